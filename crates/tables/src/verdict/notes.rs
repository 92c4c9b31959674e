//! What a fit did without.

use std::fmt::{self, Display, Formatter};

use trilink_robot::metrics::Metric;

use super::serialize_as_sentence;
use crate::columns;

/// What was fitted instead of what is missing, and what the objective and the intervals lack.
#[derive(Debug, Clone, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct FitNotes {
    /// Trials of which raw skid ratios are fitted, since debiased ones are not known.
    pub raw_skid_trials: Vec<String>,
    /// Metrics that the objective weighs and no trial has.
    pub missing_metrics: Vec<Metric>,
    /// Whether intervals hold nothing of what the model leaves out, for fewer than [`FitNotes::LEAST_FREQUENCIES`].
    pub few_frequencies: bool,
}

columns! {
    FitNotes as "{}" {
        raw_skid_trials: Vec<String>,
        missing_metrics: Vec<Metric>,
        few_frequencies: bool,
    }
}

impl FitNotes {
    /// Fewer do not tell what the model leaves out.
    pub const LEAST_FREQUENCIES: usize = 3;

    /// Whether there is nothing to say.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

impl Display for FitNotes {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let Self { raw_skid_trials, missing_metrics, few_frequencies } = self;
        let mut notes = Vec::new();
        if !raw_skid_trials.is_empty() {
            notes.push(format!(
                "raw skid ratios are fitted, since debiased ones are not known: trial {}",
                raw_skid_trials.join(", ")
            ));
        }
        if !missing_metrics.is_empty() {
            let lacking: Vec<&str> = missing_metrics.iter().map(|of| of.name()).collect();
            let lacking = lacking.join(", ");
            notes.push(format!("the objective lacks {lacking}: no trial has it"));
        }
        if *few_frequencies {
            notes.push(format!(
                "no interval holds what the model leaves out: that takes {} frequencies",
                Self::LEAST_FREQUENCIES
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
    fn notes_are_read_as_they_were_written_and_said_in_a_sentence() {
        let all = FitNotes {
            raw_skid_trials: vec!["one".to_owned(), "a, b".to_owned()],
            missing_metrics: vec![Metric::Sigma0, Metric::Sigma1],
            few_frequencies: true,
        };
        let said = "raw skid ratios are fitted, since debiased ones are not known: trial one, a, b; \
                    the objective lacks sigma0, sigma1: no trial has it; no interval holds what the \
                    model leaves out: that takes 3 frequencies";
        assert_eq!(all.to_string(), said);
        assert_eq!(FitNotes::default().to_string(), "");
        stored(&[all, FitNotes::default()]);
    }
}
