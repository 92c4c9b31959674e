//! The robot's parameters that a fit can free: the one list of them.

use std::ops::{Index, IndexMut};

use serde::{Serialize, Serializer};

use super::Robot;
use crate::named::Named;

/// What a parameter belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// Resistance of the wheels to skidding.
    Skid,
    /// Resistance of the wheels to rolling.
    Roll,
    /// The passive joint.
    Joint,
}

/// Defines [`Parameter`]: variant, family, name in the configuration, column in the
/// tables, name on an axis, unit.
macro_rules! parameters {
    ($($(#[$doc:meta])* $name:ident, $family:ident, $key:literal, $column:literal, $label:literal, $unit:literal;)*) => {
        /// A parameter of the robot that a fit can free.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Parameter { $($(#[$doc])* $name,)* }

        impl Parameter {
            /// Every parameter, in the order of the tables.
            pub const ALL: [Self; [$($key),*].len()] = [$(Self::$name),*];

            /// What it belongs to.
            pub fn family(self) -> Family {
                match self { $(Self::$name => Family::$family,)* }
            }

            /// Its name in the configuration.
            pub fn key(self) -> &'static str {
                match self { $(Self::$name => $key,)* }
            }

            /// Its column in the tables.
            pub fn column(self) -> &'static str {
                match self { $(Self::$name => $column,)* }
            }

            /// Its name on a figure's axis.
            pub fn label(self) -> &'static str {
                match self { $(Self::$name => $label,)* }
            }

            /// The unit of its values.
            pub fn unit(self) -> &'static str {
                match self { $(Self::$name => $unit,)* }
            }
        }
    };
}

parameters! {
    /// Skid resistance of wheel 0 (eq. 15).
    Skid0, Skid, "skid0", "skid0_kg_s", "Skid 0", "kg/s";
    Skid1, Skid, "skid1", "skid1_kg_s", "Skid 1", "kg/s";
    Skid2, Skid, "skid2", "skid2_kg_s", "Skid 2", "kg/s";
    /// Roll resistance of wheel 0 (eq. 14).
    Roll0, Roll, "roll0", "roll0_kg_s", "Roll 0", "kg/s";
    Roll1, Roll, "roll1", "roll1_kg_s", "Roll 1", "kg/s";
    Roll2, Roll, "roll2", "roll2_kg_s", "Roll 2", "kg/s";
    /// Sum of the wheels' roll resistances; their proportions stay. Distances and speeds hardly
    /// tell more of them.
    RollSum, Roll, "roll", "roll_sum_kg_s", "Sum of roll", "kg/s";
    /// Stiffness of the passive joint (eq. 11).
    Stiffness, Joint, "stiffness", "stiffness_nm_rad", "Stiffness", "N m/rad";
    /// Damping of the passive joint (eq. 11).
    Damping, Joint, "damping", "damping_nm_s_rad", "Damping", "N m s/rad";
}

impl Parameter {
    /// Skid resistances of wheels 0, 1, 2.
    pub const SKID: [Self; 3] = [Self::Skid0, Self::Skid1, Self::Skid2];
    /// Roll resistances of wheels 0, 1, 2.
    pub const ROLL: [Self; 3] = [Self::Roll0, Self::Roll1, Self::Roll2];

    /// Whether a value of it is one of `other` too: the same, or the sum that it is part of.
    pub fn is_part_of(self, other: Self) -> bool {
        self == other || other == Self::RollSum && Self::ROLL.contains(&self)
    }

    /// Its value in a robot.
    pub fn of(self, robot: &Robot) -> f64 {
        match self {
            Self::Skid0 => robot.skid_kg_s[0],
            Self::Skid1 => robot.skid_kg_s[1],
            Self::Skid2 => robot.skid_kg_s[2],
            Self::Roll0 => robot.roll_kg_s[0],
            Self::Roll1 => robot.roll_kg_s[1],
            Self::Roll2 => robot.roll_kg_s[2],
            Self::RollSum => robot.roll_kg_s.iter().sum(),
            Self::Stiffness => robot.stiffness_nm_rad,
            Self::Damping => robot.damping_nm_s_rad,
        }
    }

    /// Gives it a value in a robot. Without any roll resistance to keep the proportions of, the
    /// wheels share a sum equally.
    pub fn set(self, robot: &mut Robot, value: f64) {
        match self {
            Self::Skid0 => robot.skid_kg_s[0] = value,
            Self::Skid1 => robot.skid_kg_s[1] = value,
            Self::Skid2 => robot.skid_kg_s[2] = value,
            Self::Roll0 => robot.roll_kg_s[0] = value,
            Self::Roll1 => robot.roll_kg_s[1] = value,
            Self::Roll2 => robot.roll_kg_s[2] = value,
            Self::RollSum => robot.roll_kg_s = robot.roll_shares().map(|share| share * value),
            Self::Stiffness => robot.stiffness_nm_rad = value,
            Self::Damping => robot.damping_nm_s_rad = value,
        }
    }
}

/// By its column.
impl Named for Parameter {
    fn first() -> Self {
        Self::ALL[0]
    }

    fn as_name(&self) -> &str {
        self.column()
    }

    fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|parameter| parameter.column() == name)
    }
}

/// By its column.
impl Serialize for Parameter {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.column())
    }
}

/// Something for every parameter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ByParameter<T>(pub(crate) [T; Parameter::ALL.len()]);

impl ByParameter<f64> {
    /// Every value missing.
    pub const MISSING: Self = Self::splat(f64::NAN);
}

impl<T: Copy> ByParameter<T> {
    /// The same for every parameter.
    pub const fn splat(value: T) -> Self {
        Self([value; Parameter::ALL.len()])
    }
}

impl<T> ByParameter<T> {
    /// What `of` gives for every parameter.
    pub fn from_fn(of: impl FnMut(Parameter) -> T) -> Self {
        Self(Parameter::ALL.map(of))
    }

    /// In the order of the tables.
    pub fn iter(&self) -> impl Iterator<Item = (Parameter, &T)> {
        Parameter::ALL.into_iter().zip(&self.0)
    }
}

impl<T> Index<Parameter> for ByParameter<T> {
    type Output = T;
    fn index(&self, parameter: Parameter) -> &T {
        &self.0[parameter as usize]
    }
}

impl<T> IndexMut<Parameter> for ByParameter<T> {
    fn index_mut(&mut self, parameter: Parameter) -> &mut T {
        &mut self.0[parameter as usize]
    }
}

/// A map by column.
impl<T: Serialize> Serialize for ByParameter<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.iter())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parameter_that_is_set_has_its_value() {
        for parameter in Parameter::ALL {
            let mut robot = Robot::semi_passive();
            parameter.set(&mut robot, 2.5);
            assert_eq!(parameter.of(&robot), 2.5, "{parameter:?}");
            assert_eq!(Parameter::of_name(parameter.column()), Some(parameter));
            let others = Parameter::ALL.into_iter().filter(|other| {
                let related = [other.is_part_of(parameter), parameter.is_part_of(*other)];
                !related.contains(&true)
            });
            for other in others {
                assert_eq!(other.of(&robot), other.of(&Robot::semi_passive()), "{other:?}");
            }
        }
    }

    #[test]
    fn a_sum_of_roll_resistances_keeps_their_proportions() {
        let mut robot = Robot::kinematic();
        Parameter::RollSum.set(&mut robot, 2.4);
        assert_eq!(robot.roll_kg_s, [1.2, 0.6, 0.6]);
        robot.roll_kg_s = [0.0; 3];
        Parameter::RollSum.set(&mut robot, 2.4);
        assert_eq!(robot.roll_kg_s.map(|roll| (roll * 10.0).round()), [8.0; 3]);
    }
}
