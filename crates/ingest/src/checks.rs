//! Named checks of trials. All of them are run on every trial, and all results are reported.

use std::fmt;

use trilink_base::named;
use trilink_tables::{CheckRow, MAX_DEVIATIONS, Severity};

/// Defines [`Check`]. Each entry has the check's code and name, then the limit of the checked value (unless the
/// configuration or the recording gives the limit), then the multiple of the limit beyond which the trial fails because
/// nothing derived from such a recording can be trusted. Between the limit and that multiple the results are valid but
/// less certain.
macro_rules! checks {
    ($(
        $(#[$meta:meta])*
        $check:ident = $name:literal $(, limit $limit:expr)? $(, fails beyond $times:literal times)?;
    )*) => {
        named! {
            /// Check of a trial or of several trials. Codes and names never change, because reports and scripts refer
            /// to them.
            pub enum Check { $($(#[$meta])* $check = $name,)* }
        }

        impl Check {
            /// Returns the limit of the checked value, or NaN if the limit depends on the trial.
            pub(crate) const fn limit(self) -> f64 {
                match self { $(Self::$check => [$($limit,)? f64::NAN][0],)* }
            }

            fn fails_beyond(self) -> Option<f64> {
                match self { $(Self::$check => [$(Some($times),)? None][0],)* }
            }
        }
    };
}

// To add a check, add an entry here, an explanation under the same name in `crates/tables/src/checks.md`, and a finding
// where the value is computed.
checks! {
    /// Checks that the trial can be processed.
    Failed = "E001 failed";
    /// Checks that the file states its frame rate.
    Rate = "W001 rate";
    /// Checks that no frames are missing between the first and the last.
    FrameContinuity = "W002 frame-continuity", limit 0.0;
    /// Checks that the fraction of marker positions that the cameras recorded reaches a minimum.
    Coverage = "W003 coverage", limit 0.9;
    /// Checks that the markers lie on the links as in the layout. The value is their mean residual, mm; with the
    /// default limit of 0.5 mm the trial fails beyond 5 mm.
    Residual = "W004 residual", fails beyond 10.0 times;
    /// Checks that the robot moves at the commanded frequency. The value is the relative deviation; beyond 8 %, which
    /// is near the end of the frequency search range, the trial fails.
    Frequency = "W005 frequency", limit 0.02, fails beyond 4.0 times;
    /// Checks that the trial has enough steady cycles for a mean.
    SteadyState = "W006 steady-state", limit 5.0;
    /// Checks the fraction of the cycles after the transient that are left out because of gaps. Above the limit the
    /// camera setup needs attention.
    LongGaps = "W007 long-gaps", limit 0.3;
    /// Checks that every row has a frame number.
    RowsWithoutFrame = "W008 rows-without-frame", limit 0.0;
    /// Checks that the joints follow their commands in offset, amplitude and phase. The value is the maximum deviation,
    /// degrees; a deviation of more than 20 degrees means that an offset, a sign or a phase differs from the
    /// configuration.
    Gait = "W009 gait", limit 10.0, fails beyond 2.0 times;
    /// Checks that the displacement per cycle d does not change from the first half of the used cycles to the second.
    Drift = "W010 drift", limit 0.01;
    /// Checks the fraction of frames in which a marker contradicts the other markers of its link or the link's motion.
    /// Trials with half of all frames affected have been recovered, but mislabelling in 1 of 50 frames should be looked
    /// into.
    JumpedMarker = "W011 jumped-marker", limit 0.02, fails beyond 40.0 times;
    /// Checks the fraction of frames in which two labels of a link are swapped.
    SwappedLabels = "W012 swapped-labels", limit 0.02, fails beyond 40.0 times;
    /// Checks the fraction of frames in which markers contradict each other and the wrong one cannot be identified;
    /// these frames are rejected.
    AmbiguousMarkers = "W013 ambiguous-markers", limit 0.01, fails beyond 50.0 times;
    /// Checks that the links that should be held while a joint swings do not move. The value is their RMS motion as a
    /// fraction of the joint's largest swing.
    HeldLinks = "W014 held-links", limit 0.02, fails beyond 10.0 times;
    /// Checks that noise alone explains how a recording deviates from a decay law: a released joint's swing from linear
    /// damping, a coasting robot's speed from the configured roll resistance.
    Decay = "W015 decay";
    /// Checks that the robot is straight while it coasts. The value is the larger of its mean joint angles, degrees.
    Straight = "W016 straight", limit 5.0, fails beyond 4.0 times;
    /// Checks that the floor and the links are level. The value is the largest tilt, degrees. A tilt above the limit is
    /// corrected and flagged; a suspension that swings by 0.3 degrees with a period of 6 to 20 s stays below the limit.
    /// Wrong heights in a layout cause more than 10 degrees.
    Tilt = "W017 tilt", limit 0.5, fails beyond 20.0 times;
    /// Checks that the joints are where the robot's lengths h and l place them. The value is the largest distance of a
    /// joint from its place, mm.
    JointPositions = "W018 joint-places", limit 0.8, fails beyond 12.5 times;
    /// Checks that no servo saturates before the peaks of its command. The value is the shortfall at the peaks as a
    /// fraction of the first harmonic. A servo that saturates at 0.95 of its amplitude has a shortfall of 0.023.
    GaitClipping = "W019 gait-clipping", limit 0.02;
    /// Checks that no row has more cells than the header has columns.
    LongRows = "W020 long-rows", limit 0.0;
    /// Checks that the recording confirms the configured decay law of a swing or a speed: that this law, and no other
    /// as simple or simpler, is consistent with the recording.
    DecayLaw = "W021 decay-law";
    /// Checks that the measured robot parameters agree with the configured ones. The value is the largest ratio between
    /// the two or its reciprocal, whichever is larger.
    RobotParameters = "W022 robot-parameters", limit 3.0;
    /// Checks that no used cycle differs significantly from the others in d, alpha1 or a skid ratio. The value is the
    /// largest significant difference as a fraction of the mean of the others.
    OutlyingCycle = "W023 outlying-cycle", limit 0.05;
    /// Checks the fraction of rows that repeat the previous row while the robot moves; an occasional held frame is
    /// tolerated.
    RepeatedRows = "W024 repeated-rows", limit 0.01;
    /// Checks that the robot moves smoothly from frame to frame. The value is the number of jumps.
    Jump = "W025 jump", limit 0.0;
    /// Checks that the marker noise is white, that is, that no low-pass filter was applied. The value is the ratio of
    /// low-frequency noise to that expected for white noise; it is 0.8 to 1.2 in unfiltered recordings, 4 after a
    /// low-pass filter at 30 Hz, 100 after one at 6 Hz, and 5 for coordinates rounded to 0.1 mm.
    Filtered = "W026 filtered", limit 2.0;
    /// Checks that the file's metadata are complete and consistent with each other and with the file's size.
    FileHeader = "W027 file-header", limit 0.0;
    /// Checks that the metrics of the trial agree with those of the other trials of the same campaign, day and
    /// frequency. The value is the largest deviation from their median in robust standard deviations.
    UnlikeRepeats = "W028 unlike-repeats", limit MAX_DEVIATIONS;
    /// Checks that the floor is level where coast-downs or gaits in different directions show its slope. For a
    /// coast-down the value is the slope along the direction of travel, degrees.
    FloorSlope = "W029 floor-slope", limit 0.02;
    /// Checks that the file has all markers of the layout. The value is the number of missing markers; links with three
    /// others do without one.
    MissingMarkers = "W030 missing-markers", limit 0.0;
    /// Checks that no marker lacks only one or two of its coordinates, and no rigid body only a part of its pose.
    IncompletePositions = "W031 incomplete-positions", limit 0.0;
    /// Checks that the joints do not follow the gait of another campaign.
    OtherCampaign = "E002 other-campaign";
    /// Checks that no other trial has the same marker file.
    SameFile = "E003 same-file";
    /// Checks that no single reason causes most trials of a campaign to fail or to be flagged.
    CommonReason = "E004 common-reason";
    /// Checks that the trial list names every marker file of the folder.
    Unlisted = "E005 unlisted", limit 0.0;
    /// Checks that no joint has the same offset error in all trials of a campaign.
    CommonOffset = "E006 common-offset";
    /// Checks that every trial folder with earlier results still exists.
    FolderGone = "E007 folder-gone", limit 0.0;
}

impl Check {
    /// Returns whether failing the check is always an error, as it is for codes that begin with E.
    fn is_error(self) -> bool {
        self.name().starts_with('E')
    }

    /// Returns whether the check compares several trials.
    pub(crate) fn compares_trials(self) -> bool {
        (self.is_error() && self != Self::Failed)
            || matches!(self, Self::UnlikeRepeats | Self::FloorSlope)
    }
}

/// Result of a check.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Finding {
    pub check: Check,
    pub severity: Severity,
    pub value: f64,
    pub limit: f64,
    pub message: String,
}

/// Formats the code, name and message of the finding and, if it is an error, also its value and limit.
impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}: {}", self.check, self.message)?;
        if self.severity == Severity::Error {
            let digits = if self.value.fract() == 0.0 { 0 } else { 3 };
            write!(f, " (value {:.digits$}, limit {})", self.value, self.limit)?;
        }
        Ok(())
    }
}

impl Finding {
    /// Creates a finding; `holds` states whether the check has passed, and `limit` is the check's own limit. If the
    /// check has failed and its value even exceeds the multiple of `limit` beyond which the trial fails, the finding is
    /// an error and states that multiple as its limit.
    pub(crate) fn new(check: Check, holds: bool, value: f64, limit: f64, message: String) -> Self {
        let failure_limit =
            check.fails_beyond().map(|times| times * limit).filter(|&limit| value > limit);
        let (severity, limit) = match failure_limit {
            _ if holds => (Severity::Ok, limit),
            Some(failure_limit) => (Severity::Error, failure_limit),
            None if check.is_error() => (Severity::Error, limit),
            None => (Severity::Warning, limit),
        };
        Self { check, severity, value, limit, message }
    }

    /// Creates the finding of a check that passes if `value` is at most its limit.
    pub(crate) fn at_most(check: Check, value: f64, message: String) -> Self {
        let limit = check.limit();
        Self::new(check, value <= limit, value, limit, message)
    }

    /// Creates the finding of a check that passes if `value` is at least its limit.
    pub(crate) fn at_least(check: Check, value: f64, message: String) -> Self {
        let limit = check.limit();
        Self::new(check, value >= limit, value, limit, message)
    }

    /// Raises the severity of a failed check to an error, which fails the trial.
    pub(crate) fn failing(mut self) -> Self {
        self.severity = Severity::Error;
        self
    }

    /// Raises the severity of a passed check to information if `is_notable` is true.
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
        let mut explained: Vec<&str> =
            Explanation::all().map(|explanation| explanation.check).collect();
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
