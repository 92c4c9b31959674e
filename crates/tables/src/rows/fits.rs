//! Tables of fitted models, written by the fit stage.

use serde::Serialize;
use trilink_robot::{ByParameter, Model, Parameter, Per};

use crate::config::GaitInput;
use crate::{
    Contradiction, FitNotes, FitStatus, LawLike, Misfit, NoInterval, NoPrecisionReason, NotTested,
    Outcome, Sharing, Stopped, Undecided, rows,
};

rows! {
    /// Fit of one model to one campaign: row of `fits.parquet`. Fits with the gait input (commanded or measured) that
    /// is not configured are rows of `alternative_fits.parquet`. Parameters that the model does not have are missing.
    #[derive(Serialize)]
    pub struct FitRow {
        pub campaign: String,
        pub model: Model,
        /// Gait that drives the model.
        pub gait_input: GaitInput,
        pub parameters: ByParameter<f64>,
        /// Lower 95 % confidence limits of the free parameters; a limit is missing if its interval has no lower limit.
        /// If all limits are missing, `no_interval` states the reason.
        pub lower: ByParameter<f64> as "{}_lo",
        /// Upper 95 % confidence limits of the free parameters; a limit is missing if its interval has no upper limit.
        /// If all limits are missing, `no_interval` states the reason.
        pub upper: ByParameter<f64> as "{}_hi" after "{}_lo",
        /// Half-widths of the 95 % intervals from the scatter of cycles and repeats (Type A uncertainty).
        pub scatter: ByParameter<f64> as "{}_scatter" after "{}_hi",
        /// Half-widths of the 95 % intervals from errors that all trials share (Type B uncertainty).
        pub systematic: ByParameter<f64> as "{}_systematic" after "{}_scatter",
        /// Standard uncertainties from the scatter of cycles and repeats (GUM, Type A).
        pub type_a: ByParameter<f64> as "{}_u_a" after "{}_systematic",
        /// Standard uncertainties from errors that all trials share (GUM, Type B), without the shift from the fit with
        /// the measured gait, which extends one side of the interval.
        pub type_b: ByParameter<f64> as "{}_u_b" after "{}_u_a",
        /// Effective degrees of freedom of the combined standard uncertainties (Welch-Satterthwaite); infinite if the
        /// uncertainty of Type A is zero.
        pub degrees_of_freedom: ByParameter<f64> as "{}_dof" after "{}_u_b",
        /// Coverage factors: half-widths of the 95 % intervals, without that shift, over the combined standard
        /// uncertainties.
        pub coverage_factor: ByParameter<f64> as "{}_coverage_factor" after "{}_dof",
        /// Reason why there are no confidence limits; missing if there are limits.
        pub no_interval: Option<NoInterval>,
        /// Parameters that were free in the fit.
        pub free: Vec<Parameter>,
        /// Parameters that were measured by joint-release and coast-down trials and are fixed in the fit.
        pub measured: Vec<Parameter>,
        /// Free parameters that are identifiable according to the profiles of the objective.
        pub identifiable: Vec<Parameter>,
        /// Free parameters that are practically not identifiable according to the profiles of the objective.
        pub practically_not: Vec<Parameter>,
        /// Free parameters that are structurally not identifiable according to the profiles of the objective.
        pub structurally_not: Vec<Parameter>,
        /// Simpler law that the trials cannot distinguish from the model's dry-friction law; missing if there is none.
        pub law_is_like: Option<LawLike>,
        /// Free parameters that ended at a bound.
        pub at_bound: Vec<Parameter>,
        /// Objective: weighted sum of absolute relative deviations (eq. 22 of the paper), averaged over the trials.
        pub j: f64,
        /// Misfit ratio: the objective divided by its expectation from noise alone; missing if the noise is
        /// unknown, or if there are no residual degrees of freedom.
        pub lack_of_fit: f64,
        /// Upper limit of the misfit ratio for an adequate model.
        pub lack_of_fit_limit: f64,
        /// Misfit ratio of only those terms of the objective that contain the displacement d.
        pub lack_of_fit_d: f64,
        /// Misfit ratio of only those terms of the objective that contain the speed v.
        pub lack_of_fit_v: f64,
        /// Misfit ratio of only those terms of the objective that contain the skid ratios.
        pub lack_of_fit_sigma: f64,
        /// Misfit ratio of only those terms of the objective that contain the amplitude alpha_1 of the passive joint.
        pub lack_of_fit_alpha: f64,
        /// Lag-1 autocorrelation of the residuals in order of frequency, for the metric in which it is largest.
        pub autocorrelation: f64,
        /// Upper limit of the residuals' autocorrelation for an adequate model.
        pub autocorrelation_limit: f64,
        /// Ratio of the number of runs of residuals with equal sign, in order of frequency, to the number expected for
        /// independent residuals, for the metric in which this ratio is smallest.
        pub runs: f64,
        /// Lower limit of the ratio `runs` for an adequate model.
        pub runs_limit: f64,
        /// Whether the model is adequate: its misfit ratio is within the limit and, if that ratio exceeds 1, so are its
        /// autocorrelation and its number of runs; missing if this could not be tested.
        pub adequate: Option<bool>,
        /// Reason why it is not known whether the model is adequate; missing if it is known.
        pub undecided: Option<Undecided>,
        /// Deviations of the measurements from an inadequate model, or RMS deviations if the noise is unknown; missing
        /// if the model is adequate, or if there are at most as many measurements as free parameters.
        pub misfit: Option<Misfit>,
        /// Whether the same coefficients also describe the campaigns that are fitted together with this one; missing if
        /// this was not requested or not tested.
        pub sharing: Option<Sharing>,
        /// Notes on missing data and uncertainties.
        pub notes: FitNotes,
        /// Whether the confidence intervals hold for the floor of a single day, because all trials are of one day and
        /// no standard deviation between days is configured.
        pub single_day: bool,
        /// Number of trials over which the objective is averaged.
        pub trials: i64,
        /// Number of starting points of the fit.
        pub starts: i64,
        /// Number of starts whose final objective exceeds the lowest one by a fraction of at most 1e-6.
        pub starts_reached: i64,
        /// Number of starts that did not converge.
        pub starts_failed: i64,
        /// Number of times that a profile found a lower objective and the fit was restarted from there.
        pub resumed: i64,
        /// Number of steady-state motions that were solved for the fit.
        pub solves: i64,
        pub status: FitStatus,
        /// Reason why there is no fit, as text for the user; empty if there is a fit.
        pub failure: String,
    }
}

rows! {
    /// Fit of one model with one set of coefficients to all campaigns of a robot, or of several robots with common
    /// wheels: row of `shared_fits.parquet`. The `campaign` of the fit names all these campaigns, and its objective is
    /// the sum of the campaigns' objectives.
    #[derive(Serialize)]
    pub struct SharedFitRow {
        /// Name of the robot, or the names of the robots, joined by `and`.
        pub robot: String,
        pub campaigns: Vec<String>,
        /// For several robots, the wheels that the numbers in the names of coefficients stand for, from 0.
        pub wheels: Vec<String>,
        /// For several robots, the joints that the numbers in the names of coefficients stand for, from 1.
        pub joints: Vec<String>,
        #[serde(flatten)]
        pub fit: FitRow as "{}",
        /// Sum of the objectives of the campaigns' separate fits.
        pub j_separate: f64,
        /// Increase in the objective due to sharing the coefficients.
        pub rise: f64,
        /// Upper limit of the increase in the objective that chance can explain.
        pub rise_limit: f64,
        /// Fraction of bootstrap samples, generated with shared coefficients, in which the increase in the objective is
        /// at least as large as `rise`.
        pub p_value: f64,
        /// Reason why sharing was not tested; missing if it was.
        pub not_tested: Option<NotTested>,
    }
}

impl SharedFitRow {
    /// Returns the wheel or joint of several robots to which a coefficient belongs; `None` for a fit of one robot, and for
    /// a coefficient that is not one of a single wheel or joint.
    pub fn part(&self, coefficient: Parameter) -> Option<&str> {
        let number = coefficient.number()?;
        let part = match coefficient.quantity().definition().per {
            Per::Wheel => self.wheels.get(number),
            Per::FreeJoint => self.joints.get(number.checked_sub(1)?),
            _ => None,
        };
        part.map(String::as_str)
    }
}

rows! {
    /// Precision of a metric in the trials of a campaign (ISO 5725-2): row of `precision.parquet`. Standard deviations
    /// are relative to the mean of the metric at a frequency, pooled over the frequencies.
    #[derive(Serialize)]
    pub struct PrecisionRow {
        pub campaign: String,
        /// Name of the metric, which is a column of `trials.parquet`.
        pub metric: String,
        /// Number of trials that have the metric.
        pub trials: i64,
        /// Number of days of these trials.
        pub days: i64,
        /// Relative standard deviation of trials at the same frequency and on the same day.
        pub repeatability: f64,
        pub repeatability_dof: f64,
        /// Relative standard deviation of trials at the same frequency on different days; it includes the
        /// repeatability.
        pub reproducibility: f64,
        pub reproducibility_dof: f64,
        /// Reason why the repeatability is missing; missing if it is known.
        pub no_repeatability: Option<NoPrecisionReason>,
        /// Reason why the reproducibility is missing; missing if it is known.
        pub no_reproducibility: Option<NoPrecisionReason>,
    }
}

rows! {
    /// Search from one starting point of a fit: row of `starts.parquet`. Run times are left out, so that
    /// repeated runs write identical bytes.
    pub struct StartRow {
        pub campaign: String,
        pub model: Model,
        pub start: i64,
        /// Initial values of the free parameters; fixed parameters are missing.
        pub began: ByParameter<f64> as "began_{}",
        /// Final values of the free parameters; fixed parameters are missing.
        pub ended: ByParameter<f64> as "ended_{}",
        pub j: f64,
        pub solves: i64,
        pub stopped: Stopped,
    }
}

rows! {
    /// Point of the objective's profile along one free parameter, with the other free parameters fitted: row
    /// of `profiles.parquet`.
    pub struct ProfileRow {
        pub campaign: String,
        pub model: Model,
        /// Parameter along which the objective is profiled.
        pub parameter: Parameter,
        /// Value of the profiled parameter.
        pub value: f64,
        /// Values of the free parameters, fitted for the fixed value of the profiled parameter; fixed
        /// parameters are missing.
        pub parameters: ByParameter<f64>,
        pub j: f64,
        /// Objective above which a parameter value is outside the confidence interval.
        pub limit_j: f64,
    }
}

rows! {
    /// Bootstrap replicate: row of `bootstrap.parquet`. For all models of a campaign, replicates with the
    /// same number are fits to the same resampled measurements.
    pub struct BootstrapRow {
        pub campaign: String,
        pub model: Model,
        pub replicate: i64,
        /// Fitted values of the free parameters; fixed parameters are missing.
        pub parameters: ByParameter<f64>,
        pub j: f64,
        /// Schwarz criterion (BIC) of the model for a bootstrap resample of the campaign's frequencies, computed with
        /// the model linearised at its fit.
        pub criterion_resampled: f64,
        pub solves: i64,
        pub stopped: Stopped,
    }
}

rows! {
    /// Comparison of a model with the other models of its campaign: row of `comparison.parquet`.
    #[derive(Serialize)]
    pub struct ComparisonRow {
        pub campaign: String,
        pub model: Model,
        /// Objective: the sum of its terms for the displacement d, the speed v, the skid ratios and the amplitude
        /// alpha_1 of the passive joint.
        pub j: f64,
        pub j_d: f64,
        pub j_v: f64,
        pub j_sigma: f64,
        pub j_alpha: f64,
        /// Leave-one-frequency-out cross-validation error: the objective in which the trials at each frequency are
        /// predicted by a fit to the trials at all other frequencies.
        pub j_left_out: f64,
        /// Objective of the trials at frequencies above `extrapolated_above_rad_s`, predicted by a fit to the
        /// other trials; missing if there are too few trials in either group.
        pub j_extrapolated: f64,
        pub extrapolated_above_rad_s: f64,
        /// Number of free parameters.
        pub free: i64,
        /// Number of independent measurements in the objective; the displacement d and the speed v of a trial count as
        /// one.
        pub terms: i64,
        /// Schwarz criterion (BIC, see `trilink_fit`), up to a constant; lower is better.
        pub criterion: f64,
        /// Selection frequency: fraction of bootstrap replicates, with resampled frequencies, in which the model has
        /// the lowest Schwarz criterion of all models of the campaign.
        pub wins: f64,
        /// Rank in the order of preference: 1 for the preferred model, 0 if the model has no fit.
        pub rank: i64,
        /// Whether the model is the preferred one: the model with the lowest criterion among the adequate
        /// models of the campaign, or among all its models if none is adequate.
        pub preferred: bool,
        /// Whether the measurements do not distinguish the model from the preferred one.
        pub rival: bool,
        /// Frequency at which one more trial would best discriminate the model from the preferred one.
        pub tell_omega_rad_s: f64,
        /// Metric in which one more trial would best discriminate the model from the preferred one.
        pub tell_metric: String,
        /// Difference in `tell_metric` at `tell_omega_rad_s` between the predictions of this model and the preferred
        /// one, in standard errors of a trial.
        pub tell_standard_errors: f64,
        pub status: FitStatus,
        /// Outcome of the comparison of the campaign's models, which [`crate::Comparison`] formats as a
        /// sentence.
        pub outcome: Outcome,
        /// Contradiction of the model by a joint-release or coast-down trial; missing if there is none.
        pub contradiction: Option<Contradiction>,
        /// Number of requested bootstrap replicates.
        pub replicates: i64,
        /// Number of the campaign's trials that have no metrics.
        pub trials_without_metrics: i64,
        /// Number of fitted trials whose coordinates were filtered before the export.
        pub trials_filtered: i64,
    }
}
