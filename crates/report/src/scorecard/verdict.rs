//! Verdicts: what counts as reproduced.

use std::fmt;

use serde::{Deserialize, Serialize, Serializer};
use trilink_base::named;

/// Relative tolerance of [`Criterion::Equals`].
const EQUAL: f64 = 1e-9;

named! {
    /// What becomes of a claim.
    pub enum Verdict {
        Reproduced = "reproduced",
        Differs = "differs",
        NotTestable = "not testable here",
    }
}

/// A number, and what is to be said of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Found {
    /// NaN where there is none: no such motion, no optimum.
    pub value: f64,
    /// 95 % confidence limits; NaN where the interval is open.
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

/// When a number agrees with a claim.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Criterion {
    /// Not farther from the printed number than this.
    Within(f64),
    /// To nine digits.
    Equals(f64),
    AtLeast(f64),
    AtMost(f64),
    Between([f64; 2]),
    /// The printed number, give or take this, lies in the 95 % confidence interval of what was
    /// measured or fitted.
    ConfidenceInterval(f64),
}

impl fmt::Display for Criterion {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Within(tolerance) => write!(f, "within {tolerance} of the printed value"),
            Self::Equals(value) => write!(f, "equal to {value}"),
            Self::AtLeast(least) => write!(f, "at least {least}"),
            Self::AtMost(most) if *most != 0.0 && *most < 1e-4 => write!(f, "at most {most:e}"),
            Self::AtMost(most) => write!(f, "at most {most}"),
            Self::Between([low, high]) => write!(f, "{low} to {high}"),
            Self::ConfidenceInterval(_) => {
                f.write_str("printed value in the 95 % confidence interval")
            }
        }
    }
}

/// In words.
impl Serialize for Criterion {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl Criterion {
    /// Whether a number meets it; `None` where it cannot be told.
    pub(crate) fn is_met(self, found: &Found, printed: Option<f64>) -> Option<bool> {
        let value = found.value;
        Some(match self {
            Self::Within(tolerance) => (value - printed?).abs() <= tolerance,
            Self::Equals(wanted) => (value - wanted).abs() <= EQUAL * wanted.abs(),
            Self::AtLeast(least) => value >= least,
            Self::AtMost(most) => value <= most,
            Self::Between([low, high]) => (low..=high).contains(&value),
            Self::ConfidenceInterval(rounding) => {
                // An open end is NaN: nothing lies beyond it.
                let [low, high] = found.limits?;
                let printed = printed?;
                !(printed + rounding < low || printed - rounding > high)
            }
        })
    }
}
