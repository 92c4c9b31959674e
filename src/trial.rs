//! `trials.toml`: which recordings a trial folder holds.

use std::collections::BTreeSet;
use std::path::{Component, Path};

use serde::{Deserialize, Serialize};

use crate::config::{Config, ConfigError, nearest, parse_toml};
use crate::named::named;

/// Name of the list inside a trial folder.
pub const TRIALS_FILE: &str = "trials.toml";

/// Name of the planted truth inside a folder of synthetic trials.
pub const TRUTH_FILE: &str = "truth.json";

named! {
    /// What was recorded.
    pub enum TrialKind {
        /// The robot driven by its campaign's gait.
        Gait = "gait",
        /// The passive joint let go from rest (Fig. 8b).
        JointRelease = "joint-release",
        /// The straight robot pushed; gives the roll resistance.
        CoastDown = "coast-down",
    }
}

/// One recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trial {
    /// Unique name, `[A-Za-z0-9._-]{1,64}`.
    pub id: String,
    /// Marker file inside the folder; `.csv` or `.c3d`, or one of them with `.gz`.
    pub file: String,
    pub kind: TrialKind,
    /// Name of a `[campaign.*]`; gait trials only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub campaign: Option<String>,
    /// Name of a `[robot.*]`; the other kinds only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot: Option<String>,
    /// Commanded frequency; gait trials only, rad/s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub omega_rad_s: Option<f64>,
    /// Instead of `ingest.smoothing_window`, samples, 5 to 30.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoothing_window: Option<usize>,
}

/// The list in `trials.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialList {
    #[serde(default)]
    pub trial: Vec<Trial>,
}

impl TrialList {
    /// Reads the list of a trial folder. What is wrong with a single trial, such as a missing
    /// file or an unknown campaign, is left to [`Trial::check`], so that the others can go on.
    ///
    /// # Errors
    /// The list cannot be read or parsed, or an id is malformed or used twice.
    pub fn load(folder: &Path) -> Result<Self, ConfigError> {
        let path = folder.join(TRIALS_FILE);
        let text = std::fs::read_to_string(&path)
            .map_err(|source| ConfigError::Read { path: path.clone(), source })?;
        let list: Self = parse_toml(&path, &text)?;
        if list.trial.is_empty() {
            return Err(ConfigError::Value {
                path,
                key: "trial".to_owned(),
                found: "an empty list".to_owned(),
                needed: "at least one [[trial]]".to_owned(),
            });
        }
        let mut ids = BTreeSet::new();
        for (i, trial) in list.trial.iter().enumerate() {
            let error = |needed: &str| ConfigError::Value {
                path: path.clone(),
                key: format!("trial[{i}].id"),
                found: format!("{:?}", trial.id),
                needed: needed.to_owned(),
            };
            if !is_valid_id(&trial.id) {
                return Err(error(
                    "1 to 64 of the characters A-Z a-z 0-9 . _ -, not starting with a dot",
                ));
            }
            // Some disks do not tell capitals from small letters.
            if !ids.insert(trial.id.to_ascii_lowercase()) {
                return Err(error("an id that no other trial has"));
            }
        }
        Ok(list)
    }
}

/// Whether an id can name a trial and its tables.
pub fn is_valid_id(id: &str) -> bool {
    (1..=64).contains(&id.len())
        && !id.starts_with('.')
        && id.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"._-".contains(&byte))
}

/// What is wrong with one entry of `trials.toml`.
#[derive(Debug, Clone, thiserror::Error, PartialEq, Eq)]
#[error("trials.toml, trial `{trial}`: key `{key}`: found {found}, needed {needed}")]
pub struct TrialError {
    pub trial: String,
    pub key: &'static str,
    pub found: String,
    pub needed: String,
}

impl Trial {
    /// Checks the entry against the configuration.
    ///
    /// # Errors
    /// Names the key, what was found and what was needed.
    pub fn check(&self, config: &Config) -> Result<(), TrialError> {
        let error = |key, found: String, needed: String| TrialError {
            trial: self.id.clone(),
            key,
            found,
            needed,
        };
        let mut inside = Path::new(&self.file).components();
        if self.file.is_empty() || !inside.all(|part| matches!(part, Component::Normal(_))) {
            let needed = "a file inside the trial folder".to_owned();
            return Err(error("file", format!("{:?}", self.file), needed));
        }
        if let Some(window) = self.smoothing_window
            && !(5..=30).contains(&window)
        {
            let needed = "a whole number from 5 to 30".to_owned();
            return Err(error("smoothing_window", window.to_string(), needed));
        }
        let foreign: [(&'static str, bool); 2] = match self.kind {
            TrialKind::Gait => [("robot", self.robot.is_some()), ("", false)],
            TrialKind::JointRelease | TrialKind::CoastDown => {
                [("campaign", self.campaign.is_some()), ("omega_rad_s", self.omega_rad_s.is_some())]
            }
        };
        if let Some((key, _)) = foreign.into_iter().find(|(_, is_there)| *is_there) {
            let needed = format!("no such key for a trial of kind {}", self.kind.name());
            return Err(error(key, "a value".to_owned(), needed));
        }
        let (key, name, family): (_, _, Vec<&str>) = match self.kind {
            TrialKind::Gait => {
                ("campaign", &self.campaign, config.campaign.keys().map(String::as_str).collect())
            }
            TrialKind::JointRelease | TrialKind::CoastDown => {
                ("robot", &self.robot, config.robot.keys().map(String::as_str).collect())
            }
        };
        let name = name.as_deref().unwrap_or_default();
        if !family.contains(&name) {
            let found = if name.is_empty() { "nothing".into() } else { format!("`{name}`") };
            let hint = nearest(name, family.iter().copied())
                .map_or(String::new(), |near| format!(" (did you mean `{near}`?)"));
            let needed = format!("one of `{}` of pipeline.toml{hint}", family.join("`, `"));
            return Err(error(key, found, needed));
        }
        if self.kind == TrialKind::Gait
            && !self.omega_rad_s.is_some_and(|omega| omega > 0.0 && omega.is_finite())
        {
            let found = self.omega_rad_s.map_or("nothing".into(), |omega| omega.to_string());
            return Err(error("omega_rad_s", found, "a frequency above 0".into()));
        }
        Ok(())
    }
}
