//! What the page says of a run against the accepted baseline.

use serde::Serialize;

/// What changed since the baseline.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Changes {
    /// The baseline cannot be used; why.
    NotCompared { problem: String },
    Compared {
        /// When and why the baseline was accepted, if it says so.
        accepted: Option<AcceptedBaseline>,
        /// Values out of tolerance, within it, different but not judged, and the same.
        out: usize,
        within: usize,
        not_judged: usize,
        same: usize,
        /// The largest of those out of tolerance.
        largest: Vec<ChangedValue>,
        /// Trials and fits that only the baseline has, and that only this run has.
        vanished: Vec<String>,
        appeared: Vec<String>,
    },
}

/// When and why a baseline was accepted.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AcceptedBaseline {
    /// UTC, as in `2026-01-31T12:00:00Z`.
    pub time: String,
    pub reason: String,
}

/// A value that differs, as text; what is not known is empty.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChangedValue {
    pub table: String,
    /// Row of the table.
    pub of: String,
    pub column: String,
    pub baseline: String,
    pub candidate: String,
    /// Relative change, %.
    pub change: String,
    /// Change in standard errors.
    pub errors: String,
    /// Tolerance that it was judged by.
    pub limit: String,
}
