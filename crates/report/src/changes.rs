//! Comparison of a run with the accepted baseline, as shown on the report page.

use serde::Serialize;

/// Changes in the results since the baseline.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Changes {
    /// The baseline cannot be used, for the reason in `problem`.
    NotCompared { problem: String },
    Compared {
        /// Time of and reason for accepting the baseline, if recorded.
        accepted: Option<AcceptedBaseline>,
        /// Number of values whose change exceeds the tolerance.
        out: usize,
        /// Number of values that changed within tolerance.
        within: usize,
        /// Number of values that changed but for which no tolerance is defined.
        not_judged: usize,
        /// Number of unchanged values.
        same: usize,
        /// First causes of the changes that exceed their tolerances, in words.
        causes: Vec<String>,
        /// Number of causes that are not named.
        more_causes: usize,
        /// Names of the trials and fits that only this run contains.
        appeared: Vec<String>,
    },
}

/// Record of the acceptance of a baseline: time and reason.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AcceptedBaseline {
    /// Time of acceptance in UTC, such as `2026-01-31T12:00:00Z`.
    pub time: String,
    pub reason: String,
}
