//! Sensitivities of the metrics to all quantities that influence them, and uncertainty budgets of the metrics.

mod budget;
mod monte_carlo;
mod quantity;
#[cfg(test)]
mod tests;

use trilink_mechanics::{FIT_ACCURACY, MotionError, NumberDerivatives, Problem, Solver};
use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_robot::{ChainNumber, CommandNumber, Model};
use trilink_tables::{Extrapolation, SensitivityRow};

use super::answer;

pub(super) use budget::InputUncertainty;
pub use monte_carlo::Draws;
pub(super) use monte_carlo::add_monte_carlo;
use quantity::{FIRST_HARMONIC_NUMBERS, Quantity};

/// Absolute value up to which a metric counts as zero, since it may be due to rounding errors.
const EPSILON: f64 = 1e-12;

/// Motion whose sensitivities are computed.
pub(super) struct Motion {
    pub problem: Problem,
    pub model: Model,
    /// Names of the metrics and of the work.
    pub metrics: Vec<String>,
    pub extrapolation: Extrapolation,
}

/// Derivatives of the metrics of one motion with respect to a quantity, in SI units.
struct Derivative {
    quantity: Quantity,
    values: Vec<f64>,
}

impl Motion {
    /// Computes the sensitivities: one row for each metric and quantity, grouped by metric, with the quantities in the
    /// order of the robot's parameters. Numbers of a chain on which no metric depends are left out.
    ///
    /// # Errors
    /// Returns an error if the model has no periodic solution, or if the solution has no derivatives.
    pub(super) fn sensitivities(
        &self,
        from_rest: bool,
        uncertainty: &InputUncertainty,
    ) -> Result<Vec<SensitivityRow>, MotionError> {
        let Self { problem, model, extrapolation, .. } = self;
        let (mut solver, motion) = answer::solve_motion(problem, from_rest)?;
        let mut quantities = Quantity::all(problem);
        for quantity in uncertainty.quantities(&problem.robot) {
            if !quantities.contains(&quantity) {
                quantities.push(quantity);
            }
        }
        let mut derivatives = self.derivatives(&mut solver, &quantities)?;
        derivatives.retain(|Derivative { quantity, values }| {
            !matches!(quantity, Quantity::Number(_)) || values.iter().any(|slope| *slope != 0.0)
        });
        let values = self.values(&motion.metrics, motion.work_j);
        let metrics: Vec<(String, f64)> = self.metrics.iter().cloned().zip(values).collect();
        Ok(rows((*model, problem, extrapolation), &metrics, &derivatives, uncertainty))
    }

    /// Returns the metrics and the work in the order of their names.
    fn values(&self, metrics: &GaitMetrics, work_j: f64) -> Vec<f64> {
        let value = |name: &String| Metric::from_column(name).map_or(work_j, |of| metrics[of]);
        self.metrics.iter().map(value).collect()
    }

    /// Returns the values for another problem, solved from the last solution of a solver; `None` if it has no periodic
    /// solution.
    pub(super) fn values_near(&self, solver: &Solver, problem: &Problem) -> Option<Vec<f64>> {
        let mut solver = solver.clone();
        let metrics = solver.solve(problem, FIT_ACCURACY).ok()?;
        let work_j = solver.loss_j().ok()?;
        Some(self.values(&metrics, work_j))
    }

    /// Returns the derivatives of the solver's last solution, the motion itself.
    fn derivatives(
        &self,
        solver: &mut Solver,
        quantities: &[Quantity],
    ) -> Result<Vec<Derivative>, MotionError> {
        let parameters: Vec<_> = quantities
            .iter()
            .filter_map(|quantity| match quantity {
                Quantity::Robot(parameter) => Some(*parameter),
                _ => None,
            })
            .collect();
        let numbers: Vec<ChainNumber> =
            quantities.iter().flat_map(|quantity| numbers_of(*quantity)).collect();
        let mut of_parameters = solver.parameter_derivatives(&parameters)?.into_iter();
        let (omega, of_numbers) = solver.derivatives_with_omega(&numbers)?;
        let mut of_numbers = of_numbers.into_iter();
        let values = |slopes: NumberDerivatives| self.values(&slopes.metrics, slopes.work_j);
        let mut next = || of_numbers.next().map_or(Vec::new(), values);
        let derivative = |quantity: &Quantity| {
            let values = match *quantity {
                Quantity::Omega => values(omega),
                Quantity::Robot(_) => of_parameters.next().map_or(Vec::new(), values),
                Quantity::Gait(joint, number) if number >= FIRST_HARMONIC_NUMBERS => {
                    let second = self.problem.gait.joints[joint].unwrap_or_default().second();
                    let [in_phase, quadrature] = [next(), next()];
                    let polar = |(in_phase, quadrature)| {
                        let slopes = second.polar_slopes([in_phase, quadrature]);
                        slopes[number - FIRST_HARMONIC_NUMBERS]
                    };
                    in_phase.into_iter().zip(quadrature).map(polar).collect()
                }
                Quantity::Gait(..) | Quantity::Number(_) => next(),
            };
            Derivative { quantity: *quantity, values }
        };
        Ok(quantities.iter().map(derivative).collect())
    }
}

/// Returns the numbers from whose derivatives those with respect to a quantity of the gait or a number follow.
fn numbers_of(quantity: Quantity) -> Vec<ChainNumber> {
    match quantity {
        Quantity::Number(number) => vec![number],
        Quantity::Gait(joint, number) if number >= FIRST_HARMONIC_NUMBERS => {
            [CommandNumber::SecondInPhase, CommandNumber::SecondQuadrature]
                .map(|number| ChainNumber::Command(joint, number))
                .to_vec()
        }
        Quantity::Gait(joint, number) => {
            vec![ChainNumber::Command(joint, CommandNumber::ALL[number])]
        }
        Quantity::Robot(_) | Quantity::Omega => Vec::new(),
    }
}

/// Returns a row for each metric and quantity, given the values of the metrics and their derivatives.
fn rows(
    (model, problem, extrapolation): (Model, &Problem, &Extrapolation),
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
        for Derivative { quantity, values } in derivatives {
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
