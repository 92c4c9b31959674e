//! The laws by which the wheels resist skidding and rolling.

use trilink_base::named;

use super::{Family, Gait, Parameter, Robot};

named! {
    /// What resists a wheel's motion across it.
    pub enum SkidLaw {
        /// The wheel cannot skid: W q' = 0.
        Constrained = "constrained",
        /// Nothing.
        None = "none",
        /// In proportion to the skid velocity (eq. 15).
        Viscous = "viscous",
        /// Dry friction.
        Coulomb = "coulomb",
        /// Both.
        CoulombViscous = "coulomb-viscous",
        /// Dry friction that is larger at low speeds.
        Stribeck = "stribeck",
        /// The same, and in proportion to the skid velocity.
        StribeckViscous = "stribeck-viscous",
    }
}

named! {
    /// What resists a wheel's rolling.
    pub enum RollLaw {
        /// Nothing.
        None = "none",
        /// In proportion to the roll velocity (eq. 14).
        Viscous = "viscous",
        /// Dry friction.
        Coulomb = "coulomb",
        /// Both.
        CoulombViscous = "coulomb-viscous",
    }
}

impl SkidLaw {
    /// Whether there is a part in proportion to the velocity.
    pub fn is_viscous(self) -> bool {
        matches!(self, Self::Viscous | Self::CoulombViscous | Self::StribeckViscous)
    }

    /// Whether there is dry friction.
    pub fn is_dry(self) -> bool {
        matches!(self, Self::Coulomb | Self::CoulombViscous) || self.has_static()
    }

    /// Whether dry friction is larger at low speeds.
    pub fn has_static(self) -> bool {
        matches!(self, Self::Stribeck | Self::StribeckViscous)
    }
}

impl RollLaw {
    /// Whether there is a part in proportion to the velocity.
    pub fn is_viscous(self) -> bool {
        matches!(self, Self::Viscous | Self::CoulombViscous)
    }

    /// Whether there is dry friction.
    pub fn is_dry(self) -> bool {
        matches!(self, Self::Coulomb | Self::CoulombViscous)
    }
}

/// The laws of a robot's wheels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Laws {
    pub skid: SkidLaw,
    pub roll: RollLaw,
}

impl Laws {
    /// Wheels that cannot skid and roll freely.
    pub const NO_SKID: Self = Self { skid: SkidLaw::Constrained, roll: RollLaw::None };
    /// Wheels that cannot skid, with viscous roll resistance.
    pub const NO_SKID_ROLL: Self = Self { roll: RollLaw::Viscous, ..Self::NO_SKID };
    /// Viscous skid resistance.
    pub const SKID: Self = Self { skid: SkidLaw::Viscous, ..Self::NO_SKID };
    /// Viscous skid and roll resistance.
    pub const SKID_ROLL: Self = Self { skid: SkidLaw::Viscous, ..Self::NO_SKID_ROLL };
    /// Dry skid friction, viscous roll resistance.
    pub const COULOMB: Self = Self { skid: SkidLaw::Coulomb, ..Self::NO_SKID_ROLL };
    /// Dry and viscous skid friction, viscous roll resistance.
    pub const COULOMB_VISCOUS: Self = Self { skid: SkidLaw::CoulombViscous, ..Self::NO_SKID_ROLL };

    /// Whether the wheels can skid.
    pub fn skids(self) -> bool {
        self.skid != SkidLaw::Constrained
    }

    /// Whether any friction is dry.
    pub fn are_dry(self) -> bool {
        self.skid.is_dry() || self.roll.is_dry()
    }

    /// A robot without the resistances that the laws do not know.
    pub fn effective(self, robot: &Robot) -> Robot {
        let mut robot = robot.clone();
        if !self.roll.is_viscous() {
            robot.roll_kg_s = [0.0; 3];
        }
        if !self.skid.is_viscous() {
            robot.skid_kg_s = [0.0; 3];
        }
        if !self.skid.is_dry() {
            robot.skid_dry_n = [0.0; 3];
        }
        if !self.skid.has_static() {
            robot.stribeck_m_s = 0.0;
        }
        if !self.roll.is_dry() {
            robot.roll_dry_n = [0.0; 3];
        }
        robot
    }

    /// Whether the motion of a robot with this gait can depend on a parameter.
    pub fn know(self, parameter: Parameter, gait: &Gait) -> bool {
        match parameter.family() {
            Family::Skid => self.skid.is_viscous(),
            Family::SkidDry => self.skid.is_dry(),
            Family::Stribeck => self.skid.has_static(),
            Family::Roll => self.roll.is_viscous(),
            Family::RollDry => self.roll.is_dry(),
            Family::Transition => self.are_dry(),
            Family::Joint => gait.passive_joint().is_some(),
        }
    }
}
