//! Branches: how steady motions change with a parameter, through folds and past where they lose their
//! stability.
//!
//! A branch is followed by pseudo-arclength in the state at phase 0 and the parameter. Between two of
//! its points multipliers tell what happens: where the parameter turns round there is a fold; a
//! multiplier of the elements' span through -1 is where the mirror image of the motion no longer is the
//! motion (half a period), or where its period doubles (a whole one); a pair of complex ones through the
//! unit circle leads to a torus. There another branch begins, over twice the span, and is followed, too.

mod walk;

use std::f64::consts::TAU;

use trilink_robot::metrics::{Bifurcation, BranchKind, GaitMetrics, MotionStatus};
use trilink_robot::{Dry, Friction, Parameter, Viscous};

use super::method::{Collocation, Method};
use super::orbit::{PeriodicOrbit, Start};
use super::reduced::{PassiveNoSkid, Reduced, Skid};
use super::{MotionError, Problem, Result};
use walk::{Origin, Walk};

/// A motion of a branch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BranchPoint {
    /// Of the parameter that the branch is followed over.
    pub value: f64,
    /// Per period of the command, also where the motion repeats itself after two.
    pub metrics: GaitMetrics,
    /// Modulus of the largest Floquet multiplier of the motion's own period.
    pub floquet: f64,
    pub status: MotionStatus,
    pub bifurcation: Option<Bifurcation>,
}

/// Motions that follow each other.
#[derive(Debug, Clone, PartialEq)]
pub struct Branch {
    pub kind: BranchKind,
    /// Index of the branch that it begins on.
    pub parent: Option<usize>,
    pub points: Vec<BranchPoint>,
    /// Why there is no further point.
    pub end: String,
}

/// Most branches that are followed.
const MOST_BRANCHES: usize = 16;
/// Relative accuracy of the metrics.
pub(super) const ACCURACY: f64 = 1e-9;

/// Follows the motion at the low end of a range of a parameter to its ends, and every branch that it
/// meets. `problem_at` gives the problem of each value; `is_cancelled` is asked before each step.
///
/// # Errors
/// There is no motion at the low end, or it has no states of its own; or the work was cancelled.
pub fn branches(
    problem_at: &dyn Fn(f64) -> Problem,
    range: [f64; 2],
    is_cancelled: &dyn Fn() -> bool,
) -> Result<Vec<Branch>> {
    let first = problem_at(range[0]).effective();
    // The same per radian of phase at the first frequency: then no time depends on the parameter.
    let omega_rad_s = first.omega_rad_s;
    let at = |value: f64| problem_at(value).effective().per_radian_as(omega_rad_s);
    let speed = |value: f64| problem_at(value).omega_rad_s;
    let over = Over { range, omega_rad_s: &speed, is_cancelled };
    match first.gait.joints {
        [None, None] => Err(MotionError::NotDriven),
        [Some(_), Some(_)] if !first.laws.skids() => Err(MotionError::Determined),
        _ if !first.laws.are_linear() => with_friction::<Dry>(&at, &over, &first),
        _ => with_friction::<Viscous>(&at, &over, &first),
    }
}

/// What branches are followed over.
struct Over<'a> {
    range: [f64; 2],
    omega_rad_s: &'a dyn Fn(f64) -> f64,
    is_cancelled: &'a dyn Fn() -> bool,
}

/// The same for one kind of friction; `first` is the problem at the low end.
fn with_friction<F: Friction>(
    at: &dyn Fn(f64) -> Problem,
    over: &Over,
    first: &Problem,
) -> Result<Vec<Branch>> {
    match (first.gait.passive_joint(), first.laws.skids()) {
        (None, _) => follow(&|value| Skid::<3, F>::new(at(value), 0), over),
        (Some(of), true) => follow(&|value| Skid::<5, F>::new(at(value), of), over),
        (Some(of), false) => follow(&|value| PassiveNoSkid::<F>::new(at(value), of), over),
    }
}

/// All branches of a kind of motion, each with those that begin on it after those that were met before.
fn follow<const N: usize, R: Reduced<N>>(
    model_at: &dyn Fn(f64) -> R,
    &Over { range, omega_rad_s, is_cancelled }: &Over,
) -> Result<Vec<Branch>> {
    let model = model_at(range[0]);
    let mut orbit = PeriodicOrbit::default();
    if orbit.solve(&model, Start::Guess, ACCURACY).is_err() {
        Collocation { model: model.clone(), orbit: &mut orbit }.solve(false, ACCURACY)?;
    }
    let mut waiting = vec![Origin::of_solution(orbit, range[0])];
    let mut found: Vec<Branch> = Vec::new();
    while found.len() < MOST_BRANCHES && !waiting.is_empty() {
        let origin = waiting.remove(0);
        let parent = origin.parent;
        let mut walk = Walk::new(model_at, range, origin, found.len())?;
        let mut branch = walk.walk(is_cancelled)?;
        branch.points.iter_mut().for_each(|point| {
            point.metrics.v_m_s = point.metrics.d_m * omega_rad_s(point.value) / TAU;
        });
        // Where it ends on the branch that it began on, another one would come back from there.
        if let Some(value) = walk.joins_at {
            let near = |of: &Origin<N, R>| (of.value - value).abs() < 1e-3 * (range[1] - range[0]);
            waiting.retain(|of| of.parent != parent || !near(of));
        }
        waiting.append(&mut walk.origins);
        found.push(branch);
    }
    Ok(found)
}

impl Problem {
    /// The problem at another frequency of which the motion is the same per radian of phase.
    fn per_radian_as(&self, omega_rad_s: f64) -> Self {
        let ratio = omega_rad_s / self.omega_rad_s;
        let mut problem = Self { omega_rad_s, ..self.clone() };
        for parameter in Parameter::ALL.into_iter().filter(|of| !of.is_sum()) {
            let value = parameter.of(&self.robot) * ratio.powf(parameter.power_of_omega());
            parameter.set(&mut problem.robot, value);
        }
        problem
    }
}
