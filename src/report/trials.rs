//! A page for each trial, in `trials/`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use rayon::prelude::*;

use super::page::{self, TrialPages};
use super::recording::Recording;
use super::tables::Tables;
use super::{ReportError, ReportInput, figures};
use crate::store::{
    Reader, Stamp, StoreError, TrialRow, TrialStatus, cycles_path, hash, poses_path, wheels_path,
    write_if_changed,
};

/// Folder of the pages inside of `reports/`.
const FOLDER: &str = "trials";

/// The page that a trial has, by its path inside of `reports/`, unless another trial's name looks
/// the same.
pub fn page_of(trial: &str) -> String {
    format!("{FOLDER}/{}.html", figures::file_name(trial, &mut BTreeSet::new()))
}

/// Files of all trials' pages.
pub fn pages(tables: &Tables) -> TrialPages {
    let mut taken = BTreeSet::new();
    let file = |trial: &TrialRow| {
        let name = figures::file_name(&trial.trial, &mut taken);
        (trial.trial.clone(), format!("{name}.html"))
    };
    first_of_each(tables).map(file).collect()
}

/// The first row of every name.
fn first_of_each(tables: &Tables) -> impl Iterator<Item = &TrialRow> {
    let mut seen = BTreeSet::new();
    tables.trials.iter().filter(move |trial| seen.insert(trial.trial.as_str()))
}

/// What the page of each trial is made of, by its path inside of `reports/`. `stamp` gives the
/// hash of a file.
pub fn parts(
    input: &ReportInput,
    tables: &Tables,
    pages: &TrialPages,
    stamp: impl Fn(&Path) -> Option<String>,
) -> BTreeMap<String, BTreeMap<String, String>> {
    let derived = &input.paths.derived;
    let (mut checks, mut robots) =
        (BTreeMap::<&str, Vec<_>>::new(), BTreeMap::<&str, Vec<_>>::new());
    tables.checks.iter().for_each(|row| checks.entry(&row.trial).or_default().push(row));
    tables.robots.iter().for_each(|row| robots.entry(&row.trial).or_default().push(row));
    let of_trial = |trial: &TrialRow| {
        let name = trial.trial.as_str();
        let checks = checks.get(name).map_or(&[][..], Vec::as_slice);
        let robots = robots.get(name).map_or(&[][..], Vec::as_slice);
        let robot = input.campaign_setup(&trial.campaign);
        let rows = format!("{trial:?} {checks:?} {robots:?} {robot:?}");
        let own = [poses_path, wheels_path, cycles_path].map(|path| path(derived, name));
        let recorded = own.iter().filter_map(|path| stamp(path)).collect::<Vec<_>>().join(" ");
        let parts = BTreeMap::from([
            ("its row or checks".to_owned(), hash(rows.as_bytes())),
            ("its tables".to_owned(), recorded),
        ]);
        Some((format!("{FOLDER}/{}", pages.get(name)?), parts))
    };
    first_of_each(tables).filter_map(of_trial).collect()
}

/// Sentences on tables of single trials that do not belong together.
///
/// # Errors
/// A table is there and cannot be read.
pub fn damaged(
    input: &ReportInput,
    tables: &Tables,
    reader: &Reader,
) -> Result<Vec<String>, StoreError> {
    let trials = first_of_each(tables).filter(|trial| trial.status != TrialStatus::Failed);
    let trials: Vec<&TrialRow> = trials.collect();
    let of_trial = |trial: &TrialRow| {
        let recording = Recording::read(&input.paths.derived, &trial.trial, reader)?;
        Ok(recording.and_then(|recording| recording.problem))
    };
    trials.into_par_iter().filter_map(|trial| of_trial(trial).transpose()).collect()
}

/// Writes the pages but for those in `kept`. Gives what was written, by its path inside of
/// `reports/`.
///
/// # Errors
/// A table of a trial cannot be read, or a page not be filled in or written.
pub fn write(
    input: &ReportInput,
    (tables, reader): (&Tables, &Reader),
    pages: &TrialPages,
    kept: &BTreeSet<String>,
) -> Result<BTreeMap<String, Stamp>, ReportError> {
    let folder = input.paths.reports.join(FOLDER);
    let trials: Vec<&TrialRow> = first_of_each(tables).collect();
    let written = trials.into_par_iter().filter_map(|trial| {
        let file = pages.get(&trial.trial)?;
        let name = format!("{FOLDER}/{file}");
        let write = || {
            let recording = match trial.status {
                TrialStatus::Failed => None,
                _ => Recording::read(&input.paths.derived, &trial.trial, reader)?,
            };
            let of_trial = |recording| figures::trial::figures(trial, recording, input);
            let figures = recording.as_ref().map_or(Vec::new(), of_trial);
            let images = figures.iter().map(page::image).collect::<Result<Vec<_>, _>>()?;
            let html = page::trial_html(trial, tables, recording.as_ref(), &images)?;
            Ok((name.clone(), write_if_changed(&folder.join(file), html.as_bytes())?))
        };
        (!kept.contains(&name)).then(write)
    });
    written.collect()
}
