//! The table of sensitivities.

use trilink_base::named;
use trilink_robot::Model;
use trilink_robot::metrics::Metric;

use crate::{Extrapolation, rows};

/// The metrics of which there are sensitivities: those that are fitted, and the actuators' work a cycle.
pub const SENSITIVE_METRICS: [&str; Metric::FITTED.len() + 1] = {
    let (mut metrics, mut i) = (["work_j"; Metric::FITTED.len() + 1], 0);
    while i < Metric::FITTED.len() {
        metrics[i] = Metric::FITTED[i].column();
        i += 1;
    }
    metrics
};

named! {
    /// Who says how well a number is known.
    pub enum KnownFrom {
        Configured = "configured",
        Measured = "measured",
        Fitted = "fitted",
    }
}

rows! {
    /// How one metric answers to one number of the robot, the gait or the frequency: what
    /// `simulate --sensitivities` gives.
    #[derive(serde::Serialize)]
    pub struct SensitivityRow {
        pub model: Model,
        pub omega_rad_s: f64,
        /// Whether the motion is beyond the trials that its coefficients were fitted to.
        #[serde(flatten)]
        pub extrapolation: Extrapolation as "{}",
        /// As `--set` has it, and its value, in the unit of its name.
        pub parameter: String,
        pub parameter_value: f64,
        /// As columns have it, and its value.
        pub metric: String,
        pub metric_value: f64,
        /// In the metric's unit per unit of the parameter, and how far it may be off where it is a
        /// difference and not the solver's own.
        pub derivative: f64,
        pub derivative_error: f64,
        /// Relative change of the metric per relative change of the parameter; missing where either is
        /// zero.
        pub elasticity: f64,
        /// How well the parameter is known, and who says so; missing of what is taken as exact.
        pub standard_deviation: f64,
        pub known_from: Option<KnownFrom>,
        /// What it makes of the metric: standard deviation in the metric's unit, and part of the variance
        /// of all together. Parts of what varies together can be below zero.
        pub contribution: f64,
        pub variance_part: f64,
        /// Standard deviation of the metric by all together.
        pub metric_deviation: f64,
    }
}
