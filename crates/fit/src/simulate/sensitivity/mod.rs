//! Sensitivities of the metrics to all quantities that influence them, and uncertainty budgets of the metrics.

mod budget;
mod derivative;
mod monte_carlo;
mod quantity;
#[cfg(test)]
mod tests;

use trilink_mechanics::{MotionError, Problem};
use trilink_tables::{SENSITIVE_METRICS, SensitivityRow};

use super::{Setup, answer};

pub(super) use budget::InputUncertainty;
use derivative::{COUNT, MotionDerivatives};
pub use monte_carlo::Draws;
pub(super) use monte_carlo::add_monte_carlo;
use quantity::Quantity;

/// Absolute value up to which a metric counts as zero, since it may be due to rounding errors.
const EPSILON: f64 = 1e-12;

/// Computes the sensitivities at one frequency: one row for each metric and quantity, grouped by metric, with the
/// quantities in the order of the robot's parameters.
///
/// # Errors
/// Returns an error if the model has no periodic solution at this frequency or for neighbouring values of a quantity,
/// or if the solution has no derivatives.
pub(super) fn sensitivities(
    setup: &Setup,
    omega_rad_s: f64,
    from_rest: bool,
    uncertainty: &InputUncertainty,
) -> Result<Vec<SensitivityRow>, MotionError> {
    let problem = setup.problem(omega_rad_s);
    let (solver, motion) = answer::solve_motion(&problem, from_rest)?;
    let motion = MotionDerivatives::new(&problem, solver, &motion)?;
    let quantities = with_sums(&problem, uncertainty);
    let derivatives =
        quantities.iter().map(|quantity| Ok((*quantity, motion.with_respect_to(*quantity)?)));
    let derivatives: Vec<_> = derivatives.collect::<Result<_, MotionError>>()?;
    let extrapolation = setup.extrapolation(&problem);
    let mut rows = Vec::with_capacity(COUNT * derivatives.len());
    for (index, metric) in SENSITIVE_METRICS.iter().enumerate() {
        let metric_value = motion.values[index];
        let budget = budget::Budget::new(uncertainty, &problem, &|quantity| {
            let known = derivatives.iter().find(|(known, _)| *known == quantity);
            known.map_or(0.0, |(_, (derivative, _))| derivative[index])
        });
        for (quantity, (derivative, error)) in &derivatives {
            let value = quantity.value(&problem);
            let scale = quantity.scale();
            let name = quantity.name();
            let contribution = budget.contribution(&name);
            let elasticity = if value != 0.0 && metric_value.abs() > EPSILON {
                derivative[index] * value / metric_value
            } else {
                f64::NAN
            };
            rows.push(SensitivityRow {
                model: setup.model,
                omega_rad_s,
                extrapolation: extrapolation.clone(),
                parameter: name,
                parameter_value: value * scale,
                metric: (*metric).to_owned(),
                metric_value,
                derivative: derivative[index] / scale,
                derivative_error: error[index] / scale,
                elasticity,
                standard_deviation: contribution.map_or(f64::NAN, |of| of.deviation * scale),
                known_from: contribution.map(|of| of.source),
                contribution: contribution.map_or(f64::NAN, |of| of.contribution),
                variance_part: contribution.map_or(f64::NAN, |of| of.variance_share),
                metric_deviation: budget.deviation,
                draws: None,
                unsolved_draws: None,
                draws_deviation: f64::NAN,
                draws_lower: f64::NAN,
                draws_upper: f64::NAN,
            });
        }
    }
    Ok(rows)
}

/// Returns all single quantities that can influence the metrics, followed by those sums of quantities (such as a total
/// over the wheels) that have a known uncertainty.
fn with_sums(problem: &Problem, uncertainty: &InputUncertainty) -> Vec<Quantity> {
    let mut all = Quantity::all(problem);
    for quantity in uncertainty.quantities() {
        if !all.contains(&quantity) {
            all.push(quantity);
        }
    }
    all
}
