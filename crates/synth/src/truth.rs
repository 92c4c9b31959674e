//! `truth.json`: what was planted.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use trilink_base::files;
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Gait, JointCommand, Laws, Model, Robot, RollLaw, SkidLaw};
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

/// Planted coefficients; null are those of the passive joint where there is none, and viscous ones
/// that the law does not know. Dry ones are there where it does.
#[derive(Debug, Serialize)]
pub struct CampaignTruth {
    /// `skid-roll` if it is not there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub law: Option<Law>,
    pub skid_kg_s: Option<[f64; 3]>,
    pub roll_kg_s: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skid_dry_n: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skid_static_n: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stribeck_m_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roll_dry_n: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transition_m_s: Option<f64>,
    pub stiffness_nm_rad: Option<f64>,
    pub damping_nm_s_rad: Option<f64>,
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
        let spring = gait.passive_joint().map(|_| robot);
        let Laws { skid, roll } = laws;
        Self {
            law,
            skid_kg_s: skid.is_viscous().then_some(robot.skid_kg_s),
            roll_kg_s: roll.is_viscous().then_some(robot.roll_kg_s),
            skid_dry_n: skid.is_dry().then_some(robot.skid_dry_n),
            skid_static_n: skid.has_static().then_some(robot.skid_static_n),
            stribeck_m_s: skid.has_static().then_some(robot.stribeck_m_s),
            roll_dry_n: roll.is_dry().then_some(robot.roll_dry_n),
            transition_m_s: laws.are_dry().then_some(robot.transition_m_s),
            stiffness_nm_rad: spring.map(|robot| robot.stiffness_nm_rad),
            damping_nm_s_rad: spring.map(|robot| robot.damping_nm_s_rad),
        }
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde gives a reference")]
fn is_none(variation: &f64) -> bool {
    *variation == 0.0
}
