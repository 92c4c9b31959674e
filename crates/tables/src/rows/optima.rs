//! The tables of optimal gaits.

use trilink_base::named;
use trilink_robot::metrics::{FromRest, GaitMetrics, MotionStatus};
use trilink_robot::{ByParameter, Model};

use crate::{Extrapolation, NoInterval, rows};

named! {
    /// What an optimal gait is best in.
    pub enum Objective {
        /// The distance covered in a cycle (eq. 17), m.
        Distance = "d",
        /// The mean speed (eq. 17), m/s.
        Speed = "v",
        /// The distance for the actuators' work over a cycle, m/J.
        DistancePerWork = "d-per-work",
        /// The mean speed for the actuators' mean power, m/J: the same number.
        SpeedPerPower = "v-per-power",
        /// The work for each metre, J/m: the inverse, which is to be small.
        WorkPerMetre = "work-per-metre",
    }
}

impl Objective {
    /// Whether the smallest value is the best.
    pub fn is_minimised(self) -> bool {
        self == Self::WorkPerMetre
    }

    /// The unit of its values.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Distance => "m",
            Self::Speed => "m/s",
            Self::DistancePerWork | Self::SpeedPerPower => "m/J",
            Self::WorkPerMetre => "J/m",
        }
    }

    /// Its value for a motion.
    pub fn value(self, d_m: f64, v_m_s: f64, work_j: f64) -> f64 {
        match self {
            Self::Distance => d_m,
            Self::Speed => v_m_s,
            Self::DistancePerWork | Self::SpeedPerPower => d_m / work_j,
            Self::WorkPerMetre => work_j / d_m,
        }
    }
}

rows! {
    /// An optimum: `optima.parquet`. Numbers of a joint that is passive are missing.
    #[derive(serde::Serialize)]
    pub struct OptimumRow {
        pub campaign: String,
        /// 1 of the best.
        pub rank: i64,
        pub model: Model,
        /// The model's coefficients.
        pub parameters: ByParameter<f64>,
        /// Whether the model fits the trials that its coefficients are from.
        pub adequate: Option<bool>,
        /// Whether the gait is beyond those trials.
        #[serde(flatten)]
        pub extrapolation: Extrapolation as "{}",
        pub objective: Objective,
        pub value: f64,
        /// Of a front the other objective, and its value.
        pub other_objective: Option<Objective>,
        pub other_value: f64,
        pub omega_rad_s: f64,
        pub offset_rad: [f64; 2] as "phi{}_offset_rad",
        pub amplitude_rad: [f64; 2] as "phi{}_amplitude_rad",
        pub phase_rad: [f64; 2] as "phi{}_phase_rad",
        /// Of second harmonics, where commands have one.
        pub amplitude2_rad: [f64; 2] as "phi{}_amplitude2_rad",
        pub phase2_rad: [f64; 2] as "phi{}_phase2_rad",
        pub metrics: GaitMetrics,
        pub work_j: f64,
        pub power_w: f64,
        pub status: MotionStatus,
        pub from_rest: FromRest,
        pub at_bound: Vec<String>,
        pub starts: i64,
        /// The objective of the campaign's own gait at the frequency that is best for it.
        pub present_value: f64,
        pub present_omega_rad_s: f64,
        /// What varied, and within which bounds.
        pub free: Vec<String>,
        pub bounds: String,
        /// 95 % limits of the best by what the coefficients may be off by, and why there are none.
        pub lower: GaitNumbers as "{}_lo" after "{}",
        pub upper: GaitNumbers as "{}_hi" after "{}_lo",
        pub no_interval: Option<NoInterval>,
        /// Replicates of the fit that were searched again, and of them those in which this is the best.
        pub replicates: Option<i64>,
        pub best_in: Option<i64>,
        /// Part of the objective that is lost with the best gait of the fit where a replicate is true: median and
        /// 95 % quantile.
        pub regret_median: f64,
        pub regret_hi: f64,
        /// Replicates with which the robot does not get from rest into a stable motion with the best gait of the
        /// fit, and in which that exceeds a limit.
        pub not_reached: Option<i64>,
        pub over_limit: Option<i64>,
    }
}

impl OptimumRow {
    /// Whether the robot gets there from rest and stays.
    pub fn counts(&self) -> bool {
        self.status.is_reached_and_stays(self.from_rest)
    }
}

rows! {
    /// What there are limits of.
    #[derive(serde::Serialize)]
    pub struct GaitNumbers {
        pub value: f64,
        pub omega_rad_s: f64,
        pub offset_rad: [f64; 2] as "phi{}_offset_rad",
        pub amplitude_rad: [f64; 2] as "phi{}_amplitude_rad",
        pub phase_rad: [f64; 2] as "phi{}_phase_rad",
        pub amplitude2_rad: [f64; 2] as "phi{}_amplitude2_rad",
        pub phase2_rad: [f64; 2] as "phi{}_phase2_rad",
    }
}

named! {
    /// What a point of the map of an objective is.
    pub enum MapPoint {
        /// One of a grid, whose first axis changes fastest.
        Grid = "grid",
        Optimum = "optimum",
        /// The campaign's own gait at the frequency that is best for it.
        Present = "present",
        /// The optimum by a replicate of the fit.
        Replicate = "replicate",
    }
}

rows! {
    /// A point of the map of an objective about its optimum, over the one or two commands that it answers to
    /// most: `optimum_maps.parquet`.
    pub struct OptimumMapRow {
        pub campaign: String,
        pub model: Model,
        pub objective: Objective,
        pub point: MapPoint,
        /// The commands of the axes, the second empty where one varies alone, and their values: omega in rad/s, angles
        /// in degrees.
        pub x_command: String,
        pub y_command: String,
        pub x: f64,
        pub y: f64,
        /// Of the objective; missing where there is no stable motion within the bounds, and of replicates.
        pub value: f64,
        /// Whether the gait is beyond the trials that the coefficients were fitted to; missing where they were not.
        pub extrapolated: Option<bool>,
    }
}
