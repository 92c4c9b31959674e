//! Removal of everything that a run can make again.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use trilink_base::files::absolute;
use trilink_ingest::TRIAL_FOLDERS;
use trilink_tables::config::Config;
use trilink_tables::{Stamp, StoreError, is_there};

use super::lock::{Lock, record_path};
use super::record::{RECORD_FILE, Record};
use super::{RunError, Watch};

/// Files in `reports/` that `compare` writes.
const COMPARISON: [&str; 3] = ["compare.html", "compare.xml", "compare.json"];

/// Files that [`clean`] has removed, or would remove.
#[derive(Debug, Default)]
pub struct Cleaned {
    pub files: usize,
    pub bytes: u64,
    /// Files that were not removed because they have changed since this program wrote them.
    pub changed: Vec<PathBuf>,
}

/// Removes the files in `derived/` and `reports/` that runs have written; with `dry_run`, only counts them. The
/// history, the baseline, optima stored by `optimise --keep`, raw data and files that this program did not write are
/// retained.
///
/// # Errors
/// Returns an error if another process uses the folder of results, if it is not known which files runs have written, or
/// if a file cannot be removed.
pub fn clean(
    config: &Config,
    dry_run: bool,
    wait: bool,
    watch: &dyn Watch,
) -> Result<Cleaned, RunError> {
    let paths = &config.paths;
    let (derived, reports) = (&paths.derived, &paths.reports);
    let mut cleaned = Cleaned::default();
    if !is_there(derived)? {
        return Ok(cleaned);
    }
    let waiting = wait.then_some(watch);
    let _lock = if dry_run {
        None
    } else {
        Some(Lock::take(derived, waiting).map_err(RunError::from_lock)?)
    };
    let (record, problem) = Record::load(derived);
    if let Some(problem) = problem {
        return Err(RunError::NoRecord { problem });
    }
    let in_folder =
        |folder: &Path, (name, stamp): (&String, &Stamp)| (folder.join(name), Some(stamp.clone()));
    let of_tables = record.ingest.written().chain(record.fit.written());
    let mut files: Vec<(PathBuf, Option<Stamp>)> =
        of_tables.map(|file| in_folder(derived, file)).collect();
    files.extend(record.report.written().map(|file| in_folder(reports, file)));
    // The record of results does not list these files.
    let unrecorded = COMPARISON.into_iter().chain(["history.html"]);
    files.extend(unrecorded.map(|name| (reports.join(name), None)));
    files.push((record_path(config), None));
    // The record comes last, so that an interrupted removal can be continued.
    files.push((derived.join(RECORD_FILE), None));
    let retained = [&paths.history, &paths.baseline].map(|path| absolute(path));
    for (path, stamp) in files {
        let Ok(metadata) = path.symlink_metadata() else { continue };
        if retained.contains(&absolute(&path)) {
            continue;
        }
        if stamp.is_some_and(|stamp| stamp.content_of(&path).is_none()) {
            cleaned.changed.push(path);
            continue;
        }
        cleaned.files += 1;
        cleaned.bytes += metadata.len();
        if !dry_run {
            std::fs::remove_file(&path).map_err(|source| StoreError::Remove { path, source })?;
        }
    }
    if !dry_run {
        let folders = TRIAL_FOLDERS.map(|name| derived.join(name)).into_iter();
        for folder in
            folders.chain([reports.join("figures"), reports.join("trials"), reports.clone()])
        {
            // Only empty folders can be removed in this way.
            let _ = std::fs::remove_dir(folder);
        }
    }
    Ok(cleaned)
}

/// Removes the files of the last comparison from `reports`, because its results are about to change.
///
/// # Errors
/// Returns an error if a file cannot be removed.
pub(super) fn remove_comparison(reports: &Path) -> Result<(), StoreError> {
    for path in COMPARISON.map(|name| reports.join(name)) {
        match std::fs::remove_file(&path) {
            Err(source) if source.kind() != ErrorKind::NotFound => {
                return Err(StoreError::Remove { path, source });
            }
            _ => {}
        }
    }
    Ok(())
}
