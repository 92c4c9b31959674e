//! Tables that `branches --table` and `simulate --trajectory` write.

use trilink_robot::Model;
use trilink_robot::metrics::{Bifurcation, BranchKind, GaitMetrics, MotionStatus};

use crate::rows;

rows! {
    /// Steady-state motion on a branch of solutions: row of the table that `branches --table` writes.
    pub struct BranchRow {
        /// Number of the branch, from 1.
        pub branch: i64,
        pub kind: BranchKind,
        /// Number of the branch from which this branch bifurcates; missing if there is none.
        pub parent: Option<i64>,
        /// Number of periods of the command in one period of the motion.
        pub periods: i64,
        /// Name of the continuation parameter.
        pub parameter: String,
        /// Value of the continuation parameter.
        pub value: f64,
        /// Whether the motion lies outside the range of the fitted trials; missing if the coefficients do not come from
        /// a fit or the range is unknown.
        pub extrapolated: Option<bool>,
        /// Metrics per period of the command.
        pub metrics: GaitMetrics,
        /// Modulus of the largest Floquet multiplier over one period of the motion.
        pub floquet: f64,
        pub status: MotionStatus,
        /// Bifurcation at this point of the branch; missing if there is none.
        pub bifurcation: Option<Bifurcation>,
    }
}

rows! {
    /// State of a simulated motion: row of the table that `simulate --trajectory` writes. Forces and torques are
    /// missing where the constraint forces are unbounded.
    pub struct TrajectoryRow {
        pub model: Model,
        pub omega_rad_s: f64,
        /// Whether the motion lies outside the range of the fitted trials; missing if the coefficients do not come from
        /// a fit or the range is unknown.
        pub extrapolated: Option<bool>,
        /// Time since the start of the motion, which is at phase 0 of the gait, s.
        pub time_s: f64,
        /// x coordinate of the centre of link 0, m.
        pub x_m: f64,
        pub y_m: f64,
        /// Heading of link 0, rad.
        pub theta_rad: f64,
        /// Joint angles phi1 and phi2, rad.
        pub phi_rad: [f64; 2] as "phi{}_rad",
        /// Velocity of the centre of link 0 along the world x axis, m/s.
        pub x_rate_m_s: f64,
        pub y_rate_m_s: f64,
        pub theta_rate_rad_s: f64,
        pub phi_rate_rad_s: [f64; 2] as "phi{}_rate_rad_s",
        /// Roll velocities of wheels 0, 1, 2, m/s.
        pub roll_m_s: [f64; 3] as "roll{}_m_s",
        /// Skid velocities of wheels 0, 1, 2, m/s.
        pub skid_m_s: [f64; 3] as "skid{}_m_s",
        /// Lateral contact forces on wheels 0, 1, 2, N: constraint forces where the wheels cannot skid, otherwise friction.
        pub lateral_n: [f64; 3] as "lateral{}_n",
        /// Rolling friction forces on wheels 0, 1, 2, N.
        pub roll_n: [f64; 3] as "roll{}_n",
        /// Joint torques, N m.
        pub torque_nm: [f64; 2] as "torque{}_nm",
        /// Power of the actuators, and power dissipated, W.
        pub power_w: f64,
        pub loss_w: f64,
    }
}
