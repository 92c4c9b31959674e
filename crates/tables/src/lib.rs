//! What the stages share on disk: `pipeline.toml` and `trials.toml`, read strictly, and the tables of
//! `derived/`, written whole or not at all.
//!
//! - What is asked for: [`config`] (`pipeline.toml`; its `Default` is the paper's experiment) and
//!   [`trial`] (`trials.toml`).
//! - What is in the tables: `rows`, a struct for each kind of row, such as [`TrialRow`], in a file for
//!   the stage that writes them; `status`, the names in their columns; `verdict`, what fits and comparisons
//!   found; `explanations`, what each check means.
//! - How they are stored: `columns` ([`Columns`], from rows to columns and back), `frames` ([`Frames`],
//!   what has a row for each frame), `table` ([`Table`], Parquet with its [`Provenance`]), `table_set`
//!   ([`table_set!`], the tables that a stage reads and writes together), [`checksum`].
//! - How they are kept consistent: `atomic` (a file is there whole or not at all), `stamp` ([`Reader`],
//!   which refuses a file that changed since it was looked at).
//! - [`clock`]: now; `time` ([`UtcTime`]): a time as a column.
//!
//! ```
//! use trilink_tables::{Provenance, Table, config::Config, numbers, texts};
//!
//! let (robot, _) = Config::default().campaign_setup("kinematic-symmetric").unwrap();
//! assert_eq!(robot.h_m, 0.144);
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("distances.parquet");
//! let columns = vec![texts("trial", ["a", "b"].into_iter()), numbers("d_m", vec![0.41, 0.43])];
//! Table::new(columns).write(&path, &Provenance { input: "typed in".to_owned() })?;
//! assert_eq!(Table::read(&path)?.values::<f64>("d_m")?, [0.41, 0.43]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod atomic;
pub mod checksum;
pub mod clock;
mod columns;
pub mod config;
mod explanations;
mod frames;
mod objective;
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
pub use columns::{Columns, NamedCell, numbers, repeated, texts, truths};
#[doc(hidden)]
pub use columns::{fill, interleave, pattern_of};
pub use explanations::Explanation;
pub use frames::{FrameTexts, Frames};
pub use polars::prelude::Column;
pub use rows::extrapolation::Extrapolation;
pub use rows::fits::{BootstrapRow, ComparisonRow, FitRow, ProfileRow, SharedFitRow, StartRow};
pub use rows::motions::{BranchRow, TrajectoryRow};
pub use rows::optima::{GaitNumbers, MapPoint, Objective, OptimumMapRow, OptimumRow};
pub use rows::predictions::{PredictionRow, ResidualRow};
pub use rows::recording::{
    Clock, Coordinates, CycleRow, Fill, JointCycle, LABELS_APART, LabelFault, PoseFrames,
    WheelFrames, WheelVelocities, cycles_path, poses_path, wheels_path,
};
pub use rows::robot_parameters::{DecayFit, RobotParameterRow, RobotQuantity};
pub use rows::sensitivities::{KnownFrom, SENSITIVE_METRICS, SensitivityRow};
pub use rows::trials::{CheckRow, JointGait, TrialRow};
pub use stamp::{Reader, Stamp, hash, is_there, tables_in};
pub use status::{FitStatus, PredictionSource, RunStatus, Severity, Sharing, Stopped, TrialStatus};
pub use table::{Provenance, Table, guarded, hush_damaged_tables, is_own_table, row_names};
pub use time::{UtcTime, time_text};
pub use verdict::{
    Comparison, Contradiction, ContradictionKind, FitNotes, LINEAR_PART, LawKind, LawLike, Misfit,
    MisfitRms, MisfitRun, NoInterval, NoIntervalReason, NotTested, NotTestedReason, Outcome,
    Reason, Resistance, Side, Why,
};

use std::io::ErrorKind;
use std::path::PathBuf;

use trilink_base::cancel::Cancelled;

/// Why a table or file could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error("{}: cannot be written: {source}", path.display())]
    Write { path: PathBuf, source: std::io::Error },
    #[error("{}: cannot be read: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}: is not as it was when it was written or looked at", path.display())]
    Changed { path: PathBuf },
    #[error("{}: damaged: its bytes are not those that trilink wrote", path.display())]
    Damaged { path: PathBuf },
    #[error("{}: not a Parquet table: {message}", path.display())]
    Parquet { path: PathBuf, message: String },
    #[error("{}: not a Parquet table of trilink: {message}", path.display())]
    Table { path: PathBuf, message: String },
    #[error("{}: not there; `trilink ingest` makes it", path.display())]
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
    /// Whether there is no such file.
    pub fn is_not_there(&self) -> bool {
        let Self::Read { source, .. } = self else { return false };
        match source.kind() {
            // An invalid name cannot exist.
            ErrorKind::NotFound | ErrorKind::InvalidFilename => true,
            // NUL is refused by std before any system call (no OS error); EINVAL from the system proves
            // nothing.
            ErrorKind::InvalidInput => source.raw_os_error().is_none(),
            _ => false,
        }
    }

    /// Whether it is a table, but with columns of another version.
    pub fn is_schema_mismatch(&self) -> bool {
        matches!(self, Self::Column { .. } | Self::Columns { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_system_finds_invalid_is_not_taken_for_absent() {
        let is_not_there = |source| StoreError::Read { path: "a".into(), source }.is_not_there();
        let of_a_name_with_nul = std::fs::metadata("a\0b").expect_err("no file has that name");
        assert!(is_not_there(of_a_name_with_nul));
        assert!(is_not_there(ErrorKind::NotFound.into()));
        #[cfg(unix)]
        for number in [5, 13, 22] {
            let source = std::io::Error::from_raw_os_error(number);
            assert!(!is_not_there(source), "{number}");
        }
    }
}
