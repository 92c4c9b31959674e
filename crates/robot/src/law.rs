//! Friction laws of the wheels for skidding and rolling.

use trilink_base::named;

use super::{Gait, Parameter, Quantity, Robot};

named! {
    /// Law of a wheel's resistance to skidding.
    pub enum SkidLaw {
        /// No-skid constraint `W q' = 0`.
        Constrained = "constrained",
        /// No resistance.
        None = "none",
        /// Viscous resistance, proportional to the skid velocity (eq. 15 of the paper).
        Viscous = "viscous",
        /// Dry friction.
        Coulomb = "coulomb",
        /// Dry and viscous friction.
        CoulombViscous = "coulomb-viscous",
        /// Dry friction that is larger at low speeds (Stribeck effect).
        Stribeck = "stribeck",
        /// Stribeck and viscous friction.
        StribeckViscous = "stribeck-viscous",
        /// Resistance proportional to a power of the skid velocity.
        Power = "power",
    }
}

named! {
    /// Law of a wheel's resistance to rolling.
    pub enum RollLaw {
        /// No resistance.
        None = "none",
        /// Viscous resistance, proportional to the roll velocity (eq. 14 of the paper).
        Viscous = "viscous",
        /// Dry friction.
        Coulomb = "coulomb",
        /// Dry and viscous friction.
        CoulombViscous = "coulomb-viscous",
    }
}

impl SkidLaw {
    /// Returns whether the law has a viscous term.
    pub fn is_viscous(self) -> bool {
        matches!(self, Self::Viscous | Self::CoulombViscous | Self::StribeckViscous)
    }

    /// Returns whether the law has a dry-friction term.
    pub fn is_dry(self) -> bool {
        matches!(self, Self::Coulomb | Self::CoulombViscous) || self.has_static()
    }

    /// Returns whether dry friction is larger at low speeds (Stribeck effect).
    pub fn has_static(self) -> bool {
        matches!(self, Self::Stribeck | Self::StribeckViscous)
    }
}

impl RollLaw {
    /// Returns whether the law has a viscous term.
    pub fn is_viscous(self) -> bool {
        matches!(self, Self::Viscous | Self::CoulombViscous)
    }

    /// Returns whether the law has a dry-friction term.
    pub fn is_dry(self) -> bool {
        matches!(self, Self::Coulomb | Self::CoulombViscous)
    }
}

/// Friction laws of a robot's wheels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Laws {
    pub skid: SkidLaw,
    pub roll: RollLaw,
}

impl Laws {
    /// No-skid wheels that roll freely.
    pub const NO_SKID: Self = Self { skid: SkidLaw::Constrained, roll: RollLaw::None };
    /// No-skid wheels with viscous rolling resistance.
    pub const NO_SKID_ROLL: Self = Self { roll: RollLaw::Viscous, ..Self::NO_SKID };
    /// Viscous skid resistance; the wheels roll freely.
    pub const SKID: Self = Self { skid: SkidLaw::Viscous, ..Self::NO_SKID };
    /// Viscous skid and rolling resistance.
    pub const SKID_ROLL: Self = Self { skid: SkidLaw::Viscous, ..Self::NO_SKID_ROLL };
    /// Dry skid friction and viscous rolling resistance.
    pub const COULOMB: Self = Self { skid: SkidLaw::Coulomb, ..Self::NO_SKID_ROLL };
    /// Dry and viscous skid friction, and viscous rolling resistance.
    pub const COULOMB_VISCOUS: Self = Self { skid: SkidLaw::CoulombViscous, ..Self::NO_SKID_ROLL };

    /// Returns whether the wheels can skid.
    pub fn skids(self) -> bool {
        self.skid != SkidLaw::Constrained
    }

    /// Returns whether any friction is dry.
    pub fn are_dry(self) -> bool {
        self.skid.is_dry() || self.roll.is_dry()
    }

    /// Returns whether every friction force is proportional to the wheel's velocity in the direction of the
    /// force.
    pub fn are_linear(self) -> bool {
        !self.are_dry() && self.skid != SkidLaw::Power
    }

    /// Returns the robot with the coefficients that these friction laws do not use set to zero.
    pub fn effective(self, robot: &Robot) -> Robot {
        let mut robot = robot.clone();
        for quantity in Quantity::ALL {
            if quantity.definition().is_resistance && !self.is_used(quantity) {
                quantity.numbers_mut(&mut robot).fill(0.0);
            }
        }
        robot
    }

    /// Returns whether, under these laws, there is a gait for which the motion depends on a quantity.
    pub fn is_used(self, quantity: Quantity) -> bool {
        (quantity.definition().is_relevant)(self, &Gait::NONE)
    }

    /// Returns whether, under these laws, the motion of a robot of three links with the given gait depends on a parameter.
    pub fn is_relevant(self, parameter: Parameter, gait: &Gait) -> bool {
        parameter.is_of_three_links() && (parameter.quantity().definition().is_relevant)(self, gait)
    }
}
