//! Robot model: parameters, joint commands, friction laws and metrics.
//!
//! Indices 0, 1, 2 of a robot of three links denote the middle, front and rear link. Units are SI and part of each name.
//!
//! - Description: [`Robot`] (Tables I and II), a robot of three links; [`Chain`], a robot of two to eight links;
//!   [`AnyRobot`], either of them; [`Quantity`], the table of quantities that describe a robot; and [`Parameter`], a
//!   single scalar parameter of a robot.
//! - Actuation: `command` and `gait`; a [`Gait`] consists of one [`JointCommand`] per commanded joint (eq. 18
//!   and 19).
//! - Kinematics: [`Pose`] (eq. 1).
//! - Friction: `law` and `friction`, the [`Laws`] of skidding and rolling (eq. 14 and 15); a [`Model`] is a
//!   named set of laws.
//! - [`decay`], free decay in closed form; [`metrics`], the metrics of a gait cycle (eq. 17 and 20).
//! - `number`: evaluates equations for one [`Number`] or for several in the lanes of a SIMD vector.
//!
//! ```
//! use trilink_robot::{Gait, Pose, Robot};
//!
//! let robot = Robot::kinematic();
//! let [front, rear] = Gait::symmetric().joints.map(|command| command.map_or(0.0, |command| command.derivative(0, 1.0)));
//! let [middle, ..] = robot.link_poses(Pose::default(), [front, rear]);
//! assert_eq!(middle, Pose::default());
//! ```

mod any;
mod chain;
mod command;
pub mod decay;
mod friction;
mod gait;
mod kinematics;
mod law;
pub mod metrics;
mod model;
mod number;
mod parameter;
mod quantity;

pub use any::{AnyGait, AnyRobot};
pub use chain::{
    Chain, ChainError, ChainNumber, CommandNumber, Drag, FreeJoint, Joint, JointNumber, Link,
    LinkNumber, MAX_JOINTS, MAX_LINKS, NumberKind, Rotor, TorqueCommand, Wheel, WheelFriction,
};
pub use command::{JointCommand, MAX_TURNS, SecondHarmonic, Turns};
pub use friction::{Dry, Friction};
pub use gait::Gait;
pub use kinematics::{Pose, in_world, rotated};
pub use law::{Laws, RollLaw, SkidLaw};
pub use model::Model;
pub use number::{LANES, Lanes, Number};
pub use parameter::{ByParameter, Parameter};
pub use quantity::{Definition, Per, Quantity, Unit};

/// Standard gravity, m/s^2.
pub const GRAVITY_M_S2: f64 = 9.80665;

/// Parameters of a robot (Tables I and II of the paper).
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Robot {
    /// Distances of the middle link's wheel from joints 1 and 2, m.
    pub h_m: [f64; 2],
    /// Distances of the side links' wheels from joints 1 and 2, m.
    pub l_m: [f64; 2],
    /// Distances of the side links' centres of mass from joints 1 and 2, m.
    pub b_m: [f64; 2],
    /// Masses of links 0, 1, 2, kg.
    pub mass_kg: [f64; 3],
    /// Moments of inertia of links 0, 1, 2 about their centres of mass, kg m^2.
    pub inertia_kg_m2: [f64; 3],
    /// Viscous rolling resistance of wheels 0, 1, 2 (eq. 14 of the paper), kg/s.
    pub roll_kg_s: [f64; 3],
    /// Viscous skid resistance of wheels 0, 1, 2 (eq. 15 of the paper), kg/s.
    pub skid_kg_s: [f64; 3],
    /// Dry friction of wheels 0, 1, 2 across their rolling direction (see [`Friction`]), N.
    pub skid_dry_n: [f64; 3],
    /// Static friction of wheels 0, 1, 2 across their rolling direction: dry friction at low speeds
    /// (Stribeck), N.
    pub skid_static_n: [f64; 3],
    /// Stribeck speed, at which the excess of static over Coulomb friction has fallen to 1/e, m/s.
    pub stribeck_m_s: f64,
    /// Power-law resistance to skidding of wheels 0, 1, 2 at the transition speed (see [`Friction`]), N.
    pub skid_power_n: [f64; 3],
    /// Exponents of the power-law resistance to skidding of wheels 0, 1, 2.
    pub skid_exponent: [f64; 3],
    /// Dry friction of wheels 0, 1, 2 along their rolling direction, N.
    pub roll_dry_n: [f64; 3],
    /// Transition speed, m/s: scale of velocity over which dry friction changes its sign smoothly
    /// (regularisation).
    pub transition_m_s: f64,
    /// Stiffness of the passive joint (eq. 11 of the paper), N m/rad.
    pub stiffness_nm_rad: f64,
    /// Damping of the passive joint (eq. 11 of the paper), N m s/rad.
    pub damping_nm_s_rad: f64,
    /// Rest angle of the passive joint's spring (eq. 11 of the paper), rad.
    pub rest_angle_rad: f64,
}

impl Robot {
    /// Number of links, each with a wheel.
    pub const LINKS: usize = 3;
    /// Number of joints: joint 1 at the front of the middle link, joint 2 at its rear.
    pub const JOINTS: usize = 2;

    /// Returns the side link length l that normalises skid velocities (eq. 20 of the paper), m; the mean if
    /// the two side links differ.
    pub fn skid_length_m(&self) -> f64 {
        0.5 * (self.l_m[0] + self.l_m[1])
    }

    /// Returns the weight of the robot, N.
    pub fn weight_n(&self) -> f64 {
        GRAVITY_M_S2 * self.mass_kg.iter().sum::<f64>()
    }

    /// Returns the distances of the side links' wheels from the middle wheel when the robot is straight, m.
    pub fn reach_m(&self) -> [f64; 2] {
        [0, 1].map(|joint| self.h_m[joint] + self.l_m[joint])
    }

    /// Returns the moment of inertia of side link 1 or 2 about its joint, kg m^2.
    pub fn inertia_about_joint_kg_m2(&self, link: usize) -> f64 {
        self.inertia_kg_m2[link] + self.mass_kg[link] * self.b_m[link - 1].powi(2)
    }

    /// Returns the robot with all friction coefficients of its wheels multiplied by `factor`.
    pub fn with_friction_scaled(&self, factor: f64) -> Self {
        let mut robot = self.clone();
        for quantity in Quantity::ALL {
            if quantity.definition().is_resistance && quantity.count() > 1 {
                quantity.numbers_mut(&mut robot).iter_mut().for_each(|number| *number *= factor);
            }
        }
        robot
    }

    /// Returns the kinematic robot of Table I of the paper with the skid coefficients of the paper's
    /// simulations. Its dry friction is a quarter of each wheel's load; half of the robot's weight rests on
    /// the middle wheel.
    pub fn kinematic() -> Self {
        Self {
            h_m: [0.144; 2],
            l_m: [0.112; 2],
            b_m: [0.0685; 2],
            mass_kg: [1.04, 0.2, 0.2],
            inertia_kg_m2: [86e-4, 5e-4, 5e-4],
            roll_kg_s: [0.6, 0.3, 0.3],
            skid_kg_s: [100.0, 50.0, 50.0],
            skid_dry_n: [1.8, 0.9, 0.9],
            skid_static_n: [1.8, 0.9, 0.9],
            stribeck_m_s: 0.02,
            skid_power_n: [1.8, 0.9, 0.9],
            skid_exponent: [1.0; 3],
            roll_dry_n: [0.0; 3],
            transition_m_s: 0.005,
            stiffness_nm_rad: 0.0,
            damping_nm_s_rad: 0.0,
            rest_angle_rad: 0.0,
        }
    }

    /// Returns the semi-passive robot of Table II of the paper with the coefficients of the paper's
    /// simulations. Its dry friction is chosen as in [`Robot::kinematic`].
    pub fn semi_passive() -> Self {
        Self {
            b_m: [0.058; 2],
            mass_kg: [1.04, 0.34, 0.34],
            inertia_kg_m2: [86e-4, 5.9e-4, 5.9e-4],
            skid_kg_s: [400.0, 200.0, 200.0],
            skid_dry_n: [2.0, 1.0, 1.0],
            skid_static_n: [2.0, 1.0, 1.0],
            stiffness_nm_rad: 0.188,
            damping_nm_s_rad: 0.007,
            ..Self::kinematic()
        }
    }
}
