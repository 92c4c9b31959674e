//! Reading of regular files of limited size, and paths relative to a folder.

use std::fs::{File, Metadata};
use std::io::{self, ErrorKind, Read};
use std::path::{Component, Path, PathBuf};

/// Maximum size of a configuration file, trial list, run record or report page, bytes.
pub const TEXT_BYTES: u64 = 1 << 28;
/// Maximum size of a marker file or table, bytes: about twenty hours of ten markers as text.
pub const DATA_BYTES: u64 = 1 << 31;

/// Returns the extension of a file name without the dot; empty if there is none.
pub fn ending(path: &Path) -> &str {
    path.extension().and_then(|ending| ending.to_str()).unwrap_or_default()
}

/// Reads the bytes and metadata of a regular file; symbolic links are followed.
///
/// # Errors
/// Returns an error if the path is a folder, a device or a pipe, if the file has more than `max_bytes` bytes, or if it
/// cannot be read.
pub fn read(path: &Path, max_bytes: u64) -> io::Result<(Vec<u8>, Metadata)> {
    let (file, metadata) = open(path, max_bytes)?;
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(metadata.len() as usize + 1)?;
    file.take(max_bytes + 1).read_to_end(&mut bytes)?;
    check_size(bytes.len() as u64, max_bytes)?;
    Ok((bytes, metadata))
}

/// Opens a regular file to read only a part of it.
///
/// # Errors
/// Returns an error in the same cases as [`read`].
pub fn open(path: &Path, max_bytes: u64) -> io::Result<(File, Metadata)> {
    // Check before opening, because opening a pipe blocks until its other end is open.
    check_regular(&std::fs::metadata(path)?, max_bytes)?;
    let file = File::open(path)?;
    let metadata = file.metadata()?;
    check_regular(&metadata, max_bytes)?;
    Ok((file, metadata))
}

/// Reads a UTF-8 text file of at most [`TEXT_BYTES`] bytes.
///
/// # Errors
/// Returns an error in the same cases as [`read`], or if the file is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    let (bytes, _) = read(path, TEXT_BYTES)?;
    String::from_utf8(bytes).map_err(|error| io::Error::new(ErrorKind::InvalidData, error))
}

/// Returns the path `to` relative to the folder `from`, with `/` as the separator.
///
/// `to` is returned unchanged if only one of the paths is absolute, or if `from` leads upwards (`..`).
pub fn relative(from: &Path, to: &Path) -> String {
    let from = without_current_folder(from);
    let to = without_current_folder(to);
    let common = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let rest: Vec<_> = from.components().skip(common).collect();
    let leads_upwards = rest.iter().any(|part| !matches!(part, Component::Normal(_)));
    let path = if leads_upwards || from.is_absolute() != to.is_absolute() {
        to
    } else {
        rest.iter().map(|_| Component::ParentDir).chain(to.components().skip(common)).collect()
    };
    let path = path.to_string_lossy();
    // On other systems a backslash may be part of a name.
    if cfg!(windows) { path.replace('\\', "/") } else { path.into_owned() }
}

/// Removes the `.` components of a path.
fn without_current_folder(path: &Path) -> PathBuf {
    path.components().filter(|part| *part != Component::CurDir).collect()
}

/// Returns the name by which files in `folder` refer to `path`: its relative path, which stays valid if both are moved
/// together.
pub fn name_in(folder: &Path, path: &Path) -> String {
    if is_below_current_folder(folder) && is_below_current_folder(path) {
        relative(folder, path)
    } else {
        relative(&absolute(folder), &absolute(path))
    }
}

fn is_below_current_folder(path: &Path) -> bool {
    path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
}

/// Converts a path to an absolute path. The empty path stands for the current folder; the path is returned
/// unchanged if the current folder no longer exists.
pub fn absolute(path: &Path) -> PathBuf {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// Returns whether Windows reserves a file name for a device; only the part before the first dot matters.
pub fn is_device_name(name: &str) -> bool {
    let name = name.split('.').next().unwrap_or_default().trim_end().to_ascii_lowercase();
    if ["con", "prn", "aux", "nul"].contains(&name.as_str()) {
        return true;
    }
    let digits = "0123456789\u{b9}\u{b2}\u{b3}";
    let port = name.strip_prefix("com").or_else(|| name.strip_prefix("lpt"));
    port.is_some_and(|number| {
        number.chars().count() == 1 && number.chars().all(|digit| digits.contains(digit))
    })
}

fn check_regular(metadata: &Metadata, max_bytes: u64) -> io::Result<()> {
    let found = match metadata.file_type() {
        kind if kind.is_file() => return check_size(metadata.len(), max_bytes),
        kind if kind.is_dir() => "a folder",
        _ => "a device or pipe",
    };
    Err(io::Error::new(ErrorKind::Unsupported, format!("found {found}, needed a file")))
}

fn check_size(bytes: u64, max_bytes: u64) -> io::Result<()> {
    if bytes <= max_bytes {
        return Ok(());
    }
    let message = format!("found at least {bytes} bytes, but at most {max_bytes} are allowed");
    Err(io::Error::new(ErrorKind::FileTooLarge, message))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_of_limited_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "12345").unwrap();
        assert_eq!(read(&path, 5).unwrap().0, b"12345");
        let refused = |path: &Path, max_bytes| read(path, max_bytes).unwrap_err().to_string();
        assert_eq!(refused(&path, 4), "found at least 5 bytes, but at most 4 are allowed");
        assert_eq!(refused(folder.path(), 4), "found a folder, needed a file");
        #[cfg(unix)]
        assert_eq!(refused(Path::new("/dev/zero"), 4), "found a device or pipe, needed a file");
        // A sparse file takes no space on the disk.
        File::create(&path).unwrap().set_len(5 << 30).unwrap();
        assert!(refused(&path, DATA_BYTES).starts_with("found at least 5368709120 bytes"));
        assert_eq!(read(&folder.path().join("b"), 4).unwrap_err().kind(), ErrorKind::NotFound);
    }

    #[test]
    fn paths_are_made_relative_to_a_folder() {
        let from_to = |from, to| relative(Path::new(from), Path::new(to));
        assert_eq!(from_to("reports", "derived"), "../derived");
        assert_eq!(from_to("./a/reports", "a/raw/demo"), "../raw/demo");
        assert_eq!(from_to("/data/x/reports", "/data/x/derived"), "../derived");
        assert_eq!(from_to("../reports", "derived"), "derived");
        let with_backslash = if cfg!(windows) { "../a/b" } else { r"../a\b" };
        assert_eq!(from_to("reports", r"a\b"), with_backslash);
    }

    #[test]
    fn device_names_of_windows_are_recognised() {
        for name in
            ["CON", "nul", "Aux.csv", "con.1.parquet", "prn ", "COM1", "lpt9.c3d", "com\u{b2}"]
        {
            assert!(is_device_name(name), "{name}");
        }
        for name in ["", "console", "con_1", "com", "com10", "lptx", "a.con", ".con", "g-nul"] {
            assert!(!is_device_name(name), "{name}");
        }
    }
}
