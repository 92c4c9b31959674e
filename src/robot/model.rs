//! Which forces resist the wheels.

use super::{Family, Gait, Parameter};
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
    /// Whether the wheels can skid.
    pub fn skids(self) -> bool {
        matches!(self, Self::Skid | Self::SkidRoll)
    }

    /// Whether the wheels resist rolling.
    pub fn has_roll_resistance(self) -> bool {
        matches!(self, Self::NoSkidRoll | Self::SkidRoll)
    }

    /// Whether the motion of a robot with this gait can depend on a parameter.
    pub fn knows(self, parameter: Parameter, gait: &Gait) -> bool {
        match parameter.family() {
            Family::Skid => self.skids(),
            Family::Roll => self.has_roll_resistance(),
            Family::Joint => gait.passive_joint().is_some(),
        }
    }
}
