//! `[compare]`: tolerances for the comparison of two runs.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Tolerances of `trilink compare`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Compare {
    /// Factor by which the run time of a stage must increase to be reported; it must also increase by more
    /// than `run_time_s`.
    pub run_time_ratio: f64,
    /// Time by which the run time of a stage must increase to be reported, s; it must also increase by more
    /// than the factor `run_time_ratio`.
    pub run_time_s: f64,
    /// Whether a longer run time counts as out of tolerance; otherwise it is only reported.
    pub run_time_fails: bool,
    /// Tolerances for the columns of `trials.parquet`.
    pub trials: Tolerances,
    /// Tolerances for each campaign's means over the trials that the baseline and the run compared with it have in
    /// common.
    pub campaigns: Tolerances,
    /// Tolerances for the columns of `fits.parquet`.
    pub fits: Tolerances,
    /// Tolerances for the columns of `predictions.parquet` at the trials' frequencies.
    pub predictions: Tolerances,
    /// Tolerances for the columns of `robot_parameters.parquet`.
    pub robot_parameters: Tolerances,
    /// Tolerances for the numbers in `scorecard.json`.
    pub scorecard: Tolerances,
}

/// Tolerances by column name, in which `*` stands for any number of characters.
pub type Tolerances = BTreeMap<String, Tolerance>;

/// Tolerance for a column. A difference is within tolerance if it is within at least one of the limits;
/// without limits it is not judged.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tolerance {
    /// Limit on the difference, in the unit of the column.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub absolute: Option<f64>,
    /// Limit on the difference as a fraction of the baseline's value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative: Option<f64>,
    /// Limit on the difference as a multiple of its standard error, which combines those of the two compared values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub standard_errors: Option<f64>,
    /// Whether only an increase can be out of tolerance, for quantities that should be low.
    #[serde(skip_serializing_if = "is_false")]
    pub rises_only: bool,
    /// Whether a value that is missing in exactly one of the two compared runs is not judged; otherwise, it counts as
    /// out of tolerance.
    #[serde(skip_serializing_if = "is_false")]
    pub may_be_missing: bool,
}

fn is_false(value: &bool) -> bool {
    !value
}

impl Tolerance {
    /// Returns whether any limit is set.
    pub fn judges(&self) -> bool {
        self.absolute.or(self.relative).or(self.standard_errors).is_some()
    }

    /// Returns the difference to compare with the limits: the absolute difference between `baseline` and `value` or, if
    /// only an increase counts, the increase from `baseline` to `value` (0 for a decrease).
    pub fn distance(&self, [baseline, value]: [f64; 2]) -> f64 {
        let rise = value - baseline;
        if self.rises_only { rise.max(0.0) } else { rise.abs() }
    }
}

impl Compare {
    /// Returns the names of the tables with the tolerances for their columns.
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

/// Returns the tolerance for a column, which is that of the longest matching name; `None` if no name matches.
pub fn tolerance(tolerances: &Tolerances, column: &str) -> Option<Tolerance> {
    let matching = tolerances.iter().filter(|(name, _)| {
        // No column has a `?` in its name.
        trilink_base::pattern::matches(name, column, ['*', '?'])
    });
    matching.max_by_key(|(name, _)| name.len()).map(|(_, tolerance)| *tolerance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    #[test]
    fn a_column_has_the_tolerance_of_the_longest_matching_name() {
        let all = Config::default().compare;
        let skid = tolerance(&all.fits, "skid0_kg_s").unwrap();
        assert_eq!(skid.standard_errors, Some(6.0));
        assert_eq!(tolerance(&all.fits, "solves"), None);
        assert!(tolerance(&all.trials, "sigma0_debiased").unwrap().may_be_missing);
        assert!(!tolerance(&all.trials, "sigma0").unwrap().may_be_missing);
    }

    #[test]
    fn configured_tolerances_are_added_to_the_defaults() {
        let text = "[compare.trials]\nd_m = { absolute = 0.01 }\n";
        let compare = Config::parse(text).unwrap().compare;
        let absolute = Tolerance { absolute: Some(0.01), ..Tolerance::default() };
        assert_eq!(compare.trials["d_m"], absolute);
        assert_eq!(compare.trials["v_m_s"].standard_errors, Some(6.0));
        assert_eq!(compare.fits, Config::default().compare.fits);
    }
}
