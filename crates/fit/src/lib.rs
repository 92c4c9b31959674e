//! Fits every model of every campaign to the trials (section IV.D): the best coefficients, their uncertainty, and the
//! preferred model.
//!
//! The bootstrap gives the random uncertainty: the scatter between cycles and between repeated trials. The systematic
//! uncertainty covers errors that are common to all trials: a model that needs different coefficients for different
//! blocks of frequencies, robot parameters with a given standard deviation, and a gait that differs from its command.
//! The confidence intervals do not cover any other common errors.
//!
//! Among the adequate models, the one with the lowest Bayesian information criterion is preferred. The comparison also
//! reports how often the bootstrap selects each model, how well each one predicts frequencies that were left out and
//! frequencies above the fitted ones, and which additional trial would best discriminate between each model and the
//! preferred one.
//!
//! - [`fit`] processes one model of one campaign at a time: `input`, `measurement`, `job`.
//! - Misfit J (eq. 21 and 22): `robots`, `conditions`, `terms`, `objective`; its minimisation: `starts`, `search`,
//!   `least_absolute`, `hessian`.
//! - Uncertainty: `trial_noise`, `resample`, `resampler`, `variation`, `profile`, `intervals`.
//! - Model selection: `adequacy` (lack of fit), `criterion`, `compare`, `law_class`; `shared`, `sharing` (one set of
//!   coefficients for several campaigns).
//! - Applications of a fitted model: `predict` and `bands`, [`simulate`], [`optimise`] (the best gait), [`design`] (the
//!   next trials), `problem` (the objective of a fit, for optimisers of other programs).
//!
//! Steady-state motion of a configured model (see [`fit`] for an example of a fit):
//!
//! ```
//! use trilink_fit::simulate::Setup;
//! use trilink_mechanics::REFERENCE_ACCURACY;
//! use trilink_tables::config::Config;
//!
//! let settings = ["skid_kg_s=104,34,45".to_owned()];
//! let setup =
//!     Setup::new(Config::default(), "kinematic-symmetric", "skid-roll", &settings, None)?;
//! let motion = setup.problem(3.9).solve(REFERENCE_ACCURACY)?;
//! assert!((motion.metrics.d_m - 0.478359748170948).abs() < 1e-10);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod adequacy;
mod alternatives;
mod bands;
mod compare;
mod conditions;
mod criterion;
pub mod design;
mod deviations;
mod discrimination;
mod fitted_point;
mod folder;
mod gait_over_frequency;
mod hessian;
mod information;
mod input;
mod intervals;
mod job;
mod known;
mod law_class;
mod least_absolute;
mod measured_range;
mod measurement;
mod objective;
pub mod optimise;
mod precision;
mod predict;
mod problem;
mod profile;
mod resample;
mod resampler;
mod robots;
mod rows;
mod search;
mod shared;
mod sharing;
pub mod simulate;
mod starts;
mod terms;
mod trial_noise;
mod variation;

use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_tables::config::{Config, GaitInput};
use trilink_tables::{
    BootstrapRow, ComparisonRow, CycleRow, FitRow, PrecisionRow, PredictionRow, ProfileRow,
    ResidualRow, RobotParameterRow, SharedFitRow, Sharing, StartRow, TrialRow,
};

use job::Job;
use resampler::Resampler;

pub use alternatives::Alternatives;
pub use compare::preferred;
pub use folder::{FitKey, TABLES, input_paths};
pub use information::{FitInformation, TrialInformation};
pub use input::{FitCampaign, FitInput, FreeParameter};
pub use known::{KnownFit, PredictionBands};
pub use measured_range::MeasuredRange;
pub use measurement::Measurement;
pub use objective::{Evaluator, Objective, Protocol};
pub use problem::{FitProblem, Residuals, Term};
pub use shared::SharedInput;
pub use starts::{Start, search};

/// Measurements that models are fitted to.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FitData {
    pub trials: Vec<TrialRow>,
    /// Cycles by trial name; trials without cycles are resampled according to their standard errors.
    pub cycles: BTreeMap<String, Vec<CycleRow>>,
    /// Robot parameters measured by joint-release and coast-down trials.
    pub robots: Vec<RobotParameterRow>,
}

impl From<Vec<TrialRow>> for FitData {
    fn from(trials: Vec<TrialRow>) -> Self {
        Self { trials, ..Self::default() }
    }
}

/// Tables that a fit produces.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Fitted {
    pub fits: Vec<FitRow>,
    /// Fits of the same models driven by the gait that is not configured (measured or commanded); they have no profiles
    /// if there are replicates.
    pub alternatives: Vec<FitRow>,
    pub starts: Vec<StartRow>,
    pub profiles: Vec<ProfileRow>,
    pub bootstrap: Vec<BootstrapRow>,
    pub comparison: Vec<ComparisonRow>,
    pub predictions: Vec<PredictionRow>,
    pub residuals: Vec<ResidualRow>,
    /// Fits of one set of coefficients to all campaigns of a robot, or of robots with common wheels.
    pub shared: Vec<SharedFitRow>,
    /// Repeatability and reproducibility of the metrics of each campaign.
    pub precision: Vec<PrecisionRow>,
}

/// Bootstrap replicates to fit, and those that other shards (separate runs of the same fit) have computed.
#[derive(Debug, Clone)]
pub struct Replicates {
    /// Indices of the replicates to fit.
    pub numbers: Range<usize>,
    /// Replicates with lower indices that other shards (separate runs of the same fit) have computed, by the gait that
    /// drives the model.
    pub given: BTreeMap<GaitInput, Vec<BootstrapRow>>,
}

impl Default for Replicates {
    /// Returns the default: all replicates are to be fitted, and none are given.
    fn default() -> Self {
        Self { numbers: 0..usize::MAX, given: BTreeMap::new() }
    }
}

/// Progress event of a fit, which may be reported from any thread.
#[derive(Debug, Clone, Copy)]
pub enum FitEvent<'f> {
    /// A replicate has been fitted: `done` of `total` for this model and driving gait.
    Replicate { driven_by: GaitInput, row: &'f BootstrapRow, done: usize, total: usize },
    /// A model has been fitted to a campaign.
    Fitted(&'f FitRow),
    /// A model has been fitted to all campaigns of a robot, or of robots with common wheels.
    Shared(&'f SharedFitRow),
}

/// Callback that receives the progress of a fit.
pub type OnEvent<'f> = &'f (dyn Fn(FitEvent) + Sync);

/// Fits all models of all campaigns. Models, starts, profiles and replicates run in parallel; the results have a fixed
/// order and depend neither on the number of threads nor on the order of the trials.
///
/// ```
/// use trilink_tables::config::{Config, GaitInput, SigmaKind};
/// use trilink_fit::{FitData, fit};
/// use trilink_mechanics::{FIT_ACCURACY, Problem, Solver};
/// use trilink_robot::{Laws, Model, Quantity};
/// use trilink_tables::{Columns, TrialRow};
///
/// let campaign = "kinematic-symmetric";
/// let mut config = Config::default();
/// config.campaign.retain(|name, _| name == campaign);
/// config.campaign.get_mut(campaign).unwrap().models = vec![Model::SKID_ROLL];
/// (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (1, 0, false);
/// (config.fit.sigma, config.fit.gait_input) = (SigmaKind::Raw, GaitInput::Commanded);
///
/// let (mut robot, gait) = config.campaign_setup(campaign).unwrap();
/// robot.skid_kg_s = [104.0, 34.0, 45.0];
/// let trial = |omega_rad_s: f64| {
///     let problem = Problem::new(robot.clone(), gait, Laws::SKID_ROLL, omega_rad_s);
///     let metrics = Solver::default().solve(&problem, FIT_ACCURACY).unwrap();
///     let (trial, campaign) = (format!("at {omega_rad_s} rad/s"), campaign.to_owned());
///     TrialRow { trial, campaign, omega_rad_s, metrics, ..TrialRow::blank() }
/// };
/// let trials: Vec<TrialRow> = [1.0, 2.0, 3.0, 4.0].map(trial).into();
/// let fitted = fit(&config, &FitData::from(trials), &|_| {});
/// let skid0_kg_s = fitted.fits[0].parameters[Quantity::Skid.parameter(0)];
/// assert!((skid0_kg_s / 104.0 - 1.0).abs() < 1e-4);
/// ```
pub fn fit(config: &Config, data: &FitData, on_event: OnEvent) -> Fitted {
    let inputs = FitInputs::new(config);
    let replicates = Replicates::default();
    let token = CancelToken::default();
    fit_except(&inputs, data, BTreeMap::new(), &replicates, on_event, &token)
        .expect("the cancellation token is not shared, so nothing can cancel the fit")
}

/// Inputs for all fits of a configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct FitInputs {
    /// Inputs for each model of each campaign, in the order of the configuration.
    pub own: Vec<FitInput>,
    /// Inputs for each model that is fitted to all campaigns of one or several robots together.
    pub shared: Vec<SharedInput>,
}

impl FitInputs {
    pub fn new(config: &Config) -> Self {
        Self { own: FitInput::all(config), shared: SharedInput::all(config) }
    }
}

/// Fits the models that are not `cached`, as [`fit`] does, with the given replicates, and returns the tables of all
/// models, equal to those from a fit of all models. Fits to several campaigns together compute all of their replicates.
///
/// # Errors
/// Returns an error if the fit is cancelled.
pub fn fit_except(
    inputs: &FitInputs,
    data: &FitData,
    mut cached: BTreeMap<FitKey, Fitted>,
    replicates: &Replicates,
    on_event: OnEvent,
    cancel: &CancelToken,
) -> Result<Fitted, Cancelled> {
    let campaigns: Vec<&[FitInput]> =
        inputs.own.chunk_by(|a, b| a.campaign.name == b.campaign.name).collect();
    let sampled: Vec<(&[FitInput], Resampler)> = campaigns
        .into_iter()
        .map(|inputs| {
            let measurements = inputs[0].measurements(data);
            (inputs, Resampler::new(inputs[0].fit.seed, measurements, &data.cycles))
        })
        .collect();
    let new: Vec<(&FitInput, &Resampler)> = sampled
        .iter()
        .flat_map(|(inputs, resampler)| inputs.iter().map(move |input| (input, resampler)))
        .filter(|(input, _)| !cached.contains_key(&input.key()))
        .collect();
    let fitted: Vec<(FitKey, Fitted)> = new
        .par_iter()
        .with_max_len(1)
        .map(|(input, resampler)| {
            let job = Job::new(input, data, resampler, replicates).cancelled_by(cancel);
            let fitted = job.run(on_event)?;
            fitted.fits.iter().for_each(|fit| on_event(FitEvent::Fitted(fit)));
            Ok((input.key(), fitted))
        })
        .collect::<Result<_, Cancelled>>()?;
    cached.extend(fitted);
    let shared = fit_shared(inputs, data, &cached, on_event, cancel)?;
    let mut all = Fitted { shared, ..Fitted::default() };
    for (inputs, resampler) in sampled {
        let models = inputs.iter().filter_map(|input| cached.remove(&input.key()));
        let mut models: Vec<Fitted> = models.collect();
        let replicates = inputs[0].fit.bootstrap;
        let without_metrics = inputs[0].trials_without_metrics(data);
        compare::complete(&mut models, without_metrics, &resampler, replicates, |model| {
            inputs.iter().find(|input| input.model.name == model)?.contradiction(data)
        });
        models.into_iter().for_each(|fitted| all.extend(fitted));
        all.precision.extend(precision::rows(
            &inputs[0].campaign.name,
            &inputs[0].setup().1,
            &resampler.measurements,
        ));
    }
    for fit in &mut all.fits {
        let shared = all
            .shared
            .iter()
            .filter(|row| row.fit.model == fit.model && row.campaigns.contains(&fit.campaign));
        let verdicts: Vec<Sharing> = shared.filter_map(|row| row.fit.sharing).collect();
        let refused = verdicts.iter().find(|verdict| **verdict == Sharing::Refused);
        fit.sharing = refused.or(verdicts.first()).copied();
    }
    Ok(all)
}

/// Returns the rows of the models that are fitted to several campaigns together: from `known` if it has the row, or
/// else from a new fit that uses the separate fits in `known`.
fn fit_shared(
    inputs: &FitInputs,
    data: &FitData,
    known: &BTreeMap<FitKey, Fitted>,
    on_event: OnEvent,
    cancel: &CancelToken,
) -> Result<Vec<SharedFitRow>, Cancelled> {
    let rows = inputs.shared.par_iter().with_max_len(1).map(|shared| {
        if let Some(Fitted { shared, .. }) = known.get(&shared.key()) {
            return Ok(shared.clone());
        }
        let row = shared.fit(data, known, cancel)?;
        on_event(FitEvent::Shared(&row));
        Ok(vec![row])
    });
    Ok(rows.collect::<Result<Vec<_>, Cancelled>>()?.concat())
}
