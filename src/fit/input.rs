//! What a fit reads of the configuration.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{FitData, FreeParameter, Measurement, measurements};
use crate::config::{Config, Fit, Free, GaitConfig, NamedEntry, RobotConfig, Weights};
use crate::robot::{Family, Model, Parameter};
use crate::store::{CycleRow, hash};

/// What one model of one campaign is fitted with.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FitInput {
    pub campaign: NamedEntry<FitCampaign>,
    pub model: Model,
    pub robot: NamedEntry<RobotConfig>,
    pub gait: NamedEntry<GaitConfig>,
    /// What the fit does not read, such as bounds of what is not free, has its default.
    pub fit: Fit,
}

/// The keys of a campaign that a fit reads.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FitCampaign {
    pub weights: Weights,
    /// What the model leaves free, if the configuration says so.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free: Option<Free>,
}

impl FitInput {
    /// Those of all models of all campaigns, in the configuration's order.
    pub fn all(config: &Config) -> Vec<Self> {
        let campaigns = config.campaign.iter();
        let fits = campaigns.flat_map(|(name, of)| of.models.iter().map(move |&m| (name, m)));
        fits.filter_map(|(campaign, model)| Self::new(config, campaign, model)).collect()
    }

    /// Those of one model; `None` if there is no such campaign.
    pub fn new(config: &Config, campaign: &str, model: Model) -> Option<Self> {
        let of = config.campaign.get(campaign)?;
        let value = FitCampaign { weights: of.weights, free: of.free.get(&model).cloned() };
        let mut input = Self {
            campaign: NamedEntry { name: campaign.to_owned(), value },
            model,
            robot: NamedEntry::of(&config.robot, &of.robot)?,
            gait: NamedEntry::of(&config.gait, &of.gait)?,
            fit: config.fit.clone(),
        };
        let free = input.free();
        let frees = |is: fn(Parameter) -> bool| free.iter().any(|one| is(one.parameter));
        let (fit, unread) = (&mut input.fit, Config::default().fit);
        if free.is_empty() {
            (fit.starts, fit.profiles) = (1, false);
        }
        if !frees(|one| one.family() == Family::Skid) {
            fit.skid_bounds_kg_s = unread.skid_bounds_kg_s;
        }
        if !frees(|one| one.family() == Family::Roll) {
            fit.roll_bounds_kg_s = unread.roll_bounds_kg_s;
        }
        if !frees(|one| one == Parameter::Stiffness) {
            fit.stiffness_bounds_nm_rad = unread.stiffness_bounds_nm_rad;
        }
        if !frees(|one| one == Parameter::Damping) {
            fit.damping_bounds_nm_s_rad = unread.damping_bounds_nm_s_rad;
        }
        Some(input)
    }

    /// Hash of what the fit reads of each trial. Numbers are printed such that they can be told apart.
    pub fn trials(&self, data: &FitData) -> BTreeMap<String, String> {
        let of_trial = |measurement: Measurement| {
            let cycles = data.cycles.get(&measurement.trial).map_or(&[][..], Vec::as_slice);
            let used: Vec<&CycleRow> = cycles.iter().filter(|row| row.used).collect();
            let hash = hash(format!("{measurement:?} {used:?}").as_bytes());
            (measurement.trial, hash)
        };
        measurements(self, data).into_iter().map(of_trial).collect()
    }

    /// Hash of what trials of other kinds say of the robot.
    pub fn robots(&self, data: &FitData) -> String {
        let of_robot = data.robots.iter().filter(|row| row.robot == self.robot.name);
        let rows: Vec<[f64; 3]> = of_robot
            .map(|row| {
                [row.stiffness_nm_rad, row.damping_nm_s_rad, row.roll_sum_kg_s].map(|of| of.value)
            })
            .collect();
        hash(format!("{rows:?}").as_bytes())
    }

    /// The parameters that the fit frees, with their bounds.
    pub fn free(&self) -> Vec<FreeParameter> {
        let list = self.campaign.value.free.as_ref();
        FreeParameter::free_in(self.model, &self.gait.value.to_gait(), &self.fit, list)
    }
}
