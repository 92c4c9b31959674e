//! Temporary folders of tests, also of those that statics hold and nothing drops.

use std::fs::{File, remove_dir_all};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use tempfile::{Builder, NamedTempFile, TempDir};

/// What the folder of each process begins with.
const PREFIX: &str = "trilink-tests-";

/// The file in it that the process holds locked.
const HELD: &str = "held";

/// A folder that goes with its value, or when tests next start.
pub fn temporary() -> TempDir {
    TempDir::new_in(of_process(&std::env::temp_dir())).expect("a temporary folder")
}

/// The folder of this process, made in `place` by the first call. Those that earlier processes left there go.
pub fn of_process(place: &Path) -> &'static Path {
    static MADE: OnceLock<(PathBuf, File)> = OnceLock::new();
    let (folder, _) = MADE.get_or_init(|| {
        remove_left(place);
        let folder = Builder::new().prefix(PREFIX).tempdir_in(place).expect("a folder").keep();
        // Locked before it has the name by which others know it.
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
            // Another process that starts may be removing it.
            let _ = remove_dir_all(folder);
        }
    }
}
