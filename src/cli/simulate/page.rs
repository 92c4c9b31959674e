//! Page of `simulate --page`.

use std::path::Path;

use trilink_fit::simulate::{Answer, Setup};
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

/// Writes the page that animates a solution; returns a message with the path, or with the reason why no page was
/// written.
pub(super) fn write(
    path: &Path,
    campaign: &str,
    setup: &Setup,
    answer: &Answer,
) -> Result<String, Failure> {
    let problem = setup.problem(answer.omega_rad_s);
    let names = (campaign, setup.model.name());
    match simulation_page(names, &problem, answer.cycles_to_settle, answer) {
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
