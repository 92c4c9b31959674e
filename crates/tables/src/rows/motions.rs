//! What `branches --table` and `simulate --trajectory` write.

use trilink_robot::metrics::{Bifurcation, BranchKind, GaitMetrics, MotionStatus};
use trilink_robot::{ContactForces, Model};

use crate::{columns, rows};

rows! {
    /// One motion of a branch: what `branches --table` writes. Branches are numbered from 1.
    pub struct BranchRow {
        pub branch: i64,
        pub kind: BranchKind,
        /// The branch that it begins on.
        pub parent: Option<i64>,
        /// Periods of the command after which the motion repeats itself.
        pub periods: i64,
        /// What the branch is followed over, and its value there.
        pub parameter: String,
        pub value: f64,
        /// Whether it is beyond the trials that its coefficients were fitted to; missing where they were not.
        pub extrapolated: Option<bool>,
        /// Per period of the command.
        pub metrics: GaitMetrics,
        /// Modulus of the largest Floquet multiplier of the motion's own period.
        pub floquet: f64,
        pub status: MotionStatus,
        /// What happens there, if anything.
        pub bifurcation: Option<Bifurcation>,
    }
}

rows! {
    /// One moment of a simulated motion: what `simulate --trajectory` writes. Forces and torques
    /// are missing where the constraint forces are unbounded.
    pub struct TrajectoryRow {
        pub model: Model,
        pub omega_rad_s: f64,
        /// Whether it is beyond the trials that its coefficients were fitted to; missing where they were not.
        pub extrapolated: Option<bool>,
        /// After phase 0, s.
        pub time_s: f64,
        /// Centre and heading of link 0.
        pub x_m: f64,
        pub y_m: f64,
        pub theta_rad: f64,
        pub phi_rad: [f64; 2] as "phi{}_rad",
        /// Time derivatives of the coordinates.
        pub x_rate_m_s: f64,
        pub y_rate_m_s: f64,
        pub theta_rate_rad_s: f64,
        pub phi_rate_rad_s: [f64; 2] as "phi{}_rate_rad_s",
        /// Roll and skid velocities of the wheels.
        pub roll_m_s: [f64; 3] as "roll{}_m_s",
        pub skid_m_s: [f64; 3] as "skid{}_m_s",
        pub forces: ContactForces,
    }
}

columns! {
    ContactForces {
        lateral_n: [f64; 3] as "lateral{}_n",
        roll_n: [f64; 3] as "roll{}_n",
        torque_nm: [f64; 2] as "torque{}_nm",
        power_w: f64,
        loss_w: f64,
    }
}
