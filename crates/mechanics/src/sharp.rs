//! Extrapolation of a motion under dry friction to zero transition speed.

use trilink_robot::Quantity;
use trilink_robot::metrics::{ByMetric, GaitMetrics};

use super::{Problem, Result, Solver};

/// Metrics in the limit of zero transition speed, where dry friction reverses its sign discontinuously.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct SharpLimit {
    pub metrics: GaitMetrics,
    /// Estimated extrapolation error of each metric.
    pub uncertainty: GaitMetrics,
}

impl Problem {
    /// Extrapolates the metrics to zero transition speed from solutions at the robot's transition speed, half
    /// of it and a quarter of it, each computed to the relative `accuracy`. Returns `None` if no friction is
    /// dry, or if the no-skid constraints alone determine the motion.
    ///
    /// # Errors
    /// Returns an error if one of the three motions does not exist, or could not be found or resolved.
    pub fn sharp_limit(&self, accuracy: f64) -> Result<Option<SharpLimit>> {
        if !self.laws.are_dry() || self.is_determined() {
            return Ok(None);
        }
        let mut solver = Solver::default();
        let whole = solver.solve(&self.with_transition_scaled(1.0), accuracy)?;
        let half = solver.solve(&self.with_transition_scaled(0.5), accuracy)?;
        let quarter = solver.solve(&self.with_transition_scaled(0.25), accuracy)?;
        let mut uncertainty = GaitMetrics::NONE;
        let limits = ByMetric::<f64>::from_fn(|i| {
            // Linear extrapolation through neighbouring values, and the parabola through all three.
            let lines = [2.0 * half[i] - whole[i], 2.0 * quarter[i] - half[i]];
            let limit = (4.0 * lines[1] - lines[0]) / 3.0;
            uncertainty[i] = (limit - lines[1]).abs();
            limit
        });
        let mut metrics = GaitMetrics::from(limits);
        metrics.sigma = metrics.sigma.map(|sigma| if sigma < 0.0 { 0.0 } else { sigma });
        Ok(Some(SharpLimit { metrics, uncertainty }))
    }

    /// Returns the problem with the transition speed of dry friction multiplied by `factor`.
    fn with_transition_scaled(&self, factor: f64) -> Self {
        let mut problem = self.clone();
        let transition = Quantity::Transition.one();
        problem.robot.set(transition, factor * self.robot.value(transition));
        problem
    }
}
