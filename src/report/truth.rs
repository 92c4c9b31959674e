//! Planted truth against what was recovered, where a `truth.json` lies in the trial folder.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::numbers::fixed;
use super::parameters::FittedParameter;
use super::tables::Tables;
use crate::motion::Model;
use crate::robot::{Parameter, Robot};
use crate::store::TrialRow;
use crate::trial::TRUTH_FILE;

/// The model that the trials were made with.
const PLANTED_MODEL: Model = Model::SkidRoll;

/// What the trials were made from. Unknown entries are passed over, missing ones are unknown.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct Truth {
    /// The trials were computed, not recorded.
    pub synthetic: bool,
    pub seed: Option<u64>,
    pub campaigns: BTreeMap<String, PlantedCampaign>,
    pub trials: BTreeMap<String, PlantedTrial>,
}

/// Parameters of a campaign's robot.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct PlantedCampaign {
    pub skid_kg_s: Option<[f64; 3]>,
    pub roll_kg_s: Option<[f64; 3]>,
    pub stiffness_nm_rad: Option<f64>,
    pub damping_nm_s_rad: Option<f64>,
}

impl PlantedCampaign {
    fn of(&self, parameter: Parameter) -> Option<f64> {
        // What is not known is missing, and so is what follows from it.
        let robot = Robot {
            skid_kg_s: self.skid_kg_s.unwrap_or([f64::NAN; 3]),
            roll_kg_s: self.roll_kg_s.unwrap_or([f64::NAN; 3]),
            stiffness_nm_rad: self.stiffness_nm_rad.unwrap_or(f64::NAN),
            damping_nm_s_rad: self.damping_nm_s_rad.unwrap_or(f64::NAN),
            ..Robot::kinematic()
        };
        Some(parameter.of(&robot)).filter(|value| !value.is_nan())
    }
}

/// Motion of a trial.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct PlantedTrial {
    pub d_m: Option<f64>,
    pub v_m_s: Option<f64>,
    pub sigma: Option<[f64; 3]>,
    pub alpha1_rad: Option<f64>,
}

impl Truth {
    /// Reads the truth of a trial folder; `None` if there is none.
    ///
    /// # Errors
    /// A sentence on what is wrong with the file; the report goes on without it.
    pub fn read(folder: &Path) -> Result<Option<Self>, String> {
        let path = folder.join(TRUTH_FILE);
        let error = |problem: String| format!("{TRUTH_FILE} is passed over: {problem}.");
        match std::fs::read(&path) {
            Ok(bytes) => serde_json::from_slice(&bytes)
                .map(Some)
                .map_err(|problem| error(problem.to_string())),
            Err(problem) if problem.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(problem) => Err(error(problem.to_string())),
        }
    }
}

/// The section of the page.
#[derive(Debug, Serialize)]
pub struct Comparison<'t> {
    pub seed: Option<u64>,
    pub summary: Vec<String>,
    pub coefficients: Vec<Known<'t>>,
    pub trials: Vec<TrialComparison<'t>>,
}

/// A trial and what was planted, NaN where that is unknown.
#[derive(Debug, Serialize)]
pub struct TrialComparison<'t> {
    trial: &'t TrialRow,
    d_m: f64,
    v_m_s: f64,
}

/// Compares truth and tables.
pub fn compare<'t>(truth: &Truth, tables: &'t Tables) -> Comparison<'t> {
    let mut d = Worst::default();
    let mut v = Worst::default();
    let trials = tables.trials.iter().filter_map(|trial| {
        let planted = truth.trials.get(&trial.trial)?;
        let [d_m, v_m_s] = [planted.d_m, planted.v_m_s].map(|known| known.unwrap_or(f64::NAN));
        d.see(&trial.trial, trial.metrics.d_m, d_m);
        v.see(&trial.trial, trial.metrics.v_m_s, v_m_s);
        Some(TrialComparison { trial, d_m, v_m_s })
    });
    let trials = trials.collect();
    let summary = [d.sentence("d"), v.sentence("v")].into_iter().flatten().collect();
    Comparison { seed: truth.seed, summary, coefficients: planted(truth, tables), trials }
}

/// A coefficient of the fitted model that the trials were made with, and what was planted.
#[derive(Debug, Serialize)]
pub struct Known<'t> {
    pub campaign: &'t str,
    pub parameter: FittedParameter,
    pub planted: f64,
}

/// All coefficients of which the truth is known, by campaign.
pub fn planted<'t>(truth: &Truth, tables: &'t Tables) -> Vec<Known<'t>> {
    let mut known = Vec::new();
    for fit in tables.fits.iter().filter(|fit| fit.model == PLANTED_MODEL) {
        let Some(planted) = truth.campaigns.get(&fit.campaign) else { continue };
        known.extend(Parameter::ALL.into_iter().filter_map(|parameter| {
            let is_told = parameter != Parameter::RollSum || fit.free.contains(&parameter);
            let planted = planted.of(parameter).filter(|_| is_told)?;
            let parameter = FittedParameter::of(fit, parameter);
            Some(Known { campaign: &fit.campaign, parameter, planted })
        }));
    }
    known
}

/// The largest relative difference seen.
#[derive(Default)]
struct Worst {
    difference: f64,
    trial: Option<String>,
    count: usize,
}

impl Worst {
    fn see(&mut self, trial: &str, found: f64, planted: f64) {
        let difference = (found / planted - 1.0).abs();
        if difference.is_finite() {
            self.count += 1;
            if self.trial.is_none() || difference > self.difference {
                self.difference = difference;
                self.trial = Some(trial.to_owned());
            }
        }
    }

    fn sentence(self, symbol: &str) -> Option<String> {
        let trial = self.trial?;
        let percent = fixed(100.0 * self.difference, 2);
        Some(format!(
            "{symbol} of {} trials: within {percent} % of the planted value, farthest in {trial}.",
            self.count
        ))
    }
}
