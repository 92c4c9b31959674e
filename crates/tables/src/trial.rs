//! `trials.toml`: the list of recordings in a trial folder.

mod folders;

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;
use std::io::ErrorKind;
use std::ops::RangeInclusive;
use std::path::{Component, Path};

use serde::{Deserialize, Serialize};

use crate::config::{Config, ConfigError, one_of, parse_toml};
pub use folders::{ListedTrial, TrialFolder, TrialFolders, find_folders};
use trilink_base::files;
use trilink_base::named;
use trilink_base::pattern::matches_label;

/// Name of the trial list in a trial folder.
pub const TRIALS_FILE: &str = "trials.toml";

/// Permitted range of commanded frequencies, rad/s.
pub const OMEGA_RAD_S: RangeInclusive<f64> = 0.01..=1000.0;
/// Permitted range of commanded frequencies as stated in error messages.
pub const NEEDED_OMEGA: &str = "a frequency from 0.01 to 1000 rad/s";

/// File that defines the campaigns and robots, as named in error messages.
const PIPELINE: &str = " of pipeline.toml";

/// Name of the file with the true (known) parameters in a folder of synthetic trials.
pub const TRUTH_FILE: &str = "truth.json";

named! {
    /// Kind of a trial.
    pub enum TrialKind {
        /// The robot is driven by its campaign's gait.
        Gait = "gait",
        /// The passive joint is deflected and released (Fig. 8b of the paper), to measure its stiffness and damping.
        JointRelease = "joint-release",
        /// The straight robot is pushed and coasts, to measure its rolling resistance.
        CoastDown = "coast-down",
    }
}

/// Trial: one recording with its settings, an entry of `trials.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trial {
    /// Name of the trial, `[A-Za-z0-9._-]{1,64}`, which must be unique within the folder.
    pub id: String,
    /// Marker file in the folder: `.csv`, `.c3d`, `.trc`, `.tsv` or `.parquet`, or any of these with `.gz`.
    pub file: String,
    pub kind: TrialKind,
    /// Name of the campaign, an entry `[campaign.NAME]` of the configuration; only for trials of kind `gait`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub campaign: Option<String>,
    /// Name of the robot, an entry `[robot.NAME]` of the configuration; only for kinds other than `gait`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot: Option<String>,
    /// Commanded frequency, rad/s; only for trials of kind `gait`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub omega_rad_s: Option<f64>,
    /// Day of the recording, any text; the name of the folder if it is not given. Friction is assumed to differ between
    /// days.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub day: Option<String>,
    /// Smoothing window for this trial in place of `ingest.smoothing_window`, samples (5 to 30).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoothing_window: Option<usize>,
    /// Aliases: the label of the marker layout for each label in this trial's file that stands for it; those of the list
    /// apply to all its trials.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub aliases: BTreeMap<String, String>,
}

/// Trial list, the content of `trials.toml`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialList {
    /// Patterns for marker files that are not trials, or that are to be left out although they have an entry;
    /// `*` stands for any number of characters, `?` for exactly one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ignore: Vec<String>,
    /// Aliases: the label of the marker layout for each label in the files of this folder that stands for it.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub aliases: BTreeMap<String, String>,
    #[serde(default)]
    pub trial: Vec<Trial>,
    /// Trials that [`TrialList::load`] has removed from `trial` because their files match `ignore`.
    #[serde(skip)]
    pub ignored: Vec<Trial>,
}

impl TrialList {
    /// Reads the trial list of a folder, without the trials whose files the list ignores. Errors in a single
    /// trial, such as an unknown campaign, are left to [`Trial::check`], so that the other trials can be
    /// processed.
    ///
    /// # Errors
    /// Returns an error if the list cannot be read or parsed, if an id is malformed or used twice, or if no
    /// trial is left.
    pub fn load(folder: &Path) -> Result<Self, ConfigError> {
        let path = folder.join(TRIALS_FILE);
        let text = files::read_text(&path).map_err(|source| match source.kind() {
            ErrorKind::NotFound if folder.is_dir() => ConfigError::NoTrialList(folder.to_owned()),
            ErrorKind::NotFound => ConfigError::NoTrialFolder(folder.to_owned()),
            _ => ConfigError::Read { path: path.clone(), source },
        })?;
        let mut list: Self =
            parse_toml(&path, &text).map_err(|error| single_brackets(&path, &text, error))?;
        let error = |key: &str, found, needed: &str| {
            Err(ConfigError::Value {
                path: path.clone(),
                key: key.to_owned(),
                found,
                needed: needed.to_owned(),
            })
        };
        for trial in &mut list.trial {
            let own = std::mem::replace(&mut trial.aliases, list.aliases.clone());
            trial.aliases.extend(own);
        }
        if list.trial.is_empty() {
            return error("trial", "an empty list".to_owned(), "at least one [[trial]]");
        }
        let mut ids = BTreeSet::new();
        for (i, Trial { id, .. }) in list.trial.iter().enumerate() {
            let key = format!("trial[{i}].id");
            let found = format!("{id:?}");
            if files::is_device_name(id) {
                let needed = "another id, because Windows reserves this name for a device";
                return error(&key, found, needed);
            }
            if !is_valid_id(id) {
                let characters = "A-Z a-z 0-9 . _ -, not starting with a dot";
                return error(&key, found, &format!("1 to 64 of the characters {characters}"));
            }
            // Some file systems ignore case.
            if !ids.insert(id.to_ascii_lowercase()) {
                return error(&key, found, "an id that no other trial has");
            }
        }
        let (ignored, trials): (Vec<_>, Vec<_>) = list.trial.into_iter().partition(|trial| {
            let mut patterns = list.ignore.iter();
            patterns.any(|one| matches_label(one, &trial.file) && !is_catch_all(one))
        });
        if trials.is_empty() {
            let found = format!("{:?}, which match the files of all trials", list.ignore);
            return error(
                "ignore",
                found,
                "at least one [[trial]] whose file none of these patterns matches",
            );
        }
        (list.ignored, list.trial) = (ignored, trials);
        Ok(list)
    }

    /// Returns whether the marker file `file` in the folder is neither listed nor ignored.
    pub fn lacks(&self, file: &str) -> bool {
        !self.trial.iter().any(|trial| trial.file == file)
            && !self.ignore.iter().any(|pattern| matches_label(pattern, file))
    }
}

/// Returns whether a pattern, such as `*` or `*.csv`, matches all files or all files of one type. Such a
/// pattern ignores only files without an entry in the list.
fn is_catch_all(pattern: &str) -> bool {
    let stem = pattern.split('.').next().unwrap_or_default();
    !stem.is_empty() && stem.chars().all(|c| "*?".contains(c))
}

/// Replaces the parser's error by a clearer one if the trial list contains `[trial]` instead of `[[trial]]`.
fn single_brackets(path: &Path, text: &str, error: ConfigError) -> ConfigError {
    let mut lines = text.lines().map(|line| line.split('#').next().unwrap_or_default());
    match lines.position(|line| line.trim() == "[trial]") {
        Some(index) => ConfigError::Syntax {
            path: path.to_owned(),
            line: index + 1,
            key: None,
            message: "found `[trial]`, needed `[[trial]]` before each trial".to_owned(),
            suggestion: None,
        },
        None => error,
    }
}

/// Maximum number of characters in a trial's id.
const MAX_ID: usize = 64;
/// Maximum number of characters in a trial's name, which is the id, possibly prefixed with the folder's name.
const MAX_NAME: usize = 2 * MAX_ID + 1;

/// Returns whether `id` is a valid id for a trial.
pub fn is_valid_id(id: &str) -> bool {
    id.len() <= MAX_ID && is_valid_name(id) && !files::is_device_name(id)
}

/// Returns whether `name` is a valid name for a trial and its tables.
pub fn is_valid_name(name: &str) -> bool {
    (1..=MAX_NAME).contains(&name.len())
        && !name.starts_with('.')
        && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"._-".contains(&byte))
}

/// Error in an entry of `trials.toml`.
#[derive(Debug, Clone, thiserror::Error, PartialEq, Eq)]
#[error("trials.toml, trial `{trial}`: key `{key}`: found {found}, needed {needed}")]
pub struct TrialError {
    pub trial: String,
    pub key: &'static str,
    pub found: String,
    pub needed: String,
}

impl Trial {
    /// Returns the name of the trial's robot; `None` if its campaign is not configured.
    pub fn robot_name<'t>(&'t self, config: &'t Config) -> Option<&'t str> {
        let Some(campaign) = &self.campaign else { return self.robot.as_deref() };
        config.campaign.get(campaign).map(|campaign| campaign.robot.as_str())
    }

    /// Checks the trial's entry against the configuration.
    ///
    /// # Errors
    /// Returns an error that names the invalid key, what was found and what is needed.
    pub fn check(&self, config: &Config) -> Result<(), TrialError> {
        let error = |key, found: String, needed: &str| {
            Err(TrialError { trial: self.id.clone(), key, found, needed: needed.to_owned() })
        };
        let mut parts = Path::new(&self.file).components();
        if self.file.is_empty() || !parts.all(|part| matches!(part, Component::Normal(_))) {
            return error("file", format!("{:?}", self.file), "a file inside the trial folder");
        }
        if self.day.as_ref().is_some_and(|day| day.trim().is_empty()) {
            return error("day", "an empty text".to_owned(), "a text, such as \"2026-11-28\"");
        }
        if let Some(window) = self.smoothing_window.filter(|window| !(5..=30).contains(window)) {
            return error("smoothing_window", window.to_string(), "a whole number from 5 to 30");
        }
        let is_gait = self.kind == TrialKind::Gait;
        let foreign = [
            ("robot", is_gait, self.robot.as_ref().map(|name| format!("`{name}`"))),
            ("campaign", !is_gait, self.campaign.as_ref().map(|name| format!("`{name}`"))),
            ("omega_rad_s", !is_gait, self.omega_rad_s.map(|omega| omega.to_string())),
        ];
        let mut foreign = foreign.into_iter().filter(|(_, is_foreign, _)| *is_foreign);
        if let Some((key, found)) = foreign.find_map(|(key, _, found)| Some((key, found?))) {
            let needed = format!("no such key, because a trial of kind {} has none", self.kind);
            return error(key, found, &needed);
        }
        let name = if is_gait { &self.campaign } else { &self.robot };
        let name = name.as_deref().unwrap_or_default();
        let found = if name.is_empty() { "nothing".to_owned() } else { format!("`{name}`") };
        let key = if is_gait { "campaign" } else { "robot" };
        let robot = match config.campaign.get(name) {
            Some(campaign) if is_gait => &campaign.robot,
            None if is_gait => return error(key, found, &one_of(name, &config.campaign, PIPELINE)),
            _ => name,
        };
        let Some(configured) = config.robot.get(robot) else {
            return error(key, found, &one_of(robot, &config.robot, PIPELINE));
        };
        let found = match is_gait {
            true => format!("{found}, whose robot is `{robot}`"),
            false => found,
        };
        if config.marker_layout(robot).is_none() {
            return error(key, found, &config.needed_layout(robot));
        }
        if let Err(needed) = configured.check_kind(self.kind) {
            return error(key, found, needed);
        }
        match self.omega_rad_s {
            Some(omega) if !OMEGA_RAD_S.contains(&omega) => {
                let units = [("Hz", omega * TAU), ("degrees per second", omega.to_radians())];
                let unit = units.into_iter().find(|(_, right)| OMEGA_RAD_S.contains(right));
                let unit = unit.map_or(String::new(), |(unit, right)| {
                    format!(" (if the value is in {unit}, write {right:.4})")
                });
                error("omega_rad_s", omega.to_string(), &format!("{NEEDED_OMEGA}{unit}"))
            }
            None if is_gait => error("omega_rad_s", "nothing".into(), NEEDED_OMEGA),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loaded(ignore: &str) -> Result<TrialList, String> {
        let folder = tempfile::tempdir().unwrap();
        let entry =
            |id: &str| format!("[[trial]]\nid = '{id}'\nfile = '{id}.csv'\nkind = 'gait'\n");
        let list = format!("ignore = [{ignore}]\n{}", ["a-1", "a-2", "b-1"].map(entry).concat());
        std::fs::write(folder.path().join(TRIALS_FILE), list).unwrap();
        TrialList::load(folder.path()).map_err(|error| error.to_string())
    }

    #[test]
    fn an_ignored_file_is_not_a_trial_although_it_has_an_entry() {
        let ids =
            |trials: &[Trial]| trials.iter().map(|trial| trial.id.clone()).collect::<Vec<_>>();
        for (ignore, left, ignored) in [
            ("", &["a-1", "a-2", "b-1"][..], &[][..]),
            ("'a-2.csv'", &["a-1", "b-1"], &["a-2"]),
            ("'a-*.csv', 'wand*'", &["b-1"], &["a-1", "a-2"]),
            ("'?-1*'", &["a-2"], &["a-1", "b-1"]),
            // These patterns ignore only files without an entry.
            ("'*'", &["a-1", "a-2", "b-1"], &[]),
            ("'*.csv', 'b-1.csv'", &["a-1", "a-2"], &["b-1"]),
        ] {
            let list = loaded(ignore).unwrap();
            assert_eq!((ids(&list.trial), ids(&list.ignored)), (own(left), own(ignored)));
            assert!(["a-1", "a-2", "b-1"].iter().all(|id| !list.lacks(&format!("{id}.csv"))));
        }
        let message = loaded("'a-*', 'b-1.csv'").unwrap_err();
        assert!(message.contains("key `ignore`: found [\"a-*\", \"b-1.csv\"]"), "{message}");
        assert!(
            message.ends_with(
                "needed at least one [[trial]] whose file none of these patterns matches"
            )
        );
    }

    fn own(ids: &[&str]) -> Vec<String> {
        ids.iter().map(|id| (*id).to_owned()).collect()
    }

    #[test]
    fn a_list_in_place_of_a_single_value_is_rejected_by_its_key() {
        let error_with = |old: &str, new: &str| {
            let text = "ignore = ['x']\n[[trial]]\nid = 'a'\nfile = 'a.csv'\nkind = 'gait'\n\
                        omega_rad_s = 3.9\nsmoothing_window = 9\n";
            let text = text.replacen(old, new, 1);
            parse_toml::<TrialList>(Path::new("t.toml"), &text).unwrap_err().to_string()
        };
        for (old, new, message) in [
            (
                "= 3.9",
                "= [3.9, 4.5]",
                "line 6: key `trial[0].omega_rad_s`: found a list of length 2, needed a number",
            ),
            ("= 9", "= [9]", "key `trial[0].smoothing_window`: found a list of length 1, needed"),
            ("= 'a.csv'", "= ['a.csv']", "key `trial[0].file`: invalid type: list, expected a str"),
            ("= 'gait'", "= ['gait']", "key `trial[0].kind`: wanted string"),
            ("['x']", "'x'", "key `ignore`: invalid type: string \"x\", expected a list"),
            ("['x']", "[['x']]", "key `ignore`: invalid type: list, expected a string"),
        ] {
            assert!(error_with(old, new).contains(message), "{}", error_with(old, new));
        }
        let listed = "trial = [['a', 'a.csv', 'gait']]\n";
        let error = parse_toml::<TrialList>(Path::new("t.toml"), listed).unwrap_err().to_string();
        let expected =
            "key `trial`: found a list of length 3, needed a table with the keys id, file";
        assert!(error.contains(expected), "{error}");
    }
}
