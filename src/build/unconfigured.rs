//! Runs without a configuration file: the paper's experiment is assumed if any trial can belong to it.

use std::io::ErrorKind;

use trilink_ingest::{IngestInput, TrialFailure};
use trilink_tables::TrialRow;
use trilink_tables::config::{Config, ConfigError};
use trilink_tables::trial::{ListedTrial, TrialError, TrialFolders, TrialKind};

use super::{RunError, ingested};

/// Checks that the default configuration matches at least one trial in the folders, as judged by the names in the
/// trial's entry and the labels in its marker file. If there are gait trials, only these are checked. A trial that does
/// not match fails on its own when it is processed.
///
/// # Errors
/// Returns an error if the defaults match no trial, or if there is no list of trials.
pub fn check_unconfigured(config: &Config) -> Result<(), RunError> {
    let folders = config.paths.raw.iter().filter(|folder| folder.is_dir());
    let folders: Vec<String> = folders.map(|folder| folder.display().to_string()).collect();
    let folders = if folders.is_empty() { "FOLDER".to_owned() } else { folders.join(" ") };
    let unconfigured = |why| Err(RunError::Unconfigured { why, folders });
    let TrialFolders { folders: all, mut trials } = match TrialFolders::load(&config.paths) {
        Err(error @ ConfigError::Read { .. }) if is_absent(&error) => {
            return unconfigured(error.to_string());
        }
        found => found?,
    };
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
    unconfigured(format!(
        "0 of {} trials match the robots of the paper's experiment{why}",
        trials.len()
    ))
}

/// Whether an error means that a file is missing, rather than unreadable.
fn is_absent(error: &ConfigError) -> bool {
    matches!(error, ConfigError::Read { source, .. } if source.kind() == ErrorKind::NotFound)
}

/// Checks that the default configuration contains the campaign of at least one ingested trial. Unlike
/// [`check_unconfigured`], this function compares only the names of campaigns.
///
/// # Errors
/// Returns an error if there are gait trials and the defaults contain none of their campaigns, or if a table cannot be
/// read.
pub fn check_unconfigured_tables(config: &Config) -> Result<(), RunError> {
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
    Err(RunError::Unconfigured { why, folders })
}
