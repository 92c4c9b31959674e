//! The tables of a fit, and those that it reads.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::{FitData, Fitted};
use crate::robot::Model;
use crate::store::{Columns, StoreError, Table, TrialRow, cycles_path, table_set};
use crate::trial::is_valid_id;

table_set! {
    Fitted by (String, Model): row => (row.campaign.clone(), row.model);
    fits: "fits.parquet",
    alternatives: "alternative_fits.parquet",
    starts: "starts.parquet",
    profiles: "profiles.parquet",
    bootstrap: "bootstrap.parquet",
    comparison: "comparison.parquet",
    predictions: "predictions.parquet",
}

/// Files that a fit reads.
///
/// # Errors
/// There is no table of trials.
pub fn input_paths(derived: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let trials = derived.join("trials.parquet");
    match std::fs::metadata(&trials) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return Err(StoreError::NotIngested { path: trials });
        }
        _ => {}
    }
    let mut paths = vec![trials, derived.join("robot_parameters.parquet")];
    let folder = derived.join("cycles");
    match std::fs::read_dir(&folder) {
        Ok(entries) => {
            let tables = entries.flatten().map(|entry| entry.path());
            paths.extend(tables.filter(|path| path.extension().is_some_and(|e| e == "parquet")));
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        Err(source) => return Err(StoreError::Read { path: folder, source }),
    }
    paths.retain(|path| path.is_file());
    Ok(paths)
}

impl FitData {
    /// Reads `trials.parquet`, and where they are there `robot_parameters.parquet` and the trials'
    /// tables of cycles.
    ///
    /// # Errors
    /// One of them cannot be read.
    pub fn read(derived: &Path) -> Result<Self, StoreError> {
        let trials: Vec<TrialRow> = rows(&derived.join("trials.parquet"))?;
        let mut cycles = BTreeMap::new();
        for trial in trials.iter().filter(|trial| is_valid_id(&trial.trial)) {
            let path = cycles_path(derived, &trial.trial);
            if path.exists() {
                cycles.insert(trial.trial.clone(), rows(&path)?);
            }
        }
        let path = derived.join("robot_parameters.parquet");
        let robots = if path.exists() { rows(&path)? } else { Vec::new() };
        Ok(Self { trials, cycles, robots })
    }
}

fn rows<R: Columns>(path: &Path) -> Result<Vec<R>, StoreError> {
    R::from_table(&Table::read(path)?)
}
