//! Tables of fitted models, written by the fit stage.

use serde::Serialize;
use trilink_robot::{ByParameter, Model, Parameter};

use crate::config::GaitInput;
use crate::{
    Contradiction, FitNotes, FitStatus, LawLike, Misfit, NoInterval, NotTested, Outcome, Sharing,
    Stopped, rows,
};

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
        pub no_interval: Option<NoInterval>,
        /// The fitted parameters.
        pub free: Vec<Parameter>,
        /// The parameters that joint-release and coast-down trials gave.
        pub measured: Vec<Parameter>,
        /// Fitted parameters by what the profiles of the objective tell of them.
        pub identifiable: Vec<Parameter>,
        pub practically_not: Vec<Parameter>,
        pub structurally_not: Vec<Parameter>,
        /// The law that a law with dry friction is not told from at any of the trials' motions.
        pub law_is_like: Option<LawLike>,
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
        pub misfit: Option<Misfit>,
        /// Whether the same coefficients describe the robot's other campaigns; missing where that
        /// was not asked for or could not be tested.
        pub sharing: Option<Sharing>,
        /// What was fitted instead of what is missing, and what the objective and the intervals lack.
        pub notes: FitNotes,
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
        pub not_tested: Option<NotTested>,
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
        /// Information criterion, see `trilink_fit`; differences count, lower is better.
        pub criterion: f64,
        /// Part of the bootstrap's replicates in which the model has the campaign's lowest
        /// criterion, with the frequencies resampled, too.
        pub wins: f64,
        /// Order of preference: 1 of the preferred model, 0 without a fit.
        pub rank: i64,
        /// Whether it is the campaign's preferred model: of those that fit the one with the lowest
        /// criterion, of all where none fits.
        pub preferred: bool,
        /// Whether the measurements do not tell it apart from that one.
        pub rival: bool,
        /// The frequency and the metric at which one more trial would best discriminate the model from
        /// the preferred one, and the difference of the two there, in standard errors of a trial.
        pub tell_omega_rad_s: f64,
        pub tell_metric: String,
        pub tell_standard_errors: f64,
        pub status: FitStatus,
        /// What the campaign's measurements say of its models; [`crate::Comparison`] has the sentence.
        pub outcome: Outcome,
        /// What a trial of another kind tells against this model.
        pub contradiction: Option<Contradiction>,
        /// Replicates that were asked for.
        pub replicates: i64,
        /// Trials of the campaign that have no metrics.
        pub trials_without_metrics: i64,
        /// Those fitted whose coordinates were filtered before the export.
        pub trials_filtered: i64,
    }
}
