//! Table of the metrics' sensitivities to parameters.

use trilink_base::named;
use trilink_robot::Model;

use crate::{Extrapolation, rows};

/// Names of the metrics for which sensitivities are computed: the fitted metrics, and the work of the
/// actuators per cycle.
pub const SENSITIVE_METRICS: [&str; 7] =
    ["d_m", "v_m_s", "sigma0", "sigma1", "sigma2", "alpha1_rad", "work_j"];

named! {
    /// Source of a parameter's standard deviation.
    pub enum KnownFrom {
        Configured = "configured",
        Measured = "measured",
        Fitted = "fitted",
    }
}

rows! {
    /// Sensitivity of a metric to a parameter of the robot or the gait, or to the frequency: row of the table
    /// that `simulate --sensitivities` writes.
    #[derive(serde::Serialize)]
    pub struct SensitivityRow {
        pub model: Model,
        pub omega_rad_s: f64,
        /// Whether the motion lies outside the range of the fitted trials.
        #[serde(flatten)]
        pub extrapolation: Extrapolation as "{}",
        /// Name of the parameter, as in the option `--set` of `simulate`.
        pub parameter: String,
        /// Value of the parameter, in the unit that the parameter's name states.
        pub parameter_value: f64,
        /// Name of the metric, as in table columns.
        pub metric: String,
        /// Value of the metric, in the unit that the metric's name states.
        pub metric_value: f64,
        /// Derivative of the metric with respect to the parameter, in the unit of the metric per unit of the
        /// parameter.
        pub derivative: f64,
        /// Relative change in the metric per relative change in the parameter; missing if either value is
        /// zero.
        pub elasticity: f64,
        /// Standard deviation of the parameter; missing if the parameter is exact.
        pub standard_deviation: f64,
        /// Source of the parameter's standard deviation; missing if the parameter is exact.
        pub known_from: Option<KnownFrom>,
        /// Standard deviation of the metric due to this parameter, in the unit of the metric.
        pub contribution: f64,
        /// Fraction of the metric's variance that is due to this parameter; can be negative for correlated
        /// parameters.
        pub variance_part: f64,
        /// Standard deviation of the metric due to all parameters.
        pub metric_deviation: f64,
        /// Number of motions with inputs drawn at random (JCGM 101:2008), if requested.
        pub draws: Option<i64>,
        /// Number of those draws that have no periodic solution.
        pub unsolved_draws: Option<i64>,
        /// Standard deviation of the metric over the draws; missing if more than 0.1 % have no periodic solution.
        pub draws_deviation: f64,
        /// Lower limit of the probabilistically symmetric 95 % interval of the draws.
        pub draws_lower: f64,
        /// Upper limit of that interval.
        pub draws_upper: f64,
    }
}
