//! The laws by which the wheels resist skidding and rolling.

use trilink_base::named;

use super::{Gait, Parameter, Quantity, Robot};

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
        /// In proportion to a power of the skid velocity.
        Power = "power",
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
    /// Wheels that roll freely and cannot skid.
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

    /// Whether every force is in proportion to its velocity.
    pub fn are_linear(self) -> bool {
        !self.are_dry() && self.skid != SkidLaw::Power
    }

    /// A robot with the coefficients that the laws do not use set to zero.
    pub fn effective(self, robot: &Robot) -> Robot {
        let mut robot = robot.clone();
        for quantity in Quantity::ALL {
            if quantity.definition().is_resistance && !self.wheels_need(quantity) {
                quantity.numbers_mut(&mut robot).fill(0.0);
            }
        }
        robot
    }

    /// Whether the motion depends on a quantity whatever the joints do.
    pub fn wheels_need(self, quantity: Quantity) -> bool {
        (quantity.definition().matters)(self, &Gait { joints: [None, None] })
    }

    /// Whether the motion of a robot with this gait can depend on a parameter.
    pub fn know(self, parameter: Parameter, gait: &Gait) -> bool {
        (parameter.quantity().definition().matters)(self, gait)
    }
}
