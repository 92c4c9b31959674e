//! Trial folders that a configuration names, and unique names for their trials.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use trilink_base::files::{absolute, is_device_name};

use super::{TRIALS_FILE, Trial, TrialList};
use crate::config::{ConfigError, Paths, is_pattern};

/// Maximum number of characters that the folder's name contributes to a trial's name.
const MAX_PREFIX: usize = 64;
/// Number of characters of the hash that distinguishes folders with long names.
const HASH_CHARACTERS: usize = 8;
/// Usual name of the folder of all trial folders; names of trials do not repeat it.
const RAW: &str = "raw";
/// Maximum number of ignored trials whose ids a message lists.
const MAX_IDS: usize = 10;

/// Trial folder with its list of trials.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialFolder {
    /// Path of the folder relative to the folder of the configuration file; identifies the trial folder.
    pub name: String,
    pub path: PathBuf,
    pub list: TrialList,
}

/// Trial from one of several folders, identified by its folder and its id.
#[derive(Debug, Clone, PartialEq)]
pub struct ListedTrial {
    /// Index of the folder in [`TrialFolders::folders`].
    pub folder: usize,
    /// Id of the trial in the folder's list.
    pub id: String,
    /// The trial, with its id replaced by its name, which is unique among all folders.
    pub trial: Trial,
}

/// All trial folders, with their trials.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialFolders {
    /// Folders, sorted by name.
    pub folders: Vec<TrialFolder>,
    /// Trials, in the order of the folders and, within each folder, of its list.
    pub trials: Vec<ListedTrial>,
    /// Trials with marker files to be ignored, in the same order.
    pub ignored: Vec<ListedTrial>,
}

/// Finds the folders that match the paths and patterns in a configuration, each folder once, sorted by name.
/// A pattern matches only folders that contain a trial list.
///
/// # Errors
/// Returns an error if a pattern is malformed or matches no folder.
pub fn find_folders(paths: &Paths) -> Result<Vec<PathBuf>, ConfigError> {
    let mut found = BTreeMap::new();
    for path in &paths.raw {
        for folder in matching(path)? {
            found.entry(paths.name_of(&folder)).or_insert(folder);
        }
    }
    // The same folder may be found under several names.
    let mut seen = BTreeSet::new();
    let mut folders: Vec<PathBuf> = found.into_values().collect();
    folders
        .retain(|folder| seen.insert(folder.canonicalize().unwrap_or_else(|_| absolute(folder))));
    Ok(folders)
}

fn matching(path: &Path) -> Result<Vec<PathBuf>, ConfigError> {
    if !is_pattern(path) || path.exists() {
        return Ok(vec![path.to_owned()]);
    }
    let error = |found: String, needed| {
        Err(ConfigError::Pattern { pattern: path.to_owned(), found, needed })
    };
    let folders = match glob::glob(&path.to_string_lossy()) {
        Ok(folders) => folders,
        Err(problem) => return error(problem.to_string(), "a valid pattern of folder names"),
    };
    let mut found = Vec::new();
    for folder in folders {
        match folder {
            Ok(folder) if folder.join(TRIALS_FILE).is_file() => found.push(folder),
            Ok(_) => {}
            Err(problem) => {
                let path = problem.path().to_owned();
                return Err(ConfigError::Read { path, source: problem.into() });
            }
        }
    }
    if found.is_empty() {
        return error(
            "nothing".to_owned(),
            "folders that match this pattern and have a trials.toml",
        );
    }
    Ok(found)
}

impl TrialFolder {
    /// Reads the list of a trial folder.
    ///
    /// # Errors
    /// Returns an error in the same cases as [`TrialList::load`].
    pub fn load(paths: &Paths, path: &Path) -> Result<Self, ConfigError> {
        let list = TrialList::load(path)?;
        Ok(Self { name: paths.name_of(path), path: path.to_owned(), list })
    }
}

impl TrialFolders {
    /// Reads the lists of all trial folders.
    ///
    /// # Errors
    /// Returns an error in the same cases as [`find_folders`] and [`TrialList::load`], or if two trials would have the
    /// same name.
    pub fn load(paths: &Paths) -> Result<Self, ConfigError> {
        let mut folders = Vec::new();
        let (mut trials, mut ignored) = (Vec::new(), Vec::new());
        for (folder, path) in find_folders(paths)?.into_iter().enumerate() {
            let read = TrialFolder::load(paths, &path)?;
            let listed =
                |trial: &Trial| ListedTrial { folder, id: trial.id.clone(), trial: trial.clone() };
            trials.extend(read.list.trial.iter().map(listed));
            ignored.extend(read.list.ignored.iter().map(listed));
            folders.push(read);
        }
        let mut all = Self { folders, trials, ignored };
        all.name_trials(paths.only_folder().as_deref())?;
        Ok(all)
    }

    /// Prefixes the ids with the names of their folders, except those of the folder that the configuration names
    /// alone. A name depends on no other folder, so it stays when folders are added or removed. Returns an error if two
    /// trials have the same name.
    fn name_trials(&mut self, only_folder: Option<&str>) -> Result<(), ConfigError> {
        let Self { folders, trials, ignored } = self;
        let prefixes: Vec<Option<String>> = folders
            .iter()
            .map(|folder| (only_folder != Some(&folder.name)).then(|| prefix(&folder.name)))
            .collect();
        for ListedTrial { folder, trial, .. } in trials.iter_mut().chain(&mut *ignored) {
            if let Some(prefix) = &prefixes[*folder] {
                trial.id = format!("{prefix}_{}", trial.id);
            }
        }
        let mut names = BTreeMap::new();
        for ListedTrial { folder, id, trial } in trials.iter().chain(ignored.iter()) {
            if let Some(other) = names.insert(trial.id.to_ascii_lowercase(), (*folder, id)) {
                let (other_folder, other_id) = other;
                let other = &folders[other_folder].name;
                let path = folders[*folder].path.join(TRIALS_FILE);
                let needed = format!(
                    "another id or another name of the folder, because trial `{other_id}` of folder {other} would \
                     have the same name, `{}`",
                    trial.id
                );
                return Err(ConfigError::Value {
                    path,
                    key: "trial.id".to_owned(),
                    found: format!("{id:?}"),
                    needed,
                });
            }
        }
        Ok(())
    }

    /// Returns a sentence that names the trials left out because a pattern in `ignore` of `trials.toml` matches their
    /// files; `None` if there are no such trials.
    pub fn ignored_sentence(&self) -> Option<String> {
        let ids: Vec<&str> = self.ignored.iter().map(|listed| listed.id.as_str()).collect();
        if ids.is_empty() {
            return None;
        }
        let more = match ids.len().saturating_sub(MAX_IDS) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        let shown = ids.iter().take(MAX_IDS).copied().collect::<Vec<_>>().join(", ");
        Some(format!(
            "trials left out because `ignore` in trials.toml matches their files: {shown}{more}"
        ))
    }
}

/// Returns the prefix of the names of a folder's trials: the components of its path without a leading `raw`, or the
/// last of them and a hash if all are too long.
fn prefix(folder: &str) -> String {
    let components = Path::new(folder).components();
    let names = components.filter(|part| matches!(part, Component::Normal(_)));
    let names: Vec<String> = names.map(|part| to_id(&part.as_os_str().to_string_lossy())).collect();
    let names = match names.as_slice() {
        [first, rest @ ..] if first == RAW && !rest.is_empty() => rest,
        names => names,
    };
    let prefix = names.join("-");
    if (1..=MAX_PREFIX).contains(&prefix.len()) {
        return prefix;
    }
    let mut name = names.last().cloned().unwrap_or_default();
    name.truncate(MAX_PREFIX - 1 - HASH_CHARACTERS);
    format!("{name}-{}", &blake3::hash(folder.as_bytes()).to_hex()[..HASH_CHARACTERS])
}

/// Makes a name valid as part of an id: replaces invalid characters by `_`, and prepends `_` to a name that Windows
/// reserves for a device.
fn to_id(name: &str) -> String {
    let mut id = String::new();
    for c in name.chars() {
        let is_valid = c.is_ascii_alphanumeric() || "_-".contains(c) || c == '.' && !id.is_empty();
        id.push(if is_valid { c } else { '_' });
    }
    if is_device_name(&id) { format!("_{id}") } else { id }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folders(lists: &[(&str, &[&str])]) -> (tempfile::TempDir, Paths) {
        let home = tempfile::tempdir().unwrap();
        let mut paths = crate::config::Config::default().paths;
        for (folder, ids) in lists {
            let entry =
                |id: &&str| format!("[[trial]]\nid = '{id}'\nfile = 'a.csv'\nkind = 'gait'\n");
            let folder = home.path().join(folder);
            std::fs::create_dir_all(&folder).unwrap();
            let list: String = ids.iter().map(entry).collect();
            std::fs::write(folder.join(TRIALS_FILE), list).unwrap();
        }
        paths.raw = lists.iter().map(|(folder, _)| folder.into()).collect();
        paths.start_at(home.path());
        (home, paths)
    }

    fn names(lists: &[(&str, &[&str])]) -> Vec<String> {
        let (_home, paths) = folders(lists);
        let all = TrialFolders::load(&paths).unwrap();
        all.trials.into_iter().map(|listed| listed.trial.id).collect()
    }

    #[test]
    fn names_begin_with_the_folder_unless_the_configuration_names_it_alone() {
        assert_eq!(names(&[("raw/a", &["X", "y"])]), ["X", "y"]);
        assert_eq!(names(&[("raw/b", &["x", "y"]), ("raw/a", &["X"])]), ["a_X", "b_x", "b_y"]);
        let same = [("a/d", &["x", "y"][..]), ("b/d", &["x"]), ("raw", &["y"])];
        assert_eq!(names(&same), ["a-d_x", "a-d_y", "b-d_x", "raw_y"]);
        assert_eq!(names(&[("first night", &["x"]), (".2", &["x"])]), ["_2_x", "first_night_x"]);
        assert_eq!(names(&[("con.d", &["x"]), ("n", &["x"])]), ["_con.d_x", "n_x"]);
        let long = "n".repeat(200);
        let found = names(&[(&long, &["x"]), ("m", &["x"])]);
        assert!(found.iter().all(|name| super::super::is_valid_name(name)), "{found:?}");

        // Folders on the command line do not change the names in the configured folder.
        let (home, mut paths) = folders(&[("raw", &["x"])]);
        let (other, _) = folders(&[("second", &["x"])]);
        std::fs::rename(other.path().join("second"), home.path().join("second")).unwrap();
        paths.replace_raw(["raw", "second"].map(|name| home.path().join(name)).into());
        let all = TrialFolders::load(&paths).unwrap();
        let found: Vec<String> = all.trials.into_iter().map(|listed| listed.trial.id).collect();
        assert_eq!(found, ["x", "second_x"]);
    }

    #[test]
    fn an_id_that_windows_reserves_for_a_device_is_an_error_on_every_system() {
        let (_home, paths) = folders(&[("a", &["x", "Nul.1"])]);
        let message = TrialFolders::load(&paths).unwrap_err().to_string();
        let expected =
            "found \"Nul.1\", needed another id, because Windows reserves this name for a device";
        assert!(message.ends_with(expected), "{message}");
    }

    #[test]
    fn two_trials_with_the_same_name_are_an_error() {
        let (_home, paths) = folders(&[("a b", &["x"]), ("a_b", &["x"])]);
        let message = TrialFolders::load(&paths).unwrap_err().to_string();
        let expected = "found \"x\", needed another id or another name of the folder, because trial `x` of folder \
                        a b would have the same name, `a_b_x`";
        assert!(message.ends_with(expected), "{message}");
    }

    #[test]
    fn patterns_find_each_folder_with_a_list_once_and_in_order() {
        let (home, mut paths) = folders(&[("raw/11-10", &["y"]), ("raw/11-03", &["x"])]);
        std::fs::create_dir(home.path().join("raw/notes")).unwrap();
        let first = paths.raw[1].clone();
        let mut found = |raw: &[&str]| {
            paths.raw = raw.iter().map(|raw| home.path().join(raw)).collect();
            find_folders(&paths)
        };
        let all = ["raw/11-03", "raw/11-10"].map(|name| home.path().join(name));
        for raw in [&["raw/*"][..], &["raw/11-10", "raw/11-03"], &["raw/11-[01]*", "./raw/11-10/"]]
        {
            assert_eq!(found(raw).unwrap(), all, "{raw:?}");
        }
        assert_eq!(found(&["*/11-03"]).unwrap(), [first]);
        let message = found(&["raw/12-*"]).unwrap_err().to_string();
        assert!(message.contains("raw/12-*: found nothing, needed folders"), "{message}");
        assert!(
            found(&["raw/[*"]).unwrap_err().to_string().contains("a valid pattern of folder names")
        );
    }
}
