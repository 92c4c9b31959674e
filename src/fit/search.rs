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

use super::absolute::{Term, minimise};
use super::coefficient::{Coefficient, Parameter};
use super::curvature::Curvature;
use super::objective::{Evaluator, Linearised, Objective, PENALTY};
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
pub(super) const CONVERGED: f64 = 1e-9;
/// Accuracies of the motions before those of the last steps, and when they have done their part.
const ON_THE_WAY: [(f64, f64); 2] = [(1e-4, 1e-3), (FIT_ACCURACY, 1e-6)];
/// A search that ended like this has found a minimum.
pub(super) const HAS_CONVERGED: &str = "converged";
pub(super) const NOTHING_FREE: &str = "nothing is free";

/// Searches from the start with this number: 0 is the configured robot, the others are spread
/// over the bounds. Without parameters there is one evaluation.
pub fn search(objective: &Objective, parameters: &[Parameter], number: usize) -> Start {
    let began = begin(objective, parameters, number);
    search_from(objective.evaluator(parameters.to_vec()), began)
}

/// Searches from these values of the free parameters, to the last digits.
pub(super) fn search_from(mut evaluator: Evaluator, began: Vec<f64>) -> Start {
    if evaluator.parameters.is_empty() {
        let cost = evaluator.cost(&[]);
        let stopped = NOTHING_FREE.to_owned();
        return Start { ended: began.clone(), began, cost, solves: evaluator.solves(), stopped };
    }
    // Most of the way by coarse motions, the last digits by motions that have them.
    let [(accuracy, converged), on_the_way @ ..] = ON_THE_WAY;
    evaluator.accuracy = accuracy;
    let mut descent = Descent::new(&mut evaluator, began.clone());
    descent.run(converged);
    for (accuracy, converged) in on_the_way {
        descent.with_accuracy(accuracy);
        descent.run(converged);
    }
    descent.with_accuracy(REFERENCE_ACCURACY);
    let has_converged = descent.run(CONVERGED);
    let stopped = descent.stopped(has_converged).to_owned();
    let Descent { place: ended, cost, .. } = descent;
    Start { began, ended, cost, solves: evaluator.solves(), stopped }
}

/// A search on its way.
pub(super) struct Descent<'d, 'o> {
    evaluator: &'d mut Evaluator<'o>,
    pub place: Vec<f64>,
    pub cost: f64,
    terms: Vec<Term>,
    curvature: Curvature,
    /// A parameter that stays as it is.
    held: Option<usize>,
    /// Largest change of a parameter's logarithm.
    region: f64,
}

impl<'d, 'o> Descent<'d, 'o> {
    /// A search that begins at `place`.
    pub fn new(evaluator: &'d mut Evaluator<'o>, place: Vec<f64>) -> Self {
        let here = evaluator.linearised(&place);
        Self::from(evaluator, place, here)
    }

    /// A search that begins at `place`, where the objective is known.
    pub fn from(evaluator: &'d mut Evaluator<'o>, place: Vec<f64>, here: Linearised) -> Self {
        let Linearised { cost, terms } = here;
        let curvature = Curvature::default();
        Self { evaluator, place, cost, terms, curvature, held: None, region: FIRST_REGION }
    }

    /// Goes on with motions of another accuracy, from where the last step would have led that
    /// promised too little to be taken.
    fn with_accuracy(&mut self, accuracy: f64) {
        self.evaluator.accuracy = accuracy;
        let parameters = self.evaluator.parameters.clone();
        let (step, _) = self.best_step(&parameters);
        self.place = self.place_after(&parameters, &step);
        let here = self.evaluator.linearised(&self.place);
        (self.cost, self.terms) = (here.cost, here.terms);
    }

    /// The same with one parameter that stays as it is.
    pub fn holding(self, place: usize) -> Self {
        Self { held: Some(place), ..self }
    }

    /// Goes on until the objective can hardly fall, relative to itself; `false` if that takes
    /// too many steps.
    pub fn run(&mut self, converged: f64) -> bool {
        let parameters = self.evaluator.parameters.clone();
        if parameters.len() == usize::from(self.held.is_some()) {
            return true;
        }
        for _ in 0..MOST_STEPS {
            crate::interrupt::stop_if_asked(String::new);
            let (step, expected) = self.best_step(&parameters);
            if expected <= converged * self.cost {
                return true;
            }
            let next = self.place_after(&parameters, &step);
            let found = self.evaluator.linearised(&next);
            self.curvature.learn(&self.terms, &found.terms, step.as_slice());
            let kept = (self.cost - found.cost) / expected;
            if kept < 0.25 {
                self.region = 0.3 * self.region.min(step.amax());
            } else if kept > 0.75 {
                self.region = (2.0 * self.region).min(LARGEST_REGION);
            }
            if found.cost < self.cost {
                (self.place, self.cost, self.terms) = (next, found.cost, found.terms);
            }
        }
        false
    }

    /// Why it stopped.
    pub fn stopped(&self, has_converged: bool) -> &'static str {
        match has_converged {
            _ if self.cost >= PENALTY => "no motion exists here",
            true => HAS_CONVERGED,
            false => "too many steps",
        }
    }

    /// The step of the parameters' logarithms to take next, and the fall that it promises.
    fn best_step(&self, parameters: &[Parameter]) -> (DVector<f64>, f64) {
        let limits = limits(parameters, &self.place, self.region);
        self.curvature.best_step(&self.terms, &limits, self.held)
    }

    /// The parameters' values after a step of their logarithms.
    fn place_after(&self, parameters: &[Parameter], step: &DVector<f64>) -> Vec<f64> {
        parameters
            .iter()
            .zip(self.place.iter().zip(step.iter()))
            .map(|(parameter, (value, step))| {
                let [low, high] = parameter.bounds;
                if *step == 0.0 { *value } else { (value * step.exp()).clamp(low, high) }
            })
            .collect()
    }
}

/// How far the parameters' logarithms may go from `place` within the bounds and a region.
pub(super) fn limits(parameters: &[Parameter], place: &[f64], region: f64) -> Vec<[f64; 2]> {
    let limit = |(parameter, value): (&Parameter, &f64)| {
        let [low, high] = parameter.bounds.map(|bound| (bound / value).ln());
        [low.clamp(-region, 0.0), high.clamp(0.0, region)]
    };
    parameters.iter().zip(place).map(limit).collect()
}

/// The step that minimises the linearised terms; that of a held parameter is 0.
pub(super) fn linear_step(
    terms: &[Term],
    limits: &[[f64; 2]],
    held: Option<usize>,
) -> DVector<f64> {
    let Some(held) = held else { return minimise(terms, limits) };
    if limits.len() == 1 {
        return DVector::zeros(1);
    }
    let mut others = limits.to_vec();
    others.remove(held);
    let mut terms = terms.to_vec();
    for term in &mut terms {
        term.slope.remove(held);
    }
    minimise(&terms, &others).insert_row(held, 0.0)
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

/// Relative distance from a bound that counts as at it.
const AT_BOUND: f64 = 1e-3;

/// To which of its bounds a parameter's value has come: lower, upper.
pub(super) fn is_at_bound(parameter: &Parameter, value: f64) -> [bool; 2] {
    let [low, high] = parameter.bounds;
    [value < low * (1.0 + AT_BOUND), value > high * (1.0 - AT_BOUND)]
}

/// The parameters that are at a bound.
pub(super) fn at_bound(parameters: &[Parameter], values: &[f64]) -> Vec<Coefficient> {
    let both = parameters.iter().zip(values);
    both.filter(|(parameter, value)| is_at_bound(parameter, **value).contains(&true))
        .map(|(parameter, _)| parameter.coefficient)
        .collect()
}
