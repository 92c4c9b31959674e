//! The search for an optimum: projected quasi-Newton steps, limits by an augmented Lagrangian.
//!
//! argmin's own quasi-Newton solvers know no ranges and want linear algebra of its kind.
//!
//! Reference: J. Nocedal and S. J. Wright, *Numerical Optimization*, 2nd ed., Springer 2006,
//! sections 6.1 and 17.4; D. P. Bertsekas, *Projected Newton methods for optimization problems with
//! simple constraints*, SIAM J. Control Optim. 20 (1982) 221-246.

use argmin::argmin_error;
use argmin::core::{
    Error, Executor, IterState, KV, OptimizationResult, Problem, Solver, State as _,
    TerminationReason,
};
use nalgebra::SMatrix;

use super::commands::MOST_COMMANDS;
use super::landscape::{LIMITS, Landscape, Place, Point};

const MOST_STEPS: u64 = 120;
/// Relative rise of the objective that is no rise any more.
const CONVERGED: f64 = 1e-12;
/// Longest first step, and longest of all, as parts of the ranges.
const FIRST_STEP: f64 = 0.1;
const LONGEST_STEP: f64 = 0.5;
/// Part of what the gradient promises that a step must give.
const ENOUGH: f64 = 1e-4;
const SHORTEST: f64 = 1e-9;
/// How often the multipliers of the limits are found anew at most; by how much limits may be exceeded, and how
/// much stiffer they become where that falls slowly.
const MOST_ROUNDS: usize = 25;
const EXCEEDED: f64 = 1e-9;
const STIFFER: f64 = 10.0;
const SLOW: f64 = 0.25;

type Curvature = SMatrix<f64, MOST_COMMANDS, MOST_COMMANDS>;
type State = IterState<Place, (), (), (), (), f64>;

/// Where a search has ended.
#[derive(Debug, Clone, Copy)]
pub(super) struct End {
    pub place: Place,
    pub point: Point,
}

/// Searches from a place; `None` if there is no motion there, or a limit cannot be kept.
pub(super) fn search(landscape: &mut Landscape, start: Place) -> Option<End> {
    (landscape.multipliers, landscape.stiffness) = ([0.0; LIMITS], 1.0);
    let mut end = End { place: start, point: landscape.evaluate(&start)? };
    let mut before = f64::INFINITY;
    for _ in 0..MOST_ROUNDS {
        end = descend(landscape, end)?;
        let mut missed = 0.0_f64;
        for (multiplier, excess) in landscape.multipliers.iter_mut().zip(end.point.excess) {
            missed = missed.max(excess.max(-*multiplier / landscape.stiffness).abs());
            *multiplier = (*multiplier + landscape.stiffness * excess).max(0.0);
        }
        if missed <= EXCEEDED {
            return Some(end);
        }
        if missed > SLOW * before {
            landscape.stiffness *= STIFFER;
        }
        before = missed;
    }
    None
}

/// Descends to where the augmented cost can hardly fall.
fn descend(landscape: &mut Landscape, from: End) -> Option<End> {
    let (cost, gradient) = landscape.augmented(&from.point);
    let solver = ProjectedQuasiNewton {
        point: from.point,
        gradient,
        inverse: Curvature::identity(),
        is_first: true,
    };
    let result = Executor::new(landscape, solver)
        .configure(|state| state.param(from.place).cost(cost).max_iters(MOST_STEPS))
        .timer(false)
        .ctrlc(false)
        .run();
    let OptimizationResult { solver, state, .. } = result.ok()?;
    Some(End { place: state.param?, point: solver.point })
}

struct ProjectedQuasiNewton {
    point: Point,
    gradient: Place,
    /// Approximation of the inverse Hessian (BFGS), in the commands that no range stops.
    inverse: Curvature,
    is_first: bool,
}

impl ProjectedQuasiNewton {
    /// The step that the curvature asks for in the commands that no end of a range stops.
    fn direction(&self, place: &Place) -> Place {
        let is_free = |i: usize| {
            let outward = if place[i] <= 0.0 { 1.0 } else { -1.0 };
            let is_at_end = place[i] <= 0.0 || place[i] >= 1.0;
            !is_at_end || outward * self.gradient[i] < 0.0
        };
        let free = Place::from_fn(|i, _| if is_free(i) { 1.0 } else { 0.0 });
        let slope = self.gradient.component_mul(&free);
        let step = -(self.inverse * slope).component_mul(&free);
        let longest = if self.is_first { FIRST_STEP } else { LONGEST_STEP };
        step * (longest / step.amax()).min(1.0)
    }

    /// Takes in what a step has changed of the gradient (BFGS).
    fn update(&mut self, step: &Place, change: &Place) {
        // What did not move tells nothing.
        let change = change.zip_map(step, |change, step| if step == 0.0 { 0.0 } else { change });
        let curvature = step.dot(&change);
        if curvature <= 1e-10 * step.norm() * change.norm() {
            return;
        }
        if self.is_first {
            self.inverse *= curvature / change.norm_squared();
            self.is_first = false;
        }
        let turned = Curvature::identity() - (*step * change.transpose()) / curvature;
        self.inverse =
            turned * self.inverse * turned.transpose() + (*step * step.transpose()) / curvature;
    }
}

impl<'l, 'a> Solver<&'l mut Landscape<'a>, State> for ProjectedQuasiNewton {
    fn name(&self) -> &str {
        "projected quasi-Newton"
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<&'l mut Landscape<'a>>,
        state: State,
    ) -> Result<(State, Option<KV>), Error> {
        let (Some(landscape), Some(place)) = (problem.problem.as_mut(), state.param) else {
            return Err(argmin_error!(NotInitialized, "no first iterate"));
        };
        let converged = TerminationReason::SolverConverged;
        let mut direction = self.direction(&place);
        if self.gradient.dot(&direction) >= 0.0 {
            self.inverse = Curvature::identity();
            self.is_first = true;
            direction = self.direction(&place);
        }
        if -self.gradient.dot(&direction) <= CONVERGED {
            return Ok((state.terminate_with(converged), None));
        }
        let mut part = 1.0;
        while part > SHORTEST {
            let next = (place + part * direction).map(|of| of.clamp(0.0, 1.0));
            let step = next - place;
            let promised = self.gradient.dot(&step);
            let most = state.cost + ENOUGH * promised;
            let cost = match landscape.evaluate_below(&next, most) {
                Some(Ok(point)) => {
                    let (cost, gradient) = landscape.augmented(&point);
                    if cost <= most {
                        self.update(&step, &(gradient - self.gradient));
                        (self.point, self.gradient) = (point, gradient);
                        return Ok((state.param(next).cost(cost), None));
                    }
                    cost
                }
                Some(Err(cost)) => cost,
                None => {
                    part *= 0.25;
                    continue;
                }
            };
            // The parabola through both costs and the slope.
            let parabola = -0.5 * promised / (cost - state.cost - promised);
            part *= parabola.clamp(0.1, 0.5);
        }
        if self.is_first {
            return Ok((state.terminate_with(converged), None));
        }
        // With the curvature at hand no step rises: once more along the gradient.
        self.inverse = Curvature::identity();
        self.is_first = true;
        Ok((state, None))
    }
}
