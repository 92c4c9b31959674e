//! `trials.toml`: which recordings trial folders hold.

mod folders;

use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::ops::RangeInclusive;
use std::path::{Component, Path};

use serde::{Deserialize, Serialize};

use crate::config::{Config, ConfigError, one_of, parse_toml};
pub use folders::{ListedTrial, TrialFolder, TrialFolders, find_folders};
use trilink_base::files;
use trilink_base::named;
use trilink_base::pattern::matches_label;

/// Name of the list inside a trial folder.
pub const TRIALS_FILE: &str = "trials.toml";

/// Frequencies that a gait may be commanded with, and how an error says it.
pub const OMEGA_RAD_S: RangeInclusive<f64> = 0.01..=1000.0;
pub const NEEDED_OMEGA: &str = "a frequency from 0.01 to 1000 rad/s";

/// Where campaigns and robots are.
const PIPELINE: &str = " of pipeline.toml";

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
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialList {
    /// Marker files of the folder that are no trials, or are to be none although they have an entry: `*`
    /// stands for any characters, `?` for one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ignore: Vec<String>,
    #[serde(default)]
    pub trial: Vec<Trial>,
    /// Ids of entries whose files `ignore` names, which are not among `trial`.
    #[serde(skip)]
    pub ignored: Vec<String>,
}

impl TrialList {
    /// Reads the list of a trial folder, without the trials whose files it ignores. What is wrong with a
    /// single trial, such as a missing file or an unknown campaign, is left to [`Trial::check`], so that
    /// the others can go on.
    ///
    /// # Errors
    /// The list cannot be read or parsed, an id is malformed or used twice, or no trial is left.
    pub fn load(folder: &Path) -> Result<Self, ConfigError> {
        let path = folder.join(TRIALS_FILE);
        let text = trilink_base::files::read_text(&path)
            .map_err(|source| ConfigError::Read { path: path.clone(), source })?;
        let mut list: Self =
            parse_toml(&path, &text).map_err(|error| single_brackets(&path, &text, error))?;
        let error = |key: &str, found, needed: &str| {
            let (path, key, needed) = (path.clone(), key.to_owned(), needed.to_owned());
            Err(ConfigError::Value { path, key, found, needed })
        };
        if list.trial.is_empty() {
            return error("trial", "an empty list".to_owned(), "at least one [[trial]]");
        }
        let mut ids = BTreeSet::new();
        for (i, Trial { id, .. }) in list.trial.iter().enumerate() {
            let (key, found) = (format!("trial[{i}].id"), format!("{id:?}"));
            if files::is_device_name(id) {
                return error(
                    &key,
                    found,
                    "another id, because Windows takes this one for a device",
                );
            }
            if !is_valid_id(id) {
                let characters = "A-Z a-z 0-9 . _ -, not starting with a dot";
                return error(&key, found, &format!("1 to 64 of the characters {characters}"));
            }
            // Some disks do not tell capitals from small letters.
            if !ids.insert(id.to_ascii_lowercase()) {
                return error(&key, found, "an id that no other trial has");
            }
        }
        let is_ignored = |trial: &Trial| {
            let names = |pattern: &&String| matches_label(pattern, &trial.file);
            list.ignore.iter().filter(names).any(|pattern| !is_catch_all(pattern))
        };
        let (ignored, kept): (Vec<Trial>, _) = list.trial.into_iter().partition(is_ignored);
        if kept.is_empty() {
            let found = format!("{:?}, which name the files of all trials", list.ignore);
            return error("ignore", found, "at least one [[trial]] whose file none of them names");
        }
        list.ignored = ignored.into_iter().map(|trial| trial.id).collect();
        list.trial = kept;
        Ok(list)
    }

    /// Whether a marker file of the folder is neither a trial nor named by `ignore`.
    pub fn lacks(&self, file: &str) -> bool {
        !self.trial.iter().any(|trial| trial.file == file)
            && !self.ignore.iter().any(|pattern| matches_label(pattern, file))
    }
}

/// Whether a pattern names no file in particular, as `*` and `*.csv`: it stands for the files without an
/// entry.
fn is_catch_all(pattern: &str) -> bool {
    let stem = pattern.split('.').next().unwrap_or_default();
    !stem.is_empty() && stem.chars().all(|c| "*?".contains(c))
}

/// What is wrong with a list in which `[trial]` stands for `[[trial]]`, else the parser's error.
fn single_brackets(path: &Path, text: &str, error: ConfigError) -> ConfigError {
    let header = |line: &str| line.split('#').next().is_some_and(|line| line.trim() == "[trial]");
    match text.lines().position(header) {
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

/// Most characters of an id, and of a name that has a folder's in front.
const MOST_ID: usize = 64;
const MOST_NAME: usize = 2 * MOST_ID + 1;

/// Whether a text can be the id of a trial.
pub fn is_valid_id(id: &str) -> bool {
    id.len() <= MOST_ID && is_valid_name(id) && !files::is_device_name(id)
}

/// Whether a text can name a trial and its tables.
pub fn is_valid_name(name: &str) -> bool {
    (1..=MOST_NAME).contains(&name.len())
        && !name.starts_with('.')
        && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"._-".contains(&byte))
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
        let error = |key, found: String, needed: &str| {
            Err(TrialError { trial: self.id.clone(), key, found, needed: needed.to_owned() })
        };
        let mut inside = Path::new(&self.file).components();
        if self.file.is_empty() || !inside.all(|part| matches!(part, Component::Normal(_))) {
            return error("file", format!("{:?}", self.file), "a file inside the trial folder");
        }
        if let Some(window) = self.smoothing_window.filter(|window| !(5..=30).contains(window)) {
            return error("smoothing_window", window.to_string(), "a whole number from 5 to 30");
        }
        let is_gait = self.kind == TrialKind::Gait;
        let foreign = [
            ("robot", is_gait && self.robot.is_some()),
            ("campaign", !is_gait && self.campaign.is_some()),
            ("omega_rad_s", !is_gait && self.omega_rad_s.is_some()),
        ];
        if let Some((key, _)) = foreign.into_iter().find(|(_, is_there)| *is_there) {
            let needed = format!("no such key for a trial of kind {}", self.kind);
            return error(key, "a value".to_owned(), &needed);
        }
        let (key, name) =
            if is_gait { ("campaign", &self.campaign) } else { ("robot", &self.robot) };
        let name = name.as_deref().unwrap_or_default();
        let (is_known, known) = match is_gait {
            true => (config.campaign.contains_key(name), one_of(name, &config.campaign, PIPELINE)),
            false => (config.robot.contains_key(name), one_of(name, &config.robot, PIPELINE)),
        };
        if !is_known {
            let found = if name.is_empty() { "nothing".into() } else { format!("`{name}`") };
            return error(key, found, &known);
        }
        match self.omega_rad_s {
            Some(omega) if !OMEGA_RAD_S.contains(&omega) => {
                let units = [("Hz", omega * TAU), ("degrees per second", omega.to_radians())];
                let unit = units.into_iter().find(|(_, right)| OMEGA_RAD_S.contains(right));
                let unit = unit.map_or(String::new(), |(unit, right)| {
                    format!(" (is it in {unit}? then {right:.4} is right)")
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
    fn an_ignored_file_is_no_trial_although_it_has_an_entry() {
        let ids = |list: &TrialList| list.trial.iter().map(|of| of.id.clone()).collect::<Vec<_>>();
        for (ignore, left, ignored) in [
            ("", &["a-1", "a-2", "b-1"][..], &[][..]),
            ("'a-2.csv'", &["a-1", "b-1"], &["a-2"]),
            ("'a-*.csv', 'wand*'", &["b-1"], &["a-1", "a-2"]),
            ("'?-1*'", &["a-2"], &["a-1", "b-1"]),
            // They stand for the files that have no entry.
            ("'*'", &["a-1", "a-2", "b-1"], &[]),
            ("'*.csv', 'b-1.csv'", &["a-1", "a-2"], &["b-1"]),
        ] {
            let list = loaded(ignore).unwrap();
            assert_eq!((&ids(&list)[..], &list.ignored[..]), (&own(left)[..], &own(ignored)[..]));
            assert!(["a-1", "a-2", "b-1"].iter().all(|id| !list.lacks(&format!("{id}.csv"))));
        }
        let message = loaded("'a-*', 'b-1.csv'").unwrap_err();
        assert!(message.contains("key `ignore`: found [\"a-*\", \"b-1.csv\"]"), "{message}");
        assert!(message.ends_with("needed at least one [[trial]] whose file none of them names"));
    }

    fn own(ids: &[&str]) -> Vec<String> {
        ids.iter().map(|id| (*id).to_owned()).collect()
    }

    #[test]
    fn what_is_a_list_and_should_be_none_is_refused_by_its_key() {
        let said = |old: &str, new: &str| {
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
            assert!(said(old, new).contains(message), "{}", said(old, new));
        }
        let listed = "trial = [['a', 'a.csv', 'gait']]\n";
        let error = parse_toml::<TrialList>(Path::new("t.toml"), listed).unwrap_err().to_string();
        let expected =
            "key `trial`: found a list of length 3, needed a table with the keys id, file";
        assert!(error.contains(expected), "{error}");
    }
}
