//! Local optimisation by sequential quadratic programming (SQP).
//!
//! Each step solves a quadratic program that consists of the cost, with a BFGS approximation of the Hessian, and the
//! linearised limits. A line search on an exact penalty function (merit function) determines the step length. argmin's
//! own solvers support neither ranges nor limits.
//!
//! Reference: J. Nocedal and S. J. Wright, *Numerical Optimization*, 2nd ed., Springer 2006, sections 18.1 to 18.5.

use argmin::argmin_error;
use argmin::core::{
    Error, Executor, IterState, KV, OptimizationResult, Problem, Solver, State as _,
    TerminationReason,
};

use super::landscape::{Evaluation, Landscape, Position};
use super::quadratic::{Hessian, QuadraticProgram};

const MAX_STEPS: u64 = 120;
/// Predicted relative improvement of the objective below which the search has converged.
const CONVERGED: f64 = 1e-12;
/// Tolerance of the sufficient-decrease condition for errors in the merit, divided by the accuracy of the solver.
const NOISE: f64 = 1e-3;
/// Magnitude below which a gradient or a multiplier counts as zero.
const EPSILON: f64 = 1e-12;
/// Maximum length of the first step as a fraction of the ranges.
const MAX_FIRST_STEP: f64 = 0.1;
/// Maximum length of every step after the first as a fraction of the ranges.
const MAX_STEP: f64 = 0.5;
/// Fraction of the predicted decrease that a step must achieve (Armijo condition).
const ARMIJO: f64 = 1e-4;
/// Minimum step length in the line search.
const MIN_STEP_LENGTH: f64 = 1e-5;
/// Factor on the step length if there is no periodic solution at the end of the step.
const NO_MOTION: f64 = 0.1;
/// Minimum predicted decrease that can be resolved in the merit, divided by the accuracy of the solver.
const MEASURABLE: f64 = 0.1;
/// Minimum curvature along a step, as a fraction of the previous Hessian's curvature (Powell's damped BFGS update).
const MIN_CURVATURE: f64 = 0.2;
/// Maximum excess over a limit at an optimum, relative to the limit.
const MAX_EXCESS: f64 = 1e-9;
const INITIAL_PENALTY: f64 = 10.0;
/// Factor on the penalty if a limit is still exceeded at convergence.
const PENALTY_GROWTH: f64 = 10.0;
const MAX_PENALTY: f64 = 1e8;

type State = IterState<Position, (), (), (), (), f64>;

/// Result of a local search.
#[derive(Debug, Clone)]
pub(super) struct LocalOptimum {
    pub position: Position,
    pub point: Evaluation,
    pub hessian: Hessian,
}

/// Minimises the cost from a start, with the given initial Hessian if any; returns `None` if there is no periodic
/// solution at the start, or if a limit is exceeded at the end.
pub(super) fn minimise(
    landscape: &mut Landscape,
    start: Position,
    hessian: Option<Hessian>,
) -> Option<LocalOptimum> {
    landscape.penalty = INITIAL_PENALTY;
    landscape.only_near = true;
    let point = landscape.evaluate(&start)?;
    let is_first = hessian.is_none();
    let hessian = hessian.unwrap_or_else(|| initial_hessian(&point));
    let cost = landscape.merit(&point);
    let solver = SequentialQuadratic { point, hessian, is_first };
    let result = Executor::new(landscape, solver)
        .configure(|state| state.param(start).cost(cost).max_iters(MAX_STEPS))
        .timer(false)
        .ctrlc(false)
        .run();
    let OptimizationResult { solver, state, .. } = result.ok()?;
    let SequentialQuadratic { point, hessian, .. } = solver;
    let is_within = point.excess.iter().all(|excess| *excess <= MAX_EXCESS);
    Some(LocalOptimum { position: state.param.filter(|_| is_within)?, point, hessian })
}

/// Returns the initial Hessian, a multiple of the identity, so that the first step follows the gradient.
fn initial_hessian(point: &Evaluation) -> Hessian {
    identity(&point.gradient) * (point.gradient.amax() / MAX_FIRST_STEP).max(EPSILON)
}

/// Returns the identity matrix with as many rows as a position.
fn identity(position: &Position) -> Hessian {
    Hessian::identity(position.len(), position.len())
}

/// Sequential quadratic programming as an argmin solver.
struct SequentialQuadratic {
    point: Evaluation,
    /// BFGS approximation of the Hessian of the Lagrangian.
    hessian: Hessian,
    /// Whether the Hessian still has its initial value.
    is_first: bool,
}

impl SequentialQuadratic {
    /// Solves the quadratic program for given excesses over the limits; returns the step and the multipliers of the
    /// limits.
    fn solve_subproblem(
        &self,
        landscape: &Landscape,
        position: &Position,
        excess: &[f64],
    ) -> (Position, Vec<f64>) {
        let longest = if self.is_first { MAX_FIRST_STEP } else { MAX_STEP };
        let program = QuadraticProgram {
            count: landscape.count(),
            gradient: &self.point.gradient,
            hessian: &self.hessian,
            low: position.map(|coordinate| (-coordinate).max(-longest)),
            high: position.map(|coordinate| (1.0 - coordinate).min(longest)),
            excess,
            slopes: &self.point.excess_gradients,
            penalty: landscape.penalty,
        };
        program.solve()
    }

    /// Predicts the change in the merit for a step: to first order, and with the quadratic term.
    fn predict_change(&self, landscape: &Landscape, step: &Position) -> [f64; 2] {
        let Evaluation { gradient, excess, excess_gradients, .. } = &self.point;
        let mut change = gradient.dot(step);
        for (excess, slope) in excess.iter().zip(excess_gradients) {
            if excess.is_finite() {
                let after = excess + slope.dot(step);
                change += landscape.penalty * (after.max(0.0) - excess.max(0.0));
            }
        }
        [change, change + 0.5 * step.dot(&(&self.hessian * step))]
    }

    /// Returns the full step with a second-order correction for the limits on joint angles and rates, whose values at
    /// the end of the step are known without solving the model; `None` if the linearised limits are accurate.
    fn correct_step(
        &self,
        landscape: &Landscape,
        position: &Position,
        step: &Position,
        multipliers: &[f64],
    ) -> Option<Position> {
        let Evaluation { excess, excess_gradients, .. } = &self.point;
        let there = landscape.excess_of_commands(&(position + step));
        let mut corrected = excess.clone();
        let mut is_needed = false;
        for i in (0..excess.len()).filter(|i| there[*i].is_finite() && excess[*i].is_finite()) {
            corrected[i] = there[i] - excess_gradients[i].dot(step);
            is_needed |= multipliers[i] > EPSILON && (corrected[i] - excess[i]).abs() > MAX_EXCESS;
        }
        is_needed.then(|| self.solve_subproblem(landscape, position, &corrected).0)
    }

    /// Applies the damped BFGS update, given a step and the change in the Lagrangian's gradient along it.
    fn update_hessian(&mut self, step: &Position, change: &Position) {
        let curvature = step.dot(change);
        if self.is_first && curvature > 0.0 {
            self.hessian = identity(step) * (change.norm_squared() / curvature);
            self.is_first = false;
        }
        let expected_change = &self.hessian * step;
        let expected = step.dot(&expected_change);
        if expected <= 0.0 {
            return;
        }
        let weight = if curvature < MIN_CURVATURE * expected {
            (1.0 - MIN_CURVATURE) * expected / (expected - curvature)
        } else {
            1.0
        };
        let change = weight * change + (1.0 - weight) * &expected_change;
        self.hessian += &change * change.transpose() / step.dot(&change)
            - &expected_change * expected_change.transpose() / expected;
    }
}

/// Returns the gradient of the Lagrangian for given multipliers of the limits.
fn lagrangian_gradient(point: &Evaluation, multipliers: &[f64]) -> Position {
    let limits = point.excess_gradients.iter().zip(multipliers);
    limits.fold(point.gradient.clone(), |sum, (gradient, multiplier)| sum + *multiplier * gradient)
}

impl<'l, 'a> Solver<&'l mut Landscape<'a>, State> for SequentialQuadratic {
    fn name(&self) -> &str {
        "sequential quadratic programming"
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<&'l mut Landscape<'a>>,
        state: State,
    ) -> Result<(State, Option<KV>), Error> {
        let (Some(landscape), Some(position)) = (problem.problem.as_mut(), state.param.clone())
        else {
            return Err(argmin_error!(NotInitialized, "no initial iterate"));
        };
        let converged = TerminationReason::SolverConverged;
        let excess = self.point.excess.clone();
        let (step, multipliers) = self.solve_subproblem(landscape, &position, &excess);
        let [linear_change, quadratic_change] = self.predict_change(landscape, &step);
        if -quadratic_change <= CONVERGED {
            let is_within = excess.iter().all(|excess| *excess <= MAX_EXCESS);
            if is_within || landscape.penalty >= MAX_PENALTY {
                return Ok((state.terminate_with(converged), None));
            }
            landscape.penalty *= PENALTY_GROWTH;
            let merit = landscape.merit(&self.point);
            return Ok((state.cost(merit), None));
        }
        let corrected = self.correct_step(landscape, &position, &step, &multipliers);
        let mut length = 1.0;
        let measurable = MEASURABLE * landscape.accuracy;
        while length == 1.0 || (length > MIN_STEP_LENGTH && -length * linear_change > measurable) {
            let corrected = corrected.as_ref().filter(|_| length == 1.0);
            let trial_step = corrected.cloned().unwrap_or_else(|| length * &step);
            let next = (&position + trial_step).map(|coordinate| coordinate.clamp(0.0, 1.0));
            let max_merit =
                state.cost + ARMIJO * length * linear_change + NOISE * landscape.accuracy;
            let merit = match landscape.evaluate_below(&next, max_merit) {
                Some(Ok(point)) => {
                    let merit = landscape.merit(&point);
                    if merit <= max_merit {
                        let change = lagrangian_gradient(&point, &multipliers)
                            - lagrangian_gradient(&self.point, &multipliers);
                        self.update_hessian(&(&next - &position), &change);
                        self.point = point;
                        return Ok((state.param(next).cost(merit), None));
                    }
                    merit
                }
                Some(Err(merit)) => merit,
                None => {
                    length *= NO_MOTION;
                    continue;
                }
            };
            // Minimum of the parabola through both merits and the slope at the start.
            let minimum =
                -0.5 * length * linear_change / (merit - state.cost - length * linear_change);
            length *= minimum.clamp(0.1, 0.5);
        }
        if self.is_first {
            return Ok((state.terminate_with(converged), None));
        }
        // No step along this direction decreases the merit: restart along the gradient.
        self.hessian = initial_hessian(&self.point);
        self.is_first = true;
        Ok((state, None))
    }
}
