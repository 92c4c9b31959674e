//! Tables of optimal gaits.

use trilink_base::named;
use trilink_robot::metrics::{FromRest, GaitMetrics, MotionStatus};
use trilink_robot::{ByParameter, Model};

use crate::{ByJoint, ByLink, Extrapolation, NoInterval, rows};

named! {
    /// Objective of the gait optimisation.
    pub enum Objective {
        /// Displacement per cycle (eq. 17 of the paper), m.
        Distance = "d",
        /// Mean speed (eq. 17 of the paper), m/s.
        Speed = "v",
        /// Displacement divided by the work of the actuators, m/J.
        DistancePerWork = "d-per-work",
        /// Mean speed divided by the mean power of the actuators, m/J; equals the displacement per unit of
        /// work.
        SpeedPerPower = "v-per-power",
        /// Work of the actuators per metre, J/m, which is minimised; the inverse of the displacement per unit
        /// of work.
        WorkPerMetre = "work-per-metre",
    }
}

impl Objective {
    /// Returns whether the objective is minimised, not maximised.
    pub fn is_minimised(self) -> bool {
        self == Self::WorkPerMetre
    }

    /// Returns the unit of the objective.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Distance => "m",
            Self::Speed => "m/s",
            Self::DistancePerWork | Self::SpeedPerPower => "m/J",
            Self::WorkPerMetre => "J/m",
        }
    }

    /// Returns the value of the objective for a motion with the given displacement per cycle, mean speed and
    /// work per cycle.
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
    /// Optimal gait: row of `optima.parquet`. Values for a passive joint are missing.
    #[derive(serde::Serialize)]
    pub struct OptimumRow {
        pub campaign: String,
        /// Rank of the optimum; 1 for the best.
        pub rank: i64,
        pub model: Model,
        /// Coefficients of the model with which the gait was optimised.
        pub parameters: ByParameter<f64>,
        /// Whether the model is adequate for the trials to which it was fitted; missing if it was not fitted
        /// or not tested.
        pub adequate: Option<bool>,
        /// Whether the gait lies outside the range of the trials to which the model was fitted.
        #[serde(flatten)]
        pub extrapolation: Extrapolation as "{}",
        pub objective: Objective,
        pub value: f64,
        /// Second objective of a Pareto front; missing for a single objective.
        pub other_objective: Option<Objective>,
        /// Value of the second objective; missing for a single objective.
        pub other_value: f64,
        pub omega_rad_s: f64,
        pub offset_rad: ByJoint<f64> as "phi{}_offset_rad",
        pub amplitude_rad: ByJoint<f64> as "phi{}_amplitude_rad",
        pub phase_rad: ByJoint<f64> as "phi{}_phase_rad",
        /// Amplitudes of the second harmonics; missing if the commands have none.
        pub amplitude2_rad: ByJoint<f64> as "phi{}_amplitude2_rad",
        /// Phases of the second harmonics; missing if the commands have none.
        pub phase2_rad: ByJoint<f64> as "phi{}_phase2_rad",
        /// Mean of the commanded torque of a joint; only of chains.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub torque_mean_nm: ByJoint<f64> as "torque{}_mean_nm",
        /// Amplitude of the commanded torque of a joint; only of chains.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub torque_amplitude_nm: ByJoint<f64> as "torque{}_amplitude_nm",
        /// Phase of the commanded torque of a joint; only of chains.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub torque_phase_rad: ByJoint<f64> as "torque{}_phase_rad",
        /// Amplitude of the angle of a link's rotor; only of chains.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub rotor_amplitude_rad: ByLink<f64> as "rotor{}_amplitude_rad",
        /// Phase of the angle of a link's rotor; only of chains.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub rotor_phase_rad: ByLink<f64> as "rotor{}_phase_rad",
        /// Amplitude of the second harmonic of a rotor; only of chains.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub rotor_amplitude2_rad: ByLink<f64> as "rotor{}_amplitude2_rad",
        /// Phase of the second harmonic of a rotor; only of chains.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub rotor_phase2_rad: ByLink<f64> as "rotor{}_phase2_rad",
        pub metrics: GaitMetrics,
        pub work_j: f64,
        pub power_w: f64,
        pub status: MotionStatus,
        pub from_rest: FromRest,
        pub at_bound: Vec<String>,
        pub starts: i64,
        /// Value of the objective for the campaign's own gait at the best frequency for that gait.
        pub present_value: f64,
        /// Frequency at which the campaign's own gait has the best value of the objective.
        pub present_omega_rad_s: f64,
        /// Names of the command variables that were optimised.
        pub free: Vec<String>,
        /// Bounds on the optimised command variables and on the motions.
        pub bounds: String,
        /// Lower 95 % confidence limits due to the uncertainty of the coefficients; only for the best
        /// optimum.
        pub lower: GaitNumbers as "{}_lo" after "{}",
        /// Upper 95 % confidence limits due to the uncertainty of the coefficients; only for the best
        /// optimum.
        pub upper: GaitNumbers as "{}_hi" after "{}_lo",
        /// Reason why there are no confidence limits; missing if there are limits.
        pub no_interval: Option<NoInterval>,
        /// Number of bootstrap replicates of the fit for which the search was repeated.
        pub replicates: Option<i64>,
        /// Number of bootstrap replicates of the fit for which this optimum is the best one.
        pub best_in: Option<i64>,
        /// Median regret over the bootstrap replicates. The regret is the fraction of the objective that is lost if the
        /// best gait of the fit is used although the replicate's coefficients are the true ones.
        pub regret_median: f64,
        /// 95 % quantile, over the bootstrap replicates, of the regret whose median is `regret_median`.
        pub regret_hi: f64,
        /// Number of bootstrap replicates for which the best gait of the fit does not lead from rest to a stable
        /// motion.
        pub not_reached: Option<i64>,
        /// Number of bootstrap replicates for which the best gait of the fit exceeds a limit on power or torque.
        pub over_limit: Option<i64>,
    }
}

impl OptimumRow {
    /// Returns whether the optimal motion is stable and reached from rest.
    pub fn is_reachable(&self) -> bool {
        self.status.is_reached_and_stays(self.from_rest)
    }
}

rows! {
    /// Quantities of an optimal gait that have confidence limits.
    #[derive(serde::Serialize)]
    pub struct GaitNumbers {
        pub value: f64,
        pub omega_rad_s: f64,
        pub offset_rad: ByJoint<f64> as "phi{}_offset_rad",
        pub amplitude_rad: ByJoint<f64> as "phi{}_amplitude_rad",
        pub phase_rad: ByJoint<f64> as "phi{}_phase_rad",
        pub amplitude2_rad: ByJoint<f64> as "phi{}_amplitude2_rad",
        pub phase2_rad: ByJoint<f64> as "phi{}_phase2_rad",
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub torque_mean_nm: ByJoint<f64> as "torque{}_mean_nm",
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub torque_amplitude_nm: ByJoint<f64> as "torque{}_amplitude_nm",
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub torque_phase_rad: ByJoint<f64> as "torque{}_phase_rad",
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub rotor_amplitude_rad: ByLink<f64> as "rotor{}_amplitude_rad",
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub rotor_phase_rad: ByLink<f64> as "rotor{}_phase_rad",
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub rotor_amplitude2_rad: ByLink<f64> as "rotor{}_amplitude2_rad",
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub rotor_phase2_rad: ByLink<f64> as "rotor{}_phase2_rad",
    }
}

named! {
    /// Kind of point on the map of an objective.
    pub enum MapPoint {
        /// Point of the regular grid; the first axis varies fastest.
        Grid = "grid",
        Optimum = "optimum",
        /// The campaign's own gait at the frequency that is best for it.
        Present = "present",
        /// Optimum for a bootstrap replicate of the fit.
        Replicate = "replicate",
    }
}

rows! {
    /// Point on the map of an objective around its optimum, as a function of the one or two command variables
    /// to which the objective is most sensitive: row of `optimum_maps.parquet`.
    pub struct OptimumMapRow {
        pub campaign: String,
        pub model: Model,
        pub objective: Objective,
        pub point: MapPoint,
        /// Name of the command variable on the first axis.
        pub x_command: String,
        /// Name of the command variable on the second axis; empty if there is only one axis.
        pub y_command: String,
        /// Value of the first command variable: omega in rad/s, angles in degrees.
        pub x: f64,
        /// Value of the second command variable: omega in rad/s, angles in degrees.
        pub y: f64,
        /// Value of the objective; missing if there is no stable motion within the bounds, and for replicates.
        pub value: f64,
        /// Whether the gait lies outside the range of the fitted trials; missing if the coefficients do not
        /// come from a fit or the range is unknown.
        pub extrapolated: Option<bool>,
    }
}
