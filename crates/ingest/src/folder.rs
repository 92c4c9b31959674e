//! Ingests the trials in one or more folders in parallel and writes the tables of each trial.

use std::collections::{BTreeMap, HashSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use trilink_base::cancel::CancelToken;
use trilink_mocap::ReadError;
use trilink_tables::trial::{ListedTrial, TrialError, TrialFolder, TrialKind};
use trilink_tables::{
    Columns as _, CycleRow, Provenance, Stamp, StoreError, Table, ToDisk, TrialRow, cycles_path,
    is_own_table, poses_path, table_set, tables_in, wheels_path,
};

use super::{IngestInput, Ingested, PartialResult, ProcessedTrial, TrialFailure, process};

table_set! {
    Ingested by String: row => row.trial.clone();
    trials: "trials.parquet",
    checks: "checks.parquet",
    parameters: "robot_parameters.parquet",
}

/// Subfolders of `derived/` that hold one file per trial.
pub const TRIAL_FOLDERS: [&str; 3] = ["poses", "wheels", "cycles"];

/// Trial in a folder, with the configuration for processing it.
#[derive(Clone, Copy)]
pub struct Entry<'t> {
    pub folder: &'t TrialFolder,
    pub listed: &'t ListedTrial,
    /// Configuration for processing the trial, or the reason why its entry in the trial list cannot be used.
    pub input: &'t Result<IngestInput, TrialError>,
}

impl Entry<'_> {
    pub fn marker_file(&self) -> PathBuf {
        self.folder.path.join(&self.listed.trial.file)
    }
}

/// Stamp (size, time, hash) of a marker file when it was read, or the reason why the file could not be read.
pub type MarkerStamp = Result<Stamp, ErrorKind>;

/// Result of ingesting a trial.
#[derive(Debug)]
pub struct IngestedTrial {
    /// Rows of the tables that cover all trials.
    pub rows: Ingested,
    /// Stamp of the marker file; `None` if the file was not read.
    pub marker_file: Option<MarkerStamp>,
    /// Paths and stamps of the tables that belong to this trial alone.
    pub written: BTreeMap<PathBuf, Stamp>,
}

/// Ingests trials in parallel and writes each trial's tables. `provenance` is called after the trial's marker file has
/// been read; `on_trial` is called for each finished trial, from any thread and in any order.
///
/// # Errors
/// Returns an error if a table cannot be written or the work was cancelled. A trial that fails is reported in its row
/// instead.
pub fn ingest_trials(
    derived: &Path,
    trials: &[Entry],
    provenance: &(dyn Fn(Entry, Option<&MarkerStamp>) -> Provenance + Sync),
    on_trial: &(dyn Fn(&TrialRow) + Sync),
    cancel: &CancelToken,
) -> Result<Vec<IngestedTrial>, StoreError> {
    let (ingested, stamps) = ToDisk::during(|to_disk| {
        trials
            .par_iter()
            .with_max_len(1)
            .map(|entry| {
                cancel.check()?;
                let ingested = ingest_trial(derived, *entry, provenance, to_disk)?;
                on_trial(&ingested.0.rows.trials[0]);
                Ok(ingested)
            })
            .collect::<Result<Vec<_>, StoreError>>()
    });
    let mut stamps = stamps?;
    let mut trials = Vec::new();
    for (mut trial, paths) in ingested? {
        trial.written = paths.into_iter().filter_map(|path| stamps.remove_entry(&path)).collect();
        trials.push(trial);
    }
    Ok(trials)
}

/// Ingests one trial. Also returns the paths of the tables to be written.
fn ingest_trial(
    derived: &Path,
    entry: Entry,
    provenance: &(dyn Fn(Entry, Option<&MarkerStamp>) -> Provenance + Sync),
    to_disk: &ToDisk,
) -> Result<(IngestedTrial, Vec<PathBuf>), StoreError> {
    let Entry { folder, listed: ListedTrial { id, trial, .. }, input } = entry;
    let mut partial = PartialResult::new(trial);
    let mut marker_file = None;
    let mut paths = Vec::new();
    partial.row.folder = folder.name.clone();
    partial.row.day = trial.day.clone().unwrap_or_else(|| folder.name.clone());
    partial.row.id = id.clone();
    // Messages name the file relative to the project, so that a copy of the project gives identical messages.
    let path = Path::new(&folder.name).join(&trial.file);
    // The entry is checked before the file is read: its file name might point out of the folder.
    let input = input.as_ref().map_err(|error| TrialFailure::from(error.clone()));
    let processed = input.and_then(|input| {
        let file = trilink_mocap::read_file(&entry.marker_file());
        let file = file.map_err(|error| ReadError { path: path.clone(), ..error });
        // The content may be newer than the time in the stamp, but not older.
        marker_file = Some(match &file {
            Ok((file, metadata)) => Ok(Stamp::of_input(metadata, file)),
            Err(error) => Err(error.system().unwrap_or(ErrorKind::Other)),
        });
        process(&path, file?.0, trial, input, &mut partial)
    });
    let (row, checks, parameters) = match processed {
        Err(failure) => {
            let (row, checks) = partial.failed(&failure);
            (row, checks, None)
        }
        Ok(ProcessedTrial { row, checks, parameters, cycles, poses, wheels }) => {
            let provenance = provenance(entry, marker_file.as_ref());
            let mut write = |table: &Table, path: PathBuf| -> Result<(), StoreError> {
                to_disk.send(table.write_pending(&path, &provenance)?);
                paths.push(path);
                Ok(())
            };
            write(&poses, poses_path(derived, &trial.id))?;
            write(&wheels, wheels_path(derived, &trial.id))?;
            if trial.kind == TrialKind::Gait {
                write(&CycleRow::to_table(&cycles), cycles_path(derived, &trial.id))?;
            }
            (row, checks, parameters)
        }
    };
    let rows = Ingested { trials: vec![row], checks, parameters: parameters.into_iter().collect() };
    Ok((IngestedTrial { rows, marker_file, written: BTreeMap::new() }, paths))
}

/// Lists the tables in `derived` that this program wrote for trials that are no longer listed or have failed, so that
/// nobody mistakes them for current results. `current` has the paths, relative to `derived`, of the tables to keep.
///
/// # Errors
/// Returns an error if a folder cannot be read.
pub fn outdated_tables(
    derived: &Path,
    current: &HashSet<&str>,
) -> Result<Vec<PathBuf>, StoreError> {
    let mut paths = Vec::new();
    for folder in TRIAL_FOLDERS {
        for path in tables_in(&derived.join(folder))? {
            let name = path.file_name().and_then(|name| name.to_str());
            let is_current =
                name.is_some_and(|name| current.contains(format!("{folder}/{name}").as_str()));
            if !is_current && is_own_table(&path) {
                paths.push(path);
            }
        }
    }
    Ok(paths)
}
