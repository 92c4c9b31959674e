//! Errors for formulas that cannot be evaluated.

use minijinja::{Error, ErrorKind};

pub(super) const NO_MOTION: &str = "No motion of the model was found for this claim.";
pub(super) const NO_TRIALS: &str = "The tables contain no trials for this claim.";

/// Creates the error for a value that does not exist, with the reason.
pub(super) fn missing(reason: &'static str) -> Error {
    Error::new(ErrorKind::UndefinedError, reason)
}

/// Creates the error for an unknown name in a formula.
pub(super) fn unknown(name: &str) -> Error {
    Error::new(ErrorKind::UnknownMethod, format!("unknown name {name}"))
}
