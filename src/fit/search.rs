//! The search for the free coefficients.
//!
//! Nelder and Mead's simplex in the coefficients' logarithms, which the objective's kinks (it
//! is a sum of absolute values) do not disturb, from several starts. The bounds are met by a
//! logistic transform.

use std::cell::RefCell;

use argmin::core::{CostFunction, Executor, State, TerminationReason, TerminationStatus};
use argmin::solver::neldermead::NelderMead;

use super::objective::{Coefficient, Evaluator, Objective, Parameter};

/// One run of the search.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Start {
    pub began: Vec<f64>,
    pub ended: Vec<f64>,
    pub cost: f64,
    pub solves: usize,
    /// Why the search stopped.
    pub stopped: String,
}

/// Simplices one after the other, each from where the last one ended: edge lengths in the
/// transformed coefficients.
const EDGES: [f64; 3] = [0.6, 0.1, 0.02];
const MOST_ITERATIONS: u64 = 300;
/// Spread of the objective over the simplex at which it has converged.
const SPREAD: f64 = 1e-9;

/// Searches from the start with this number: 0 is the configured robot, the others are spread
/// over the bounds. Without parameters there is one evaluation.
pub(super) fn search(objective: &Objective, parameters: &[Parameter], number: usize) -> Start {
    let began = begin(objective, parameters, number);
    let mut evaluator = objective.evaluator(parameters.to_vec());
    if parameters.is_empty() {
        let cost = evaluator.cost(&[]);
        let stopped = "nothing is free".to_owned();
        return Start { ended: began.clone(), began, cost, solves: evaluator.solves(), stopped };
    }
    let mut place: Vec<f64> = parameters
        .iter()
        .zip(&began)
        .map(|(parameter, value)| to_free(parameter, *value))
        .collect();
    let problem = Free(RefCell::new(evaluator));
    let (mut cost, mut stopped) = (f64::INFINITY, String::new());
    for edge in EDGES {
        let run = simplex(&place, edge).and_then(|solver| {
            Executor::new(&problem, solver)
                .configure(|state| state.max_iters(MOST_ITERATIONS))
                .ctrlc(false)
                .run()
        });
        match run {
            Ok(result) => {
                stopped = reason(result.state().get_termination_status());
                if let Some(best) = result.state().get_best_param()
                    && result.state().get_best_cost() <= cost
                {
                    cost = result.state().get_best_cost();
                    place = best.clone();
                }
            }
            Err(error) => {
                stopped = format!("failed: {error}");
                break;
            }
        }
    }
    let evaluator = problem.0.into_inner();
    let ended =
        parameters.iter().zip(&place).map(|(parameter, z)| from_free(parameter, *z)).collect();
    Start { began, ended, cost, solves: evaluator.solves(), stopped }
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

fn simplex(place: &[f64], edge: f64) -> Result<NelderMead<Vec<f64>, f64>, argmin::core::Error> {
    let mut corners = vec![place.to_vec()];
    for i in 0..place.len() {
        let mut corner = place.to_vec();
        corner[i] += edge;
        corners.push(corner);
    }
    NelderMead::new(corners).with_sd_tolerance(SPREAD)
}

fn reason(status: &TerminationStatus) -> String {
    match status {
        TerminationStatus::Terminated(TerminationReason::SolverConverged) => "converged".into(),
        TerminationStatus::Terminated(TerminationReason::MaxItersReached) => {
            format!("{MOST_ITERATIONS} iterations")
        }
        other => other.to_string(),
    }
}

/// The objective of the transformed coefficients.
struct Free<'a>(RefCell<Evaluator<'a>>);

impl CostFunction for &Free<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, place: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        let mut evaluator = self.0.borrow_mut();
        let values: Vec<f64> = evaluator
            .parameters
            .iter()
            .zip(place)
            .map(|(parameter, z)| from_free(parameter, *z))
            .collect();
        Ok(evaluator.cost(&values))
    }
}

/// From between the bounds to the real line: the logit of the place on the logarithmic scale.
fn to_free(parameter: &Parameter, value: f64) -> f64 {
    let [low, high] = parameter.bounds;
    let part = ((value / low).ln() / (high / low).ln()).clamp(1e-9, 1.0 - 1e-9);
    (part / (1.0 - part)).ln()
}

fn from_free(parameter: &Parameter, z: f64) -> f64 {
    let [low, high] = parameter.bounds;
    (low * (high / low).powf(1.0 / (1.0 + (-z).exp()))).clamp(low, high)
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
