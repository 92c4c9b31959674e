//! What can be wrong with a marker file.

use std::path::{Path, PathBuf};

/// Why a marker file cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}{problem}", path.display())]
pub struct ViconError {
    pub path: PathBuf,
    pub problem: Problem,
}

/// What is wrong, as it is written after the file's name.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    #[error(": no such file")]
    Missing,
    #[error(": cannot be read: {0}")]
    Read(std::io::Error),
    #[error(": cannot be unpacked: {0}")]
    Unpack(std::io::Error),
    #[error(": found more than {limit_bytes} bytes when unpacked, needed at most that")]
    TooLarge { limit_bytes: u64 },
    #[error(": found UTF-16, needed a text in UTF-8; save it as `CSV UTF-8`")]
    Utf16,
    #[error(": found {found}, needed {needed}")]
    C3d { found: String, needed: &'static str },
    #[error(": found an empty file, needed a `Trajectories` section")]
    Empty,
    #[error(": found {found}, needed a `Trajectories` section")]
    NoSection { found: String },
    #[error(", line {line}: found {found}, needed {needed}")]
    Header { line: usize, found: String, needed: &'static str },
    #[error(": found no row of numbers below line {line}, needed at least one frame")]
    NoRows { line: usize },
    #[error(": found {} rows below line {} and none with a frame number, needed at least one", .rows, .line)]
    NoFrameNumbers { line: usize, rows: usize },
    #[error(", line {line}: found a second `Trajectories` section, needed one")]
    TwoSections { line: usize },
    /// A cell of a column (counted from 1) with its name, such as `Snake:M1 X`.
    #[error(", line {line}, column {column} ({name}): found `{found}`, needed {needed}")]
    NotANumber { line: usize, column: usize, name: String, found: String, needed: &'static str },
    #[error(", line {line}: found frame {found} after frame {previous}, needed a larger number")]
    FrameOrder { line: usize, found: i64, previous: i64 },
    #[error(", line {}: found the file's end after {} cells of a row, needed {}; is the copy complete?", .line, .found, .needed)]
    Cut { line: usize, found: usize, needed: usize },
    #[error(", line {}: found rows much shorter than the {} markers of the header, needed one cell per axis", .line, .markers)]
    ShortRows { line: usize, markers: usize },
}

impl Problem {
    pub(super) fn of(self, path: &Path) -> ViconError {
        ViconError { path: path.to_owned(), problem: self }
    }
}
