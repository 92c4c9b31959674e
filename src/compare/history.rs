//! Table of figures of merit from all runs, which reveals slow drifts.

use std::path::{Path, PathBuf};

use polars::prelude::Column;
use trilink_base::files::absolute;
use trilink_tables::config::Paths;
use trilink_tables::{Columns as _, Reader, RunStatus, StoreError, UtcTime, is_there, rows};

use super::CompareError;

rows! {
    /// Row of `history.parquet`: a figure of merit of a run, or an event such as the acceptance of a baseline or a
    /// failed run.
    pub struct HistoryRow {
        /// Time at which the run ended.
        pub time: UtcTime,
        /// Number of the run, counted from the start of the history.
        pub run: i64,
        /// Status of the run; missing in histories from earlier versions.
        pub status: Option<RunStatus>,
        pub version: String,
        /// Hash of the program's source; empty if unknown.
        pub program: String,
        /// Hash of the configuration; empty if unknown.
        pub configuration: String,
        /// Hash of the trials; empty if unknown.
        pub input: String,
        /// Campaign; empty for quantities of the whole run.
        pub campaign: String,
        /// Model; empty for quantities of a campaign or of the whole run.
        pub model: String,
        pub quantity: String,
        pub value: f64,
        /// Lower limit of the 95 % confidence interval of the value; NaN if unknown.
        pub lower: f64 as "lo",
        /// Upper limit of the 95 % confidence interval of the value; NaN if unknown.
        pub upper: f64 as "hi",
        /// Standard error that describes how the value varies from run to run; NaN if unknown.
        pub value_se: f64,
        /// What the value rests on: the frequencies of a mean, rad/s, or `inadequate` for a model that is known to be
        /// inadequate. Only values with the same basis are compared.
        pub basis: String,
        /// Text of an event: reason why the run became the new baseline or failed, or name of a trial that was added or
        /// removed. Empty for a figure of merit.
        pub note: String,
    }
}

/// Columns that are missing from histories of earlier versions.
const NEW_COLUMNS: [&str; 8] =
    ["status", "program", "configuration", "input", "lo", "hi", "value_se", "basis"];

impl HistoryRow {
    /// Returns whether the row is a figure of merit, not an event.
    pub fn is_measured(&self) -> bool {
        self.note.is_empty()
    }
}

/// Value of `basis` for a model that is known to be inadequate.
pub(super) const INADEQUATE: &str = "inadequate";
/// Value of `quantity` for the event that a run became the new baseline.
pub(super) const ACCEPTED: &str = "accepted";
/// Value of `quantity` for each trial of the first run whose trials the history lists.
pub(super) const TRIAL: &str = "trial";
/// Value of `quantity` in a row that records the addition of a trial.
pub(super) const TRIAL_ADDED: &str = "trial came";
/// Value of `quantity` for the event that a trial was removed.
pub(super) const TRIAL_REMOVED: &str = "trial gone";
/// Prefix of `quantity` for a mean over a campaign's trials.
pub(super) const MEAN: &str = "mean ";
/// Prefix of `quantity` for the number of trials with a given status.
pub(super) const TRIALS: &str = "trials ";
/// Suffix of `quantity` for the run time of a stage, which differs even between identical runs.
pub(super) const SECONDS: &str = "_s of run";

/// Returns the path of a history that an earlier version wrote to the folder of reports.
fn earlier_path(paths: &Paths) -> PathBuf {
    paths.reports.join("history.parquet")
}

/// Returns the number of the next run.
pub(super) fn next_run(rows: &[HistoryRow]) -> i64 {
    rows.iter().map(|row| row.run).max().unwrap_or(0) + 1
}

/// Returns the number of the last run with figures of merit; 0 if there is none.
pub(super) fn last_run(rows: &[HistoryRow]) -> i64 {
    rows.iter().rfind(|row| row.is_measured()).map_or(0, |row| row.run)
}

/// History as read from its file.
pub(super) struct History {
    pub rows: Vec<HistoryRow>,
    /// Message about a damaged file; `None` if the file was intact.
    pub problem: Option<String>,
}

impl History {
    /// Reads the history. A history from an earlier version, in the folder of reports, is moved to its configured place.
    /// A damaged file is moved aside, and a new history is started.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read or moved.
    pub(super) fn load(paths: &Paths) -> Result<Self, CompareError> {
        let path = &paths.history;
        let earlier = earlier_path(paths);
        let mut problem = None;
        if is_there(&earlier)? && absolute(&earlier) != absolute(path) {
            if is_there(path)? {
                problem = Some(format!(
                    "{}: an earlier history, not continued because {} exists; move it, or name it in the key \
                     `paths.history`",
                    earlier.display(),
                    path.display()
                ));
            } else {
                move_file(&earlier, path)?;
            }
        }
        let rows = Reader::default().table(path).and_then(|mut table| {
            let expected = HistoryRow::to_table(&[]).frame;
            for column in expected.columns() {
                let name = column.name();
                if NEW_COLUMNS.contains(&name.as_str()) && table.frame.column(name).is_err() {
                    let rows = table.frame.height();
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
            Ok(rows) => return Ok(Self { rows, problem }),
            Err(error) if error.is_not_there() => {
                return Ok(Self { rows: Vec::new(), problem });
            }
            Err(error @ StoreError::Read { .. }) => return Err(error.into()),
            Err(damage) => damage,
        };
        let aside = (1..).map(|i| path.with_extension(format!("damaged-{i}.parquet")));
        let aside = aside
            .into_iter()
            .find(|path| path.try_exists().is_ok_and(|is_there| !is_there))
            .unwrap_or_else(|| path.clone());
        move_file(path, &aside)?;
        let problem = format!(
            "{damage}; the file was renamed to {}, and a new history begins",
            aside.display()
        );
        Ok(Self { rows: Vec::new(), problem: Some(problem) })
    }
}

/// Moves a file within a file system, and creates the folder to which it is moved.
fn move_file(from: &Path, to: &Path) -> Result<(), StoreError> {
    let error = |source| StoreError::Write { path: to.to_owned(), source };
    if let Some(folder) = to.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(error)?;
    }
    std::fs::rename(from, to).map_err(error)
}
