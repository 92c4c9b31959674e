//! Parameters of a fitted model, with their confidence limits and remarks.

use serde::Serialize;
use trilink_base::numbers::place;
use trilink_robot::{Parameter, Per};
use trilink_tables::FitRow;
use trilink_tables::config::RobotConfig;

/// Mark for a parameter that is neither fitted nor measured.
pub(crate) const HELD: &str = "held";

/// Returns the label of a parameter, with the name of its wheel's link in place of the number; `links` are the names by
/// number.
pub(crate) fn label<N: AsRef<str>>(parameter: Parameter, links: &[N]) -> String {
    let definition = parameter.quantity().definition();
    let wheel = parameter.number().filter(|_| definition.per == Per::Wheel);
    match wheel.and_then(|wheel| links.get(wheel)) {
        Some(link) => format!("{}, {}", definition.label, link.as_ref()),
        None => parameter.label().to_owned(),
    }
}

/// Parameter value from a fit, with its uncertainty.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct FittedParameter {
    pub parameter: Parameter,
    pub label: String,
    pub unit: &'static str,
    /// Value of the parameter; NaN if the model does not have the parameter.
    pub value: f64,
    /// Whether the parameter is fitted; otherwise, it is fixed at the robot's value.
    pub free: bool,
    /// 95 % confidence limits; NaN where the interval is open or unknown.
    pub limits: [f64; 2],
    /// Standard uncertainties from the scatter of cycles and trials (Type A) and from errors that all trials share
    /// (Type B), and the combined standard uncertainty.
    pub type_a: f64,
    pub type_b: f64,
    pub combined: f64,
    /// Decimal place to which the value and its limits are rounded.
    pub place: i32,
    /// Effective degrees of freedom of the combined standard uncertainty.
    pub degrees_of_freedom: f64,
    /// Coverage factor of the confidence interval.
    pub coverage_factor: f64,
    /// Remarks on the value: whether it is `held` (fixed) or `measured` (in trials of other kinds) rather than fitted,
    /// whether it is not identifiable according to its profile, and whether it lies at a bound.
    pub marks: [Option<&'static str>; 3],
}

impl FittedParameter {
    /// Returns the parameter with the name of its wheel's link in the label; `links` are the names by number.
    pub(crate) fn of_links(self, links: &[String]) -> Self {
        Self { label: label(self.parameter, links), ..self }
    }

    /// Returns the parameter with its value and uncertainty divided by a ratio.
    pub(crate) fn over(self, ratio: f64) -> Self {
        let [value, type_a, type_b, combined] =
            [self.value, self.type_a, self.type_b, self.combined].map(|of| of / ratio);
        let limits = self.limits.map(|limit| limit / ratio);
        Self { value, limits, type_a, type_b, combined, ..self }
    }

    /// Returns the value, the uncertainty and the remarks for a parameter of a fit.
    pub(crate) fn new(fit: &FitRow, parameter: Parameter) -> Self {
        // The coefficients of the individual wheels are free if their sum is free.
        let sum = parameter.whole().filter(|sum| fit.free.contains(sum));
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
        let limits = [fit.lower, fit.upper].map(|limits| limits[fitted] * share);
        let combined = fit.type_a[fitted].hypot(fit.type_b[fitted]) * share;
        // Without standard uncertainties, half the interval takes their place.
        let half = 0.5 * (limits[1] - limits[0]);
        let uncertainty = if combined > 0.0 { combined } else { half };
        Self {
            parameter,
            label: label(parameter, &RobotConfig::THREE_LINKS),
            unit: parameter.unit(),
            value,
            free,
            limits,
            type_a: fit.type_a[fitted] * share,
            type_b: fit.type_b[fitted] * share,
            combined,
            place: place(uncertainty, value),
            degrees_of_freedom: fit.degrees_of_freedom[fitted],
            coverage_factor: fit.coverage_factor[fitted],
            marks: if value.is_finite() { marks } else { [None; 3] },
        }
    }
}
