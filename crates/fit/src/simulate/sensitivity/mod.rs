//! How a motion's metrics answer to every number that they depend on, and what the uncertainty of each
//! contributes to theirs.

mod budget;
mod derivative;
mod quantity;
#[cfg(test)]
mod tests;

use trilink_mechanics::{MotionError, Problem};
use trilink_tables::{SENSITIVE_METRICS, SensitivityRow};

use super::{Setup, answer};

pub(super) use budget::Uncertain;
use derivative::{COUNT, Differentiated};
use quantity::Quantity;

/// A number that is zero but for rounding, as a part of what it is made of.
const NOTHING: f64 = 1e-12;

/// The rows of a problem's motion: metric by metric, the parameters in the order of the robot.
///
/// # Errors
/// There is no such motion, or none nearby, or it has no derivatives.
pub(super) fn of(
    setup: &Setup,
    omega_rad_s: f64,
    from_rest: bool,
    uncertain: &Uncertain,
) -> Result<Vec<SensitivityRow>, MotionError> {
    let problem = setup.problem(omega_rad_s);
    let (solver, motion) = answer::solved(&problem, from_rest)?;
    let differentiated = Differentiated::new(&problem, solver, &motion)?;
    let quantities = with_sums(&problem, uncertain);
    let derivatives = quantities.iter().map(|of| Ok((*of, differentiated.by(*of)?)));
    let derivatives: Vec<_> = derivatives.collect::<Result<_, MotionError>>()?;
    let extrapolation = setup.extrapolation(&problem);
    let mut rows = Vec::with_capacity(COUNT * derivatives.len());
    for (nth, metric) in SENSITIVE_METRICS.iter().enumerate() {
        let metric_value = differentiated.values[nth];
        let by = |quantity: Quantity| {
            let found = derivatives.iter().find(|(of, _)| *of == quantity);
            found.map_or(0.0, |(_, (derivative, _))| derivative[nth])
        };
        let budget = budget::Budget::new(uncertain, &problem, &by);
        for (quantity, (derivative, error)) in &derivatives {
            let (value, scale) = (quantity.of(&problem), quantity.scale());
            let name = quantity.name();
            let part = budget.part(&name);
            let elasticity = match value != 0.0 && metric_value.abs() > NOTHING {
                true => derivative[nth] * value / metric_value,
                false => f64::NAN,
            };
            rows.push(SensitivityRow {
                model: setup.model,
                omega_rad_s,
                extrapolation: extrapolation.clone(),
                parameter: name,
                parameter_value: value * scale,
                metric: (*metric).to_owned(),
                metric_value,
                derivative: derivative[nth] / scale,
                derivative_error: error[nth] / scale,
                elasticity,
                standard_deviation: part.map_or(f64::NAN, |part| part.deviation * scale),
                known_from: part.map(|part| part.source),
                contribution: part.map_or(f64::NAN, |part| part.contribution),
                variance_part: part.map_or(f64::NAN, |part| part.variance_part),
                metric_deviation: budget.deviation,
            });
        }
    }
    Ok(rows)
}

/// All quantities, and the sums that something is known of.
fn with_sums(problem: &Problem, uncertain: &Uncertain) -> Vec<Quantity> {
    let mut all = Quantity::all(problem);
    for quantity in uncertain.quantities() {
        if !all.contains(&quantity) {
            all.push(quantity);
        }
    }
    all
}
