//! Tables that a fit reads and writes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use trilink_robot::Model;
use trilink_tables::trial::is_valid_name;
use trilink_tables::{
    BootstrapRow, ComparisonRow, FitRow, PredictionRow, ProfileRow, Reader, ResidualRow,
    SharedFitRow, StartRow, StoreError, TrialRow, is_there, table_set, tables_in,
};

use super::{FitData, Fitted};

/// Key of a fit that can be rerun by itself.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum FitKey {
    /// One model, fitted to one campaign.
    Own { campaign: String, model: Model },
    /// One model, fitted to all campaigns of a robot or of several robots with common wheels.
    Shared { robot: String, model: Model },
}

/// Table row that belongs to a fit.
trait OfFit {
    fn key(&self) -> FitKey;
}

macro_rules! of_campaigns {
    ($($row:ty),*) => {$(
        impl OfFit for $row {
            fn key(&self) -> FitKey {
                FitKey::Own { campaign: self.campaign.clone(), model: self.model }
            }
        }
    )*};
}

of_campaigns!(
    FitRow,
    StartRow,
    ProfileRow,
    BootstrapRow,
    ComparisonRow,
    PredictionRow,
    ResidualRow
);

impl OfFit for SharedFitRow {
    fn key(&self) -> FitKey {
        FitKey::Shared { robot: self.robot.clone(), model: self.fit.model }
    }
}

table_set! {
    Fitted by FitKey: row => row.key();
    fits: "fits.parquet",
    alternatives: "alternative_fits.parquet",
    starts: "starts.parquet",
    profiles: "profiles.parquet",
    bootstrap: "bootstrap.parquet",
    comparison: "comparison.parquet",
    predictions: "predictions.parquet",
    residuals: "residuals.parquet",
    shared: "shared_fits.parquet";
    whole: precision: "precision.parquet"
}

const TRIALS: &str = "trials.parquet";
const ROBOTS: &str = "robot_parameters.parquet";

/// Returns the paths of the tables that a fit reads, each with a flag that is always true: this program wrote the file.
///
/// # Errors
/// Returns an error if there is no table of trials, or if a folder cannot be read.
pub fn input_paths(derived: &Path) -> Result<Vec<(PathBuf, bool)>, StoreError> {
    let trials = derived.join(TRIALS);
    if !is_there(&trials)? {
        return Err(StoreError::NotIngested { path: trials });
    }
    let mut paths = vec![trials];
    let robots = derived.join(ROBOTS);
    if is_there(&robots)? {
        paths.push(robots);
    }
    paths.extend(tables_in(&derived.join("cycles"))?);
    Ok(paths.into_iter().map(|path| (path, true)).collect())
}

impl FitData {
    /// Reads `trials.parquet` and, if they exist, `robot_parameters.parquet` and the tables of the trials' cycles.
    ///
    /// # Errors
    /// Returns an error if a table cannot be read, or if a trial or a cycle appears twice.
    pub fn read(derived: &Path, reader: &Reader) -> Result<Self, StoreError> {
        let trials: Vec<TrialRow> = reader.rows(&derived.join(TRIALS))?;
        let mut cycles = BTreeMap::new();
        for trial in trials.iter().filter(|trial| is_valid_name(&trial.trial)) {
            if let Some(rows) = reader.cycles_if_there(derived, &trial.trial)? {
                cycles.insert(trial.trial.clone(), rows);
            }
        }
        let robots = reader.rows_if_there(&derived.join(ROBOTS))?.unwrap_or_default();
        Ok(Self { trials, cycles, robots })
    }
}

#[cfg(test)]
mod tests {
    use trilink_tables::{Columns as _, CycleRow, Provenance, cycles_path};

    use super::*;

    #[test]
    fn a_trial_that_appears_twice_in_the_table_is_an_error() {
        let folder = tempfile::tempdir().expect("a folder");
        let row = |name: &str| TrialRow { trial: name.to_owned(), ..TrialRow::blank() };
        let read = |names: &[&str]| {
            let rows: Vec<TrialRow> = names.iter().map(|name| row(name)).collect();
            let made = Provenance { input: String::new() };
            TrialRow::to_table(&rows).write(&folder.path().join(TRIALS), &made).expect("written");
            FitData::read(folder.path(), &Reader::default())
        };
        assert_eq!(read(&["one", "two"]).expect("trials").trials.len(), 2);
        let message = read(&["one", "two", "one"]).expect_err("one stands twice").to_string();
        assert!(message.ends_with("column `trial`: found `one` twice, needed each value once"));
    }

    #[test]
    fn a_cycle_that_appears_twice_in_the_table_is_an_error() {
        let folder = tempfile::tempdir().expect("a folder");
        let made = Provenance { input: String::new() };
        let trial = TrialRow { trial: "one".to_owned(), ..TrialRow::blank() };
        TrialRow::to_table(&[trial]).write(&folder.path().join(TRIALS), &made).expect("written");
        let read = |numbers: &[i64]| {
            let row = |cycle: &i64| CycleRow { cycle: *cycle, ..CycleRow::blank() };
            let rows: Vec<CycleRow> = numbers.iter().map(row).collect();
            let path = cycles_path(folder.path(), "one");
            CycleRow::to_table(&rows).write(&path, &made).expect("written");
            FitData::read(folder.path(), &Reader::default())
        };
        assert_eq!(read(&[0, 1, 4]).expect("cycles").cycles["one"].len(), 3);
        let message = read(&[0, 1, 1]).expect_err("1 stands twice").to_string();
        assert!(
            message.ends_with("column `cycle`: found 1 after 1, needed increasing cycle numbers")
        );
    }
}
