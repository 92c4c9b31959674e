//! Figures of merit of every run, one below the other, so that a slow drift shows.

use std::path::{Path, PathBuf};

use polars::prelude::Column;
use trilink_tables::{Columns as _, Reader, RunStatus, StoreError, UtcTime, rows};

use super::CompareError;

rows! {
    /// One figure of merit of one run, or something that happened: `history.parquet`.
    pub struct HistoryRow {
        /// When the run ended.
        pub time: UtcTime,
        /// Counts the runs.
        pub run: i64,
        /// How it ended; missing in histories from before this was kept.
        pub status: Option<RunStatus>,
        pub version: String,
        /// What it was made with: hashes of the program's source, of the settings and of the
        /// trials. Empty where that was not kept.
        pub program: String,
        pub configuration: String,
        pub input: String,
        /// Empty for what is of the whole run, as is the model.
        pub campaign: String,
        pub model: String,
        pub quantity: String,
        pub value: f64,
        /// The 95 % interval.
        pub lower: f64 as "lo",
        pub upper: f64 as "hi",
        /// Of the value, from run to run.
        pub value_se: f64,
        /// Why a run became the new baseline or did not come to its end, or a trial that came or is
        /// gone; then nothing was measured.
        pub note: String,
    }
}

/// Columns that histories from before they were kept do not have.
const ADDED: [&str; 7] = ["status", "program", "configuration", "input", "lo", "hi", "value_se"];

impl HistoryRow {
    /// Whether it has a figure of merit.
    pub fn is_measured(&self) -> bool {
        self.note.is_empty()
    }
}

/// The quantity of a row that tells of a new baseline.
pub(super) const ACCEPTED: &str = "accepted";
/// The same of a trial of the first run that knows its trials, and of one that came or is gone since.
pub(super) const TRIAL: &str = "trial";
pub(super) const CAME: &str = "trial came";
pub(super) const GONE: &str = "trial gone";
/// The quantity of a trial's mean begins with this, and that of how many ended how.
pub(super) const MEAN: &str = "mean ";
pub(super) const TRIALS: &str = "trials ";

/// What is not the same when nothing has changed.
pub(super) const SECONDS: &str = "_s of run";

/// Where the history lies.
pub fn history_path(reports: &Path) -> PathBuf {
    reports.join("history.parquet")
}

/// The number of the run after those of the rows.
pub(super) fn next_run(rows: &[HistoryRow]) -> i64 {
    rows.iter().map(|row| row.run).max().unwrap_or(0) + 1
}

/// The last run that came to figures of merit; 0 if there is none.
pub(super) fn last_run(rows: &[HistoryRow]) -> i64 {
    rows.iter().rfind(|row| row.is_measured()).map_or(0, |row| row.run)
}

/// The history as it is found.
pub(super) struct History {
    pub rows: Vec<HistoryRow>,
    /// That it was damaged.
    pub problem: Option<String>,
}

impl History {
    /// Reads the history. One that is damaged is moved aside, and a new one begins.
    pub(super) fn load(reports: &Path) -> Result<Self, CompareError> {
        let path = history_path(reports);
        let rows = Reader::default().table(&path).and_then(|mut table| {
            let sound = HistoryRow::to_table(&[]).frame;
            for column in sound.columns() {
                let (name, rows) = (column.name(), table.frame.height());
                if ADDED.contains(&name.as_str()) && table.frame.column(name).is_err() {
                    let missing = Column::full_null(name.clone(), rows, column.dtype());
                    table.frame.with_column(missing).map_err(|error| StoreError::Table {
                        path: path.clone(),
                        message: error.to_string(),
                    })?;
                }
            }
            HistoryRow::from_table(&table)
        });
        let damage = match rows {
            Ok(rows) => return Ok(Self { rows, problem: None }),
            Err(error) if error.is_not_there() => {
                return Ok(Self { rows: Vec::new(), problem: None });
            }
            Err(error @ StoreError::Read { .. }) => return Err(error.into()),
            Err(damage) => damage,
        };
        let aside = (1..).map(|i| reports.join(format!("history.damaged-{i}.parquet")));
        let aside = aside
            .into_iter()
            .find(|path| path.try_exists().is_ok_and(|is_there| !is_there))
            .unwrap_or_else(|| path.clone());
        std::fs::rename(&path, &aside)
            .map_err(|source| StoreError::Write { path: aside.clone(), source })?;
        let problem = format!("{damage}; it is now {}, and a new one begins", aside.display());
        Ok(Self { rows: Vec::new(), problem: Some(problem) })
    }
}
