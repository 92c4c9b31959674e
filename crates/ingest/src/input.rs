//! Configuration of the ingest stage.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use trilink_mocap::Recording;
use trilink_robot::{Gait, Robot};
use trilink_tables::config::{Config, GaitConfig, Ingest, Markers, NamedEntry, RobotConfig, Vicon};
use trilink_tables::trial::{Trial, TrialError, TrialKind};

use super::error::{Problem, TrialFailure};
use super::markers::layout::{apply_aliases, locate};

/// Settings for reading marker files, common to all trials.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct IngestSettings {
    pub vicon: Vicon,
    pub ingest: Ingest,
    pub markers: Markers,
}

/// Configuration for processing one trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct IngestInput {
    #[serde(flatten)]
    pub settings: IngestSettings,
    pub robot: NamedEntry<RobotConfig>,
    /// Labels of the layout by the labels that replace them in the file.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    aliases: BTreeMap<String, String>,
    /// Commanded gait; `None` unless the trial's kind is `gait`.
    pub gait: Option<NamedEntry<GaitConfig>>,
}

impl IngestSettings {
    pub fn new(config: &Config) -> Self {
        let Config { vicon, ingest, markers, .. } = config;
        Self { vicon: vicon.clone(), ingest: ingest.clone(), markers: markers.clone() }
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
        let campaign = trial.campaign.as_ref().and_then(|name| config.campaign.get(name));
        let robot = trial.robot_name(config)?.to_owned();
        let markers = config.markers_of(&robot).clone();
        let mut robot = NamedEntry::find(&config.robot, &robot)?;
        // Parameter deviations are read only by fits.
        robot.value.clear_deviations();
        let gait = match campaign {
            Some(campaign) => Some(NamedEntry::find(&config.gait, &campaign.gait)?),
            None => None,
        };
        let settings = IngestSettings { markers, ..IngestSettings::new(config) };
        Some(Self { settings, robot, aliases: trial.aliases.clone(), gait })
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

    pub(super) fn robot(&self) -> Robot {
        self.robot.value.to_robot()
    }

    /// Returns the commanded gait and its frequency, rad/s; `None` unless the trial's kind is `gait`.
    pub(super) fn command(&self, trial: &Trial) -> Option<(Gait, f64)> {
        Some((self.gait.as_ref()?.value.to_gait(), trial.omega_rad_s?))
    }
}
