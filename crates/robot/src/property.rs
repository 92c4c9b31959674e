//! The numbers of a robot.

use super::{Parameter, Robot};

/// A number of the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Property {
    /// Half the length of the middle link.
    H,
    /// Distance of a side link's wheel from its joint.
    L,
    /// Distance of a side link's centre of mass from its joint.
    B,
    /// Of a link.
    Mass(usize),
    /// Moment of inertia of a link.
    Inertia(usize),
    Coefficient(Parameter),
    /// Of the passive joint.
    RestAngle,
}

impl Property {
    /// Its value in a robot, in SI units.
    pub fn of(self, robot: &Robot) -> f64 {
        match self {
            Self::H => robot.h_m,
            Self::L => robot.l_m,
            Self::B => robot.b_m,
            Self::Mass(link) => robot.mass_kg[link],
            Self::Inertia(link) => robot.inertia_kg_m2[link],
            Self::Coefficient(parameter) => parameter.of(robot),
            Self::RestAngle => robot.rest_angle_rad,
        }
    }

    /// Gives it a value in a robot, in SI units.
    pub fn set(self, robot: &mut Robot, value: f64) {
        match self {
            Self::H => robot.h_m = value,
            Self::L => robot.l_m = value,
            Self::B => robot.b_m = value,
            Self::Mass(link) => robot.mass_kg[link] = value,
            Self::Inertia(link) => robot.inertia_kg_m2[link] = value,
            Self::Coefficient(parameter) => parameter.set(robot, value),
            Self::RestAngle => robot.rest_angle_rad = value,
        }
    }
}
