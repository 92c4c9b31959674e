//! Sensitivities of the metrics to all quantities that influence them, and uncertainty budgets of the metrics.

mod budget;
mod derivative;
mod monte_carlo;
mod quantity;
#[cfg(test)]
mod tests;

use trilink_mechanics::{AnyProblem, ChainProblem, FIT_ACCURACY, MotionError, Problem, Solver};
use trilink_mechanics::{ChainMotion, ChainSlopes, REFERENCE_ACCURACY};
use trilink_robot::{ChainNumber, Model};
use trilink_tables::{Extrapolation, SENSITIVE_METRICS, SensitivityRow};

use super::{ChainSetup, Setup, answer};

pub(super) use budget::InputUncertainty;
use derivative::{MotionDerivatives, by_metric};
pub use monte_carlo::Draws;
pub(super) use monte_carlo::add_monte_carlo;
use quantity::Quantity;

/// Absolute value up to which a metric counts as zero, since it may be due to rounding errors.
const EPSILON: f64 = 1e-12;

/// Derivatives of the metrics of one motion with respect to a quantity, in SI units, and their estimated errors.
struct Derivative {
    quantity: Quantity,
    values: Vec<f64>,
    errors: Vec<f64>,
}

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
    let extrapolation = setup.extrapolation(&problem);
    let any = AnyProblem::from(problem.clone());
    let derivatives = with_sums(&problem, &any, uncertainty).into_iter().map(|quantity| {
        let (values, errors) = motion.with_respect_to(quantity)?;
        Ok(Derivative { quantity, values: values.to_vec(), errors: errors.to_vec() })
    });
    let derivatives: Vec<Derivative> = derivatives.collect::<Result<_, MotionError>>()?;
    let metrics: Vec<(String, f64)> =
        SENSITIVE_METRICS.map(str::to_owned).into_iter().zip(motion.values).collect();
    Ok(rows((setup.model, &any, &extrapolation), &metrics, &derivatives, uncertainty))
}

/// Computes the sensitivities of a chain's motion as [`sensitivities`] does, to all numbers of the chain on which the
/// motion depends and to the uncertain sums of its coefficients.
///
/// # Errors
/// Returns an error if the model has no periodic solution at this frequency.
pub(super) fn sensitivities_of_chain(
    setup: &ChainSetup,
    omega_rad_s: f64,
    uncertainty: &InputUncertainty,
) -> Result<Vec<SensitivityRow>, MotionError> {
    let any = AnyProblem::from(setup.problem(omega_rad_s));
    let numbers = setup.chain.numbers();
    let (ChainMotion { metrics, work_j, .. }, slopes) =
        setup.problem(omega_rad_s).derivatives(REFERENCE_ACCURACY, &numbers)?;
    let values = |slopes: &ChainSlopes| -> Vec<f64> {
        let slopes = setup.metrics(&slopes.metrics, slopes.work_j).into_iter();
        slopes.map(|(_, slope)| slope).collect()
    };
    let slopes: Vec<(ChainNumber, Vec<f64>)> =
        numbers.into_iter().zip(slopes.iter().map(values)).collect();
    let metrics = setup.metrics(&metrics, work_j);
    let exact = || vec![f64::NAN; metrics.len()];
    let mut derivatives: Vec<Derivative> = slopes
        .iter()
        .filter(|(_, values)| values.iter().any(|slope| *slope != 0.0))
        .map(|(number, values)| Derivative {
            quantity: Quantity::Number(*number),
            values: values.clone(),
            errors: exact(),
        })
        .collect();
    for quantity in uncertainty.quantities(&any.robot) {
        let Quantity::Robot(sum) = quantity else { continue };
        let mut values = vec![0.0; metrics.len()];
        for (number, share) in setup.chain.shares_of(sum) {
            let own = slopes.iter().find(|(known, _)| *known == number);
            let own = own.map_or(&[][..], |(_, own)| own);
            values.iter_mut().zip(own).for_each(|(value, slope)| *value += share * slope);
        }
        derivatives.push(Derivative { quantity, values, errors: exact() });
    }
    let extrapolation = setup.extrapolation(&any);
    Ok(rows((setup.model, &any, &extrapolation), &metrics, &derivatives, uncertainty))
}

/// Returns a row for each metric and quantity, given the values of the metrics and their derivatives.
fn rows(
    (model, problem, extrapolation): (Model, &AnyProblem, &Extrapolation),
    metrics: &[(String, f64)],
    derivatives: &[Derivative],
    uncertainty: &InputUncertainty,
) -> Vec<SensitivityRow> {
    let mut rows = Vec::with_capacity(metrics.len() * derivatives.len());
    for (index, (metric, metric_value)) in metrics.iter().enumerate() {
        let metric_value = *metric_value;
        let budget = budget::Budget::new(uncertainty, problem, &|quantity| {
            let known = derivatives.iter().find(|known| known.quantity == quantity);
            known.map_or(0.0, |known| known.values[index])
        });
        for Derivative { quantity, values, errors } in derivatives {
            let value = quantity.value(problem);
            let scale = quantity.scale();
            let name = quantity.name(&problem.robot);
            let contribution = budget.contribution(&name);
            let elasticity = if value != 0.0 && metric_value.abs() > EPSILON {
                values[index] * value / metric_value
            } else {
                f64::NAN
            };
            rows.push(SensitivityRow {
                model,
                omega_rad_s: problem.omega_rad_s,
                extrapolation: extrapolation.clone(),
                parameter: name,
                parameter_value: value * scale,
                metric: metric.clone(),
                metric_value,
                derivative: values[index] / scale,
                derivative_error: errors[index] / scale,
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
    rows
}

/// Returns the values of [`SENSITIVE_METRICS`] for a problem, solved from the last solution of a solver; `None` if it has
/// no periodic solution.
pub(super) fn metrics_near(solver: &Solver, problem: &AnyProblem) -> Option<Vec<f64>> {
    let mut solver = solver.clone();
    let metrics = solver.solve(&problem.three_links()?, FIT_ACCURACY).ok()?;
    let [work_j, _] = solver.work_and_loss_j().ok()?;
    Some(by_metric(&metrics, work_j).to_vec())
}

/// Returns the values of the metrics of a chain's motion; `None` if there is no periodic solution.
pub(super) fn metrics_of_chain(setup: &ChainSetup, problem: &AnyProblem) -> Option<Vec<f64>> {
    let chain = problem.robot.as_chain()?.with_gait(&problem.gait);
    let (laws, omega_rad_s) = (problem.laws, problem.omega_rad_s);
    let motion = ChainProblem { chain, laws, omega_rad_s }.solve(FIT_ACCURACY).ok()?;
    let metrics = setup.metrics(&motion.metrics, motion.work_j);
    Some(metrics.into_iter().map(|(_, value)| value).collect())
}

/// Returns all single quantities that can influence the metrics, followed by those sums of quantities (such as a total
/// over the wheels) that have a known uncertainty.
fn with_sums(problem: &Problem, any: &AnyProblem, uncertainty: &InputUncertainty) -> Vec<Quantity> {
    let mut all = Quantity::all(problem);
    for quantity in uncertainty.quantities(&any.robot) {
        if !all.contains(&quantity) {
            all.push(quantity);
        }
    }
    all
}
