//! The trials of folders, side by side, and their tables.

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

use super::{IngestInput, Ingested, Known, ProcessedTrial, TrialFailure, process};

table_set! {
    Ingested by String: row => row.trial.clone();
    trials: "trials.parquet",
    checks: "checks.parquet",
    parameters: "robot_parameters.parquet",
}

/// Folders inside `derived/` with a file for each trial.
pub const FOLDERS: [&str; 3] = ["poses", "wheels", "cycles"];

/// A trial of a folder.
#[derive(Clone, Copy)]
pub struct Entry<'t> {
    pub folder: &'t TrialFolder,
    pub listed: &'t ListedTrial,
    /// What it is processed with, if its entry can be used.
    pub input: &'t Result<IngestInput, TrialError>,
}

impl Entry<'_> {
    pub fn marker_file(&self) -> PathBuf {
        self.folder.path.join(&self.listed.trial.file)
    }
}

/// The stamp of a marker file as it was read; or why it could not be.
pub type MarkerStamp = Result<Stamp, ErrorKind>;

/// What became of a trial.
#[derive(Debug)]
pub struct IngestedTrial {
    /// Its rows of the tables of all trials.
    pub rows: Ingested,
    /// Of the marker file as it was read, if it was.
    pub marker_file: Option<MarkerStamp>,
    /// Its own tables.
    pub written: BTreeMap<PathBuf, Stamp>,
}

/// Ingests trials, in parallel, and writes the tables of each. `provenance` is asked
/// once a marker file is read; `on_trial` is called on any thread and in any order.
///
/// # Errors
/// A table cannot be written, or the work was cancelled. What is wrong with one trial is in its row instead.
pub fn ingest_trials(
    derived: &Path,
    trials: &[Entry],
    provenance: &(dyn Fn(Entry, Option<&MarkerStamp>) -> Provenance + Sync),
    on_trial: &(dyn Fn(&TrialRow) + Sync),
    cancel: &CancelToken,
) -> Result<Vec<IngestedTrial>, StoreError> {
    let (ingested, stamps) = ToDisk::during(|to_disk| {
        let ingested = trials.par_iter().with_max_len(1).map(|entry| {
            cancel.check()?;
            let ingested = ingest_trial(derived, *entry, provenance, to_disk)?;
            on_trial(&ingested.0.rows.trials[0]);
            Ok(ingested)
        });
        ingested.collect::<Result<Vec<_>, StoreError>>()
    });
    let mut stamps = stamps?;
    let with_stamps = |(mut trial, paths): (IngestedTrial, Vec<PathBuf>)| {
        trial.written = paths.into_iter().filter_map(|path| stamps.remove_entry(&path)).collect();
        trial
    };
    Ok(ingested?.into_iter().map(with_stamps).collect())
}

/// Ingests one trial; gives the tables that are on their way to the disk, too.
fn ingest_trial(
    derived: &Path,
    entry: Entry,
    provenance: &(dyn Fn(Entry, Option<&MarkerStamp>) -> Provenance + Sync),
    to_disk: &ToDisk,
) -> Result<(IngestedTrial, Vec<PathBuf>), StoreError> {
    let Entry { folder, listed: ListedTrial { id, trial, .. }, input } = entry;
    let (mut known, mut marker_file, mut paths) = (Known::new(trial), None, Vec::new());
    (known.row.folder, known.row.id) = (folder.name.clone(), id.clone());
    // What is said of a file is the same in a copy of the project.
    let path = Path::new(&folder.name).join(&trial.file);
    // The entry is checked first: its file name might point out of the folder.
    let input = input.as_ref().map_err(|error| TrialFailure::from(error.clone()));
    let processed = input.and_then(|input| {
        let file = trilink_mocap::read_file(&entry.marker_file());
        let file = file.map_err(|error| ReadError { path: path.clone(), ..error });
        // What is read may be newer than its time, never older.
        marker_file = Some(match &file {
            Ok((file, metadata)) => Ok(Stamp::of_input(metadata, file)),
            Err(error) => Err(error.system().unwrap_or(ErrorKind::Other)),
        });
        process(&path, file?.0, trial, input, &mut known)
    });
    let (row, checks, parameters) = match processed {
        Err(failure) => {
            let (row, checks) = known.failed(&failure);
            (row, checks, None)
        }
        Ok(ProcessedTrial { row, checks, parameters, cycles, poses, wheels }) => {
            let provenance = provenance(entry, marker_file.as_ref());
            let mut write = |table: &Table, path: PathBuf| -> Result<(), StoreError> {
                to_disk.send(table.write_beside(&path, &provenance)?);
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

/// Tables of trials that are not in the list or have failed, so that nobody should take them for
/// results: those that are not `current`, by their paths in `derived`, and that this program
/// wrote.
///
/// # Errors
/// A folder cannot be read.
pub fn outdated(derived: &Path, current: &HashSet<&str>) -> Result<Vec<PathBuf>, StoreError> {
    let mut paths = Vec::new();
    for folder in FOLDERS {
        let is_current = |path: &PathBuf| {
            let name = path.file_name().and_then(|name| name.to_str());
            name.is_some_and(|name| current.contains(format!("{folder}/{name}").as_str()))
        };
        let tables = tables_in(&derived.join(folder))?;
        paths.extend(tables.into_iter().filter(|path| !is_current(path) && is_own_table(path)));
    }
    Ok(paths)
}
