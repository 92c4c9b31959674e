//! Tables of one trial, and the removal of those that no trial accounts for any more.

use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::cycles::WheelVelocities;
use super::error::IngestError;
use super::poses::{Coordinates, Tracked};
use crate::store::{Column, StageState, Table, is_own_table};

/// Folders inside `derived/` with a file for each trial.
const FOLDERS: [&str; 3] = ["poses", "wheels", "cycles"];

/// `poses/<trial>.parquet`.
pub(super) fn poses(trial: &str, tracked: &Tracked, smooth: Coordinates, rate_hz: f64) -> Table {
    let frames = smooth.len();
    let Coordinates { x_m, y_m, theta_rad, phi_rad: [phi1_rad, phi2_rad] } = smooth;
    let residual = |link: usize| Column::F64(tracked.residual_mm[link].clone());
    let fill = |link: usize| names(tracked.fill[link].iter().map(|fill| fill.name()));
    let outlier = |link: usize| names(tracked.outlier[link].iter().map(|found| found.name()));
    let [frame, time_s] = frames_and_times(tracked.first_frame, frames, rate_hz);
    Table::new([
        ("trial", Column::repeat(trial, frames)),
        ("frame", frame),
        ("time_s", time_s),
        ("x_m", Column::F64(x_m)),
        ("y_m", Column::F64(y_m)),
        ("theta_rad", Column::F64(theta_rad)),
        ("phi1_rad", Column::F64(phi1_rad)),
        ("phi2_rad", Column::F64(phi2_rad)),
        ("residual0_mm", residual(0)),
        ("residual1_mm", residual(1)),
        ("residual2_mm", residual(2)),
        ("fill0", fill(0)),
        ("fill1", fill(1)),
        ("fill2", fill(2)),
        ("outlier0", outlier(0)),
        ("outlier1", outlier(1)),
        ("outlier2", outlier(2)),
    ])
}

/// `wheels/<trial>.parquet`.
pub(super) fn wheels(
    trial: &str,
    first_frame: i64,
    wheels: WheelVelocities,
    rate_hz: f64,
) -> Table {
    let frames = wheels.roll_m_s[0].len();
    let [frame, time_s] = frames_and_times(first_frame, frames, rate_hz);
    let WheelVelocities { roll_m_s: [roll0, roll1, roll2], skid_m_s: [skid0, skid1, skid2] } =
        wheels;
    Table::new([
        ("trial", Column::repeat(trial, frames)),
        ("frame", frame),
        ("time_s", time_s),
        ("roll0_m_s", Column::F64(roll0)),
        ("roll1_m_s", Column::F64(roll1)),
        ("roll2_m_s", Column::F64(roll2)),
        ("skid0_m_s", Column::F64(skid0)),
        ("skid1_m_s", Column::F64(skid1)),
        ("skid2_m_s", Column::F64(skid2)),
    ])
}

/// A column of text of which there are but a few kinds.
fn names(rows: impl Iterator<Item = &'static str>) -> Column {
    let mut names: Vec<String> = Vec::new();
    let rows = rows
        .map(|name| {
            let known = names.iter().position(|known| known == name);
            known.unwrap_or_else(|| {
                names.push(name.to_owned());
                names.len() - 1
            }) as u8
        })
        .collect();
    Column::Names(names, rows)
}

fn frames_and_times(first_frame: i64, frames: usize, rate_hz: f64) -> [Column; 2] {
    [
        Column::I64((first_frame..).take(frames).collect()),
        Column::F64((0..frames).map(|i| i as f64 / rate_hz).collect()),
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
