//! What can be had of one objective for another: the gaits of which none is better in both.
//!
//! Reference: Y. Y. Haimes, L. S. Lasdon and D. A. Wismer, *On a bicriterion formulation of the problems of
//! integrated system identification and system optimization*, IEEE Trans. Syst. Man Cybern. 1 (1971) 296: one
//! objective is searched with a limit to the other.

use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_tables::Objective;

use super::landscape::LEAST_NAME;
use super::{Bounds, Optimum, Search};

/// Gaits of a front, its ends among them.
const POINTS: usize = 15;
/// Searches for each one beside that from its neighbour.
const STARTS: usize = 4;
/// By how much one is better than another one, relative, that leaves it aside.
const BETTER: f64 = 1e-7;

impl Search {
    /// The Pareto front of the objective and another one: gaits that count, from the best in the first to the best
    /// in the other, at even steps of the other's logarithm; empty where an objective has no optimum that counts.
    ///
    /// # Errors
    /// The work was cancelled.
    pub fn front(&self, other: Objective, cancel: &CancelToken) -> Result<Vec<Optimum>, Cancelled> {
        let end = |objective| {
            let found = Self { objective, ..self.clone() }.run(cancel)?;
            Ok(found.optima.into_iter().next().filter(Optimum::counts))
        };
        let (Some(first), Some(last)) = (end(self.objective)?, end(other)?) else {
            return Ok(Vec::new());
        };
        let [from, to] = [&first, &last].map(|of| of.value_of(other).ln());
        let mut front = vec![first];
        for step in 1..POINTS - 1 {
            let level = (from + (to - from) * step as f64 / (POINTS - 1) as f64).exp();
            let bounds = Bounds { least: Some((other, level)), ..self.bounds };
            let nearest = front.last().map_or(&self.problem, |of| &of.problem);
            let search =
                Self { problem: nearest.clone(), bounds, starts: 1 + STARTS, ..self.clone() };
            let again = Self { problem: last.problem.clone(), starts: 1, ..search.clone() };
            let found = [search.run(cancel)?, again.run(cancel)?].into_iter();
            let found = found.flat_map(|found| found.optima);
            let cost = |of: &Optimum| self.objective.cost_of_value(of.value_of(self.objective));
            let best = found.filter(Optimum::counts).min_by(|a, b| cost(a).total_cmp(&cost(b)));
            // That the other is limited is what a front is.
            front.extend(best.map(|mut of| {
                of.at_bound.retain(|name| name != LEAST_NAME);
                of
            }));
        }
        let value = last.value_of(self.objective);
        front.push(Optimum { value, ..last });
        let costs =
            |of: &Optimum| [self.objective, other].map(|by| by.cost_of_value(of.value_of(by)));
        let all: Vec<[f64; 2]> = front.iter().map(costs).collect();
        let is_behind = |[a, b]: &[f64; 2]| {
            all.iter().any(|[x, y]| x <= a && y <= b && (*x < a - BETTER || *y < b - BETTER))
        };
        let kept = all.iter().map(|of| !is_behind(of)).collect::<Vec<bool>>();
        let kept = front.into_iter().zip(kept);
        Ok(kept.filter_map(|(of, is_kept)| is_kept.then_some(of)).collect())
    }
}
