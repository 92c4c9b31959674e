//! Trial folders that have results but no longer exist: gone, or renamed.

use std::collections::{BTreeMap, BTreeSet};

use trilink_ingest::FolderInput;
use trilink_tables::hash;
use trilink_tables::trial::TrialFolder;

use super::ingest::{FOLDER, MARKER_FILE};
use super::record::StageState;

/// Trial folders that have results but no longer exist.
#[derive(Default)]
pub(super) struct MissingFolders {
    /// Folders that are gone, with the number of trials in each.
    pub gone: BTreeMap<String, usize>,
    /// Sentences about the folders that were renamed.
    pub renamed: Vec<String>,
}

impl MissingFolders {
    /// Divides the missing folders into those that are gone and those that were renamed to one of the `new` folders,
    /// which has the same marker files.
    pub(super) fn find(
        missing: impl Iterator<Item = String>,
        new: &[TrialFolder],
        known: &StageState,
    ) -> Self {
        let hashes = |folder: &TrialFolder| -> BTreeSet<String> {
            let files = folder.list.trial.iter().map(|trial| folder.path.join(&trial.file));
            files.filter_map(|file| Some(hash(&std::fs::read(file).ok()?))).collect()
        };
        let mut new: Vec<(&str, BTreeSet<String>)> =
            new.iter().map(|folder| (folder.name.as_str(), hashes(folder))).collect();
        let earlier = FolderInput::gone(&known.whole);
        let mut found = Self::default();
        for folder in missing {
            let trials = known.targets.iter().filter(|made| made.key.get(FOLDER) == Some(&folder));
            let count = trials.clone().count();
            let files: BTreeSet<&String> =
                trials.filter_map(|made| made.key.get(MARKER_FILE)).collect();
            let same =
                new.iter().position(|(_, hashes)| files.iter().all(|file| hashes.contains(*file)));
            match same.filter(|_| count > 0) {
                Some(same) => {
                    let (name, _) = new.remove(same);
                    found.renamed.push(format!(
                        "folder {folder} is now called {name}: it has the same {count} marker files"
                    ));
                }
                None => {
                    let count =
                        if count > 0 { count } else { earlier.get(&folder).copied().unwrap_or(0) };
                    found.gone.insert(folder, count);
                }
            }
        }
        found
    }
}
