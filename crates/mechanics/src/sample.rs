//! State of a robot and the forces on it at one time.

use trilink_robot::Pose;

/// State of a robot and the forces on it at one time. Links are in the order of their numbers
/// ([`Chain::numbering`](trilink_robot::Chain::numbering)), joints from front to rear.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    pub time_s: f64,
    /// Pose of link 0; the motion starts at the origin, heading along x.
    pub pose: Pose,
    /// Rates `(x', y', theta')` of that pose, m/s and rad/s.
    pub pose_rates: [f64; 3],
    /// Joint angles, rad, and their rates, rad/s.
    pub phi_rad: Vec<f64>,
    pub phi_rate_rad_s: Vec<f64>,
    /// Roll velocities of the wheels, m/s; NaN for a link without a wheel.
    pub roll_m_s: Vec<f64>,
    /// Skid velocities of the wheels, m/s; NaN for a link without a wheel.
    pub skid_m_s: Vec<f64>,
    /// Lateral contact forces on the wheels, N: the constraint forces (eq. 8 of the paper) where the wheels cannot skid,
    /// otherwise friction. NaN for a link without a wheel or where they are unbounded.
    pub lateral_n: Vec<f64>,
    /// Rolling friction forces on the wheels, N; NaN for a link without a wheel.
    pub roll_n: Vec<f64>,
    /// Torques at the joints, N m: of the actuator, or of the spring, the damper and the prescribed torque of a free
    /// joint.
    pub torque_nm: Vec<f64>,
    /// Power of the actuators of all joints and rotors, W.
    pub power_w: f64,
    /// Power dissipated at the wheels, by drag and in the joints, W.
    pub loss_w: f64,
}
