//! A page for each trial, in `trials/`.

use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::path::Path;

use rayon::prelude::*;

use super::font::Typeface;
use super::page::{self, Drawn, TrialPages};
use super::recording::Recording;
use super::tables::Tables;
use super::{ReportError, figures, plot, render};
use crate::config::Config;
use crate::store::{TrialRow, write_if_changed};

/// Folder of the pages inside of `reports/`.
const FOLDER: &str = "trials";

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

/// Writes them, and removes those of trials that are no longer there.
///
/// # Errors
/// A page cannot be filled in or written, or an old one not removed.
pub fn write(config: &Config, tables: &Tables, pages: &TrialPages) -> Result<(), ReportError> {
    let folder = config.paths.reports.join(FOLDER);
    let trials: Vec<&TrialRow> = first_of_each(tables).collect();
    trials.into_par_iter().try_for_each(|trial| {
        let Some(file) = pages.get(&trial.trial) else { return Ok(()) };
        let recording = match trial.status.as_str() {
            "failed" => None,
            _ => Recording::read(&config.paths.derived, &trial.trial).ok(),
        };
        let html = html(trial, tables, recording.as_ref(), config)?;
        write_if_changed(&folder.join(file), html.as_bytes())?;
        Ok::<(), ReportError>(())
    })?;
    remove_others(&folder, pages)
}

fn html(
    trial: &TrialRow,
    tables: &Tables,
    recording: Option<&Recording>,
    config: &Config,
) -> Result<String, ReportError> {
    let font = Typeface::load()?;
    let figures =
        recording.map_or(Vec::new(), |recording| figures::trial::figures(trial, recording, config));
    let draw = |figure| -> Result<Drawn, ReportError> {
        Ok(Drawn { figure, svg: render::svg(figure)?, size: plot::size(figure, font) })
    };
    let drawn = figures.iter().map(draw).collect::<Result<Vec<_>, _>>()?;
    page::trial_html(trial, tables, recording, &drawn)
}

fn remove_others(folder: &Path, pages: &TrialPages) -> Result<(), ReportError> {
    let error = |path: &Path, source| ReportError::Remove { path: path.to_owned(), source };
    let written: BTreeSet<&str> = pages.values().map(String::as_str).collect();
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(source) if source.kind() == ErrorKind::NotFound => return Ok(()),
        Err(source) => return Err(error(folder, source)),
    };
    for entry in entries {
        let entry = entry.map_err(|source| error(folder, source))?;
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name.ends_with(".html") && !written.contains(name.as_ref()) {
            let path = entry.path();
            std::fs::remove_file(&path).map_err(|source| error(&path, source))?;
        }
    }
    Ok(())
}
