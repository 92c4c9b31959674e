//! The search for the free coefficients.
//!
//! The objective is a sum of absolute values, and its minimum lies where several of them have
//! their kinks. Each step minimises the sum of the linearised terms, kinks and all, within a
//! trust region in the coefficients' logarithms: near a vertex of kinks the steps converge like
//! Newton's.
//!
//! Reference: R. Fletcher, *Practical Methods of Optimization*, 2nd ed., Wiley 1987, section
//! 14.4.

use nalgebra::DVector;

use super::absolute::{minimise, sum};
use super::objective::{Coefficient, Evaluator, Objective, PENALTY, Parameter};
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

const MOST_STEPS: usize = 200;
/// Trust region at first and at most: coefficients may change by these factors' logarithms.
const FIRST_REGION: f64 = 1.0;
const LARGEST_REGION: f64 = 3.0;
/// Fall of the objective, relative to it, below which it has converged.
const CONVERGED: f64 = 1e-9;

/// Searches from the start with this number: 0 is the configured robot, the others are spread
/// over the bounds. Without parameters there is one evaluation.
pub fn search(objective: &Objective, parameters: &[Parameter], number: usize) -> Start {
    let began = begin(objective, parameters, number);
    let mut evaluator = objective.evaluator(parameters.to_vec());
    if parameters.is_empty() {
        let cost = evaluator.cost(&[]);
        let stopped = "nothing is free".to_owned();
        return Start { ended: began.clone(), began, cost, solves: evaluator.solves(), stopped };
    }
    let mut descent = Descent {
        place: began.clone(),
        cost: f64::INFINITY,
        region: FIRST_REGION,
        evaluator: &mut evaluator,
    };
    descent.run(FIT_ACCURACY);
    // The last digits by motions that have them.
    let has_converged = descent.run(REFERENCE_ACCURACY);
    let Descent { place, cost, .. } = descent;
    let stopped = match has_converged {
        _ if cost >= PENALTY => "no motion exists here",
        true => "converged",
        false => "too many steps",
    };
    let stopped = stopped.to_owned();
    Start { began, ended: place, cost, solves: evaluator.solves(), stopped }
}

/// A search on its way.
struct Descent<'d, 'o> {
    evaluator: &'d mut Evaluator<'o>,
    place: Vec<f64>,
    cost: f64,
    /// Largest change of a parameter's logarithm.
    region: f64,
}

impl Descent<'_, '_> {
    /// Goes on, with motions of this accuracy, until the objective can hardly fall; `false` if
    /// that takes too many steps.
    fn run(&mut self, accuracy: f64) -> bool {
        self.evaluator.accuracy = accuracy;
        let parameters = self.evaluator.parameters.clone();
        let (cost, mut terms) = self.evaluator.linearised(&self.place);
        self.cost = cost;
        for _ in 0..MOST_STEPS {
            let step = minimise(&terms, &self.limits(&parameters));
            let expected = sum(&terms, &DVector::zeros(step.len())) - sum(&terms, &step);
            if expected <= CONVERGED * self.cost {
                return true;
            }
            let next: Vec<f64> = parameters
                .iter()
                .zip(self.place.iter().zip(step.iter()))
                .map(|(parameter, (value, step))| {
                    let [low, high] = parameter.bounds;
                    (value * step.exp()).clamp(low, high)
                })
                .collect();
            let (next_cost, next_terms) = self.evaluator.linearised(&next);
            let kept = (self.cost - next_cost) / expected;
            if kept < 0.25 {
                self.region = 0.3 * self.region.min(step.amax());
            } else if kept > 0.75 {
                self.region = (2.0 * self.region).min(LARGEST_REGION);
            }
            if next_cost < self.cost {
                (self.place, self.cost, terms) = (next, next_cost, next_terms);
            }
        }
        false
    }

    /// How far the parameters' logarithms may go from where they are.
    fn limits(&self, parameters: &[Parameter]) -> Vec<[f64; 2]> {
        let limit = |(parameter, value): (&Parameter, &f64)| {
            let [low, high] = parameter.bounds.map(|bound| (bound / value).ln());
            [low.clamp(-self.region, 0.0), high.clamp(0.0, self.region)]
        };
        parameters.iter().zip(&self.place).map(limit).collect()
    }
}

/// Where a start begins.
fn begin(objective: &Objective, parameters: &[Parameter], number: usize) -> Vec<f64> {
    const BASES: [u32; 6] = [2, 3, 5, 7, 11, 13];
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

/// What is to be said of the fitted coefficients.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Marks {
    /// Hardly move the objective.
    pub insensitive: Vec<Coefficient>,
    pub at_bound: Vec<Coefficient>,
}

/// A coefficient is insensitive when changing it by this factor, up or down, moves the
/// objective by less than [`SLIGHT`] of its value or than the measurements' own error.
const FACTOR: f64 = 1.2;
const SLIGHT: f64 = 0.01;
/// Relative distance from a bound that counts as at it.
const AT_BOUND: f64 = 1e-3;

/// Marks the coefficients that the objective does not tell.
pub(super) fn marks(evaluator: &mut Evaluator, values: &[f64]) -> Marks {
    let mut marks = Marks::default();
    let cost = evaluator.cost(values);
    let slight = (SLIGHT * cost).max(evaluator.objective.standard_error());
    for (i, parameter) in evaluator.parameters.clone().iter().enumerate() {
        let moves = [FACTOR, 1.0 / FACTOR].iter().any(|factor| {
            let mut changed = values.to_vec();
            changed[i] *= factor;
            evaluator.cost(&changed) - cost > slight
        });
        if !moves {
            marks.insensitive.push(parameter.coefficient);
        }
        let [low, high] = parameter.bounds;
        if values[i] < low * (1.0 + AT_BOUND) || values[i] > high * (1.0 - AT_BOUND) {
            marks.at_bound.push(parameter.coefficient);
        }
    }
    marks
}
