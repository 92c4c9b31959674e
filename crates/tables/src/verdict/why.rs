//! Reasons why a result is missing.

use std::fmt::{self, Display, Formatter};

use serde::{Serialize, Serializer};

use crate::{Column, Columns, NamedCell, StoreError, Table, fill};

/// Reason why a result is missing. Tables store the name of the reason.
pub trait Reason: NamedCell + Copy {
    /// Returns a sentence that states the reason; `{of}` in the sentence is a placeholder for the subjects
    /// ([`Why::of`]).
    fn sentence(self) -> &'static str;
}

/// Reason why a result is missing, with its subjects, such as the metrics or the campaign concerned.
#[derive(Debug, Clone, PartialEq)]
pub struct Why<R> {
    pub reason: R,
    /// Subjects of the reason, such as metrics or a campaign.
    pub of: Vec<String>,
}

impl<R> Why<R> {
    /// Creates a reason with a single subject.
    pub fn new(reason: R, subject: &str) -> Self {
        Self { reason, of: vec![subject.to_owned()] }
    }
}

impl<R: Reason> From<R> for Why<R> {
    fn from(reason: R) -> Self {
        Self { reason, of: Vec::new() }
    }
}

impl<R: Reason> Display for Why<R> {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        f.write_str(&self.reason.sentence().replace("{of}", &self.of.join(", ")))
    }
}

impl<R: Reason> Serialize for Why<R> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<R: Reason> Columns for Option<Why<R>> {
    const PATTERN: &'static str = "{field}{}";

    fn blank() -> Self {
        None
    }

    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>) {
        let reasons = values.iter().map(|value| value.as_ref().map(|why| why.reason));
        let of = values.iter().map(|value| value.as_ref().map_or(Vec::new(), |why| why.of.clone()));
        Columns::write_all(reasons.collect::<Vec<_>>(), &fill(pattern, ""), columns);
        Columns::write_all(of.collect::<Vec<_>>(), &fill(pattern, "_of"), columns);
    }

    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError> {
        let reasons = Option::<R>::read(table, &fill(pattern, ""))?;
        let of = Vec::<String>::read(table, &fill(pattern, "_of"))?;
        let both = reasons.into_iter().zip(of);
        Ok(both.map(|(reason, of)| Some(Why { reason: reason?, of })).collect())
    }
}

/// Defines an enumeration of reasons with their names and sentences.
macro_rules! reasons {
    ($(#[$meta:meta])* pub enum $type:ident { $($value:ident = $name:literal: $sentence:literal,)* }) => {
        trilink_base::named! { $(#[$meta])* pub enum $type { $($value = $name,)* } }

        impl Reason for $type {
            fn sentence(self) -> &'static str {
                match self { $(Self::$value => $sentence,)* }
            }
        }
    };
}

/// Reason why a result has no confidence limits, with its subjects, such as the metrics concerned.
pub type NoInterval = Why<NoIntervalReason>;

reasons! {
    /// Reason why a fit, a prediction or an optimum has no confidence limits.
    pub enum NoIntervalReason {
        UnknownNoise = "unknown-noise": "there are no cycles, repeats or standard errors from which to estimate the noise of {of}",
        NotAskedFor = "not-asked-for": "neither replicates nor profiles were requested",
        Inadequate = "inadequate": "the model does not fit",
        UnknownVariation = "unknown-variation": "the residuals exceed the noise between cycles, and there are too few \
                                                 trials to estimate the variation between trials",
        FitFailed = "fit-failed": "the fit has failed",
        NothingFitted = "nothing-fitted": "no coefficient is fitted",
        NoReplicates = "no-replicates": "no replicates were requested",
        NoMotion = "no-motion": "no periodic motion was found for the model",
        ResampleSingular = "resample-singular": "the model fitted to a resample has no periodic solution at this \
                                                 frequency: the gait passes through a singular shape (det W_b = 0, \
                                                 eq. 4), where condition (5) of the paper fails",
        ResampleDiverged = "resample-diverged": "no periodic motion at this frequency was found for the model fitted \
                                                 to a resample",
        ResampleGaitUnknown = "resample-gait-unknown": "the motion at this frequency cannot be computed for the model \
                                                        fitted to a resample, because the offset, amplitude and phase \
                                                        of the commanded joints were not measured; set gait_input = \
                                                        \"commanded\" under [fit] to fit without them",
        OtherSettings = "other-settings": "the settings have changed since the fit; run `trilink fit` again",
        OtherTrials = "other-trials": "the trials have changed since the fit; run `trilink fit` again",
        ParameterSet = "parameter-set": "{of} was set by hand, so the uncertainty of the fit does not apply to it",
        NotFitted = "not-fitted": "the coefficients are not fitted",
        NoOptimum = "no-optimum": "no valid optimum was found",
        NotTheBest = "not-the-best": "confidence limits are computed for the best optimum only",
        Front = "front": "confidence limits are not computed for Pareto fronts",
    }
}

/// Reason why it is not known whether a model is adequate, with its subjects, such as the frequencies at which repeats
/// would settle the question.
pub type Undecided = Why<UndecidedReason>;

reasons! {
    /// Reason why it is not known whether a model is adequate.
    pub enum UndecidedReason {
        FewMeasurements = "few-measurements": "there are no more measurements than free parameters",
        Filtered = "filtered": "coordinates were filtered before the export in {of} (W026: export unfiltered \
                                coordinates), so the noise is unknown",
        UnknownNoise = "unknown-noise": "the noise is unknown",
        NoRepeats = "no-repeats": "the misfit exceeds the noise of the cycles, but the trials may differ from each \
                                   other by as much; repeated trials at {of} would show whether they do",
    }
}

reasons! {
    /// Reason why the repeatability or the reproducibility of a metric is not known.
    pub enum NoPrecisionReason {
        NotMeasured = "not-measured": "no trial has this metric",
        UnknownDay = "unknown-day": "the table of trials does not state the day of every trial",
        NoRepeats = "no-repeats": "no frequency was measured twice on one day",
        OneDay = "one-day": "all trials are of one day",
        NoCommonFrequency = "no-common-frequency": "no frequency was measured on two days",
    }
}

/// Reason why it was not tested whether campaigns share their coefficients, with its subjects, such as the campaign
/// concerned.
pub type NotTested = Why<NotTestedReason>;

reasons! {
    /// Reason why it was not tested whether campaigns share their coefficients.
    pub enum NotTestedReason {
        NoTrials = "no-trials": "campaign {of} has no trial with metrics",
        PartOfFree = "part-of-free": "a sum of coefficients is a free parameter in one campaign, and a term of this \
                                      sum is a free parameter in another: {of}",
        SumOfWheels = "sum-of-wheels": "{of} is the sum over the wheels of one robot, and the robots have different \
                                        wheels or loads: list the coefficients of the wheels ({of}0 and so on) in `free` instead",
        TooManyWheels = "too-many-wheels": "the robots together have more than 8 wheels, or more than 7 joints with \
                                            coefficients",
        NoWholeModel = "no-whole-model": "in one of the campaigns, no model yields a periodic motion for every trial",
        SharedFitFailed = "shared-fit-failed": "the shared fit has failed",
        FitFailed = "fit-failed": "the fit of campaign {of} has failed",
        OtherFree = "other-free": "campaign {of} does not have the same free parameters as the others",
        NothingLeft = "nothing-left": "the fits leave no residual degrees of freedom to estimate the noise",
        NotLowest = "not-lowest": "a fit to one campaign alone has not reached its lowest objective",
        FewBlocks = "few-blocks": "campaign {of} has too few blocks of frequencies",
        NoMotion = "no-motion": "no periodic motion was found for one of the trials in the shared fit",
        OtherDays = "other-days": "the coefficients differ, but so may the floors of the different days on which the \
                                   campaigns were recorded; record them on the same days or state fit.day_sd",
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::super::tests::stored;
    use super::*;

    fn check<R: Reason + fmt::Debug + PartialEq>(reasons: &[R]) {
        let of = vec!["d".to_owned(), "sigma0".to_owned()];
        let all = reasons.iter().map(|reason| Why { reason: *reason, of: of.clone() });
        let sentences: BTreeSet<String> = all.clone().map(|why| why.to_string()).collect();
        assert_eq!(sentences.len(), reasons.len());
        assert!(sentences.iter().all(|sentence| !sentence.contains('{')), "{sentences:?}");
        let table = stored(&all.map(Some).chain([None]).collect::<Vec<_>>());
        assert_eq!(table.frame.get_column_names(), ["of", "of_of"]);
    }

    #[test]
    fn every_reason_survives_a_round_trip_and_has_a_sentence() {
        check(&NoIntervalReason::ALL);
        check(&NotTestedReason::ALL);
        check(&UndecidedReason::ALL);
        let why = NoInterval::new(NoIntervalReason::ParameterSet, "d");
        let sentence = "d was set by hand, so the uncertainty of the fit does not apply to it";
        assert_eq!(why.to_string(), sentence);
    }
}
