//! A page for each trial, in `trials/`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use rayon::prelude::*;
use trilink_robot::Robot;
use trilink_tables::{Reader, ToDisk, TrialRow, TrialStatus, cycles_path, poses_path, wheels_path};

use super::page::{self, TrialPages};
use super::recording::Recording;
use super::tables::Tables;
use super::truth::Truth;
use super::{ReportError, ReportInput, figures, hash_of, replay};

/// Campaigns of pages and what these are made of, by path inside of `reports/`.
pub(crate) type PageParts = BTreeMap<String, (String, BTreeMap<String, String>)>;

/// Folder of the pages inside of `reports/`.
const FOLDER: &str = "trials";

/// The page that a trial has, by its path inside of `reports/`, unless another trial's name looks
/// the same.
pub fn page_of(trial: &str) -> String {
    format!("{FOLDER}/{}.html", figures::file_name(trial, &mut BTreeSet::new()))
}

/// Files of the trials' pages: of all trials, or where these are more than the configuration
/// allows of so many that failed, are flagged, or are the first of their campaign and frequency,
/// and of those that were asked for.
pub(crate) fn pages(input: &ReportInput, tables: &Tables) -> TrialPages {
    let (mut taken, mut conditions) = (BTreeSet::new(), BTreeSet::new());
    let mut trials: Vec<_> = first_of_each(tables)
        .map(|trial| {
            let omega = trial.omega_commanded_rad_s.to_bits();
            let is_first = conditions.insert((&trial.campaign, trial.kind, omega));
            let rank = match trial.status {
                TrialStatus::Failed => 0,
                TrialStatus::Flagged => 1,
                TrialStatus::Ok => 3 - usize::from(is_first),
            };
            (rank, trial, figures::file_name(&trial.trial, &mut taken))
        })
        .collect();
    let most = input.trial_pages();
    if trials.len() > most {
        trials.sort_by_key(|(rank, ..)| *rank);
        let shown = trials.iter().take(most).filter(|(rank, ..)| *rank < 3).count();
        let is_asked = |trial: &TrialRow| input.asked_pages.contains(&trial.trial);
        let asked = trials.split_off(shown).into_iter().filter(|(_, trial, _)| is_asked(trial));
        trials.extend(asked.collect::<Vec<_>>());
    }
    let file = |(_, trial, name): (_, &TrialRow, _)| (trial.trial.clone(), format!("{name}.html"));
    trials.into_iter().map(file).collect()
}

/// The robot of a trial: its campaign's, or the one that it was to tell about.
fn robot_of(trial: &TrialRow, input: &ReportInput, tables: &Tables) -> Option<Robot> {
    let of_campaign = input.campaign_setup(&trial.campaign).map(|(robot, _)| robot);
    let named = || tables.robots.iter().find(|row| row.trial == trial.trial);
    of_campaign.or_else(|| input.robot(&named()?.robot))
}

/// The first row of every name.
fn first_of_each(tables: &Tables) -> impl Iterator<Item = &TrialRow> {
    let mut seen = BTreeSet::new();
    tables.trials.iter().filter(move |trial| seen.insert(trial.trial.as_str()))
}

/// The campaign of each trial's page and what the page is made of, by its path inside of `reports/`.
/// `stamp` gives the hash of a file.
pub(crate) fn parts(
    input: &ReportInput,
    (tables, truth): (&Tables, Option<&Truth>),
    pages: &TrialPages,
    stamp: impl Fn(&Path) -> Option<String>,
) -> PageParts {
    let derived = &input.paths.derived;
    let (mut checks, mut robots) =
        (BTreeMap::<&str, Vec<_>>::new(), BTreeMap::<&str, Vec<_>>::new());
    tables.checks.iter().for_each(|row| checks.entry(&row.trial).or_default().push(row));
    tables.robots.iter().for_each(|row| robots.entry(&row.trial).or_default().push(row));
    // A page shows motions of models that its campaign does not fit, too.
    let laws = hash_of(input.models());
    let fit = |campaign| (campaign, tables.preferred(campaign));
    let fits: BTreeMap<&str, _> = tables.campaigns(input).into_iter().map(fit).collect();
    let of_trial = |(trial, page): (&TrialRow, &String)| {
        let name = trial.trial.as_str();
        let checks = checks.get(name).map_or(&[][..], Vec::as_slice);
        let robots = robots.get(name).map_or(&[][..], Vec::as_slice);
        let setup = input.campaign_setup(&trial.campaign);
        let robot = robots.first().and_then(|row| input.robot(&row.robot));
        let beside = page::neighbours(trial, tables, pages);
        let is_synthetic = truth.is_some_and(|truth| truth.is_synthetic(trial));
        let rows = (trial, checks, robots, setup, robot, input.markers(), beside, is_synthetic);
        let own = [poses_path, wheels_path, cycles_path].map(|path| path(derived, name));
        let recorded = own.iter().filter_map(|path| stamp(path)).collect::<Vec<_>>().join(" ");
        let source = tables.source(input);
        let models = source.models(&trial.campaign).into_iter();
        let predicted: Vec<_> = models.filter_map(|model| source.of_trial(trial, model)).collect();
        let models = (predicted, fits.get(&*trial.campaign), &laws);
        let parts = BTreeMap::from([
            ("its row or checks".to_owned(), hash_of(&rows)),
            ("its campaign's models".to_owned(), hash_of(&models)),
            ("its tables".to_owned(), recorded),
        ]);
        (format!("{FOLDER}/{page}"), (trial.campaign.clone(), parts))
    };
    let with_page =
        first_of_each(tables).filter_map(|trial| Some((trial, pages.get(&trial.trial)?)));
    with_page.map(of_trial).collect()
}

/// What [`write`] found and did.
#[derive(Debug, Default)]
pub(crate) struct PagesWritten {
    /// Paths inside of `reports/`.
    pub pages: Vec<String>,
    /// Sentences on tables of single trials that do not belong together.
    pub damaged: Vec<String>,
}

/// Looks at the tables of every trial and writes the pages but for those in `kept`.
///
/// # Errors
/// A table of a trial is there and cannot be read, or a page not be filled in or written.
pub(crate) fn write(
    input: &ReportInput,
    ((tables, truth), reader): ((&Tables, Option<&Truth>), &Reader),
    pages: &TrialPages,
    kept: &BTreeSet<String>,
    to_disk: &ToDisk,
) -> Result<PagesWritten, ReportError> {
    let trials: Vec<&TrialRow> = first_of_each(tables).collect();
    let inputs = (tables, input);
    let written = trials.into_par_iter().with_max_len(1).map(|trial| {
        let recording = match trial.status {
            TrialStatus::Failed => None,
            _ => {
                let TrialRow { trial, smoothing_window, .. } = trial;
                Recording::read(&input.paths.derived, trial, *smoothing_window, reader)?
            }
        };
        let problem = recording.as_ref().and_then(|recording| recording.problem.clone());
        let page = pages.get(&trial.trial).map(|file| format!("{FOLDER}/{file}"));
        let page = page.filter(|page| !kept.contains(page));
        if let Some(page) = &page {
            let of_trial = |recording| figures::trial::figures(trial, recording, inputs);
            let is_synthetic = truth.is_some_and(|truth| truth.is_synthetic(trial));
            let mut figures = recording.as_ref().map_or(Vec::new(), of_trial);
            figures.iter_mut().for_each(|figure| figure.is_synthetic = is_synthetic);
            let images = figures.iter().map(page::image).collect::<Result<Vec<_>, _>>()?;
            let replay = recording.as_ref().zip(robot_of(trial, input, tables));
            let replay = replay.and_then(|(recording, robot)| {
                let fit = tables.preferred(&trial.campaign);
                replay::of_trial(trial, recording, robot, input, fit)
            });
            let (recording, replay) = (recording.as_ref(), replay.as_ref());
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
