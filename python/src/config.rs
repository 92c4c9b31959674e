//! Cache for the configuration loaded last, because reading the file takes longer than solving for a motion.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::SystemTime;

use trilink_tables::config::{CONFIG_FILE, Config};

use crate::error::Failure;

/// State of a configuration file at the time it was read.
#[derive(PartialEq)]
struct FileState {
    /// Path of the file as given by the caller; relative paths in the configuration are resolved against the folder of
    /// this path.
    given: PathBuf,
    path: PathBuf,
    modified: SystemTime,
    bytes: u64,
}

static LAST: Mutex<Option<(FileState, Config)>> = Mutex::new(None);

/// Loads a configuration like [`Config::load_or_default`], but rereads a file only if its modification time or size has
/// changed.
pub fn load(path: Option<&Path>) -> Result<Config, Failure> {
    let Some(state) = file_state(path.unwrap_or(Path::new(CONFIG_FILE))) else {
        return Ok(Config::load_or_default(path)?);
    };
    // Even after a panic in another thread, the cache holds a complete configuration or none.
    let last = || LAST.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    if let Some((last, config)) = &*last()
        && *last == state
    {
        return Ok(config.clone());
    }
    let config = Config::load_or_default(path)?;
    *last() = Some((state, config.clone()));
    Ok(config)
}

/// Returns the current state of a file; `None` if the file does not exist or its state cannot be determined.
fn file_state(path: &Path) -> Option<FileState> {
    let metadata = path.metadata().ok()?;
    let given = path.to_owned();
    let path = std::path::absolute(path).ok()?;
    Some(FileState { given, path, modified: metadata.modified().ok()?, bytes: metadata.len() })
}
