//! Files that are there whole or not at all.

use std::fs;
use std::io::{BufWriter, Write};
use std::path::Path;

use super::StoreError;

/// Writes a file beside its place, flushes it to the disk and renames it into place; creates
/// the folder if need be. An error leaves what was there before.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), StoreError> {
    let attempt = || {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        fs::create_dir_all(folder)?;
        let beside = tempfile::Builder::new().prefix(".writing-").tempfile_in(folder)?;
        let mut buffer = BufWriter::new(beside);
        write(&mut buffer)?;
        let beside = buffer.into_inner().map_err(|error| error.into_error())?;
        make_readable(beside.as_file())?;
        beside.as_file().sync_all()?;
        beside.persist(path).map_err(|error| error.error)?;
        Ok(())
    };
    attempt().map_err(|source| StoreError::Write { path: path.to_owned(), source })
}

/// [`write_atomically`] of bytes at hand.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    write_atomically(path, |file| file.write_all(bytes))
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
