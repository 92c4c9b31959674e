//! The tables of `derived/`. Column names are a contract: scripts of others read them.

use std::path::{Path, PathBuf};

use super::parameters::parameter_columns;
use super::rows::rows;
use crate::config::SigmaKind;
use crate::metrics::GaitMetrics;

/// `derived/poses/<trial>.parquet`.
pub fn poses_path(derived: &Path, trial: &str) -> PathBuf {
    derived.join("poses").join(format!("{trial}.parquet"))
}

/// `derived/wheels/<trial>.parquet`.
pub fn wheels_path(derived: &Path, trial: &str) -> PathBuf {
    derived.join("wheels").join(format!("{trial}.parquet"))
}

/// `derived/cycles/<trial>.parquet`.
pub fn cycles_path(derived: &Path, trial: &str) -> PathBuf {
    derived.join("cycles").join(format!("{trial}.parquet"))
}

rows! {
    /// One cycle of a trial: `cycles/<trial>.parquet`.
    pub struct CycleRow {
        pub trial: String,
        pub cycle: i64,
        /// When the cycle starts, after the first frame, s.
        pub start_s: f64,
        pub d_m: f64,
        pub v_m_s: f64,
        pub sigma0: f64,
        pub sigma1: f64,
        pub sigma2: f64,
        pub alpha1_rad: f64,
        pub dtheta_rad: f64,
        /// Whether the cycle counts towards the trial's means.
        pub used: bool,
    }
}

rows! {
    /// One trial: `trials.parquet`. Standard errors end in `_se`.
    pub struct TrialRow {
        pub trial: String,
        /// Empty for trials that are not of kind `gait`.
        pub campaign: String,
        pub kind: String,
        pub omega_commanded_rad_s: f64,
        /// Measured, by harmonic regression on the commanded joints.
        pub omega_rad_s: f64,
        pub omega_rad_s_se: f64,
        /// Cycles that the means are taken over.
        pub cycles: i64,
        pub d_m: f64,
        pub d_m_se: f64,
        pub v_m_s: f64,
        pub v_m_s_se: f64,
        pub sigma0: f64,
        pub sigma0_se: f64,
        pub sigma1: f64,
        pub sigma1_se: f64,
        pub sigma2: f64,
        pub sigma2_se: f64,
        /// Skid ratios without the part that differs from cycle to cycle.
        pub sigma0_debiased: f64,
        pub sigma0_debiased_se: f64,
        pub sigma1_debiased: f64,
        pub sigma1_debiased_se: f64,
        pub sigma2_debiased: f64,
        pub sigma2_debiased_se: f64,
        pub alpha1_rad: f64,
        pub alpha1_rad_se: f64,
        pub dtheta_rad: f64,
        pub dtheta_rad_se: f64,
        /// Measured gait: `phi_i = offset + amplitude cos(omega t + phase)`, the phase of a
        /// commanded joint being that of its command.
        pub phi1_offset_rad: f64,
        pub phi1_amplitude_rad: f64,
        pub phi1_phase_rad: f64,
        /// What else the joint does in every cycle: RMS of its harmonics above the first.
        pub phi1_harmonics_rad: f64,
        pub phi2_offset_rad: f64,
        pub phi2_amplitude_rad: f64,
        pub phi2_phase_rad: f64,
        pub phi2_harmonics_rad: f64,
        /// Part of all markers' frames that the cameras saw.
        pub coverage: f64,
        /// Mean residual of the rigid fits, mm.
        pub residual_mm: f64,
        /// Width of the moving average, samples.
        pub smoothing_window: i64,
        /// What it leaves of the speeds of the gait's first three harmonics. Only the raw skid
        /// ratios and the tables of smoothed coordinates and speeds lose the rest.
        pub smoothing_left1: f64,
        pub smoothing_left2: f64,
        pub smoothing_left3: f64,
        /// `ok`, `flagged` (a check warns) or `failed` (no metrics).
        pub status: String,
        pub message: String,
    }
}

impl TrialRow {
    /// Measured skid ratios of wheels 0, 1, 2 with their standard errors. A debiased one of
    /// which nothing is left above the noise is missing.
    pub fn sigma(&self, kind: SigmaKind) -> [(f64, f64); 3] {
        match kind {
            SigmaKind::Raw => [
                (self.sigma0, self.sigma0_se),
                (self.sigma1, self.sigma1_se),
                (self.sigma2, self.sigma2_se),
            ],
            SigmaKind::Debiased => [
                (self.sigma0_debiased, self.sigma0_debiased_se),
                (self.sigma1_debiased, self.sigma1_debiased_se),
                (self.sigma2_debiased, self.sigma2_debiased_se),
            ]
            .map(|(sigma, se)| if sigma > 0.0 { (sigma, se) } else { (f64::NAN, f64::NAN) }),
        }
    }

    /// The trial's mean metrics.
    pub fn metrics(&self) -> GaitMetrics {
        GaitMetrics {
            d_m: self.d_m,
            v_m_s: self.v_m_s,
            sigma: [self.sigma0, self.sigma1, self.sigma2],
            alpha1_rad: self.alpha1_rad,
            dtheta_rad: self.dtheta_rad,
        }
    }
}

rows! {
    /// What one trial of kind `joint-release` or `coast-down` says of its robot:
    /// `robot_parameters.parquet`. What the kind does not tell is missing. Standard errors end
    /// in `_se`; values of the configuration have `configured` in their names.
    pub struct RobotParameterRow {
        pub trial: String,
        pub kind: String,
        pub robot: String,
        /// The joint that was let go, 1 or 2; 0 for a coast-down.
        pub joint: i64,
        /// Moment of inertia of its link about it, from the configuration.
        pub inertia_kg_m2: f64,
        pub natural_rad_s: f64,
        pub natural_rad_s_se: f64,
        /// From a fit of the whole decay, and from the logarithmic decrement.
        pub damping_ratio: f64,
        pub damping_ratio_se: f64,
        pub damping_ratio_decrement: f64,
        pub damping_ratio_decrement_se: f64,
        pub rest_angle_rad: f64,
        pub rest_angle_rad_se: f64,
        pub rest_angle_configured_rad: f64,
        /// k_tau and c_tau of eq. 11.
        pub stiffness_nm_rad: f64,
        pub stiffness_nm_rad_se: f64,
        pub stiffness_configured_nm_rad: f64,
        pub damping_nm_s_rad: f64,
        pub damping_nm_s_rad_se: f64,
        pub damping_configured_nm_s_rad: f64,
        /// Of the whole robot, from the configuration.
        pub mass_kg: f64,
        /// Rate at which the speed decays.
        pub decay_1_s: f64,
        pub decay_1_s_se: f64,
        /// Sum of c^R of eq. 14, and what the configured proportions make of it.
        pub roll_sum_kg_s: f64,
        pub roll_sum_kg_s_se: f64,
        pub roll_sum_configured_kg_s: f64,
        pub roll0_kg_s: f64,
        pub roll0_kg_s_se: f64,
        pub roll1_kg_s: f64,
        pub roll1_kg_s_se: f64,
        pub roll2_kg_s: f64,
        pub roll2_kg_s_se: f64,
    }
}

/// A quantity that a trial tells of its robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobotQuantity {
    /// Its symbol in plain letters, and its unit.
    pub name: &'static str,
    pub unit: &'static str,
    pub measured: f64,
    pub se: f64,
    /// NaN if it is not in the configuration.
    pub configured: f64,
}

impl RobotParameterRow {
    /// What the trial tells, in the order in which it is to be read.
    pub fn quantities(&self) -> impl Iterator<Item = RobotQuantity> {
        let quantity = |name, unit, [measured, se, configured]: [f64; 3]| RobotQuantity {
            name,
            unit,
            measured,
            se,
            configured,
        };
        let none = f64::NAN;
        let stiffness =
            [self.stiffness_nm_rad, self.stiffness_nm_rad_se, self.stiffness_configured_nm_rad];
        let damping =
            [self.damping_nm_s_rad, self.damping_nm_s_rad_se, self.damping_configured_nm_s_rad];
        let roll = [self.roll_sum_kg_s, self.roll_sum_kg_s_se, self.roll_sum_configured_kg_s];
        [
            quantity("omega_n", "rad/s", [self.natural_rad_s, self.natural_rad_s_se, none]),
            quantity("zeta", "", [self.damping_ratio, self.damping_ratio_se, none]),
            quantity("k_tau", "N m/rad", stiffness),
            quantity("c_tau", "N m s/rad", damping),
            quantity("sum c_R", "kg/s", roll),
        ]
        .into_iter()
        .filter(|quantity| !quantity.measured.is_nan())
    }
}

rows! {
    /// One check of one trial: `checks.parquet`.
    pub struct CheckRow {
        pub trial: String,
        /// Code and name, such as `W003 residual`.
        pub check: String,
        /// `ok`, `warning` or `error`.
        pub severity: String,
        pub value: f64,
        pub limit: f64,
        pub message: String,
    }
}

rows! {
    /// One model fitted to one campaign: `fits.parquet`. Parameters that the model does not have
    /// are missing.
    pub struct FitRow {
        pub campaign: String,
        pub model: String,
        pub skid0_kg_s: f64,
        pub skid1_kg_s: f64,
        pub skid2_kg_s: f64,
        pub roll0_kg_s: f64,
        pub roll1_kg_s: f64,
        pub roll2_kg_s: f64,
        pub roll_sum_kg_s: f64,
        pub stiffness_nm_rad: f64,
        pub damping_nm_s_rad: f64,
        /// 95 % confidence limits of the fitted parameters; missing where the interval is open.
        pub skid0_kg_s_lo: f64,
        pub skid0_kg_s_hi: f64,
        pub skid1_kg_s_lo: f64,
        pub skid1_kg_s_hi: f64,
        pub skid2_kg_s_lo: f64,
        pub skid2_kg_s_hi: f64,
        pub roll0_kg_s_lo: f64,
        pub roll0_kg_s_hi: f64,
        pub roll1_kg_s_lo: f64,
        pub roll1_kg_s_hi: f64,
        pub roll2_kg_s_lo: f64,
        pub roll2_kg_s_hi: f64,
        pub roll_sum_kg_s_lo: f64,
        pub roll_sum_kg_s_hi: f64,
        pub stiffness_nm_rad_lo: f64,
        pub stiffness_nm_rad_hi: f64,
        pub damping_nm_s_rad_lo: f64,
        pub damping_nm_s_rad_hi: f64,
        /// Names of the fitted parameters.
        pub free: Vec<String>,
        /// Names of the parameters that joint-release and coast-down trials gave.
        pub measured: Vec<String>,
        /// Fitted parameters by what the profiles of the objective tell of them.
        pub identifiable: Vec<String>,
        pub practically_not: Vec<String>,
        pub structurally_not: Vec<String>,
        /// Fitted parameters that ended at a bound.
        pub at_bound: Vec<String>,
        /// Value of the objective (eq. 22), averaged over the trials.
        pub j: f64,
        /// Trials that it is averaged over.
        pub trials: i64,
        pub starts: i64,
        /// Starts that ended at this objective, to 1e-6 of it, and those that did not converge.
        pub starts_reached: i64,
        pub starts_failed: i64,
        /// How often a profile found a lower objective, from which the fit went on.
        pub resumed: i64,
        /// Steady motions solved for.
        pub solves: i64,
        /// `ok`, or why there is no fit.
        pub status: String,
    }
}

rows! {
    /// One start of a fit: `starts.parquet`. No time: the same folder gives the same bytes.
    pub struct StartRow {
        pub campaign: String,
        pub model: String,
        pub start: i64,
        /// Where the free parameters began and ended; those that are not free are missing.
        pub began_skid0_kg_s: f64,
        pub began_skid1_kg_s: f64,
        pub began_skid2_kg_s: f64,
        pub began_roll0_kg_s: f64,
        pub began_roll1_kg_s: f64,
        pub began_roll2_kg_s: f64,
        pub began_roll_sum_kg_s: f64,
        pub began_stiffness_nm_rad: f64,
        pub began_damping_nm_s_rad: f64,
        pub ended_skid0_kg_s: f64,
        pub ended_skid1_kg_s: f64,
        pub ended_skid2_kg_s: f64,
        pub ended_roll0_kg_s: f64,
        pub ended_roll1_kg_s: f64,
        pub ended_roll2_kg_s: f64,
        pub ended_roll_sum_kg_s: f64,
        pub ended_stiffness_nm_rad: f64,
        pub ended_damping_nm_s_rad: f64,
        pub j: f64,
        pub solves: i64,
        /// Why the search stopped: "converged"; "joined an earlier start" if it came to where
        /// one with a lower number goes on from, so that both end there; "nothing is free"; "no
        /// motion exists here"; "too many steps".
        pub stopped: String,
    }
}

rows! {
    /// The objective with one free parameter held and the others fitted: `profiles.parquet`.
    pub struct ProfileRow {
        pub campaign: String,
        pub model: String,
        /// The parameter that is held, and where.
        pub parameter: String,
        pub value: f64,
        /// The free parameters there; those that are not free are missing.
        pub skid0_kg_s: f64,
        pub skid1_kg_s: f64,
        pub skid2_kg_s: f64,
        pub roll0_kg_s: f64,
        pub roll1_kg_s: f64,
        pub roll2_kg_s: f64,
        pub roll_sum_kg_s: f64,
        pub stiffness_nm_rad: f64,
        pub damping_nm_s_rad: f64,
        pub j: f64,
        /// Objective above which a value is outside of the profile's interval.
        pub limit_j: f64,
    }
}

rows! {
    /// One replicate of the bootstrap: `bootstrap.parquet`. The number of a replicate stands for
    /// the same resampled measurements in every model of a campaign.
    pub struct BootstrapRow {
        pub campaign: String,
        pub model: String,
        pub replicate: i64,
        /// The free parameters; those that are not free are missing.
        pub skid0_kg_s: f64,
        pub skid1_kg_s: f64,
        pub skid2_kg_s: f64,
        pub roll0_kg_s: f64,
        pub roll1_kg_s: f64,
        pub roll2_kg_s: f64,
        pub roll_sum_kg_s: f64,
        pub stiffness_nm_rad: f64,
        pub damping_nm_s_rad: f64,
        pub j: f64,
        pub solves: i64,
        pub stopped: String,
    }
}

rows! {
    /// How one model compares with its campaign's others: `comparison.parquet`.
    pub struct ComparisonRow {
        pub campaign: String,
        pub model: String,
        /// The objective and its parts; the parts' sum is the whole.
        pub j: f64,
        pub j_d: f64,
        pub j_v: f64,
        pub j_sigma: f64,
        pub j_alpha: f64,
        /// The objective with every frequency's trials predicted by a fit to the others.
        pub j_left_out: f64,
        /// Number of free parameters, and of terms in the objective.
        pub free: i64,
        pub terms: i64,
        /// Information criterion, see [`crate::fit`]; differences count, lower is better.
        pub criterion: f64,
        /// Part of the bootstrap's replicates in which the model has the campaign's lowest
        /// objective.
        pub wins: f64,
        /// The same fit driven by the other gait than the configured one.
        pub other_gait_input: String,
        pub other_gait_j: f64,
        /// Its parameters.
        pub other_gait_skid0_kg_s: f64,
        pub other_gait_skid1_kg_s: f64,
        pub other_gait_skid2_kg_s: f64,
        pub other_gait_roll0_kg_s: f64,
        pub other_gait_roll1_kg_s: f64,
        pub other_gait_roll2_kg_s: f64,
        pub other_gait_roll_sum_kg_s: f64,
        pub other_gait_stiffness_nm_rad: f64,
        pub other_gait_damping_nm_s_rad: f64,
        pub status: String,
        /// What the campaign's measurements say of its models, in a sentence.
        pub sentence: String,
    }
}

rows! {
    /// What a fitted model predicts: `predictions.parquet`.
    pub struct PredictionRow {
        pub campaign: String,
        pub model: String,
        pub omega_rad_s: f64,
        /// `trial` at the trials' frequencies, `curve` on a fine grid.
        pub source: String,
        pub d_m: f64,
        pub v_m_s: f64,
        pub sigma0: f64,
        pub sigma1: f64,
        pub sigma2: f64,
        pub alpha1_rad: f64,
        pub dtheta_rad: f64,
        /// Contribution of this frequency to the objective; only for `trial`.
        pub j: f64,
        /// `stable`, `unstable`, `singular` or `diverged`.
        pub status: String,
        /// Where the robot goes from rest: into this motion (`reached`), into `another`, or into
        /// none (`unsettled`). Only for `trial`, and where there is a motion.
        pub from_rest: String,
    }
}

impl PredictionRow {
    /// The predicted metrics.
    pub fn metrics(&self) -> GaitMetrics {
        GaitMetrics {
            d_m: self.d_m,
            v_m_s: self.v_m_s,
            sigma: [self.sigma0, self.sigma1, self.sigma2],
            alpha1_rad: self.alpha1_rad,
            dtheta_rad: self.dtheta_rad,
        }
    }
}

rows! {
    /// One moment of a simulated motion: what `simulate --trajectory` writes. Forces and torques
    /// are missing where the constraint forces are unbounded.
    pub struct TrajectoryRow {
        pub omega_rad_s: f64,
        /// After phase 0, s.
        pub time_s: f64,
        /// Centre and heading of link 0.
        pub x_m: f64,
        pub y_m: f64,
        pub theta_rad: f64,
        pub phi1_rad: f64,
        pub phi2_rad: f64,
        /// Time derivatives of the coordinates.
        pub x_rate_m_s: f64,
        pub y_rate_m_s: f64,
        pub theta_rate_rad_s: f64,
        pub phi1_rate_rad_s: f64,
        pub phi2_rate_rad_s: f64,
        /// Roll and skid velocities of the wheels.
        pub roll0_m_s: f64,
        pub roll1_m_s: f64,
        pub roll2_m_s: f64,
        pub skid0_m_s: f64,
        pub skid1_m_s: f64,
        pub skid2_m_s: f64,
        /// Forces of the ground on the wheels across them: constraint forces Lambda (eq. 8) or
        /// skid resistance (eq. 15).
        pub lateral0_n: f64,
        pub lateral1_n: f64,
        pub lateral2_n: f64,
        /// Roll resistance (eq. 14).
        pub roll0_n: f64,
        pub roll1_n: f64,
        pub roll2_n: f64,
        /// Torques of the actuators, or of spring and damper at the passive joint.
        pub torque1_nm: f64,
        pub torque2_nm: f64,
        /// Power of the actuators, and what friction takes.
        pub power_w: f64,
        pub loss_w: f64,
    }
}

parameter_columns!(FitRow, parameters, set_parameters: skid0_kg_s, skid1_kg_s, skid2_kg_s, roll0_kg_s, roll1_kg_s, roll2_kg_s, roll_sum_kg_s, stiffness_nm_rad, damping_nm_s_rad);
parameter_columns!(FitRow, lower_limits, set_lower_limits: skid0_kg_s_lo, skid1_kg_s_lo, skid2_kg_s_lo, roll0_kg_s_lo, roll1_kg_s_lo, roll2_kg_s_lo, roll_sum_kg_s_lo, stiffness_nm_rad_lo, damping_nm_s_rad_lo);
parameter_columns!(FitRow, upper_limits, set_upper_limits: skid0_kg_s_hi, skid1_kg_s_hi, skid2_kg_s_hi, roll0_kg_s_hi, roll1_kg_s_hi, roll2_kg_s_hi, roll_sum_kg_s_hi, stiffness_nm_rad_hi, damping_nm_s_rad_hi);
parameter_columns!(StartRow, began, set_began: began_skid0_kg_s, began_skid1_kg_s, began_skid2_kg_s, began_roll0_kg_s, began_roll1_kg_s, began_roll2_kg_s, began_roll_sum_kg_s, began_stiffness_nm_rad, began_damping_nm_s_rad);
parameter_columns!(StartRow, ended, set_ended: ended_skid0_kg_s, ended_skid1_kg_s, ended_skid2_kg_s, ended_roll0_kg_s, ended_roll1_kg_s, ended_roll2_kg_s, ended_roll_sum_kg_s, ended_stiffness_nm_rad, ended_damping_nm_s_rad);
parameter_columns!(ProfileRow, parameters, set_parameters: skid0_kg_s, skid1_kg_s, skid2_kg_s, roll0_kg_s, roll1_kg_s, roll2_kg_s, roll_sum_kg_s, stiffness_nm_rad, damping_nm_s_rad);
parameter_columns!(BootstrapRow, parameters, set_parameters: skid0_kg_s, skid1_kg_s, skid2_kg_s, roll0_kg_s, roll1_kg_s, roll2_kg_s, roll_sum_kg_s, stiffness_nm_rad, damping_nm_s_rad);
parameter_columns!(ComparisonRow, other_gait_parameters, set_other_gait_parameters: other_gait_skid0_kg_s, other_gait_skid1_kg_s, other_gait_skid2_kg_s, other_gait_roll0_kg_s, other_gait_roll1_kg_s, other_gait_roll2_kg_s, other_gait_roll_sum_kg_s, other_gait_stiffness_nm_rad, other_gait_damping_nm_s_rad);
