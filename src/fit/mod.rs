//! Fits every model of every campaign to the trials (section IV.D): the best coefficients, what
//! they are worth, and which model the measurements prefer.
//!
//! Confidence intervals are those of the bootstrap: of the spread of cycles and of repeated
//! trials. An error that all trials share, such as a servo that does not follow its command
//! or a wrong mass, is not in them.
//!
//! Models are compared by their objective, by leave-one-frequency-out cross-validation, by how
//! often they are nearest to resampled measurements (selection frequency of the bootstrap), and by
//! the Bayesian information criterion.

mod compare;
mod fitted_point;
mod folder;
mod free;
mod hessian;
mod input;
mod job;
mod least_absolute;
mod measured;
mod measurement;
mod noise_correction;
mod objective;
mod predict;
mod profile;
mod resample;
mod search;
mod starts;

use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::config::{Config, ParameterSource};
use crate::robot::Model;
use crate::store::{
    BootstrapRow, ComparisonRow, CycleRow, FitRow, PredictionRow, ProfileRow, RobotParameterRow,
    StartRow, TrialRow,
};
use job::{Job, JobResult};
use resample::Resampler;

pub use folder::{TABLES, input_paths};
pub use free::FreeParameter;
pub use input::{FitCampaign, FitInput};
pub use measurement::Measurement;
pub use objective::{Evaluator, Objective};
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
    pub starts: Vec<StartRow>,
    pub profiles: Vec<ProfileRow>,
    pub bootstrap: Vec<BootstrapRow>,
    pub comparison: Vec<ComparisonRow>,
    pub predictions: Vec<PredictionRow>,
}

/// Something that has happened; on any thread.
#[derive(Debug, Clone, Copy)]
pub enum FitEvent<'f> {
    /// Another replicate is fitted: `done` of `total` are.
    Replicate { campaign: &'f str, model: Model, done: usize, total: usize },
    /// A model is done.
    Fitted(&'f FitRow),
}

/// Is notified of it.
pub type OnEvent<'f> = &'f (dyn Fn(FitEvent) + Sync);

/// Fits all campaigns; models, starts, profiles and replicates in parallel, results in order.
/// They depend neither on the number of threads nor on the order of the trials.
///
/// ```
/// use trilink::config::{Config, SigmaKind};
/// use trilink::fit::{FitData, fit};
/// use trilink::motion::{FIT_ACCURACY, Problem, Solver};
/// use trilink::robot::{Model, Parameter};
/// use trilink::store::{Columns, TrialRow};
///
/// let campaign = "kinematic-symmetric";
/// let mut config = Config::default();
/// config.campaign.retain(|name, _| name == campaign);
/// config.campaign.get_mut(campaign).unwrap().models = vec![Model::SkidRoll];
/// (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (1, 0, false);
/// config.fit.sigma = SigmaKind::Raw;
///
/// let (mut robot, gait) = config.campaign_setup(campaign).unwrap();
/// robot.skid_kg_s = [104.0, 34.0, 45.0];
/// let trial = |omega_rad_s: f64| {
///     let problem = Problem { robot: robot.clone(), gait, model: Model::SkidRoll, omega_rad_s };
///     let metrics = Solver::default().solve(&problem, FIT_ACCURACY).unwrap();
///     let (trial, campaign) = (format!("at {omega_rad_s} rad/s"), campaign.to_owned());
///     TrialRow { trial, campaign, omega_rad_s, metrics, ..TrialRow::blank() }
/// };
/// let trials: Vec<TrialRow> = [1.0, 2.0, 3.0, 4.0].map(trial).into();
/// let fitted = fit(&config, &FitData::from(trials), &|_| {});
/// let skid0_kg_s = fitted.fits[0].parameters[Parameter::Skid0];
/// assert!((skid0_kg_s / 104.0 - 1.0).abs() < 1e-4);
/// ```
pub fn fit(config: &Config, data: &FitData, on_event: OnEvent) -> Fitted {
    fit_except(&FitInput::all(config), data, Kept::new(), on_event)
}

/// What there is of fits that stay as they are, by campaign and model.
pub type Kept = BTreeMap<(String, Model), Fitted>;

/// [`fit`] of those models only that are not kept. The tables are those that a fit of all would
/// have given.
pub fn fit_except(
    inputs: &[FitInput],
    data: &FitData,
    mut kept: Kept,
    on_event: OnEvent,
) -> Fitted {
    let campaigns: Vec<&[FitInput]> =
        inputs.chunk_by(|a, b| a.campaign.name == b.campaign.name).collect();
    let key = |input: &FitInput| (input.campaign.name.clone(), input.model);
    let sampled: Vec<(&[FitInput], Vec<Measurement>, Resampler)> = campaigns
        .iter()
        .filter(|inputs| inputs.iter().any(|input| !kept.contains_key(&key(input))))
        .map(|inputs| {
            let measurements = measurements(&inputs[0], data);
            let FitInput { campaign, fit, .. } = &inputs[0];
            let resampler = Resampler::new(&campaign.name, fit.seed, &measurements, &data.cycles);
            (*inputs, measurements, resampler)
        })
        .collect();
    let jobs: Vec<Job> = sampled
        .iter()
        .flat_map(|(inputs, measurements, resampler)| {
            let new = inputs.iter().filter(|input| !kept.contains_key(&key(input)));
            new.map(move |input| {
                let mut robot = input.robot.value.to_robot();
                let measured = match input.fit.robot_parameters {
                    ParameterSource::Configured => Vec::new(),
                    ParameterSource::Measured => {
                        measured::with_measured(&mut robot, &input.robot.name, &data.robots)
                    }
                };
                let gait = input.gait.value.to_gait();
                Job { input, robot, gait, measured, resampler, measurements }
            })
        })
        .collect();
    let mut fitted: BTreeMap<(String, Model), JobResult> = jobs
        .par_iter()
        .with_max_len(1)
        .map(|job| {
            let done = job.run(on_event);
            done.tables.fits.iter().for_each(|fit| on_event(FitEvent::Fitted(fit)));
            (key(job.input), done)
        })
        .collect();
    let mut all = Fitted::default();
    for inputs in campaigns {
        let models = inputs.iter().filter_map(|input| {
            kept.remove(&key(input)).map(JobResult::from).or_else(|| fitted.remove(&key(input)))
        });
        let mut models: Vec<JobResult> = models.collect();
        compare_models(&mut models, inputs[0].fit.bootstrap);
        models.into_iter().for_each(|done| all.extend(done.tables));
    }
    all
}

/// What the trials of a campaign measured, in order.
fn measurements(input: &FitInput, data: &FitData) -> Vec<Measurement> {
    let of_campaign = data.trials.iter().filter(|trial| trial.campaign == input.campaign.name);
    let mut measurements: Vec<Measurement> =
        of_campaign.filter_map(|trial| Measurement::new(trial, input.fit.sigma)).collect();
    measurements.sort_by(Measurement::order);
    measurements
}

/// Completes the rows of a campaign's comparison by what needs all of them.
fn compare_models(models: &mut [JobResult], replicates: usize) {
    let costs: Vec<&[f64]> = models.iter().map(|done| done.replicates.as_slice()).collect();
    let frequencies = compare::selection_frequencies(&costs);
    for (model, frequency) in models.iter_mut().zip(frequencies) {
        model.tables.comparison.iter_mut().for_each(|row| row.wins = frequency);
    }
    let rows: Vec<ComparisonRow> =
        models.iter().flat_map(|done| done.tables.comparison.iter().cloned()).collect();
    let sentence = compare::sentence(&rows, replicates);
    for row in models.iter_mut().flat_map(|done| &mut done.tables.comparison) {
        row.sentence.clone_from(&sentence);
    }
}
