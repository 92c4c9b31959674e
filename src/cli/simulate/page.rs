//! Page of `simulate --page`.

use std::path::Path;

use serde::Serialize;
use trilink_mechanics::Problem;
use trilink_report::{SimulationError, simulation_page};
use trilink_tables::write_if_changed;

use crate::cli::Failure;

/// Returns an error unless exactly one model and one frequency are given, so that there is a single motion to animate.
pub(super) fn check(models: usize, frequencies: usize) -> Result<(), Failure> {
    for (what, count) in [("models", models), ("frequencies", frequencies)] {
        if count != 1 {
            return Err(format!("--page: found {count} {what}, needed one").into());
        }
    }
    Ok(())
}

/// Writes the page that animates the solution of a problem; returns a message with the path, or with the reason why no
/// page was written. `names` are those of the campaign and the model; `cycles_to_settle` is the number of cycles in the
/// transient, `None` if it does not end.
pub(super) fn write(
    path: &Path,
    names: (&str, &str),
    problem: &Problem,
    cycles_to_settle: Option<usize>,
    answer: &impl Serialize,
) -> Result<String, Failure> {
    match simulation_page(names, problem, cycles_to_settle, answer) {
        Ok(page) => {
            write_if_changed(path, page.as_bytes())?;
            Ok(path.display().to_string())
        }
        Err(SimulationError::Motion(error)) => {
            Ok(format!("{}: not written: {error}", path.display()))
        }
        Err(error) => Err(error.into()),
    }
}
