//! Paths in a configuration.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use trilink_base::files::name_in;

/// Paths in a configuration, which are relative to the folder of the configuration file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Paths {
    /// Trial folders, or patterns that match trial folders.
    #[serde(with = "one_or_many")]
    pub raw: Vec<PathBuf>,
    /// Folder for the Parquet tables.
    pub derived: PathBuf,
    /// Folder for the report: figures, HTML pages, and files for other programs such as `fits.json`.
    pub reports: PathBuf,
    /// File that contains the baseline with which later results are compared.
    pub baseline: PathBuf,
    /// Table of the figures of merit of all runs, the only result that cannot be made again.
    pub history: PathBuf,
    /// Folder of the configuration file.
    #[serde(skip)]
    pub base: PathBuf,
    /// The configured `raw`, if [`Self::replace_raw`] has replaced it.
    #[serde(skip)]
    configured_raw: Option<Vec<PathBuf>>,
}

impl Paths {
    /// Prepends `base`, the folder of the configuration file, to the relative paths.
    pub fn start_at(&mut self, base: &Path) {
        let Self { derived, reports, baseline, history, .. } = self;
        let others = [derived, reports, baseline, history];
        for path in self.raw.iter_mut().chain(others) {
            // In front of a pattern, wildcard characters in the name of the folder itself must be escaped.
            let is_pattern = is_pattern(path) && !base.join(&*path).exists();
            let base = if is_pattern { escaped(base) } else { base.to_owned() };
            *path = base.join(&*path);
        }
        self.base = base.to_owned();
    }

    /// Replaces the trial folders, for example by those given on the command line. The names of trials still follow
    /// from the configured ones.
    pub fn replace_raw(&mut self, folders: Vec<PathBuf>) {
        let before = std::mem::replace(&mut self.raw, folders);
        self.configured_raw.get_or_insert(before);
    }

    /// Returns the name of the folder whose trials are named by their ids alone: the configured one, unless several
    /// folders or a pattern are configured.
    pub(crate) fn only_folder(&self) -> Option<String> {
        match self.configured_raw.as_ref().unwrap_or(&self.raw).as_slice() {
            [folder] if !is_pattern(folder) || folder.exists() => Some(self.name_of(folder)),
            _ => None,
        }
    }

    /// Returns `path` relative to the folder of the configuration file. The result stays valid if that folder and the
    /// file at `path` are moved together.
    pub fn name_of(&self, path: &Path) -> String {
        let name = name_in(&self.base, path);
        if name.is_empty() { ".".to_owned() } else { name }
    }
}

/// Returns whether a path contains wildcards.
pub fn is_pattern(path: &Path) -> bool {
    path.to_string_lossy().contains(['*', '?', '['])
}

fn escaped(path: &Path) -> PathBuf {
    glob::Pattern::escape(&path.to_string_lossy()).into()
}

/// Serialization of a list of paths: a single path as text, several paths as a list.
mod one_or_many {
    use super::{Deserialize, PathBuf, Serialize};
    use serde::{Deserializer, Serializer};

    #[derive(Serialize, Deserialize)]
    #[serde(untagged, expecting = "expected a folder or a list of folders")]
    enum OneOrMany {
        One(PathBuf),
        Many(Vec<PathBuf>),
    }

    pub(super) fn serialize<S: Serializer>(
        paths: &[PathBuf],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        match paths {
            [path] => path.serialize(serializer),
            paths => paths.serialize(serializer),
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        from: D,
    ) -> Result<Vec<PathBuf>, D::Error> {
        Ok(match OneOrMany::deserialize(from)? {
            OneOrMany::One(path) => vec![path],
            OneOrMany::Many(paths) => paths,
        })
    }
}
