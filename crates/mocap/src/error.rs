//! Errors in marker files.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Reason why a marker file cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}{problem}", path.display())]
pub struct ReadError {
    pub path: PathBuf,
    pub problem: FileProblem,
}

/// Problem with a file, worded to follow the file's name in a message.
#[derive(Debug, thiserror::Error)]
pub enum FileProblem {
    #[error(": no such file")]
    Missing,
    #[error(": cannot be read: {0}")]
    Read(std::io::Error),
    #[error(": cannot be unpacked: {0}")]
    Unpack(std::io::Error),
    /// Unusable content. `place` names the line, and possibly the cell; it is empty if the problem concerns the whole
    /// file.
    #[error("{place}: found {found}, needed {needed}")]
    Content { place: String, found: String, needed: String },
}

impl FileProblem {
    /// Creates a problem that concerns the whole file.
    pub(super) fn new(found: impl Into<String>, needed: impl Into<String>) -> Self {
        Self::Content { place: String::new(), found: found.into(), needed: needed.into() }
    }

    /// Creates a problem that concerns a single line.
    pub(super) fn in_line(
        line: usize,
        found: impl Into<String>,
        needed: impl Into<String>,
    ) -> Self {
        Self::Content {
            place: format!(", line {line}"),
            found: found.into(),
            needed: needed.into(),
        }
    }

    pub(super) fn in_file(self, path: &Path) -> ReadError {
        ReadError { path: path.to_owned(), problem: self }
    }
}

impl ReadError {
    /// Returns the kind of the operating system's error if the file could not be read; otherwise `None`.
    pub fn system(&self) -> Option<ErrorKind> {
        match &self.problem {
            FileProblem::Missing => Some(ErrorKind::NotFound),
            FileProblem::Read(error) => Some(error.kind()),
            _ => None,
        }
    }
}
