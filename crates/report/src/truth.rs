//! Planted truth against what was recovered, where a `truth.json` lies in a trial folder.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use minijinja::context;
use minijinja::value::{Serde, Value};
use serde::{Deserialize, Serialize};
use trilink_base::files;
use trilink_base::numbers::fixed;
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Model, Parameter, Robot};
use trilink_tables::config::Paths;
use trilink_tables::trial::{TRUTH_FILE, find_folders};
use trilink_tables::{Reader, StoreError, TrialRow};

use super::parameters::FittedParameter;
use super::tables::Tables;

/// What the trials were made from. Unknown entries are passed over, missing ones are unknown.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Truth {
    /// The trials were computed, not recorded.
    pub synthetic: bool,
    /// Folders of such trials.
    #[serde(skip)]
    pub synthetic_folders: BTreeSet<String>,
    pub seed: Option<u64>,
    /// Relative standard deviation of friction from cycle to cycle.
    pub friction_variation: f64,
    /// Friction of each day's floor as a part of the planted one.
    pub days: BTreeMap<String, f64>,
    pub servo: Option<PlantedServo>,
    /// Campaigns that know none of these.
    pub tidy: Vec<String>,
    pub campaigns: BTreeMap<String, PlantedCampaign>,
    pub trials: BTreeMap<String, PlantedTrial>,
}

/// How servos followed their commands.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(default)]
pub(crate) struct PlantedServo {
    pub lag_s: f64,
    pub compliance_rad_nm: f64,
}

/// The model that trials were made with.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(crate) struct PlantedLaw {
    pub model: Model,
}

/// Parameters of a campaign's robot.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub(crate) struct PlantedCampaign {
    /// `skid-roll` if it is not said.
    pub law: Option<PlantedLaw>,
    /// By the keys of quantities: a number, or one a wheel.
    #[serde(flatten)]
    pub planted: BTreeMap<String, serde_json::Value>,
}

impl PlantedCampaign {
    /// The model whose laws made the trials.
    fn model(&self) -> Model {
        self.law.map_or(Model::SKID_ROLL, |law| law.model)
    }

    fn of(&self, parameter: Parameter) -> Option<f64> {
        let planted = self.planted.get(parameter.quantity().name())?;
        let each = planted.as_array().map_or(std::slice::from_ref(planted), Vec::as_slice);
        let mut robot = Robot::kinematic();
        let numbers = parameter.quantity().numbers_mut(&mut robot);
        if each.len() != numbers.len() {
            return None;
        }
        for (number, planted) in numbers.iter_mut().zip(each) {
            *number = planted.as_f64()?;
        }
        Some(parameter.of(&robot))
    }
}

/// Motion of a trial.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct PlantedTrial {
    pub d_m: Option<f64>,
    pub v_m_s: Option<f64>,
    pub sigma: Option<[f64; 3]>,
    pub alpha1_rad: Option<f64>,
}

impl PlantedTrial {
    /// What is not known is missing.
    pub(crate) fn metrics(&self) -> GaitMetrics {
        let known = |value: Option<f64>| value.unwrap_or(f64::NAN);
        GaitMetrics {
            d_m: known(self.d_m),
            v_m_s: known(self.v_m_s),
            sigma: self.sigma.unwrap_or([f64::NAN; 3]),
            alpha1_rad: known(self.alpha1_rad),
            ..GaitMetrics::MISSING
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
    pub(crate) fn read(
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
            truth.synthetic_folders.extend(truth.synthetic.then(|| folder.clone()));
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
        self.synthetic_folders.extend(other.synthetic_folders);
        self.seed = self.seed.filter(|seed| other.seed == Some(*seed));
        self.friction_variation = self.friction_variation.max(other.friction_variation);
        self.servo = self.servo.or(other.servo);
        self.tidy.extend(other.tidy);
        let days = other.days.into_iter();
        self.days.extend(days.map(|(day, floor)| (format!("{folder}/{day}"), floor)));
        self.trials.extend(other.trials);
        for (campaign, planted) in other.campaigns {
            let known = self.campaigns.entry(campaign.clone());
            let known = known.or_insert_with(|| planted.clone());
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

/// What pages say where all trials were computed, and where some were.
const ALL: &str = "These trials are synthetic.";
const SOME: &str = "Some of these trials are synthetic";

impl Truth {
    /// Whether a trial was computed.
    pub(crate) fn is_synthetic(&self, trial: &TrialRow) -> bool {
        // Tables that were made elsewhere may not say where their trials are.
        self.synthetic
            && (trial.folder.is_empty() || self.synthetic_folders.contains(&trial.folder))
    }

    /// Whether any trial of these campaigns was computed; of all campaigns where none is named.
    pub(crate) fn is_synthetic_in(&self, campaigns: &[String], tables: &Tables) -> bool {
        let is_of = |trial: &&TrialRow| campaigns.is_empty() || campaigns.contains(&trial.campaign);
        tables.trials.iter().filter(is_of).any(|trial| self.is_synthetic(trial))
    }

    /// What the pages say of trials that were computed; empty where all were recorded.
    pub(crate) fn notice(&self, tables: &Tables) -> String {
        let synthetic = tables.trials.iter().filter(|trial| self.is_synthetic(trial)).count();
        if synthetic == 0 {
            return String::new();
        }
        match synthetic == tables.trials.len() {
            true => ALL.to_owned(),
            false => {
                let folders: Vec<&str> =
                    self.synthetic_folders.iter().map(String::as_str).collect();
                format!("{SOME}: those of {}.", folders.join(", "))
            }
        }
    }
}

/// What pages without the trials' table say of trials that were computed; empty where all were
/// recorded. What is wrong with a file is said by the report.
pub fn notice_of_folders(paths: &Paths) -> String {
    let folders = find_folders(paths).unwrap_or_default();
    let is_synthetic = |folder: &&PathBuf| {
        let truth = files::read(&folder.join(TRUTH_FILE), files::TEXT_BYTES).ok();
        truth
            .and_then(|(json, _)| serde_json::from_slice::<Truth>(&json).ok())
            .is_some_and(|truth| truth.synthetic)
    };
    match folders.iter().filter(is_synthetic).count() {
        0 => String::new(),
        synthetic if synthetic == folders.len() => ALL.to_owned(),
        _ => format!("{SOME}."),
    }
}

/// What the page shows of truth and tables.
pub(crate) fn compare(truth: &Truth, tables: &Tables) -> Value {
    let trials = tables.trials.iter();
    let trials: Vec<(&TrialRow, GaitMetrics)> = trials
        .filter_map(|trial| Some((trial, truth.trials.get(&trial.trial)?.metrics())))
        .collect();
    let within = [
        sentence("d", &trials, |metrics| metrics.d_m),
        sentence("v", &trials, |metrics| metrics.v_m_s),
    ];
    let known = planted(truth, tables);
    let summary = made_with(truth, tables).into_iter().chain(varied(truth));
    let summary: Vec<String> = summary.chain(within.into_iter().flatten()).collect();
    context! {
        seed => truth.seed,
        summary => Serde(summary),
        coefficients => Serde(known),
        trials => Serde(trials),
    }
}

/// Which models made the trials, and what that leaves unknown.
fn made_with(truth: &Truth, tables: &Tables) -> Vec<String> {
    let mut campaigns: BTreeMap<Model, Vec<&str>> = BTreeMap::new();
    for (campaign, planted) in &truth.campaigns {
        campaigns.entry(planted.model()).or_default().push(campaign);
    }
    let of_model = |(model, campaigns): (&Model, &Vec<&str>)| {
        let is_fitted = |name: &&&str| {
            tables.fits.iter().any(|fit| fit.model == *model && fit.campaign == **name)
        };
        let without: Vec<&str> =
            campaigns.iter().filter(|name| !is_fitted(name)).copied().collect();
        let without = match &without[..] {
            [] => String::new(),
            names => format!("; it is not fitted to {}", names.join(", ")),
        };
        format!(
            "{} {} made with {model}{without}.",
            campaigns.join(", "),
            if campaigns.len() > 1 { "were" } else { "was" }
        )
    };
    let mut sentences: Vec<String> = campaigns.iter().map(of_model).collect();
    if !sentences.is_empty() {
        let other = "The coefficients of other models have no truth to be compared with.";
        sentences.push(other.to_owned());
    }
    sentences
}

/// What no model knows of how the trials were made.
fn varied(truth: &Truth) -> Option<String> {
    let percent = |part: f64| fixed(100.0 * part, 1);
    let cycles = (truth.friction_variation > 0.0).then(|| {
        let percent = percent(truth.friction_variation);
        format!("friction varied from cycle to cycle with a standard deviation of {percent} %")
    });
    let farthest = truth.days.values().map(|floor| (floor - 1.0).abs()).fold(0.0, f64::max);
    let days = (farthest > 0.0).then(|| {
        let percent = percent(farthest);
        format!("the floors of {} days had up to {percent} % more or less of it", truth.days.len())
    });
    let servo = truth.servo.map(|PlantedServo { lag_s, compliance_rad_nm }| {
        format!(
            "servos lagged by {} ms and gave way by {} rad/(N m)",
            fixed(1e3 * lag_s, 1),
            fixed(compliance_rad_nm, 3)
        )
    });
    let parts: Vec<String> = [cycles, days, servo].into_iter().flatten().collect();
    let sentence = match &truth.tidy[..] {
        _ if parts.is_empty() => return None,
        [] => parts.join(", "),
        tidy => format!("but for {}, {}", tidy.join(", "), parts.join(", ")),
    };
    let first = sentence[..1].to_uppercase();
    let mean = match truth.friction_variation > 0.0 {
        true => " Planted motions are those of the mean friction of a trial's day.",
        false => "",
    };
    Some(format!("{first}{}: no model has that to the letter.{mean}", &sentence[1..]))
}

/// A coefficient of the fitted model that the trials were made with, and what was planted.
#[derive(Debug, Serialize)]
pub(crate) struct Known<'t> {
    pub campaign: &'t str,
    pub model: Model,
    pub parameter: FittedParameter,
    pub planted: f64,
    /// Half the width of the interval that scatter alone gives; NaN where it is not known.
    #[serde(skip)]
    pub scatter: f64,
}

/// All coefficients of which the truth is known, by campaign.
pub(crate) fn planted<'t>(truth: &Truth, tables: &'t Tables) -> Vec<Known<'t>> {
    let mut known = Vec::new();
    for fit in &tables.fits {
        let planted = truth.campaigns.get(&fit.campaign);
        let Some(planted) = planted.filter(|planted| planted.model() == fit.model) else {
            continue;
        };
        known.extend(Parameter::ALL.into_iter().filter_map(|parameter| {
            let is_told = !parameter.is_sum() || fit.free.contains(&parameter);
            let planted = planted.of(parameter).filter(|_| is_told)?;
            let scatter = fit.scatter[parameter];
            let parameter = FittedParameter::of(fit, parameter);
            Some(Known { campaign: &fit.campaign, model: fit.model, parameter, planted, scatter })
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

#[cfg(test)]
mod tests {
    use trilink_robot::Quantity;

    use super::*;
    use crate::tests::made_up;

    #[test]
    fn only_the_model_that_made_the_trials_has_a_truth() {
        let truth: Truth = serde_json::from_value(serde_json::json!({
            "friction_variation": 0.05,
            "days": {"1": 1.021, "2": 0.979},
            "servo": {"lag_s": 0.02, "compliance_rad_nm": 0.05},
            "campaigns": {
                "dry": {"law": {"model": "coulomb", "skid": "coulomb", "roll": "viscous"},
                    "skid_kg_s": null, "skid_dry_n": [2.0, 1.0, 1.1], "transition_m_s": 0.005},
                "dry-too": {"law": {"model": "coulomb"}, "skid_dry_n": [2.0, 1.0, 1.1]},
                "wet": {"skid_kg_s": [100.0, 50.0, 60.0]},
            },
        }))
        .expect("a truth");
        let coulomb = Model::new("coulomb");
        let fits = [("dry", coulomb), ("dry", Model::SKID_ROLL), ("dry-too", Model::SKID_ROLL)];
        let fits = fits.into_iter().chain([("wet", Model::SKID_ROLL), ("wet", coulomb)]);
        let fits = fits.map(|(campaign, model)| made_up::fit(campaign, model, 0)).collect();
        let tables = Tables { fits, ..Tables::default() };
        let known: Vec<_> = planted(&truth, &tables)
            .iter()
            .map(|known| (known.campaign, known.model, known.parameter.parameter, known.planted))
            .collect();
        let dry = |parameter, planted| ("dry", coulomb, parameter, planted);
        let wet = |parameter, planted| ("wet", Model::SKID_ROLL, parameter, planted);
        assert_eq!(
            known,
            [
                dry(Quantity::SkidDry.of(0), 2.0),
                dry(Quantity::SkidDry.of(1), 1.0),
                dry(Quantity::SkidDry.of(2), 1.1),
                dry(Quantity::Transition.one(), 0.005),
                wet(Quantity::Skid.of(0), 100.0),
                wet(Quantity::Skid.of(1), 50.0),
                wet(Quantity::Skid.of(2), 60.0),
            ]
        );
        assert_eq!(
            made_with(&truth, &tables),
            [
                "dry, dry-too were made with coulomb; it is not fitted to dry-too.",
                "wet was made with skid-roll.",
                "The coefficients of other models have no truth to be compared with.",
            ]
        );
        assert_eq!(
            varied(&truth).as_deref(),
            Some(
                "Friction varied from cycle to cycle with a standard deviation of 5.0 %, the floors \
                 of 2 days had up to 2.1 % more or less of it, servos lagged by 20.0 ms and gave way \
                 by 0.050 rad/(N m): no model has that to the letter. Planted motions are those of the \
                 mean friction of a trial's day."
            )
        );
        let truth =
            Truth { days: BTreeMap::new(), servo: None, tidy: vec!["wet".to_owned()], ..truth };
        assert_eq!(
            varied(&truth).as_deref(),
            Some(
                "But for wet, friction varied from cycle to cycle with a standard deviation of 5.0 %: \
                 no model has that to the letter. Planted motions are those of the mean friction of a \
                 trial's day."
            )
        );
        assert_eq!(varied(&Truth::default()), None);
    }
}
