//! Why something is not there.

use std::fmt::{self, Display, Formatter};

use serde::{Serialize, Serializer};

use crate::{Column, Columns, NamedCell, StoreError, Table, fill};

/// A reason that tables have by its name.
pub trait Reason: NamedCell + Copy {
    /// What people read, with `{of}` in the place of what it is about.
    fn sentence(self) -> &'static str;
}

/// Why something is not there.
#[derive(Debug, Clone, PartialEq)]
pub struct Why<R> {
    pub reason: R,
    /// What it is about, such as metrics or a campaign.
    pub of: Vec<String>,
}

impl<R> Why<R> {
    /// For a reason that is about one thing.
    pub fn of(reason: R, one: &str) -> Self {
        Self { reason, of: vec![one.to_owned()] }
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

/// Defines reasons by their names and sentences.
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

/// Why there are no confidence limits.
pub type NoInterval = Why<NoIntervalReason>;

reasons! {
    /// What keeps a fit, a prediction or an optimum from having confidence limits.
    pub enum NoIntervalReason {
        UnknownNoise = "unknown-noise": "no cycles, repeats or standard errors tell the noise of {of}",
        NotAskedFor = "not-asked-for": "neither replicates nor profiles were asked for",
        Inadequate = "inadequate": "the model does not fit",
        FitFailed = "fit-failed": "the fit has failed",
        NothingFitted = "nothing-fitted": "no coefficient is fitted",
        NoReplicates = "no-replicates": "no replicates were asked for",
        NoMotion = "no-motion": "there is no motion",
        ResampleSingular = "resample-singular": "the fit to a resample has no motion at this frequency: the gait crosses det W_b = 0 without meeting condition (5)",
        ResampleDiverged = "resample-diverged": "the fit to a resample has no motion at this frequency: no periodic motion was found",
        ResampleGaitUnknown = "resample-gait-unknown": "the fit to a resample has no motion at this frequency: the offset, amplitude and phase of the commanded joints were not measured; gait_input = \"commanded\" under [fit] does without",
        OtherSettings = "other-settings": "the settings are not those of the fit; `trilink fit` fits anew",
        OtherTrials = "other-trials": "the trials are not those of the fit; `trilink fit` fits anew",
        ParameterSet = "parameter-set": "{of} was set by hand: the uncertainty of the fit does not apply",
        NotFitted = "not-fitted": "the coefficients are not fitted",
        NoOptimum = "no-optimum": "no valid optimum was found",
        NotTheBest = "not-the-best": "computed for the best optimum only",
        Front = "front": "not computed for Pareto fronts",
    }
}

/// Why sharing is neither kept nor refused.
pub type NotTested = Why<NotTestedReason>;

reasons! {
    /// What keeps anybody from knowing whether campaigns share their coefficients.
    pub enum NotTestedReason {
        NoTrials = "no-trials": "campaign {of} has no trial with metrics",
        PartOfFree = "part-of-free": "one campaign leaves a sum free, and another a part of it: {of}",
        NoWholeModel = "no-whole-model": "in one of the campaigns no model has a motion for every trial",
        SharedFitFailed = "shared-fit-failed": "the shared fit has failed",
        FitFailed = "fit-failed": "the fit of campaign {of} has failed",
        OtherFree = "other-free": "campaign {of} does not leave free what the others do",
        NothingLeft = "nothing-left": "the fits leave nothing that would tell the noise",
        NotLowest = "not-lowest": "a separate fit has not converged to its lowest objective",
        FewBlocks = "few-blocks": "campaign {of} has too few blocks of frequencies",
        NoMotion = "no-motion": "a motion of the shared fit does not exist",
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
        let said: BTreeSet<String> = all.clone().map(|why| why.to_string()).collect();
        assert_eq!(said.len(), reasons.len());
        assert!(said.iter().all(|said| !said.contains('{')), "{said:?}");
        let table = stored(&all.map(Some).chain([None]).collect::<Vec<_>>());
        assert_eq!(table.frame.get_column_names(), ["of", "of_of"]);
    }

    #[test]
    fn every_reason_is_read_as_it_was_written_and_said_in_a_sentence() {
        check(&NoIntervalReason::ALL);
        check(&NotTestedReason::ALL);
        let why = NoInterval::of(NoIntervalReason::UnknownNoise, "d");
        assert_eq!(why.to_string(), "no cycles, repeats or standard errors tell the noise of d");
    }
}
