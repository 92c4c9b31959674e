//! What a trial's tables were computed from, in one short text.

use serde::Serialize;

use crate::config::{Config, GaitConfig, Ingest, Markers, RobotConfig, Vicon};
use crate::trial::Trial;

/// Everything but the marker file that a trial's tables depend on.
#[derive(Serialize)]
struct Dependencies<'a> {
    trial: &'a Trial,
    vicon: &'a Vicon,
    ingest: &'a Ingest,
    markers: &'a Markers,
    robot: Option<&'a RobotConfig>,
    gait: Option<&'a GaitConfig>,
}

/// Of one trial: blake3 in hexadecimal of the marker file and of the configuration that is
/// used. `file` is `None` if it cannot be read.
pub(super) fn of_trial(trial: &Trial, config: &Config, file: Option<&[u8]>) -> String {
    let campaign = trial.campaign.as_ref().and_then(|name| config.campaign.get(name));
    let robot = campaign.map(|campaign| &campaign.robot).or(trial.robot.as_ref());
    let dependencies = Dependencies {
        trial,
        vicon: &config.vicon,
        ingest: &config.ingest,
        markers: &config.markers,
        robot: robot.and_then(|name| config.robot.get(name)),
        gait: campaign.and_then(|campaign| config.gait.get(&campaign.gait)),
    };
    let settings = serde_json::to_vec(&dependencies)
        .expect("numbers, names and maps with text keys can always be written as JSON");
    let mut hasher = blake3::Hasher::new();
    // The length in front keeps the two parts apart.
    hasher.update(&(settings.len() as u64).to_le_bytes());
    hasher.update(&settings);
    if let Some(file) = file {
        hasher.update(file);
    }
    hasher.finalize().to_hex().to_string()
}

/// Of all trials in the order of the list.
pub(super) fn of_all<'a>(trials: impl Iterator<Item = &'a str>) -> String {
    let mut hasher = blake3::Hasher::new();
    trials.for_each(|fingerprint| {
        hasher.update(fingerprint.as_bytes());
    });
    hasher.finalize().to_hex().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trial::TrialKind;

    #[test]
    fn only_what_is_used_changes_the_fingerprint() {
        let trial = Trial {
            id: "a".into(),
            file: "a.csv".into(),
            kind: TrialKind::Gait,
            campaign: Some("kinematic-skewed".into()),
            robot: None,
            omega_rad_s: Some(3.9),
            smoothing_window: None,
        };
        let print = |change: &dyn Fn(&mut Config)| {
            let mut config = Config::default();
            change(&mut config);
            of_trial(&trial, &config, Some(b"data"))
        };
        let original = print(&|_| ());
        assert_eq!(original.len(), 64);
        assert_eq!(print(&|config| config.fit.starts = 99), original);
        assert_eq!(print(&|config| config.paths.raw = "x".into()), original);
        assert_ne!(print(&|config| config.gait.clear()), original);
        assert_ne!(print(&|config| config.vicon.rate_hz = 100.0), original);
        assert_ne!(print(&|config| config.ingest.skip_cycles = 3), original);
        assert_ne!(print(&|config| config.markers.link0.clear()), original);
        assert_ne!(print(&|config| config.robot.clear()), original);
        assert_ne!(of_trial(&trial, &Config::default(), Some(b"datb")), original);
        assert_ne!(of_trial(&trial, &Config::default(), None), original);
    }
}
