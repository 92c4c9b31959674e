//! `truth.json`: the true values of a folder of synthetic trials.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use trilink_base::files;
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{
    AnyRobot, Chain, Gait, JointCommand, Laws, Model, Parameter, Per, Quantity, Robot, RollLaw,
    SkidLaw,
};
use trilink_tables::config::{Config, GaitConfig};
use trilink_tables::trial::TRUTH_FILE;

use super::cameras::LabelError;
use super::decay::{DecayTruth, Slope};
use super::servo::Servo;

/// Returns the models that generated the campaigns in a folder, by campaign; campaigns of the model `skid-roll` are
/// left out. Empty if `truth.json` cannot be read.
pub fn planted_models(folder: &Path) -> BTreeMap<String, Model> {
    #[derive(Default, Deserialize)]
    struct Known {
        campaigns: BTreeMap<String, Planted>,
    }
    #[derive(Deserialize)]
    struct Planted {
        law: Option<Made>,
    }
    #[derive(Deserialize)]
    struct Made {
        model: Model,
    }
    let text = files::read(&folder.join(TRUTH_FILE), files::TEXT_BYTES);
    let known = text.ok().and_then(|(json, _)| serde_json::from_slice::<Known>(&json).ok());
    let campaigns = known.unwrap_or_default().campaigns.into_iter();
    campaigns.filter_map(|(campaign, planted)| Some((campaign, planted.law?.model))).collect()
}

/// True values of a folder of synthetic trials, as written to `truth.json`.
#[derive(Debug, Serialize)]
pub struct Truth {
    pub synthetic: bool,
    pub seed: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub servo: Option<Servo>,
    /// Slope of the floor in the coast-downs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slope: Option<Slope>,
    /// True values of those parameters that are off their configured values, by robot and parameter (of a chain by
    /// [`Chain::number_name`]), in the units that the parameters' names state.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub off_configured: BTreeMap<String, BTreeMap<String, f64>>,
    /// Relative standard deviation of friction from cycle to cycle.
    #[serde(skip_serializing_if = "is_none")]
    pub friction_variation: f64,
    /// Friction of each day's floor relative to the true coefficients; empty if there is a single day.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub days: BTreeMap<usize, f64>,
    /// Campaigns with ideal servos and constant friction.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tidy: Vec<String>,
    pub campaigns: BTreeMap<String, CampaignTruth>,
    pub trials: BTreeMap<String, TrialTruth>,
    /// True robot parameters, by id of the joint-release or coast-down trial.
    pub robots: BTreeMap<String, DecayTruth>,
}

/// Returns the true values of those robot parameters that differ from the configured ones.
pub(super) fn off_configured(
    configured: &Config,
    truth: &Config,
) -> BTreeMap<String, BTreeMap<String, f64>> {
    let robots = truth.robot.iter().map(|(name, robot)| {
        let [own, other] =
            [robot, &configured.robot[name]].map(|robot| robot.to_robot(&GaitConfig::default()));
        let values: BTreeMap<String, f64> = match &own {
            AnyRobot::ThreeLinks(robot) => {
                let parameters = Quantity::ALL.into_iter().flat_map(|of| of.parameters_of(robot));
                let changed = parameters.filter(|of| own.value(*of) != other.value(*of));
                let in_unit =
                    |of: Parameter| own.value(of) / of.quantity().definition().unit.in_si();
                changed.map(|of| (of.name().to_owned(), in_unit(of))).collect()
            }
            AnyRobot::Chain(chain) => {
                let configured = |of| other.as_chain().and_then(|other| other.number(of));
                let numbers = chain.numbers().into_iter();
                let changed = numbers.filter(|of| chain.number(*of) != configured(*of));
                let in_unit = |of| Some((chain.number_name(of), chain.number(of)? / of.in_si()));
                changed.filter_map(in_unit).collect()
            }
        };
        (name.clone(), values)
    });
    robots.filter(|(_, values)| !values.is_empty()).collect()
}

/// Model that generated a campaign's trials, with the model's laws.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Law {
    pub model: Model,
    pub skid: SkidLaw,
    pub roll: RollLaw,
}

/// True coefficients of a campaign: all quantities that fits can estimate and on which the motion depends under the
/// campaign's friction laws and gait.
#[derive(Debug, Serialize)]
pub struct CampaignTruth {
    /// Model that generated the trials, with its friction laws; `None` for the model `skid-roll`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub law: Option<Law>,
    #[serde(flatten)]
    pub planted: BTreeMap<Quantity, Numbers>,
}

/// A number of the robot, or a list with a number for each link, or for each joint. NaN, which is written as null, stands
/// for a link or joint that lacks the number.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub enum Numbers {
    One(f64),
    Each(Vec<f64>),
}

/// Metrics of a trial's steady-state motion, and the gait that its servos performed.
#[derive(Debug, Serialize)]
pub struct TrialTruth {
    pub omega_rad_s: f64,
    #[serde(flatten)]
    pub metrics: GaitMetrics,
    pub gait: Vec<Option<JointCommand>>,
    /// Number of the trial's day, counted from 1; `None` if the trials are not distributed over several days.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub day: Option<usize>,
    /// Friction of the trial relative to that of its day; left out if it is equal.
    #[serde(skip_serializing_if = "is_one")]
    pub friction: f64,
    /// Label errors in the recording, at most one per frame.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub misplaced: Vec<LabelError>,
}

impl Truth {
    /// Returns the content of `truth.json`.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("numbers and names can be serialised") + "\n"
    }
}

impl CampaignTruth {
    pub(super) fn new(law: Option<Law>, laws: Laws, robot: &Robot, gait: &Gait) -> Self {
        let mut planted = BTreeMap::new();
        for quantity in Quantity::ALL {
            let definition = quantity.definition();
            if definition.is_fitted && (definition.is_relevant)(laws, gait) {
                let numbers = match quantity.numbers(robot) {
                    [one] => Numbers::One(*one),
                    each => Numbers::Each(each.to_vec()),
                };
                planted.insert(quantity, numbers);
            }
        }
        Self { law, planted }
    }

    pub(super) fn of_chain(law: Option<Law>, laws: Laws, chain: &Chain) -> Self {
        let gait = chain.gait();
        let robot = AnyRobot::from(chain.clone());
        let fitted = Quantity::ALL.into_iter().filter(|quantity| quantity.definition().is_fitted);
        let planted = fitted.filter_map(|quantity| {
            let indices = match quantity.definition().per {
                Per::Wheel => 0..chain.links.len(),
                Per::FreeJoint => 1..chain.links.len(),
                Per::Robot => 0..1,
                Per::Link | Per::Joint => return None,
            };
            let parameters = indices.map(|index| quantity.parameter(index));
            let is_used = parameters.clone().any(|one| robot.depends_on(one, laws, &gait));
            let values: Vec<f64> = parameters.map(|parameter| robot.value(parameter)).collect();
            let numbers = match (quantity.definition().per, &values[..]) {
                (Per::Robot, [one]) => Numbers::One(*one),
                _ => Numbers::Each(values),
            };
            is_used.then_some((quantity, numbers))
        });
        Self { law, planted: planted.collect() }
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
#[expect(clippy::float_cmp, reason = "a factor that is not drawn is exactly 1")]
fn is_one(factor: &f64) -> bool {
    *factor == 1.0
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_none(variation: &f64) -> bool {
    *variation == 0.0
}
