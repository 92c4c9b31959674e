//! Multi-start search for the free coefficients, with starts spread over the range between the bounds.

use rayon::prelude::*;
use trilink_mechanics::{FIT_ACCURACY, REFERENCE_ACCURACY};
use trilink_tables::Stopped;

use super::input::FreeParameter;
use super::objective::{Evaluator, Objective};
use super::search::{CONVERGENCE_TOLERANCE, Ended, Iterate};

/// Search from one starting point.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Values of the free parameters at the start of the search, in the order of the parameters.
    pub began: Vec<f64>,
    /// Values of the free parameters at the end of the search.
    pub ended: Vec<f64>,
    /// Objective (eq. 22 of the paper) at the end of the search.
    pub cost: f64,
    /// Number of periodic solutions computed.
    pub solves: usize,
    pub stopped: Stopped,
}

/// Relative solver accuracies used in the early stages of a search, before its final, most accurate stage. Each is
/// paired with the predicted relative decrease of the objective below which that stage ends.
const APPROACH: [(f64, f64); 2] = [(1e-4, 1e-3), (FIT_ACCURACY, 1e-6)];
/// Maximum number of times that the Taylor expansion of the trials' metrics is recomputed in the final, most accurate
/// stage of a search; the effect of each recomputation is about a hundredth of that of the previous one.
const MAX_EXPANSIONS: usize = 4;
/// Relative change of the objective, due to a new Taylor expansion of the trials' metrics, below which no further
/// expansion is needed.
const EXPANSION_TOLERANCE: f64 = 1e-9;
/// Maximum difference in the logarithm of a parameter between two searches that are taken to approach the same minimum;
/// their objectives may differ by at most [`SAME_COST`] (relative). The last iterations change these values by much
/// less, and neighbouring minima differ by more.
const SAME_VALUE: f64 = 1e-3;
const SAME_COST: f64 = 1e-5;

/// Searches from the start with the given index. Index 0 is the configured robot, except for parameters whose
/// configured values are not within their bounds; the other starts are spread over the range between the bounds.
/// Without free parameters, the objective is evaluated once.
pub fn search(objective: &Objective, parameters: &[FreeParameter], number: usize) -> Start {
    let began = starting_values(objective, parameters, number);
    search_from(objective.evaluator(parameters.to_vec()), began)
}

/// Searches from the first `count` starts. If several searches approach the same minimum, only the first of them runs
/// the last, most accurate iterations.
pub(super) fn search_all(
    objective: &Objective,
    parameters: &[FreeParameter],
    count: usize,
) -> Vec<Start> {
    let approaches: Vec<Approach> = (0..count)
        .into_par_iter()
        .map(|number| {
            let began = starting_values(objective, parameters, number);
            Approach::new(objective.evaluator(parameters.to_vec()), began)
        })
        .collect();
    // In order of the index, whatever the order in which the searches have ended.
    let mut first: Vec<usize> = Vec::new();
    for (number, approach) in approaches.iter().enumerate() {
        let mut earlier = (0..number).filter(|&earlier| first[earlier] == earlier);
        let same = earlier.find(|&earlier| approach.is_near(&approaches[earlier]));
        first.push(same.unwrap_or(number));
    }
    let mut starts: Vec<Start> = approaches
        .into_par_iter()
        .enumerate()
        .map(|(number, approach)| {
            if first[number] == number {
                approach.finish()
            } else {
                approach.into_start(Stopped::Joined)
            }
        })
        .collect();
    for (number, &first) in first.iter().enumerate().filter(|(number, first)| number != *first) {
        let Start { ended, cost, .. } = starts[first].clone();
        starts[number].ended = ended;
        starts[number].cost = cost;
    }
    starts
}

/// Searches to full accuracy, starting from the given values of the free parameters.
pub(super) fn search_from(evaluator: Evaluator, began: Vec<f64>) -> Start {
    Approach::new(evaluator, began).finish()
}

/// Search before its last, most accurate iterations.
struct Approach<'o> {
    began: Vec<f64>,
    evaluator: Evaluator<'o>,
    iterate: Iterate,
}

impl<'o> Approach<'o> {
    /// Runs the iterations at reduced solver accuracy.
    fn new(mut evaluator: Evaluator<'o>, began: Vec<f64>) -> Self {
        let [(accuracy, tolerance), finer @ ..] = APPROACH;
        let is_free = !evaluator.parameters.is_empty();
        evaluator.accuracy = if is_free { accuracy } else { FIT_ACCURACY };
        let mut iterate = Iterate::new(&mut evaluator, began.clone());
        if is_free {
            iterate = iterate.run(&mut evaluator, tolerance, false, &Ended::default());
            for (accuracy, tolerance) in finer {
                iterate = iterate.with_accuracy(&mut evaluator, accuracy);
                iterate = iterate.run(&mut evaluator, tolerance, false, &Ended::default());
            }
        }
        Self { began, evaluator, iterate }
    }

    /// Whether the last iterations of this search and of the other one would lead to the same minimum.
    fn is_near(&self, other: &Self) -> bool {
        let here = &self.iterate;
        let there = &other.iterate;
        let mut pairs = here.values.iter().zip(&there.values);
        (here.cost - there.cost).abs() <= SAME_COST * there.cost
            && pairs.all(|(a, b)| (a / b).ln().abs() <= SAME_VALUE)
    }

    /// Runs the last iterations at full solver accuracy.
    fn finish(mut self) -> Start {
        if self.evaluator.parameters.is_empty() {
            return self.into_start(Stopped::NothingFree);
        }
        let mut iterate = self.iterate.with_accuracy(&mut self.evaluator, REFERENCE_ACCURACY);
        for _ in 0..MAX_EXPANSIONS {
            iterate =
                iterate.run(&mut self.evaluator, CONVERGENCE_TOLERANCE, true, &Ended::default());
            let cost = iterate.cost;
            if self.evaluator.has_expansions() {
                iterate = iterate.expand(&mut self.evaluator);
            }
            if (iterate.cost - cost).abs() <= EXPANSION_TOLERANCE * cost {
                break;
            }
        }
        self.iterate = iterate;
        let stopped = self.iterate.stopped;
        self.into_start(stopped)
    }

    fn into_start(self, stopped: Stopped) -> Start {
        let Self { began, evaluator, iterate: Iterate { values: ended, cost, .. } } = self;
        Start { began, ended, cost, solves: evaluator.solves, stopped }
    }
}

/// Returns the values of the free parameters for the start with the given index.
pub(super) fn starting_values(
    objective: &Objective,
    parameters: &[FreeParameter],
    number: usize,
) -> Vec<f64> {
    const BASES: [u32; 8] = [2, 3, 5, 7, 11, 13, 17, 19];
    parameters
        .iter()
        .zip(BASES.into_iter().cycle())
        .map(|(free, base)| {
            let [low, high] = free.bounds;
            let configured = objective.robots.value(free.parameter);
            if number == 0 && configured > low && configured < high {
                return configured;
            }
            // No starts in the outer 5 % of the range between the bounds, on a log scale.
            let fraction = 0.05 + 0.9 * radical_inverse(number as u32 + 1, base);
            low * (high / low).powf(fraction)
        })
        .collect()
}

/// Returns the radical inverse of a number in the given base (Halton's low-discrepancy sequence).
fn radical_inverse(mut number: u32, base: u32) -> f64 {
    let mut inverse = 0.0;
    let mut digit = 1.0 / f64::from(base);
    while number > 0 {
        inverse += f64::from(number % base) * digit;
        number /= base;
        digit /= f64::from(base);
    }
    inverse
}
