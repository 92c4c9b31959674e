//! What is left of the transition speed in a motion under dry friction.

use trilink_robot::metrics::{ByMetric, GaitMetrics};

use super::{Problem, Result, Solver};

/// The metrics where dry friction changes its sign at once.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct SharpLimit {
    pub metrics: GaitMetrics,
    /// By how much the extrapolation may miss each of them.
    pub uncertainty: GaitMetrics,
}

impl Problem {
    /// The metrics extrapolated to a transition speed of zero from this one, its half and its
    /// quarter, to a relative `accuracy` of each; `None` where no friction is dry.
    ///
    /// # Errors
    /// One of the motions does not exist, or could not be found or resolved.
    pub fn sharp_limit(&self, accuracy: f64) -> Result<Option<SharpLimit>> {
        if !self.laws.are_dry() || self.is_determined() {
            return Ok(None);
        }
        let mut solver = Solver::default();
        let mut solve = |factor: f64| solver.solve(&self.softened(factor), accuracy);
        let [whole, half, quarter] = [solve(1.0)?, solve(0.5)?, solve(0.25)?];
        let mut uncertainty = GaitMetrics::NONE;
        let limits = ByMetric::<f64>::from_fn(|i| {
            // Straight lines through neighbours, and the parabola through all three.
            let lines = [2.0 * half[i] - whole[i], 2.0 * quarter[i] - half[i]];
            let limit = (4.0 * lines[1] - lines[0]) / 3.0;
            uncertainty[i] = (limit - lines[1]).abs();
            limit
        });
        let mut metrics = GaitMetrics::from(limits);
        metrics.sigma = metrics.sigma.map(|sigma| sigma.max(0.0));
        Ok(Some(SharpLimit { metrics, uncertainty }))
    }
}
