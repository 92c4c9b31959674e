//! `truth.json`: what was planted.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use trilink_base::files;
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Gait, JointCommand, Laws, Model, Quantity, Robot, RollLaw, SkidLaw};
use trilink_tables::trial::TRUTH_FILE;

use super::cameras::LabelError;
use super::decay::DecayTruth;
use super::servo::Servo;

/// The models that made the campaigns of a folder, other than `skid-roll`; none where its truth cannot be
/// read.
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

/// What was planted in a folder.
#[derive(Debug, Serialize)]
pub struct Truth {
    pub synthetic: bool,
    pub seed: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub servo: Option<Servo>,
    /// Relative standard deviation of friction from cycle to cycle.
    #[serde(skip_serializing_if = "is_none")]
    pub friction_variation: f64,
    /// Friction of each day's floor as a part of the planted one, where there are several.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub days: BTreeMap<usize, f64>,
    /// Campaigns that know none of these.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tidy: Vec<String>,
    pub campaigns: BTreeMap<String, CampaignTruth>,
    pub trials: BTreeMap<String, TrialTruth>,
    /// By the trial that shows them.
    pub robots: BTreeMap<String, DecayTruth>,
}

/// The model whose laws made a campaign.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Law {
    pub model: Model,
    pub skid: SkidLaw,
    pub roll: RollLaw,
}

/// Planted coefficients: of every quantity that the law and the gait know, as the configuration has it.
#[derive(Debug, Serialize)]
pub struct CampaignTruth {
    /// `skid-roll` if it is not there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub law: Option<Law>,
    #[serde(flatten)]
    pub planted: BTreeMap<Quantity, Numbers>,
}

/// One number, or one a wheel.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub enum Numbers {
    One(f64),
    Each(Vec<f64>),
}

/// The steady motion of one trial and the gait that its servos reached.
#[derive(Debug, Serialize)]
pub struct TrialTruth {
    pub omega_rad_s: f64,
    #[serde(flatten)]
    pub metrics: GaitMetrics,
    pub gait: [Option<JointCommand>; 2],
    /// From 1 on, where there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub day: Option<usize>,
    /// Frames in which a marker was not where its label says.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub misplaced: Vec<LabelError>,
}

impl Truth {
    /// The file's text.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("plain numbers and names") + "\n"
    }
}

impl CampaignTruth {
    pub(super) fn new(law: Option<Law>, laws: Laws, robot: &Robot, gait: &Gait) -> Self {
        let planted = Quantity::ALL.into_iter().filter(|of| {
            let definition = of.definition();
            definition.is_fitted && (definition.matters)(laws, gait)
        });
        let numbers = |of: Quantity| match of.numbers(robot) {
            [one] => (of, Numbers::One(*one)),
            each => (of, Numbers::Each(each.to_vec())),
        };
        Self { law, planted: planted.map(numbers).collect() }
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde gives a reference")]
fn is_none(variation: &f64) -> bool {
    *variation == 0.0
}
