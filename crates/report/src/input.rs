//! Configuration of the report.

use std::collections::BTreeSet;

use serde::Serialize;
use trilink_base::files::relative;
use trilink_plot::Print;
use trilink_robot::metrics::Metric;
use trilink_robot::{AnyGait, AnyRobot, Gait, Model, Robot};
use trilink_tables::config::{
    Campaign, Compare, Config, GaitConfig, MarkerLayout, Models, Paths, Report, RobotConfig,
    RobotGroup, SigmaKind, Smoothing,
};

use super::looks::ModelLook;

/// Returns the configured width and font size of printed figures.
pub fn print_of(report: &Report) -> Print {
    Print { width_mm: report.width_mm.mm(), font_pt: report.font_pt }
}

/// Configuration of a report. Its serialised form contains the requested trial pages and the configuration printed on
/// the report page, which together determine the other fields.
#[derive(Debug, Clone, Serialize)]
pub struct ReportInput {
    #[serde(skip)]
    pub paths: Paths,
    #[serde(skip)]
    pub sigma: SigmaKind,
    /// Names of the trials whose pages were explicitly requested, in this run or an earlier one.
    pub asked_pages: BTreeSet<String>,
    /// Configuration with paths relative to the report page.
    #[serde(flatten)]
    shown: Config,
}

impl ReportInput {
    pub fn new(config: &Config, asked_pages: BTreeSet<String>) -> Self {
        let mut shown = config.clone();
        let Paths { raw, derived, reports, baseline, history, .. } = &mut shown.paths;
        for path in raw.iter_mut().chain([derived, reports, baseline, history]) {
            *path = relative(&config.paths.reports, path).into();
        }
        Self { paths: config.paths.clone(), sigma: config.fit.sigma, asked_pages, shown }
    }

    /// Returns the names of the campaigns of all robots.
    pub(crate) fn campaigns(&self) -> impl Iterator<Item = &str> {
        self.shown.campaign.keys().map(String::as_str)
    }

    pub fn models(&self) -> &Models {
        &self.shown.model
    }

    /// Returns the colour and dashes with which a model is plotted.
    pub fn look(&self, model: Model) -> ModelLook {
        ModelLook::new(model, self.models())
    }

    /// Returns the tolerances for changes since the baseline.
    pub fn tolerances(&self) -> &Compare {
        &self.shown.compare
    }

    /// Returns the maximum number of trial pages, not counting those that were explicitly requested.
    pub fn trial_pages(&self) -> usize {
        self.shown.report.trial_pages
    }

    /// Returns the method by which the ingest smooths the coordinates.
    pub fn smoothing(&self) -> Smoothing {
        self.shown.ingest.smoothing
    }

    /// Returns the width and font size of printed figures.
    pub fn print(&self) -> Print {
        print_of(&self.shown.report)
    }

    /// Returns the robot and gait of a campaign in SI units, or `None` if either is not configured.
    pub fn campaign_setup(&self, campaign: &str) -> Option<(Robot, Gait)> {
        self.shown.campaign_setup(campaign)
    }

    /// Returns the robot and gait of a campaign, whatever the number of links, or `None` if either is not configured.
    pub fn setup(&self, campaign: &str) -> Option<(AnyRobot, AnyGait)> {
        self.shown.setup(campaign)
    }

    /// Returns whether the robot of a campaign is a chain.
    pub(crate) fn is_chain(&self, campaign: &str) -> bool {
        self.shown.robot_of(campaign).is_some_and(|robot| robot.chain().is_some())
    }

    /// Returns the names of the links of a campaign's robot by number.
    pub(crate) fn links(&self, campaign: &str) -> Vec<String> {
        match self.shown.chain_setup(campaign) {
            None => RobotConfig::THREE_LINKS.map(str::to_owned).into(),
            Some(chain) => chain.names_by_number(),
        }
    }

    /// Returns whether a link of a campaign's robot, given its number, has a wheel; true for every link of a campaign
    /// that is not configured.
    pub(crate) fn has_wheel(&self, campaign: &str, number: usize) -> bool {
        let metric = Metric::SIGMA.get(number).copied();
        let setup = self.setup(campaign);
        setup.is_none_or(|(robot, _)| metric.is_some_and(|metric| robot.has_metric(metric)))
    }

    /// Returns the indices of the joints of a campaign's robot whose angle is not commanded; none if the campaign is not
    /// configured.
    pub(crate) fn free_joints(&self, campaign: &str) -> Vec<usize> {
        let setup = self.setup(campaign);
        let joints = setup.iter().flat_map(|(robot, gait)| {
            (0..robot.joints()).filter(|joint| robot.is_free(*joint, gait))
        });
        joints.collect()
    }

    /// Returns a robot in SI units, or `None` if it is not configured. The commands of a chain are zero.
    pub(crate) fn robot(&self, name: &str) -> Option<AnyRobot> {
        self.shown.robot.get(name).map(|robot| robot.to_robot(&GaitConfig::default()))
    }

    /// Returns the configuration of a campaign's robot, or `None` if it is not configured.
    pub(crate) fn configured_robot(&self, campaign: &str) -> Option<&RobotConfig> {
        self.shown.robot_of(campaign)
    }

    /// Returns the name of a campaign's robot, or `None` if the campaign is not configured.
    pub(crate) fn robot_name(&self, campaign: &str) -> Option<&str> {
        Some(self.names(campaign)?.0)
    }

    /// Returns the group of robots with this name ([`RobotGroup::name`]) whose campaigns are fitted together; `None` if the
    /// configuration asks for no such fit.
    pub(crate) fn robot_group(&self, name: &str) -> Option<RobotGroup> {
        self.shown.robot_groups().into_iter().find(|group| group.name() == name)
    }

    /// Returns the names of a campaign's robot and gait, or `None` if the campaign is not configured.
    pub(crate) fn names(&self, campaign: &str) -> Option<(&str, &str)> {
        let Campaign { robot, gait, .. } = self.shown.campaign.get(campaign)?;
        Some((robot, gait))
    }

    /// Returns the marker layout of a robot; `None` for a robot without one.
    pub(crate) fn marker_layout(&self, robot: &str) -> Option<MarkerLayout> {
        self.shown.marker_layout(robot)
    }

    /// Returns the configuration as TOML, including default values.
    pub fn configuration(&self) -> String {
        toml::to_string(&self.shown).unwrap_or_default()
    }
}
