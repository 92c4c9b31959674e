//! How the last run ended, and its results for who reads all of them.

use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use serde::Deserialize;
use trilink_tables::config::Config;
use trilink_tables::{Reader, RunStatus, StoreError, is_there};

use super::lock::{Lock, record_path, take_over};
use super::record::{RECORD_FILE, Record, changed_outputs};
use super::{RunError, Watch};

/// What `run.json` says of the last run.
#[derive(Debug, Deserialize)]
pub(super) struct LastRun {
    pub status: RunStatus,
    /// UTC.
    pub started: String,
    /// Why it did not come to its end.
    pub error: Option<String>,
}

impl LastRun {
    /// `None` if there is no `run.json` that can be understood.
    pub(super) fn load(config: &Config) -> Option<Self> {
        serde_json::from_slice(&Reader::default().bytes(&record_path(config)).ok()?).ok()
    }
}

/// Keeps runs from a folder of results while this lives.
///
/// # Errors
/// Another process is busy with the folder, or it cannot be written to.
pub fn hold(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Lock, RunError> {
    let path = config.paths.derived.join("trials.parquet");
    if !is_there(&path)? {
        return Err(StoreError::NotIngested { path }.into());
    }
    take_over(config, wait, watch)
}

/// Makes sure that the tables are those of a run that came to its end, and that a run has found
/// them up to date within `max_age`. Who asks holds the lock.
///
/// # Errors
/// They are not.
pub fn check_finished(
    _lock: &Lock,
    config: &Config,
    max_age: Option<Duration>,
) -> Result<(), RunError> {
    let (derived, path) = (&config.paths.derived, record_path(config));
    let error = |path: PathBuf, problem: String| Err(RunError::Unfinished { path, problem });
    let Some(LastRun { status, started, error: why }) = LastRun::load(config) else {
        let problem = match path.try_exists() {
            Ok(true) => "is no record of a run".to_owned(),
            Ok(false) => "is not there".to_owned(),
            Err(source) => format!("cannot be read: {source}"),
        };
        return error(path, problem);
    };
    let began = format!("the run that began at {started}");
    match status {
        RunStatus::Ok | RunStatus::Attention => {}
        // Who runs holds the lock.
        RunStatus::Running => return error(path, format!("{began} was killed")),
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
    // A time to come has no age.
    let age = SystemTime::now().duration_since(modified).unwrap_or_default();
    match max_age.filter(|max_age| age > *max_age) {
        Some(max_age) => {
            let [age, max_age] = [age, max_age].map(|time| time.as_secs_f64() / 3600.0);
            error(path, format!("last confirmed {age:.1} h ago, needed {max_age} h at most"))
        }
        None => Ok(()),
    }
}

/// Notes that a run has found everything up to date: the record then is as young as that, while
/// no file has another content. A folder that cannot be written to stays as it is.
pub(super) fn confirm(config: &Config) {
    let path = config.paths.derived.join(RECORD_FILE);
    let record = std::fs::File::options().append(true).open(path);
    let _ = record.and_then(|record| record.set_modified(SystemTime::now()));
}
