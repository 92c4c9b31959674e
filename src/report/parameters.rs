//! The parameters of a fitted model and how each came about.

use super::numbers::{as_configured, significant};
use crate::robot::Parameter;
use crate::store::FitRow;

/// One parameter of one fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedParameter {
    pub parameter: Parameter,
    /// NaN if the model does not have it.
    pub value: f64,
    /// Fitted; otherwise held at the robot's value.
    pub free: bool,
    /// What its profile does not tell: `practically not` or `structurally not` identifiable.
    pub unidentifiable: Option<&'static str>,
    /// 95 % confidence limits; NaN where the interval is open or unknown.
    pub limits: [f64; 2],
    pub at_bound: bool,
    /// Given by trials of other kinds.
    pub measured: bool,
}

impl FittedParameter {
    /// What a fit says of a parameter.
    pub fn of(fit: &FitRow, parameter: Parameter) -> Self {
        let sum = Parameter::RollSum;
        // The three roll coefficients are as free as their sum.
        let is_part = parameter != sum && parameter.is_part_of(sum);
        let by_sum = is_part && !fit.free.contains(&parameter) && fit.free.contains(&sum);
        let told = if by_sum { sum } else { parameter };
        let value = fit.parameters[parameter];
        let share = if by_sum { value / fit.parameters[sum] } else { 1.0 };
        let unidentifiable = match () {
            () if fit.structurally_not.contains(&told) => Some(STRUCTURALLY_NOT),
            () if fit.practically_not.contains(&told) => Some(PRACTICALLY_NOT),
            () => None,
        };
        Self {
            parameter,
            value,
            free: fit.free.contains(&told),
            measured: fit.measured.iter().any(|measured| parameter.is_part_of(*measured)),
            unidentifiable,
            limits: [fit.lower, fit.upper].map(|limits| limits[told] * share),
            at_bound: fit.at_bound.contains(&told),
        }
    }

    /// The value: fitted ones to four digits, held ones as they were configured.
    pub fn text(&self) -> String {
        match self.free {
            true => significant(self.value, 4),
            false => as_configured(self.value),
        }
    }

    /// What a reader has to know before trusting the value: `held`, `measured`, `not
    /// identifiable`, `at bound` and the like.
    pub fn marks(&self) -> Vec<&'static str> {
        if !self.value.is_finite() {
            return Vec::new();
        }
        let held = match (self.free, self.measured) {
            (true, _) => None,
            (false, true) => Some("measured"),
            (false, false) => Some("held"),
        };
        let at_bound = self.at_bound.then_some("at bound");
        [held, self.unidentifiable, at_bound].into_iter().flatten().collect()
    }

    /// The confidence interval; empty for parameters that were not fitted, `∞` or `0` where it is
    /// open.
    pub fn interval(&self) -> String {
        let [low, high] = self.limits;
        if !self.free || !(low.is_finite() || high.is_finite()) {
            return String::new();
        }
        let text = |limit: f64, open: &str| match limit.is_finite() {
            true => significant(limit, 3),
            false => open.to_owned(),
        };
        format!("{} to {}", text(low, "0"), text(high, "∞"))
    }
}

/// Names that [`FittedParameter::marks`] gives to parameters that the data do not tell.
pub const PRACTICALLY_NOT: &str = "practically not identifiable";
pub const STRUCTURALLY_NOT: &str = "not identifiable";
