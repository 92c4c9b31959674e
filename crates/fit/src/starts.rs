//! Searches from starts that are spread over the bounds.

use rayon::prelude::*;
use trilink_mechanics::{FIT_ACCURACY, REFERENCE_ACCURACY};
use trilink_tables::Stopped;

use super::input::FreeParameter;
use super::objective::{Evaluator, Objective};
use super::search::{CONVERGED, Ended, Iterate};

/// One search.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Values of the free parameters, in their order.
    pub began: Vec<f64>,
    pub ended: Vec<f64>,
    /// Eq. 22 where it ended.
    pub cost: f64,
    /// Steady motions solved for.
    pub solves: usize,
    pub stopped: Stopped,
}

/// Accuracies of the motions before those of the last iterations, and the tolerances of the
/// search with them.
const APPROACH: [(f64, f64); 2] = [(1e-4, 1e-3), (FIT_ACCURACY, 1e-6)];
/// How often the trials' motions are expanded in the last iterations: each changes a
/// hundredth of what the one before did.
const MOST_EXPANSIONS: usize = 4;
/// Change of the objective by them, relative to it, that is none.
const EXPANDED: f64 = 1e-9;
/// Largest difference of a parameter's logarithm, and of the objective relative to itself, of
/// iterates that are the same before the last iterations. These go much less far, and
/// neighbouring minima are further apart.
const SAME_VALUE: f64 = 1e-3;
const SAME_COST: f64 = 1e-5;

/// Searches from the start with this number: 0 is the configured robot, the others are spread
/// over the bounds. Without parameters there is one evaluation.
pub fn search(objective: &Objective, parameters: &[FreeParameter], number: usize) -> Start {
    let began = begin(objective, parameters, number);
    search_from(objective.evaluator(parameters.to_vec()), began)
}

/// Searches from the first `count` starts. Of those that come to the same minimum only the first
/// takes the last, most accurate iterations.
pub(super) fn search_all(
    objective: &Objective,
    parameters: &[FreeParameter],
    count: usize,
) -> Vec<Start> {
    let approaches: Vec<Approach> = (0..count)
        .into_par_iter()
        .map(|number| {
            let began = begin(objective, parameters, number);
            Approach::new(objective.evaluator(parameters.to_vec()), began)
        })
        .collect();
    // In the order of their numbers, whatever the order in which they have ended.
    let mut first: Vec<usize> = Vec::new();
    for (number, approach) in approaches.iter().enumerate() {
        let mut earlier = (0..number).filter(|&earlier| first[earlier] == earlier);
        let same = earlier.find(|&earlier| approach.is_near(&approaches[earlier]));
        first.push(same.unwrap_or(number));
    }
    let end = |(number, approach): (usize, Approach)| match first[number] == number {
        true => approach.finish(),
        false => approach.start(Stopped::Joined),
    };
    let mut starts: Vec<Start> = approaches.into_par_iter().enumerate().map(end).collect();
    for (number, &first) in first.iter().enumerate().filter(|(number, first)| number != *first) {
        let Start { ended, cost, .. } = starts[first].clone();
        (starts[number].ended, starts[number].cost) = (ended, cost);
    }
    starts
}

/// Searches from these values of the free parameters, to the last digits.
pub(super) fn search_from(evaluator: Evaluator, began: Vec<f64>) -> Start {
    Approach::new(evaluator, began).finish()
}

/// A search that lacks the last digits.
struct Approach<'o> {
    began: Vec<f64>,
    evaluator: Evaluator<'o>,
    iterate: Iterate,
}

impl<'o> Approach<'o> {
    /// The larger part of the search, by coarse motions.
    fn new(mut evaluator: Evaluator<'o>, began: Vec<f64>) -> Self {
        let [(accuracy, tolerance), finer @ ..] = APPROACH;
        let is_free = !evaluator.parameters.is_empty();
        evaluator.accuracy = if is_free { accuracy } else { FIT_ACCURACY };
        let mut iterate = Iterate::begin(&mut evaluator, began.clone());
        if is_free {
            iterate = iterate.run(&mut evaluator, tolerance, false, &Ended::default());
            for (accuracy, tolerance) in finer {
                iterate = iterate.with_accuracy(&mut evaluator, accuracy);
                iterate = iterate.run(&mut evaluator, tolerance, false, &Ended::default());
            }
        }
        Self { began, evaluator, iterate }
    }

    /// Whether the last iterations would lead to where they lead another search.
    fn is_near(&self, other: &Self) -> bool {
        let (here, there) = (&self.iterate, &other.iterate);
        let mut both = here.values.iter().zip(&there.values);
        (here.cost - there.cost).abs() <= SAME_COST * there.cost
            && both.all(|(a, b)| (a / b).ln().abs() <= SAME_VALUE)
    }

    /// The last digits, by motions that have them.
    fn finish(mut self) -> Start {
        if self.evaluator.parameters.is_empty() {
            return self.start(Stopped::NothingFree);
        }
        let mut iterate = self.iterate.with_accuracy(&mut self.evaluator, REFERENCE_ACCURACY);
        for _ in 0..MOST_EXPANSIONS {
            iterate = iterate.run(&mut self.evaluator, CONVERGED, true, &Ended::default());
            let cost = iterate.cost;
            if self.evaluator.has_expansions() {
                iterate = iterate.expand(&mut self.evaluator);
            }
            if (iterate.cost - cost).abs() <= EXPANDED * cost {
                break;
            }
        }
        self.iterate = iterate;
        let stopped = self.iterate.stopped;
        self.start(stopped)
    }

    fn start(self, stopped: Stopped) -> Start {
        let Self { began, evaluator, iterate: Iterate { values: ended, cost, .. } } = self;
        Start { began, ended, cost, solves: evaluator.solves, stopped }
    }
}

/// Where a start begins.
fn begin(objective: &Objective, parameters: &[FreeParameter], number: usize) -> Vec<f64> {
    const BASES: [u32; 8] = [2, 3, 5, 7, 11, 13, 17, 19];
    parameters
        .iter()
        .zip(BASES.into_iter().cycle())
        .map(|(free, base)| {
            let [low, high] = free.bounds;
            let configured = free.parameter.of(&objective.robot);
            if number == 0 && configured > low && configured < high {
                return configured;
            }
            // Half of what would reach the bounds is left free on either side.
            let part = 0.05 + 0.9 * radical_inverse(number as u32 + 1, base);
            low * (high / low).powf(part)
        })
        .collect()
}

/// Halton's low-discrepancy sequence.
fn radical_inverse(mut number: u32, base: u32) -> f64 {
    let (mut inverse, mut digit) = (0.0, 1.0 / f64::from(base));
    while number > 0 {
        inverse += f64::from(number % base) * digit;
        number /= base;
        digit /= f64::from(base);
    }
    inverse
}
