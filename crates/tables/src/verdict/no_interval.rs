//! Why coefficients or predictions have no confidence limits.

use std::fmt::{self, Display, Formatter};

use trilink_base::named;

use super::{serialize_as_sentence, verdict};

named! {
    /// What keeps a fit, a prediction or an optimum from having confidence limits.
    pub enum NoIntervalReason {
        /// Of these metrics.
        UnknownNoise = "unknown-noise",
        NotAskedFor = "not-asked-for",
        Inadequate = "inadequate",
        FitFailed = "fit-failed",
        NothingFitted = "nothing-fitted",
        NoReplicates = "no-replicates",
        NoMotion = "no-motion",
        /// The fit to a resample has no motion: the gait passes a singular shape.
        ResampleSingular = "resample-singular",
        /// None was found.
        ResampleDiverged = "resample-diverged",
        /// Its gait was not measured there.
        ResampleGaitUnknown = "resample-gait-unknown",
        /// The configuration is not the fit's.
        OtherSettings = "other-settings",
        OtherTrials = "other-trials",
        /// This parameter is not as it was fitted.
        ParameterSet = "parameter-set",
        NotFitted = "not-fitted",
        NoOptimum = "no-optimum",
        /// Limits are those of another optimum.
        NotTheBest = "not-the-best",
        Front = "front",
    }
}

verdict! {
    /// Why there are no confidence limits.
    pub struct NoInterval {
        pub reason: NoIntervalReason as "",
        /// The metrics or the parameter that it is about.
        pub of: Vec<String> as "_of",
    }
}

impl From<NoIntervalReason> for NoInterval {
    fn from(reason: NoIntervalReason) -> Self {
        Self { reason, of: Vec::new() }
    }
}

impl Display for NoInterval {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        use NoIntervalReason as Reason;
        const RESAMPLE: &str = "the fit to a resample has no motion at this frequency";
        let of = self.of.join(", ");
        match self.reason {
            Reason::UnknownNoise => {
                write!(f, "no cycles, repeats or standard errors tell the noise of {of}")
            }
            Reason::NotAskedFor => f.write_str("neither replicates nor profiles were asked for"),
            Reason::Inadequate => f.write_str("the model does not fit"),
            Reason::FitFailed => f.write_str("the fit has failed"),
            Reason::NothingFitted => f.write_str("no coefficient is fitted"),
            Reason::NoReplicates => f.write_str("no replicates were asked for"),
            Reason::NoMotion => f.write_str("there is no motion"),
            Reason::ResampleSingular => {
                write!(f, "{RESAMPLE}: the gait crosses det W_b = 0 without meeting condition (5)")
            }
            Reason::ResampleDiverged => write!(f, "{RESAMPLE}: no periodic motion was found"),
            Reason::ResampleGaitUnknown => write!(
                f,
                "{RESAMPLE}: the offset, amplitude and phase of the commanded joints were not \
                 measured; gait_input = \"commanded\" under [fit] does without"
            ),
            Reason::OtherSettings => {
                f.write_str("the settings are not those of the fit; `trilink fit` fits anew")
            }
            Reason::OtherTrials => {
                f.write_str("the trials are not those of the fit; `trilink fit` fits anew")
            }
            Reason::ParameterSet => {
                write!(f, "{of} is set: of what is not as it was fitted nothing is known")
            }
            Reason::NotFitted => f.write_str("the coefficients are not fitted"),
            Reason::NoOptimum => f.write_str("no optimum counts"),
            Reason::NotTheBest => f.write_str("of the best alone"),
            Reason::Front => f.write_str("a front has none"),
        }
    }
}

serialize_as_sentence!(NoInterval);

#[cfg(test)]
mod tests {
    use super::super::tests::stored;
    use super::*;

    #[test]
    fn every_reason_is_read_as_it_was_written_and_said_in_a_sentence() {
        let of = vec!["d".to_owned(), "sigma0".to_owned()];
        let all = NoIntervalReason::ALL.map(|reason| NoInterval { reason, of: of.clone() });
        let said: std::collections::BTreeSet<String> =
            all.iter().map(NoInterval::to_string).collect();
        assert_eq!(said.len(), all.len());
        assert!(said.contains("no cycles, repeats or standard errors tell the noise of d, sigma0"));
        let table = stored(&all.into_iter().map(Some).chain([None]).collect::<Vec<_>>());
        assert_eq!(table.frame.get_column_names(), ["of", "of_of"]);
    }
}
