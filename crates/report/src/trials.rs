//! Pages on individual trials, in the folder `trials/`.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::SQRT_2;
use std::path::Path;

use rayon::prelude::*;
use trilink_robot::AnyRobot;
use trilink_tables::{Reader, ToDisk, TrialRow, TrialStatus, cycles_path, poses_path, wheels_path};

use super::page::{self, TrialPages};
use super::recording::Recording;
use super::tables::Tables;
use super::truth::Truth;
use super::{ReportError, ReportInput, figures, hash_of, replay};

/// For each trial page, keyed by its path within `reports/`: the campaign, and hashes of the page's inputs, keyed by
/// descriptions of these inputs.
pub(crate) type PageParts = BTreeMap<String, (String, BTreeMap<String, String>)>;

/// Folder within `reports/` that contains the trial pages.
const FOLDER: &str = "trials";

/// Returns the path of a trial's page within `reports/`, on the assumption that no other trial's name gives the same
/// file name.
pub fn page_of(trial: &str) -> String {
    format!("{FOLDER}/{}.html", figures::file_name(trial, &mut BTreeSet::new()))
}

/// Returns the file names of the trial pages, keyed by trial.
///
/// Every trial has a page if there are at most `trial_pages` trials. Otherwise, the trials with a page are those whose
/// pages were requested, and up to `trial_pages` trials that failed, are flagged or are the first for their campaign
/// and frequency.
pub(crate) fn pages(input: &ReportInput, tables: &Tables) -> TrialPages {
    let mut taken = BTreeSet::new();
    let mut conditions = BTreeSet::new();
    let mut trials: Vec<_> = first_of_each(tables)
        .map(|trial| {
            let omega = trial.omega_commanded_rad_s.to_bits();
            let is_first = conditions.insert((&trial.campaign, trial.kind, omega));
            let rank = match trial.status {
                TrialStatus::Failed | TrialStatus::Ignored => 0,
                TrialStatus::Flagged => 1,
                TrialStatus::Ok => 3 - usize::from(is_first),
            };
            (rank, trial, figures::file_name(&trial.trial, &mut taken))
        })
        .collect();
    let max_pages = input.trial_pages();
    if trials.len() > max_pages {
        trials.sort_by_key(|(rank, ..)| *rank);
        let shown = trials.iter().take(max_pages).filter(|(rank, ..)| *rank < 3).count();
        let mut others = trials.split_off(shown);
        others.retain(|(_, trial, _)| input.asked_pages.contains(&trial.trial));
        trials.extend(others);
    }
    trials
        .into_iter()
        .map(|(_, trial, name)| (trial.trial.clone(), format!("{name}.html")))
        .collect()
}

/// Returns the name of the robot used in a trial: the robot of the trial's campaign, or the robot whose parameters the
/// trial measures; `None` if neither is known.
fn robot_of<'t>(trial: &TrialRow, input: &'t ReportInput, tables: &'t Tables) -> Option<&'t str> {
    input.robot_name(&trial.campaign).or_else(|| {
        let row = tables.robots.iter().find(|row| row.trial == trial.trial)?;
        Some(&row.robot)
    })
}

/// Returns, for each robot, the skid velocity (m/s) that sets the scale of the arrows in the replays of its trials: the
/// largest amplitude in any trial, rounded up so that a further trial rarely changes it.
fn skid_scales<'t>(input: &'t ReportInput, tables: &'t Tables) -> BTreeMap<&'t str, f64> {
    let mut largest: BTreeMap<&str, f64> = BTreeMap::new();
    for trial in &tables.trials {
        let Some(name) = robot_of(trial, input, tables) else { continue };
        let Some(robot) = input.robot(name) else { continue };
        let sigma = trial.metrics.sigma.into_iter().fold(0.0, f64::max);
        // The skid ratio is the RMS of the velocity over l omega (eq. 20 of the paper).
        let amplitude_m_s = SQRT_2 * sigma * skid_length_m(&robot) * trial.omega_rad_s;
        if amplitude_m_s.is_finite() && amplitude_m_s > 0.0 {
            let entry = largest.entry(name).or_default();
            *entry = entry.max(replay::nice(amplitude_m_s));
        }
    }
    largest
}

/// Returns the length l by which the skid velocities of a robot are normalised (eq. 20 of the paper), m.
fn skid_length_m(robot: &AnyRobot) -> f64 {
    match robot {
        AnyRobot::ThreeLinks(robot) => robot.skid_length_m(),
        AnyRobot::Chain(chain) => chain.skid_length_m,
    }
}

/// Returns the first row for each trial name, except ignored trials.
fn first_of_each(tables: &Tables) -> impl Iterator<Item = &TrialRow> {
    let mut seen = BTreeSet::new();
    let read = tables.trials.iter().filter(|trial| trial.status != TrialStatus::Ignored);
    read.filter(move |trial| seen.insert(trial.trial.as_str()))
}

/// Returns the campaign and the input hashes of each trial page, keyed by the page's path within `reports/`. `stamp`
/// returns the hash of a file.
pub(crate) fn parts(
    input: &ReportInput,
    (tables, truth): (&Tables, Option<&Truth>),
    pages: &TrialPages,
    stamp: impl Fn(&Path) -> Option<String>,
) -> PageParts {
    let derived = &input.paths.derived;
    let mut checks = BTreeMap::<&str, Vec<_>>::new();
    let mut robots = BTreeMap::<&str, Vec<_>>::new();
    tables.checks.iter().for_each(|row| checks.entry(&row.trial).or_default().push(row));
    tables.robots.iter().for_each(|row| robots.entry(&row.trial).or_default().push(row));
    // Trial pages also show motions of models that are not fitted to the campaign.
    let laws = hash_of(input.models());
    let fits: BTreeMap<&str, _> = tables
        .campaigns(input)
        .into_iter()
        .map(|campaign| (campaign, tables.preferred(campaign)))
        .collect();
    let scales = skid_scales(input, tables);
    let with_page =
        first_of_each(tables).filter_map(|trial| Some((trial, pages.get(&trial.trial)?)));
    with_page
        .map(|(trial, page)| {
            let name = trial.trial.as_str();
            let checks = checks.get(name).map_or(&[][..], Vec::as_slice);
            let robots = robots.get(name).map_or(&[][..], Vec::as_slice);
            let setup = input.setup(&trial.campaign);
            let robot = robots.first().and_then(|row| input.robot(&row.robot));
            let markers = robot_of(trial, input, tables).and_then(|name| input.marker_layout(name));
            let neighbours = page::neighbours(trial, tables, pages);
            let scale = robot_of(trial, input, tables).and_then(|name| scales.get(name));
            let is_synthetic = truth.is_some_and(|truth| truth.is_synthetic(trial));
            let rows =
                (trial, checks, robots, setup, robot, markers, neighbours, is_synthetic, scale);
            let own = [poses_path, wheels_path, cycles_path].map(|path| path(derived, name));
            let recorded = own.iter().filter_map(|path| stamp(path)).collect::<Vec<_>>().join(" ");
            let source = tables.source(input);
            let models = source.models(&trial.campaign).into_iter();
            let predicted: Vec<_> =
                models.filter_map(|model| source.of_trial(trial, model)).collect();
            let models = (predicted, fits.get(&*trial.campaign), &laws);
            let parts = BTreeMap::from([
                ("its row or checks".to_owned(), hash_of(&rows)),
                ("its campaign's models".to_owned(), hash_of(&models)),
                ("its tables".to_owned(), recorded),
            ]);
            (format!("{FOLDER}/{page}"), (trial.campaign.clone(), parts))
        })
        .collect()
}

/// Trial pages that were written, and problems that were found.
#[derive(Debug, Default)]
pub(crate) struct PagesWritten {
    /// Paths of the written pages within `reports/`.
    pub pages: Vec<String>,
    /// Sentences that describe inconsistent tables of individual trials.
    pub damaged: Vec<String>,
}

/// Reads the tables of every trial and writes all trial pages except those in `kept`, which are up to date.
///
/// # Errors
/// Returns an error if an existing table of a trial cannot be read, or if a page cannot be rendered or written.
pub(crate) fn write(
    input: &ReportInput,
    ((tables, truth), reader): ((&Tables, Option<&Truth>), &Reader),
    pages: &TrialPages,
    kept: &BTreeSet<String>,
    to_disk: &ToDisk,
) -> Result<PagesWritten, ReportError> {
    let trials: Vec<&TrialRow> = first_of_each(tables).collect();
    let inputs = (tables, input);
    let scales = skid_scales(input, tables);
    let written = trials.into_par_iter().with_max_len(1).map(|trial| {
        let recording = match trial.status {
            TrialStatus::Failed | TrialStatus::Ignored => None,
            TrialStatus::Ok | TrialStatus::Flagged => {
                let TrialRow { trial, smoothing_window, .. } = trial;
                Recording::read(&input.paths.derived, trial, *smoothing_window, reader)?
            }
        };
        let problem = recording.as_ref().and_then(|recording| recording.problem.clone());
        let page = pages.get(&trial.trial).map(|file| format!("{FOLDER}/{file}"));
        let page = page.filter(|page| !kept.contains(page));
        if let Some(page) = &page {
            let is_synthetic = truth.is_some_and(|truth| truth.is_synthetic(trial));
            let mut figures = recording
                .as_ref()
                .map_or(Vec::new(), |recording| figures::trial::figures(trial, recording, inputs));
            let row = tables.robots.iter().find(|row| row.trial == trial.trial);
            let decay = row.zip(recording.as_ref());
            let decay = decay.and_then(|(row, recording)| figures::decay(row, recording, input));
            figures.splice(0..0, decay);
            figures.iter_mut().for_each(|figure| figure.is_synthetic = is_synthetic);
            let images = figures.iter().map(page::image).collect::<Result<Vec<_>, _>>()?;
            let replay = recording.as_ref().zip(robot_of(trial, input, tables));
            let replay = replay.and_then(|(recording, robot)| {
                let fit = tables.preferred(&trial.campaign);
                let scale = scales.get(robot).copied();
                replay::of_trial(trial, recording, robot, input, fit, scale)
            });
            let recording = recording.as_ref();
            let replay = replay.as_ref();
            let html =
                page::trial_html(trial, inputs, pages, is_synthetic, recording, replay, &images)?;
            to_disk.write_if_changed(&input.paths.reports.join(page), html.as_bytes())?;
        }
        Ok((page, problem))
    });
    let written = written.collect::<Result<Vec<_>, ReportError>>()?;
    let (pages, damaged): (Vec<_>, Vec<_>) = written.into_iter().unzip();
    let [pages, damaged] = [pages, damaged].map(|all| all.into_iter().flatten().collect());
    Ok(PagesWritten { pages, damaged })
}
