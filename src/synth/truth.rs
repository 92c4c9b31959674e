//! `truth.json`: what was planted.

use std::collections::BTreeMap;

use serde::Serialize;

use super::cameras::LabelError;
use super::decay::DecayTruth;
use crate::metrics::GaitMetrics;
use crate::robot::{Gait, JointCommand, Robot};

/// What was planted in a folder.
#[derive(Debug, Serialize)]
pub struct Truth {
    pub synthetic: bool,
    pub seed: u64,
    pub campaigns: BTreeMap<String, CampaignTruth>,
    pub trials: BTreeMap<String, TrialTruth>,
    /// By the trial that shows them.
    pub robots: BTreeMap<String, DecayTruth>,
}

/// Planted coefficients; those of the passive joint are null where there is none.
#[derive(Debug, Serialize)]
pub struct CampaignTruth {
    pub skid_kg_s: [f64; 3],
    pub roll_kg_s: [f64; 3],
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
    pub(super) fn new(robot: &Robot, gait: &Gait) -> Self {
        let spring = gait.passive_joint().map(|_| robot);
        Self {
            skid_kg_s: robot.skid_kg_s,
            roll_kg_s: robot.roll_kg_s,
            stiffness_nm_rad: spring.map(|robot| robot.stiffness_nm_rad),
            damping_nm_s_rad: spring.map(|robot| robot.damping_nm_s_rad),
        }
    }
}
