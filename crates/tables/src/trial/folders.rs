//! Trial folders: which there are, and what their trials are called.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use trilink_base::files::{absolute, is_device_name};

use super::{TRIALS_FILE, Trial, TrialList};
use crate::config::{ConfigError, Paths, is_pattern};

/// Most characters that a trial's name has of its folder's.
const MOST_FRONT: usize = 64;
/// Characters of a hash that tell folders apart whose names do not.
const HASH_CHARACTERS: usize = 8;
/// More ids are not named in one sentence.
const MOST_IDS: usize = 10;

/// A trial folder.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialFolder {
    /// Its path as seen from the configuration, which it is known by.
    pub name: String,
    pub path: PathBuf,
    pub list: TrialList,
}

/// A trial of one of several folders. Its identity is its folder and its id.
#[derive(Debug, Clone, PartialEq)]
pub struct ListedTrial {
    /// Index of its folder.
    pub folder: usize,
    /// As in the folder's list.
    pub id: String,
    /// With a name as its id that no other trial has.
    pub trial: Trial,
}

/// Trial folders with all their trials.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialFolders {
    /// In the order of their names.
    pub folders: Vec<TrialFolder>,
    /// In the order of folders and lists.
    pub trials: Vec<ListedTrial>,
}

/// The folders that paths and patterns name, each once, in the order of their names. A pattern
/// names folders with a list of trials.
///
/// # Errors
/// A pattern cannot be understood or names no folder.
pub fn find_folders(paths: &Paths) -> Result<Vec<PathBuf>, ConfigError> {
    let mut found = BTreeMap::new();
    for path in &paths.raw {
        for folder in matching(path)? {
            found.entry(paths.name_of(&folder)).or_insert(folder);
        }
    }
    // One folder may have several names.
    let mut seen = BTreeSet::new();
    let place = |folder: &PathBuf| folder.canonicalize().unwrap_or_else(|_| absolute(folder));
    Ok(found.into_values().filter(|folder| seen.insert(place(folder))).collect())
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
        Err(problem) => return error(problem.to_string(), "a pattern of folders"),
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
    match found.is_empty() {
        true => error("nothing".to_owned(), "folders with a trials.toml that match it"),
        false => Ok(found),
    }
}

impl TrialFolders {
    /// Reads the lists of all trial folders.
    ///
    /// # Errors
    /// As [`find_folders`] and [`TrialList::load`], or a trial would have the name of another.
    pub fn load(paths: &Paths) -> Result<Self, ConfigError> {
        let with_list = |path: PathBuf| {
            let list = TrialList::load(&path)?;
            Ok(TrialFolder { name: paths.name_of(&path), path, list })
        };
        let folders = find_folders(paths)?.into_iter().map(with_list);
        let folders: Vec<TrialFolder> = folders.collect::<Result<_, _>>()?;
        let listed = folders.iter().enumerate().flat_map(|(folder, TrialFolder { list, .. })| {
            let listed = move |trial: &Trial| {
                let trial = trial.clone();
                ListedTrial { folder, id: trial.id.clone(), trial }
            };
            list.trial.iter().map(listed)
        });
        let mut all = Self { trials: listed.collect(), folders };
        all.tell_apart()?;
        Ok(all)
    }

    /// Gives trials of one id their folders' names in front of it. Which trials there are decides
    /// on that, not their order.
    fn tell_apart(&mut self) -> Result<(), ConfigError> {
        let Self { folders, trials } = self;
        let mut same: BTreeMap<String, Vec<&mut ListedTrial>> = BTreeMap::new();
        for trial in trials.iter_mut() {
            same.entry(trial.id.to_ascii_lowercase()).or_default().push(trial);
        }
        for same in same.into_values().filter(|same| same.len() > 1) {
            let names: Vec<&str> =
                same.iter().map(|trial| folders[trial.folder].name.as_str()).collect();
            for (trial, front) in same.into_iter().zip(fronts(&names)) {
                trial.trial.id = format!("{front}_{}", trial.id);
            }
        }
        let mut names = BTreeMap::new();
        for ListedTrial { folder, id, trial } in trials {
            if let Some(other) = names.insert(trial.id.to_ascii_lowercase(), (*folder, &*id)) {
                let (other, other_id) = (&folders[other.0].name, other.1);
                let needed = format!("another id, because `{other_id}` of {other} is called so");
                let path = folders[*folder].path.join(TRIALS_FILE);
                let (key, found) = ("trial.id".to_owned(), format!("{id:?}"));
                return Err(ConfigError::Value { path, key, found, needed });
            }
        }
        Ok(())
    }

    /// A sentence on the trials whose files their lists ignore.
    pub fn ignored(&self) -> Option<String> {
        let ids: Vec<&str> =
            self.folders.iter().flat_map(|of| &of.list.ignored).map(String::as_str).collect();
        let more = match ids.len().saturating_sub(MOST_IDS) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        let shown = ids.iter().take(MOST_IDS).copied().collect::<Vec<_>>().join(", ");
        let sentence =
            || format!("left out, because `ignore` of trials.toml names the file: {shown}{more}");
        (!ids.is_empty()).then(sentence)
    }

    /// A sentence on the ids that several folders have.
    pub fn told_apart(&self) -> Option<String> {
        let apart = || self.trials.iter().filter(|listed| listed.id != listed.trial.id);
        let ListedTrial { folder, id, trial } = apart().next()?;
        let ids: BTreeSet<String> = apart().map(|listed| listed.id.to_ascii_lowercase()).collect();
        let more = match ids.len() - 1 {
            0 => String::new(),
            others => format!(" (and {others} other ids)"),
        };
        let (count, name, folder) = (apart().count(), &trial.id, &self.folders[*folder].name);
        Some(format!(
            "several folders have a trial `{id}`{more}: each of these {count} trials has its folder's \
             name in front, as `{name}` of {folder}"
        ))
    }
}

/// What tells folders apart in front of an id: as many of the last parts of their paths as it
/// takes.
fn fronts(folders: &[&str]) -> Vec<String> {
    let parts = |folder: &str| -> Vec<String> {
        let is_name = |part: &Component| matches!(part, Component::Normal(_));
        let names = Path::new(folder).components().filter(is_name);
        names.map(|part| plain(&part.as_os_str().to_string_lossy())).collect()
    };
    let parts: Vec<Vec<String>> = folders.iter().map(|folder| parts(folder)).collect();
    let longest = parts.iter().map(Vec::len).max().unwrap_or(0);
    for count in 1..=longest {
        let last = |parts: &Vec<String>| parts[parts.len().saturating_sub(count)..].join("-");
        let fronts: Vec<String> = parts.iter().map(last).collect();
        let mut seen = BTreeSet::new();
        let mut tells =
            |front: &String| !front.is_empty() && seen.insert(front.to_ascii_lowercase());
        if fronts.iter().all(|front| front.len() <= MOST_FRONT) && fronts.iter().all(&mut tells) {
            return fronts;
        }
    }
    let hashed = |(folder, parts): (&&str, &Vec<String>)| {
        let mut front = parts.last().cloned().unwrap_or_default();
        front.truncate(MOST_FRONT - 1 - HASH_CHARACTERS);
        let hash = blake3::hash(folder.as_bytes()).to_hex();
        format!("{front}-{}", &hash[..HASH_CHARACTERS])
    };
    folders.iter().zip(&parts).map(hashed).collect()
}

/// A folder's name in the characters of an id.
fn plain(name: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    let plain = |(i, c): (usize, char)| match is_plain(c) && (i > 0 || c != '.') {
        true => c,
        false => '_',
    };
    let name: String = name.chars().enumerate().map(plain).collect();
    if is_device_name(&name) { format!("_{name}") } else { name }
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
    fn trials_of_one_id_have_as_much_of_their_folder_in_front_as_tells_them_apart() {
        assert_eq!(names(&[("raw/b", &["x", "y"]), ("raw/a", &["X"])]), ["a_X", "b_x", "y"]);
        let same = [("a/d", &["x", "y"][..]), ("b/d", &["x"]), ("c", &["y"])];
        assert_eq!(names(&same), ["a-d_x", "d_y", "b-d_x", "c_y"]);
        // Their characters are those of ids, and two of such names may be the same.
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
    fn an_id_that_windows_takes_for_a_device_is_an_error_everywhere() {
        let (_home, paths) = folders(&[("a", &["x", "Nul.1"])]);
        let message = TrialFolders::load(&paths).unwrap_err().to_string();
        let expected =
            "found \"Nul.1\", needed another id, because Windows takes this one for a device";
        assert!(message.ends_with(expected), "{message}");
    }

    #[test]
    fn a_name_that_another_trial_has_is_an_error() {
        let (_home, paths) = folders(&[("a", &["x"]), ("b", &["x"]), ("c", &["a_x"])]);
        let message = TrialFolders::load(&paths).unwrap_err().to_string();
        let expected = "found \"a_x\", needed another id, because `x` of a is called so";
        assert!(message.ends_with(expected), "{message}");
    }

    #[test]
    fn patterns_name_folders_with_lists_each_once_and_in_order() {
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
        assert!(found(&["raw/[*"]).unwrap_err().to_string().contains("a pattern of folders"));
    }
}
