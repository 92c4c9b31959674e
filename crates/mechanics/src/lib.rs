//! Motion of the models: steady-state periodic motions and transients from rest.
//!
//! Except for the motions that eq. 3 determines, which are integrated by quadrature, solutions are computed
//! by Radau IIA collocation: a transient is integrated element by element, and a steady-state motion (limit
//! cycle) is a periodic boundary value problem, solved for all collocation elements at once. Equation numbers
//! are those of Raz and Or, *Locomotion Dynamics of an Underactuated Three-Link Robotic Vehicle*.
//!
//! A [`Problem`] is a robot, a gait, friction laws and a frequency. In reading order:
//!
//! - Equations of motion of chains of links (for the paper's robot, eq. 7, or eq. 3 where constraints determine the
//!   motion): `chain`, behind the interface `reduced`.
//! - Collocation: `radau`, `element`, `lu`, `mesh`, then `transient` and `orbit`, the periodic problem
//!   with its Floquet multipliers; `method` and `solver` ([`Solver`], which also gives the [`Attractor`]).
//! - Results, as [`SteadyMotion`] and [`Sample`]: `cycle`, `extreme`, `path`, `trajectory`.
//! - Derivatives of the results by the adjoint method: `orbit::adjoint` and `chain::derivative`.
//! - Selection among several motions: `attractor` (the motion reached from rest), `branch` ([`branches`]
//!   through folds, by numerical continuation), `sharp` ([`SharpLimit`], the limit of zero transition
//!   speed of regularised Coulomb friction).
//!
//! ```
//! use trilink_mechanics::{Laws, Problem, REFERENCE_ACCURACY};
//! use trilink_robot::{Gait, Robot};
//!
//! let robot = Robot { skid_kg_s: [104.0, 34.0, 45.0], ..Robot::kinematic() };
//! let gait = Gait::symmetric();
//! let problem = Problem::new(robot, gait, Laws::SKID_ROLL, 3.9);
//! let motion = problem.solve(REFERENCE_ACCURACY)?;
//! assert!((motion.metrics.d_m - 0.478359748170948).abs() < 1e-10);
//! assert!(motion.floquet.is_some_and(|modulus| modulus < 1.0));
//! # Ok::<(), trilink_mechanics::MotionError>(())
//! ```
//!
//! The example `floquet` prints d, v and the Floquet multipliers against frequency; `own_friction` solves
//! motions under a friction law that the caller defines ([`Solver::with_friction`]).

mod attractor;
mod branch;
mod chain;
mod cycle;
mod element;
mod extreme;
mod lu;
mod mesh;
mod method;
mod orbit;
mod path;
mod problem;
mod radau;
mod reduced;
mod sample;
mod sharp;
mod solver;
mod trajectory;
mod transient;

use trilink_robot::metrics::{GaitMetrics, Metric};

pub use branch::{Branch, BranchPoint, branches};
pub use orbit::Effort;
pub use problem::Problem;
pub use sample::Sample;
pub use sharp::SharpLimit;
pub use solver::{Attractor, InputDerivatives, NumberDerivatives, Solver};
pub use transient::Posture;
pub use trilink_robot::metrics::{FromRest, MotionStatus};
pub use trilink_robot::{Laws, Model, Pose};

/// Result of computing a motion.
pub(crate) type Result<T> = std::result::Result<T, MotionError>;

/// Reason why a motion could not be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MotionError {
    #[error(
        "no skid-free motion exists: the gait passes through a singular shape (det W_b = 0, eq. 4) at phase \
         {phase_rad:.4} rad, where condition (5) of the paper fails"
    )]
    Singular { phase_rad: f64 },
    #[error("Newton's method found no periodic motion in {steps} steps")]
    NotConverged { steps: usize },
    #[error("the discretisation error {error:.1e} exceeds the tolerance on the finest mesh")]
    Unresolved { error: f64 },
    #[error(
        "the transient cannot be integrated beyond {time_s} s: the step size becomes too small"
    )]
    Stuck { time_s: f64 },
    #[error("starting from rest, the motion has not settled after {cycles} cycles{}", repeats(*repeats_after))]
    Unsettled {
        cycles: usize,
        /// Number of cycles after which the motion repeats; `None` if it does not.
        repeats_after: Option<usize>,
    },
    #[error("no motion has been computed yet")]
    Unsolved,
    #[error(
        "this motion follows from eq. 3 of the paper and has no dynamic states, so there is no branch to trace"
    )]
    Determined,
    #[error("the gait moves no joint and no rotor, so the robot does not move")]
    NotDriven,
    #[error("the offset, amplitude and phase of the commanded joints were not measured")]
    GaitUnknown,
    #[error(transparent)]
    Chain(#[from] trilink_robot::ChainError),
    #[error(
        "nothing resists the motion: no wheel has friction and no link has drag, so it has no steady state"
    )]
    NotResisted,
    #[error(
        "{wheels} wheels that cannot skid constrain only {velocities} velocities (three of the robot, and one for each joint \
         that is not driven): free {} more of the joints, or take wheels away",
        wheels - velocities
    )]
    Overconstrained { wheels: usize, velocities: usize },
    #[error(
        "the constraints of the wheels that cannot skid depend on each other in the mean shape, so the motion that they \
         allow is not determined: let the wheels skid, bend the chain, free joints, or take wheels away"
    )]
    Dependent,
    #[error("cancelled")]
    Cancelled,
}

fn repeats(after: Option<usize>) -> String {
    after.map_or(String::new(), |cycles| format!(": it repeats itself every {cycles} cycles"))
}

impl MotionError {
    /// Returns the status to report for a motion that was not found for this reason.
    pub fn status(&self) -> MotionStatus {
        match self {
            Self::Singular { .. } | Self::Dependent => MotionStatus::Singular,
            Self::GaitUnknown
            | Self::Chain(_)
            | Self::NotDriven
            | Self::NotResisted
            | Self::Overconstrained { .. } => MotionStatus::Failed,
            _ => MotionStatus::Diverged,
        }
    }
}

/// Relative accuracy of the metrics in reports, about ten digits.
pub const REFERENCE_ACCURACY: f64 = 1e-10;
/// Relative accuracy of solutions from which forces are computed, because the forces on skidding wheels are
/// products of large coefficients and very small velocities.
pub const FORCES_ACCURACY: f64 = 1e-12;
/// Relative accuracy of the metrics in fits, far below the measurement uncertainty.
pub const FIT_ACCURACY: f64 = 1e-6;

/// Steady-state periodic motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SteadyMotion {
    pub metrics: GaitMetrics,
    /// Modulus of the largest Floquet multiplier of the dynamic states; `None` if there are none, because the
    /// no-skid constraints alone determine the motion (eq. 3 of the paper).
    pub floquet: Option<f64>,
    /// Work of the actuators over a cycle, J.
    pub work_j: f64,
    /// Whether the motion lacks the half-period symmetry of the commands and is therefore one of a
    /// mirror-image pair (pitchfork bifurcation).
    pub is_symmetry_broken: bool,
}

impl SteadyMotion {
    /// Returns the metrics in the order of their fields, followed by the work in J.
    pub fn to_array(&self) -> [f64; Metric::OF_THREE_LINKS.len() + 1] {
        let mut values = [self.work_j; Metric::OF_THREE_LINKS.len() + 1];
        values[..Metric::OF_THREE_LINKS.len()].copy_from_slice(&self.metrics.to_array());
        values
    }

    /// Returns the status of the motion: unstable; symmetry-broken, that is, stable without the half-period
    /// symmetry of the commands; or stable.
    pub fn status(&self) -> MotionStatus {
        MotionStatus::new(self.floquet, self.is_symmetry_broken)
    }
}
