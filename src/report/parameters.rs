//! The parameters of a fitted model and how each came about.

use super::numbers::{as_configured, significant};
use crate::robot;
use crate::store::FitRow;

/// One parameter of one fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    pub name: &'static str,
    /// In the unit of the name; NaN if the model does not have it.
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

impl Parameter {
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

/// Names that [`Parameter::marks`] gives to parameters that the data do not tell.
pub const PRACTICALLY_NOT: &str = "practically not identifiable";
pub const STRUCTURALLY_NOT: &str = "not identifiable";

/// Place of the sum of the roll coefficients, which the three are free by.
const ROLL_SUM: usize = 6;

/// All parameters of a fit in the order of [`robot::Parameter::ALL`].
pub fn of_fit(fit: &FitRow) -> [Parameter; 9] {
    let (values, lower, upper) = (fit.parameters(), fit.lower_limits(), fit.upper_limits());
    let lists = |names: &[String], place: usize| {
        names.iter().any(|name| name == robot::Parameter::ALL[place].column())
    };
    std::array::from_fn(|i| {
        // The three roll coefficients are as free as their sum.
        let is_roll = (3..ROLL_SUM).contains(&i);
        let by_sum = is_roll && !lists(&fit.free, i) && lists(&fit.free, ROLL_SUM);
        let place = if by_sum { ROLL_SUM } else { i };
        let share = if by_sum { values[i] / values[ROLL_SUM] } else { 1.0 };
        let unidentifiable = match () {
            () if lists(&fit.structurally_not, place) => Some(STRUCTURALLY_NOT),
            () if lists(&fit.practically_not, place) => Some(PRACTICALLY_NOT),
            () => None,
        };
        let measured = lists(&fit.measured, i) || is_roll && lists(&fit.measured, ROLL_SUM);
        Parameter {
            name: robot::Parameter::ALL[i].column(),
            value: values[i],
            free: lists(&fit.free, place),
            measured,
            unidentifiable,
            limits: [lower[place] * share, upper[place] * share],
            at_bound: lists(&fit.at_bound, place),
        }
    })
}
