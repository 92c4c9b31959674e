//! Planted truth against what was recovered, where a `truth.json` lies in a trial folder.

use std::collections::BTreeMap;

use minijinja::context;
use minijinja::value::{Serde, Value};
use serde::{Deserialize, Serialize};

use super::numbers::fixed;
use super::parameters::FittedParameter;
use super::tables::Tables;
use crate::config::Paths;
use crate::metrics::GaitMetrics;
use crate::motion::Model;
use crate::robot::{Parameter, Robot};
use crate::store::{Reader, StoreError, TrialRow};
use crate::trial::TRUTH_FILE;

/// The model that the trials were made with.
const PLANTED_MODEL: Model = Model::SKID_ROLL;

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
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
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
            skid_dry_n: [f64::NAN; 3],
            skid_static_n: [f64::NAN; 3],
            stribeck_m_s: f64::NAN,
            roll_dry_n: [f64::NAN; 3],
            transition_m_s: f64::NAN,
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
    /// Reads what was planted in the trials of all folders; `None` if nothing is known. What is
    /// wrong with a file, and what folders disagree on, is added to what is `missing`: the report
    /// goes on without it.
    ///
    /// # Errors
    /// A file is there and cannot be read.
    pub fn read(
        paths: &Paths,
        rows: &[TrialRow],
        reader: &Reader,
        missing: &mut Vec<String>,
    ) -> Result<Option<Self>, StoreError> {
        let mut truths = BTreeMap::new();
        for folder in &paths.raw {
            let bytes = match reader.bytes(&folder.join(TRUTH_FILE)) {
                Err(error) if error.is_not_there() => continue,
                bytes => bytes?,
            };
            let (name, several) = (paths.name_of(folder), paths.raw.len() > 1);
            match serde_json::from_slice::<Self>(&bytes) {
                Ok(truth) => drop(truths.insert(name, truth)),
                Err(problem) => {
                    let of = if several { format!(" of {name}") } else { String::new() };
                    missing.push(format!("{TRUTH_FILE}{of} is passed over: {problem}."));
                }
            }
        }
        let mut all: Option<Self> = None;
        for (folder, mut truth) in truths {
            let mut planted = std::mem::take(&mut truth.trials);
            // Tables that were made elsewhere may not say where their trials are.
            let is_here = |row: &&TrialRow| row.folder.is_empty() || row.folder == folder;
            let here = rows.iter().filter(is_here).filter_map(|row| {
                let id = if row.id.is_empty() { &row.trial } else { &row.id };
                Some((row.trial.clone(), planted.remove(id)?))
            });
            truth.trials = here.collect();
            match &mut all {
                None => all = Some(truth),
                Some(all) => all.extend(truth, &folder, missing),
            }
        }
        Ok(all)
    }

    /// Adds what was planted in another folder.
    fn extend(&mut self, other: Self, folder: &str, missing: &mut Vec<String>) {
        self.synthetic |= other.synthetic;
        self.seed = self.seed.filter(|seed| other.seed == Some(*seed));
        self.trials.extend(other.trials);
        for (campaign, planted) in other.campaigns {
            let known = self.campaigns.entry(campaign.clone());
            let known = known.or_insert(planted);
            if *known != planted {
                // Nothing is known of a campaign in which not all is alike.
                *known = PlantedCampaign::default();
                missing.push(format!(
                    "{TRUTH_FILE} of {folder} plants other coefficients of {campaign} than \
                     another folder's: they are not compared."
                ));
            }
        }
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
            let is_told = !parameter.is_sum() || fit.free.contains(&parameter);
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
