//! Tables of one trial, and the removal of those that no trial accounts for any more.

use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::cycles::WheelVelocities;
use super::error::IngestError;
use super::poses::{Coordinates, Tracked};
use crate::store::{Column, StageState, Table, is_own_table, numbers, repeated, texts};

/// Folders inside `derived/` with a file for each trial.
const FOLDERS: [&str; 3] = ["poses", "wheels", "cycles"];

/// `poses/<trial>.parquet`.
pub(super) fn poses(trial: &str, tracked: &Tracked, smooth: Coordinates, rate_hz: f64) -> Table {
    let Coordinates { x_m, y_m, theta_rad, phi_rad: [phi1_rad, phi2_rad] } = smooth;
    let mut columns = frames(trial, tracked.first_frame, x_m.len(), rate_hz);
    columns.extend([
        numbers("x_m", x_m),
        numbers("y_m", y_m),
        numbers("theta_rad", theta_rad),
        numbers("phi1_rad", phi1_rad),
        numbers("phi2_rad", phi2_rad),
    ]);
    let Tracked { residual_mm, fill, outlier, .. } = tracked;
    for (link, residual_mm) in residual_mm.iter().enumerate() {
        columns.push(numbers(&format!("residual{link}_mm"), residual_mm.clone()));
    }
    for (link, fill) in fill.iter().enumerate() {
        columns.push(texts(&format!("fill{link}"), fill.iter().map(|fill| fill.name())));
    }
    for (link, outlier) in outlier.iter().enumerate() {
        columns.push(texts(&format!("outlier{link}"), outlier.iter().map(|found| found.name())));
    }
    Table::new(columns)
}

/// `wheels/<trial>.parquet`.
pub(super) fn wheels(
    trial: &str,
    first_frame: i64,
    wheels: WheelVelocities,
    rate_hz: f64,
) -> Table {
    let WheelVelocities { roll_m_s, skid_m_s } = wheels;
    let mut columns = frames(trial, first_frame, roll_m_s[0].len(), rate_hz);
    for (name, of_wheels) in [("roll", roll_m_s), ("skid", skid_m_s)] {
        let of_wheels = of_wheels.into_iter().enumerate();
        columns.extend(of_wheels.map(|(i, values)| numbers(&format!("{name}{i}_m_s"), values)));
    }
    Table::new(columns)
}

/// The columns that tell the frames.
fn frames(trial: &str, first_frame: i64, frames: usize, rate_hz: f64) -> Vec<Column> {
    vec![
        repeated("trial", trial, frames),
        Column::new("frame".into(), (first_frame..).take(frames).collect::<Vec<_>>()),
        numbers("time_s", (0..frames).map(|i| i as f64 / rate_hz).collect()),
    ]
}

/// Tables of trials that are not in the list or have failed, so that nobody should take them for
/// results: those that are not `current` and that this program wrote.
///
/// # Errors
/// A folder cannot be read.
pub(super) fn outdated(
    derived: &Path,
    known: &StageState,
    current: &BTreeSet<PathBuf>,
) -> Result<Vec<PathBuf>, IngestError> {
    let recorded = recorded(derived, known);
    let mut found = Vec::new();
    for folder in table_folders(derived) {
        let entries = match std::fs::read_dir(&folder) {
            Ok(entries) => entries,
            Err(source) if source.kind() == ErrorKind::NotFound => continue,
            // The places are checked before anything is written.
            Err(source) if source.kind() == ErrorKind::NotADirectory => continue,
            Err(source) => return Err(IngestError::Outdated { path: folder, source }),
        };
        let paths = entries.flatten().map(|entry| entry.path());
        found.extend(paths.filter(|path| {
            path.extension().is_some_and(|extension| extension == "parquet")
                && !current.contains(path)
                && path.is_file()
                && (recorded.contains(path) || is_own_table(path))
        }));
    }
    Ok(found)
}

/// Removes the tables that are [`outdated`].
pub(super) fn remove_outdated(
    derived: &Path,
    known: &StageState,
    current: &BTreeSet<PathBuf>,
) -> Result<(), IngestError> {
    for path in outdated(derived, known, current)? {
        std::fs::remove_file(&path).map_err(|source| IngestError::Outdated { path, source })?;
    }
    Ok(())
}

/// The trials' own tables that a record has.
pub(super) fn recorded(derived: &Path, known: &StageState) -> BTreeSet<PathBuf> {
    let names = known.things.values().flat_map(|thing| thing.outputs.keys());
    names.map(|name| derived.join(name)).collect()
}

/// Folders inside `derived/` with a file for each trial.
pub fn table_folders(derived: &Path) -> Vec<PathBuf> {
    FOLDERS.map(|folder| derived.join(folder)).into()
}
