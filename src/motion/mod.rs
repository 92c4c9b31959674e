//! The models' motion: steady periodic solutions and the way there from rest.
//!
//! Every solution comes from collocation by the same rule ([`radau`]): a transient follows one
//! element after the other, a steady motion closes them to a ring and solves for all at once.

mod cycle;
mod element;
mod kinematic;
mod lu;
mod path;
mod periodic;
mod radau;
mod reduced;
mod transient;

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::metrics::GaitMetrics;
use crate::robot::{Gait, Robot};
use periodic::{Orbit, Search, Start};
use reduced::{Driven, KinematicSkid, PassiveNoSkid, PassiveSkid, Reduced};

pub use transient::Transient;

/// Which forces resist the wheels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// `W q' = 0`, damping of the passive joint only.
    NoSkid,
    /// The same, driven by the measured gait of each trial.
    NoSkidMeasured,
    /// `W q' = 0` with the joint's damping free in the fit.
    NoSkidDamped,
    /// `W q' = 0` with roll resistance.
    NoSkidRoll,
    /// Skid resistance instead of constraints.
    Skid,
    /// Skid and roll resistance.
    SkidRoll,
}

impl Model {
    /// Every model.
    pub const ALL: [Self; 6] = [
        Self::NoSkid,
        Self::NoSkidMeasured,
        Self::NoSkidDamped,
        Self::NoSkidRoll,
        Self::Skid,
        Self::SkidRoll,
    ];

    /// The model's name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoSkid => "no-skid",
            Self::NoSkidMeasured => "no-skid-measured",
            Self::NoSkidDamped => "no-skid-damped",
            Self::NoSkidRoll => "no-skid-roll",
            Self::Skid => "skid",
            Self::SkidRoll => "skid-roll",
        }
    }

    /// Whether the wheels can skid.
    pub fn skids(self) -> bool {
        matches!(self, Self::Skid | Self::SkidRoll)
    }

    /// Whether the wheels resist rolling.
    pub fn has_roll_resistance(self) -> bool {
        matches!(self, Self::NoSkidRoll | Self::SkidRoll)
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Why there is no motion to report.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MotionError {
    #[error(
        "at phase {phase_rad:.4} rad the gait crosses det W_b = 0 without meeting condition (5)"
    )]
    Singular { phase_rad: f64 },
    #[error("Newton's method found no periodic motion in {steps} steps")]
    NotConverged { steps: usize },
    #[error("the motion is too rough to resolve: {tail:.1e} of its spectrum is left")]
    Unresolved { tail: f64 },
    #[error("the integrator cannot pass {time_s} s")]
    Stuck { time_s: f64 },
    #[error("a robot without a commanded joint does not move")]
    NotDriven,
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

/// A steady periodic motion.
#[derive(Debug, Clone)]
pub struct SteadyMotion {
    pub metrics: GaitMetrics,
    /// Modulus of the largest Floquet multiplier of the reduced motion; `None` where the
    /// motion has no states of its own.
    pub floquet: Option<f64>,
    orbit: AnyOrbit,
}

impl SteadyMotion {
    /// `stable` or `unstable`.
    pub fn status(&self) -> &'static str {
        match self.floquet {
            Some(modulus) if modulus >= 1.0 => "unstable",
            _ => "stable",
        }
    }

    /// Newton steps that the solution took.
    pub fn newton_steps(&self) -> usize {
        match &self.orbit {
            AnyOrbit::None => 0,
            AnyOrbit::Kinematic(orbit) => orbit.steps,
            AnyOrbit::Skid(orbit) => orbit.steps,
            AnyOrbit::NoSkid(orbit) => orbit.steps,
        }
    }
}

#[derive(Debug, Clone)]
enum AnyOrbit {
    None,
    Kinematic(Orbit<3>),
    Skid(Orbit<5>),
    NoSkid(Orbit<2>),
}

/// How accurately a steady motion is solved for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Accuracy {
    /// d, v, sigma and alpha_1 to about ten digits.
    Reference,
    /// To 1e-6 or better: far below what a measurement tells, for fits.
    Fit,
}

impl Accuracy {
    fn search(self) -> Search {
        match self {
            Self::Reference => Search { elements: 32, tail: 3e-7 },
            Self::Fit => Search { elements: 8, tail: 2e-5 },
        }
    }
}

impl Problem {
    /// Solves for the steady periodic motion, from a neighbouring solution if one is given.
    ///
    /// # Errors
    /// There is no such motion, or it could not be found or resolved.
    pub fn solve(
        &self,
        guess: Option<&SteadyMotion>,
        accuracy: Accuracy,
    ) -> Result<SteadyMotion, MotionError> {
        let driven = self.driven();
        let search = accuracy.search();
        match (self.gait.joints, self.gait.passive_joint()) {
            ([Some(joint1), Some(joint2)], _) if !self.model.skids() => {
                let metrics = kinematic::solve(&self.robot, [joint1, joint2], self.omega_rad_s)?;
                Ok(SteadyMotion { metrics, floquet: None, orbit: AnyOrbit::None })
            }
            ([Some(_), Some(_)], _) => {
                let guess = guess.and_then(|motion| match &motion.orbit {
                    AnyOrbit::Kinematic(orbit) => Some(orbit),
                    _ => None,
                });
                steady(&KinematicSkid(driven.clone()), &driven, guess, search, AnyOrbit::Kinematic)
            }
            ([None, None], _) | (_, None) => Err(MotionError::NotDriven),
            (_, Some(passive)) if self.model.skids() => {
                let guess = guess.and_then(|motion| match &motion.orbit {
                    AnyOrbit::Skid(orbit) => Some(orbit),
                    _ => None,
                });
                let model = PassiveSkid { driven: driven.clone(), passive };
                steady(&model, &driven, guess, search, AnyOrbit::Skid)
            }
            (_, Some(passive)) => {
                let guess = guess.and_then(|motion| match &motion.orbit {
                    AnyOrbit::NoSkid(orbit) => Some(orbit),
                    _ => None,
                });
                let model = PassiveNoSkid { driven: driven.clone(), passive };
                steady(&model, &driven, guess, search, AnyOrbit::NoSkid)
            }
        }
    }

    /// Follows the motion from rest at phase 0.
    ///
    /// # Errors
    /// The integrator cannot pass a moment, or the model has no states of its own.
    pub fn follow(&self, duration_s: f64, tolerance: f64) -> Result<Transient, MotionError> {
        let driven = self.driven();
        match self.gait.passive_joint() {
            None if self.model.skids() => {
                let model = KinematicSkid(driven.clone());
                Ok(transient::follow(&model, &driven, duration_s, tolerance)?.0)
            }
            Some(passive) if self.model.skids() => {
                let model = PassiveSkid { driven: driven.clone(), passive };
                Ok(transient::follow(&model, &driven, duration_s, tolerance)?.0)
            }
            Some(passive) => {
                let model = PassiveNoSkid { driven: driven.clone(), passive };
                Ok(transient::follow(&model, &driven, duration_s, tolerance)?.0)
            }
            None => Err(MotionError::NotDriven),
        }
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
        }
    }
}

/// Cycles after which a robot that started from rest is near its steady motion.
const SETTLING_CYCLES: f64 = 40.0;

/// Solves for the orbit, from the guess, from rest, or from where the robot settles, and
/// measures it.
fn steady<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    guess: Option<&Orbit<N>>,
    search: Search,
    wrap: fn(Orbit<N>) -> AnyOrbit,
) -> Result<SteadyMotion, MotionError> {
    let omega_rad_s = driven.omega_rad_s;
    let near_guess =
        guess.map(|guess| periodic::solve(model, omega_rad_s, Start::Near(guess), search));
    let orbit = match near_guess {
        Some(Ok(orbit)) => orbit,
        _ => periodic::solve(model, omega_rad_s, Start::Rest, search).or_else(|error| {
            let duration_s = SETTLING_CYCLES * std::f64::consts::TAU / omega_rad_s;
            let settled = transient::follow(model, driven, duration_s, 1e-4).map_err(|_| error)?;
            periodic::solve(model, omega_rad_s, Start::State(settled.1), search)
        })?,
    };
    let metrics = cycle::metrics(model, driven, &orbit);
    Ok(SteadyMotion { metrics, floquet: Some(orbit.floquet), orbit: wrap(orbit) })
}
