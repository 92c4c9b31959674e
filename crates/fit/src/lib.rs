//! Fits every model of every campaign to the trials (section IV.D): the best coefficients, what
//! they are worth, and which model the measurements prefer.
//!
//! Confidence intervals are those of the bootstrap: of the spread of cycles and of repeated
//! trials. An error that all trials share, such as a servo that does not follow its command
//! or a wrong mass, is not in them.
//!
//! Of the models that fit, the one with the lowest Bayesian information criterion is preferred. Beside
//! that stand how often it is so in resampled measurements (selection frequency of the bootstrap),
//! what each model predicts of a frequency that is left out and of those above the fitted ones, and
//! which one more trial would tell it from the preferred one.
//!
//! - [`fit`] takes `input` and `measurement` through `job`, one model of one campaign.
//! - The misfit J (eq. 21 and 22): `conditions`, `terms`, `objective`; its minimum: `starts`, `search`,
//!   `least_absolute`, `hessian`.
//! - Uncertainty: `trial_noise`, `resample`, `resampler`, `noise_correction`, `profile`, `intervals`.
//! - Which model: `adequacy` (lack of fit), `criterion`, `compare`, `law_class`; `shared`, `sharing`
//!   (one set of coefficients for several campaigns).
//! - With a fitted model: `predict` and `bands`, [`simulate`], [`optimise`] (the best gait), [`design`]
//!   (the next trials).
//!
//! The motion of a configured model; [`fit`] has an example of a fit:
//!
//! ```
//! use trilink_fit::simulate::Setup;
//! use trilink_mechanics::REFERENCE_ACCURACY;
//! use trilink_tables::config::Config;
//!
//! let setup = Setup::new(Config::default(), "kinematic-symmetric", "skid-roll", &[])?;
//! let mut problem = setup.problem(3.9);
//! problem.robot.skid_kg_s = [104.0, 34.0, 45.0];
//! let motion = problem.solve(REFERENCE_ACCURACY)?;
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
mod noise_correction;
mod objective;
pub mod optimise;
mod predict;
mod profile;
mod resample;
mod resampler;
mod rows;
mod search;
mod shared;
mod sharing;
pub mod simulate;
mod starts;
mod tell_apart;
mod terms;
mod trial_noise;

use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_tables::config::{Config, GaitInput};
use trilink_tables::{
    BootstrapRow, ComparisonRow, CycleRow, FitRow, PredictionRow, ProfileRow, ResidualRow,
    RobotParameterRow, SharedFitRow, StartRow, TrialRow,
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
pub use shared::SharedInput;
pub use starts::{Start, search};

/// What is fitted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FitData {
    pub trials: Vec<TrialRow>,
    /// By trial; of those that have none the standard errors are resampled.
    pub cycles: BTreeMap<String, Vec<CycleRow>>,
    /// What trials of other kinds measured of the robots.
    pub robots: Vec<RobotParameterRow>,
}

impl From<Vec<TrialRow>> for FitData {
    fn from(trials: Vec<TrialRow>) -> Self {
        Self { trials, ..Self::default() }
    }
}

/// The tables of a fit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Fitted {
    pub fits: Vec<FitRow>,
    /// The same models driven by the other gait than the configured one, without profiles.
    pub alternatives: Vec<FitRow>,
    pub starts: Vec<StartRow>,
    pub profiles: Vec<ProfileRow>,
    pub bootstrap: Vec<BootstrapRow>,
    pub comparison: Vec<ComparisonRow>,
    pub predictions: Vec<PredictionRow>,
    pub residuals: Vec<ResidualRow>,
    /// Of what is fitted to all campaigns of a robot together.
    pub shared: Vec<SharedFitRow>,
}

/// Which replicates there are, of those that the settings ask for.
#[derive(Debug, Clone)]
pub struct Replicates {
    /// Numbers of those that are fitted.
    pub numbers: Range<usize>,
    /// Those that come before and were fitted elsewhere, by what drives their models.
    pub given: BTreeMap<GaitInput, Vec<BootstrapRow>>,
}

impl Default for Replicates {
    /// All of them are fitted.
    fn default() -> Self {
        Self { numbers: 0..usize::MAX, given: BTreeMap::new() }
    }
}

/// Something that has happened; on any thread.
#[derive(Debug, Clone, Copy)]
pub enum FitEvent<'f> {
    /// Another replicate of a model that is driven so is fitted: `done` of `total` are.
    Replicate { driven_by: GaitInput, row: &'f BootstrapRow, done: usize, total: usize },
    /// A model is done.
    Fitted(&'f FitRow),
    /// One that all campaigns of a robot share.
    Shared(&'f SharedFitRow),
}

/// Is notified of it.
pub type OnEvent<'f> = &'f (dyn Fn(FitEvent) + Sync);

/// Fits all campaigns; models, starts, profiles and replicates in parallel, results in order.
/// They depend neither on the number of threads nor on the order of the trials.
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
///     let problem = Problem { robot: robot.clone(), gait, laws: Laws::SKID_ROLL, omega_rad_s };
///     let metrics = Solver::default().solve(&problem, FIT_ACCURACY).unwrap();
///     let (trial, campaign) = (format!("at {omega_rad_s} rad/s"), campaign.to_owned());
///     TrialRow { trial, campaign, omega_rad_s, metrics, ..TrialRow::blank() }
/// };
/// let trials: Vec<TrialRow> = [1.0, 2.0, 3.0, 4.0].map(trial).into();
/// let fitted = fit(&config, &FitData::from(trials), &|_| {});
/// let skid0_kg_s = fitted.fits[0].parameters[Quantity::Skid.of(0)];
/// assert!((skid0_kg_s / 104.0 - 1.0).abs() < 1e-4);
/// ```
pub fn fit(config: &Config, data: &FitData, on_event: OnEvent) -> Fitted {
    let (inputs, replicates) = (FitInputs::new(config), Replicates::default());
    let token = CancelToken::default();
    fit_except(&inputs, data, BTreeMap::new(), &replicates, on_event, &token)
        .expect("the token is not shared, so nothing cancels it")
}

/// All that is fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct FitInputs {
    /// Each model of each campaign, in the configuration's order.
    pub own: Vec<FitInput>,
    /// What the campaigns of a robot share.
    pub shared: Vec<SharedInput>,
}

impl FitInputs {
    pub fn new(config: &Config) -> Self {
        Self { own: FitInput::all(config), shared: SharedInput::all(config) }
    }
}

/// [`fit`] of those models only that are not `cached`, with these replicates; what is shared has all of
/// its own. The tables are those that a fit of all would have given.
///
/// # Errors
/// The work was cancelled.
pub fn fit_except(
    inputs: &FitInputs,
    data: &FitData,
    mut cached: BTreeMap<FitKey, Fitted>,
    replicates: &Replicates,
    on_event: OnEvent,
    cancel: &CancelToken,
) -> Result<Fitted, Cancelled> {
    let key = FitInput::key;
    let campaigns: Vec<&[FitInput]> =
        inputs.own.chunk_by(|a, b| a.campaign.name == b.campaign.name).collect();
    let is_new = |input: &&FitInput| !cached.contains_key(&key(input));
    let sampled: Vec<(&[FitInput], Resampler)> = campaigns
        .into_iter()
        .map(|inputs| {
            let measurements = inputs[0].measurements(data);
            (inputs, Resampler::new(inputs[0].fit.seed, measurements, &data.cycles))
        })
        .collect();
    let new: Vec<(&FitInput, &Resampler)> = sampled
        .iter()
        .flat_map(|(inputs, resampler)| {
            inputs.iter().filter(is_new).map(move |input| (input, resampler))
        })
        .collect();
    let fitted: Vec<(FitKey, Fitted)> = new
        .par_iter()
        .with_max_len(1)
        .map(|(input, resampler)| {
            let job = Job::new(input, data, resampler, replicates).cancelled_by(cancel);
            let fitted = job.run(on_event)?;
            fitted.fits.iter().for_each(|fit| on_event(FitEvent::Fitted(fit)));
            Ok((key(input), fitted))
        })
        .collect::<Result<_, Cancelled>>()?;
    cached.extend(fitted);
    let shared = fit_shared(inputs, data, &cached, on_event, cancel)?;
    let mut all = Fitted { shared, ..Fitted::default() };
    for (inputs, resampler) in sampled {
        let models = inputs.iter().filter_map(|input| cached.remove(&key(input)));
        let mut models: Vec<Fitted> = models.collect();
        let contradicts =
            |model| inputs.iter().find(|of| of.model.name == model)?.contradiction(data);
        let (replicates, without) =
            (inputs[0].fit.bootstrap, inputs[0].trials_without_metrics(data));
        compare::complete(&mut models, without, &resampler, replicates, contradicts);
        models.into_iter().for_each(|fitted| all.extend(fitted));
    }
    for fit in &mut all.fits {
        let is_of = |row: &&SharedFitRow| {
            row.fit.model == fit.model && row.campaigns.contains(&fit.campaign)
        };
        fit.sharing = all.shared.iter().find(is_of).and_then(|row| row.fit.sharing);
    }
    Ok(all)
}

/// What campaigns share, beside the `known` fits to each of them; as they are where they are known.
fn fit_shared(
    inputs: &FitInputs,
    data: &FitData,
    known: &BTreeMap<FitKey, Fitted>,
    on_event: OnEvent,
    cancel: &CancelToken,
) -> Result<Vec<SharedFitRow>, Cancelled> {
    let of_model = |shared: &SharedInput| {
        if let Some(Fitted { shared, .. }) = known.get(&shared.key()) {
            return Ok(shared.clone());
        }
        let row = shared.fit(data, known, cancel)?;
        on_event(FitEvent::Shared(&row));
        Ok(vec![row])
    };
    let rows = inputs.shared.par_iter().with_max_len(1).map(of_model);
    Ok(rows.collect::<Result<Vec<_>, Cancelled>>()?.concat())
}
