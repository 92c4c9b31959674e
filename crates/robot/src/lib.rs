//! The robot itself: its parameters, what its joints are commanded to do, and
//! the equations of motion of the paper's section II in link 0's own frame.
//!
//! Index order is always 0, 1, 2 = middle, front, rear link. Units are SI and stand in the names.
//!
//! - What there is: [`Robot`] (Tables I and II), [`Quantity`], the table of what it is described by, and
//!   [`Parameter`], a single number of it.
//! - What moves it: `command` and `gait`, a [`Gait`] of one [`JointCommand`] a joint (eq. 18 and 19).
//! - What it does: `kinematics` (eq. 1), [`skid_rows`] and [`roll_rows`] that give the wheels'
//!   velocities, [`det_wb`] (eq. 4).
//! - What resists it: `law` and `friction`, the [`Laws`] of skidding and rolling (eq. 14 and 15), by
//!   name as a [`Model`].
//! - What follows: `balance`, the [`force_balance`] (eq. 7) with its Jacobian; [`decay`], motions
//!   without a gait in closed form; [`metrics`], what one cycle amounts to (eq. 17 and 20).
//! - `number`: the equations for one [`Number`] or for several at once.
//!
//! ```
//! use trilink_robot::{Gait, Robot, Trig, dot, skid_rows};
//!
//! let (robot, shape) = (Robot::kinematic(), Gait::symmetric().at(1.0, 3.9));
//! // Link 0 at rest: the side wheels skid as their joints turn them.
//! let [rate1, rate2] = shape.rate_rad_s;
//! let velocity = [0.0, 0.0, 0.0, rate1, rate2];
//! let skid_m_s = skid_rows(&robot, &Trig::new(shape.phi_rad)).map(|row| dot(&row, &velocity));
//! assert_eq!(skid_m_s, [0.0, -robot.l_m * rate1, -robot.l_m * rate2]);
//! ```

mod balance;
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

pub use balance::{Balance, ContactForces, dforce_dphi, force_balance, mass_matrix};
pub use command::{JointCommand, MOST_TURNS, SecondHarmonic, Turns};
pub use friction::{Dry, Friction, Viscous};
pub use gait::{Gait, Shape};
pub use kinematics::{
    Pose, Trig, Velocity, det_wb, dot, droll_rows_dphi, dskid_rows_dphi, in_world, roll_rows,
    rotated, skid_rows,
};
pub use law::{Laws, RollLaw, SkidLaw};
pub use model::Model;
pub use number::{LANES, Lanes, Number};
pub use parameter::{ByParameter, Parameter};
pub use quantity::{Definition, Per, Quantity, Unit};

/// Parameters of a robot (Tables I and II).
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Robot {
    /// Half the length of the middle link, m.
    pub h_m: f64,
    /// Distance of a side link's wheel from its joint, m.
    pub l_m: f64,
    /// Distance of a side link's centre of mass from its joint, m.
    pub b_m: f64,
    /// Masses of links 0, 1, 2, kg.
    pub mass_kg: [f64; 3],
    /// Moments of inertia of links 0, 1, 2 about their centres of mass, kg m^2.
    pub inertia_kg_m2: [f64; 3],
    /// Roll resistance of wheels 0, 1, 2 (eq. 14), kg/s.
    pub roll_kg_s: [f64; 3],
    /// Skid resistance of wheels 0, 1, 2 (eq. 15), kg/s.
    pub skid_kg_s: [f64; 3],
    /// Dry friction of wheels 0, 1, 2 across them, see [`Friction`], N.
    pub skid_dry_n: [f64; 3],
    /// The same at low speeds, N.
    pub skid_static_n: [f64; 3],
    /// Speed from which it is dry friction alone, m/s.
    pub stribeck_m_s: f64,
    /// Resistance to skidding of wheels 0, 1, 2 by a power of the velocity, see [`Friction`], at the
    /// transition speed, N.
    pub skid_power_n: [f64; 3],
    /// The exponents of these powers.
    pub skid_exponent: [f64; 3],
    /// Dry friction of wheels 0, 1, 2 along them, N.
    pub roll_dry_n: [f64; 3],
    /// Speed within which dry friction changes its sign, m/s.
    pub transition_m_s: f64,
    /// Stiffness of the passive joint (eq. 11), N m/rad.
    pub stiffness_nm_rad: f64,
    /// Damping of the passive joint (eq. 11), N m s/rad.
    pub damping_nm_s_rad: f64,
    /// Angle at which the passive joint's spring is unloaded (eq. 11), rad.
    pub rest_angle_rad: f64,
}

impl Robot {
    /// Links, each with a wheel.
    pub const LINKS: usize = 3;

    /// The same with all friction of the wheels times a factor.
    pub fn resisted(&self, factor: f64) -> Self {
        let mut robot = self.clone();
        let wheels = |of: &Quantity| of.definition().is_resistance && of.count() > 1;
        for quantity in Quantity::ALL.into_iter().filter(wheels) {
            quantity.numbers_mut(&mut robot).iter_mut().for_each(|number| *number *= factor);
        }
        robot
    }

    /// Table I with the skid coefficients used in the paper's simulations, and dry friction of a
    /// quarter of the load, which the middle wheel has half of.
    pub fn kinematic() -> Self {
        Self {
            h_m: 0.144,
            l_m: 0.112,
            b_m: 0.0685,
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

    /// Table II with the values used in the paper's simulations, and dry friction as in
    /// [`Robot::kinematic`].
    pub fn semi_passive() -> Self {
        Self {
            b_m: 0.058,
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
