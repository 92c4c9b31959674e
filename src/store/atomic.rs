//! Files that are there whole or not at all.

use std::fs;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use super::{Stamp, StoreError};

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
    pub fn write(
        path: &Path,
        write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<Self, StoreError> {
        let attempt = || {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let folder = folder.unwrap_or(Path::new("."));
            fs::create_dir_all(folder)?;
            let file = tempfile::Builder::new().prefix(WRITING).tempfile_in(folder)?;
            let mut hashing = Hashing { to: BufWriter::new(file), hasher: blake3::Hasher::new() };
            write(&mut hashing)?;
            let blake3 = hashing.hasher.finalize().to_hex().to_string();
            let file = hashing.to.into_inner().map_err(|error| error.into_error())?;
            make_readable(file.as_file())?;
            Ok(Self { path: path.to_owned(), file, blake3 })
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

/// Hashes what it passes on.
struct Hashing<W> {
    to: W,
    hasher: blake3::Hasher,
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.to.write(bytes)?;
        self.hasher.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.to.flush()
    }
}

/// Writes bytes at hand beside their place, flushes them to the disk and renames them into place;
/// creates the folder if need be. An error leaves what was there before.
///
/// # Errors
/// The file cannot be written.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<Stamp, StoreError> {
    PendingFile::write(path, |file| file.write_all(bytes))?.settle()
}

/// [`write_bytes`], unless the file has these bytes already: then it is left alone.
///
/// # Errors
/// The file cannot be written.
pub fn write_if_changed(path: &Path, bytes: &[u8]) -> Result<Stamp, StoreError> {
    match fs::metadata(path) {
        Ok(metadata)
            if metadata.is_file()
                && metadata.len() == bytes.len() as u64
                && fs::read(path).is_ok_and(|found| found == bytes) =>
        {
            Ok(Stamp::of_output(&metadata, super::hash(bytes)))
        }
        _ => write_bytes(path, bytes),
    }
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
