//! Fits every model of every campaign to the trials (section IV.D).

mod absolute;
mod objective;
mod predict;
mod search;

use std::path::Path;

use rayon::prelude::*;

use crate::config::{Campaign, Config};
use crate::motion::Model;
use crate::robot::{Gait, Robot};
use crate::store::{
    FitRow, PredictionRow, Provenance, Rows, StartRow, StoreError, Table, TrialRow,
};

pub use objective::{Coefficient, Evaluator, Measurement, Objective, Parameter};
pub use search::{Start, search};

/// The tables of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    pub fits: Vec<FitRow>,
    pub starts: Vec<StartRow>,
    pub predictions: Vec<PredictionRow>,
}

/// Fits all campaigns to `derived/trials.parquet` and writes `fits.parquet`, `starts.parquet`
/// and `predictions.parquet` beside it. `on_fit` hears of every finished model.
///
/// # Errors
/// The trials cannot be read or the tables not written. A model that cannot be fitted is a
/// row with a status.
pub fn fit_folder(
    config: &Config,
    derived: &Path,
    on_fit: &(dyn Fn(&FitRow) + Sync),
) -> Result<Fitted, StoreError> {
    let path = derived.join("trials.parquet");
    let trials = TrialRow::from_table(&Table::read(&path)?)?;
    let fitted = fit(config, &trials, on_fit);
    let provenance = provenance(config, &path)?;
    FitRow::to_table(&fitted.fits).write(&derived.join("fits.parquet"), &provenance)?;
    StartRow::to_table(&fitted.starts).write(&derived.join("starts.parquet"), &provenance)?;
    PredictionRow::to_table(&fitted.predictions)
        .write(&derived.join("predictions.parquet"), &provenance)?;
    Ok(fitted)
}

/// The trials' table and the keys that a fit reads.
fn provenance(config: &Config, trials: &Path) -> Result<Provenance, StoreError> {
    let bytes = std::fs::read(trials)
        .map_err(|source| StoreError::Read { path: trials.to_owned(), source })?;
    let keys = serde_json::to_vec(&(&config.fit, &config.robot, &config.gait, &config.campaign))
        .expect("a configuration is plain data");
    let mut hash = blake3::Hasher::new();
    hash.update(&bytes).update(&keys);
    Ok(Provenance { input: hash.finalize().to_hex().to_string() })
}

/// Fits all campaigns; models, starts and frequencies in parallel, results in order.
pub fn fit(config: &Config, trials: &[TrialRow], on_fit: &(dyn Fn(&FitRow) + Sync)) -> Fitted {
    let jobs: Vec<Job> = config
        .campaign
        .iter()
        .filter_map(|(name, campaign)| Some((name, campaign, config.campaign_setup(name)?)))
        .flat_map(|(name, campaign, (robot, gait))| {
            let measurements: Vec<Measurement> = trials
                .iter()
                .filter(|trial| trial.campaign == *name)
                .filter_map(|trial| Measurement::new(trial, config.fit.sigma))
                .collect();
            campaign.models.iter().map(move |&model| Job {
                name: name.clone(),
                campaign: campaign.clone(),
                model,
                robot: robot.clone(),
                gait,
                measurements: measurements.clone(),
            })
        })
        .collect();
    let results: Vec<Fitted> = jobs
        .par_iter()
        .map(|job| {
            let fitted = job.run(config);
            fitted.fits.iter().for_each(on_fit);
            fitted
        })
        .collect();
    let mut all = Fitted { fits: Vec::new(), starts: Vec::new(), predictions: Vec::new() };
    for fitted in results {
        all.fits.extend(fitted.fits);
        all.starts.extend(fitted.starts);
        all.predictions.extend(fitted.predictions);
    }
    all
}

/// One model of one campaign.
struct Job {
    name: String,
    campaign: Campaign,
    model: Model,
    robot: Robot,
    gait: Gait,
    measurements: Vec<Measurement>,
}

impl Job {
    fn run(&self, config: &Config) -> Fitted {
        if self.measurements.is_empty() {
            return self.without_trials();
        }
        let objective = Objective::new(
            self.model,
            self.robot.clone(),
            self.gait,
            self.campaign.weights,
            config.fit.gait_input,
            self.measurements.clone(),
        );
        let parameters = Parameter::free_in(self.model, &self.gait, &config.fit);
        let starts: Vec<Start> = (0..if parameters.is_empty() { 1 } else { config.fit.starts })
            .into_par_iter()
            .map(|number| search(&objective, &parameters, number))
            .collect();
        let best = starts
            .iter()
            .min_by(|a, b| a.cost.total_cmp(&b.cost))
            .expect("there is at least one start");
        let robot = objective.robot_with(&parameters, &best.ended);
        let mut evaluation = objective.evaluator(parameters.clone());
        let status = evaluation.status(&best.ended);
        let marks = search::marks(&mut evaluation, &best.ended);
        let names = |of: &[Coefficient]| of.iter().map(|free| free.name().to_owned()).collect();
        let free: Vec<Coefficient> = parameters.iter().map(|free| free.coefficient).collect();
        let fit = FitRow {
            free: names(&free),
            insensitive: names(&marks.insensitive),
            at_bound: names(&marks.at_bound),
            j: if status == "ok" { best.cost } else { f64::NAN },
            starts: starts.len() as i64,
            solves: (starts.iter().map(|start| start.solves).sum::<usize>() + evaluation.solves())
                as i64,
            status,
            ..self.with_parameters_of(&robot)
        };
        Fitted {
            predictions: predict::predictions(&self.name, &objective, &robot),
            starts: starts
                .iter()
                .enumerate()
                .map(|(number, start)| self.start_row(number, &parameters, start))
                .collect(),
            fits: vec![fit],
        }
    }

    fn without_trials(&self) -> Fitted {
        let status = "failed: no trial with metrics".to_owned();
        let fit = FitRow { status, ..self.with_parameters_of(&self.robot) };
        Fitted { fits: vec![fit], starts: Vec::new(), predictions: Vec::new() }
    }

    /// A row with the parameters that the model knows; the others are missing.
    fn with_parameters_of(&self, robot: &Robot) -> FitRow {
        let known = |is_known: bool, value: f64| if is_known { value } else { f64::NAN };
        let is_passive = self.gait.passive_joint().is_some();
        let [skid0, skid1, skid2] = robot.skid_kg_s.map(|c| known(self.model.skids(), c));
        let has_roll = self.model.has_roll_resistance();
        let [roll0, roll1, roll2] = robot.roll_kg_s.map(|c| known(has_roll, c));
        FitRow {
            campaign: self.name.clone(),
            model: self.model.name().to_owned(),
            skid0_kg_s: skid0,
            skid1_kg_s: skid1,
            skid2_kg_s: skid2,
            roll0_kg_s: roll0,
            roll1_kg_s: roll1,
            roll2_kg_s: roll2,
            stiffness_nm_rad: known(is_passive, robot.stiffness_nm_rad),
            damping_nm_s_rad: known(is_passive, robot.damping_nm_s_rad),
            ..FitRow::blank()
        }
    }

    fn start_row(&self, number: usize, parameters: &[Parameter], start: &Start) -> StartRow {
        let value = |coefficient: Coefficient, values: &[f64]| {
            let place = parameters.iter().position(|free| free.coefficient == coefficient);
            place.map_or(f64::NAN, |place| values[place])
        };
        let began = |coefficient| value(coefficient, &start.began);
        let ended = |coefficient| value(coefficient, &start.ended);
        StartRow {
            campaign: self.name.clone(),
            model: self.model.name().to_owned(),
            start: number as i64,
            began_skid0_kg_s: began(Coefficient::Skid(0)),
            began_skid1_kg_s: began(Coefficient::Skid(1)),
            began_skid2_kg_s: began(Coefficient::Skid(2)),
            began_damping_nm_s_rad: began(Coefficient::Damping),
            ended_skid0_kg_s: ended(Coefficient::Skid(0)),
            ended_skid1_kg_s: ended(Coefficient::Skid(1)),
            ended_skid2_kg_s: ended(Coefficient::Skid(2)),
            ended_damping_nm_s_rad: ended(Coefficient::Damping),
            j: start.cost,
            solves: start.solves as i64,
            stopped: start.stopped.clone(),
        }
    }
}
