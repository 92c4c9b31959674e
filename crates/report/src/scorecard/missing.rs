//! Why a formula has no number.

use minijinja::{Error, ErrorKind};

pub(super) const NO_MOTION: &str = "There is no such motion.";
pub(super) const NO_TRIALS: &str = "The folder has no such trials.";

/// A number that there is not, and why.
pub(super) fn missing(reason: &'static str) -> Error {
    Error::new(ErrorKind::UndefinedError, reason)
}

/// A name in a formula that stands for nothing.
pub(super) fn unknown(name: &str) -> Error {
    Error::new(ErrorKind::UnknownMethod, format!("nothing is called {name}"))
}
