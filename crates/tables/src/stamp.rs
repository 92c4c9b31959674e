//! File stamps (size, modification time and hash), which avoid reading unchanged files again.

use std::collections::HashMap;
use std::fs::Metadata;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use trilink_base::files;

use super::table::max_rows;
use super::{Columns, CycleRow, StoreError, Table, cycles_path};

/// Coarsest resolution of modification times in file systems that store fractions of a second.
const TICK: Duration = Duration::from_millis(20);
/// Coarsest resolution of modification times in file systems that store whole seconds.
const COARSE_TICK: Duration = Duration::from_secs(2);

/// Size, modification time and hash of a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stamp {
    pub bytes: u64,
    /// Modification time, ns since the Unix epoch. `None` if a later change to the file could have the same
    /// modification time, so that the file must be read again.
    pub modified_ns: Option<u64>,
    /// BLAKE3 hash of the content, hexadecimal.
    pub blake3: String,
}

impl Stamp {
    /// Returns the stamp of a file that other programs may modify. `content` must have been read after
    /// `metadata`.
    pub fn of_input(metadata: &Metadata, content: &[u8]) -> Self {
        let is_whole = metadata.len() == content.len() as u64;
        let modified_ns = modified_ns(metadata).filter(|ns| is_whole && is_past(*ns));
        Self { bytes: metadata.len(), modified_ns, blake3: hash(content) }
    }

    /// Returns the stamp of a file in a folder whose lock this process holds. As no other process writes to
    /// the folder, the modification time is trusted even if the file is very recent.
    pub(super) fn of_output(metadata: &Metadata, blake3: String) -> Self {
        Self { bytes: metadata.len(), modified_ns: modified_ns(metadata), blake3 }
    }

    /// Returns whether this stamp equals the `earlier` one. Modification times are compared only if the earlier stamp
    /// has one.
    pub fn confirms(&self, earlier: &Self) -> bool {
        (self.bytes, &self.blake3) == (earlier.bytes, &earlier.blake3)
            && (earlier.modified_ns.is_none() || earlier.modified_ns == self.modified_ns)
    }

    /// Returns the current stamp of the file at `path`. The file is read only if there is no `earlier` stamp, if its
    /// size or modification time differs from that stamp, or if `verify` is set. `own` states that no process writes to
    /// the file without holding the lock on its folder.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read.
    pub fn renew(path: &Path, earlier: Option<&Self>, own: bool, verify: bool) -> io::Result<Self> {
        if let Some(earlier) = earlier.filter(|earlier| !verify && earlier.is_current(path)) {
            return Ok(earlier.clone());
        }
        let (content, metadata) = files::read(path, files::DATA_BYTES)?;
        if own {
            Ok(Self::of_output(&metadata, hash(&content)))
        } else {
            Ok(Self::of_input(&metadata, &content))
        }
    }

    /// Returns whether a file has the size and the modification time in this stamp.
    pub fn is_current(&self, path: &Path) -> bool {
        let Ok(metadata) = std::fs::metadata(path) else { return false };
        metadata.is_file()
            && metadata.len() == self.bytes
            && self.modified_ns.is_some()
            && modified_ns(&metadata) == self.modified_ns
    }

    /// Returns whether a file is unchanged, judged by its size and modification time or, if `verify` is set,
    /// by the hash of its content.
    pub fn is_intact(&self, path: &Path, verify: bool) -> bool {
        if verify { self.content_of(path).is_some() } else { self.is_current(path) }
    }

    /// Reads a file; `None` if its content differs from this stamp or cannot be read.
    pub fn content_of(&self, path: &Path) -> Option<Vec<u8>> {
        let (content, _) = files::read(path, self.bytes).ok()?;
        (hash(&content) == self.blake3).then_some(content)
    }
}

/// Returns whether a file or folder exists at a path.
///
/// # Errors
/// Returns an error if this cannot be determined.
pub fn is_there(path: &Path) -> Result<bool, StoreError> {
    path.try_exists().map_err(|source| StoreError::Read { path: path.to_owned(), source })
}

/// Reader that rejects a file that differs from its stamp; files without a stamp are read as they are.
#[derive(Debug, Clone, Default)]
pub struct Reader(pub HashMap<PathBuf, Stamp>);

impl Reader {
    /// Creates a reader from the stamps of files in a folder, given with the files' names.
    pub fn new<'s>(
        folder: &Path,
        files: impl IntoIterator<Item = (&'s String, &'s Stamp)>,
    ) -> Self {
        Self(files.into_iter().map(|(name, stamp)| (folder.join(name), stamp.clone())).collect())
    }

    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read or differs from its stamp.
    pub fn bytes(&self, path: &Path) -> Result<Vec<u8>, StoreError> {
        let (bytes, _) = files::read(path, files::DATA_BYTES)
            .map_err(|source| StoreError::Read { path: path.to_owned(), source })?;
        match self.0.get(path) {
            Some(stamp) if stamp.blake3 != hash(&bytes) => {
                Err(StoreError::Changed { path: path.to_owned() })
            }
            _ => Ok(bytes),
        }
    }

    /// Reads a table.
    ///
    /// # Errors
    /// Returns an error in the same cases as [`Reader::bytes`], or if the file is not a table that trilink writes.
    pub fn table(&self, path: &Path) -> Result<Table, StoreError> {
        Table::parse(path, self.bytes(path)?)
    }

    /// Reads a table after checking that it has no more rows than are permitted for tables of its name.
    ///
    /// # Errors
    /// Returns an error in the same cases as [`Reader::table`], if the table has too many rows, or if two rows agree in
    /// all columns that identify a row.
    pub fn bounded_table(&self, path: &Path) -> Result<Table, StoreError> {
        Table::parse_at_most(path, self.bytes(path)?, max_rows(path))?.each_row_once()
    }

    /// Reads the rows of a table.
    ///
    /// # Errors
    /// Returns an error in the same cases as [`Reader::table`], if a column is missing or has the wrong type, or if two
    /// rows agree in all columns that identify a row.
    pub fn rows<R: Columns>(&self, path: &Path) -> Result<Vec<R>, StoreError> {
        R::from_table(&self.table(path)?.each_row_once()?)
    }

    /// Reads the rows of a table; `None` if there is no such file.
    ///
    /// # Errors
    /// Returns an error in the same cases as [`Reader::rows`], except if the file does not exist.
    pub fn rows_if_there<R: Columns>(&self, path: &Path) -> Result<Option<Vec<R>>, StoreError> {
        match self.rows(path) {
            Err(error) if error.is_not_there() => Ok(None),
            rows => rows.map(Some),
        }
    }

    /// Reads the cycles of a trial in chronological order; `None` if the trial has no table of cycles.
    ///
    /// # Errors
    /// Returns an error in the same cases as [`Reader::rows_if_there`], or if the cycle numbers do not increase.
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
        Err(StoreError::Column { path, column, found, needed: "increasing cycle numbers" })
    }
}

/// Lists the Parquet files in a folder, sorted by name; empty if the folder does not exist.
///
/// # Errors
/// Returns an error if the folder cannot be read.
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
    // Within one folder, comparing whole paths as text is enough.
    paths.sort_unstable_by(|a, b| a.as_os_str().cmp(b.as_os_str()));
    Ok(paths)
}

/// Computes the BLAKE3 hash of `content`, hexadecimal.
pub fn hash(content: &[u8]) -> String {
    blake3::hash(content).to_hex().to_string()
}

fn modified_ns(metadata: &Metadata) -> Option<u64> {
    let since = metadata.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
    u64::try_from(since.as_nanos()).ok()
}

/// Returns whether a change made now would get a modification time other than `modified_ns`.
fn is_past(modified_ns: u64) -> bool {
    let tick = if modified_ns.is_multiple_of(1_000_000_000) { COARSE_TICK } else { TICK };
    let modified = UNIX_EPOCH + Duration::from_nanos(modified_ns);
    // A modification time in the future is not past.
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
    fn a_file_is_read_again_if_its_size_or_time_differs_or_is_too_recent() {
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
