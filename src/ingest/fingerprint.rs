//! What a trial's tables were computed from, in short texts.

use std::io;
use std::path::Path;

use serde::Serialize;

use super::IngestInput;
use super::plan::version;
use crate::store::{CONFIGURATION, Parts, Stamp, hash};
use crate::trial::{Trial, TrialError};

const ENTRY: &str = "the entry in trials.toml";
/// Part of every trial that is known once the file is looked at.
pub(super) const MARKER_FILE: &str = "the marker file";
/// Part of trials that failed: their messages name the file.
pub(super) const PLACE: &str = "the place of the marker file";

/// Everything but the marker file that a trial's tables depend on; an entry that cannot be used
/// is described with names of the configuration.
pub(super) fn parts(
    trial: &Trial,
    input: &Result<IngestInput, TrialError>,
    folder: &Path,
) -> Parts {
    let settings = match input {
        Ok(input) => hash_of(input),
        Err(error) => hash(error.to_string().as_bytes()),
    };
    let place = folder.join(&trial.file).display().to_string();
    Parts::from([
        version(),
        (ENTRY.to_owned(), hash_of(trial)),
        (CONFIGURATION.to_owned(), settings),
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
    use crate::config::Config;
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
            of_parts(&parts(&trial, &IngestInput::new(&config, &trial), Path::new("raw")))
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
