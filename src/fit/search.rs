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
use super::objective::{Evaluator, Linearised, PENALTY};

const MOST_STEPS: usize = 200;
/// Trust region at first and at most: coefficients may change by these factors' logarithms.
const FIRST_REGION: f64 = 1.0;
const LARGEST_REGION: f64 = 3.0;
/// And at least when the motions become more accurate.
const NEXT_REGION: f64 = 0.1;
/// Fall of the objective, relative to it, below which it has converged.
pub(super) const CONVERGED: f64 = 1e-11;
/// Shortest step, as a multiple of the motions' accuracy, that the curvature is learnt from.
const TELLING: f64 = 10.0;
/// A search that ended like this has found a minimum.
pub(super) const HAS_CONVERGED: &str = "converged";
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
    pub fn new(place: Vec<f64>, here: Linearised) -> Self {
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
        Self::going_on(evaluator, Come::new(place, here))
    }

    /// A search that goes on from where it has come.
    pub fn going_on(evaluator: &'d mut Evaluator<'o>, come: Come) -> Self {
        Self { evaluator, come, held: None }
    }

    /// Goes on with motions of another accuracy, from where the last step would have led that
    /// promised too little to be taken.
    pub fn with_accuracy(&mut self, accuracy: f64) {
        self.evaluator.accuracy = accuracy;
        let parameters = self.evaluator.parameters.clone();
        let (step, _) = self.best_step(&parameters);
        self.come.place = self.place_after(&parameters, &step);
        let here = self.evaluator.linearised(&self.come.place);
        (self.come.cost, self.come.terms) = (here.cost, here.terms);
        // What coarse motions could not tell may have closed the region.
        self.come.region = self.come.region.max(NEXT_REGION);
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
    pub fn descend(&mut self, converged: f64, is_last: bool) -> bool {
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
            // Slopes that differ by no more than their inaccuracy tell nothing of the curvature.
            if step.amax() > TELLING * self.evaluator.accuracy {
                come.curvature.learn(&come.terms, &found.terms, step.as_slice());
            }
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
