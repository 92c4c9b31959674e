//! Runs without a configuration file: the paper's experiment is assumed if any trial can belong to it.

use std::path::Path;

use trilink_ingest::{IngestInput, TrialFailure};
use trilink_mocap::marker_files;
use trilink_tables::config::{Config, ConfigError};
use trilink_tables::trial::{ListedTrial, TrialError, TrialFolders, TrialKind};
use trilink_tables::{TrialRow, is_there};

use super::{RunError, ingested};

/// Reads the lists of trials in a folder without a configuration file.
///
/// # Errors
/// Returns an error if a list is missing or invalid.
pub fn load_unconfigured(config: &Config) -> Result<TrialFolders, RunError> {
    match TrialFolders::load(&config.paths) {
        Err(ConfigError::NoTrialFolder(_) | ConfigError::NoTrialList(_)) => {
            Err(RunError::NoProject { advice: advice(&marker_folders(config)) })
        }
        found => Ok(found?),
    }
}

/// Returns the configured trial folders that exist, the current folder if none does but it contains marker files, or
/// otherwise a placeholder.
fn marker_folders(config: &Config) -> String {
    let folders = config.paths.raw.iter().filter(|folder| folder.is_dir());
    let folders: Vec<String> = folders.map(|folder| folder.display().to_string()).collect();
    if !folders.is_empty() {
        folders.join(" ")
    } else if marker_files(Path::new(".")).is_ok_and(|files| !files.is_empty()) {
        ".".to_owned()
    } else {
        "FOLDER".to_owned()
    }
}

/// Advises how to configure the trials in `folders`.
fn advice(folders: &str) -> String {
    format!(
        "name the configuration with -c FILE, or create one with `trilink init {folders}` (`trilink demo` shows the \
         paper's experiment)"
    )
}

/// Checks that the default configuration matches at least one trial in the folders, as judged by the names in the
/// trial's entry and the labels in its marker file. If there are gait trials, only these are checked. A trial that does
/// not match fails on its own when it is processed.
///
/// # Errors
/// Returns an error if the defaults match no trial, or if there is no list of trials.
pub fn check_unconfigured(config: &Config) -> Result<(), RunError> {
    let TrialFolders { folders: all, mut trials, .. } = load_unconfigured(config)?;
    let is_of_gait = |listed: &ListedTrial| listed.trial.kind == TrialKind::Gait;
    if trials.iter().any(is_of_gait) {
        trials.retain(is_of_gait);
    }
    let mut first = None;
    for ListedTrial { folder, id, trial } in &trials {
        let input = IngestInput::new(config, trial)
            .map_err(|error| TrialFailure::from(TrialError { trial: id.clone(), ..error }));
        match input.and_then(|input| input.check_labels(&all[*folder].path.join(&trial.file))) {
            Ok(()) => return Ok(()),
            Err(failure) => _ = first.get_or_insert(failure),
        }
    }
    let why = first.map_or(String::new(), |failure| format!(": {failure}"));
    let all = trials.len();
    let why = format!("0 of {all} trials match the robots of the paper's experiment{why}");
    Err(RunError::Unconfigured { why, advice: advice(&marker_folders(config)) })
}

/// Checks that a folder without a configuration file has results.
///
/// # Errors
/// Returns an error if there are no results, or if their folder cannot be accessed.
pub fn check_results(config: &Config) -> Result<(), RunError> {
    if is_there(&config.paths.derived)? {
        Ok(())
    } else {
        Err(RunError::NoProject { advice: advice(&marker_folders(config)) })
    }
}

/// Checks that the default configuration contains the campaign of at least one ingested trial. Unlike
/// [`check_unconfigured`], this function compares only the names of campaigns.
///
/// # Errors
/// Returns an error if there are no results, if there are gait trials and the defaults contain none of their campaigns,
/// or if a table cannot be read.
pub fn check_unconfigured_tables(config: &Config) -> Result<(), RunError> {
    check_results(config)?;
    let mut trials = ingested(config)?.trials;
    trials.retain(|row| !row.campaign.is_empty());
    let is_known = |row: &TrialRow| config.campaign.contains_key(&row.campaign);
    let Some(first) = trials.first().filter(|_| !trials.iter().any(is_known)) else {
        return Ok(());
    };
    let all = trials.len();
    let campaign = &first.campaign;
    let why = format!(
        "0 of {all} ingested trials belong to a campaign of the paper's experiment: found `{campaign}`"
    );
    let folders = config.paths.base.join(&first.folder).display().to_string();
    Err(RunError::Unconfigured { why, advice: advice(&folders) })
}
