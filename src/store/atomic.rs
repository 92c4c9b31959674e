//! Files that are there whole or not at all.

use std::fs;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use super::StoreError;

/// A file that is written beside its place and not yet there.
#[derive(Debug)]
pub struct Beside {
    path: PathBuf,
    file: tempfile::NamedTempFile,
}

impl Beside {
    /// Writes a file beside its place; creates the folder if need be.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(
        path: &Path,
        write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<Self, StoreError> {
        let attempt = || {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let folder = folder.unwrap_or(Path::new("."));
            fs::create_dir_all(folder)?;
            let file = tempfile::Builder::new().prefix(".writing-").tempfile_in(folder)?;
            let mut buffer = BufWriter::new(file);
            write(&mut buffer)?;
            let file = buffer.into_inner().map_err(|error| error.into_error())?;
            make_readable(file.as_file())?;
            Ok(Self { path: path.to_owned(), file })
        };
        attempt().map_err(|source| StoreError::Write { path: path.to_owned(), source })
    }

    /// Flushes the file to the disk and renames it into its place.
    ///
    /// # Errors
    /// Either fails; then what was there before stays.
    pub fn settle(self) -> Result<(), StoreError> {
        let Self { path, file } = self;
        let settled = file
            .as_file()
            .sync_all()
            .and_then(|()| file.persist(&path).map_err(|error| error.error));
        settled.map(|_| ()).map_err(|source| StoreError::Write { path, source })
    }
}

/// Writes bytes at hand beside their place, flushes them to the disk and renames them into place;
/// creates the folder if need be. An error leaves what was there before.
///
/// # Errors
/// The file cannot be written.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    Beside::write(path, |file| file.write_all(bytes))?.settle()
}

/// Temporary files are private; results are for everybody who may read the folder.
#[cfg(unix)]
fn make_readable(file: &fs::File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn make_readable(_file: &fs::File) -> std::io::Result<()> {
    Ok(())
}
