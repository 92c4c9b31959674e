//! Verdicts on claims, and the criteria for them.

use std::fmt;

use serde::{Deserialize, Serialize, Serializer};
use trilink_base::named;

/// Relative tolerance of [`Criterion::Equals`].
const EQUAL: f64 = 1e-9;

named! {
    /// Verdict on a claim of the paper.
    pub enum Verdict {
        Reproduced = "reproduced",
        Differs = "differs",
        NotTestable = "not testable here",
    }
}

/// Value of a formula, with its confidence interval and a note.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Found {
    /// Value; NaN if it does not exist because there is no motion or no optimum.
    pub value: f64,
    /// 95 % confidence limits; NaN where the interval is open, `None` if the value has no interval.
    pub limits: Option<[f64; 2]>,
    pub note: &'static str,
}

impl Found {
    pub(crate) fn new(value: f64) -> Self {
        Self::with_note(value, "")
    }

    pub(crate) fn with_note(value: f64, note: &'static str) -> Self {
        Self { value, limits: None, note }
    }
}

/// Criterion that a value must meet to agree with a claim.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Criterion {
    /// Maximum absolute difference from the printed value.
    Within(f64),
    /// Value that must be reached within a relative tolerance of 1e-9.
    Equals(f64),
    AtLeast(f64),
    AtMost(f64),
    Between([f64; 2]),
    /// The printed value, give or take this rounding error, must lie in the 95 % confidence interval of the measured or
    /// fitted value.
    ConfidenceInterval(f64),
}

impl fmt::Display for Criterion {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Within(tolerance) => {
                write!(f, "within {tolerance} of the value published in the paper")
            }
            Self::Equals(value) => write!(f, "equal to {value}"),
            Self::AtLeast(min) => write!(f, "at least {min}"),
            Self::AtMost(max) if *max != 0.0 && *max < 1e-4 => write!(f, "at most {max:e}"),
            Self::AtMost(max) => write!(f, "at most {max}"),
            Self::Between([low, high]) => write!(f, "{low} to {high}"),
            Self::ConfidenceInterval(_) => {
                f.write_str("the value published in the paper lies in the 95 % confidence interval")
            }
        }
    }
}

/// Serialises the criterion as text, such as `at most 5`.
impl Serialize for Criterion {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl Criterion {
    /// Returns whether a value meets the criterion; `None` if the printed value or the interval needed to decide this
    /// is missing.
    pub(crate) fn is_met(self, found: &Found, printed: Option<f64>) -> Option<bool> {
        let value = found.value;
        Some(match self {
            Self::Within(tolerance) => (value - printed?).abs() <= tolerance,
            Self::Equals(wanted) => (value - wanted).abs() <= EQUAL * wanted.abs(),
            Self::AtLeast(min) => value >= min,
            Self::AtMost(max) => value <= max,
            Self::Between([low, high]) => (low..=high).contains(&value),
            Self::ConfidenceInterval(rounding) => {
                // An open end of the interval is NaN, so every comparison with it is false.
                let [low, high] = found.limits?;
                let printed = printed?;
                !(printed + rounding < low || printed - rounding > high)
            }
        })
    }
}
