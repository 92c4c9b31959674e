//! Search for the free coefficients: sequential least absolute deviations with a trust region.
//!
//! The objective is a sum of absolute values whose minimum lies at breakpoints of several of these. Each iteration
//! minimises the sum of the linearised residuals, breakpoints included, within a trust region for the logarithms of the
//! coefficients; near the minimum the iterates converge as in Newton's method. argmin runs the iterations; none of its
//! own solvers converges if the minimum lies at breakpoints.
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
/// Initial trust-region radius, in terms of the coefficients' logarithms.
const FIRST_RADIUS: f64 = 1.0;
const MAX_RADIUS: f64 = 3.0;
/// Minimum trust-region radius after switching to a higher solver accuracy.
const MIN_RESTART_RADIUS: f64 = 0.1;
/// Predicted relative decrease of the objective below which the last, most accurate iterations of a search have
/// converged.
pub(super) const CONVERGENCE_TOLERANCE: f64 = 1e-11;
/// Minimum step in the logarithms of the parameters for which the Hessians are updated, as a multiple of the solver's
/// relative accuracy.
const MIN_UPDATE_STEP: f64 = 10.0;

/// Translates the reason why argmin ended a run; `cost` is the final objective.
fn stopped(reason: Option<&TerminationReason>, cost: f64) -> Stopped {
    match reason {
        _ if cost >= PENALTY => Stopped::NoMotion,
        Some(TerminationReason::SolverConverged) => Stopped::Converged,
        _ => Stopped::TooManySteps,
    }
}

/// Shared counter of finished searches.
pub(super) type Ended = Arc<AtomicUsize>;

/// State of a search between two runs of argmin's executor.
#[derive(Debug, Clone)]
pub(super) struct Iterate {
    pub values: Vec<f64>,
    pub cost: f64,
    /// Reason why the latest run of argmin's executor ended.
    pub stopped: Stopped,
    solver: TrustRegion,
}

impl Iterate {
    /// Starts a search at `values`.
    pub(crate) fn new(evaluator: &mut Evaluator, values: Vec<f64>) -> Self {
        let at = evaluator.expanded(&values);
        Self::from_linearised(values, at)
    }

    /// Starts a search at `values`, given the objective linearised there.
    pub(crate) fn from_linearised(
        values: Vec<f64>,
        Linearised { cost, residuals }: Linearised,
    ) -> Self {
        let solver = TrustRegion {
            residuals,
            hessians: Hessians::default(),
            radius: FIRST_RADIUS,
            held: None,
            tolerance: CONVERGENCE_TOLERANCE,
            is_last: false,
        };
        Self { values, cost, stopped: Stopped::NothingFree, solver }
    }

    /// Holds the parameter at `index` fixed.
    pub(crate) fn holding(mut self, index: usize) -> Self {
        self.solver.held = Some(index);
        self
    }

    /// Switches to another solver accuracy and takes the last step that the previous run proposed. The run itself did
    /// not take this step, because the predicted decrease of the objective was below the tolerance.
    pub(crate) fn with_accuracy(mut self, evaluator: &mut Evaluator, accuracy: f64) -> Self {
        evaluator.accuracy = accuracy;
        let (step, _) = self.solver.best_step(&evaluator.parameters, &self.values);
        self.values = values_after(&evaluator.parameters, &self.values, &step);
        if accuracy == REFERENCE_ACCURACY {
            evaluator.add_second_order(&self.values);
        }
        self = self.expand(evaluator);
        // Errors of the less accurate solutions may have shrunk the trust region.
        self.solver.radius = self.solver.radius.max(MIN_RESTART_RADIUS);
        self
    }

    /// Recomputes, at the current parameter values, the Taylor expansion that yields the metrics of trials with similar
    /// inputs from one solution of the model, and the objective with it.
    pub(crate) fn expand(mut self, evaluator: &mut Evaluator) -> Self {
        let linearised = evaluator.expanded(&self.values);
        self.cost = linearised.cost;
        self.solver.residuals = linearised.residuals;
        self
    }

    /// Iterates until the predicted relative decrease of the objective is below `tolerance`. `is_last` states that no
    /// other run will continue from the result; `ended` counts finished searches.
    pub(crate) fn run(
        self,
        evaluator: &mut Evaluator,
        tolerance: f64,
        is_last: bool,
        ended: &Ended,
    ) -> Self {
        // After a cancellation, rayon still starts the queued searches, of which there may be thousands.
        if evaluator.objective.cancel.is_cancelled() {
            return self;
        }
        let solver = TrustRegion { tolerance, is_last, ..self.solver };
        let result = Executor::new(evaluator, solver)
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

/// argmin's state: parameter values and objective.
type State = IterState<Vec<f64>, (), (), (), (), f64>;

/// Method of sequential least absolute deviations as a solver for argmin, with the state that argmin does not store.
#[derive(Debug, Clone)]
struct TrustRegion {
    residuals: Vec<Residual>,
    hessians: Hessians,
    /// Radius of the trust region: maximum change in the logarithm of a parameter in one step.
    radius: f64,
    /// Index of the parameter that is held fixed; `None` if there is none.
    held: Option<usize>,
    tolerance: f64,
    /// Whether no other run continues from the final values, so that this run may end without linearising the residuals
    /// there.
    is_last: bool,
}

impl TrustRegion {
    /// Returns the next step in the logarithms of the parameters, and the predicted decrease of the objective.
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
        let next_cost = evaluator.terms.cost(metrics.iter().copied());
        let is_inside = step.amax() < 0.9 * self.radius;
        let is_as_predicted = (next_cost - (cost - expected)).abs() <= self.tolerance * cost;
        if self.is_last && is_inside && is_as_predicted {
            return Ok((state.param(next).cost(next_cost).terminate_with(converged), None));
        }
        let found = evaluator.linearised_at(&next, &metrics);
        // For shorter steps, the change in slope is within the errors of the slopes.
        if step.amax() > MIN_UPDATE_STEP * evaluator.accuracy {
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

/// Observer that counts finished searches.
struct Observer(Ended);

impl Observe<State> for Observer {
    fn observe_final(&mut self, _: &State) -> Result<(), Error> {
        self.0.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }
}

/// Returns the parameter values after a step in their logarithms, within their bounds.
fn values_after(parameters: &[FreeParameter], values: &[f64], step: &DVector<f64>) -> Vec<f64> {
    let each = parameters.iter().zip(values.iter().zip(step.iter()));
    each.map(|(parameter, (value, step))| {
        let [low, high] = parameter.bounds;
        if *step == 0.0 { *value } else { (value * step.exp()).clamp(low, high) }
    })
    .collect()
}

/// Returns, for each parameter, the range of steps in its logarithm from `values` that stay within its bounds and
/// within a trust region of the given radius.
pub(super) fn limits(parameters: &[FreeParameter], values: &[f64], radius: f64) -> Vec<[f64; 2]> {
    let each = parameters.iter().zip(values);
    each.map(|(parameter, value)| {
        let [low, high] = parameter.bounds.map(|bound| (bound / value).ln());
        [low.clamp(-radius, 0.0), high.clamp(0.0, radius)]
    })
    .collect()
}
