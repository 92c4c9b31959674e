//! Continuation of branches of steady-state motions along a parameter, through folds and beyond losses of
//! stability.
//!
//! A branch is traced by pseudo-arclength continuation in the state at phase 0 and the parameter. The tangent
//! and the Floquet multipliers detect bifurcations between two points: at a fold the parameter reverses its
//! direction; where a multiplier over the meshed time span passes through -1, the motion loses its
//! half-period symmetry (span of half a period) or its period doubles (span of a whole period); where a
//! complex-conjugate pair of multipliers crosses the unit circle, a torus emerges. Where a multiplier passes
//! through -1, another branch begins, whose motions have twice the span; it is traced as well.

mod continuation;

use std::f64::consts::TAU;

use trilink_robot::metrics::{Bifurcation, BranchKind, GaitMetrics, MotionStatus};

use super::chain::ChainProblem;
use super::method::Collocation;
use super::orbit::{PeriodicOrbit, Start};
use super::reduced::Reduced;
use super::{MotionError, Problem, Result};
use continuation::{BranchStart, Continuation};

/// Point of a branch: a steady-state motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BranchPoint {
    /// Value of the continuation parameter.
    pub value: f64,
    /// Metrics per period of the command, even if the motion has twice that period.
    pub metrics: GaitMetrics,
    /// Modulus of the largest Floquet multiplier over the motion's own period.
    pub floquet: f64,
    pub status: MotionStatus,
    pub bifurcation: Option<Bifurcation>,
}

/// Branch of steady-state motions.
#[derive(Debug, Clone, PartialEq)]
pub struct Branch {
    pub kind: BranchKind,
    /// Index of the branch from which this branch bifurcates; `None` for the first.
    pub parent: Option<usize>,
    pub points: Vec<BranchPoint>,
    /// Reason why the continuation of the branch ended.
    pub end: String,
}

/// Maximum number of branches that are traced.
const MAX_BRANCHES: usize = 16;
/// Relative accuracy of the metrics on the branches.
pub(super) const ACCURACY: f64 = 1e-9;

/// Traces the branch of the motion at the lower end of a parameter range, and every branch that bifurcates
/// from a traced branch. `problem_at` returns the problem at a parameter value; `is_cancelled` is checked
/// before each step.
///
/// # Errors
/// Returns an error if there is no steady-state motion at the lower end, if the no-skid constraints alone
/// determine that motion, so that it has no dynamic states, or if the computation was cancelled.
pub fn branches(
    problem_at: &dyn Fn(f64) -> Problem,
    range: [f64; 2],
    is_cancelled: &dyn Fn() -> bool,
) -> Result<Vec<Branch>> {
    let first = problem_at(range[0]);
    if first.is_determined() {
        return Err(MotionError::Determined);
    }
    let speed = |value: f64| problem_at(value).omega_rad_s;
    let sweep = Sweep { range, omega_rad_s: &speed, is_cancelled };
    // All problems are converted to one frequency with the same motion per radian of phase, so that no time
    // scale depends on the parameter.
    let at = |value: f64| problem_at(value).per_radian_as(first.omega_rad_s).effective();
    let mut found = first.as_chain().checked()?.steady()?.branches(&at, &sweep)?;
    for point in found.iter_mut().flat_map(|branch| &mut branch.points) {
        point.metrics = first.own_metrics(point.metrics);
    }
    Ok(found)
}

/// Parameter range of the sweep, and the gait's frequency as a function of the parameter; shared by all
/// branches.
pub(super) struct Sweep<'a> {
    range: [f64; 2],
    omega_rad_s: &'a dyn Fn(f64) -> f64,
    is_cancelled: &'a dyn Fn() -> bool,
}

/// Traces all branches of the motions of one reduced model, in the order in which their starts are found.
pub(super) fn trace_all<const N: usize, R: Reduced<N>>(
    model_at: &dyn Fn(f64) -> R,
    &Sweep { range, omega_rad_s, is_cancelled }: &Sweep,
) -> Result<Vec<Branch>> {
    let model = model_at(range[0]);
    let mut orbit = PeriodicOrbit::default();
    // `find` would leave the symmetric branch where that is unstable.
    if orbit.solve(&model, Start::Guess, ACCURACY).is_err() {
        Collocation { model: &model, orbit: &mut orbit }.find(false, ACCURACY)?;
    }
    let mut waiting = vec![BranchStart::from_solution(orbit, range[0])];
    let mut found: Vec<Branch> = Vec::new();
    while found.len() < MAX_BRANCHES && !waiting.is_empty() {
        let origin = waiting.remove(0);
        let parent = origin.parent;
        let mut continuation = Continuation::new(model_at, range, origin, found.len())?;
        let mut branch = continuation.trace(is_cancelled)?;
        branch.points.iter_mut().for_each(|point| {
            point.metrics.v_m_s = point.metrics.d_m * omega_rad_s(point.value) / TAU;
        });
        // If the branch rejoins its parent, the branch that starts at the junction would only retrace this
        // one.
        if let Some(value) = continuation.joins_at {
            let tolerance = 1e-3 * (range[1] - range[0]);
            waiting
                .retain(|other| other.parent != parent || (other.value - value).abs() >= tolerance);
        }
        waiting.append(&mut continuation.bifurcating);
        found.push(branch);
    }
    Ok(found)
}

impl Problem {
    /// Returns the equivalent problem at the frequency `omega_rad_s`: its motion is the same function of the
    /// command's phase.
    fn per_radian_as(&self, omega_rad_s: f64) -> ChainProblem {
        let ratio = omega_rad_s / self.omega_rad_s;
        let mut problem = ChainProblem { omega_rad_s, ..self.as_chain() };
        for number in problem.chain.numbers() {
            if let Some(value) = problem.chain.number_mut(number) {
                *value *= ratio.powi(number.power_of_omega());
            }
        }
        problem
    }
}
