//! The models' motion: steady periodic solutions and the transients from rest.
//!
//! Every solution but those of eq. 3, which take quadrature, comes from collocation with Radau IIA: a
//! transient is integrated one element after the other, a steady motion (limit cycle) is a periodic
//! boundary value problem that is solved for all elements at once. Equations are those of Raz and Or,
//! *Locomotion Dynamics of an Underactuated Three-Link Robotic Vehicle*.
//!
//! A [`Problem`] is a robot, a gait, friction laws and a frequency. In reading order:
//!
//! - The equations (eq. 7) in the states that matter: `reduced`; `quadrature` (eq. 3, where no wheel
//!   skids and no joint is passive).
//! - Collocation: `radau`, `element`, `lu`, `mesh`, then `transient` and `orbit`, the periodic problem
//!   with its Floquet multipliers; `method` and `solver` ([`Solver`], which also gives the [`Attractor`])
//!   choose among them.
//! - What a solution says, as [`SteadyMotion`] and [`Sample`]: `cycle`, `extreme`, `path`, `forces`,
//!   `trajectory`.
//! - Its derivatives, by adjoints: `sensitivity` and `gradient` ([`Derivatives`]).
//! - Which motion it is: `attractor` (the one reached from rest), `branch` ([`branches`] through folds, by
//!   numerical continuation), `sharp` ([`SharpLimit`], regularised Coulomb friction as the transition
//!   speed goes to zero).
//!
//! ```
//! use trilink_mechanics::{Laws, Problem, REFERENCE_ACCURACY};
//! use trilink_robot::{Gait, Robot};
//!
//! let robot = Robot { skid_kg_s: [104.0, 34.0, 45.0], ..Robot::kinematic() };
//! let gait = Gait::symmetric();
//! let problem = Problem { robot, gait, laws: Laws::SKID_ROLL, omega_rad_s: 3.9 };
//! let motion = problem.solve(REFERENCE_ACCURACY)?;
//! assert!((motion.metrics.d_m - 0.478359748170948).abs() < 1e-10);
//! assert!(motion.floquet.is_some_and(|modulus| modulus < 1.0));
//! # Ok::<(), trilink_mechanics::MotionError>(())
//! ```
//!
//! The example `floquet` prints d, v and the multipliers over frequency.

mod attractor;
mod branch;
mod cycle;
mod element;
mod extreme;
mod forces;
mod gradient;
mod lu;
mod mesh;
mod method;
mod orbit;
mod path;
mod quadrature;
mod radau;
mod reduced;
mod sensitivity;
mod sharp;
mod solver;
mod trajectory;
mod transient;

use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_robot::{Gait, Robot};

pub use branch::{Branch, BranchPoint, branches};
pub use orbit::Effort;
pub use reduced::Derivatives;
pub use sharp::SharpLimit;
pub use solver::{Attractor, Solver};
pub use trajectory::Sample;
pub use trilink_robot::ContactForces;
pub use trilink_robot::metrics::{FromRest, MotionStatus};
pub use trilink_robot::{Laws, Model, Pose};

/// A result of this crate.
pub(crate) type Result<T> = std::result::Result<T, MotionError>;

/// Why there is no motion to report.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MotionError {
    #[error(
        "at phase {phase_rad:.4} rad the gait crosses det W_b = 0 without meeting condition (5)"
    )]
    Singular { phase_rad: f64 },
    #[error("Newton's method found no periodic motion in {steps} steps")]
    NotConverged { steps: usize },
    #[error("the motion is too rough to resolve: {error:.1e} of it is missed")]
    Unresolved { error: f64 },
    #[error("the integrator cannot pass {time_s} s")]
    Stuck { time_s: f64 },
    #[error("from rest the motion has not settled after {cycles} cycles{}", repeats(*repeats_after))]
    Unsettled {
        cycles: usize,
        /// Number of cycles after which the motion repeats itself, if it does.
        repeats_after: Option<usize>,
    },
    #[error("nothing has been solved for yet")]
    Unsolved,
    #[error("eq. 3 gives this motion at every moment: there is nothing to follow")]
    Determined,
    #[error("a robot without a commanded joint does not move")]
    NotDriven,
    #[error("the offset, amplitude and phase of the commanded joints were not measured")]
    GaitUnknown,
    #[error("cancelled")]
    Cancelled,
}

fn repeats(after: Option<usize>) -> String {
    after.map_or(String::new(), |cycles| format!(": it repeats itself every {cycles} cycles"))
}

impl MotionError {
    /// The status of a motion that was not found for this reason.
    pub fn status(&self) -> MotionStatus {
        match self {
            Self::Singular { .. } => MotionStatus::Singular,
            Self::GaitUnknown => MotionStatus::Failed,
            _ => MotionStatus::Diverged,
        }
    }
}

/// A robot under friction laws and a gait at one frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem {
    pub robot: Robot,
    pub gait: Gait,
    pub laws: Laws,
    pub omega_rad_s: f64,
}

/// Relative accuracy of the metrics for reports: about ten digits.
pub const REFERENCE_ACCURACY: f64 = 1e-10;
/// Relative accuracy of solutions whose forces are asked for: those of wheels that skid are large
/// coefficients times velocities that are nearly nothing.
pub const FORCES_ACCURACY: f64 = 1e-12;
/// Relative accuracy for fits: far below what a measurement tells.
pub const FIT_ACCURACY: f64 = 1e-6;

impl Problem {
    /// Solves for the steady periodic motion to a relative `accuracy` of its metrics, and for
    /// its stability. A [`Solver`] does the same many times over and allocates for the first only.
    ///
    /// # Errors
    /// There is no such motion, or it could not be found or resolved.
    pub fn solve(&self, accuracy: f64) -> Result<SteadyMotion> {
        let mut solver = Solver::default();
        let metrics = solver.solve(self, accuracy)?;
        solver.steady_motion(metrics)
    }

    /// Coordinates `(x, y, theta, phi1, phi2)`, m and rad, at `rate_hz` over `duration_s` from rest
    /// at phase 0, with a relative error of every element near `tolerance`.
    ///
    /// # Errors
    /// The integrator cannot pass some time, or there is no motion.
    pub fn transient(
        &self,
        duration_s: f64,
        rate_hz: f64,
        tolerance: f64,
    ) -> Result<Vec<[f64; 5]>> {
        self.varied_transient(&[], duration_s, rate_hz, tolerance)
    }

    /// The same where all friction of the wheels in cycle i is scaled by `friction[i]`; cycles beyond
    /// the slice are unscaled.
    ///
    /// # Errors
    /// As [`Problem::transient`].
    pub fn varied_transient(
        &self,
        friction: &[f64],
        duration_s: f64,
        rate_hz: f64,
        tolerance: f64,
    ) -> Result<Vec<[f64; 5]>> {
        let time = transient::Frames { friction, duration_s, rate_hz };
        Solver::default().with(self, |method| method.transient(&time, tolerance))
    }

    /// The first `cycles` cycles from rest at phase 0, `samples` a cycle and one at the end.
    ///
    /// # Errors
    /// The integrator cannot pass some time, or there is no motion.
    pub fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<Sample>> {
        Solver::default().with(self, |method| method.cycles_from_rest(cycles, samples))
    }

    /// Whether eq. 3 gives the motion: both joints are commanded and the wheels cannot skid.
    fn is_determined(&self) -> bool {
        !self.laws.skids() && self.gait.passive_joint().is_none()
    }

    /// The same with a transition of dry friction that is `factor` times as wide.
    fn softened(&self, factor: f64) -> Self {
        let mut problem = self.clone();
        problem.robot.transition_m_s *= factor;
        problem
    }

    /// The same with all friction of the wheels times a factor.
    fn resisted(&self, factor: f64) -> Self {
        Self { robot: self.robot.resisted(factor), ..self.clone() }
    }

    /// The same with the coefficients that the laws do not use set to zero.
    fn effective(&self) -> Self {
        Self { robot: self.laws.effective(&self.robot), ..self.clone() }
    }
}

/// A steady periodic motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SteadyMotion {
    pub metrics: GaitMetrics,
    /// Modulus of the largest Floquet multiplier of the reduced motion; `None` where the
    /// motion has no states of its own.
    pub floquet: Option<f64>,
    /// Work of the actuators over a cycle, J.
    pub work_j: f64,
    /// Whether it has lost the commands' symmetry (mirror image, half a period later) and so belongs to
    /// a mirror-image pair (pitchfork).
    pub is_symmetry_broken: bool,
}

impl SteadyMotion {
    /// The metrics in the order of their fields, then the work.
    pub fn to_array(&self) -> [f64; Metric::ALL.len() + 1] {
        let mut values = [self.work_j; Metric::ALL.len() + 1];
        values[..Metric::ALL.len()].copy_from_slice(&self.metrics.to_array());
        values
    }

    /// Whether it is stable, and whether it has lost the commands' symmetry.
    pub fn status(&self) -> MotionStatus {
        MotionStatus::new(self.floquet, self.is_symmetry_broken)
    }
}
