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
    /// Folder of the configuration file.
    #[serde(skip)]
    pub base: PathBuf,
}

impl Paths {
    /// Prepends `base`, the folder of the configuration file, to the relative paths.
    pub fn start_at(&mut self, base: &Path) {
        let others = [&mut self.derived, &mut self.reports, &mut self.baseline];
        for path in self.raw.iter_mut().chain(others) {
            // In front of a pattern, wildcard characters in the name of the folder itself must be escaped.
            let is_pattern = is_pattern(path) && !base.join(&*path).exists();
            let base = if is_pattern { escaped(base) } else { base.to_owned() };
            *path = base.join(&*path);
        }
        self.base = base.to_owned();
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
