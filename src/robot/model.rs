//! Which forces resist the wheels.

use super::{Gait, Laws, Parameter};
use crate::named::named;

named! {
    /// Which forces resist the wheels.
    pub enum Model {
        /// `W q' = 0`, damping of the passive joint only.
        NoSkid = "no-skid",
        /// The same, driven by the measured gait of each trial.
        NoSkidMeasured = "no-skid-measured",
        /// `W q' = 0` with the joint's damping free in the fit.
        NoSkidDamped = "no-skid-damped",
        /// `W q' = 0` with roll resistance.
        NoSkidRoll = "no-skid-roll",
        /// Skid resistance instead of constraints.
        Skid = "skid",
        /// Skid and roll resistance.
        SkidRoll = "skid-roll",
    }
}

impl Model {
    /// The laws of its wheels.
    pub fn laws(self) -> Laws {
        match self {
            Self::NoSkid | Self::NoSkidMeasured | Self::NoSkidDamped => Laws::NO_SKID,
            Self::NoSkidRoll => Laws::NO_SKID_ROLL,
            Self::Skid => Laws::SKID,
            Self::SkidRoll => Laws::SKID_ROLL,
        }
    }

    /// Whether the wheels can skid.
    pub fn skids(self) -> bool {
        self.laws().skids()
    }

    /// Whether the motion of a robot with this gait can depend on a parameter.
    pub fn knows(self, parameter: Parameter, gait: &Gait) -> bool {
        self.laws().know(parameter, gait)
    }
}
