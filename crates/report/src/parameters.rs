//! The parameters of a fitted model and how each came about.

use serde::Serialize;
use trilink_robot::Parameter;
use trilink_tables::FitRow;

/// The mark of a parameter that is neither fitted nor measured.
pub(crate) const HELD: &str = "held";

/// One parameter of one fit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct FittedParameter {
    pub parameter: Parameter,
    /// NaN if the model does not have it.
    pub value: f64,
    /// Fitted; otherwise held at the robot's value.
    pub free: bool,
    /// 95 % confidence limits; NaN where the interval is open or unknown.
    pub limits: [f64; 2],
    /// Half the widths that they have by scatter and by what all trials share.
    pub scatter: f64,
    pub systematic: f64,
    /// What a reader has to know before trusting the value: `held` or `measured` (by trials of
    /// other kinds) instead of fitted, not identifiable by its profile, at a bound.
    pub marks: [Option<&'static str>; 3],
}

impl FittedParameter {
    /// What a fit says of a parameter.
    pub(crate) fn of(fit: &FitRow, parameter: Parameter) -> Self {
        // The coefficients of three wheels are as free as their sum.
        let sum = parameter.sum().filter(|sum| fit.free.contains(sum));
        let fitted = sum.filter(|_| !fit.free.contains(&parameter)).unwrap_or(parameter);
        let value = fit.parameters[parameter];
        let share = if fitted == parameter { 1.0 } else { value / fit.parameters[fitted] };
        let free = fit.free.contains(&fitted);
        let is_measured = fit.measured.iter().any(|measured| parameter.is_part_of(*measured));
        let held = if is_measured { "measured" } else { HELD };
        let unidentifiable = if fit.structurally_not.contains(&fitted) {
            Some("not identifiable")
        } else {
            fit.practically_not.contains(&fitted).then_some("practically not identifiable")
        };
        let at_bound = fit.at_bound.contains(&fitted).then_some("at bound");
        let marks = [(!free).then_some(held), unidentifiable, at_bound];
        Self {
            parameter,
            value,
            free,
            limits: [fit.lower, fit.upper].map(|limits| limits[fitted] * share),
            scatter: fit.scatter[fitted] * share,
            systematic: fit.systematic[fitted] * share,
            marks: if value.is_finite() { marks } else { [None; 3] },
        }
    }
}
