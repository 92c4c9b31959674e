//! Tables of fitted models' predictions and residuals, written by the fit stage.

use trilink_robot::Model;
use trilink_robot::metrics::{FromRest, GaitMetrics, MotionStatus};

use crate::{NoInterval, PredictionSource, rows};

rows! {
    /// What a fitted model predicts: `predictions.parquet`.
    #[derive(serde::Serialize)]
    pub struct PredictionRow {
        pub campaign: String,
        pub model: Model,
        /// Empty on a curve.
        pub trial: String,
        pub omega_rad_s: f64,
        pub source: PredictionSource,
        pub metrics: GaitMetrics,
        /// 95 % confidence limits of the metrics; missing for the reason in `no_interval`.
        pub lower: GaitMetrics as "{}_lo" after "{}",
        pub upper: GaitMetrics as "{}_hi" after "{}_lo",
        pub no_interval: Option<NoInterval>,
        /// Contribution of this frequency to the objective; only for `trial`.
        pub j: f64,
        /// `stable`, `symmetry-broken` (stable, and one of two that are each other's mirror image),
        /// `unstable`, `singular` or `diverged`; `failed` where the gait was not measured.
        pub status: MotionStatus,
        /// Where the robot goes from rest. Only for `trial`, and where there is a motion.
        pub from_rest: Option<FromRest>,
    }
}

rows! {
    /// What a fitted model leaves of a trial's metric: `residuals.parquet`.
    pub struct ResidualRow {
        pub campaign: String,
        pub model: Model,
        pub trial: String,
        pub omega_rad_s: f64,
        /// A column of `predictions.parquet`.
        pub metric: String,
        /// What was fitted, and what the model makes of it; in the unit of the metric.
        pub measured: f64,
        pub predicted: f64,
        /// Measured less predicted.
        pub residual: f64,
        pub standard_error: f64,
        /// The residual over the standard error.
        pub residual_standard_errors: f64,
    }
}
