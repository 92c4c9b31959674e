//! `[compare]`: which differences between two runs are to be expected.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize};

/// What a comparison takes for the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Compare {
    /// A stage that takes longer by this factor, and by more than `run_time_s`, is named.
    pub run_time_ratio: f64,
    pub run_time_s: f64,
    /// Whether a longer run is out of tolerance; otherwise it is only named.
    pub run_time_fails: bool,
    /// By column of `trials.parquet`.
    #[serde(deserialize_with = "over_trials")]
    pub trials: Tolerances,
    /// By column of the means over each campaign's trials that both runs have.
    #[serde(deserialize_with = "over_campaigns")]
    pub campaigns: Tolerances,
    /// By column of `fits.parquet`.
    #[serde(deserialize_with = "over_fits")]
    pub fits: Tolerances,
    /// By column of `predictions.parquet`, at the trials' frequencies.
    #[serde(deserialize_with = "over_predictions")]
    pub predictions: Tolerances,
    /// By column of `robot_parameters.parquet`.
    #[serde(deserialize_with = "over_robot_parameters")]
    pub robot_parameters: Tolerances,
    /// By number of `scorecard.json`.
    #[serde(deserialize_with = "over_scorecard")]
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

    const fn absolute(absolute: f64) -> Self {
        Self { absolute: Some(absolute), ..Self::NONE }
    }

    const fn relative(relative: f64, absolute: f64) -> Self {
        Self { relative: Some(relative), absolute: Some(absolute), ..Self::NONE }
    }

    const fn errors(errors: f64) -> Self {
        Self { standard_errors: Some(errors), relative: Some(LIBM), ..Self::NONE }
    }

    const fn or_missing(self) -> Self {
        Self { may_be_missing: true, ..self }
    }

    const NONE: Self =
        Self { absolute: None, relative: None, standard_errors: None, may_be_missing: false };
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

/// What another processor or library of elementary functions may make of the same numbers.
const LIBM: f64 = 1e-6;
/// Hundreds of values are compared: of an honest standard error's multiples this one is met by
/// chance in one night of a million.
const ERRORS: f64 = 6.0;

/// The markers' noise and the links' vibration are in raw skid ratios of a trial, by more or less
/// than in the next; that hardly shows in how its cycles differ.
const RAW_SIGMA: f64 = 0.001;

impl Default for Compare {
    fn default() -> Self {
        Self {
            run_time_ratio: 1.5,
            run_time_s: 5.0,
            run_time_fails: false,
            trials: trials(),
            campaigns: campaigns(),
            fits: fits(),
            predictions: predictions(),
            robot_parameters: robot_parameters(),
            scorecard: table(&[("computed", Tolerance::relative(LIBM, 1e-9))]),
        }
    }
}

fn table(entries: &[(&str, Tolerance)]) -> Tolerances {
    entries.iter().map(|(name, tolerance)| ((*name).to_owned(), *tolerance)).collect()
}

fn trials() -> Tolerances {
    let mut all = campaigns();
    all.extend(table(&[
        ("sigma*", Tolerance { absolute: Some(RAW_SIGMA), ..Tolerance::errors(ERRORS) }),
        ("omega_commanded_rad_s", Tolerance::absolute(1e-9)),
        ("coverage", Tolerance::absolute(0.1)),
        ("residual_mm", Tolerance::relative(0.2, 0.02)),
        ("phi*", Tolerance::absolute(0.005)),
    ]));
    all
}

fn campaigns() -> Tolerances {
    table(&[
        ("omega_rad_s", Tolerance::errors(ERRORS)),
        ("d_m", Tolerance::errors(ERRORS)),
        ("v_m_s", Tolerance::errors(ERRORS)),
        ("sigma*", Tolerance { absolute: Some(RAW_SIGMA / 10.0), ..Tolerance::errors(ERRORS) }),
        ("sigma*_debiased", Tolerance::errors(ERRORS).or_missing()),
        ("alpha1_rad", Tolerance::errors(ERRORS)),
        ("dtheta_rad", Tolerance::errors(ERRORS)),
    ])
}

fn fits() -> Tolerances {
    table(&[
        ("skid*", Tolerance::errors(ERRORS)),
        ("roll*", Tolerance::errors(ERRORS)),
        ("stiffness*", Tolerance::errors(ERRORS)),
        ("damping*", Tolerance::errors(ERRORS)),
        ("interval_*", Tolerance { relative: Some(3.0), ..Tolerance::NONE }.or_missing()),
        ("j", Tolerance::relative(0.15, 0.005)),
    ])
}

fn predictions() -> Tolerances {
    table(&[
        ("d_m", Tolerance::relative(0.02, 0.001)),
        ("v_m_s", Tolerance::relative(0.02, 0.001)),
        ("sigma*", Tolerance::relative(0.03, 0.002)),
        ("alpha1_rad", Tolerance::relative(0.02, 0.002)),
        ("dtheta_rad", Tolerance::absolute(0.01)),
    ])
}

fn robot_parameters() -> Tolerances {
    table(&[
        ("natural_rad_s", Tolerance::errors(ERRORS)),
        ("damping*", Tolerance::errors(ERRORS)),
        ("stiffness*", Tolerance::errors(ERRORS)),
        ("roll_sum_kg_s", Tolerance::errors(ERRORS)),
        ("*_configured_*", Tolerance::relative(LIBM, 1e-12)),
    ])
}

/// What is named stands beside what is not.
macro_rules! over {
    ($($name:ident $defaults:ident),+) => {$(
        fn $name<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Tolerances, D::Error> {
            let mut all = Compare::default().$defaults;
            all.extend(Tolerances::deserialize(deserializer)?);
            Ok(all)
        }
    )+};
}

over!(
    over_trials trials,
    over_campaigns campaigns,
    over_fits fits,
    over_predictions predictions,
    over_robot_parameters robot_parameters,
    over_scorecard scorecard
);

/// The tolerance of a column: that of the longest name that fits it.
pub fn tolerance(tolerances: &Tolerances, column: &str) -> Option<Tolerance> {
    let fitting = tolerances.iter().filter(|(name, _)| {
        // `?` is no letter of a column.
        crate::pattern::matches(name, column, ['*', '?'])
    });
    fitting.max_by_key(|(name, _)| name.len()).map(|(_, tolerance)| *tolerance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_has_the_tolerance_of_the_longest_name_that_fits() {
        let all = Compare::default();
        let of = |column: &str| tolerance(&all.fits, column);
        assert_eq!(of("skid0_kg_s"), Some(Tolerance::errors(ERRORS)));
        assert_eq!(of("solves"), None);
        assert!(tolerance(&all.trials, "sigma0_debiased").unwrap().may_be_missing);
        assert!(!tolerance(&all.trials, "sigma0").unwrap().may_be_missing);
    }

    #[test]
    fn tolerances_that_are_named_stand_beside_the_others() {
        let text = "[trials]\nd_m = { absolute = 0.01 }\n";
        let compare: Compare = toml::from_str(text).unwrap();
        assert_eq!(compare.trials["d_m"], Tolerance::absolute(0.01));
        assert_eq!(compare.trials["v_m_s"], Tolerance::errors(ERRORS));
        assert_eq!(compare.fits, Compare::default().fits);
    }
}
