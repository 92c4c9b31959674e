//! What a trial's entry, the configuration and its marker file say before anything is measured.

use std::path::Path;

use super::error::TrialFailure;
use crate::config::Config;
use crate::robot::{Gait, Robot};
use crate::trial::{Trial, TrialError, TrialKind};
use crate::vicon;

/// The robot, and for a gait trial the gait with its commanded frequency (rad/s).
pub(super) fn setup(
    trial: &Trial,
    config: &Config,
) -> Result<(Robot, Option<(Gait, f64)>), TrialError> {
    let unknown = |key| TrialError {
        trial: trial.id.clone(),
        key,
        found: "a name without a robot or a gait".to_owned(),
        needed: "one that pipeline.toml describes in full".to_owned(),
    };
    if trial.kind == TrialKind::Gait {
        let setup = trial.campaign.as_deref().and_then(|name| config.campaign_setup(name));
        let (robot, gait) = setup.ok_or_else(|| unknown("campaign"))?;
        Ok((robot, trial.omega_rad_s.map(|omega_rad_s| (gait, omega_rad_s))))
    } else {
        let robot = trial.robot.as_deref().and_then(|name| config.robot.get(name));
        Ok((robot.ok_or_else(|| unknown("robot"))?.to_robot(), None))
    }
}

/// The file's frame rate, Hz, if it may be the one. If the file has none, the configured one,
/// unless each file has to say its own.
pub(super) fn frame_rate(
    path: &Path,
    file: &vicon::MarkerFile,
    config: &Config,
) -> Result<f64, TrialFailure> {
    let needed_hz = config.vicon.rate_hz;
    match file.rate_hz {
        Some(found_hz) if found_hz != needed_hz && !config.vicon.rate_from_file => {
            Err(TrialFailure::Rate { path: path.to_owned(), found_hz, needed_hz })
        }
        None if config.vicon.rate_from_file => Err(TrialFailure::NoRate { path: path.to_owned() }),
        rate_hz => Ok(rate_hz.unwrap_or(needed_hz)),
    }
}

/// Longest gap that is filled, frames.
pub(super) fn max_gap_frames(config: &Config, rate_hz: f64) -> usize {
    (config.ingest.max_gap_s * rate_hz + 1e-6) as usize
}
