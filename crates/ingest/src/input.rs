//! Configuration of the ingest stage.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use trilink_mocap::Recording;
use trilink_robot::{Gait, Joint, Robot};
use trilink_tables::config::{
    ChainCampaign, ChainGait, ChainRobot, Config, GaitConfig, Ingest, MarkerLayout, NamedEntry,
    RobotConfig, Vicon,
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
    #[serde(flatten)]
    setup: Setup,
    /// Labels of the layout by the labels that replace them in the file.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    aliases: BTreeMap<String, String>,
}

/// Robot of a trial and its commanded gait.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
enum Setup {
    ThreeLinks {
        robot: NamedEntry<RobotConfig>,
        /// `None` unless the trial's kind is `gait`.
        gait: Option<NamedEntry<GaitConfig>>,
    },
    Chain {
        robot: NamedEntry<ChainRobot>,
        /// `None` unless the trial's kind is `gait`.
        gait: Option<Box<NamedEntry<ChainGait>>>,
    },
}

impl IngestSettings {
    /// Selects the settings, with the marker layout of robots that have none of their own.
    pub fn new(config: &Config) -> Self {
        let Config { vicon, ingest, markers, .. } = config;
        Self { vicon: vicon.clone(), ingest: ingest.clone(), markers: markers.clone().into() }
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
            found: "an entry without a robot or without a gait".to_owned(),
            needed: "an entry whose robot and gait are defined in pipeline.toml".to_owned(),
        })
    }

    fn select(config: &Config, trial: &Trial) -> Option<Self> {
        let name = trial.robot_name(config)?.to_owned();
        let markers = config.marker_layout(&name)?;
        let campaign = trial.campaign.as_ref();
        let setup = if let Some(robot) = NamedEntry::find(&config.chains.robot, &name) {
            let robot = robot.map(ChainRobot::without_wheel_names);
            let gait = match campaign.and_then(|of| config.chains.campaign.get(of)) {
                Some(ChainCampaign { gait, .. }) => Some(Box::new(NamedEntry {
                    name: gait.clone(),
                    value: config.chain_gait(gait)?,
                })),
                None => None,
            };
            Setup::Chain { robot, gait }
        } else {
            let mut robot = NamedEntry::find(&config.robot, &name)?;
            // Parameter deviations are read only by fits.
            robot.value.clear_deviations();
            let gait = match campaign.and_then(|of| config.campaign.get(of)) {
                Some(campaign) => Some(NamedEntry::find(&config.gait, &campaign.gait)?),
                None => None,
            };
            Setup::ThreeLinks { robot, gait }
        };
        let settings = IngestSettings { markers, ..IngestSettings::new(config) };
        Some(Self { settings, setup, aliases: trial.aliases.clone() })
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

    /// Returns the robot of three links, and its commanded gait with its frequency, rad/s, unless the trial's kind is
    /// other than `gait`; `None` for a chain.
    pub(super) fn three_links(&self, trial: &Trial) -> Option<(Robot, Option<(Gait, f64)>)> {
        let Setup::ThreeLinks { robot, gait } = &self.setup else { return None };
        let gait = gait.as_ref().map(|gait| gait.value.to_gait());
        Some((robot.value.to_robot(), gait.zip(trial.omega_rad_s)))
    }

    /// Returns the robot of the trial with the commands of its joints.
    pub(super) fn subject(&self, trial: &Trial) -> Subject {
        match &self.setup {
            Setup::ThreeLinks { robot, gait } => {
                let robot = robot.value.to_robot();
                let joints = gait.as_ref().map(|gait| gait.value.to_gait().joints.to_vec());
                Subject {
                    geometry: Geometry::of_robot(&robot),
                    command: joints
                        .zip(trial.omega_rad_s)
                        .map(|(joints, omega_rad_s)| Command { joints, omega_rad_s }),
                    robot: robot.into(),
                }
            }
            Setup::Chain { robot, gait } => {
                let at_rest = ChainGait::default();
                let gait = gait.as_ref().map(|gait| &gait.value);
                let chain = robot.value.to_chain(gait.unwrap_or(&at_rest));
                let command = gait.map(|_| {
                    let joints = chain.joints.iter().map(|joint| match joint {
                        Joint::Driven(command) => Some(*command),
                        Joint::Free(_) => None,
                    });
                    let omega_rad_s = trial.omega_rad_s.unwrap_or(f64::NAN);
                    Command { joints: joints.collect(), omega_rad_s }
                });
                Subject { geometry: Geometry::new(&chain), command, robot: chain.into() }
            }
        }
    }
}
