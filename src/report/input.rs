//! What the report reads of the configuration.

use std::collections::BTreeMap;

use serde::Serialize;

use super::paths::relative;
use crate::config::{Config, Paths, SigmaKind};
use crate::robot::{Gait, Robot};

/// What a report is made with. Serialised it is the configuration that the page prints, which
/// decides all else.
#[derive(Debug, Clone, Serialize)]
pub struct ReportInput {
    #[serde(skip)]
    pub paths: Paths,
    #[serde(skip)]
    pub campaign: BTreeMap<String, ReportCampaign>,
    #[serde(skip)]
    pub sigma: SigmaKind,
    /// With paths as seen from the page.
    #[serde(flatten)]
    shown: Config,
}

/// What a report reads of a campaign.
#[derive(Debug, Clone)]
pub struct ReportCampaign {
    /// Names of the entries in the configuration.
    pub robot: String,
    pub gait: String,
    /// Both in SI units; missing where an entry is.
    setup: Option<(Robot, Gait)>,
}

impl ReportInput {
    pub fn new(config: &Config) -> Self {
        let campaigns = config.campaign.iter().map(|(name, of)| {
            let setup = config.campaign_setup(name);
            (name.clone(), ReportCampaign { robot: of.robot.clone(), gait: of.gait.clone(), setup })
        });
        let (campaign, mut shown) = (campaigns.collect(), config.clone());
        let Paths { raw, derived, reports } = &mut shown.paths;
        for path in [raw, derived, reports] {
            *path = relative(&config.paths.reports, path).into();
        }
        Self { paths: config.paths.clone(), campaign, sigma: config.fit.sigma, shown }
    }

    /// The robot and gait of a campaign, in SI units.
    pub fn campaign_setup(&self, campaign: &str) -> Option<(Robot, Gait)> {
        self.campaign.get(campaign)?.setup.clone()
    }

    /// The configuration as TOML, defaults too.
    pub fn configuration(&self) -> String {
        toml::to_string(&self.shown).unwrap_or_default()
    }
}
