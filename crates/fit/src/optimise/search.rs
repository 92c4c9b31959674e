//! The search for an optimum: sequential quadratic programming.
//!
//! Each step solves a quadratic program of the cost, of which the curvature is learnt from the gradients, and of
//! the limits where they are. A merit function, in which limits may be exceeded at a price, decides what part of
//! the step is gone. argmin's own solvers know neither ranges nor limits.
//!
//! Reference: J. Nocedal and S. J. Wright, *Numerical Optimization*, 2nd ed., Springer 2006, sections 18.1 to 18.5.

use argmin::argmin_error;
use argmin::core::{
    Error, Executor, IterState, KV, OptimizationResult, Problem, Solver, State as _,
    TerminationReason,
};

use super::landscape::{LIMITS, Landscape, Place, Point};
use super::quadratic::{Curvature, QuadraticProgram};

const MOST_STEPS: u64 = 120;
/// Relative rise of the objective that is no rise any more.
const CONVERGED: f64 = 1e-12;
/// By how much less than a step must give the merit may seem to be, over the accuracy of the motions.
const NOISE: f64 = 1e-3;
/// Slope, or multiplier of a limit, that is nothing.
const NOTHING: f64 = 1e-12;
/// Longest first step, and longest of all, as parts of the ranges.
const FIRST_STEP: f64 = 0.1;
const LONGEST_STEP: f64 = 0.5;
/// Part of what is promised that a step must give.
const ENOUGH: f64 = 1e-4;
const SHORTEST: f64 = 1e-5;
/// Part of a step that is tried where there is no motion at its end.
const NO_MOTION: f64 = 0.1;
/// What is promised at least of a part of a step, over the accuracy of the motions, that the merit can tell.
const MEASURABLE: f64 = 0.1;
/// Part of the curvature known before that is kept along a step which shows less (Powell).
const LEAST_CURVATURE: f64 = 0.2;
/// By how much limits may be exceeded; what that costs at first, how much dearer it becomes where they still are in the
/// end, and at most.
const EXCEEDED: f64 = 1e-9;
const PRICE: f64 = 10.0;
const DEARER: f64 = 10.0;
const DEAREST: f64 = 1e8;

type State = IterState<Place, (), (), (), (), f64>;

/// Where a search has ended.
#[derive(Debug, Clone, Copy)]
pub(super) struct End {
    pub place: Place,
    pub point: Point,
    pub curvature: Curvature,
}

/// Searches from a place, with the curvature there if it is known; `None` if there is no motion, or a limit cannot be
/// kept.
pub(super) fn search(
    landscape: &mut Landscape,
    start: Place,
    curvature: Option<Curvature>,
) -> Option<End> {
    (landscape.price, landscape.only_near) = (PRICE, true);
    let point = landscape.evaluate(&start)?;
    let is_first = curvature.is_none();
    let curvature = curvature.unwrap_or(steepest(&point));
    let solver = SequentialQuadratic { point, curvature, is_first };
    let cost = landscape.merit(&point);
    let result = Executor::new(landscape, solver)
        .configure(|state| state.param(start).cost(cost).max_iters(MOST_STEPS))
        .timer(false)
        .ctrlc(false)
        .run();
    let OptimizationResult { solver, state, .. } = result.ok()?;
    let SequentialQuadratic { point, curvature, .. } = solver;
    let is_within = point.excess.iter().all(|excess| *excess <= EXCEEDED);
    Some(End { place: state.param.filter(|_| is_within)?, point, curvature })
}

/// The curvature with which the first step goes along the gradient.
fn steepest(point: &Point) -> Curvature {
    Curvature::identity() * (point.gradient.amax() / FIRST_STEP).max(NOTHING)
}

struct SequentialQuadratic {
    point: Point,
    /// Of the Lagrangian (BFGS).
    curvature: Curvature,
    is_first: bool,
}

impl SequentialQuadratic {
    /// The step of least merit as far as gradients and curvature tell, where limits are exceeded by so much, and
    /// their multipliers.
    fn plan(
        &self,
        landscape: &Landscape,
        place: &Place,
        excess: &[f64; LIMITS],
    ) -> (Place, [f64; LIMITS]) {
        let longest = if self.is_first { FIRST_STEP } else { LONGEST_STEP };
        let program = QuadraticProgram {
            count: landscape.count(),
            gradient: &self.point.gradient,
            curvature: &self.curvature,
            low: place.map(|of| (-of).max(-longest)),
            high: place.map(|of| (1.0 - of).min(longest)),
            excess,
            slopes: &self.point.excess_gradients,
            price: landscape.price,
        };
        program.solve()
    }

    /// What a step changes of the merit, by the gradients, and by the curvature, too.
    fn promised(&self, landscape: &Landscape, step: &Place) -> [f64; 2] {
        let Point { gradient, excess, excess_gradients, .. } = &self.point;
        let mut change = gradient.dot(step);
        for (excess, slope) in excess.iter().zip(excess_gradients) {
            if excess.is_finite() {
                let after = excess + slope.dot(step);
                change += landscape.price * (after.max(0.0) - excess.max(0.0));
            }
        }
        [change, change + 0.5 * step.dot(&(self.curvature * step))]
    }

    /// The whole step with what the limits of commands are at its end, which no motion need be known for, if they are
    /// not what their slopes promise (second-order correction).
    fn corrected(
        &self,
        landscape: &Landscape,
        place: &Place,
        step: &Place,
        multipliers: &[f64; LIMITS],
    ) -> Option<Place> {
        let Point { excess, excess_gradients, .. } = &self.point;
        let there = landscape.excess_of_commands(&(place + step));
        let mut corrected = *excess;
        let mut is_needed = false;
        for i in (0..LIMITS).filter(|i| there[*i].is_finite() && excess[*i].is_finite()) {
            corrected[i] = there[i] - excess_gradients[i].dot(step);
            is_needed |= multipliers[i] > NOTHING && (corrected[i] - excess[i]).abs() > EXCEEDED;
        }
        is_needed.then(|| self.plan(landscape, place, &corrected).0)
    }

    /// Takes in what a step has changed of the Lagrangian's gradient.
    fn update(&mut self, step: &Place, change: &Place) {
        let found = step.dot(change);
        if self.is_first && found > 0.0 {
            self.curvature = Curvature::identity() * (change.norm_squared() / found);
            self.is_first = false;
        }
        let known = self.curvature * step;
        let expected = step.dot(&known);
        if expected <= 0.0 {
            return;
        }
        let kept = match found < LEAST_CURVATURE * expected {
            true => (1.0 - LEAST_CURVATURE) * expected / (expected - found),
            false => 1.0,
        };
        let change = kept * change + (1.0 - kept) * known;
        self.curvature +=
            change * change.transpose() / step.dot(&change) - known * known.transpose() / expected;
    }
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
        let (Some(landscape), Some(place)) = (problem.problem.as_mut(), state.param) else {
            return Err(argmin_error!(NotInitialized, "no first iterate"));
        };
        let converged = TerminationReason::SolverConverged;
        let excess = self.point.excess;
        let (step, multipliers) = self.plan(landscape, &place, &excess);
        let [promised, with_curvature] = self.promised(landscape, &step);
        if -with_curvature <= CONVERGED {
            let is_within = excess.iter().all(|excess| *excess <= EXCEEDED);
            if is_within || landscape.price >= DEAREST {
                return Ok((state.terminate_with(converged), None));
            }
            landscape.price *= DEARER;
            let merit = landscape.merit(&self.point);
            return Ok((state.cost(merit), None));
        }
        let corrected = self.corrected(landscape, &place, &step, &multipliers);
        let mut part = 1.0;
        let measurable = MEASURABLE * landscape.accuracy;
        while part == 1.0 || (part > SHORTEST && -part * promised > measurable) {
            let way = corrected.filter(|_| part == 1.0).unwrap_or(part * step);
            let next = (place + way).map(|of| of.clamp(0.0, 1.0));
            let most = state.cost + ENOUGH * part * promised + NOISE * landscape.accuracy;
            let merit = match landscape.evaluate_below(&next, most) {
                Some(Ok(point)) => {
                    let merit = landscape.merit(&point);
                    if merit <= most {
                        let gradient = |of: &Point| {
                            let limits = of.excess_gradients.iter().zip(&multipliers);
                            limits.fold(of.gradient, |sum, (slope, force)| sum + *force * slope)
                        };
                        let change = gradient(&point) - gradient(&self.point);
                        self.update(&(next - place), &change);
                        self.point = point;
                        return Ok((state.param(next).cost(merit), None));
                    }
                    merit
                }
                Some(Err(merit)) => merit,
                None => {
                    part *= NO_MOTION;
                    continue;
                }
            };
            // The parabola through both merits and the slope.
            let parabola = -0.5 * part * promised / (merit - state.cost - part * promised);
            part *= parabola.clamp(0.1, 0.5);
        }
        if self.is_first {
            return Ok((state.terminate_with(converged), None));
        }
        // With the curvature at hand no step rises: once more along the gradient.
        (self.curvature, self.is_first) = (steepest(&self.point), true);
        Ok((state, None))
    }
}
