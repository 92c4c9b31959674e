//! Verdicts: what counts as reproduced.

use super::claims::{Claim, Criterion};
use super::computed::Found;

/// Relative tolerance of [`Criterion::Equals`].
const EQUAL: f64 = 1e-9;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    Reproduced,
    Differs,
    NotTestable,
}

impl Verdict {
    pub const ALL: [Self; 3] = [Self::Reproduced, Self::Differs, Self::NotTestable];

    pub fn name(self) -> &'static str {
        match self {
            Self::Reproduced => "reproduced",
            Self::Differs => "differs",
            Self::NotTestable => "not testable here",
        }
    }
}

impl Criterion {
    /// In words.
    pub fn text(self) -> String {
        match self {
            Self::Within(tolerance) => format!("within {tolerance} of the printed value"),
            Self::WithinPercent(tolerance) => format!("within {tolerance} % of the printed value"),
            Self::Equals(value) => format!("equal to {value}"),
            Self::AtLeast(least) => format!("at least {least}"),
            Self::AtMost(most) if most != 0.0 && most < 1e-4 => format!("at most {most:e}"),
            Self::AtMost(most) => format!("at most {most}"),
            Self::Between([low, high]) => format!("{low} to {high}"),
            Self::ConfidenceInterval(_) => {
                "printed value in the fit's 95 % confidence interval".to_owned()
            }
        }
    }

    /// Whether a number meets it; `None` where it cannot be told.
    fn is_met(self, found: &Found, printed: Option<f64>) -> Option<bool> {
        let value = found.value;
        Some(match self {
            Self::Within(tolerance) => (value - printed?).abs() <= tolerance,
            Self::WithinPercent(percent) => {
                (value - printed?).abs() <= 0.01 * percent * printed?.abs()
            }
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

/// The verdict on a claim by the number that it is about, and why there is none.
pub fn judge(claim: &Claim, found: Option<&Found>) -> (Verdict, Option<String>) {
    let not_testable = |reason: &str| (Verdict::NotTestable, Some(reason.to_owned()));
    if let Some(reason) = &claim.not_testable {
        return not_testable(reason);
    }
    let Some(found) = found else {
        let lacking = claim.measured.as_ref().map(|measured| measured.lacking());
        return not_testable(lacking.unwrap_or("Nothing answers it."));
    };
    let printed = claim.printed.as_ref().and_then(|printed| printed.number());
    match claim.criterion.and_then(|criterion| criterion.is_met(found, printed)) {
        Some(true) => (Verdict::Reproduced, None),
        Some(false) => (Verdict::Differs, None),
        None => not_testable("The fit has no confidence interval."),
    }
}
