//! Outcome of the last run, and checks that must pass before the results of a run are read.

use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};
use trilink_tables::config::Config;
use trilink_tables::{Reader, RunStatus, StoreError, is_there};

use super::lock::{Lock, record_path, take_over};
use super::record::{RECORD_FILE, Record, changed_outputs};
use super::{RunError, Watch};

/// Outcome of the last run, as read from `run.json`.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub struct LastRun {
    pub status: RunStatus,
    /// Start time of the run (UTC).
    pub started: String,
    /// Error that ended the run; `None` if there was none.
    pub error: Option<String>,
    /// End time of the run (UTC); `None` if the run was killed.
    pub ended: Option<String>,
}

impl LastRun {
    /// Reads `run.json`; returns `None` if the file is missing or invalid.
    pub fn load(config: &Config) -> Option<Self> {
        serde_json::from_slice(&Reader::default().bytes(&record_path(config)).ok()?).ok()
    }
}

/// Locks the folder of results, so that no run can change it while the returned lock is held.
///
/// # Errors
/// Returns an error if there are no results, if another process uses the folder, or if the folder cannot be written to.
pub fn hold(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Lock, RunError> {
    let path = config.paths.derived.join("trials.parquet");
    if !is_there(&path)? {
        return Err(StoreError::NotIngested { path }.into());
    }
    take_over(config, wait, watch)
}

/// Checks that the tables are those of a completed run and, if `max_age` is given, that a run within this time made
/// them or confirmed that they are up to date. The caller must hold the lock.
///
/// # Errors
/// Returns an error if the last run was not completed, or if no run has confirmed the tables within `max_age`.
pub fn check_finished(
    _lock: &Lock,
    config: &Config,
    max_age: Option<Duration>,
) -> Result<(), RunError> {
    let derived = &config.paths.derived;
    let path = record_path(config);
    let error = |path: PathBuf, problem: String| Err(RunError::Unfinished { path, problem });
    let Some(LastRun { status, started, error: why, .. }) = LastRun::load(config) else {
        let problem = match path.try_exists() {
            Ok(true) => "is not the record of a run".to_owned(),
            Ok(false) => "does not exist".to_owned(),
            Err(source) => format!("cannot be read: {source}"),
        };
        return error(path, problem);
    };
    let began = format!("the run that began at {started}");
    match status {
        RunStatus::Ok | RunStatus::Attention => {}
        // A run that were still going on would hold the lock.
        RunStatus::Running => return error(path, format!("{began} was killed before it ended")),
        RunStatus::Failed | RunStatus::Interrupted => {
            let why = why.map_or(String::new(), |why| format!(": {why}"));
            return error(path, format!("{began}: {status}{why}"));
        }
    }
    let (known, _) = Record::load(derived);
    if known.run.is_none_or(|stamp| stamp.content_of(&path).is_none()) {
        return error(path, format!("{began} is older than the tables"));
    }
    let tables = known.ingest.outputs.into_iter().chain(known.fit.outputs).collect();
    if let Some(changed) = changed_outputs(derived, &tables, true).into_iter().next() {
        return error(derived.clone(), changed);
    }
    let path = derived.join(RECORD_FILE);
    let modified = std::fs::metadata(&path).and_then(|metadata| metadata.modified());
    let modified = modified.map_err(|source| StoreError::Read { path: path.clone(), source })?;
    // A modification time in the future counts as age 0.
    let age = SystemTime::now().duration_since(modified).unwrap_or_default();
    match max_age.filter(|max_age| age > *max_age) {
        Some(max_age) => {
            let [age, max_age] = [age, max_age].map(|time| time.as_secs_f64() / 3600.0);
            let confirmed = "the tables were last confirmed to be up to date";
            error(path, format!("{confirmed} {age:.1} h ago; --max-age allows {max_age} h"))
        }
        None => Ok(()),
    }
}

/// Sets the modification time of `up-to-date.json` to now, after a run that found everything up to date. The content
/// does not change; errors (for example in a read-only folder) are ignored.
pub(super) fn confirm(config: &Config) {
    let path = config.paths.derived.join(RECORD_FILE);
    let record = std::fs::File::options().append(true).open(path);
    let _ = record.and_then(|record| record.set_modified(SystemTime::now()));
}
