//! Pareto front of two objectives by the epsilon-constraint method: one objective is optimised with a limit on the
//! other.
//!
//! Reference: Y. Y. Haimes, L. S. Lasdon and D. A. Wismer, *On a bicriterion formulation of the problems of
//! integrated system identification and system optimization*, IEEE Trans. Syst. Man Cybern. 1 (1971) 296.

use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_tables::Objective;

use super::landscape::MIN_NAME;
use super::{Bounds, Optimum, Search};

/// Number of gaits on a Pareto front, including its ends.
const POINTS: usize = 15;
/// Number of starts for each gait of the front, in addition to the neighbouring gait.
const STARTS: usize = 4;
/// Minimum relative improvement for one gait to dominate another.
const MIN_IMPROVEMENT: f64 = 1e-7;

impl Search {
    /// Returns gaits on the Pareto front of this search's objective and `other`, from the optimum of the former to that
    /// of the latter, at even steps in the logarithm of `other`. The motions of all these gaits are stable and reached
    /// from rest. Returns no gaits if either objective has no optimum with such a motion.
    ///
    /// # Errors
    /// Returns an error if the search is cancelled.
    pub fn front(&self, other: Objective, cancel: &CancelToken) -> Result<Vec<Optimum>, Cancelled> {
        let first = self.best_gait(self.objective, cancel)?;
        let last = self.best_gait(other, cancel)?;
        let (Some(first), Some(last)) = (first, last) else { return Ok(Vec::new()) };
        let [from, to] = [&first, &last].map(|end| end.value_of(other).ln());
        let mut front = vec![first];
        for step in 1..POINTS - 1 {
            let level = (from + (to - from) * step as f64 / (POINTS - 1) as f64).exp();
            let bounds = Bounds { least: Some((other, level)), ..self.bounds };
            let neighbour = front.last().map_or(&self.problem, |gait| &gait.problem);
            let from_neighbour =
                Self { problem: neighbour.clone(), bounds, starts: 1 + STARTS, ..self.clone() };
            let from_last =
                Self { problem: last.problem.clone(), starts: 1, ..from_neighbour.clone() };
            let results = [from_neighbour.run(cancel)?, from_last.run(cancel)?];
            let best = results
                .into_iter()
                .flat_map(|result| result.optima)
                .filter(Optimum::is_reachable)
                .min_by(|a, b| a.cost(self.objective).total_cmp(&b.cost(self.objective)));
            // The limit on the other objective defines the front; do not report it.
            front.extend(best.map(|mut gait| {
                gait.at_bound.retain(|name| name != MIN_NAME);
                gait
            }));
        }
        let value = last.value_of(self.objective);
        front.push(Optimum { value, ..last });
        let costs: Vec<[f64; 2]> =
            front.iter().map(|gait| [self.objective, other].map(|by| gait.cost(by))).collect();
        let mut own_costs = costs.iter();
        front.retain(|_| own_costs.next().is_some_and(|own| !is_dominated(own, &costs)));
        Ok(front)
    }

    /// Returns the best gait for an objective; `None` if no optimum is stable and reached from rest.
    fn best_gait(
        &self,
        objective: Objective,
        cancel: &CancelToken,
    ) -> Result<Option<Optimum>, Cancelled> {
        let result = Self { objective, ..self.clone() }.run(cancel)?;
        Ok(result.optima.into_iter().next().filter(Optimum::is_reachable))
    }
}

impl Optimum {
    fn cost(&self, objective: Objective) -> f64 {
        objective.cost_of_value(self.value_of(objective))
    }
}

/// Returns whether `costs` contains a gait that is at least as good as the one with costs `[a, b]` in both objectives
/// and better in one.
fn is_dominated([a, b]: &[f64; 2], costs: &[[f64; 2]]) -> bool {
    costs
        .iter()
        .any(|[x, y]| x <= a && y <= b && (*x < a - MIN_IMPROVEMENT || *y < b - MIN_IMPROVEMENT))
}
