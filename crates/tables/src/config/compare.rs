//! `[compare]`: which differences between two runs are to be expected.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// What a comparison takes for the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Compare {
    /// A stage that takes longer by this factor, and by more than `run_time_s`, is named.
    pub run_time_ratio: f64,
    pub run_time_s: f64,
    /// Whether a longer run is out of tolerance; otherwise it is only named.
    pub run_time_fails: bool,
    /// By column of `trials.parquet`.
    pub trials: Tolerances,
    /// By column of the means over each campaign's trials that both runs have.
    pub campaigns: Tolerances,
    /// By column of `fits.parquet`.
    pub fits: Tolerances,
    /// By column of `predictions.parquet`, at the trials' frequencies.
    pub predictions: Tolerances,
    /// By column of `robot_parameters.parquet`.
    pub robot_parameters: Tolerances,
    /// By number of `scorecard.json`.
    pub scorecard: Tolerances,
}

/// Tolerances by the name of a column, in which `*` stands for any characters.
pub type Tolerances = BTreeMap<String, Tolerance>;

/// A difference is within if it is within one of these; without any it is not judged.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tolerance {
    /// In the column's unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub absolute: Option<f64>,
    /// To the baseline's value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative: Option<f64>,
    /// To the standard errors of both runs together.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub standard_errors: Option<f64>,
    /// Whether only a rise is out of tolerance: of what is better the lower it is.
    #[serde(skip_serializing_if = "is_false")]
    pub rises_only: bool,
    /// Whether a value may be there in one run and missing in the other.
    #[serde(skip_serializing_if = "is_false")]
    pub may_be_missing: bool,
}

fn is_false(value: &bool) -> bool {
    !value
}

impl Tolerance {
    /// Whether it says anything.
    pub fn judges(&self) -> bool {
        self.absolute.or(self.relative).or(self.standard_errors).is_some()
    }

    /// How far a value is from a baseline's to a side that is judged.
    pub fn distance(&self, [baseline, value]: [f64; 2]) -> f64 {
        let rise = value - baseline;
        if self.rises_only { rise.max(0.0) } else { rise.abs() }
    }
}

impl Compare {
    /// The tables with their tolerances.
    pub fn tables(&self) -> [(&'static str, &Tolerances); 6] {
        [
            ("trials", &self.trials),
            ("campaigns", &self.campaigns),
            ("fits", &self.fits),
            ("predictions", &self.predictions),
            ("robot_parameters", &self.robot_parameters),
            ("scorecard", &self.scorecard),
        ]
    }
}

/// The tolerance of a column: that of the longest name that fits it.
pub fn tolerance(tolerances: &Tolerances, column: &str) -> Option<Tolerance> {
    let fitting = tolerances.iter().filter(|(name, _)| {
        // `?` is no letter of a column.
        trilink_base::pattern::matches(name, column, ['*', '?'])
    });
    fitting.max_by_key(|(name, _)| name.len()).map(|(_, tolerance)| *tolerance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    #[test]
    fn a_column_has_the_tolerance_of_the_longest_name_that_fits() {
        let all = Config::default().compare;
        let of = |column: &str| tolerance(&all.fits, column);
        assert_eq!(of("skid0_kg_s").and_then(|found| found.standard_errors), Some(6.0));
        assert_eq!(of("solves"), None);
        assert!(tolerance(&all.trials, "sigma0_debiased").unwrap().may_be_missing);
        assert!(!tolerance(&all.trials, "sigma0").unwrap().may_be_missing);
    }

    #[test]
    fn tolerances_that_are_named_stand_beside_the_others() {
        let text = "[compare.trials]\nd_m = { absolute = 0.01 }\n";
        let compare = Config::parse(text).unwrap().compare;
        let absolute = Tolerance { absolute: Some(0.01), ..Tolerance::default() };
        assert_eq!(compare.trials["d_m"], absolute);
        assert_eq!(compare.trials["v_m_s"].standard_errors, Some(6.0));
        assert_eq!(compare.fits, Config::default().compare.fits);
    }
}
