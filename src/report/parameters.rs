//! The parameters of a fitted model and how each came about.

use super::numbers::{as_configured, significant};
use crate::store::FitRow;

/// Columns of `fits.parquet` that are parameters.
pub const NAMES: [&str; 8] = [
    "skid0_kg_s",
    "skid1_kg_s",
    "skid2_kg_s",
    "roll0_kg_s",
    "roll1_kg_s",
    "roll2_kg_s",
    "stiffness_nm_rad",
    "damping_nm_s_rad",
];

/// One parameter of one fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    pub name: &'static str,
    /// In the unit of the name; NaN if the model does not have it.
    pub value: f64,
    /// Fitted; otherwise held at the robot's value.
    pub free: bool,
    /// Hardly moves the objective.
    pub insensitive: bool,
    pub at_bound: bool,
}

impl Parameter {
    /// The value: fitted ones to four digits, held ones as they were configured.
    pub fn text(&self) -> String {
        match self.free {
            true => significant(self.value, 4),
            false => as_configured(self.value),
        }
    }

    /// What a reader has to know before trusting the value: `held`, `insensitive`, `at bound`.
    pub fn marks(&self) -> Vec<&'static str> {
        if !self.value.is_finite() {
            return Vec::new();
        }
        let marks =
            [(!self.free, "held"), (self.insensitive, "insensitive"), (self.at_bound, "at bound")];
        marks.into_iter().filter_map(|(is_so, mark)| is_so.then_some(mark)).collect()
    }
}

/// All parameters of a fit in the order of [`NAMES`].
pub fn of_fit(fit: &FitRow) -> [Parameter; 8] {
    let values = [
        fit.skid0_kg_s,
        fit.skid1_kg_s,
        fit.skid2_kg_s,
        fit.roll0_kg_s,
        fit.roll1_kg_s,
        fit.roll2_kg_s,
        fit.stiffness_nm_rad,
        fit.damping_nm_s_rad,
    ];
    std::array::from_fn(|i| {
        let name = NAMES[i];
        let lists = |names: &[String]| names.iter().any(|listed| listed == name);
        Parameter {
            name,
            value: values[i],
            free: lists(&fit.free),
            insensitive: lists(&fit.insensitive),
            at_bound: lists(&fit.at_bound),
        }
    })
}
