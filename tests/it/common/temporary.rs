//! Temporary folders for tests, including those in statics, which are never dropped.

use std::fs::{File, remove_dir_all};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use tempfile::{Builder, NamedTempFile, TempDir};

/// Prefix of the names of the folders that test processes create.
const PREFIX: &str = "trilink-tests-";

/// Name of the file in a process's folder that the process keeps locked.
const HELD: &str = "held";

/// Creates a temporary folder, removed on drop or else when tests are next started.
pub fn temporary() -> TempDir {
    TempDir::new_in(of_process(&std::env::temp_dir())).expect("a temporary folder")
}

/// Returns the folder of this process, which the first call creates in `place`. The folders of earlier processes are
/// removed.
pub fn of_process(place: &Path) -> &'static Path {
    static MADE: OnceLock<(PathBuf, File)> = OnceLock::new();
    let (folder, _) = MADE.get_or_init(|| {
        remove_left(place);
        let folder = Builder::new().prefix(PREFIX).tempdir_in(place).expect("a folder").keep();
        // Lock the file before it gets the name that other processes look for.
        let held = NamedTempFile::new_in(&folder).expect("a file");
        held.as_file().lock().expect("a lock");
        let held = held.persist(folder.join(HELD)).expect("a name");
        (folder, held)
    });
    folder
}

fn remove_left(place: &Path) {
    for entry in place.read_dir().into_iter().flatten().flatten() {
        let folder = entry.path();
        let of_tests = entry.file_name().to_string_lossy().starts_with(PREFIX);
        if of_tests && File::open(folder.join(HELD)).is_ok_and(|held| held.try_lock().is_ok()) {
            // Another process that starts may remove the folder at the same time.
            let _ = remove_dir_all(folder);
        }
    }
}
