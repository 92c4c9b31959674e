//! Tables of fitted models' predictions and residuals, written by the fit stage.

use trilink_robot::Model;
use trilink_robot::metrics::{FromRest, GaitMetrics, MotionStatus};

use crate::{NoInterval, PredictionSource, rows};

rows! {
    /// Prediction by a fitted model, for a trial or a point of a prediction curve: row of
    /// `predictions.parquet`.
    #[derive(serde::Serialize)]
    pub struct PredictionRow {
        pub campaign: String,
        pub model: Model,
        /// Name of the trial that is predicted; empty for points of a prediction curve.
        pub trial: String,
        pub omega_rad_s: f64,
        pub source: PredictionSource,
        pub metrics: GaitMetrics,
        /// Lower 95 % confidence limits of the metrics; if they are missing, `no_interval` states the reason.
        pub lower: GaitMetrics as "{}_lo" after "{}",
        /// Upper 95 % confidence limits of the metrics; if they are missing, `no_interval` states the reason.
        pub upper: GaitMetrics as "{}_hi" after "{}_lo",
        /// Reason why there are no confidence limits; missing if there are limits.
        pub no_interval: Option<NoInterval>,
        /// Contribution of the trial to the objective; missing for points of a prediction curve.
        pub j: f64,
        /// Status of the predicted motion: `stable`, `symmetry-broken` (stable, and one of a mirror-image
        /// pair), `unstable`, `singular` or `diverged`; `failed` if the gait was not measured.
        pub status: MotionStatus,
        /// Attractor that the robot reaches from rest; missing for points of a prediction curve, and for
        /// trials for which the model has no steady-state motion.
        pub from_rest: Option<FromRest>,
    }
}

rows! {
    /// Residual of a fitted model in one metric of one trial: row of `residuals.parquet`.
    pub struct ResidualRow {
        pub campaign: String,
        pub model: Model,
        pub trial: String,
        pub omega_rad_s: f64,
        /// Name of the metric, which is a column of `predictions.parquet`.
        pub metric: String,
        /// Measured value, in the unit of the metric.
        pub measured: f64,
        /// Predicted value, in the unit of the metric.
        pub predicted: f64,
        /// Measured minus predicted value.
        pub residual: f64,
        /// Standard error of the measured value.
        pub standard_error: f64,
        /// Standard deviation of the metric in such trials: noise of the cycles, and variation between trials and days.
        /// 0 if the noise is not known.
        pub noise: f64,
        /// Residual divided by the standard error of the measured value.
        pub residual_standard_errors: f64,
    }
}
