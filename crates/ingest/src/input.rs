//! What the ingest reads of the configuration.

use std::path::Path;

use serde::Serialize;
use trilink_mocap::Recording;
use trilink_robot::{Gait, Robot};
use trilink_tables::config::{Config, GaitConfig, Ingest, Markers, NamedEntry, RobotConfig, Vicon};
use trilink_tables::trial::{Trial, TrialError, TrialKind};

use super::error::{Problem, TrialFailure};
use super::markers::layout::locate;

/// What every marker file is read with.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct IngestSettings {
    pub vicon: Vicon,
    pub ingest: Ingest,
    pub markers: Markers,
}

/// What one trial is processed with.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct IngestInput {
    #[serde(flatten)]
    pub settings: IngestSettings,
    pub robot: NamedEntry<RobotConfig>,
    /// Of trials of kind `gait`.
    pub gait: Option<NamedEntry<GaitConfig>>,
}

impl IngestSettings {
    pub fn new(config: &Config) -> Self {
        let Config { vicon, ingest, markers, .. } = config;
        Self { vicon: vicon.clone(), ingest: ingest.clone(), markers: markers.clone() }
    }

    /// The file's frame rate, Hz, if it may be the one. If the file has none, the configured one,
    /// unless each file has to state its own.
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

    /// Longest gap that is filled, frames.
    pub(super) fn max_gap_frames(&self, rate_hz: f64) -> usize {
        (self.ingest.max_gap_s * rate_hz + 1e-6) as usize
    }
}

impl IngestInput {
    /// What a trial is processed with.
    ///
    /// # Errors
    /// The trial's entry does not go with the configuration.
    pub fn new(config: &Config, trial: &Trial) -> Result<Self, TrialError> {
        trial.check(config)?;
        let found = || {
            let campaign = trial.campaign.as_ref().and_then(|name| config.campaign.get(name));
            let robot = campaign.map(|campaign| &campaign.robot).or(trial.robot.as_ref())?;
            let mut robot = NamedEntry::of(&config.robot, robot)?;
            // Only a fit reads it.
            robot.value.forget_deviations();
            let gait = match campaign {
                Some(campaign) => Some(NamedEntry::of(&config.gait, &campaign.gait)?),
                None => None,
            };
            Some(Self { settings: IngestSettings::new(config), robot, gait })
        };
        found().ok_or_else(|| TrialError {
            trial: trial.id.clone(),
            key: if trial.kind == TrialKind::Gait { "campaign" } else { "robot" },
            found: "a name without a robot or a gait".to_owned(),
            needed: "one that pipeline.toml describes in full".to_owned(),
        })
    }

    /// Checks that a file has the markers of the layout, and nothing else.
    ///
    /// # Errors
    /// It has not, or cannot be read.
    pub fn check_labels(&self, path: &Path) -> Result<(), TrialFailure> {
        let IngestSettings { vicon: Vicon { unit, ignore, .. }, markers, .. } = &self.settings;
        let file = trilink_mocap::read_markers(path, *unit)?.without(ignore);
        locate(markers, &file).map(drop).map_err(|problem| problem.of(path))
    }

    pub(super) fn robot(&self) -> Robot {
        self.robot.value.to_robot()
    }

    /// The commanded gait of a trial of kind `gait` and its frequency, rad/s.
    pub(super) fn command(&self, trial: &Trial) -> Option<(Gait, f64)> {
        Some((self.gait.as_ref()?.value.to_gait(), trial.omega_rad_s?))
    }
}
