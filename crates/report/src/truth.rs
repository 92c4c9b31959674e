//! True parameters of synthetic trials, from `truth.json` in the trial folders, and their comparison with the fitted
//! values.

use std::collections::{BTreeMap, BTreeSet};

use minijinja::context;
use minijinja::value::{Serde, Value};
use serde::{Deserialize, Serialize};
use trilink_base::files;
use trilink_base::numbers::fixed;
use trilink_robot::metrics::{GaitMetrics, Metric, padded};
use trilink_robot::{Model, Parameter, Per, Robot};
use trilink_tables::config::Paths;
use trilink_tables::trial::{TRUTH_FILE, find_folders};
use trilink_tables::{Reader, StoreError, TrialRow};

use super::ReportInput;
use super::parameters::FittedParameter;
use super::tables::Tables;

/// True parameters with which synthetic trials were generated, from `truth.json`. Unknown entries in the file are
/// ignored.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Truth {
    /// Whether the trials are synthetic, that is, computed instead of recorded.
    pub synthetic: bool,
    /// Folders that contain synthetic trials.
    #[serde(skip)]
    pub synthetic_folders: BTreeSet<String>,
    pub seed: Option<u64>,
    /// Relative standard deviation of the friction between cycles.
    pub friction_variation: f64,
    /// Friction on each day relative to the nominal friction of the synthetic trials, keyed by day.
    pub days: BTreeMap<String, f64>,
    pub servo: Option<PlantedServo>,
    /// True values of robot parameters that are off their configured values, by robot and parameter.
    pub off_configured: BTreeMap<String, BTreeMap<String, f64>>,
    /// Campaigns that were generated without servo errors and with constant friction, that is, the same friction in all
    /// cycles and on all days.
    pub tidy: Vec<String>,
    pub campaigns: BTreeMap<String, PlantedCampaign>,
    pub trials: BTreeMap<String, PlantedTrial>,
}

/// Lag and compliance of the servos with which synthetic trials were generated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(default)]
pub(crate) struct PlantedServo {
    pub lag_s: f64,
    pub compliance_rad_nm: f64,
}

/// Model with which synthetic trials were generated.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(crate) struct PlantedLaw {
    pub model: Model,
}

/// True parameters of the robot in the synthetic trials of a campaign.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub(crate) struct PlantedCampaign {
    /// Model with which the trials were generated; `None` stands for `skid-roll`.
    pub law: Option<PlantedLaw>,
    /// True values, keyed by quantity: a number, or an array with one number for each wheel, link or joint.
    #[serde(flatten)]
    pub planted: BTreeMap<String, serde_json::Value>,
}

impl PlantedCampaign {
    /// Returns the model that generated the trials.
    fn model(&self) -> Model {
        self.law.map_or(Model::SKID_ROLL, |law| law.model)
    }

    /// Returns the true value of a parameter; `None` if it is unknown.
    fn planted_value(&self, parameter: Parameter) -> Option<f64> {
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
        Some(parameter.value_in(&robot))
    }

    /// Returns the true value of a parameter of a chain; `None` if it is unknown.
    fn planted_value_of_chain(&self, parameter: Parameter) -> Option<f64> {
        let planted = self.planted.get(parameter.quantity().name())?;
        let Some(each) = planted.as_array() else { return planted.as_f64() };
        match parameter.number() {
            Some(number) => {
                let is_of_joint = parameter.quantity().definition().per == Per::FreeJoint;
                each.get(number.checked_sub(usize::from(is_of_joint))?)?.as_f64()
            }
            None => parameter.is_sum().then(|| each.iter().filter_map(|one| one.as_f64()).sum()),
        }
    }
}

/// True motion of a synthetic trial.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct PlantedTrial {
    pub d_m: Option<f64>,
    pub v_m_s: Option<f64>,
    /// By link; `None` for one without a wheel.
    pub sigma: Option<Vec<Option<f64>>>,
    /// Other values, such as the amplitudes of the joints (`alpha1_rad`, ..).
    #[serde(flatten)]
    pub others: BTreeMap<String, serde_json::Value>,
}

impl PlantedTrial {
    /// Returns the true metrics of the trial; NaN if unknown.
    pub(crate) fn metrics(&self) -> GaitMetrics {
        let sigma = self.sigma.iter().flatten().map(|sigma| sigma.unwrap_or(f64::NAN));
        GaitMetrics {
            d_m: self.d_m.unwrap_or(f64::NAN),
            v_m_s: self.v_m_s.unwrap_or(f64::NAN),
            sigma: padded(&sigma.collect::<Vec<_>>()),
            alpha_rad: Metric::ALPHA.map(|alpha| {
                self.others.get(alpha.column()).and_then(|of| of.as_f64()).unwrap_or(f64::NAN)
            }),
            ..GaitMetrics::MISSING
        }
    }
}

impl Truth {
    /// Reads the true parameters of the synthetic trials in all trial folders; returns `None` if no folder contains
    /// any.
    ///
    /// Invalid files and contradictions between folders are skipped, and sentences that describe them are added to
    /// `missing`.
    ///
    /// # Errors
    /// Returns an error if an existing file cannot be read.
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
            let name = paths.name_of(folder);
            let several = paths.raw.len() > 1;
            match serde_json::from_slice::<Self>(&bytes) {
                Ok(truth) => drop(truths.insert(name, truth)),
                Err(problem) => {
                    let of = if several { format!(" of {name}") } else { String::new() };
                    missing.push(format!("{TRUTH_FILE}{of} is ignored: {problem}."));
                }
            }
        }
        let mut all: Option<Self> = None;
        for (folder, mut truth) in truths {
            let mut planted = std::mem::take(&mut truth.trials);
            // Tables from another source may not name the folder of each trial.
            let here = rows
                .iter()
                .filter(|row| row.folder.is_empty() || row.folder == folder)
                .filter_map(|row| {
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

    /// Adds the true parameters from another trial folder.
    fn extend(&mut self, other: Self, folder: &str, missing: &mut Vec<String>) {
        self.synthetic |= other.synthetic;
        self.synthetic_folders.extend(other.synthetic_folders);
        self.seed = self.seed.filter(|seed| other.seed == Some(*seed));
        self.friction_variation = self.friction_variation.max(other.friction_variation);
        self.servo = self.servo.or(other.servo);
        self.off_configured.extend(other.off_configured);
        self.tidy.extend(other.tidy);
        let days = other.days.into_iter();
        self.days.extend(days.map(|(day, floor)| (format!("{folder}/{day}"), floor)));
        self.trials.extend(other.trials);
        for (campaign, planted) in other.campaigns {
            let known = self.campaigns.entry(campaign.clone());
            let known = known.or_insert_with(|| planted.clone());
            if *known != planted {
                // True values that contradict each other are discarded for the whole campaign.
                *known = PlantedCampaign::default();
                missing.push(format!(
                    "The coefficients of {campaign} are not compared, because {TRUTH_FILE} in \
                     {folder} and {TRUTH_FILE} in another folder contradict each other."
                ));
            }
        }
    }
}

/// Notice for pages on which all trials are synthetic.
const ALL: &str = "These trials are synthetic.";
/// Beginning of the notice for pages on which only some trials are synthetic.
const SOME: &str = "Some of these trials are synthetic";

impl Truth {
    /// Returns whether a trial is synthetic.
    pub(crate) fn is_synthetic(&self, trial: &TrialRow) -> bool {
        // Tables from another source may not name the folder of each trial.
        self.synthetic
            && (trial.folder.is_empty() || self.synthetic_folders.contains(&trial.folder))
    }

    /// Returns whether any trial of the given campaigns is synthetic; an empty slice stands for all campaigns.
    pub(crate) fn is_synthetic_in(&self, campaigns: &[String], tables: &Tables) -> bool {
        tables
            .trials
            .iter()
            .filter(|trial| campaigns.is_empty() || campaigns.contains(&trial.campaign))
            .any(|trial| self.is_synthetic(trial))
    }

    /// Returns the notice that trials are synthetic; empty if all trials were recorded.
    pub(crate) fn notice(&self, tables: &Tables) -> String {
        let synthetic = tables.trials.iter().filter(|trial| self.is_synthetic(trial)).count();
        if synthetic == 0 {
            return String::new();
        }
        if synthetic == tables.trials.len() {
            ALL.to_owned()
        } else {
            let folders: Vec<&str> = self.synthetic_folders.iter().map(String::as_str).collect();
            format!("{SOME}: the trials of {}.", folders.join(", "))
        }
    }
}

/// Returns the notice that trials are synthetic, for pages that are made without the table of trials; empty if all
/// trials were recorded. Invalid `truth.json` files are ignored; the report names them.
pub fn notice_of_folders(paths: &Paths) -> String {
    let folders = find_folders(paths).unwrap_or_default();
    match folders
        .iter()
        .filter(|folder| {
            let truth = files::read(&folder.join(TRUTH_FILE), files::TEXT_BYTES).ok();
            truth
                .and_then(|(json, _)| serde_json::from_slice::<Truth>(&json).ok())
                .is_some_and(|truth| truth.synthetic)
        })
        .count()
    {
        0 => String::new(),
        synthetic if synthetic == folders.len() => ALL.to_owned(),
        _ => format!("{SOME}."),
    }
}

/// Returns the template values for comparing true and fitted parameters on the report page.
pub(crate) fn compare(truth: &Truth, tables: &Tables, input: &ReportInput) -> Value {
    let trials = tables.trials.iter();
    let trials: Vec<(&TrialRow, GaitMetrics)> = trials
        .filter_map(|trial| Some((trial, truth.trials.get(&trial.trial)?.metrics())))
        .collect();
    let within = [
        max_deviation("d", &trials, |metrics| metrics.d_m),
        max_deviation("v", &trials, |metrics| metrics.v_m_s),
    ];
    let known = planted(truth, tables, input);
    let summary = generating_models(truth, tables).into_iter().chain(unmodelled_effects(truth));
    let summary: Vec<String> = summary.chain(within.into_iter().flatten()).collect();
    context! {
        seed => truth.seed,
        summary => Serde(summary),
        coefficients => Serde(known),
        trials => Serde(trials),
    }
}

/// Returns sentences that name the models that generated the trials and the campaigns to which these models are not
/// fitted.
fn generating_models(truth: &Truth, tables: &Tables) -> Vec<String> {
    let mut campaigns: BTreeMap<Model, Vec<&str>> = BTreeMap::new();
    for (campaign, planted) in &truth.campaigns {
        campaigns.entry(planted.model()).or_default().push(campaign);
    }
    let mut sentences: Vec<String> = campaigns
        .iter()
        .map(|(model, campaigns)| {
            let is_fitted = |name: &&&str| {
                tables.fits.iter().any(|fit| fit.model == *model && fit.campaign == **name)
            };
            let without: Vec<&str> =
                campaigns.iter().filter(|name| !is_fitted(name)).copied().collect();
            let without = match &without[..] {
                [] => String::new(),
                names => format!("; this model is not fitted to {}", names.join(", ")),
            };
            format!(
                "{} {} generated with {model}{without}.",
                campaigns.join(", "),
                if campaigns.len() > 1 { "were" } else { "was" }
            )
        })
        .collect();
    if !sentences.is_empty() {
        let other = "The coefficients of other models have no true values to compare with.";
        sentences.push(other.to_owned());
    }
    sentences
}

/// Returns a sentence on effects that were simulated in the synthetic trials but are not part of any model; `None` if
/// there are none.
fn unmodelled_effects(truth: &Truth) -> Option<String> {
    let cycles = (truth.friction_variation > 0.0).then(|| {
        let percent = fixed(100.0 * truth.friction_variation, 1);
        format!("friction varied from cycle to cycle with a standard deviation of {percent} %")
    });
    let largest = truth.days.values().map(|floor| (floor - 1.0).abs()).fold(0.0, f64::max);
    let days = (largest > 0.0).then(|| {
        let percent = fixed(100.0 * largest, 1);
        format!(
            "friction on the floors of {} days deviated by up to {percent} % from that of the generating model",
            truth.days.len()
        )
    });
    let servo = truth.servo.map(|PlantedServo { lag_s, compliance_rad_nm }| {
        format!(
            "the servos had a lag of {} ms and a compliance of {} rad/(N m)",
            fixed(1e3 * lag_s, 1),
            fixed(compliance_rad_nm, 3)
        )
    });
    let robots = (!truth.off_configured.is_empty()).then(|| {
        let robots = truth.off_configured.keys().map(String::as_str).collect::<Vec<_>>();
        format!("the true parameters of {} are off the configured ones", robots.join(", "))
    });
    let effects: Vec<String> = [cycles, days, servo, robots].into_iter().flatten().collect();
    let sentence = match &truth.tidy[..] {
        _ if effects.is_empty() => return None,
        [] => effects.join(", "),
        tidy => format!("except in {}, {}", tidy.join(", "), effects.join(", ")),
    };
    let first = sentence[..1].to_uppercase();
    let mean = if truth.friction_variation > 0.0 {
        " The true motions of synthetic trials are computed with the mean friction of each trial's day."
    } else {
        ""
    };
    Some(format!("{first}{}. No model includes these effects exactly.{mean}", &sentence[1..]))
}

/// Coefficient of the model that generated the synthetic trials: true value and fitted value.
#[derive(Debug, Serialize)]
pub(crate) struct Known<'t> {
    pub campaign: &'t str,
    pub model: Model,
    pub parameter: FittedParameter,
    pub planted: f64,
    /// Half-width of the confidence interval due to scatter alone; NaN if unknown.
    #[serde(skip)]
    pub scatter: f64,
}

/// Returns all fitted coefficients with known true values, grouped by campaign.
pub(crate) fn planted<'t>(
    truth: &Truth,
    tables: &'t Tables,
    input: &ReportInput,
) -> Vec<Known<'t>> {
    let mut known = Vec::new();
    for fit in &tables.fits {
        let planted = truth.campaigns.get(&fit.campaign);
        let Some(planted) = planted.filter(|planted| planted.model() == fit.model) else {
            continue;
        };
        let is_chain = input.is_chain(&fit.campaign);
        let links = input.links(&fit.campaign);
        let parameters = Parameter::OF_ANY_ROBOT.into_iter();
        let parameters = parameters.filter(|of| is_chain || of.is_of_three_links());
        known.extend(parameters.filter_map(|parameter| {
            let is_determined = !parameter.is_sum() || fit.free.contains(&parameter);
            let planted = match is_chain {
                true => planted.planted_value_of_chain(parameter),
                false => planted.planted_value(parameter),
            };
            let planted = planted.filter(|_| is_determined)?;
            let scatter = fit.scatter[parameter];
            let parameter = FittedParameter::new(fit, parameter).of_links(&links);
            Some(Known { campaign: &fit.campaign, model: fit.model, parameter, planted, scatter })
        }));
    }
    known
}

/// Returns a sentence on the largest deviation of a measured metric from its true value; `None` if no true value is
/// known.
fn max_deviation(
    symbol: &str,
    trials: &[(&TrialRow, GaitMetrics)],
    metric: fn(&GaitMetrics) -> f64,
) -> Option<String> {
    let known: Vec<_> = trials
        .iter()
        .map(|(trial, planted)| {
            (&trial.trial, (metric(&trial.metrics) / metric(planted) - 1.0).abs())
        })
        .filter(|(_, difference)| difference.is_finite())
        .collect();
    // `max_by` returns the last of several equal maxima, which is the first trial because the order is reversed.
    let (trial, largest) = known.iter().rev().max_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(format!(
        "{symbol} of {} trials: within {} % of the true values, largest deviation in {trial}.",
        known.len(),
        fixed(100.0 * largest, 2)
    ))
}

#[cfg(test)]
mod tests {
    use trilink_robot::Quantity;
    use trilink_tables::config::Config;

    use super::*;
    use crate::tests::made_up;

    #[test]
    fn only_the_model_that_generated_the_trials_has_true_values() {
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
        let input = ReportInput::new(&Config::default(), BTreeSet::new());
        let known: Vec<_> = planted(&truth, &tables, &input)
            .iter()
            .map(|known| (known.campaign, known.model, known.parameter.parameter, known.planted))
            .collect();
        let dry = |parameter, planted| ("dry", coulomb, parameter, planted);
        let wet = |parameter, planted| ("wet", Model::SKID_ROLL, parameter, planted);
        assert_eq!(
            known,
            [
                dry(Quantity::SkidDry.parameter(0), 2.0),
                dry(Quantity::SkidDry.parameter(1), 1.0),
                dry(Quantity::SkidDry.parameter(2), 1.1),
                dry(Quantity::Transition.one(), 0.005),
                wet(Quantity::Skid.parameter(0), 100.0),
                wet(Quantity::Skid.parameter(1), 50.0),
                wet(Quantity::Skid.parameter(2), 60.0),
            ]
        );
        assert_eq!(
            generating_models(&truth, &tables),
            [
                "dry, dry-too were generated with coulomb; this model is not fitted to dry-too.",
                "wet was generated with skid-roll.",
                "The coefficients of other models have no true values to compare with.",
            ]
        );
        assert_eq!(
            unmodelled_effects(&truth).as_deref(),
            Some(
                "Friction varied from cycle to cycle with a standard deviation of 5.0 %, friction on the floors of 2 \
                 days deviated by up to 2.1 % from that of the generating model, the servos had a lag of 20.0 ms and a \
                 compliance of 0.050 rad/(N m). No model includes these effects exactly. The true motions of \
                 synthetic trials are computed with the mean friction of each trial's day."
            )
        );
        let truth =
            Truth { days: BTreeMap::new(), servo: None, tidy: vec!["wet".to_owned()], ..truth };
        assert_eq!(
            unmodelled_effects(&truth).as_deref(),
            Some(
                "Except in wet, friction varied from cycle to cycle with a standard deviation of 5.0 %. \
                 No model includes these effects exactly. The true motions of synthetic trials are \
                 computed with the mean friction of each trial's day."
            )
        );
        assert_eq!(unmodelled_effects(&Truth::default()), None);
    }
}
