//! One run at a time on a folder of results.

use std::fs::{File, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use trilink_tables::config::Config;
use trilink_tables::{StoreError, WRITING, remove_unfinished};

use super::record::RECORD_FILE;
use super::{RunError, Watch};

/// Name of the lock inside `derived/`. The file stays; what counts is who holds it, and the
/// system lets go of it when a process ends, however that ends.
const LOCK_FILE: &str = ".lock";

/// How often who waits looks whether the lock is free.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

/// A folder of results that nobody else writes to while this lives.
#[derive(Debug)]
pub struct Lock {
    _file: File,
}

/// Who holds a lock, as the file says it.
#[derive(Debug, Serialize, Deserialize)]
struct Holder {
    process: u32,
    host: Option<String>,
    started_unix_s: u64,
}

impl Lock {
    /// Takes the lock of `derived`, which is made if need be. If another process has it, waits
    /// for it after `waiting` was told who that is; without `waiting` it gives up.
    ///
    /// # Errors
    /// Another process has it, or the file cannot be written.
    pub fn take(derived: &Path, waiting: Option<&dyn Watch>) -> Result<Self, StoreError> {
        let path = derived.join(LOCK_FILE);
        let error = |source| StoreError::Write { path: path.clone(), source };
        std::fs::create_dir_all(derived)
            .map_err(|source| StoreError::Write { path: derived.to_owned(), source })?;
        // Whoever follows a link writes where nothing of this program is.
        if let Ok(kind) = std::fs::symlink_metadata(&path).map(|found| found.file_type())
            && !kind.is_file()
        {
            let found = if kind.is_symlink() { "a link" } else { "a device or pipe" };
            return Err(StoreError::Place { path, found, needed: "a place for a file" });
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
                    std::thread::sleep(LOOK_AGAIN);
                }
            }
            Err(TryLockError::Error(source)) => return Err(error(source)),
        }
        let holder = Holder { process: std::process::id(), host: host(), started_unix_s: now_s() };
        let text = serde_json::to_string(&holder).expect("a holder is plain data") + "\n";
        file.set_len(0)
            .and_then(|()| file.rewind())
            .and_then(|()| file.write_all(text.as_bytes()))
            .map_err(error)?;
        Ok(Self { _file: file })
    }
}

/// Keeps runs from a folder of results that is only read, while this lives; `None` if no run has
/// ever been there.
///
/// # Errors
/// Another process is busy with the folder.
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

/// Who holds a lock, in words.
fn holder(file: &mut File) -> String {
    let mut text = String::new();
    // Some systems do not let others read a file that is locked.
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

fn now_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

fn host() -> Option<String> {
    const LINUX: &str = "/proc/sys/kernel/hostname";
    let said = std::fs::read_to_string(LINUX).ok();
    let said = said.or_else(|| std::env::var("COMPUTERNAME").ok());
    let said = said.or_else(|| std::env::var("HOSTNAME").ok());
    said.map(|name| name.trim().to_owned()).filter(|name| !name.is_empty())
}

/// Removes what writers that were killed left in these folders. Only who holds the lock may.
///
/// # Errors
/// A file cannot be removed.
pub fn sweep(_lock: &Lock, folders: &[PathBuf]) -> Result<(), StoreError> {
    remove_unfinished(folders)
}

/// Checks that results can be written before any work is done: that `folders` are folders, or
/// can be made, in which files can be made, and that none of `files` is a folder.
///
/// # Errors
/// Names the first place that will not do.
fn check_places(folders: &[PathBuf], files: &[PathBuf]) -> Result<(), StoreError> {
    for folder in folders {
        let error = |source| StoreError::Write { path: folder.clone(), source };
        if folder.exists() && !folder.is_dir() {
            let (found, needed) = ("a file", "a folder");
            return Err(StoreError::Place { path: folder.clone(), found, needed });
        }
        std::fs::create_dir_all(folder).map_err(error)?;
        tempfile::Builder::new().prefix(WRITING).tempfile_in(folder).map_err(error)?;
    }
    match files.iter().find(|path| path.is_dir()) {
        Some(path) => {
            let (found, needed) = ("a folder", "a place for a file");
            Err(StoreError::Place { path: path.clone(), found, needed })
        }
        None => Ok(()),
    }
}

/// Takes the lock of the folder of results, and makes sure that there is where to write to.
pub(super) fn take_over(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Lock, RunError> {
    let (derived, reports) = (&config.paths.derived, &config.paths.reports);
    let folders = folders(config);
    let names = [RECORD_FILE].into_iter().chain(trilink_ingest::TABLES);
    let names = names.chain(trilink_fit::TABLES).chain(trilink_fit::optimise::TABLES);
    let mut files: Vec<PathBuf> = names.map(|name| derived.join(name)).collect();
    files.extend(trilink_report::FILES.map(|name| reports.join(name)));
    files.push(record_path(config));
    hold_places(&folders, &files, wait, watch)
}

/// Takes the lock in the first of `folders`, and makes sure that all files can be written.
pub(super) fn hold_places(
    folders: &[PathBuf],
    files: &[PathBuf],
    wait: bool,
    watch: &dyn Watch,
) -> Result<Lock, RunError> {
    check_places(&folders[..1], &[folders[0].join(LOCK_FILE)])?;
    let lock = Lock::take(&folders[0], wait.then_some(watch)).map_err(RunError::of_lock)?;
    check_places(folders, files)?;
    sweep(&lock, folders)?;
    Ok(lock)
}

/// Folders that are written to, `derived/` first.
pub(super) fn folders(config: &Config) -> Vec<PathBuf> {
    let reports = &config.paths.reports;
    let mut folders = table_folders(&config.paths.derived);
    folders.extend([reports.clone(), reports.join("figures"), reports.join("trials")]);
    folders
}

/// A folder of results and those inside of it that tables are written to.
pub(super) fn table_folders(derived: &Path) -> Vec<PathBuf> {
    let inner = trilink_ingest::FOLDERS.map(|folder| derived.join(folder));
    std::iter::once(derived.to_owned()).chain(inner).collect()
}

pub(super) fn record_path(config: &Config) -> PathBuf {
    config.paths.reports.join("run.json")
}
