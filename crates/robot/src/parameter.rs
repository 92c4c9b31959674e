//! The robot's parameters that a fit can free: the one list of them.

use std::ops::{Index, IndexMut};

use serde::{Serialize, Serializer};
use trilink_base::named;

use super::Robot;

/// What a parameter belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// Viscous resistance of the wheels to skidding.
    Skid,
    /// Dry friction of the wheels across them.
    SkidDry,
    /// What dry friction across the wheels is at low speeds, and from which speed it is not.
    Stribeck,
    /// Viscous resistance of the wheels to rolling.
    Roll,
    /// Dry friction of the wheels along them.
    RollDry,
    /// The speed within which dry friction changes its sign.
    Transition,
    /// The passive joint.
    Joint,
}

named! {
    /// A parameter of the robot that a fit can free, in the order of the tables, by its column
    /// there.
    pub enum Parameter {
        /// Skid resistance of wheel 0 (eq. 15).
        Skid0 = "skid0_kg_s",
        Skid1 = "skid1_kg_s",
        Skid2 = "skid2_kg_s",
        /// Roll resistance of wheel 0 (eq. 14).
        Roll0 = "roll0_kg_s",
        Roll1 = "roll1_kg_s",
        Roll2 = "roll2_kg_s",
        /// Sum of the wheels' roll resistances; their proportions stay. Distances and speeds
        /// hardly tell more of them.
        RollSum = "roll_sum_kg_s",
        /// Dry friction of wheel 0 across it.
        SkidDry0 = "skid_dry0_n",
        SkidDry1 = "skid_dry1_n",
        SkidDry2 = "skid_dry2_n",
        /// The same at low speeds.
        SkidStatic0 = "skid_static0_n",
        SkidStatic1 = "skid_static1_n",
        SkidStatic2 = "skid_static2_n",
        /// Speed from which that is dry friction alone.
        Stribeck = "stribeck_m_s",
        /// Dry friction of wheel 0 along it.
        RollDry0 = "roll_dry0_n",
        RollDry1 = "roll_dry1_n",
        RollDry2 = "roll_dry2_n",
        /// Their sum; their proportions stay.
        RollDrySum = "roll_dry_sum_n",
        /// Speed within which dry friction changes its sign.
        Transition = "transition_m_s",
        /// Stiffness of the passive joint (eq. 11).
        Stiffness = "stiffness_nm_rad",
        /// Damping of the passive joint (eq. 11).
        Damping = "damping_nm_s_rad",
    }
}

impl Parameter {
    /// Skid resistances of wheels 0, 1, 2.
    pub const SKID: [Self; 3] = [Self::Skid0, Self::Skid1, Self::Skid2];
    /// Roll resistances of wheels 0, 1, 2.
    pub const ROLL: [Self; 3] = [Self::Roll0, Self::Roll1, Self::Roll2];
    /// Dry friction of wheels 0, 1, 2 across them.
    pub const SKID_DRY: [Self; 3] = [Self::SkidDry0, Self::SkidDry1, Self::SkidDry2];
    /// The same at low speeds.
    pub const SKID_STATIC: [Self; 3] = [Self::SkidStatic0, Self::SkidStatic1, Self::SkidStatic2];
    /// Dry friction of wheels 0, 1, 2 along them.
    pub const ROLL_DRY: [Self; 3] = [Self::RollDry0, Self::RollDry1, Self::RollDry2];

    /// What it belongs to, its name in the configuration and on a figure's axis, and its unit.
    const fn about(self) -> (Family, [&'static str; 3]) {
        match self {
            Self::Skid0 => (Family::Skid, ["skid0", "Skid 0", "kg/s"]),
            Self::Skid1 => (Family::Skid, ["skid1", "Skid 1", "kg/s"]),
            Self::Skid2 => (Family::Skid, ["skid2", "Skid 2", "kg/s"]),
            Self::Roll0 => (Family::Roll, ["roll0", "Roll 0", "kg/s"]),
            Self::Roll1 => (Family::Roll, ["roll1", "Roll 1", "kg/s"]),
            Self::Roll2 => (Family::Roll, ["roll2", "Roll 2", "kg/s"]),
            Self::RollSum => (Family::Roll, ["roll", "Sum of roll", "kg/s"]),
            Self::SkidDry0 => (Family::SkidDry, ["skid_dry0", "Dry skid 0", "N"]),
            Self::SkidDry1 => (Family::SkidDry, ["skid_dry1", "Dry skid 1", "N"]),
            Self::SkidDry2 => (Family::SkidDry, ["skid_dry2", "Dry skid 2", "N"]),
            Self::SkidStatic0 => (Family::Stribeck, ["skid_static0", "Static skid 0", "N"]),
            Self::SkidStatic1 => (Family::Stribeck, ["skid_static1", "Static skid 1", "N"]),
            Self::SkidStatic2 => (Family::Stribeck, ["skid_static2", "Static skid 2", "N"]),
            Self::Stribeck => (Family::Stribeck, ["stribeck", "Stribeck speed", "m/s"]),
            Self::RollDry0 => (Family::RollDry, ["roll_dry0", "Dry roll 0", "N"]),
            Self::RollDry1 => (Family::RollDry, ["roll_dry1", "Dry roll 1", "N"]),
            Self::RollDry2 => (Family::RollDry, ["roll_dry2", "Dry roll 2", "N"]),
            Self::RollDrySum => (Family::RollDry, ["roll_dry", "Sum of dry roll", "N"]),
            Self::Transition => (Family::Transition, ["transition", "Transition speed", "m/s"]),
            Self::Stiffness => (Family::Joint, ["stiffness", "Stiffness", "N m/rad"]),
            Self::Damping => (Family::Joint, ["damping", "Damping", "N m s/rad"]),
        }
    }

    /// What it belongs to.
    pub const fn family(self) -> Family {
        self.about().0
    }

    /// Its name in the configuration.
    pub const fn key(self) -> &'static str {
        self.about().1[0]
    }

    /// Its name on a figure's axis.
    pub const fn label(self) -> &'static str {
        self.about().1[1]
    }

    /// The unit of its values.
    pub const fn unit(self) -> &'static str {
        self.about().1[2]
    }

    /// The power of omega that goes with it: a motion is the same per radian of phase at another
    /// frequency where every parameter has grown by its power of that.
    pub fn power_of_omega(self) -> f64 {
        match self.unit() {
            "N" | "N m/rad" => 2.0,
            _ => 1.0,
        }
    }

    /// Whether a value of it is one of `other` too: the same, or the sum that it is part of.
    pub fn is_part_of(self, other: Self) -> bool {
        self == other
            || other == Self::RollSum && Self::ROLL.contains(&self)
            || other == Self::RollDrySum && Self::ROLL_DRY.contains(&self)
    }

    /// The sum that it is a part of.
    pub fn sum(self) -> Option<Self> {
        Self::ALL.into_iter().find(|other| *other != self && self.is_part_of(*other))
    }

    /// Whether the configuration of a robot has a key of its name: it is of no single wheel, and no sum.
    pub fn is_key(self) -> bool {
        !self.is_sum() && !self.key().ends_with(|c: char| c.is_ascii_digit())
    }

    /// Whether it is the sum of others.
    pub fn is_sum(self) -> bool {
        Self::ALL.into_iter().any(|other| other.sum() == Some(self))
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
            Self::SkidDry0 => robot.skid_dry_n[0],
            Self::SkidDry1 => robot.skid_dry_n[1],
            Self::SkidDry2 => robot.skid_dry_n[2],
            Self::SkidStatic0 => robot.skid_static_n[0],
            Self::SkidStatic1 => robot.skid_static_n[1],
            Self::SkidStatic2 => robot.skid_static_n[2],
            Self::Stribeck => robot.stribeck_m_s,
            Self::RollDry0 => robot.roll_dry_n[0],
            Self::RollDry1 => robot.roll_dry_n[1],
            Self::RollDry2 => robot.roll_dry_n[2],
            Self::RollDrySum => robot.roll_dry_n.iter().sum(),
            Self::Transition => robot.transition_m_s,
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
            Self::SkidDry0 => robot.skid_dry_n[0] = value,
            Self::SkidDry1 => robot.skid_dry_n[1] = value,
            Self::SkidDry2 => robot.skid_dry_n[2] = value,
            Self::SkidStatic0 => robot.skid_static_n[0] = value,
            Self::SkidStatic1 => robot.skid_static_n[1] = value,
            Self::SkidStatic2 => robot.skid_static_n[2] = value,
            Self::Stribeck => robot.stribeck_m_s = value,
            Self::RollDry0 => robot.roll_dry_n[0] = value,
            Self::RollDry1 => robot.roll_dry_n[1] = value,
            Self::RollDry2 => robot.roll_dry_n[2] = value,
            Self::RollDrySum => {
                robot.roll_dry_n = robot.roll_dry_shares().map(|share| share * value);
            }
            Self::Transition => robot.transition_m_s = value,
            Self::Stiffness => robot.stiffness_nm_rad = value,
            Self::Damping => robot.damping_nm_s_rad = value,
        }
    }
}

/// Something for every parameter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ByParameter<T>([T; Parameter::ALL.len()]);

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

    /// Values in the order of [`Parameter::ALL`].
    pub const fn from_array(values: [T; Parameter::ALL.len()]) -> Self {
        Self(values)
    }

    /// Values in the order of [`Parameter::ALL`].
    pub const fn as_array(&self) -> &[T; Parameter::ALL.len()] {
        &self.0
    }

    /// In the order of [`Parameter::ALL`].
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.0.iter_mut()
    }

    /// In the order of [`Parameter::ALL`].
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
    use trilink_base::Named;

    use super::*;

    #[test]
    fn a_parameter_that_is_set_has_its_value() {
        for parameter in Parameter::ALL {
            let mut robot = Robot::semi_passive();
            parameter.set(&mut robot, 2.5);
            assert_eq!(parameter.of(&robot), 2.5, "{parameter:?}");
            assert_eq!(Parameter::of_name(parameter.name()), Some(parameter));
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
