//! Locking of a folder of results: one run at a time.

use std::fs::{File, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use trilink_tables::config::Config;
use trilink_tables::{StoreError, WRITING, remove_unfinished};

use super::record::RECORD_FILE;
use super::{RunError, Watch};

/// Name of the lock file in `derived/`. The file is never removed: only the operating system's lock on it counts, which
/// is released however the process that holds it ends.
const LOCK_FILE: &str = ".lock";

/// Interval at which a waiting process tries to take the lock.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Lock on a folder of results, released on drop.
#[derive(Debug)]
pub struct Lock {
    _file: File,
}

/// Process that holds a lock, as described in the lock file.
#[derive(Debug, Serialize, Deserialize)]
struct Holder {
    process: u32,
    host: Option<String>,
    started_unix_s: u64,
}

impl Lock {
    /// Locks the folder `derived`, which is created if necessary. If another process holds the lock, this function
    /// notifies `waiting` and waits; if `waiting` is `None`, it returns an error at once.
    ///
    /// # Errors
    /// Returns an error if another process holds the lock, if waiting was cancelled, or if the lock file cannot be
    /// written.
    pub fn take(derived: &Path, waiting: Option<&dyn Watch>) -> Result<Self, StoreError> {
        let path = derived.join(LOCK_FILE);
        let error = |source| StoreError::Write { path: path.clone(), source };
        std::fs::create_dir_all(derived)
            .map_err(|source| StoreError::Write { path: derived.to_owned(), source })?;
        // Following a link would write to a file that does not belong to this program.
        if let Ok(kind) = std::fs::symlink_metadata(&path).map(|found| found.file_type())
            && !kind.is_file()
        {
            let found = if kind.is_symlink() { "a link" } else { "a device or pipe" };
            return Err(StoreError::Place { path, found, needed: "a path for a regular file" });
        }
        let mut options = File::options();
        let mut file = options
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .map_err(error)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let held = StoreError::Held { path: path.clone(), holder: holder(&mut file) };
                let Some(watch) = waiting else { return Err(held) };
                watch.note(&format!("{held}; waiting"));
                let cancel = watch.cancel_token();
                while let Err(TryLockError::WouldBlock) = file.try_lock() {
                    cancel.check()?;
                    std::thread::sleep(POLL_INTERVAL);
                }
            }
            Err(TryLockError::Error(source)) => return Err(error(source)),
        }
        let holder = Holder { process: std::process::id(), host: host(), started_unix_s: now_s() };
        let text = serde_json::to_string(&holder)
            .expect("the holder of the lock can be serialised")
            + "\n";
        file.set_len(0)
            .and_then(|()| file.rewind())
            .and_then(|()| file.write_all(text.as_bytes()))
            .map_err(error)?;
        Ok(Self { _file: file })
    }
}

/// Takes a shared lock on a folder of results, so that no run changes them while they are read. Returns `None` if no
/// run has ever used the folder.
///
/// # Errors
/// Returns an error if another process holds the lock.
pub fn share(derived: &Path) -> Result<Option<Lock>, StoreError> {
    let path = derived.join(LOCK_FILE);
    let mut file = match File::open(&path) {
        Ok(file) => file,
        Err(problem) if problem.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(StoreError::Read { path, source }),
    };
    match file.try_lock_shared() {
        Ok(()) => Ok(Some(Lock { _file: file })),
        Err(TryLockError::WouldBlock) => Err(StoreError::Held { path, holder: holder(&mut file) }),
        Err(TryLockError::Error(source)) => Err(StoreError::Read { path, source }),
    }
}

/// Describes in words which process holds the lock on a lock file.
fn holder(file: &mut File) -> String {
    let mut text = String::new();
    // Some operating systems do not let other processes read a locked file.
    let _ = file.read_to_string(&mut text);
    match serde_json::from_str::<Holder>(&text) {
        Ok(Holder { process, host, started_unix_s }) => {
            let host = host.map_or(String::new(), |host| format!(" on {host}"));
            let age_s = now_s().saturating_sub(started_unix_s);
            format!("process {process}{host}, for {age_s} s")
        }
        Err(_) => "another process".to_owned(),
    }
}

/// Returns the current Unix time, s.
fn now_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

/// Returns the host name of this computer; `None` if it is unknown.
fn host() -> Option<String> {
    const LINUX: &str = "/proc/sys/kernel/hostname";
    let name = std::fs::read_to_string(LINUX).ok();
    let name = name.or_else(|| std::env::var("COMPUTERNAME").ok());
    let name = name.or_else(|| std::env::var("HOSTNAME").ok());
    Some(name?.trim().to_owned()).filter(|name| !name.is_empty())
}

/// Removes the unfinished files that killed processes have left in `folders`. The caller must hold the lock.
///
/// # Errors
/// Returns an error if a file cannot be removed.
pub fn sweep(_lock: &Lock, folders: &[PathBuf]) -> Result<(), StoreError> {
    remove_unfinished(folders)
}

/// Checks, before any work is done, that results can be written: each of `folders` must exist or be creatable, and be
/// writable; none of `files` may be a folder.
///
/// # Errors
/// Returns an error that names the first unusable path.
fn check_writable(folders: &[PathBuf], files: &[PathBuf]) -> Result<(), StoreError> {
    for folder in folders {
        let error = |source| StoreError::Write { path: folder.clone(), source };
        if folder.exists() && !folder.is_dir() {
            return Err(StoreError::Place {
                path: folder.clone(),
                found: "a file",
                needed: "a folder",
            });
        }
        std::fs::create_dir_all(folder).map_err(error)?;
        tempfile::Builder::new().prefix(WRITING).tempfile_in(folder).map_err(error)?;
    }
    match files.iter().find(|path| path.is_dir()) {
        Some(path) => {
            let needed = "a path for a regular file";
            Err(StoreError::Place { path: path.clone(), found: "a folder", needed })
        }
        None => Ok(()),
    }
}

/// Locks the folder of results and checks that all results can be written. If another process holds the lock, waits if
/// `wait` is set, and otherwise returns an error.
pub(super) fn take_over(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Lock, RunError> {
    let derived = &config.paths.derived;
    let reports = &config.paths.reports;
    let folders = folders(config);
    let names = [RECORD_FILE].into_iter().chain(trilink_ingest::TABLES);
    let names = names.chain(trilink_fit::TABLES).chain(trilink_fit::optimise::TABLES);
    let mut files: Vec<PathBuf> = names.map(|name| derived.join(name)).collect();
    files.extend(trilink_report::FILES.map(|name| reports.join(name)));
    files.push(record_path(config));
    files.push(config.paths.history.clone());
    hold_places(&folders, &files, wait, watch)
}

/// Locks the first of `folders`, checks that all `folders` and `files` can be written, and removes the unfinished files
/// of killed processes. If another process holds the lock, waits if `wait` is set, and otherwise returns an error.
pub(super) fn hold_places(
    folders: &[PathBuf],
    files: &[PathBuf],
    wait: bool,
    watch: &dyn Watch,
) -> Result<Lock, RunError> {
    check_writable(&folders[..1], &[folders[0].join(LOCK_FILE)])?;
    let lock = Lock::take(&folders[0], wait.then_some(watch)).map_err(RunError::from_lock)?;
    check_writable(folders, files)?;
    sweep(&lock, folders)?;
    Ok(lock)
}

/// Returns the folders that a run writes to, `derived/` first.
pub(super) fn folders(config: &Config) -> Vec<PathBuf> {
    let reports = &config.paths.reports;
    let mut folders = table_folders(&config.paths.derived);
    folders.extend([reports.clone(), reports.join("figures"), reports.join("trials")]);
    folders
}

/// Returns the paths of a folder of results and of its subfolders for tables.
pub(super) fn table_folders(derived: &Path) -> Vec<PathBuf> {
    let inner = trilink_ingest::TRIAL_FOLDERS.map(|folder| derived.join(folder));
    std::iter::once(derived.to_owned()).chain(inner).collect()
}

/// Returns the path of `run.json`.
pub(super) fn record_path(config: &Config) -> PathBuf {
    config.paths.reports.join("run.json")
}
