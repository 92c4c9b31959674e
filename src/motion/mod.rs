//! The models' motion: steady periodic solutions and the way there from rest.
//!
//! Every solution comes from collocation by the same rule, Radau IIA: a transient follows one
//! element after the other, a steady motion closes them to a ring and solves for all at once.

mod cycle;
mod element;
mod extreme;
mod forces;
mod kinematic;
mod lu;
mod path;
mod radau;
mod reduced;
mod ring;
mod sensitivity;
mod settle;
mod solver;
mod task;
mod trajectory;
mod transient;

use crate::metrics::GaitMetrics;
use crate::robot::{Gait, Robot};
use reduced::Driven;
use task::{Follow, SampleFromRest};

pub use crate::robot::{Model, Pose};
pub use forces::Actions;
pub use reduced::Derivatives;
pub use solver::{Settled, Solver};
pub use trajectory::Sample;
pub use transient::Transient;

/// Why there is no motion to report.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MotionError {
    #[error(
        "at phase {phase_rad:.4} rad the gait crosses det W_b = 0 without meeting condition (5)"
    )]
    Singular { phase_rad: f64 },
    #[error("Newton's method found no periodic motion in {steps} steps")]
    NotConverged { steps: usize },
    #[error("the motion is too rough to resolve: {missed:.1e} of it is missed")]
    Unresolved { missed: f64 },
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
    #[error("the gait that is to drive the robot was not measured")]
    GaitUnknown,
}

fn repeats(after: Option<usize>) -> String {
    after.map_or(String::new(), |cycles| format!(": it repeats itself every {cycles} cycles"))
}

impl MotionError {
    /// `singular` or `diverged`.
    pub fn status(&self) -> &'static str {
        match self {
            Self::Singular { .. } => "singular",
            _ => "diverged",
        }
    }
}

/// A model of a robot under a gait at one frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem {
    pub robot: Robot,
    pub gait: Gait,
    pub model: Model,
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
    /// its stability. A [`Solver`] does the same many times over without allocating.
    ///
    /// # Errors
    /// There is no such motion, or it could not be found or resolved.
    pub fn solve(&self, accuracy: f64) -> Result<SteadyMotion, MotionError> {
        let mut solver = Solver::default();
        let metrics = solver.solve(self, accuracy)?;
        solver.motion(metrics)
    }

    /// Follows the motion from rest at phase 0 for `duration_s`, with a relative error of every
    /// element near `tolerance`.
    ///
    /// # Errors
    /// The integrator cannot pass a moment, or the model has no states of its own.
    pub fn follow(&self, duration_s: f64, tolerance: f64) -> Result<Transient, MotionError> {
        Solver::default().dispatch(self, Follow { duration_s, tolerance })
    }

    /// The first `cycles` cycles from rest at phase 0, `samples` a cycle and one at the end.
    ///
    /// # Errors
    /// The integrator cannot pass a moment, or there is no motion.
    pub fn cycles_from_rest(
        &self,
        cycles: usize,
        samples: usize,
    ) -> Result<Vec<Sample>, MotionError> {
        Solver::default().dispatch(self, SampleFromRest { cycles, samples })
    }

    /// Whether eq. 3 gives the motion: both joints are commanded and the wheels cannot skid.
    fn is_determined(&self) -> bool {
        !self.model.skids() && self.gait.passive_joint().is_none()
    }

    /// The robot with the resistances that the model knows.
    fn driven(&self) -> Driven {
        let mut robot = self.robot.clone();
        if !self.model.has_roll_resistance() {
            robot.roll_kg_s = [0.0; 3];
        }
        if !self.model.skids() {
            robot.skid_kg_s = [0.0; 3];
        }
        Driven {
            robot,
            gait: self.gait,
            omega_rad_s: self.omega_rad_s,
            model_skids: self.model.skids(),
            model_rolls: self.model.has_roll_resistance(),
        }
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
    /// Newton steps that the solution took.
    pub newton_steps: usize,
}

impl SteadyMotion {
    /// `stable` or `unstable`.
    pub fn status(&self) -> &'static str {
        match self.floquet {
            Some(modulus) if modulus >= 1.0 => "unstable",
            _ => "stable",
        }
    }
}
