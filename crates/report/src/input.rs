//! What the report reads of the configuration.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use trilink_base::files::relative;
use trilink_plot::Print;
use trilink_robot::{Gait, Model, Robot};
use trilink_tables::config::{
    Campaign, Compare, Config, Markers, Models, Paths, Report, RobotConfig, SigmaKind,
};

use super::looks::ModelLook;

/// What a report is made with. Serialised it is the configuration that the page prints, which
/// decides all else.
#[derive(Debug, Clone, Serialize)]
pub struct ReportInput {
    #[serde(skip)]
    pub paths: Paths,
    #[serde(skip)]
    pub sigma: SigmaKind,
    /// Trials of which a page was asked for.
    pub asked_pages: BTreeSet<String>,
    /// With paths as seen from the page.
    #[serde(flatten)]
    shown: Config,
}

impl ReportInput {
    pub fn new(config: &Config, asked_pages: BTreeSet<String>) -> Self {
        let mut shown = config.clone();
        let Paths { raw, derived, reports, baseline, .. } = &mut shown.paths;
        for path in raw.iter_mut().chain([derived, reports, baseline]) {
            *path = relative(&config.paths.reports, path).into();
        }
        Self { paths: config.paths.clone(), sigma: config.fit.sigma, asked_pages, shown }
    }

    pub fn campaigns(&self) -> &BTreeMap<String, Campaign> {
        &self.shown.campaign
    }

    pub fn models(&self) -> &Models {
        &self.shown.model
    }

    /// How a model is shown.
    pub fn look(&self, model: Model) -> ModelLook {
        ModelLook::new(model, self.models())
    }

    /// Which differences from the baseline are to be expected.
    pub fn tolerances(&self) -> &Compare {
        &self.shown.compare
    }

    /// Most trials of which all get a page.
    pub fn trial_pages(&self) -> usize {
        self.shown.report.trial_pages
    }

    /// The size of figures.
    pub fn print(&self) -> Print {
        let Report { width_mm, font_pt, .. } = self.shown.report;
        Print { width_mm: width_mm.mm(), font_pt }
    }

    /// The robot and gait of a campaign, in SI units; `None` where an entry is missing.
    pub fn campaign_setup(&self, campaign: &str) -> Option<(Robot, Gait)> {
        self.shown.campaign_setup(campaign)
    }

    /// A robot in SI units.
    pub fn robot(&self, name: &str) -> Option<Robot> {
        self.shown.robot.get(name).map(RobotConfig::to_robot)
    }

    /// The robot of a campaign as configured.
    pub(crate) fn configured_robot(&self, campaign: &str) -> Option<&RobotConfig> {
        self.shown.robot.get(&self.shown.campaign.get(campaign)?.robot)
    }

    /// The layout of the markers.
    pub fn markers(&self) -> &Markers {
        &self.shown.markers
    }

    /// The configuration as TOML, defaults too.
    pub fn configuration(&self) -> String {
        toml::to_string(&self.shown).unwrap_or_default()
    }
}
