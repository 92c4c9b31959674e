//! Notes on data and uncertainties that are missing in a fit.

use std::fmt::{self, Display, Formatter};

use trilink_robot::metrics::Metric;

use super::serialize_as_sentence;
use crate::columns;

/// Notes on a fit: substitutes for missing data, and what the objective and the confidence intervals do not
/// include.
#[derive(Debug, Clone, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct FitNotes {
    /// Trials whose raw skid ratios are fitted because debiased ones are not available.
    pub raw_skid_trials: Vec<String>,
    /// Trials that are left out because they are unlike their repeats.
    pub unlike_repeats: Vec<String>,
    /// Metrics that have a weight in the objective but no measurement in any trial.
    pub missing_metrics: Vec<Metric>,
    /// Whether the confidence intervals ignore model error, because there are fewer than
    /// [`FitNotes::MIN_FREQUENCIES`] frequencies.
    pub few_frequencies: bool,
}

columns! {
    FitNotes as "{}" {
        raw_skid_trials: Vec<String>,
        unlike_repeats: Vec<String>,
        missing_metrics: Vec<Metric>,
        few_frequencies: bool,
    }
}

impl FitNotes {
    /// Minimum number of frequencies from which model error can be estimated.
    pub const MIN_FREQUENCIES: usize = 3;

    /// Returns whether the fit has no notes.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

impl Display for FitNotes {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let Self { raw_skid_trials, unlike_repeats, missing_metrics, few_frequencies } = self;
        let mut notes = Vec::new();
        if !raw_skid_trials.is_empty() {
            notes.push(format!(
                "raw skid ratios are fitted for the trials that have no debiased ones: {}",
                raw_skid_trials.join(", ")
            ));
        }
        if !unlike_repeats.is_empty() {
            notes.push(format!(
                "trials that are unlike their repeats are left out (W028 in `trilink explain`): {}",
                unlike_repeats.join(", ")
            ));
        }
        if !missing_metrics.is_empty() {
            let missing: Vec<&str> = missing_metrics.iter().map(|metric| metric.name()).collect();
            notes.push(format!(
                "the objective needs metrics that no trial provides: {}",
                missing.join(", ")
            ));
        }
        if *few_frequencies {
            notes.push(format!(
                "the confidence intervals ignore model error, because at least {} frequencies are needed to estimate \
                 it",
                Self::MIN_FREQUENCIES
            ));
        }
        f.write_str(&notes.join("; "))
    }
}

serialize_as_sentence!(FitNotes);

#[cfg(test)]
mod tests {
    use super::super::tests::stored;
    use super::*;

    #[test]
    fn notes_survive_a_round_trip_and_have_a_sentence() {
        let all = FitNotes {
            raw_skid_trials: vec!["one".to_owned(), "a, b".to_owned()],
            unlike_repeats: vec!["two".to_owned()],
            missing_metrics: vec![Metric::Sigma0, Metric::Sigma1],
            few_frequencies: true,
        };
        let sentence = "raw skid ratios are fitted for the trials that have no debiased ones: one, a, b; trials \
                        that are unlike their repeats are left out (W028 in `trilink explain`): two; the objective needs metrics that no trial provides: sigma0, sigma1; the confidence intervals \
                        ignore model error, because at least 3 frequencies are needed to estimate it";
        assert_eq!(all.to_string(), sentence);
        assert_eq!(FitNotes::default().to_string(), "");
        stored(&[all, FitNotes::default()]);
    }
}
