//! Without a configuration file the paper's experiment is assumed, if any trial can belong to it.

use std::io::ErrorKind;

use trilink_ingest::{IngestInput, TrialFailure};
use trilink_tables::TrialRow;
use trilink_tables::config::{Config, ConfigError};
use trilink_tables::trial::{ListedTrial, TrialFolders, TrialKind};

use super::{RunError, ingested};

/// Checks that the defaults match at least one trial of the folders (with a gait, if any has one):
/// the names in its entry and the labels of its marker file. Trials that do not match fail later,
/// one by one.
///
/// # Errors
/// They describe none; or there is no list of trials.
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
    for ListedTrial { folder, trial, .. } in &trials {
        let input = IngestInput::new(config, trial).map_err(TrialFailure::from);
        match input.and_then(|of| of.check_labels(&all[*folder].path.join(&trial.file))) {
            Ok(()) => return Ok(()),
            Err(failure) => _ = first.get_or_insert(failure),
        }
    }
    let why = first.map_or(String::new(), |failure| format!(": {failure}"));
    unconfigured(format!("not one trial of {} is of its robots{why}", trials.len()))
}

fn is_absent(error: &ConfigError) -> bool {
    matches!(error, ConfigError::Read { source, .. } if source.kind() == ErrorKind::NotFound)
}

/// [`check_unconfigured`] of the trials that are ingested, of which names alone are looked at.
///
/// # Errors
/// There are trials with a gait, and the defaults describe none of them; or a table cannot be read.
pub fn check_unconfigured_tables(config: &Config) -> Result<(), RunError> {
    let mut trials = ingested(config)?.trials;
    trials.retain(|row| !row.campaign.is_empty());
    let is_known = |row: &TrialRow| config.campaign.contains_key(&row.campaign);
    let Some(first) = trials.first().filter(|_| !trials.iter().any(is_known)) else {
        return Ok(());
    };
    let (all, campaign) = (trials.len(), &first.campaign);
    let why = format!("not one ingested trial of {all} is of its campaigns: found `{campaign}`");
    let folders = config.paths.base.join(&first.folder).display().to_string();
    Err(RunError::Unconfigured { why, folders })
}
