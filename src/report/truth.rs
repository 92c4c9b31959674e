//! Planted truth against what was recovered, where a `truth.json` lies in the trial folder.

use std::collections::BTreeMap;
use std::path::Path;

use minijinja::context;
use minijinja::value::{Serde, Value};
use serde::{Deserialize, Serialize};

use super::numbers::fixed;
use super::parameters::FittedParameter;
use super::tables::Tables;
use crate::metrics::GaitMetrics;
use crate::motion::Model;
use crate::robot::{Parameter, Robot};
use crate::store::{Reader, StoreError, TrialRow};
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

impl PlantedTrial {
    /// What is not known is missing.
    pub fn metrics(&self) -> GaitMetrics {
        let known = |value: Option<f64>| value.unwrap_or(f64::NAN);
        GaitMetrics {
            d_m: known(self.d_m),
            v_m_s: known(self.v_m_s),
            sigma: self.sigma.unwrap_or([f64::NAN; 3]),
            alpha1_rad: known(self.alpha1_rad),
            dtheta_rad: f64::NAN,
        }
    }
}

impl Truth {
    /// Reads the truth of a trial folder; `None` if there is none.
    ///
    /// # Errors
    /// The file cannot be read, or a sentence on what is wrong with its content: the report goes
    /// on without it.
    pub fn read(
        folder: &Path,
        reader: &Reader,
    ) -> Result<Result<Option<Self>, String>, StoreError> {
        let bytes = match reader.bytes(&folder.join(TRUTH_FILE)) {
            Err(error) if error.is_not_there() => return Ok(Ok(None)),
            bytes => bytes?,
        };
        let truth = serde_json::from_slice(&bytes).map(Some);
        Ok(truth.map_err(|problem| format!("{TRUTH_FILE} is passed over: {problem}.")))
    }
}

/// What the page shows of truth and tables.
pub fn compare(truth: &Truth, tables: &Tables) -> Value {
    let trials = tables.trials.iter();
    let trials: Vec<(&TrialRow, GaitMetrics)> = trials
        .filter_map(|trial| Some((trial, truth.trials.get(&trial.trial)?.metrics())))
        .collect();
    let summary = [
        sentence("d", &trials, |metrics| metrics.d_m),
        sentence("v", &trials, |metrics| metrics.v_m_s),
    ];
    context! {
        seed => truth.seed,
        summary => Serde(summary.iter().flatten().collect::<Vec<_>>()),
        coefficients => Serde(planted(truth, tables)),
        trials => Serde(trials),
    }
}

/// A coefficient of the fitted model that the trials were made with, and what was planted.
#[derive(Debug, Serialize)]
pub struct Known<'t> {
    pub campaign: &'t str,
    pub parameter: FittedParameter,
    pub planted: f64,
    /// Half the width of the interval that scatter alone gives; NaN where it is not known.
    #[serde(skip)]
    pub scatter: f64,
}

/// All coefficients of which the truth is known, by campaign.
pub fn planted<'t>(truth: &Truth, tables: &'t Tables) -> Vec<Known<'t>> {
    let mut known = Vec::new();
    for fit in tables.fits.iter().filter(|fit| fit.model == PLANTED_MODEL) {
        let Some(planted) = truth.campaigns.get(&fit.campaign) else { continue };
        known.extend(Parameter::ALL.into_iter().filter_map(|parameter| {
            let is_told = parameter != Parameter::RollSum || fit.free.contains(&parameter);
            let planted = planted.of(parameter).filter(|_| is_told)?;
            let scatter = fit.scatter[parameter];
            let parameter = FittedParameter::of(fit, parameter);
            Some(Known { campaign: &fit.campaign, parameter, planted, scatter })
        }));
    }
    known
}

/// How far a measure of the trials is from what was planted at most.
fn sentence(
    symbol: &str,
    trials: &[(&TrialRow, GaitMetrics)],
    of: fn(&GaitMetrics) -> f64,
) -> Option<String> {
    let known: Vec<_> = trials
        .iter()
        .map(|(trial, planted)| (&trial.trial, (of(&trial.metrics) / of(planted) - 1.0).abs()))
        .filter(|(_, difference)| difference.is_finite())
        .collect();
    // The first of several, which in reverse is the last.
    let (trial, most) = known.iter().rev().max_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(format!(
        "{symbol} of {} trials: within {} % of the planted value, farthest in {trial}.",
        known.len(),
        fixed(100.0 * most, 2)
    ))
}
