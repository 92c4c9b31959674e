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
use rayon::prelude::*;

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
pub(super) const CONVERGED: f64 = 1e-11;
/// Accuracies of the motions before those of the last steps, and when they have done their part.
const ON_THE_WAY: [(f64, f64); 2] = [(1e-4, 1e-3), (FIT_ACCURACY, 1e-6)];
/// A search that ended like this has found a minimum.
pub(super) const HAS_CONVERGED: &str = "converged";
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
        let mut descent = Descent { evaluator: &mut evaluator, come, held: None };
        descent.with_accuracy(REFERENCE_ACCURACY);
        let has_converged = descent.run(CONVERGED);
        let stopped = descent.stopped(has_converged).to_owned();
        let Come { place: ended, cost, .. } = descent.come;
        Start { began, ended, cost, solves: evaluator.solves(), stopped }
    }
}

/// How far a search has come.
#[derive(Debug, Clone)]
pub(super) struct Come {
    pub place: Vec<f64>,
    pub cost: f64,
    terms: Vec<Term>,
    curvature: Curvature,
    /// Largest change of a parameter's logarithm.
    region: f64,
}

impl Come {
    fn new(place: Vec<f64>, here: Linearised) -> Self {
        let Linearised { cost, terms } = here;
        Self { place, cost, terms, curvature: Curvature::default(), region: FIRST_REGION }
    }
}

/// A search on its way.
pub(super) struct Descent<'d, 'o> {
    evaluator: &'d mut Evaluator<'o>,
    pub come: Come,
    /// A parameter that stays as it is.
    held: Option<usize>,
}

impl<'d, 'o> Descent<'d, 'o> {
    /// A search that begins at `place`.
    pub fn new(evaluator: &'d mut Evaluator<'o>, place: Vec<f64>) -> Self {
        let here = evaluator.linearised(&place);
        Self::from(evaluator, place, here)
    }

    /// A search that begins at `place`, where the objective is known.
    pub fn from(evaluator: &'d mut Evaluator<'o>, place: Vec<f64>, here: Linearised) -> Self {
        Self { evaluator, come: Come::new(place, here), held: None }
    }

    /// Goes on with motions of another accuracy, from where the last step would have led that
    /// promised too little to be taken.
    fn with_accuracy(&mut self, accuracy: f64) {
        self.evaluator.accuracy = accuracy;
        let parameters = self.evaluator.parameters.clone();
        let (step, _) = self.best_step(&parameters);
        self.come.place = self.place_after(&parameters, &step);
        let here = self.evaluator.linearised(&self.come.place);
        (self.come.cost, self.come.terms) = (here.cost, here.terms);
    }

    /// The same with one parameter that stays as it is.
    pub fn holding(self, place: usize) -> Self {
        Self { held: Some(place), ..self }
    }

    /// Goes on until the objective can hardly fall, relative to itself; `false` if that takes
    /// too many steps. The terms may be left behind.
    pub fn run(&mut self, converged: f64) -> bool {
        self.descend(converged, true)
    }

    /// Goes on until the objective can hardly fall; `is_last` if nothing goes on from there, so
    /// that the terms are not needed where the objective is as low as they promised.
    fn descend(&mut self, converged: f64, is_last: bool) -> bool {
        let parameters = self.evaluator.parameters.clone();
        if parameters.len() == usize::from(self.held.is_some()) {
            return true;
        }
        for _ in 0..MOST_STEPS {
            crate::interrupt::stop_if_asked(String::new);
            let (step, expected) = self.best_step(&parameters);
            let cost = self.come.cost;
            if expected <= converged * cost {
                return true;
            }
            let next = self.place_after(&parameters, &step);
            let metrics = self.evaluator.metrics(&next);
            let found = self.evaluator.objective.cost(&metrics);
            let is_free = step.amax() < 0.9 * self.come.region;
            if is_last && is_free && (found - (cost - expected)).abs() <= converged * cost {
                (self.come.place, self.come.cost) = (next, found);
                return true;
            }
            let found = self.evaluator.linearised_at(&next, &metrics);
            let come = &mut self.come;
            come.curvature.learn(&come.terms, &found.terms, step.as_slice());
            let kept = (cost - found.cost) / expected;
            if kept < 0.25 {
                come.region = 0.3 * come.region.min(step.amax());
            } else if kept > 0.75 {
                come.region = (2.0 * come.region).min(LARGEST_REGION);
            }
            if found.cost < cost {
                (come.place, come.cost, come.terms) = (next, found.cost, found.terms);
            }
        }
        false
    }

    /// Why it stopped.
    pub fn stopped(&self, has_converged: bool) -> &'static str {
        match has_converged {
            _ if self.come.cost >= PENALTY => "no motion exists here",
            true => HAS_CONVERGED,
            false => "too many steps",
        }
    }

    /// The step of the parameters' logarithms to take next, and the fall that it promises.
    fn best_step(&self, parameters: &[Parameter]) -> (DVector<f64>, f64) {
        let limits = limits(parameters, &self.come.place, self.come.region);
        self.come.curvature.best_step(&self.come.terms, &limits, self.held)
    }

    /// The parameters' values after a step of their logarithms.
    fn place_after(&self, parameters: &[Parameter], step: &DVector<f64>) -> Vec<f64> {
        parameters
            .iter()
            .zip(self.come.place.iter().zip(step.iter()))
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
