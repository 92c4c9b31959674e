//! The tables of one trial, frame by frame and cycle by cycle, by the ingest.

use std::path::{Path, PathBuf};

use serde::Serialize;
use trilink_robot::metrics::GaitMetrics;

use crate::rows;

/// `derived/poses/<trial>.parquet`.
pub fn poses_path(derived: &Path, trial: &str) -> PathBuf {
    derived.join("poses").join(format!("{trial}.parquet"))
}

/// `derived/wheels/<trial>.parquet`.
pub fn wheels_path(derived: &Path, trial: &str) -> PathBuf {
    derived.join("wheels").join(format!("{trial}.parquet"))
}

/// `derived/cycles/<trial>.parquet`.
pub fn cycles_path(derived: &Path, trial: &str) -> PathBuf {
    derived.join("cycles").join(format!("{trial}.parquet"))
}

/// Between the labels of markers in a text.
pub const LABELS_APART: &str = ", ";

rows! {
    /// One cycle of a trial: `cycles/<trial>.parquet`.
    #[derive(Serialize)]
    pub struct CycleRow {
        pub trial: String,
        pub cycle: i64,
        /// When the cycle starts, after the first frame, s.
        pub start_s: f64,
        pub metrics: GaitMetrics,
        /// What the joints do in it.
        pub gait: [JointCycle; 2] as "phi{}_{}",
        /// Whether the cycle counts towards the trial's means, and where it does not, why.
        pub used: bool,
        pub reason: String,
    }
}

rows! {
    /// What a joint does in a cycle: as [`JointGait`].
    #[derive(Copy, Serialize)]
    pub struct JointCycle {
        pub offset_rad: f64,
        pub amplitude_rad: f64,
        pub phase_rad: f64,
    }
}
