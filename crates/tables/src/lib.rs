//! Files that the stages share: `pipeline.toml` and `trials.toml`, which are parsed strictly, and the tables in
//! `derived/`, which are written atomically.
//!
//! - Input: [`config`] (`pipeline.toml`; its `Default` is the paper's experiment) and [`trial`] (`trials.toml`).
//! - Content of the tables: `rows`, a struct for each kind of row, such as [`TrialRow`], grouped by the stage
//!   that writes it; `status`, enumerations in columns; `verdict`, findings of fits and comparisons;
//!   `explanations`, the meaning of each check.
//! - Storage: `columns` ([`Columns`], conversion between rows and columns), `frames` ([`Frames`], tables with a row for
//!   each frame), `table` ([`Table`], Parquet with its [`Provenance`]), `table_set` ([`table_set!`], the tables
//!   that a stage reads and writes together), [`checksum`].
//! - Consistency: `atomic` (a file is written completely or not at all), `stamp` ([`Reader`], which rejects a
//!   file that has changed since it was last checked).
//! - Time: [`clock`], the current time; `time` ([`UtcTime`]), a time in a column.
//!
//! ```
//! use trilink_tables::{Provenance, Table, config::Config, numbers, texts};
//!
//! let (robot, _) = Config::default().campaign_setup("kinematic-symmetric").unwrap();
//! assert_eq!(robot.h_m, [0.144; 2]);
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("distances.parquet");
//! let columns = vec![texts("trial", ["a", "b"].into_iter()), numbers("d_m", vec![0.41, 0.43])];
//! Table::new(columns).write(&path, &Provenance { input: "typed in".to_owned() })?;
//! assert_eq!(Table::read(&path)?.values::<f64>("d_m")?, [0.41, 0.43]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod atomic;
mod causes;
pub mod checksum;
pub mod clock;
mod columns;
pub mod config;
mod explanations;
mod frames;
mod meaning;
mod numbered;
mod objective;
mod repeats;
mod rows;
mod stamp;
mod status;
mod table;
mod table_set;
mod time;
pub mod trial;
mod verdict;

pub use atomic::{
    PendingFile, ToDisk, WRITING, remove_unfinished, unfinished, write_bytes, write_if_changed,
};
pub use causes::{CommonCause, without_file};
pub use columns::{Columns, NamedCell, booleans, numbers, repeated, texts};
#[doc(hidden)]
pub use columns::{fill, interleave, pattern_of};
pub use explanations::Explanation;
pub use frames::{FrameTexts, Frames};
pub use meaning::{meaning, unit};
pub use numbered::{ByJoint, ByLink, Numbered};
pub use polars::prelude::Column;
pub use repeats::{MAX_DEVIATIONS, SAME_FREQUENCY, UnlikeRepeats};
pub use rows::extrapolation::Extrapolation;
pub use rows::fits::{
    BootstrapRow, ComparisonRow, FitRow, PrecisionRow, ProfileRow, SharedFitRow, StartRow,
};
pub use rows::motions::BranchRow;
pub use rows::optima::{GaitNumbers, MapPoint, Objective, OptimumMapRow, OptimumRow};
pub use rows::predictions::{PredictionRow, ResidualRow};
pub use rows::recording::{
    Clock, Coordinates, CycleRow, Fill, JointCycle, LABELS_APART, LabelFault, PoseFrames,
    WheelFrames, WheelVelocities, WheelVelocityErrors, cycles_path, poses_path, wheels_path,
};
pub use rows::robot_parameters::{DecayFit, RobotParameterRow, RobotQuantity};
pub use rows::sensitivities::{KnownFrom, SENSITIVE_METRICS, SensitivityRow};
pub use rows::trials::{CheckRow, JointGait, TrialRow};
pub use stamp::{Reader, Stamp, hash, is_there, tables_in};
pub use status::{
    FitStatus, LawStatus, PredictionSource, RunStatus, Severity, Sharing, SlopeStatus, Stopped,
    TrialStatus,
};
pub use table::{Provenance, Table, guarded, hush_damaged_tables, is_own_table, row_names};
pub use time::{UtcTime, time_text};
pub use verdict::{
    Comparison, Contradiction, ContradictionKind, FitNotes, LINEAR_PART, LawKind, LawLike, Misfit,
    MisfitRun, NoInterval, NoIntervalReason, NoPrecisionReason, NotTested, NotTestedReason,
    Outcome, Reason, Resistance, Side, Undecided, UndecidedReason, Why,
};

use std::io::ErrorKind;
use std::path::PathBuf;

use trilink_base::cancel::Cancelled;

/// Error while reading, writing or removing a table or another file.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error("{}: cannot be written: {source}", path.display())]
    Write { path: PathBuf, source: std::io::Error },
    #[error("{}: cannot be read: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}: has changed since it was written or last checked", path.display())]
    Changed { path: PathBuf },
    #[error("{}: damaged: the content does not match the checksum that trilink wrote", path.display())]
    Damaged { path: PathBuf },
    #[error("{}: not a Parquet table: {message}", path.display())]
    Parquet { path: PathBuf, message: String },
    #[error("{}: not a Parquet table written by trilink: {message}", path.display())]
    Table { path: PathBuf, message: String },
    #[error("{}: does not exist; `trilink ingest` creates it", path.display())]
    NotIngested { path: PathBuf },
    #[error("{}: found {found}, needed {needed}", path.display())]
    Place { path: PathBuf, found: &'static str, needed: &'static str },
    #[error("{}: cannot be removed: {source}", path.display())]
    Remove { path: PathBuf, source: std::io::Error },
    #[error("{}: held by {holder}", path.display())]
    Held { path: PathBuf, holder: String },
    #[error("{}: {problems}", path.display())]
    Columns { path: PathBuf, problems: String },
    #[error("{}: column `{column}`: found {found}, needed {needed}", path.display())]
    Column { path: PathBuf, column: String, found: String, needed: &'static str },
}

impl StoreError {
    /// Returns whether the error means that the file does not exist.
    pub fn is_not_there(&self) -> bool {
        let Self::Read { source, .. } = self else { return false };
        match source.kind() {
            // A file with an invalid name cannot exist.
            ErrorKind::NotFound | ErrorKind::InvalidFilename => true,
            // The standard library rejects a name that contains NUL before any system call (so there is no OS
            // error), whereas EINVAL from the system proves nothing.
            ErrorKind::InvalidInput => source.raw_os_error().is_none(),
            _ => false,
        }
    }

    /// Returns whether the error means that the columns of a table are not as expected, as happens if another
    /// version of the program wrote it.
    pub fn is_schema_mismatch(&self) -> bool {
        matches!(self, Self::Column { .. } | Self::Columns { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_that_the_system_rejects_is_not_taken_for_absent() {
        let is_not_there = |source| StoreError::Read { path: "a".into(), source }.is_not_there();
        let error_of_nul = std::fs::metadata("a\0b").expect_err("no file has that name");
        assert!(is_not_there(error_of_nul));
        assert!(is_not_there(ErrorKind::NotFound.into()));
        #[cfg(unix)]
        for number in [5, 13, 22] {
            let source = std::io::Error::from_raw_os_error(number);
            assert!(!is_not_there(source), "{number}");
        }
    }
}
