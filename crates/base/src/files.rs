//! Files that are read: regular ones of a bearable size.

use std::fs::{File, Metadata};
use std::io::{self, ErrorKind, Read};
use std::path::{Component, Path, PathBuf};

/// Most bytes of a configuration, list, record or page.
pub const TEXT_BYTES: u64 = 1 << 28;
/// Most bytes of a marker file or table: some twenty hours of ten markers as text.
pub const DATA_BYTES: u64 = 1 << 31;

/// The ending of a file's name, without its dot; empty where there is none.
pub fn ending(path: &Path) -> &str {
    path.extension().and_then(|ending| ending.to_str()).unwrap_or_default()
}

/// The bytes of a file, or of what a link points to, with what the system says of it.
///
/// # Errors
/// It is a folder, a device or a pipe, has more than `most` bytes, or cannot be read.
pub fn read(path: &Path, most: u64) -> io::Result<(Vec<u8>, Metadata)> {
    let (file, metadata) = open(path, most)?;
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(metadata.len() as usize + 1)?;
    file.take(most + 1).read_to_end(&mut bytes)?;
    check_size(bytes.len() as u64, most)?;
    Ok((bytes, metadata))
}

/// Opens a file of which a part is to be read.
///
/// # Errors
/// As [`read`].
pub fn open(path: &Path, most: u64) -> io::Result<(File, Metadata)> {
    // Whoever opens a pipe waits for its other end.
    check(&std::fs::metadata(path)?, most)?;
    let file = File::open(path)?;
    let metadata = file.metadata()?;
    check(&metadata, most)?;
    Ok((file, metadata))
}

/// [`read`] of text.
///
/// # Errors
/// As [`read`], or it is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    let (bytes, _) = read(path, TEXT_BYTES)?;
    String::from_utf8(bytes).map_err(|error| io::Error::new(ErrorKind::InvalidData, error))
}

/// `to` as seen from the folder `from`; as it is where one of them is absolute and the other
/// not, or where `from` climbs.
pub fn relative(from: &Path, to: &Path) -> String {
    let plain = |path: &Path| -> PathBuf {
        path.components().filter(|part| *part != Component::CurDir).collect()
    };
    let (from, to) = (plain(from), plain(to));
    let common = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let rest: Vec<_> = from.components().skip(common).collect();
    let climbs = rest.iter().any(|part| !matches!(part, Component::Normal(_)));
    let path = if climbs || from.is_absolute() != to.is_absolute() {
        to
    } else {
        rest.iter().map(|_| Component::ParentDir).chain(to.components().skip(common)).collect()
    };
    let path = path.to_string_lossy();
    // Elsewhere a name may have a backslash in it.
    if cfg!(windows) { path.replace('\\', "/") } else { path.into_owned() }
}

/// A path as seen from a folder, so that it means the same in a copy of both.
pub fn name_in(folder: &Path, path: &Path) -> String {
    let is_below_here = |path: &Path| {
        path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
    };
    match is_below_here(folder) && is_below_here(path) {
        true => relative(folder, path),
        false => relative(&absolute(folder), &absolute(path)),
    }
}

/// A path from the root, where the empty one is the current folder; as it is where that is gone.
pub fn absolute(path: &Path) -> PathBuf {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// Whether Windows takes a file of this name for a device, whatever follows its first dot.
pub fn is_device_name(name: &str) -> bool {
    let name = name.split('.').next().unwrap_or_default().trim_end().to_ascii_lowercase();
    let digits = "0123456789\u{b9}\u{b2}\u{b3}";
    let numbered = |port| {
        name.strip_prefix(port).is_some_and(|number| {
            number.chars().count() == 1 && number.chars().all(|digit| digits.contains(digit))
        })
    };
    ["con", "prn", "aux", "nul"].contains(&name.as_str())
        || ["com", "lpt"].into_iter().any(numbered)
}

fn check(metadata: &Metadata, most: u64) -> io::Result<()> {
    let found = match metadata.file_type() {
        kind if kind.is_file() => return check_size(metadata.len(), most),
        kind if kind.is_dir() => "a folder",
        _ => "a device or pipe",
    };
    Err(io::Error::new(ErrorKind::Unsupported, format!("found {found}, needed a file")))
}

fn check_size(bytes: u64, most: u64) -> io::Result<()> {
    if bytes <= most {
        return Ok(());
    }
    let message = format!("found {bytes} bytes or more, needed {most} at most");
    Err(io::Error::new(ErrorKind::FileTooLarge, message))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_of_a_bearable_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "12345").unwrap();
        assert_eq!(read(&path, 5).unwrap().0, b"12345");
        let refused = |path: &Path, most| read(path, most).unwrap_err().to_string();
        assert_eq!(refused(&path, 4), "found 5 bytes or more, needed 4 at most");
        assert_eq!(refused(folder.path(), 4), "found a folder, needed a file");
        #[cfg(unix)]
        assert_eq!(refused(Path::new("/dev/zero"), 4), "found a device or pipe, needed a file");
        // Sparse: nothing of it is on the disk.
        File::create(&path).unwrap().set_len(5 << 30).unwrap();
        assert!(refused(&path, DATA_BYTES).starts_with("found 5368709120 bytes or more"));
        assert_eq!(read(&folder.path().join("b"), 4).unwrap_err().kind(), ErrorKind::NotFound);
    }

    #[test]
    fn a_path_is_as_seen_from_a_folder() {
        let from_to = |from, to| relative(Path::new(from), Path::new(to));
        assert_eq!(from_to("reports", "derived"), "../derived");
        assert_eq!(from_to("./a/reports", "a/raw/demo"), "../raw/demo");
        assert_eq!(from_to("/data/x/reports", "/data/x/derived"), "../derived");
        assert_eq!(from_to("../reports", "derived"), "derived");
        let with_backslash = if cfg!(windows) { "../a/b" } else { r"../a\b" };
        assert_eq!(from_to("reports", r"a\b"), with_backslash);
    }

    #[test]
    fn names_of_devices_are_known() {
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
