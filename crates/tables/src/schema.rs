//! The tables of `derived/`. Column names are a contract: scripts of others read them.

use std::path::{Path, PathBuf};

use serde::Serialize;
use trilink_base::text::known;
use trilink_robot::decay::{DecayLaw, Swing};
use trilink_robot::metrics::{Bifurcation, BranchKind, FromRest, GaitMetrics, MotionStatus};
use trilink_robot::{ByParameter, ContactForces, JointCommand, Model, Parameter, Quantity};
use trilink_statistics::Estimate;

use super::{FitStatus, PredictionSource, Severity, Sharing, Stopped, TrialStatus};
use crate::config::{GaitInput, SigmaKind};
use crate::trial::TrialKind;
use crate::{columns, rows};

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

/// Between the labels of markers in a text.
pub const LABELS_APART: &str = ", ";

rows! {
    /// One cycle of a trial: `cycles/<trial>.parquet`.
    #[derive(Serialize)]
    pub struct CycleRow {
        pub trial: String,
        pub cycle: i64,
        /// When the cycle starts, after the first frame, s.
        pub start_s: f64,
        pub metrics: GaitMetrics,
        /// What the joints do in it.
        pub gait: [JointCycle; 2] as "phi{}_{}",
        /// Whether the cycle counts towards the trial's means, and where it does not, why.
        pub used: bool,
        pub reason: String,
    }
}

rows! {
    /// One trial: `trials.parquet`. Standard errors end in `_se`.
    #[derive(Serialize)]
    pub struct TrialRow {
        /// Its id, with its folder's name in front where another folder has the same.
        pub trial: String,
        /// Where it is: its folder as seen from the configuration, and its id and its marker file in
        /// the folder's list.
        pub folder: String,
        pub id: String,
        pub file: String,
        /// Empty for trials that are not of kind `gait`.
        pub campaign: String,
        pub kind: TrialKind,
        pub omega_commanded_rad_s: f64,
        /// Measured, by harmonic regression on the commanded joints.
        pub omega_rad_s: f64,
        pub omega_rad_s_se: f64,
        /// Cycles that the means are taken over.
        pub cycles: i64,
        /// Means over the cycles, and their standard errors.
        pub metrics: GaitMetrics,
        pub metrics_se: GaitMetrics as "{}_se" after "{}",
        /// Skid ratios without what the markers' noise makes of them.
        pub sigma_debiased: [Estimate; 3] as "sigma{}_debiased{}" after "sigma2_se",
        /// Measured gait of the joints.
        pub gait: [JointGait; 2] as "phi{}_{}",
        /// Part of all markers' frames that the cameras saw.
        pub coverage: f64,
        /// Mean residual of the rigid fits, mm.
        pub residual_mm: f64,
        /// Whether the markers' noise is white, as all errors take it to be; a filter before the export ends that.
        /// Missing where too little was seen to tell.
        pub noise_white: Option<bool>,
        /// Width of the moving average, samples.
        pub smoothing_window: i64,
        /// What it leaves of the speeds of the gait's first three harmonics. Only the raw skid
        /// ratios and the tables of smoothed coordinates and speeds lose the rest.
        pub smoothing_left1: f64,
        pub smoothing_left2: f64,
        pub smoothing_left3: f64,
        pub status: TrialStatus,
        pub message: String,
    }
}

rows! {
    /// What a joint does in a cycle: as [`JointGait`].
    #[derive(Copy, Serialize)]
    pub struct JointCycle {
        pub offset_rad: f64,
        pub amplitude_rad: f64,
        pub phase_rad: f64,
    }
}

rows! {
    /// What a joint does: `phi = offset + amplitude cos(omega t + phase)`, the phase of a
    /// commanded joint being that of its command.
    #[derive(Copy, Serialize)]
    pub struct JointGait {
        pub offset_rad: f64,
        pub amplitude_rad: f64,
        pub phase_rad: f64,
        /// What else it does in every cycle: RMS of its harmonics above the first.
        pub harmonics_rad: f64,
        pub offset_rad_se: f64,
        pub amplitude_rad_se: f64,
        pub phase_rad_se: f64,
    }
}

impl JointGait {
    /// The command that would give it, but for the harmonics.
    pub fn command(&self) -> JointCommand {
        let Self { offset_rad, amplitude_rad, phase_rad, .. } = *self;
        JointCommand::new(offset_rad, amplitude_rad, phase_rad)
    }

    /// Standard errors of offset, amplitude and phase.
    pub fn errors_rad(&self) -> [f64; 3] {
        [self.offset_rad_se, self.amplitude_rad_se, self.phase_rad_se]
    }
}

impl TrialRow {
    /// Measured skid ratios of wheels 0, 1, 2. A debiased one of which nothing is left above the
    /// noise is missing; the raw one replaces a debiased one that is not known.
    pub fn sigma(&self, kind: SigmaKind) -> [Estimate; 3] {
        std::array::from_fn(|wheel| {
            let raw = Estimate::new(self.metrics.sigma[wheel], self.metrics_se.sigma[wheel]);
            let debiased = self.sigma_debiased[wheel];
            match kind {
                SigmaKind::Debiased if debiased.value > 0.0 => debiased,
                SigmaKind::Debiased if !debiased.value.is_nan() => Estimate::MISSING,
                SigmaKind::Debiased | SigmaKind::Raw => raw,
            }
        })
    }

    /// Whether [`TrialRow::sigma`] gives raw skid ratios instead of debiased ones.
    pub fn lacks_debiased(&self) -> bool {
        let both = self.metrics.sigma.iter().zip(&self.sigma_debiased);
        both.into_iter().any(|(raw, debiased)| raw.is_finite() && debiased.value.is_nan())
    }
}

rows! {
    /// What one trial of kind `joint-release` or `coast-down` says of its robot:
    /// `robot_parameters.parquet`. What the kind does not tell is missing. Standard errors end
    /// in `_se`; values of the configuration have `configured` in their names.
    #[derive(Serialize)]
    pub struct RobotParameterRow {
        pub trial: String,
        pub kind: TrialKind,
        pub robot: String,
        /// The law that the recording follows; what stands under no law's name follows from it.
        pub law: Option<DecayLaw>,
        /// The joint that was let go, 1 or 2; 0 for a coast-down.
        pub joint: i64,
        /// Moment of inertia of its link about it, from the configuration.
        pub inertia_kg_m2: f64,
        pub natural_rad_s: Estimate,
        /// From a fit of the whole decay, and from the logarithmic decrement.
        pub damping_ratio: Estimate,
        pub damping_ratio_decrement: Estimate,
        pub rest_angle_rad: Estimate,
        pub rest_angle_configured_rad: f64,
        /// The decay that was fitted: at `t` after `released_s`, which is after the first frame,
        /// `rest_angle + exp(-zeta omega_n t) (cosine cos(omega_d t) + sine sin(omega_d t))`, with
        /// dry friction until the first turn and about an angle off the rest ([`Swing`]).
        pub released_s: f64,
        pub decay_cosine_rad: f64,
        pub decay_sine_rad: f64,
        /// k_tau and c_tau of eq. 11.
        pub stiffness_nm_rad: Estimate,
        pub stiffness_configured_nm_rad: f64,
        pub damping_nm_s_rad: Estimate,
        pub damping_configured_nm_s_rad: f64,
        /// Torque of dry friction in the joint.
        pub joint_dry_nm: Estimate,
        /// Of the whole robot, from the configuration.
        pub mass_kg: f64,
        /// Rate at which the speed decays.
        pub decay_1_s: Estimate,
        /// Sum of c^R of eq. 14, and what the configured proportions make of it.
        pub roll_sum_kg_s: Estimate,
        pub roll_sum_configured_kg_s: f64,
        pub roll_kg_s: [Estimate; 3] as "roll{}_kg_s{}",
        /// Dry friction of the wheels together.
        pub roll_dry_sum_n: Estimate,
        pub roll_dry_sum_configured_n: f64,
        /// What each law gives, whether or not the recording follows it.
        pub viscous: DecayFit as "viscous_{}",
        pub coulomb: DecayFit as "coulomb_{}",
        pub coulomb_viscous: DecayFit as "coulomb_viscous_{}",
        /// Above these a law is refused.
        pub misfit_over_noise_limit: f64,
        pub f_limit: f64,
        /// Why there is no law that the recording follows, or none that it tells from the others;
        /// then what was measured is missing.
        pub status: FitStatus,
    }
}

rows! {
    /// A law by which a motion dies away, fitted to a recording.
    #[derive(Copy, Serialize)]
    pub struct DecayFit {
        /// RMS residual of the path of a coast-down, and of the angle of a joint.
        pub misfit_m: f64,
        pub misfit_rad: f64,
        /// What is slow in the residuals over what noise makes of it.
        pub misfit_over_noise: f64,
        /// F of the law against the one with both parts.
        pub f: f64,
        /// Whether it is not refused.
        pub adequate: Option<bool>,
        pub roll_sum_kg_s: Estimate,
        pub roll_dry_sum_n: Estimate,
        pub stiffness_nm_rad: Estimate,
        pub damping_nm_s_rad: Estimate,
        pub joint_dry_nm: Estimate,
    }
}

/// A quantity that a trial tells of its robot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RobotQuantity {
    /// Its symbol in plain letters, and its unit.
    pub name: &'static str,
    pub unit: &'static str,
    pub measured: Estimate,
    /// NaN if it is not in the configuration.
    pub configured: f64,
}

impl RobotQuantity {
    /// How many times as large as configured it is measured.
    pub fn times_configured(&self) -> f64 {
        self.measured.value / self.configured
    }
}

impl RobotParameterRow {
    /// The fitted decay of a joint that was let go, from its release on.
    pub fn swing(&self) -> Swing {
        // Of a law without one of its parts that is missing.
        let part = |of: f64| if of.is_nan() { 0.0 } else { of };
        let [ratio, natural_rad_s] = [part(self.damping_ratio.value), self.natural_rad_s.value];
        Swing {
            rest_rad: self.rest_angle_rad.value,
            cosine_rad: self.decay_cosine_rad,
            sine_rad: self.decay_sine_rad,
            viscous_1_s: ratio * natural_rad_s,
            damped_rad_s: natural_rad_s * (1.0 - ratio.powi(2)).sqrt(),
            dry_rad: part(self.joint_dry_nm.value / self.stiffness_nm_rad.value),
        }
    }

    /// Its angle at a time after the release, rad.
    pub fn decay_rad(&self, after_s: f64) -> f64 {
        self.swing().angle_rad(after_s).0
    }

    /// What each law gives, with what the configuration has of it.
    pub fn laws(&self) -> [(DecayLaw, &DecayFit); 3] {
        let [viscous, coulomb, both] = DecayLaw::ALL;
        [(viscous, &self.viscous), (coulomb, &self.coulomb), (both, &self.coulomb_viscous)]
    }

    /// What the trial tells, in the order in which it is to be read.
    pub fn quantities(&self) -> impl Iterator<Item = RobotQuantity> {
        let stiffness = (self.stiffness_nm_rad, self.stiffness_configured_nm_rad);
        let damping = (self.damping_nm_s_rad, self.damping_configured_nm_s_rad);
        let roll = (self.roll_sum_kg_s, self.roll_sum_configured_kg_s);
        let roll_dry = (self.roll_dry_sum_n, self.roll_dry_sum_configured_n);
        [
            ("omega_n", "rad/s", (self.natural_rad_s, f64::NAN)),
            ("zeta", "", (self.damping_ratio, f64::NAN)),
            ("k_tau", Quantity::Stiffness.one().unit(), stiffness),
            ("c_tau", Quantity::Damping.one().unit(), damping),
            ("T_tau", "N m", (self.joint_dry_nm, f64::NAN)),
            ("sum c_R", Quantity::Roll.sum().unit(), roll),
            ("sum F_R", Quantity::RollDry.sum().unit(), roll_dry),
        ]
        .into_iter()
        .map(|(name, unit, (measured, configured))| RobotQuantity {
            name,
            unit,
            measured,
            configured,
        })
        .filter(|quantity| !quantity.measured.value.is_nan())
    }
}

rows! {
    /// One check of one trial: `checks.parquet`.
    #[derive(Serialize)]
    pub struct CheckRow {
        pub trial: String,
        /// Code and name, such as `W003 residual`.
        pub check: String,
        pub severity: Severity,
        pub value: f64,
        pub limit: f64,
        pub message: String,
    }
}

rows! {
    /// One model fitted to one campaign: `fits.parquet`, and `alternative_fits.parquet` for the other
    /// gait than the configured one. Parameters that the model does not have
    /// are missing.
    #[derive(Serialize)]
    pub struct FitRow {
        pub campaign: String,
        pub model: Model,
        /// The gait that drives it.
        pub gait_input: GaitInput,
        pub parameters: ByParameter<f64>,
        /// 95 % confidence limits of the fitted parameters; missing where the interval is open,
        /// and all of them for the reason in `no_interval`.
        pub lower: ByParameter<f64> as "{}_lo",
        pub upper: ByParameter<f64> as "{}_hi" after "{}_lo",
        /// Half the widths that the intervals have by the scatter of cycles and repeats, and by
        /// what all trials share.
        pub scatter: ByParameter<f64> as "{}_scatter" after "{}_hi",
        pub systematic: ByParameter<f64> as "{}_systematic" after "{}_scatter",
        /// Why there are no confidence limits.
        pub no_interval: String,
        /// The fitted parameters.
        pub free: Vec<Parameter>,
        /// The parameters that joint-release and coast-down trials gave.
        pub measured: Vec<Parameter>,
        /// Fitted parameters by what the profiles of the objective tell of them.
        pub identifiable: Vec<Parameter>,
        pub practically_not: Vec<Parameter>,
        pub structurally_not: Vec<Parameter>,
        /// The law that a law with dry friction is not told from at any of the trials' motions,
        /// and why.
        pub law_is_like: String,
        /// Fitted parameters that ended at a bound.
        pub at_bound: Vec<Parameter>,
        /// Value of the objective (eq. 22), averaged over the trials.
        pub j: f64,
        /// The objective over the one that noise alone leaves, and the limit of this ratio;
        /// missing where nothing tells the noise, or no measurement is left to test the model with.
        pub lack_of_fit: f64,
        pub lack_of_fit_limit: f64,
        /// The same ratio of the terms of d, v, sigma and alpha_1.
        pub lack_of_fit_d: f64,
        pub lack_of_fit_v: f64,
        pub lack_of_fit_sigma: f64,
        pub lack_of_fit_alpha: f64,
        /// Lag-1 autocorrelation over frequency of the residuals of the metric where it is
        /// largest, and its limit.
        pub autocorrelation: f64,
        pub autocorrelation_limit: f64,
        /// Runs of residuals of one sign over frequency, as a part of those of independent
        /// residuals, of the metric where they are fewest, and its limit.
        pub runs: f64,
        pub runs_limit: f64,
        /// Whether the model is within the three limits; missing where they are.
        pub adequate: Option<bool>,
        /// Where and to which side the measurements are off an inadequate model, or by how much where
        /// nothing tells the noise.
        pub misfit: String,
        /// Whether the same coefficients describe the robot's other campaigns; missing where that
        /// was not asked for or could not be tested.
        pub sharing: Option<Sharing>,
        /// What was fitted instead of what is missing, and what the objective and the intervals lack.
        pub notes: String,
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
        pub status: FitStatus,
    }
}

rows! {
    /// One model fitted with one set of coefficients to all campaigns of a robot:
    /// `shared_fits.parquet`. Its `campaign` names all of them, and its objective is the sum of theirs.
    #[derive(Serialize)]
    pub struct SharedFitRow {
        pub robot: String,
        pub campaigns: Vec<String>,
        #[serde(flatten)]
        pub fit: FitRow as "{}",
        /// Sum of the objectives of the campaigns' own fits.
        pub j_separate: f64,
        /// What sharing adds to it, and the limit of what it adds by chance.
        pub rise: f64,
        pub rise_limit: f64,
        /// Part of worlds with the same coefficients in which sharing adds as much.
        pub p_value: f64,
        /// Why sharing is neither kept nor refused.
        pub not_tested: String,
    }
}

impl SharedFitRow {
    /// What came out, in a sentence.
    pub fn sentence(&self) -> String {
        let Self { fit, j_separate, rise, rise_limit, p_value, not_tested, .. } = self;
        if !fit.status.is_ok() {
            return format!(
                "one set of coefficients for all campaigns has no fit ({}).",
                fit.status
            );
        }
        let verdict = match fit.sharing {
            Some(Sharing::Kept) => "one set of coefficients describes all campaigns as well",
            Some(Sharing::Refused) => "one set of coefficients for all campaigns is refused",
            None => "whether all campaigns have the same coefficients is not known",
        };
        let reason = match not_tested.is_empty() || fit.sharing.is_some() {
            true => String::new(),
            false => format!(", since {not_tested}"),
        };
        let j = known([fit.j, *j_separate], |[j, separate]| {
            format!(": J = {j:.4} against {separate:.4} of separate fits")
        });
        let tested = known([*rise, *rise_limit, *p_value], |[rise, limit, p]| {
            format!(", {rise:.4} more, of which up to {limit:.4} would be chance (p = {p:.3})")
        });
        let tested = if fit.sharing.is_some() && !j.is_empty() { tested } else { String::new() };
        format!("{verdict}{reason}{j}{tested}.")
    }
}

rows! {
    /// One start of a fit: `starts.parquet`. No time: the same folder gives the same bytes.
    pub struct StartRow {
        pub campaign: String,
        pub model: Model,
        pub start: i64,
        /// Where the free parameters began and ended; those that are not free are missing.
        pub began: ByParameter<f64> as "began_{}",
        pub ended: ByParameter<f64> as "ended_{}",
        pub j: f64,
        pub solves: i64,
        pub stopped: Stopped,
    }
}

rows! {
    /// The objective with one free parameter held and the others fitted: `profiles.parquet`.
    pub struct ProfileRow {
        pub campaign: String,
        pub model: Model,
        /// The parameter that is held, and where.
        pub parameter: Parameter,
        pub value: f64,
        /// The free parameters there; those that are not free are missing.
        pub parameters: ByParameter<f64>,
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
        pub model: Model,
        pub replicate: i64,
        /// The free parameters; those that are not free are missing.
        pub parameters: ByParameter<f64>,
        pub j: f64,
        /// Information criterion with the frequencies resampled, too, by the model linearised at
        /// its fit.
        pub criterion_resampled: f64,
        pub solves: i64,
        pub stopped: Stopped,
    }
}

rows! {
    /// How one model compares with its campaign's others: `comparison.parquet`.
    #[derive(Serialize)]
    pub struct ComparisonRow {
        pub campaign: String,
        pub model: Model,
        /// The objective and its parts; the parts' sum is the whole.
        pub j: f64,
        pub j_d: f64,
        pub j_v: f64,
        pub j_sigma: f64,
        pub j_alpha: f64,
        /// The objective with every frequency's trials predicted by a fit to the others.
        pub j_left_out: f64,
        /// The objective of the trials above a frequency, predicted by a fit to those up to it;
        /// missing where there are too few of either.
        pub j_extrapolated: f64,
        pub extrapolated_above_rad_s: f64,
        /// Number of free parameters, and of measurements in the objective: d and v of a trial
        /// are one.
        pub free: i64,
        pub terms: i64,
        /// Information criterion, see [`trilink_fit`]; differences count, lower is better.
        pub criterion: f64,
        /// Part of the bootstrap's replicates in which the model has the campaign's lowest
        /// criterion, with the frequencies resampled, too.
        pub wins: f64,
        /// Whether it is the campaign's preferred model: of those that fit the one with the lowest
        /// criterion, of all where none fits.
        pub preferred: bool,
        /// The frequency and the metric of one more trial that would best tell the model from the
        /// preferred one, and how far both are apart there, in standard errors of a trial.
        pub tell_omega_rad_s: f64,
        pub tell_metric: String,
        pub tell_standard_errors: f64,
        pub status: FitStatus,
        /// What the campaign's measurements say of its models, in a sentence.
        pub sentence: String,
    }
}

rows! {
    /// What a fitted model predicts: `predictions.parquet`.
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
        pub no_interval: String,
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

columns! {
    ContactForces {
        lateral_n: [f64; 3] as "lateral{}_n",
        roll_n: [f64; 3] as "roll{}_n",
        torque_nm: [f64; 2] as "torque{}_nm",
        power_w: f64,
        loss_w: f64,
    }
}

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
