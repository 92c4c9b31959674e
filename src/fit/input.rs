//! What a fit reads of the configuration.

use serde::Serialize;

use super::FreeParameter;
use crate::config::{Config, Fit, Free, GaitConfig, Named, RobotConfig, Weights};
use crate::robot::{Family, Model, Parameter};

/// What one model of one campaign is fitted with.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FitInput {
    pub campaign: Named<FitCampaign>,
    pub model: Model,
    pub robot: Named<RobotConfig>,
    pub gait: Named<GaitConfig>,
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
            campaign: Named { name: campaign.to_owned(), value },
            model,
            robot: Named::of(&config.robot, &of.robot)?,
            gait: Named::of(&config.gait, &of.gait)?,
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

    /// The parameters that the fit frees, with their bounds.
    pub fn free(&self) -> Vec<FreeParameter> {
        let list = self.campaign.value.free.as_ref();
        FreeParameter::free_in(self.model, &self.gait.value.to_gait(), &self.fit, list)
    }
}
