//! Which forces resist the wheels.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::{Family, Gait, Parameter};

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

    /// Whether the motion of a robot with this gait can depend on a parameter.
    pub fn knows(self, parameter: Parameter, gait: &Gait) -> bool {
        match parameter.family() {
            Family::Skid => self.skids(),
            Family::Roll => self.has_roll_resistance(),
            Family::Joint => gait.passive_joint().is_some(),
        }
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.name())
    }
}
