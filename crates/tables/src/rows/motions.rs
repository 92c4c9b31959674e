//! Table that `branches --table` writes.

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
