//! Searches from starts that are spread over the bounds.

use rayon::prelude::*;

use super::coefficient::Parameter;
use super::objective::{Evaluator, Objective};
use super::search::{CONVERGED, Come, Descent};
use crate::motion::{FIT_ACCURACY, REFERENCE_ACCURACY};

/// One run of the search.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Values of the free parameters, in their order.
    pub began: Vec<f64>,
    pub ended: Vec<f64>,
    /// Eq. 22 where it ended.
    pub cost: f64,
    /// Steady motions solved for.
    pub solves: usize,
    /// Why the search stopped.
    pub stopped: String,
}

/// Accuracies of the motions before those of the last steps, and when they have done their part.
const ON_THE_WAY: [(f64, f64); 2] = [(1e-4, 1e-3), (FIT_ACCURACY, 1e-6)];
/// A search without anything to search for.
pub(super) const NOTHING_FREE: &str = "nothing is free";
/// A search that has come to where one with a lower number goes on from, and ends where that does.
pub(super) const JOINED: &str = "joined an earlier start";
/// Largest difference of a parameter's logarithm, and of the objective relative to itself, of
/// places that are the same before the last steps. These go much less far, and neighbouring
/// minima are further apart.
const SAME_PLACE: f64 = 1e-3;
const SAME_COST: f64 = 1e-5;

/// Searches from the start with this number: 0 is the configured robot, the others are spread
/// over the bounds. Without parameters there is one evaluation.
pub fn search(objective: &Objective, parameters: &[Parameter], number: usize) -> Start {
    let began = begin(objective, parameters, number);
    search_from(objective.evaluator(parameters.to_vec()), began)
}

/// Searches from the first `count` starts. Of those that come to the same place only the first
/// takes the last, most accurate steps.
pub(super) fn search_all(
    objective: &Objective,
    parameters: &[Parameter],
    count: usize,
) -> Vec<Start> {
    let come: Vec<Approach> = (0..count)
        .into_par_iter()
        .map(|number| {
            let began = begin(objective, parameters, number);
            Approach::new(objective.evaluator(parameters.to_vec()), began)
        })
        .collect();
    // In the order of their numbers, whatever the order in which they have come.
    let mut first: Vec<usize> = Vec::new();
    for (number, approach) in come.iter().enumerate() {
        let mut earlier = (0..number).filter(|&earlier| first[earlier] == earlier);
        first.push(earlier.find(|&earlier| approach.is_at(&come[earlier])).unwrap_or(number));
    }
    let end = |(number, approach): (usize, Approach)| match first[number] == number {
        true => approach.finish(),
        false => approach.join(),
    };
    let mut starts: Vec<Start> = come.into_par_iter().enumerate().map(end).collect();
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
    come: Come,
}

impl<'o> Approach<'o> {
    /// Most of the way by coarse motions.
    fn new(mut evaluator: Evaluator<'o>, began: Vec<f64>) -> Self {
        if evaluator.parameters.is_empty() {
            evaluator.accuracy = FIT_ACCURACY;
            let come = Come::new(Vec::new(), evaluator.linearised(&[]));
            return Self { began, evaluator, come };
        }
        let [(accuracy, converged), on_the_way @ ..] = ON_THE_WAY;
        evaluator.accuracy = accuracy;
        let mut descent = Descent::new(&mut evaluator, began.clone());
        descent.descend(converged, false);
        for (accuracy, converged) in on_the_way {
            descent.with_accuracy(accuracy);
            descent.descend(converged, false);
        }
        let come = descent.come;
        Self { began, evaluator, come }
    }

    /// Whether the last steps would lead to where they lead another search.
    fn is_at(&self, other: &Self) -> bool {
        let (here, there) = (&self.come, &other.come);
        let mut both = here.place.iter().zip(&there.place);
        (here.cost - there.cost).abs() <= SAME_COST * there.cost
            && both.all(|(a, b)| (a / b).ln().abs() <= SAME_PLACE)
    }

    /// A search that leaves the last steps to another one.
    fn join(self) -> Start {
        let Self { began, evaluator, come: Come { place: ended, cost, .. } } = self;
        Start { began, ended, cost, solves: evaluator.solves(), stopped: JOINED.to_owned() }
    }

    /// The last digits, by motions that have them.
    fn finish(self) -> Start {
        let Self { began, mut evaluator, come } = self;
        if evaluator.parameters.is_empty() {
            let stopped = NOTHING_FREE.to_owned();
            let (cost, solves) = (come.cost, evaluator.solves());
            return Start { ended: began.clone(), began, cost, solves, stopped };
        }
        let mut descent = Descent::going_on(&mut evaluator, come);
        descent.with_accuracy(REFERENCE_ACCURACY);
        let has_converged = descent.run(CONVERGED);
        let stopped = descent.stopped(has_converged).to_owned();
        let Come { place: ended, cost, .. } = descent.come;
        Start { began, ended, cost, solves: evaluator.solves(), stopped }
    }
}

/// Where a start begins.
fn begin(objective: &Objective, parameters: &[Parameter], number: usize) -> Vec<f64> {
    const BASES: [u32; 8] = [2, 3, 5, 7, 11, 13, 17, 19];
    parameters
        .iter()
        .zip(BASES.into_iter().cycle())
        .map(|(parameter, base)| {
            let [low, high] = parameter.bounds;
            let configured = parameter.coefficient.of(objective.robot());
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
