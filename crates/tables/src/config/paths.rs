//! Where things are.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use trilink_base::files::name_in;

/// Where things are; relative paths start at the configuration file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Paths {
    /// Trial folders, or patterns of them.
    #[serde(with = "one_or_many")]
    pub raw: Vec<PathBuf>,
    /// Parquet tables.
    pub derived: PathBuf,
    /// Figures, page and fits.
    pub reports: PathBuf,
    /// Results that later ones are compared with, as a file.
    pub baseline: PathBuf,
    /// Where the configuration file lies.
    #[serde(skip)]
    pub base: PathBuf,
}

impl Paths {
    /// Makes the paths start at the folder where the configuration file lies.
    pub fn start_at(&mut self, base: &Path) {
        let places = [&mut self.derived, &mut self.reports, &mut self.baseline];
        for place in self.raw.iter_mut().chain(places) {
            // What is no pattern in the folder's own name must not become one.
            let is_pattern = is_pattern(place) && !base.join(&*place).exists();
            let base = if is_pattern { escaped(base) } else { base.to_owned() };
            *place = base.join(&*place);
        }
        self.base = base.to_owned();
    }

    /// A path as seen from the configuration file, so that it means the same in a copy of both.
    pub fn name_of(&self, path: &Path) -> String {
        let name = name_in(&self.base, path);
        if name.is_empty() { ".".to_owned() } else { name }
    }
}

/// Whether a path stands for all that match it.
pub fn is_pattern(path: &Path) -> bool {
    path.to_string_lossy().contains(['*', '?', '['])
}

fn escaped(path: &Path) -> PathBuf {
    glob::Pattern::escape(&path.to_string_lossy()).into()
}

/// One path as text, others as a list.
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
