//! What a file was when it was last looked at, so that unchanged ones are not read again.

use std::collections::HashMap;
use std::fs::Metadata;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use trilink_base::files;

use super::table::most_rows;
use super::{Columns, CycleRow, StoreError, Table, cycles_path};

/// Clocks of file systems tick this coarsely at most; those that count whole seconds are told by
/// their times.
const TICK: Duration = Duration::from_millis(20);
const COARSE_TICK: Duration = Duration::from_secs(2);

/// Size, time and content of a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stamp {
    pub bytes: u64,
    /// Of the last change, ns since 1970. Missing where a later change might have the same time:
    /// then the file is read again the next time.
    pub modified_ns: Option<u64>,
    /// Of the content, in hexadecimal.
    pub blake3: String,
}

impl Stamp {
    /// The stamp of a file somebody else may write, of which `content` was read after `metadata`.
    pub fn of_input(metadata: &Metadata, content: &[u8]) -> Self {
        let is_whole = metadata.len() == content.len() as u64;
        let modified_ns = modified_ns(metadata).filter(|ns| is_whole && is_past(*ns));
        Self { bytes: metadata.len(), modified_ns, blake3: hash(content) }
    }

    /// The stamp of a file in a folder that only who holds its lock writes to: however young the
    /// file is, a later change has another time.
    pub(super) fn of_output(metadata: &Metadata, blake3: String) -> Self {
        Self { bytes: metadata.len(), modified_ns: modified_ns(metadata), blake3 }
    }

    /// Whether it says the same as an earlier one, or only more of the file's time.
    pub fn confirms(&self, earlier: &Self) -> bool {
        (self.bytes, &self.blake3) == (earlier.bytes, &earlier.blake3)
            && (earlier.modified_ns.is_none() || earlier.modified_ns == self.modified_ns)
    }

    /// The stamp of a file that was known as `known`, which is read only if its size or time
    /// differ, or to `verify` it. The program's `own` are of folders that only who holds their
    /// lock writes to.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn renew(path: &Path, known: Option<&Self>, own: bool, verify: bool) -> io::Result<Self> {
        if let Some(known) = known.filter(|known| !verify && known.is_current(path)) {
            return Ok(known.clone());
        }
        let (content, metadata) = files::read(path, files::DATA_BYTES)?;
        Ok(match own {
            true => Self::of_output(&metadata, hash(&content)),
            false => Self::of_input(&metadata, &content),
        })
    }

    /// Whether a file has this size and time.
    pub fn is_current(&self, path: &Path) -> bool {
        let Ok(metadata) = std::fs::metadata(path) else { return false };
        metadata.is_file()
            && metadata.len() == self.bytes
            && self.modified_ns.is_some()
            && modified_ns(&metadata) == self.modified_ns
    }

    /// Whether a file is as it was; to `verify` that, it is read.
    pub fn is_intact(&self, path: &Path, verify: bool) -> bool {
        if verify { self.content_of(path).is_some() } else { self.is_current(path) }
    }

    /// The content of a file that still has this one.
    pub fn content_of(&self, path: &Path) -> Option<Vec<u8>> {
        let (content, _) = files::read(path, self.bytes).ok()?;
        (hash(&content) == self.blake3).then_some(content)
    }
}

/// Whether there is something at a path.
///
/// # Errors
/// That cannot be found out.
pub fn is_there(path: &Path) -> Result<bool, StoreError> {
    path.try_exists().map_err(|source| StoreError::Read { path: path.to_owned(), source })
}

/// Reads files that were looked at before: what is read is what was seen, or an error.
#[derive(Debug, Clone, Default)]
pub struct Reader(pub HashMap<PathBuf, Stamp>);

impl Reader {
    /// Of files in a folder as they were written.
    pub fn of<'s>(folder: &Path, files: impl IntoIterator<Item = (&'s String, &'s Stamp)>) -> Self {
        Self(files.into_iter().map(|(name, stamp)| (folder.join(name), stamp.clone())).collect())
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// It cannot be read, or is not what it was.
    pub fn bytes(&self, path: &Path) -> Result<Vec<u8>, StoreError> {
        let (bytes, _) = files::read(path, files::DATA_BYTES)
            .map_err(|source| StoreError::Read { path: path.to_owned(), source })?;
        match self.0.get(path) {
            Some(seen) if seen.blake3 != hash(&bytes) => {
                Err(StoreError::Changed { path: path.to_owned() })
            }
            _ => Ok(bytes),
        }
    }

    /// A table.
    ///
    /// # Errors
    /// As [`Reader::bytes`], or it is not a table that trilink writes.
    pub fn table(&self, path: &Path) -> Result<Table, StoreError> {
        Table::parse(path, self.bytes(path)?)
    }

    /// A table that is not absurdly long.
    ///
    /// # Errors
    /// As [`Reader::table`], or it has more rows than a table of its name may have, or two with one name.
    pub fn bearable_table(&self, path: &Path) -> Result<Table, StoreError> {
        Table::parse_at_most(path, self.bytes(path)?, most_rows(path))?.each_row_once()
    }

    /// The rows of a table.
    ///
    /// # Errors
    /// As [`Reader::table`], or a column is missing or of another type, or two rows have one name.
    pub fn rows<R: Columns>(&self, path: &Path) -> Result<Vec<R>, StoreError> {
        R::from_table(&self.table(path)?.each_row_once()?)
    }

    /// The rows of a table; none if it is not there.
    ///
    /// # Errors
    /// As [`Reader::rows`], but for a table that is not there.
    pub fn rows_if_there<R: Columns>(&self, path: &Path) -> Result<Option<Vec<R>>, StoreError> {
        match self.rows(path) {
            Err(error) if error.is_not_there() => Ok(None),
            rows => rows.map(Some),
        }
    }

    /// The cycles of a trial in their order; none if there is no table of them.
    ///
    /// # Errors
    /// As [`Reader::rows`], but for a table that is not there, or a cycle does not follow the one before.
    pub fn cycles_if_there(
        &self,
        derived: &Path,
        trial: &str,
    ) -> Result<Option<Vec<CycleRow>>, StoreError> {
        let path = cycles_path(derived, trial);
        let Some(rows) = self.rows_if_there::<CycleRow>(&path)? else { return Ok(None) };
        let Some(pair) = rows.windows(2).find(|pair| pair[0].cycle >= pair[1].cycle) else {
            return Ok(Some(rows));
        };
        let found = format!("{} after {}", pair[1].cycle, pair[0].cycle);
        let column = "cycle".to_owned();
        Err(StoreError::Column { path, column, found, needed: "cycles that rise" })
    }
}

/// The tables in a folder, in order; none if it is not there.
///
/// # Errors
/// The folder cannot be read.
pub fn tables_in(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let error = |source| StoreError::Read { path: folder.to_owned(), source };
    let entries = match std::fs::read_dir(folder) {
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            return Ok(Vec::new());
        }
        entries => entries.map_err(error)?,
    };
    let paths = entries.map(|entry| entry.map(|entry| entry.path()));
    let mut paths = paths.collect::<io::Result<Vec<_>>>().map_err(error)?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "parquet"));
    // Of one folder: their parts need not be compared.
    paths.sort_unstable_by(|a, b| a.as_os_str().cmp(b.as_os_str()));
    Ok(paths)
}

/// blake3 in hexadecimal.
pub fn hash(content: &[u8]) -> String {
    blake3::hash(content).to_hex().to_string()
}

fn modified_ns(metadata: &Metadata) -> Option<u64> {
    let since = metadata.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
    u64::try_from(since.as_nanos()).ok()
}

/// Whether a change that is made now has another time.
fn is_past(modified_ns: u64) -> bool {
    let tick = if modified_ns.is_multiple_of(1_000_000_000) { COARSE_TICK } else { TICK };
    let modified = UNIX_EPOCH + Duration::from_nanos(modified_ns);
    // A time to come tells nothing of the past.
    SystemTime::now().duration_since(modified).is_ok_and(|age| age > tick)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, File};

    fn set_age(path: &Path, age: Duration) {
        File::options()
            .write(true)
            .open(path)
            .unwrap()
            .set_modified(SystemTime::now() - age)
            .unwrap();
    }

    #[test]
    fn a_file_is_read_again_when_its_size_or_time_differs_or_is_too_young_to_tell() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        fs::write(&path, "one").unwrap();
        let read = || Stamp::renew(&path, None, false, false);
        assert_eq!(read().unwrap().modified_ns, None);
        set_age(&path, Duration::from_secs(10));
        let stamp = read().unwrap();
        assert!(stamp.is_current(&path));
        let time = fs::metadata(&path).unwrap().modified().unwrap();
        fs::write(&path, "two").unwrap();
        File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
        assert!(stamp.is_current(&path) && stamp.content_of(&path).is_none());
        assert_eq!(Stamp::renew(&path, Some(&stamp), false, false).unwrap(), stamp);
        assert_eq!(Stamp::renew(&path, Some(&stamp), false, true).unwrap().blake3, hash(b"two"));
        set_age(&path, Duration::from_secs(20));
        assert!(!stamp.is_current(&path));
        fs::remove_file(&path).unwrap();
        assert!(!stamp.is_current(&path) && read().is_err());
    }
}
