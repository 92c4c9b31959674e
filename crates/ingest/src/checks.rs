//! Small named checks, all run on every trial, all reported.

use std::fmt;

use trilink_base::named;
use trilink_tables::{CheckRow, Severity};

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
/// How far d, alpha1 or a skid ratio of a cycle may be from the others', as a part of theirs, if it is not by
/// chance.
pub(super) const OUTLYING: f64 = 0.05;
/// Part of the frames that may have a marker that jumped, or two swapped labels, before
/// somebody should look. Half of all frames were seen to recover; the cameras' labelling that
/// fails in one frame of fifty is a reason to look all the same.
pub(super) const MOST_MISPLACED: f64 = 0.02;
/// The same of frames in which it is not clear what is wrong, and which are thrown out.
pub(super) const MOST_AMBIGUOUS: f64 = 0.01;
/// How many times as large as white noise the slow noise of the markers may be. Of unfiltered recordings it is
/// 0.8 to 1.2 times, of those low-passed at 30 Hz 4 times, at 6 Hz 100 times, with coordinates to 0.1 mm 5 times.
pub(super) const MAX_SLOW_NOISE: f64 = 2.0;
/// Part of the rows that may repeat the one before: a frame that was held now and then.
pub(super) const MOST_REPEATED: f64 = 0.01;
/// How far a joint may be from where h and l put it, mm.
pub(super) const JOINT_POSITION_MM: f64 = 0.8;
/// How much a joint may stay behind the peak of its first harmonic, as a part of it. A servo
/// that stops at 0.95 of its amplitude stays behind by 0.023.
pub(super) const CLIPPING: f64 = 0.02;
/// How far offset, amplitude or phase of a joint may be from the command, degrees.
pub(super) const GAIT_TOLERANCE_DEG: f64 = 10.0;

named! {
    /// What is looked at: code and name. They do not change; reports and scripts count them.
    pub enum Check {
        /// The trial could be processed.
        Failed = "E001 failed",
        /// The file states its frame rate.
        Rate = "W001 rate",
        /// No frames are left out.
        FrameContinuity = "W002 frame-continuity",
        /// The cameras saw the markers most of the time.
        Coverage = "W003 coverage",
        /// The markers lie on the links as in the layout.
        Residual = "W004 residual",
        /// The robot moved at the commanded frequency.
        Frequency = "W005 frequency",
        /// Enough cycles are steady.
        SteadyState = "W006 steady-state",
        /// Few cycles had to be left out because of a gap.
        LongGaps = "W007 long-gaps",
        /// Every row has a frame number.
        RowsWithoutFrame = "W008 rows-without-frame",
        /// The joints did what they were commanded.
        Gait = "W009 gait",
        /// d does not change over the cycles used.
        Drift = "W010 drift",
        /// No marker is off the others of its link or off the link's motion.
        JumpedMarker = "W011 jumped-marker",
        /// No two labels of a link are swapped.
        SwappedLabels = "W012 swapped-labels",
        /// Where markers contradict each other, it is clear which of them is wrong.
        AmbiguousMarkers = "W013 ambiguous-markers",
        /// The links that should be held while a joint swings do not move.
        HeldLinks = "W014 held-links",
        /// A swing or a speed dies away as linear damping makes it, but for noise.
        Decay = "W015 decay",
        /// The robot that coasts is straight.
        Straight = "W016 straight",
        /// Floor and links are level.
        Tilt = "W017 tilt",
        /// The joints are where h and l put them.
        JointPositions = "W018 joint-places",
        /// No servo stops short of its peaks.
        GaitClipping = "W019 gait-clipping",
        /// No row has more cells than the header has columns.
        LongRows = "W020 long-rows",
        /// The recording tells that a swing or a speed dies away by the law that the robot is
        /// configured with, and by no other.
        DecayLaw = "W021 decay-law",
        /// What a trial tells of the robot's parameters is about what is configured.
        RobotParameters = "W022 robot-parameters",
        /// No cycle that counts is unlike the others.
        OutlyingCycle = "W023 outlying-cycle",
        /// No rows repeat the one before although the robot moves.
        RepeatedRows = "W024 repeated-rows",
        /// The robot goes on smoothly from frame to frame.
        Jump = "W025 jump",
        /// The markers' noise is white: no filter has taken the fast part of it.
        Filtered = "W026 filtered",
        /// What a file states of itself is there and agrees with itself and its size.
        FileHeader = "W027 file-header",
        /// The joints do what no other campaign commands.
        OtherCampaign = "E002 other-campaign",
        /// No other trial has the same marker file.
        SameFile = "E003 same-file",
        /// Not most of a campaign's trials need a person for one reason.
        CommonReason = "E004 common-reason",
        /// The list names every marker file of the folder.
        Unlisted = "E005 unlisted",
        /// No joint is bent alike in all trials of a campaign.
        CommonOffset = "E006 common-offset",
    }
}

impl Check {
    /// How many times its limit the value of a check may be before nothing that follows from the
    /// recording can be believed: then the trial fails. `None` of checks beyond whose limit the
    /// numbers are less certain, but still the trial's.
    pub(crate) fn fails_beyond(self) -> Option<f64> {
        match self {
            // Markers 5 mm off the configured layout, if the limit is the default of 0.5 mm.
            Self::Residual => Some(10.0),
            // 8 %: near the end of what is searched for the gait.
            Self::Frequency => Some(4.0),
            // 20 degrees: an offset, a sign or a phase that is not the configured one.
            Self::Gait => Some(2.0),
            // Four fifths and half of all frames.
            Self::JumpedMarker | Self::SwappedLabels => Some(40.0),
            Self::AmbiguousMarkers => Some(50.0),
            // A fifth of the first swing.
            Self::HeldLinks => Some(10.0),
            // 20 degrees.
            Self::Straight => Some(4.0),
            // 10 degrees, of which a layout without its heights makes more.
            Self::Tilt => Some(20.0),
            // 10 mm.
            Self::JointPositions => Some(12.5),
            _ => None,
        }
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

/// Code, name and message, and why it fails the trial if it does.
impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}: {}", self.check, self.message)?;
        match self.severity {
            Severity::Error => {
                let digits = if self.value.fract() == 0.0 { 0 } else { 3 };
                write!(f, " (found {:.digits$}, needed at most {})", self.value, self.limit)
            }
            _ => Ok(()),
        }
    }
}

impl Finding {
    /// A value beyond the limit that fails a trial is given with that limit.
    pub(crate) fn new(check: Check, holds: bool, value: f64, limit: f64, message: String) -> Self {
        let most = check.fails_beyond().map(|times| times * limit).filter(|most| value > *most);
        let (severity, limit) = match (holds, most) {
            (true, _) => (Severity::Ok, limit),
            (false, Some(most)) => (Severity::Error, most),
            (false, None) if check == Check::Failed => (Severity::Error, limit),
            (false, None) => (Severity::Warning, limit),
        };
        Self { check, severity, value, limit, message }
    }

    /// A check that holds while `value` is not above `limit`.
    pub(crate) fn at_most(check: Check, value: f64, limit: f64, message: String) -> Self {
        Self::new(check, value <= limit, value, limit, message)
    }

    /// A check that holds while `value` is not below `limit`.
    pub(crate) fn at_least(check: Check, value: f64, limit: f64, message: String) -> Self {
        Self::new(check, value >= limit, value, limit, message)
    }

    /// The same finding, which fails the trial.
    pub(crate) fn failing(mut self) -> Self {
        self.severity = Severity::Error;
        self
    }

    /// The same finding, worth reporting although it holds.
    pub(crate) fn notable(mut self, is_notable: bool) -> Self {
        if is_notable && self.holds() {
            self.severity = Severity::Info;
        }
        self
    }

    pub(crate) fn holds(&self) -> bool {
        matches!(self.severity, Severity::Ok | Severity::Info)
    }

    pub(crate) fn row(&self, trial: &str) -> CheckRow {
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

#[cfg(test)]
mod tests {
    use trilink_tables::Explanation;

    use super::*;

    #[test]
    fn every_check_is_explained_and_nothing_else_is() {
        let mut explained: Vec<&str> = Explanation::all().map(|of| of.check).collect();
        explained.sort_unstable();
        let mut checks = Check::ALL.map(Check::name);
        checks.sort_unstable();
        assert_eq!(explained, checks);
        for Explanation { check, parts } in Explanation::all() {
            let headings: Vec<&str> = parts.iter().map(|(heading, _)| *heading).collect();
            assert_eq!(headings, ["What", "Why it matters", "What to do"], "{check}");
            for (heading, text) in parts {
                let is_plain = !["**", "](", "\n"].iter().any(|mark| text.contains(mark));
                assert!(
                    text.len() > 20 && text.ends_with('.') && is_plain,
                    "{check} {heading}: {text}"
                );
            }
        }
    }
}
