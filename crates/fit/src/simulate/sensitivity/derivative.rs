//! Derivatives of a steady motion's metrics.
//!
//! Those by coefficients of resistance and of the joint, by the numbers of the gait and by omega are
//! the solver's own, by adjoints. Those by dimensions, masses, moments of inertia and the rest angle are
//! central differences of sixth order around the motion, each from it, to a relative accuracy of 1e-10;
//! what they differ from the fourth order's, and what the motions' own inaccuracy makes of them, is their
//! error.

use trilink_mechanics::{
    Derivatives, MotionError, Problem, REFERENCE_ACCURACY, Solver, SteadyMotion,
};
use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_tables::SENSITIVE_METRICS;

use super::quantity::{OF_FIRST, Quantity};

pub(super) const COUNT: usize = SENSITIVE_METRICS.len();

/// A number for each metric.
pub(super) type ByMetric = [f64; COUNT];

/// Steps of the differences, as a part of the value, or in SI units of one that is zero.
const STEP: f64 = 3e-3;
/// Weights of the differences over one, two and three steps to either side.
const SIXTH: [f64; 3] = [3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0];
const FOURTH: [f64; 3] = [2.0 / 3.0, -1.0 / 12.0, 0.0];

/// In the order of [`SENSITIVE_METRICS`].
pub(super) fn by_metric(metrics: &GaitMetrics, work_j: f64) -> ByMetric {
    let value = |i: usize| Metric::FITTED.get(i).map_or(work_j, |metric| metrics[*metric]);
    std::array::from_fn(value)
}

/// A motion with its derivatives.
pub(super) struct Differentiated<'p> {
    problem: &'p Problem,
    /// Which has solved for the motion last.
    solver: Solver,
    pub values: ByMetric,
    metrics: Derivatives,
    work: Derivatives<f64>,
}

impl<'p> Differentiated<'p> {
    /// Of the motion that the solver has solved for last.
    ///
    /// # Errors
    /// It has no derivatives.
    pub(super) fn new(
        problem: &'p Problem,
        mut solver: Solver,
        motion: &SteadyMotion,
    ) -> Result<Self, MotionError> {
        let (metrics, work) = (solver.derivatives()?, solver.work_derivatives()?);
        let values = by_metric(&motion.metrics, motion.work_j);
        Ok(Self { problem, solver, values, metrics, work })
    }

    /// Derivatives with respect to a quantity in SI units, and their errors where they are differences.
    ///
    /// # Errors
    /// A motion nearby does not exist.
    pub(super) fn by(&self, quantity: Quantity) -> Result<(ByMetric, ByMetric), MotionError> {
        let own = match quantity {
            Quantity::Robot(of) if of.quantity().definition().is_fitted => {
                (&self.metrics.parameters[of], self.work.parameters[of])
            }
            Quantity::Gait(joint, number) if number >= OF_FIRST => {
                let second = self.problem.gait.joints[joint].unwrap_or_default().second();
                let parts = [0, 1].map(|part| {
                    by_metric(&self.metrics.second[joint][part], self.work.second[joint][part])
                });
                let slope = |metric: usize| {
                    second.polar_slopes(parts.map(|of| of[metric]))[number - OF_FIRST]
                };
                return Ok((std::array::from_fn(slope), [f64::NAN; COUNT]));
            }
            Quantity::Gait(joint, number) => {
                (&self.metrics.gait[joint][number], self.work.gait[joint][number])
            }
            Quantity::Omega => (&self.metrics.omega, self.work.omega),
            Quantity::Robot(_) => return self.differences(quantity),
        };
        Ok((by_metric(own.0, own.1), [f64::NAN; COUNT]))
    }

    fn differences(&self, quantity: Quantity) -> Result<(ByMetric, ByMetric), MotionError> {
        let value = quantity.of(self.problem);
        let step = STEP * if value == 0.0 { 1.0 } else { value.abs() };
        let mut differences = [[0.0; COUNT]; 3];
        for (nth, differences) in differences.iter_mut().enumerate() {
            let away = step * (nth + 1) as f64;
            let [above, below] =
                [self.at(quantity, value + away)?, self.at(quantity, value - away)?];
            *differences = std::array::from_fn(|metric| above[metric] - below[metric]);
        }
        let of = |weights: [f64; 3], metric: usize| -> f64 {
            let both = weights.iter().zip(&differences);
            both.map(|(weight, of)| weight * of[metric]).sum::<f64>() / step
        };
        let derivatives = std::array::from_fn(|metric| of(SIXTH, metric));
        let errors = std::array::from_fn(|metric| {
            let noise = 2.0 * REFERENCE_ACCURACY * self.values[metric].abs() / step;
            (of(SIXTH, metric) - of(FOURTH, metric)).abs() + noise
        });
        Ok((derivatives, errors))
    }

    fn at(&self, quantity: Quantity, value: f64) -> Result<ByMetric, MotionError> {
        let mut problem = self.problem.clone();
        quantity.set(&mut problem, value);
        let mut solver = self.solver.clone();
        let metrics = solver.solve(&problem, REFERENCE_ACCURACY)?;
        let [work_j, _] = solver.work_and_loss_j()?;
        Ok(by_metric(&metrics, work_j))
    }
}
