//! Extrapolation of a fitted model beyond its trials.

use crate::rows;

rows! {
    /// Whether a motion predicted by a fitted model lies outside the range of the trials to which the model
    /// was fitted.
    #[derive(serde::Serialize)]
    pub struct Extrapolation {
        /// Whether the motion lies outside the range of the trials; missing if the coefficients are not
        /// fitted or the range is unknown.
        pub extrapolated: Option<bool>,
        /// Quantities of the motion that are outside the range of the trials, with this range, or the reason
        /// why the range is unknown; empty if the motion is within the range.
        pub beyond_trials: String,
    }
}
