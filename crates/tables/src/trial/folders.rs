//! Trial folders that a configuration names, and unique names for their trials.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use trilink_base::files::{absolute, is_device_name};

use super::{TRIALS_FILE, Trial, TrialList};
use crate::config::{ConfigError, Paths, is_pattern};

/// Maximum number of characters that the folder's name contributes to a trial's name.
const MAX_PREFIX: usize = 64;
/// Number of characters of the hash that distinguishes folders with equal names.
const HASH_CHARACTERS: usize = 8;
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
    /// The trial, with its id replaced by a name that is unique among all folders.
    pub trial: Trial,
}

/// All trial folders, with their trials.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialFolders {
    /// Folders, sorted by name.
    pub folders: Vec<TrialFolder>,
    /// Trials, in the order of the folders and, within each folder, of its list.
    pub trials: Vec<ListedTrial>,
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

impl TrialFolders {
    /// Reads the lists of all trial folders.
    ///
    /// # Errors
    /// Returns an error in the same cases as [`find_folders`] and [`TrialList::load`], or if two trials would have the
    /// same name.
    pub fn load(paths: &Paths) -> Result<Self, ConfigError> {
        let mut folders = Vec::new();
        let mut trials = Vec::new();
        for (folder, path) in find_folders(paths)?.into_iter().enumerate() {
            let list = TrialList::load(&path)?;
            for trial in &list.trial {
                trials.push(ListedTrial { folder, id: trial.id.clone(), trial: trial.clone() });
            }
            folders.push(TrialFolder { name: paths.name_of(&path), path, list });
        }
        let mut all = Self { folders, trials };
        all.make_names_unique()?;
        Ok(all)
    }

    /// Prefixes each id that occurs in several folders with the name of its folder; the result does not depend on the
    /// order of the trials. Returns an error if two trials then still have the same name.
    fn make_names_unique(&mut self) -> Result<(), ConfigError> {
        let Self { folders, trials } = self;
        let mut by_id: BTreeMap<String, Vec<&mut ListedTrial>> = BTreeMap::new();
        for trial in trials.iter_mut() {
            by_id.entry(trial.id.to_ascii_lowercase()).or_default().push(trial);
        }
        for same in by_id.into_values().filter(|same| same.len() > 1) {
            let names: Vec<&str> =
                same.iter().map(|trial| folders[trial.folder].name.as_str()).collect();
            for (trial, prefix) in same.into_iter().zip(distinct_prefixes(&names)) {
                trial.trial.id = format!("{prefix}_{}", trial.id);
            }
        }
        let mut names = BTreeMap::new();
        for ListedTrial { folder, id, trial } in trials {
            if let Some(other) = names.insert(trial.id.to_ascii_lowercase(), (*folder, &*id)) {
                let (other_folder, other_id) = other;
                let other = &folders[other_folder].name;
                let path = folders[*folder].path.join(TRIALS_FILE);
                let needed = format!(
                    "another id, because trial `{other_id}` of folder {other} has the same name"
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
    pub fn ignored(&self) -> Option<String> {
        let ids: Vec<&str> =
            self.folders.iter().flat_map(|one| &one.list.ignored).map(String::as_str).collect();
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

    /// Returns a sentence about the ids that occur in several folders; `None` if there are none.
    pub fn told_apart(&self) -> Option<String> {
        let renamed: Vec<&ListedTrial> =
            self.trials.iter().filter(|listed| listed.id != listed.trial.id).collect();
        let ListedTrial { folder, id, trial } = renamed.first()?;
        let ids: BTreeSet<String> =
            renamed.iter().map(|listed| listed.id.to_ascii_lowercase()).collect();
        let more = match ids.len() - 1 {
            0 => String::new(),
            others => format!(" (and {others} other ids)"),
        };
        Some(format!(
            "several folders contain a trial `{id}`{more}: the names of these {} trials are prefixed with the names \
             of their folders, such as `{}` in {}",
            renamed.len(),
            trial.id,
            self.folders[*folder].name
        ))
    }
}

/// Returns, for each folder, a prefix that distinguishes it from the others: as many of the last components of its path
/// as necessary, or its name and a hash if those components do not suffice or are too long.
fn distinct_prefixes(folders: &[&str]) -> Vec<String> {
    let parts: Vec<Vec<String>> = folders.iter().map(|folder| id_parts(folder)).collect();
    let max_parts = parts.iter().map(Vec::len).max().unwrap_or(0);
    for count in 1..=max_parts {
        let prefixes: Vec<String> = parts
            .iter()
            .map(|parts| parts[parts.len().saturating_sub(count)..].join("-"))
            .collect();
        let mut seen = BTreeSet::new();
        if prefixes.iter().all(|prefix| {
            (1..=MAX_PREFIX).contains(&prefix.len()) && seen.insert(prefix.to_ascii_lowercase())
        }) {
            return prefixes;
        }
    }
    let mut prefixes = Vec::new();
    for (folder, parts) in folders.iter().zip(&parts) {
        let mut name = parts.last().cloned().unwrap_or_default();
        name.truncate(MAX_PREFIX - 1 - HASH_CHARACTERS);
        let hash = blake3::hash(folder.as_bytes()).to_hex();
        prefixes.push(format!("{name}-{}", &hash[..HASH_CHARACTERS]));
    }
    prefixes
}

/// Splits a path into its components, and replaces the characters in them that are not valid in an id.
fn id_parts(folder: &str) -> Vec<String> {
    let components = Path::new(folder).components();
    let names = components.filter(|part| matches!(part, Component::Normal(_)));
    names.map(|part| to_id(&part.as_os_str().to_string_lossy())).collect()
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
    fn equal_ids_are_prefixed_with_as_much_of_their_folders_as_necessary() {
        assert_eq!(names(&[("raw/b", &["x", "y"]), ("raw/a", &["X"])]), ["a_X", "b_x", "y"]);
        let same = [("a/d", &["x", "y"][..]), ("b/d", &["x"]), ("c", &["y"])];
        assert_eq!(names(&same), ["a-d_x", "d_y", "b-d_x", "c_y"]);
        // Prefixes contain only characters that are valid in ids, so different folders may have equal
        // prefixes.
        assert_eq!(names(&[("first night", &["x"]), (".2", &["x"])]), ["_2_x", "first_night_x"]);
        assert_eq!(names(&[("con.d", &["x"]), ("n", &["x"])]), ["_con.d_x", "n_x"]);
        let [one, other] = &names(&[("a b", &["x"]), ("a_b", &["x"])])[..] else { panic!() };
        assert!(one.starts_with("a_b-") && other.starts_with("a_b-") && one != other, "{one}");
        assert!(one.ends_with("_x") && one.len() == "a_b-_x".len() + HASH_CHARACTERS);
        let long = "n".repeat(200);
        let found = names(&[(&long, &["x"]), ("m", &["x"])]);
        assert!(found.iter().all(|name| super::super::is_valid_name(name)), "{found:?}");
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
        let (_home, paths) = folders(&[("a", &["x"]), ("b", &["x"]), ("c", &["a_x"])]);
        let message = TrialFolders::load(&paths).unwrap_err().to_string();
        let expected =
            "found \"a_x\", needed another id, because trial `x` of folder a has the same name";
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
