//! Configuration of the ingest stage.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use trilink_mocap::Recording;
use trilink_robot::AnyRobot;
use trilink_tables::config::{
    Config, GaitConfig, Ingest, MarkerLayout, NamedEntry, RobotConfig, Vicon,
};
use trilink_tables::trial::{Trial, TrialError, TrialKind};

use super::error::{Problem, TrialFailure};
use super::geometry::Geometry;
use super::markers::layout::{apply_aliases, locate};
use super::{Command, Subject};

/// Settings for reading marker files, common to all trials.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct IngestSettings {
    pub vicon: Vicon,
    pub ingest: Ingest,
    pub markers: MarkerLayout,
}

/// Configuration for processing one trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct IngestInput {
    #[serde(flatten)]
    pub settings: IngestSettings,
    robot: NamedEntry<RobotConfig>,
    /// `None` unless the trial's kind is `gait`.
    gait: Option<NamedEntry<GaitConfig>>,
    /// Aliases: the label of the layout for each label in the file that stands for it.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    aliases: BTreeMap<String, String>,
}

impl IngestSettings {
    /// Selects the settings, with the marker layout of robots that have none of their own.
    pub fn new(config: &Config) -> Self {
        let Config { vicon, ingest, markers, .. } = config;
        Self { vicon: vicon.clone(), ingest: ingest.clone(), markers: markers.into() }
    }

    /// Returns the frame rate of a file, Hz: the rate that the file states, or `vicon.rate_hz` if it states none. The
    /// two must be equal unless `vicon.rate_from_file` is set.
    pub(super) fn frame_rate(&self, file: &Recording) -> Result<f64, Problem> {
        let needed_hz = self.vicon.rate_hz;
        match file.rate_hz {
            Some(found_hz) if found_hz != needed_hz && !self.vicon.rate_from_file => {
                Err(Problem::Rate { found_hz, needed_hz })
            }
            None if self.vicon.rate_from_file => Err(Problem::NoRate),
            rate_hz => Ok(rate_hz.unwrap_or(needed_hz)),
        }
    }

    /// Returns the length of the longest gap to be filled, frames.
    pub(super) fn max_gap_frames(&self, rate_hz: f64) -> usize {
        (self.ingest.max_gap_s * rate_hz + 1e-6) as usize
    }
}

impl IngestInput {
    /// Selects the configuration for processing a trial.
    ///
    /// # Errors
    /// Returns an error if the trial's entry contradicts the configuration or names a part of it that is incomplete.
    pub fn new(config: &Config, trial: &Trial) -> Result<Self, TrialError> {
        trial.check(config)?;
        Self::select(config, trial).ok_or_else(|| TrialError {
            trial: trial.id.clone(),
            key: if trial.kind == TrialKind::Gait { "campaign" } else { "robot" },
            found: "a robot or a gait that is not configured".to_owned(),
            needed: "one whose robot and gait are defined in pipeline.toml".to_owned(),
        })
    }

    fn select(config: &Config, trial: &Trial) -> Option<Self> {
        let name = trial.robot_name(config)?.to_owned();
        let markers = config.marker_layout(&name)?;
        let robot = NamedEntry::find(&config.robot, &name)?
            .map(|robot| robot.without_wheel_names().without_deviations());
        let gait = match trial.campaign.as_ref().and_then(|of| config.campaign.get(of)) {
            Some(campaign) => Some(NamedEntry::find(&config.gait, &campaign.gait)?),
            None => None,
        };
        let settings = IngestSettings { markers, ..IngestSettings::new(config) };
        Some(Self { settings, robot, gait, aliases: trial.aliases.clone() })
    }

    /// Checks that a file has the markers of the configured layout; nothing else is checked.
    ///
    /// # Errors
    /// Returns an error if a marker is missing or ambiguous, or if the file cannot be read.
    pub fn check_labels(&self, path: &Path) -> Result<(), TrialFailure> {
        let IngestSettings { vicon: Vicon { unit, .. }, markers, .. } = &self.settings;
        let file = self.with_layout_labels(trilink_mocap::read_markers(path, *unit)?);
        locate(markers, &file).map(drop).map_err(|problem| problem.in_file(path))
    }

    /// Leaves out the markers to be ignored and replaces labels by those of the layout.
    pub(super) fn with_layout_labels(&self, file: Recording) -> Recording {
        let mut file = file.without(&self.settings.vicon.ignore);
        apply_aliases(&self.aliases, &mut file);
        file
    }

    /// Returns the robot of the trial with the commands of its joints.
    pub(super) fn subject(&self, trial: &Trial) -> Subject {
        let gait = self.gait.as_ref().map_or_else(GaitConfig::default, |gait| gait.value.clone());
        let (robot, gait) = self.robot.value.setup(&gait);
        let omega_rad_s = trial.omega_rad_s.filter(|_| self.gait.is_some());
        let joints = gait.joints[..robot.joints()].to_vec();
        let geometry = match &robot {
            AnyRobot::ThreeLinks(robot) => Geometry::of_robot(robot),
            AnyRobot::Chain(chain) => Geometry::new(chain),
        };
        let command = omega_rad_s.map(|omega_rad_s| Command { joints, omega_rad_s });
        Subject { geometry, command, robot }
    }
}
