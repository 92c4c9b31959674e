//! Derivatives of the metrics of a steady-state motion.
//!
//! The solver computes the derivatives with respect to the coefficients of friction and of the joint, the gait
//! parameters and omega by the adjoint method. Derivatives with respect to dimensions, masses, moments of inertia and
//! the rest angle are sixth-order central differences between periodic solutions of relative accuracy 1e-10, which are
//! warm-started from the original solution. The error estimate is the deviation from fourth-order differences plus the
//! effect of the solver's error.

use trilink_mechanics::{
    AnyProblem, Derivatives, MotionError, Problem, REFERENCE_ACCURACY, Solver, SteadyMotion,
};
use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_tables::SENSITIVE_METRICS;

use super::quantity::{FIRST_HARMONIC_NUMBERS, Quantity};

/// Number of metrics in [`SENSITIVE_METRICS`].
pub(super) const COUNT: usize = SENSITIVE_METRICS.len();

/// One value for each metric, in the order of [`SENSITIVE_METRICS`].
pub(super) type ByMetric = [f64; COUNT];

/// Finite-difference step, relative to the value, or in SI units for a value of zero.
const STEP: f64 = 3e-3;
/// Weights of the sixth-order central differences over one, two and three steps.
const SIXTH_ORDER: [f64; 3] = [3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0];
/// Weights of the fourth-order central differences over one, two and three steps.
const FOURTH_ORDER: [f64; 3] = [2.0 / 3.0, -1.0 / 12.0, 0.0];

/// Returns the metrics and the work in the order of [`SENSITIVE_METRICS`].
pub(super) fn by_metric(metrics: &GaitMetrics, work_j: f64) -> ByMetric {
    SENSITIVE_METRICS
        .map(|column| Metric::from_column(column).map_or(work_j, |metric| metrics[metric]))
}

/// Metrics of a steady-state motion and their derivatives.
pub(super) struct MotionDerivatives<'p> {
    problem: &'p Problem,
    /// Solver whose latest solution is this motion.
    solver: Solver,
    pub values: ByMetric,
    metrics: Derivatives,
    work: Derivatives<f64>,
}

impl<'p> MotionDerivatives<'p> {
    /// Computes the adjoint derivatives of the solver's latest solution.
    ///
    /// # Errors
    /// Returns an error if that solution has no derivatives.
    pub(super) fn new(
        problem: &'p Problem,
        mut solver: Solver,
        motion: &SteadyMotion,
    ) -> Result<Self, MotionError> {
        let metrics = solver.derivatives()?;
        let work = solver.work_derivatives()?;
        let values = by_metric(&motion.metrics, motion.work_j);
        Ok(Self { problem, solver, values, metrics, work })
    }

    /// Returns the derivatives with respect to a quantity in SI units, and their estimated errors; the errors are NaN
    /// for adjoint derivatives.
    ///
    /// # Errors
    /// Returns an error if the model has no periodic solution for a neighbouring value of the quantity.
    pub(super) fn with_respect_to(
        &self,
        quantity: Quantity,
    ) -> Result<(ByMetric, ByMetric), MotionError> {
        let (metrics, work) = match quantity {
            Quantity::Robot(of) if of.quantity().definition().is_fitted => {
                (&self.metrics.parameters[of], self.work.parameters[of])
            }
            Quantity::Gait(joint, number) if number >= FIRST_HARMONIC_NUMBERS => {
                let second = self.problem.gait.joints[joint].unwrap_or_default().second();
                let components = [0, 1].map(|component| {
                    let metrics = &self.metrics.second[joint][component];
                    by_metric(metrics, self.work.second[joint][component])
                });
                let slopes = std::array::from_fn(|metric| {
                    let slopes = second.polar_slopes(components.map(|of| of[metric]));
                    slopes[number - FIRST_HARMONIC_NUMBERS]
                });
                return Ok((slopes, [f64::NAN; COUNT]));
            }
            Quantity::Gait(joint, number) => {
                (&self.metrics.gait[joint][number], self.work.gait[joint][number])
            }
            Quantity::Omega => (&self.metrics.omega, self.work.omega),
            Quantity::Robot(_) | Quantity::Number(_) => return self.finite_differences(quantity),
        };
        Ok((by_metric(metrics, work), [f64::NAN; COUNT]))
    }

    fn finite_differences(&self, quantity: Quantity) -> Result<(ByMetric, ByMetric), MotionError> {
        let value = quantity.value(&self.problem.clone().into());
        let step = STEP * if value == 0.0 { 1.0 } else { value.abs() };
        let mut differences = [[0.0; COUNT]; 3];
        for (index, differences) in differences.iter_mut().enumerate() {
            let change = step * (index + 1) as f64;
            let above = self.metrics_at(quantity, value + change)?;
            let below = self.metrics_at(quantity, value - change)?;
            *differences = std::array::from_fn(|metric| above[metric] - below[metric]);
        }
        let derivative = |weights: [f64; 3], metric: usize| -> f64 {
            let both = weights.iter().zip(&differences);
            both.map(|(weight, difference)| weight * difference[metric]).sum::<f64>() / step
        };
        let derivatives = std::array::from_fn(|metric| derivative(SIXTH_ORDER, metric));
        let errors = std::array::from_fn(|metric| {
            let noise = 2.0 * REFERENCE_ACCURACY * self.values[metric].abs() / step;
            (derivatives[metric] - derivative(FOURTH_ORDER, metric)).abs() + noise
        });
        Ok((derivatives, errors))
    }

    fn metrics_at(&self, quantity: Quantity, value: f64) -> Result<ByMetric, MotionError> {
        let mut problem = AnyProblem::from(self.problem.clone());
        quantity.set(&mut problem, value);
        let problem = problem.three_links().ok_or(MotionError::Unsolved)?;
        let mut solver = self.solver.clone();
        let metrics = solver.solve(&problem, REFERENCE_ACCURACY)?;
        let [work_j, _] = solver.work_and_loss_j()?;
        Ok(by_metric(&metrics, work_j))
    }
}
