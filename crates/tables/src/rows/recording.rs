//! Tables of one trial, frame by frame and cycle by cycle, written by the ingest stage.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use serde::Serialize;
use trilink_base::named;
use trilink_robot::metrics::GaitMetrics;

use crate::{FrameTexts, frames, rows};

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

frames! {
    /// The frames of a table, and when each was, after the first, s.
    pub struct Clock {
        pub frame: Vec<i64>,
        pub time_s: Vec<f64>,
    }
}

frames! {
    /// The robot's five coordinates over time; NaN where missing.
    pub struct Coordinates {
        /// Link 0's wheel axle.
        pub x_m: Vec<f64>,
        pub y_m: Vec<f64>,
        /// Heading of link 0, without jumps.
        pub theta_rad: Vec<f64>,
        /// Joint angles phi1 and phi2.
        pub phi_rad: [Vec<f64>; 2] as "phi{}_rad",
    }
}

frames! {
    /// Velocities of wheels 0, 1, 2 over time; NaN where missing.
    pub struct WheelVelocities {
        pub roll_m_s: [Vec<f64>; 3] as "roll{}_m_s",
        pub skid_m_s: [Vec<f64>; 3] as "skid{}_m_s",
    }
}

frames! {
    /// Where the robot was, and what the cameras saw of links 0, 1, 2: `poses/<trial>.parquet`.
    pub struct PoseFrames {
        pub clock: Clock,
        pub coordinates: Coordinates,
        /// RMS misfit of the link's markers; NaN where there is no fit.
        pub residual_mm: [Vec<f64>; 3] as "residual{}_mm",
        pub fill: [Vec<Fill>; 3] as "fill{}",
        pub outlier: [Vec<LabelFault>; 3] as "outlier{}",
        /// Labels of the markers that the cameras did not see, and of those that were corrected, with
        /// [`LABELS_APART`].
        pub unseen: [FrameTexts; 3] as "unseen{}",
        pub corrected: [FrameTexts; 3] as "corrected{}",
    }
}

frames! {
    /// How the wheels moved: `wheels/<trial>.parquet`.
    pub struct WheelFrames {
        pub clock: Clock,
        pub velocities: WheelVelocities,
    }
}

named! {
    /// Where a link's pose in a frame comes from.
    pub enum Fill {
        /// All its markers were seen.
        Measured = "measured",
        /// Some were not, or one had jumped; the pose is that of the others.
        Rigid = "rigid",
        /// The frame lies in a short gap.
        Interpolated = "interpolated",
        Missing = "missing",
    }
}

named! {
    /// What was wrong with a link's markers in a frame.
    pub enum LabelFault {
        None = "none",
        /// One marker had jumped, and is left out.
        Jumped = "jumped",
        /// Two labels were swapped, and are swapped back.
        Swapped = "swapped",
        /// Which marker is wrong is not clear: the link's pose is thrown out.
        Ambiguous = "ambiguous",
    }
}

impl Clock {
    /// Frames without gaps from the first one on.
    pub fn new(first_frame: i64, frames: usize, rate_hz: f64) -> Self {
        let frame = (first_frame..).take(frames).collect();
        Self { frame, time_s: (0..frames).map(|i| i as f64 / rate_hz).collect() }
    }
}

impl Coordinates {
    /// The same for each of the five series.
    #[must_use]
    pub fn map(&self, change: impl Fn(&[f64]) -> Vec<f64>) -> Self {
        Self {
            x_m: change(&self.x_m),
            y_m: change(&self.y_m),
            theta_rad: change(&self.theta_rad),
            phi_rad: self.phi_rad.each_ref().map(|phi_rad| change(phi_rad)),
        }
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.x_m.len()
    }

    /// Makes these frames missing.
    pub fn leave_out(&mut self, frames: RangeInclusive<usize>) {
        let Self { x_m, y_m, theta_rad, phi_rad: [phi1_rad, phi2_rad] } = self;
        for series in [x_m, y_m, theta_rad, phi1_rad, phi2_rad] {
            series[frames.clone()].fill(f64::NAN);
        }
    }
}

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
    /// What a joint does in a cycle: as [`JointGait`](crate::JointGait).
    #[derive(Copy, Serialize)]
    pub struct JointCycle {
        pub offset_rad: f64,
        pub amplitude_rad: f64,
        pub phase_rad: f64,
    }
}
