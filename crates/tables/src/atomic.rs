//! Atomic writing of files: either the complete file is written or none.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver, SyncSender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use trilink_base::files;

use super::{Stamp, StoreError, hash};

/// Prefix of the names that files have while they are being written.
pub const WRITING: &str = ".writing-";

/// Maximum number of files waiting to be flushed to disk.
const MAX_PENDING: usize = 32;
/// Number of threads that flush files: flushing several files at once takes barely longer than flushing one.
const FLUSH_THREADS: usize = 4;
/// Delays between attempts to replace a file that another program has open, ms; two seconds in total.
const RETRY_DELAYS_MS: [u64; 8] = [8, 16, 32, 64, 128, 256, 512, 1024];

/// File that is written under a temporary name in its folder but not yet renamed.
#[derive(Debug)]
pub struct PendingFile {
    path: PathBuf,
    file: tempfile::NamedTempFile,
    blake3: String,
}

impl PendingFile {
    /// Writes a temporary file in the folder of `path`; the folder is created if necessary.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn write(path: &Path, bytes: &[u8]) -> Result<Self, StoreError> {
        match write_temporary(path, bytes) {
            Ok(file) => Ok(Self { path: path.to_owned(), file, blake3: hash(bytes) }),
            Err(source) => Err(StoreError::Write { path: path.to_owned(), source }),
        }
    }

    /// Returns the final path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Flushes the file to disk and renames it to its final path.
    ///
    /// # Errors
    /// Returns an error if either step fails; an existing file at the final path is then left unchanged.
    pub fn commit(self) -> Result<Stamp, StoreError> {
        let Self { path, file, blake3 } = self;
        let persist = |file: tempfile::NamedTempFile| {
            file.persist(&path).map_err(|tempfile::PersistError { error, file }| (error, file))
        };
        let metadata = file
            .as_file()
            .sync_all()
            .and_then(|()| retry_while(is_in_use, file, persist, &RETRY_DELAYS_MS))
            .and_then(|file| file.metadata());
        match metadata {
            Ok(metadata) => Ok(Stamp::of_output(&metadata, blake3)),
            Err(source) => Err(StoreError::Write { path, source }),
        }
    }
}

fn write_temporary(path: &Path, bytes: &[u8]) -> io::Result<tempfile::NamedTempFile> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let mut builder = tempfile::Builder::new();
    // Temporary files are private by default, but results get the permissions of ordinary new files.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = builder.prefix(WRITING).tempfile_in(folder)?;
    file.write_all(bytes)?;
    Ok(file)
}

/// Returns whether a Windows error means that another program, such as a virus scanner, has the file open:
/// ERROR_ACCESS_DENIED or ERROR_SHARING_VIOLATION.
fn is_in_use(error: &io::Error) -> bool {
    cfg!(windows) && matches!(error.raw_os_error(), Some(5 | 32))
}

/// Calls `attempt`, and again after each delay as long as it fails with an error for which `is_temporary`
/// holds. A failed attempt returns its argument together with the error.
fn retry_while<F, T>(
    is_temporary: impl Fn(&io::Error) -> bool,
    mut file: F,
    attempt: impl Fn(F) -> Result<T, (io::Error, F)>,
    delays_ms: &[u64],
) -> io::Result<T> {
    for delay_ms in delays_ms {
        match attempt(file) {
            Err((error, returned)) if is_temporary(&error) => file = returned,
            result => return result.map_err(|(error, _)| error),
        }
        thread::sleep(Duration::from_millis(*delay_ms));
    }
    attempt(file).map_err(|(error, _)| error)
}

/// Writes a file atomically: under a temporary name in its folder (which is created if necessary), then
/// flushed to disk and renamed. If an error occurs, an existing file is left unchanged.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<Stamp, StoreError> {
    PendingFile::write(path, bytes)?.commit()
}

/// Writes a file as [`write_bytes`] does, but leaves the file untouched if it already contains exactly these
/// bytes.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub fn write_if_changed(path: &Path, bytes: &[u8]) -> Result<Stamp, StoreError> {
    stamp_if_unchanged(path, bytes).map_or_else(|| write_bytes(path, bytes), Ok)
}

/// Returns the stamp of a file if it already contains exactly these bytes; otherwise `None`.
fn stamp_if_unchanged(path: &Path, bytes: &[u8]) -> Option<Stamp> {
    let (current, metadata) = files::read(path, bytes.len() as u64).ok()?;
    (current == bytes).then(|| Stamp::of_output(&metadata, hash(bytes)))
}

/// Queue of files that background threads flush to disk while further files are computed.
#[derive(Debug)]
pub struct ToDisk {
    pending: SyncSender<PendingFile>,
    unchanged: Mutex<BTreeMap<PathBuf, Stamp>>,
}

impl ToDisk {
    /// Runs `work`, which may queue files from any thread, and waits until all of them are at their final
    /// paths. Returns the result of `work`, and the stamps of the files.
    ///
    /// # Errors
    /// The second result is an error if a file cannot be written.
    pub fn during<T>(
        work: impl FnOnce(&Self) -> T,
    ) -> (T, Result<BTreeMap<PathBuf, Stamp>, StoreError>) {
        thread::scope(|scope| {
            let (pending, files) = mpsc::sync_channel(MAX_PENDING);
            let files = Arc::new(Mutex::new(files));
            let flushers = [(); FLUSH_THREADS].map(|()| {
                let files = Arc::clone(&files);
                scope.spawn(move || commit_all(&files))
            });
            // Only the flushing threads may own the receiver: if all of them fail, sending must fail, too.
            drop(files);
            let to_disk = Self { pending, unchanged: Mutex::default() };
            let result = work(&to_disk);
            let Self { pending, unchanged } = to_disk;
            drop(pending);
            let mut stamps = Ok(unchanged.into_inner().unwrap_or_else(PoisonError::into_inner));
            for flusher in flushers {
                let committed = flusher.join();
                let committed = committed.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
                stamps =
                    stamps.and_then(|stamps| Ok(stamps.into_iter().chain(committed?).collect()));
            }
            (result, stamps)
        })
    }

    /// Queues a file to be flushed to disk and renamed.
    pub fn send(&self, file: PendingFile) {
        // Sending fails only if all flushing threads have failed, and those report why.
        let _ = self.pending.send(file);
    }

    /// Writes a file and queues it to be flushed and renamed, but leaves an existing file untouched if it
    /// already contains exactly these bytes.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn write_if_changed(&self, path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
        match stamp_if_unchanged(path, bytes) {
            Some(stamp) => {
                let mut unchanged = self.unchanged.lock().unwrap_or_else(PoisonError::into_inner);
                unchanged.insert(path.to_owned(), stamp);
            }
            None => self.send(PendingFile::write(path, bytes)?),
        }
        Ok(())
    }
}

/// Flushes and renames queued files until the channel is closed. The lock on `files` is held only while the
/// next file is received.
fn commit_all(files: &Mutex<Receiver<PendingFile>>) -> Result<Vec<(PathBuf, Stamp)>, StoreError> {
    let receive = || files.lock().unwrap_or_else(PoisonError::into_inner).recv().ok();
    let mut committed = Vec::new();
    while let Some(file) = receive() {
        committed.push((file.path().to_owned(), file.commit()?));
    }
    Ok(committed)
}

/// Returns the temporary files in the given folders, which killed processes have left or other processes are
/// still writing.
pub fn unfinished(folders: &[PathBuf]) -> Vec<PathBuf> {
    let entries = folders.iter().flat_map(fs::read_dir).flatten().flatten();
    entries.filter(is_unfinished).map(|entry| entry.path()).collect()
}

fn is_unfinished(entry: &fs::DirEntry) -> bool {
    entry.file_name().to_string_lossy().starts_with(WRITING)
        && entry.file_type().is_ok_and(|kind| kind.is_file())
}

/// Removes the temporary files that killed processes left in the given folders. No process may be writing to
/// these folders.
///
/// # Errors
/// Returns an error if a temporary file cannot be removed.
pub fn remove_unfinished(folders: &[PathBuf]) -> Result<(), StoreError> {
    for path in unfinished(folders) {
        match fs::remove_file(&path) {
            // The file may be gone: a process that waits for the lock creates and removes one to test whether
            // the folder is writable.
            Err(source) if source.kind() == io::ErrorKind::NotFound => {}
            removed => removed.map_err(|source| StoreError::Remove { path, source })?,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_files_are_committed_after_the_work_and_unchanged_ones_are_left_untouched() {
        let folder = tempfile::tempdir().unwrap();
        let paths: Vec<PathBuf> =
            (0..100).map(|i| folder.path().join(format!("{i}/file"))).collect();
        let write_all = || {
            let (written, stamps) = ToDisk::during(|to_disk| -> Result<(), StoreError> {
                paths.iter().try_for_each(|path| to_disk.write_if_changed(path, b"content"))
            });
            written.unwrap();
            stamps.unwrap()
        };
        let stamps = write_all();
        assert!(paths.iter().all(|path| stamps[path].content_of(path).is_some()));
        assert_eq!((stamps.len(), write_all()), (paths.len(), stamps));
    }

    #[test]
    fn a_file_that_its_writer_removes_in_the_meantime_is_no_error() {
        let folder = tempfile::tempdir().unwrap();
        thread::scope(|scope| {
            let writers = [(); 4].map(|()| {
                scope.spawn(|| {
                    for _ in 0..500 {
                        drop(tempfile::Builder::new().prefix(WRITING).tempfile_in(folder.path()));
                    }
                })
            });
            while !writers.iter().all(thread::ScopedJoinHandle::is_finished) {
                remove_unfinished(&[folder.path().to_owned()]).expect("missing files are no error");
            }
        });
    }

    #[test]
    fn replacing_a_file_in_use_is_retried_and_other_errors_are_not() {
        let is_busy = |error: &io::Error| error.kind() == io::ErrorKind::ResourceBusy;
        let succeed_at = |attempts: usize, kind: io::ErrorKind| {
            let count = std::cell::Cell::new(0);
            let attempt = |file| {
                count.set(count.get() + 1);
                if count.get() < attempts { Err((kind.into(), file)) } else { Ok(file) }
            };
            let result = retry_while(is_busy, "file", attempt, &[0; 3]);
            (result.map_err(|error| error.kind()), count.get())
        };
        let busy = io::ErrorKind::ResourceBusy;
        let full = io::ErrorKind::StorageFull;
        assert_eq!(succeed_at(1, busy), (Ok("file"), 1));
        assert_eq!(succeed_at(4, busy), (Ok("file"), 4));
        assert_eq!(succeed_at(5, busy), (Err(busy), 4));
        assert_eq!(succeed_at(2, full), (Err(full), 1));
        assert!(!is_in_use(&full.into()));
        assert_eq!(is_in_use(&io::Error::from_raw_os_error(32)), cfg!(windows));
    }

    #[test]
    fn files_that_cannot_be_renamed_are_an_error_and_block_nobody() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("taken");
        fs::create_dir(&path).unwrap();
        let (sent, stamps) = ToDisk::during(|to_disk| {
            let all = 0..3 * MAX_PENDING;
            all.map(|_| to_disk.send(PendingFile::write(&path, b"content").unwrap())).count()
        });
        assert!(sent == 3 * MAX_PENDING && matches!(stamps, Err(StoreError::Write { .. })));
        assert!(unfinished(&[folder.path().to_owned()]).is_empty());
    }
}
