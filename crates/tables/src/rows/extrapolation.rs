//! Whether a prediction lies within what was measured.

use crate::rows;

rows! {
    /// Whether a motion of a fitted model is beyond the trials that its coefficients are from.
    #[derive(serde::Serialize)]
    pub struct Extrapolation {
        /// Missing where no fitted coefficients are used, or what the trials cover is not known.
        pub extrapolated: Option<bool>,
        /// What is beyond, with the range of the trials, or why that is not known; empty within.
        pub beyond_trials: String,
    }
}
