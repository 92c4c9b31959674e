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
        /// Values whose changes exceed their tolerances the most.
        largest: Vec<ChangedValue>,
        /// Names of the trials and fits that only the baseline contains.
        vanished: Vec<String>,
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

/// Table value that changed, with all fields formatted as text; unknown fields are empty.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChangedValue {
    pub table: String,
    /// Name of the table row.
    pub of: String,
    pub column: String,
    pub baseline: String,
    pub candidate: String,
    /// Relative change, in per cent.
    pub change: String,
    /// Change as a multiple of the standard error.
    pub errors: String,
    /// Tolerance with which the change was compared.
    pub limit: String,
}
