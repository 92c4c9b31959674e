//! Small named checks, all run on every trial, all reported.

use std::fmt;

use trilink_base::named;
use trilink_tables::{CheckRow, Severity};

/// Defines [`Check`]: of each its code and name, then the limit of its value, unless the configuration or the
/// recording gives that, and how many times this limit the value may be before the trial fails, as nothing
/// that follows from the recording can be believed then. Else the numbers are less certain, but still the trial's.
macro_rules! checks {
    ($(
        $(#[$meta:meta])*
        $check:ident = $name:literal $(, limit $limit:literal)? $(, fails beyond $times:literal times)?;
    )*) => {
        named! {
            /// What is looked at: code and name. They do not change; reports and scripts count them.
            pub enum Check { $($(#[$meta])* $check = $name,)* }
        }

        impl Check {
            /// Missing if it is not the same for all trials.
            pub(crate) const fn limit(self) -> f64 {
                match self { $(Self::$check => [$($limit,)? f64::NAN][0],)* }
            }

            fn fails_beyond(self) -> Option<f64> {
                match self { $(Self::$check => [$(Some($times),)? None][0],)* }
            }
        }
    };
}

// An entry here, its explanation in `crates/tables/src/checks.md` under the same name, and the finding where the
// value arises are all that a check is.
checks! {
    /// The trial could be processed.
    Failed = "E001 failed";
    /// The file states its frame rate.
    Rate = "W001 rate";
    /// No frames are left out.
    FrameContinuity = "W002 frame-continuity", limit 0.0;
    /// The cameras saw this part of all markers' frames.
    Coverage = "W003 coverage", limit 0.9;
    /// The markers lie on the links as in the layout: 5 mm off, if the limit is the default of 0.5 mm.
    Residual = "W004 residual", fails beyond 10.0 times;
    /// The robot moved at the commanded frequency: 8 % off is near the end of what is searched for the gait.
    Frequency = "W005 frequency", limit 0.02, fails beyond 4.0 times;
    /// Enough cycles for a mean are steady.
    SteadyState = "W006 steady-state", limit 5.0;
    /// Fraction of the cycles after the transient that were left out because of gaps: the cameras need
    /// attention.
    LongGaps = "W007 long-gaps", limit 0.3;
    /// Every row has a frame number.
    RowsWithoutFrame = "W008 rows-without-frame", limit 0.0;
    /// The joints did what they were commanded, in offset, amplitude and phase, degrees: beyond 20, an offset, a
    /// sign or a phase is not the configured one.
    Gait = "W009 gait", limit 10.0, fails beyond 2.0 times;
    /// d does not change from the first half of the cycles used to the second.
    Drift = "W010 drift", limit 0.01;
    /// No marker is off the others of its link or off the link's motion, but in this part of the frames. Half
    /// of all frames were seen to recover; the cameras' labelling that fails in one frame of fifty is a reason
    /// to look all the same.
    JumpedMarker = "W011 jumped-marker", limit 0.02, fails beyond 40.0 times;
    /// No two labels of a link are swapped.
    SwappedLabels = "W012 swapped-labels", limit 0.02, fails beyond 40.0 times;
    /// Where markers contradict each other, it is clear which of them is wrong; the others are thrown out.
    AmbiguousMarkers = "W013 ambiguous-markers", limit 0.01, fails beyond 50.0 times;
    /// The links that should be held while a joint swings do not move, as a part of the first swing.
    HeldLinks = "W014 held-links", limit 0.02, fails beyond 10.0 times;
    /// A swing or a speed dies away as linear damping makes it, but for noise.
    Decay = "W015 decay";
    /// The robot that coasts is straight, degrees.
    Straight = "W016 straight", limit 5.0, fails beyond 4.0 times;
    /// Floor and links are level, degrees. What is more is corrected and flagged; a suspension that swings by
    /// 0.3 degrees within 6 to 20 s stays below. A layout without its heights makes more than 10.
    Tilt = "W017 tilt", limit 0.5, fails beyond 20.0 times;
    /// The joints are where h and l put them, mm.
    JointPositions = "W018 joint-places", limit 0.8, fails beyond 12.5 times;
    /// No servo stops short of its peaks, as a part of its first harmonic. One that stops at 0.95 of its
    /// amplitude stays behind by 0.023.
    GaitClipping = "W019 gait-clipping", limit 0.02;
    /// No row has more cells than the header has columns.
    LongRows = "W020 long-rows", limit 0.0;
    /// The recording tells that a swing or a speed dies away by the law that the robot is
    /// configured with, and by no other.
    DecayLaw = "W021 decay-law";
    /// What a trial tells of the robot's parameters is about what is configured: so many times as large, or as
    /// small.
    RobotParameters = "W022 robot-parameters", limit 3.0;
    /// No cycle that counts is unlike the others in d, alpha1 or a skid ratio, as a part of theirs, if it is
    /// not by chance.
    OutlyingCycle = "W023 outlying-cycle", limit 0.05;
    /// No rows repeat the one before although the robot moves, but for a frame that was held now and then.
    RepeatedRows = "W024 repeated-rows", limit 0.01;
    /// The robot goes on smoothly from frame to frame.
    Jump = "W025 jump", limit 0.0;
    /// The markers' noise is white: no filter has taken the fast part of it. Slow noise over white noise is 0.8
    /// to 1.2 in unfiltered recordings, 4 in those low-passed at 30 Hz, 100 at 6 Hz, 5 with coordinates to 0.1 mm.
    Filtered = "W026 filtered", limit 2.0;
    /// What a file states of itself is there and agrees with itself and its size.
    FileHeader = "W027 file-header", limit 0.0;
    /// The joints do what no other campaign commands.
    OtherCampaign = "E002 other-campaign";
    /// No other trial has the same marker file.
    SameFile = "E003 same-file";
    /// Not most of a campaign's trials need a person for one reason.
    CommonReason = "E004 common-reason";
    /// The list names every marker file of the folder.
    Unlisted = "E005 unlisted", limit 0.0;
    /// No joint is bent alike in all trials of a campaign.
    CommonOffset = "E006 common-offset";
}

impl Check {
    /// Whether what it finds is always an error, as the codes with an E say.
    fn is_error(self) -> bool {
        self.name().starts_with('E')
    }

    /// Whether only several trials together show it.
    pub(crate) fn is_of_several(self) -> bool {
        self.is_error() && self != Self::Failed
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
            (false, None) if check.is_error() => (Severity::Error, limit),
            (false, None) => (Severity::Warning, limit),
        };
        Self { check, severity, value, limit, message }
    }

    /// A check that holds while `value` is not above its limit.
    pub(crate) fn at_most(check: Check, value: f64, message: String) -> Self {
        let limit = check.limit();
        Self::new(check, value <= limit, value, limit, message)
    }

    /// A check that holds while `value` is not below its limit.
    pub(crate) fn at_least(check: Check, value: f64, message: String) -> Self {
        let limit = check.limit();
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
