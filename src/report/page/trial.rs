//! The page of one trial: `trials/<trial>.html`.

use minijinja::context;
use minijinja::value::{Serde, Value};

use super::fill;
use crate::report::ReportError;
use crate::report::recording::Recording;
use crate::report::replay::Replay;
use crate::report::tables::Tables;
use crate::store::{CheckRow, RobotParameterRow, RobotQuantity, TrialRow};

/// The page as HTML; without a recording it shows the trial's row and checks.
///
/// # Errors
/// The template cannot be filled in.
pub fn html(
    trial: &TrialRow,
    tables: &Tables,
    recording: Option<&Recording>,
    replay: Option<&Replay>,
    figures: &[Value],
) -> Result<String, ReportError> {
    let robots = tables.robots.iter().filter(|row| row.trial == trial.trial);
    let quantities: Vec<RobotQuantity> = robots.flat_map(RobotParameterRow::quantities).collect();
    let checks = tables.checks.iter().filter(|check| check.trial == trial.trial);
    let page = context! {
        version => env!("CARGO_PKG_VERSION"),
        trial => Serde(trial),
        quantities => Serde(quantities),
        figures => figures,
        replay => replay.map(|replay| replay.value(&format!("Motion of trial {}", trial.trial))),
        gaps => Serde(recording.map(gaps)),
        cycles => Serde(recording.map(|recording| &recording.cycles)),
        checks => Serde(checks.collect::<Vec<&CheckRow>>()),
    };
    fill("trial.html", include_str!("trial.html"), &page).map_err(ReportError::Page)
}

/// Of every link, the parts of its frames that are measured, from other markers, interpolated and
/// missing, and how long it is missing at most, s.
fn gaps(recording: &Recording) -> [([f64; 4], Option<f64>); 3] {
    let step_s = match recording.time_s.as_slice() {
        [first, second, ..] => second - first,
        _ => f64::NAN,
    };
    recording.fill.each_ref().map(|fill| {
        let part = |name: &str| {
            let count = fill.iter().filter(|fill| *fill == name).count();
            count as f64 / fill.len().max(1) as f64
        };
        let missing = fill.chunk_by(|a, b| a == b).filter(|run| run[0] == "missing");
        let longest_s = missing.map(|run| run.len() as f64 * step_s).max_by(f64::total_cmp);
        (["measured", "rigid", "interpolated", "missing"].map(part), longest_s)
    })
}
