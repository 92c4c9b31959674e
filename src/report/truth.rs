//! Planted truth against what was recovered, where a `truth.json` lies in the trial folder.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::numbers::{as_configured, fixed, percent};
use super::parameters::FittedParameter;
use super::tables::Tables;
use crate::metrics::GaitMetrics;
use crate::motion::Model;
use crate::robot::{Parameter, Robot};
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
pub struct Comparison {
    pub seed: Option<u64>,
    pub summary: Vec<String>,
    pub coefficients: Vec<CoefficientRow>,
    pub trials: Vec<TrialComparison>,
}

#[derive(Debug, Serialize)]
pub struct CoefficientRow {
    pub campaign: String,
    pub parameter: &'static str,
    pub planted: String,
    pub found: String,
    pub difference: String,
    /// See [`FittedParameter::marks`].
    pub marks: Vec<&'static str>,
}

#[derive(Debug, Serialize)]
pub struct TrialComparison {
    pub trial: String,
    pub d_planted_mm: String,
    pub d_measured_mm: String,
    pub d_difference: String,
    pub v_planted_mm_s: String,
    pub v_measured_mm_s: String,
    pub v_difference: String,
}

/// Compares truth and tables.
pub fn compare(truth: &Truth, tables: &Tables) -> Comparison {
    let mut d = Worst::default();
    let mut v = Worst::default();
    let trials = tables.trials.iter().filter_map(|row| {
        let planted = truth.trials.get(&row.trial)?;
        let planted_d = planted.d_m.unwrap_or(f64::NAN);
        let planted_v = planted.v_m_s.unwrap_or(f64::NAN);
        let GaitMetrics { d_m, v_m_s, .. } = row.metrics;
        d.see(&row.trial, d_m, planted_d);
        v.see(&row.trial, v_m_s, planted_v);
        Some(TrialComparison {
            trial: row.trial.clone(),
            d_planted_mm: fixed(1e3 * planted_d, 2),
            d_measured_mm: fixed(1e3 * d_m, 2),
            d_difference: percent(d_m, planted_d),
            v_planted_mm_s: fixed(1e3 * planted_v, 2),
            v_measured_mm_s: fixed(1e3 * v_m_s, 2),
            v_difference: percent(v_m_s, planted_v),
        })
    });
    let trials = trials.collect();
    let summary = [d.sentence("d"), v.sentence("v")].into_iter().flatten().collect();
    let coefficients = planted(truth, tables).into_iter().map(coefficient_row).collect();
    Comparison { seed: truth.seed, summary, coefficients, trials }
}

/// A coefficient of the fitted model that the trials were made with, and what was planted.
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

fn coefficient_row(known: Known<'_>) -> CoefficientRow {
    let Known { campaign, parameter, planted } = known;
    CoefficientRow {
        campaign: campaign.to_owned(),
        parameter: parameter.parameter.column(),
        planted: as_configured(planted),
        found: parameter.text(),
        difference: percent(parameter.value, planted),
        marks: parameter.marks(),
    }
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
