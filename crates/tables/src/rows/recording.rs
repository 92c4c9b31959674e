//! Tables of one trial, frame by frame and cycle by cycle, written by the ingest stage.

use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};

use serde::Serialize;
use trilink_base::named;
use trilink_robot::MAX_JOINTS;
use trilink_robot::metrics::GaitMetrics;

use crate::{ByJoint, ByLink, Columns as _, FrameTexts, Numbered, frames, rows};

/// Returns the path of `poses/<trial>.parquet` in the folder `derived`.
pub fn poses_path(derived: &Path, trial: &str) -> PathBuf {
    derived.join("poses").join(format!("{trial}.parquet"))
}

/// Returns the path of `wheels/<trial>.parquet` in the folder `derived`.
pub fn wheels_path(derived: &Path, trial: &str) -> PathBuf {
    derived.join("wheels").join(format!("{trial}.parquet"))
}

/// Returns the path of `cycles/<trial>.parquet` in the folder `derived`.
pub fn cycles_path(derived: &Path, trial: &str) -> PathBuf {
    derived.join("cycles").join(format!("{trial}.parquet"))
}

/// Separator between marker labels in a cell.
pub const LABELS_APART: &str = ", ";

frames! {
    /// Frame numbers and times of a recording.
    pub struct Clock {
        pub frame: Vec<i64>,
        /// Time since the first frame, s.
        pub time_s: Vec<f64>,
    }
}

frames! {
    /// The robot's coordinates as functions of time; NaN where missing.
    pub struct Coordinates {
        /// x coordinate of link 0's origin (its wheel axle in the paper's robot), m.
        pub x_m: Vec<f64>,
        pub y_m: Vec<f64>,
        /// Unwrapped heading of link 0, rad.
        pub theta_rad: Vec<f64>,
        /// Joint angles from front to rear, rad: heading of the link behind the joint minus that of the link ahead.
        pub phi_rad: ByJoint<Vec<f64>> as "phi{}_rad",
    }
}

frames! {
    /// Roll and skid velocities of the wheels, by link, as functions of time; NaN where missing.
    pub struct WheelVelocities {
        pub roll_m_s: ByLink<Vec<f64>> as "roll{}_m_s",
        pub skid_m_s: ByLink<Vec<f64>> as "skid{}_m_s",
    }
}

frames! {
    /// Standard errors of the roll and skid velocities of the wheels, by link, in every frame; NaN where missing.
    pub struct WheelVelocityErrors {
        pub roll_m_s: ByLink<Vec<f64>> as "roll{}_m_s_se",
        pub skid_m_s: ByLink<Vec<f64>> as "skid{}_m_s_se",
    }
}

frames! {
    /// Poses as functions of time, with the quality of the marker data for each link: `poses/<trial>.parquet`.
    pub struct PoseFrames {
        pub clock: Clock,
        pub coordinates: Coordinates,
        /// RMS residual of the rigid fit to each link's markers, mm; NaN in frames without a fit.
        pub residual_mm: ByLink<Vec<f64>> as "residual{}_mm",
        pub fill: ByLink<Vec<Fill>> as "fill{}",
        pub outlier: ByLink<Vec<LabelFault>> as "outlier{}",
        /// Labels of the occluded markers on each link, separated by [`LABELS_APART`].
        pub unseen: ByLink<FrameTexts> as "unseen{}",
        /// Labels of the markers on each link that were rejected as outliers or whose swapped labels were
        /// restored, separated by [`LABELS_APART`].
        pub corrected: ByLink<FrameTexts> as "corrected{}",
    }
}

frames! {
    /// Wheel velocities as functions of time: `wheels/<trial>.parquet`.
    pub struct WheelFrames {
        pub clock: Clock,
        pub velocities: WheelVelocities,
        /// `None` if the smoothing gives no errors.
        pub errors: Option<WheelVelocityErrors>,
    }
}

named! {
    /// Source of a link's pose in a frame.
    pub enum Fill {
        /// The pose is fitted to all markers of the link.
        Measured = "measured",
        /// The pose is fitted to the remaining markers of the link, because some were occluded or rejected.
        Rigid = "rigid",
        /// The pose is interpolated across a short gap.
        Interpolated = "interpolated",
        Missing = "missing",
    }
}

named! {
    /// Fault in the marker labels of a link in a frame.
    pub enum LabelFault {
        None = "none",
        /// One marker is an outlier and is left out.
        Jumped = "jumped",
        /// Two labels were swapped and have been restored.
        Swapped = "swapped",
        /// It is ambiguous which marker is wrong, so the link's pose is discarded.
        Ambiguous = "ambiguous",
    }
}

impl Clock {
    /// Creates the frame numbers and times of `frames` consecutive frames.
    pub fn new(first_frame: i64, frames: usize, rate_hz: f64) -> Self {
        let frame = (first_frame..).take(frames).collect();
        Self { frame, time_s: (0..frames).map(|i| i as f64 / rate_hz).collect() }
    }
}

impl Coordinates {
    /// Returns the coordinates after applying a function to each of the time series.
    #[must_use]
    pub fn map(&self, change: impl Fn(&[f64]) -> Vec<f64>) -> Self {
        Self {
            x_m: change(&self.x_m),
            y_m: change(&self.y_m),
            theta_rad: change(&self.theta_rad),
            phi_rad: self.phi_rad.iter().map(|phi_rad| change(phi_rad)).collect(),
        }
    }

    /// Returns the direction from the first to the last visible position of link 0 in a range of frames, from the x
    /// axis, rad; NaN if link 0 is visible in fewer than two frames.
    pub fn direction_rad(&self, mut frames: Range<usize>) -> f64 {
        let is_visible = |i: &usize| !self.x_m[*i].is_nan() && !self.y_m[*i].is_nan();
        let (Some(first), Some(last)) = (frames.find(is_visible), frames.rfind(is_visible)) else {
            return f64::NAN;
        };
        let [dx, dy] = [&self.x_m, &self.y_m].map(|series| series[last] - series[first]);
        dy.atan2(dx)
    }

    /// Returns the number of frames.
    pub fn frames(&self) -> usize {
        self.x_m.len()
    }

    /// Sets the coordinates in a range of frames to missing (NaN).
    pub fn leave_out(&mut self, frames: RangeInclusive<usize>) {
        let Self { x_m, y_m, theta_rad, phi_rad } = self;
        for series in [x_m, y_m, theta_rad].into_iter().chain(phi_rad.iter_mut()) {
            series[frames.clone()].fill(f64::NAN);
        }
    }
}

rows! {
    /// One gait cycle of a trial: row of `cycles/<trial>.parquet`.
    #[derive(Serialize)]
    pub struct CycleRow {
        pub trial: String,
        pub cycle: i64,
        /// Time from the first frame to the start of the cycle, s.
        pub start_s: f64,
        pub metrics: GaitMetrics,
        /// Measured motion of the joints in the cycle.
        pub gait: [JointCycle; 2] as "phi{}_{}",
        /// Measured motion of the joints behind the second.
        pub more_gait: Numbered<JointCycle, 3> as "phi{}_{}" after "phi2_phase_rad",
        /// Whether the cycle is used for the trial means.
        pub used: bool,
        /// Reason why the cycle is not used; otherwise empty.
        pub reason: String,
    }
}

impl CycleRow {
    /// Returns the measured motion of the joints from front to rear; blank for joints that the robot lacks.
    pub fn joints(&self) -> [JointCycle; MAX_JOINTS] {
        let mut all = self.gait.iter().chain(&*self.more_gait).copied();
        std::array::from_fn(|_| all.next().unwrap_or_else(JointCycle::blank))
    }
}

rows! {
    /// Motion of a joint in a cycle: `phi = offset + amplitude cos(omega t + phase)`, as in
    /// [`JointGait`](crate::JointGait).
    #[derive(Copy, Serialize)]
    pub struct JointCycle {
        pub offset_rad: f64,
        pub amplitude_rad: f64,
        pub phase_rad: f64,
    }
}
