//! Small named checks, all run on every trial, all reported.

use std::fmt;

use super::error::TrialFailure;
use crate::store::{CheckRow, Severity};

/// Part of all markers' frames that should be seen.
pub(super) const LEAST_COVERAGE: f64 = 0.9;
/// How far the measured frequency may be from the commanded one.
pub(super) const FREQUENCY_TOLERANCE: f64 = 0.02;
/// Cycles that a mean should be over.
pub(super) const LEAST_CYCLES: f64 = 5.0;
/// Part of the cycles after the transient that gaps may cost before somebody should look at the
/// cameras.
pub(super) const MOST_GAPPED: f64 = 0.3;
/// How much d may change from the first half of the used cycles to the second.
pub(super) const D_DRIFT: f64 = 0.01;
/// Part of the frames that may have a marker that jumped, or two swapped labels, before
/// somebody should look. Half of all frames were seen to recover; the cameras' labelling that
/// fails in one frame of fifty is a reason to look all the same.
pub(super) const MOST_MISPLACED: f64 = 0.02;
/// The same of frames in which it is not clear what is wrong, and which are thrown out.
pub(super) const MOST_AMBIGUOUS: f64 = 0.01;
/// How far a joint may be from where h and l put it, mm.
pub(super) const JOINT_POSITION_MM: f64 = 0.8;
/// How much a joint may stay behind the peak of its first harmonic, as a part of it. A servo
/// that stops at 0.95 of its amplitude stays behind by 0.023.
pub(super) const CLIPPING: f64 = 0.02;
/// How far offset, amplitude or phase of a joint may be from the command, degrees.
pub(super) const GAIT_TOLERANCE_DEG: f64 = 10.0;

/// What is looked at. Codes do not change; reports and scripts count them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Check {
    /// The file states its frame rate.
    Rate,
    /// No frames are left out.
    FrameContinuity,
    /// The cameras saw the markers most of the time.
    Coverage,
    /// The markers lie on the links as in the layout.
    Residual,
    /// The robot moved at the commanded frequency.
    Frequency,
    /// Enough cycles are steady.
    SteadyState,
    /// Few cycles had to be left out because of a gap.
    LongGaps,
    /// Every row has a frame number.
    RowsWithoutFrame,
    /// The joints did what they were commanded.
    Gait,
    /// d does not change over the cycles used.
    Drift,
    /// No marker is off the others of its link or off the link's motion.
    JumpedMarker,
    /// No two labels of a link are swapped.
    SwappedLabels,
    /// Where markers contradict each other, it is clear which of them is wrong.
    AmbiguousMarkers,
    /// The links that should be held while a joint swings do not move.
    HeldLinks,
    /// A swing or a speed dies away as linear damping makes it.
    Decay,
    /// The robot that coasts is straight.
    Straight,
    /// Floor and links are level.
    Tilt,
    /// The joints are where h and l put them.
    JointPositions,
    /// No servo stops short of its peaks.
    GaitClipping,
    /// The trial could be processed.
    Failed,
}

/// Code and name, such as `W003 coverage`.
impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Failed => "E001 failed",
            Self::Rate => "W001 rate",
            Self::FrameContinuity => "W002 frame-continuity",
            Self::Coverage => "W003 coverage",
            Self::Residual => "W004 residual",
            Self::Frequency => "W005 frequency",
            Self::SteadyState => "W006 steady-state",
            Self::LongGaps => "W007 long-gaps",
            Self::RowsWithoutFrame => "W008 rows-without-frame",
            Self::Gait => "W009 gait",
            Self::Drift => "W010 drift",
            Self::JumpedMarker => "W011 jumped-marker",
            Self::SwappedLabels => "W012 swapped-labels",
            Self::HeldLinks => "W014 held-links",
            Self::Decay => "W015 decay",
            Self::Straight => "W016 straight",
            Self::Tilt => "W017 tilt",
            Self::JointPositions => "W018 joint-places",
            Self::GaitClipping => "W019 gait-clipping",
            Self::AmbiguousMarkers => "W013 ambiguous-markers",
        })
    }
}

/// What a check found.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Finding {
    pub check: Check,
    pub severity: Severity,
    pub value: f64,
    pub limit: f64,
    pub message: String,
}

/// Code, name and message.
impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}: {}", self.check, self.message)
    }
}

impl Finding {
    pub fn new(check: Check, holds: bool, value: f64, limit: f64, message: String) -> Self {
        let severity = match (holds, check) {
            (true, _) => Severity::Ok,
            (false, Check::Failed) => Severity::Error,
            (false, _) => Severity::Warning,
        };
        Self { check, severity, value, limit, message }
    }

    /// A check that holds while `value` is not above `limit`.
    pub fn at_most(check: Check, value: f64, limit: f64, message: String) -> Self {
        Self::new(check, value <= limit, value, limit, message)
    }

    /// A check that holds while `value` is not below `limit`.
    pub fn at_least(check: Check, value: f64, limit: f64, message: String) -> Self {
        Self::new(check, value >= limit, value, limit, message)
    }

    /// The same finding, worth reporting although it holds.
    pub fn notable(mut self, is_notable: bool) -> Self {
        if is_notable && self.holds() {
            self.severity = Severity::Info;
        }
        self
    }

    pub fn holds(&self) -> bool {
        matches!(self.severity, Severity::Ok | Severity::Info)
    }

    pub fn row(&self, trial: &str) -> CheckRow {
        CheckRow {
            trial: trial.to_owned(),
            check: self.check.to_string(),
            severity: self.severity,
            value: self.value,
            limit: self.limit,
            message: self.message.clone(),
        }
    }
}

impl TrialFailure {
    /// The only row of `checks.parquet` of a trial that gives no numbers.
    pub fn check_row(&self, trial: &str) -> CheckRow {
        Finding::new(Check::Failed, false, f64::NAN, f64::NAN, self.to_string()).row(trial)
    }
}
