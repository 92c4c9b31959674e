//! What a trial's tables were computed from, in short texts.

use std::io;
use std::path::Path;

use serde::Serialize;

use super::plan::version;
use crate::config::{Config, GaitConfig, Ingest, Markers, RobotConfig, Vicon};
use crate::store::{CONFIGURATION, Parts, Stamp, hash};
use crate::trial::Trial;

const ENTRY: &str = "the entry in trials.toml";
/// Part of every trial that is known once the file is looked at.
pub(super) const MARKER_FILE: &str = "the marker file";
/// Part of trials that failed: their messages name the file.
pub(super) const PLACE: &str = "the place of the marker file";

/// The keys of the configuration that a trial's tables depend on.
#[derive(Serialize)]
struct Dependencies<'a> {
    vicon: &'a Vicon,
    ingest: &'a Ingest,
    markers: &'a Markers,
    robot: Option<&'a RobotConfig>,
    gait: Option<&'a GaitConfig>,
    /// What is wrong with the entry, which is said with names of the configuration.
    wrong: Option<String>,
}

/// Everything but the marker file that a trial's tables depend on.
pub(super) fn parts(trial: &Trial, config: &Config, folder: &Path) -> Parts {
    let campaign = trial.campaign.as_ref().and_then(|name| config.campaign.get(name));
    let robot = campaign.map(|campaign| &campaign.robot).or(trial.robot.as_ref());
    let dependencies = Dependencies {
        vicon: &config.vicon,
        ingest: &config.ingest,
        markers: &config.markers,
        robot: robot.and_then(|name| config.robot.get(name)),
        gait: campaign.and_then(|campaign| config.gait.get(&campaign.gait)),
        wrong: trial.check(config).err().map(|error| error.to_string()),
    };
    let place = folder.join(&trial.file).display().to_string();
    Parts::from([
        version(),
        (ENTRY.to_owned(), hash_of(trial)),
        (CONFIGURATION.to_owned(), hash_of(&dependencies)),
        (PLACE.to_owned(), place),
    ])
}

/// Of the marker file: its content, or why there is none.
pub(super) fn of_file(file: Option<&io::Result<Stamp>>) -> String {
    match file {
        Some(Ok(stamp)) => stamp.blake3.clone(),
        Some(Err(error)) => format!("unreadable: {}", error.kind()),
        None => "not read".to_owned(),
    }
}

/// Of all the parts of one trial; goes into its tables.
pub(super) fn of_parts(parts: &Parts) -> String {
    hash_of(parts)
}

/// Of all trials in the order of the list.
pub(super) fn of_all<'a>(trials: impl Iterator<Item = &'a Parts>) -> String {
    let mut hasher = blake3::Hasher::new();
    trials.for_each(|parts| {
        hasher.update(of_parts(parts).as_bytes());
    });
    hasher.finalize().to_hex().to_string()
}

fn hash_of(value: &impl Serialize) -> String {
    let json = serde_json::to_vec(value)
        .expect("numbers, names and maps with text keys can always be written as JSON");
    hash(&json)
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
            of_parts(&parts(&trial, &config, Path::new("raw")))
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
    }

    #[test]
    fn a_file_that_cannot_be_read_is_told_from_one_that_is_not_looked_at() {
        let gone = Stamp::read(Path::new("/nowhere/a.csv"));
        assert_eq!(of_file(Some(&gone)), "unreadable: entity not found");
        assert_eq!(of_file(None), "not read");
    }
}
