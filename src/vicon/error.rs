//! What can be wrong with a marker file.

use std::path::PathBuf;

/// Why a marker file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ViconError {
    #[error("{}: no such file", path.display())]
    Missing { path: PathBuf },
    #[error("{}: cannot be read: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}: cannot be unpacked: {source}", path.display())]
    Unpack { path: PathBuf, source: std::io::Error },
    #[error("{}: found more than {limit_bytes} bytes when unpacked, needed at most that", path.display())]
    TooLarge { path: PathBuf, limit_bytes: u64 },
    #[error("{}: found UTF-16, needed a text in UTF-8; save it as `CSV UTF-8`", path.display())]
    Utf16 { path: PathBuf },
    #[error("{}: found {found}, needed {needed}", path.display())]
    C3d { path: PathBuf, found: String, needed: &'static str },
    #[error("{}: found an empty file, needed a `Trajectories` section", path.display())]
    Empty { path: PathBuf },
    #[error("{}: found {found}, needed a `Trajectories` section", path.display())]
    NoSection { path: PathBuf, found: String },
    #[error("{}, line {line}: found {found}, needed {needed}", path.display())]
    Header { path: PathBuf, line: usize, found: String, needed: String },
    #[error("{}: found no row of numbers below line {line}, needed at least one frame", path.display())]
    NoRows { path: PathBuf, line: usize },
    #[error("{}: found {rows} rows below line {line} and none with a frame number, needed at least one", path.display())]
    NoFrameNumbers { path: PathBuf, line: usize, rows: usize },
    #[error("{}, line {line}: found a second `Trajectories` section, needed one", path.display())]
    TwoSections { path: PathBuf, line: usize },
    #[error("{}, line {line}, column {column} ({name}): found `{found}`, needed {needed}", path.display())]
    NotANumber {
        path: PathBuf,
        line: usize,
        /// Counted from 1.
        column: usize,
        /// What the column holds, such as `Snake:M1 X` or `Frame`.
        name: String,
        found: String,
        needed: &'static str,
    },
    #[error("{}, line {line}: found frame {found} after frame {previous}, needed a larger number", path.display())]
    FrameOrder { path: PathBuf, line: usize, found: i64, previous: i64 },
    #[error("{}, line {line}: found the file's end after {found} cells of a row, needed {needed}; is the copy complete?", path.display())]
    Cut { path: PathBuf, line: usize, found: usize, needed: usize },
    #[error("{}, line {line}: found rows much shorter than the {markers} markers of the header, needed one cell per axis", path.display())]
    ShortRows { path: PathBuf, line: usize, markers: usize },
}
