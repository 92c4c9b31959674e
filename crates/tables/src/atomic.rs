//! Files that are there whole or not at all.

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

/// How the names of files begin that are being written.
pub const WRITING: &str = ".writing-";

/// Files that may wait for the disk, and threads that wait for it: what is flushed at the same time
/// takes hardly longer than one file.
const MOST_PENDING: usize = 32;
const FLUSHING: usize = 4;
/// Waits for a file that another program has open, two seconds in all.
const WAITS_MS: [u64; 8] = [8, 16, 32, 64, 128, 256, 512, 1024];

/// A file that is written beside its place and not yet there.
#[derive(Debug)]
pub struct PendingFile {
    path: PathBuf,
    file: tempfile::NamedTempFile,
    blake3: String,
}

impl PendingFile {
    /// Writes a file beside its place; creates the folder if need be.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(path: &Path, bytes: &[u8]) -> Result<Self, StoreError> {
        let attempt = || {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let folder = folder.unwrap_or(Path::new("."));
            fs::create_dir_all(folder)?;
            let mut builder = tempfile::Builder::new();
            // Temporary files are private; results are for everybody who may read new files.
            #[cfg(unix)]
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
            let mut file = builder.prefix(WRITING).tempfile_in(folder)?;
            file.write_all(bytes)?;
            Ok(Self { path: path.to_owned(), file, blake3: hash(bytes) })
        };
        attempt().map_err(|source| StoreError::Write { path: path.to_owned(), source })
    }

    /// Where it will be.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Flushes the file to the disk and renames it into its place.
    ///
    /// # Errors
    /// Either fails; then what was there before stays.
    pub fn settle(self) -> Result<Stamp, StoreError> {
        let Self { path, file, blake3 } = self;
        let persist = |file: tempfile::NamedTempFile| {
            file.persist(&path).map_err(|tempfile::PersistError { error, file }| (error, file))
        };
        let settled = file
            .as_file()
            .sync_all()
            .and_then(|()| while_held(file, persist, is_held, &WAITS_MS))
            .and_then(|file| file.metadata());
        match settled {
            Ok(metadata) => Ok(Stamp::of_output(&metadata, blake3)),
            Err(source) => Err(StoreError::Write { path, source }),
        }
    }
}

/// Whether this is what Windows says of a file that another program, such as a virus scanner, has
/// open: ERROR_ACCESS_DENIED or ERROR_SHARING_VIOLATION.
fn is_held(error: &io::Error) -> bool {
    cfg!(windows) && matches!(error.raw_os_error(), Some(5 | 32))
}

/// Tries with what the last try gave back, after each of the waits, while an error says that a file
/// is held.
fn while_held<F, T>(
    mut file: F,
    attempt: impl Fn(F) -> Result<T, (io::Error, F)>,
    is_held: impl Fn(&io::Error) -> bool,
    waits_ms: &[u64],
) -> io::Result<T> {
    for wait_ms in waits_ms {
        match attempt(file) {
            Err((error, back)) if is_held(&error) => file = back,
            done => return done.map_err(|(error, _)| error),
        }
        thread::sleep(Duration::from_millis(*wait_ms));
    }
    attempt(file).map_err(|(error, _)| error)
}

/// Writes bytes at hand beside their place, flushes them to the disk and renames them into place;
/// creates the folder if need be. An error leaves what was there before.
///
/// # Errors
/// The file cannot be written.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<Stamp, StoreError> {
    PendingFile::write(path, bytes)?.settle()
}

/// [`write_bytes`], unless the file has these bytes already: then it is left alone.
///
/// # Errors
/// The file cannot be written.
pub fn write_if_changed(path: &Path, bytes: &[u8]) -> Result<Stamp, StoreError> {
    unchanged(path, bytes).map_or_else(|| write_bytes(path, bytes), Ok)
}

/// The stamp of a file that has these bytes.
fn unchanged(path: &Path, bytes: &[u8]) -> Option<Stamp> {
    let (found, metadata) = files::read(path, bytes.len() as u64).ok()?;
    (found == bytes).then(|| Stamp::of_output(&metadata, hash(bytes)))
}

/// Files on their way to the disk, which is waited for while the next ones are computed.
#[derive(Debug)]
pub struct ToDisk {
    pending: SyncSender<PendingFile>,
    unchanged: Mutex<BTreeMap<PathBuf, Stamp>>,
}

impl ToDisk {
    /// Does `work`, which may give files to be written from any thread, and waits until all of
    /// them are in their places. Gives the files' stamps, too.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn during<T>(
        work: impl FnOnce(&Self) -> T,
    ) -> (T, Result<BTreeMap<PathBuf, Stamp>, StoreError>) {
        thread::scope(|scope| {
            let (pending, files) = mpsc::sync_channel(MOST_PENDING);
            let files = Arc::new(Mutex::new(files));
            let flushing = [(); FLUSHING].map(|()| {
                let files = Arc::clone(&files);
                scope.spawn(move || settle_all(&files))
            });
            // Who works has to learn if nobody takes files any more.
            drop(files);
            let to_disk = Self { pending, unchanged: Mutex::default() };
            let done = work(&to_disk);
            let Self { pending, unchanged } = to_disk;
            drop(pending);
            let mut stamps = Ok(unchanged.into_inner().unwrap_or_else(PoisonError::into_inner));
            for settled in flushing {
                let settled = settled.join();
                let settled = settled.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
                stamps = stamps.and_then(|stamps| Ok(stamps.into_iter().chain(settled?).collect()));
            }
            (done, stamps)
        })
    }

    /// A file that is written beside its place.
    pub fn send(&self, file: PendingFile) {
        // If nobody takes it any more, whoever did has the reason.
        let _ = self.pending.send(file);
    }

    /// Bytes at hand, unless the file has them already: then it is left alone.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_if_changed(&self, path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
        match unchanged(path, bytes) {
            Some(stamp) => {
                let mut unchanged = self.unchanged.lock().unwrap_or_else(PoisonError::into_inner);
                unchanged.insert(path.to_owned(), stamp);
            }
            None => self.send(PendingFile::write(path, bytes)?),
        }
        Ok(())
    }
}

fn settle_all(files: &Mutex<Receiver<PendingFile>>) -> Result<Vec<(PathBuf, Stamp)>, StoreError> {
    let next = || files.lock().unwrap_or_else(PoisonError::into_inner).recv().ok();
    let settle = |file: PendingFile| Ok((file.path().to_owned(), file.settle()?));
    std::iter::from_fn(next).map(settle).collect()
}

/// What writers that were killed left in these folders, or are writing just now.
pub fn unfinished(folders: &[PathBuf]) -> Vec<PathBuf> {
    let entries = folders.iter().flat_map(fs::read_dir).flatten().flatten();
    let is_unfinished = |entry: &fs::DirEntry| {
        entry.file_name().to_string_lossy().starts_with(WRITING)
            && entry.file_type().is_ok_and(|kind| kind.is_file())
    };
    entries.filter(is_unfinished).map(|entry| entry.path()).collect()
}

/// Removes what writers that were killed left in these folders, where nobody is writing.
///
/// # Errors
/// A file cannot be removed.
pub fn remove_unfinished(folders: &[PathBuf]) -> Result<(), StoreError> {
    for path in unfinished(folders) {
        match fs::remove_file(&path) {
            // Who waits for the results has looked whether a file can be made here.
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
    fn all_files_are_in_their_places_when_the_work_is_over_and_same_ones_are_left_alone() {
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
    fn a_file_that_its_writer_removes_meanwhile_is_no_error() {
        let folder = tempfile::tempdir().unwrap();
        let make = || drop(tempfile::Builder::new().prefix(WRITING).tempfile_in(folder.path()));
        thread::scope(|scope| {
            let makers = [(); 4].map(|()| scope.spawn(|| (0..500).for_each(|_| make())));
            while !makers.iter().all(thread::ScopedJoinHandle::is_finished) {
                remove_unfinished(&[folder.path().to_owned()]).expect("what is gone is removed");
            }
        });
    }

    #[test]
    fn a_file_that_is_held_is_tried_again_for_a_while_and_others_once() {
        let held = |error: &io::Error| error.kind() == io::ErrorKind::ResourceBusy;
        let tried = |attempts: usize, kind: io::ErrorKind| {
            let count = std::cell::Cell::new(0);
            let attempt = |file| {
                count.set(count.get() + 1);
                if count.get() < attempts { Err((kind.into(), file)) } else { Ok(file) }
            };
            let result = while_held("file", attempt, held, &[0; 3]);
            (result.map_err(|error| error.kind()), count.get())
        };
        let (busy, full) = (io::ErrorKind::ResourceBusy, io::ErrorKind::StorageFull);
        assert_eq!(tried(1, busy), (Ok("file"), 1));
        assert_eq!(tried(4, busy), (Ok("file"), 4));
        assert_eq!(tried(5, busy), (Err(busy), 4));
        assert_eq!(tried(2, full), (Err(full), 1));
        assert!(!is_held(&full.into()));
        assert_eq!(is_held(&io::Error::from_raw_os_error(32)), cfg!(windows));
    }

    #[test]
    fn files_that_cannot_be_put_in_their_places_are_an_error_and_nobody_waits_for_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("taken");
        fs::create_dir(&path).unwrap();
        let (sent, stamps) = ToDisk::during(|to_disk| {
            let all = 0..3 * MOST_PENDING;
            all.map(|_| to_disk.send(PendingFile::write(&path, b"content").unwrap())).count()
        });
        assert!(sent == 3 * MOST_PENDING && matches!(stamps, Err(StoreError::Write { .. })));
        assert!(unfinished(&[folder.path().to_owned()]).is_empty());
    }
}
