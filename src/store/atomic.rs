//! Files that are there whole or not at all.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::{Stamp, StoreError, hash};
use crate::files;

/// How the names of files begin that are being written.
pub const WRITING: &str = ".writing-";

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
        let settled = file
            .as_file()
            .sync_all()
            .and_then(|()| file.persist(&path).map_err(|error| error.error))
            .and_then(|file| file.metadata());
        match settled {
            Ok(metadata) => Ok(Stamp::of_output(&metadata, blake3)),
            Err(source) => Err(StoreError::Write { path, source }),
        }
    }
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
    match files::read(path, bytes.len() as u64) {
        Ok((found, metadata)) if found == bytes => Ok(Stamp::of_output(&metadata, hash(bytes))),
        _ => write_bytes(path, bytes),
    }
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
        fs::remove_file(&path).map_err(|source| StoreError::Remove { path, source })?;
    }
    Ok(())
}
