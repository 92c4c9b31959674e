//! What can be wrong with a marker file.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Why a marker file cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}{problem}", path.display())]
pub struct ReadError {
    pub path: PathBuf,
    pub problem: FileProblem,
}

/// What is wrong, as it is written after the file's name.
#[derive(Debug, thiserror::Error)]
pub enum FileProblem {
    #[error(": no such file")]
    Missing,
    #[error(": cannot be read: {0}")]
    Read(std::io::Error),
    #[error(": cannot be unpacked: {0}")]
    Unpack(std::io::Error),
    /// `place` is a line, perhaps with a cell, or nothing.
    #[error("{place}: found {found}, needed {needed}")]
    Content { place: String, found: String, needed: String },
}

impl FileProblem {
    /// What is wrong with a file as a whole.
    pub(super) fn new(found: impl Into<String>, needed: impl Into<String>) -> Self {
        Self::Content { place: String::new(), found: found.into(), needed: needed.into() }
    }

    pub(super) fn in_line(
        line: usize,
        found: impl Into<String>,
        needed: impl Into<String>,
    ) -> Self {
        let (found, needed) = (found.into(), needed.into());
        Self::Content { place: format!(", line {line}"), found, needed }
    }

    pub(super) fn of(self, path: &Path) -> ReadError {
        ReadError { path: path.to_owned(), problem: self }
    }
}

impl ReadError {
    /// What the system says of a file that cannot be read.
    pub fn system(&self) -> Option<ErrorKind> {
        match &self.problem {
            FileProblem::Missing => Some(ErrorKind::NotFound),
            FileProblem::Read(error) => Some(error.kind()),
            _ => None,
        }
    }
}
