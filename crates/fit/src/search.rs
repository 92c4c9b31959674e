//! The search for the free coefficients: sequential least absolute deviations with a trust
//! region.
//!
//! The objective is a sum of absolute values, and its minimum lies where several of them have
//! their breakpoints. Each iteration minimises the sum of the linearised residuals, breakpoints
//! and all, within a trust region of the coefficients' logarithms: near a vertex of breakpoints
//! the iterates converge like Newton's. argmin runs it; none of argmin's own solvers converges on
//! breakpoints.
//!
//! Reference: R. Fletcher, *Practical Methods of Optimization*, 2nd ed., Wiley 1987, section
//! 14.4.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use argmin::argmin_error;
use argmin::core::observers::{Observe, ObserverMode};
use argmin::core::{
    Error, Executor, IterState, KV, OptimizationResult, Problem, Solver, State as _,
    TerminationReason,
};
use nalgebra::DVector;
use trilink_mechanics::REFERENCE_ACCURACY;
use trilink_tables::Stopped;

use super::hessian::Hessians;
use super::input::FreeParameter;
use super::least_absolute::Residual;
use super::objective::Evaluator;
use super::terms::{Linearised, PENALTY};

const MAX_ITERATIONS: u64 = 200;
/// Trust-region radius at first and at most: coefficients may change by these factors' logarithms.
const FIRST_RADIUS: f64 = 1.0;
const MAX_RADIUS: f64 = 3.0;
/// And at least when the motions become more accurate.
const NEXT_RADIUS: f64 = 0.1;
/// Fall of the objective, relative to it, below which it has converged.
pub(super) const CONVERGED: f64 = 1e-11;
/// Shortest step, as a multiple of the motions' accuracy, that updates the Hessians.
const INFORMATIVE: f64 = 10.0;

fn stopped(reason: Option<&TerminationReason>, cost: f64) -> Stopped {
    match reason {
        _ if cost >= PENALTY => Stopped::NoMotion,
        Some(TerminationReason::SolverConverged) => Stopped::Converged,
        _ => Stopped::TooManySteps,
    }
}

/// Counts searches that have ended.
pub(super) type Ended = Arc<AtomicUsize>;

/// A search between two runs of the executor.
#[derive(Debug, Clone)]
pub(super) struct Iterate {
    pub values: Vec<f64>,
    pub cost: f64,
    /// Of the last run.
    pub stopped: Stopped,
    solver: TrustRegion,
}

impl Iterate {
    /// A search that begins at `values`.
    pub(crate) fn begin(evaluator: &mut Evaluator, values: Vec<f64>) -> Self {
        let at = evaluator.expanded(&values);
        Self::from_linearised(values, at)
    }

    /// A search that begins at `values`, where the objective is known.
    pub(crate) fn from_linearised(
        values: Vec<f64>,
        Linearised { cost, residuals }: Linearised,
    ) -> Self {
        let solver = TrustRegion {
            residuals,
            hessians: Hessians::default(),
            radius: FIRST_RADIUS,
            held: None,
            tolerance: CONVERGED,
            is_last: false,
        };
        Self { values, cost, stopped: Stopped::NothingFree, solver }
    }

    /// The same with one parameter that stays as it is.
    pub(crate) fn holding(mut self, index: usize) -> Self {
        self.solver.held = Some(index);
        self
    }

    /// Evaluates motions of another accuracy, where the last step would have led that promised
    /// too little to be taken.
    pub(crate) fn with_accuracy(mut self, evaluator: &mut Evaluator, accuracy: f64) -> Self {
        evaluator.accuracy = accuracy;
        let (step, _) = self.solver.best_step(&evaluator.parameters, &self.values);
        self.values = values_after(&evaluator.parameters, &self.values, &step);
        if accuracy == REFERENCE_ACCURACY {
            evaluator.add_second_order(&self.values);
        }
        self = self.expand(evaluator);
        // What coarse motions could not resolve may have closed the region.
        self.solver.radius = self.solver.radius.max(NEXT_RADIUS);
        self
    }

    /// Expands the trials' motions where the search is.
    pub(crate) fn expand(mut self, evaluator: &mut Evaluator) -> Self {
        let at = evaluator.expanded(&self.values);
        (self.cost, self.solver.residuals) = (at.cost, at.residuals);
        self
    }

    /// Iterates until the objective can hardly fall, relative to itself; `is_last` if nothing
    /// goes on from the end.
    pub(crate) fn run(
        self,
        on: &mut Evaluator,
        tolerance: f64,
        is_last: bool,
        ended: &Ended,
    ) -> Self {
        // After cancellation rayon still starts the searches that are queued, which may be thousands.
        if on.objective.cancel.is_cancelled() {
            return self;
        }
        let solver = TrustRegion { tolerance, is_last, ..self.solver };
        let result = Executor::new(on, solver)
            .configure(|state| state.param(self.values).cost(self.cost).max_iters(MAX_ITERATIONS))
            .timer(false)
            .ctrlc(false)
            .add_observer(Observer(Arc::clone(ended)), ObserverMode::Always)
            .run();
        let OptimizationResult { solver, state, .. } = result.expect("there is a first iterate");
        let stopped = stopped(state.get_termination_reason(), state.cost);
        Self { values: state.param.unwrap_or_default(), cost: state.cost, stopped, solver }
    }
}

/// The values of the parameters and the objective there.
type State = IterState<Vec<f64>, (), (), (), (), f64>;

/// The method, with what it knows beside the iterate.
#[derive(Debug, Clone)]
struct TrustRegion {
    residuals: Vec<Residual>,
    hessians: Hessians,
    /// Largest change of a parameter's logarithm.
    radius: f64,
    /// A parameter that stays as it is.
    held: Option<usize>,
    tolerance: f64,
    /// Whether the residuals are not needed where the objective is as low as predicted.
    is_last: bool,
}

impl TrustRegion {
    /// The next step of the parameters' logarithms, and the fall that it predicts.
    fn best_step(&self, parameters: &[FreeParameter], values: &[f64]) -> (DVector<f64>, f64) {
        let limits = limits(parameters, values, self.radius);
        self.hessians.best_step(&self.residuals, &limits, self.held)
    }
}

impl<'e, 'o> Solver<&'e mut Evaluator<'o>, State> for TrustRegion {
    fn name(&self) -> &str {
        "sequential least absolute deviations"
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<&'e mut Evaluator<'o>>,
        mut state: State,
    ) -> Result<(State, Option<KV>), Error> {
        let (Some(evaluator), Some(values)) = (problem.problem.as_mut(), &state.param) else {
            return Err(argmin_error!(NotInitialized, "no first iterate"));
        };
        if evaluator.objective.cancel.is_cancelled() {
            return Ok((state.terminate_with(TerminationReason::Interrupt), None));
        }
        let converged = TerminationReason::SolverConverged;
        let cost = state.cost;
        let (step, expected) = self.best_step(&evaluator.parameters, values);
        if expected <= self.tolerance * cost {
            return Ok((state.terminate_with(converged), None));
        }
        let next = values_after(&evaluator.parameters, values, &step);
        let metrics = evaluator.metrics(&next);
        let found = evaluator.terms.cost(metrics.iter().copied());
        let is_inside = step.amax() < 0.9 * self.radius;
        let is_as_predicted = (found - (cost - expected)).abs() <= self.tolerance * cost;
        if self.is_last && is_inside && is_as_predicted {
            return Ok((state.param(next).cost(found).terminate_with(converged), None));
        }
        let found = evaluator.linearised_at(&next, &metrics);
        // Slopes that differ by no more than their inaccuracy say nothing of the Hessians.
        if step.amax() > INFORMATIVE * evaluator.accuracy {
            self.hessians.update(&self.residuals, &found.residuals, step.as_slice());
        }
        let ratio = (cost - found.cost) / expected;
        if ratio < 0.25 {
            self.radius = 0.3 * self.radius.min(step.amax());
        } else if ratio > 0.75 {
            self.radius = (2.0 * self.radius).min(MAX_RADIUS);
        }
        if found.cost < cost {
            self.residuals = found.residuals;
            state = state.param(next).cost(found.cost);
        }
        Ok((state, None))
    }
}

/// Counts finished searches.
struct Observer(Ended);

impl Observe<State> for Observer {
    fn observe_final(&mut self, _: &State) -> Result<(), Error> {
        self.0.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }
}

/// The parameters' values after a step of their logarithms.
fn values_after(parameters: &[FreeParameter], values: &[f64], step: &DVector<f64>) -> Vec<f64> {
    let after = |(parameter, (value, step)): (&FreeParameter, (&f64, &f64))| {
        let [low, high] = parameter.bounds;
        if *step == 0.0 { *value } else { (value * step.exp()).clamp(low, high) }
    };
    parameters.iter().zip(values.iter().zip(step.iter())).map(after).collect()
}

/// How far the parameters' logarithms may go from `values` within the bounds and a trust region.
pub(super) fn limits(parameters: &[FreeParameter], values: &[f64], radius: f64) -> Vec<[f64; 2]> {
    let limit = |(parameter, value): (&FreeParameter, &f64)| {
        let [low, high] = parameter.bounds.map(|bound| (bound / value).ln());
        [low.clamp(-radius, 0.0), high.clamp(0.0, radius)]
    };
    parameters.iter().zip(values).map(limit).collect()
}
