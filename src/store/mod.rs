//! Where results rest: the tables of `derived/`, written whole or not at all.

mod atomic;
mod parameters;
mod rows;
mod schema;
mod table;

pub use atomic::{Beside, write_bytes};
pub use parameters::PARAMETERS;
pub use rows::Rows;
pub use schema::{
    BootstrapRow, CheckRow, ComparisonRow, CycleRow, FitRow, PredictionRow, ProfileRow,
    RobotParameterRow, RobotQuantity, StartRow, TrajectoryRow, TrialRow, cycles_path, poses_path,
    wheels_path,
};
pub use table::{Column, Provenance, Table, is_reading};

use std::path::PathBuf;

/// Why a table or file could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    #[error("{}: cannot be written: {source}", path.display())]
    Write { path: PathBuf, source: std::io::Error },
    #[error("{}: cannot be read: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}: not a Parquet table of trilink: {message}", path.display())]
    Table { path: PathBuf, message: String },
    #[error("{}: column `{column}`: found {found}, needed {needed}", path.display())]
    Column { path: PathBuf, column: String, found: String, needed: &'static str },
}
