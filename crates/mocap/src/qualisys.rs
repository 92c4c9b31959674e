//! Reads the header of a TSV export of Qualisys Track Manager, of 3D data (markers) or 6D data (rigid bodies), which is
//! always in mm.
//!
//! ```text
//! NO_OF_FRAMES   600
//! NO_OF_MARKERS  2
//! FREQUENCY      120
//! DATA_INCLUDED  3D
//! MARKER_NAMES   M1    M2
//! Frame  Time  M1 X  M1 Y  M1 Z  M2 X  M2 Y  M2 Z   optional, as are both columns
//! ```
//!
//! In 6D data, `NO_OF_BODIES` and `BODY_NAMES` take the place of the markers, and each body has 16 columns: `X Y Z Roll
//! Pitch Yaw Residual Rot[0] ... Rot[8]`. The rotation matrix is read, column by column, because the meaning of the
//! angles is a setting of the program.

use trilink_base::body;

use super::FileProblem;
use super::cells::{Dialect, Lines, label_text, shown};
use super::header::{Column, Header};
use super::rotation::Rotation;
use super::systems::System;
use crate::LengthUnit;

/// Maximum number of lines of the header; each event of a recording has one.
const HEADER_LINES: usize = 4096;
/// Number of columns of a rigid body: position, three angles, residual and rotation matrix.
const BODY_COLUMNS: usize = 16;

pub(super) fn header(text: &[u8]) -> Result<Header<'_>, FileProblem> {
    let name = System::Qualisys.name();
    let mut lines = Lines::new(text);
    let mut entries: Vec<(usize, &[u8])> = Vec::new();
    let dialect = Dialect::of_first_line(text);
    let is_time = |cell: &[u8]| cell.eq_ignore_ascii_case(b"time");
    let is_frame = |cell: &[u8]| cell.eq_ignore_ascii_case(b"frame");
    // The first row below the entries, and the text below the header.
    let (line, row, rest) = loop {
        let rest = lines.clone();
        let (line, row) =
            lines.next().filter(|(line, _)| *line <= HEADER_LINES).ok_or_else(|| {
                FileProblem::new(format!("{name} without a row of numbers"), "at least one frame")
            })?;
        let cell = dialect.first_cell(row);
        let has_axes = is_time(cell) || is_frame(cell) || cell.ends_with(b" X");
        if has_axes {
            break (line, row, lines);
        }
        if !dialect.is_blank(row) && (cell.is_empty() || dialect.number(cell).is_some()) {
            break (line, row, rest);
        }
        entries.push((line, row));
    };
    let entry = |key: &str| {
        let of_key = |row: &[u8]| dialect.first_cell(row).eq_ignore_ascii_case(key.as_bytes());
        entries.iter().copied().find(|(_, row)| of_key(row))
    };
    let value = |key: &str| dialect.cells(entry(key)?.1).nth(1).filter(|cell| !cell.is_empty());
    let number = |key: &str| dialect.number(value(key)?).filter(|number| *number > 0.0);
    let needed = "3D data with MARKER_NAMES or 6D data with BODY_NAMES; export the labelled trajectories as 3D data or the \
                  rigid bodies as 6D data, with the header";
    let kind = value("DATA_INCLUDED").unwrap_or(b"3D");
    let is_6d = kind.eq_ignore_ascii_case(b"6D") || entry("NO_OF_BODIES").is_some();
    if !is_6d && !kind.eq_ignore_ascii_case(b"3D") {
        return Err(FileProblem::new(format!("{name} with {} data", shown(kind)), needed));
    }
    let [keys, count_key, what] = if is_6d {
        ["BODY_NAMES", "NO_OF_BODIES", "bodies"]
    } else {
        ["MARKER_NAMES", "NO_OF_MARKERS", "markers"]
    };
    let Some((names_line, names)) = entry(keys) else {
        return Err(FileProblem::new(format!("{name} without {what}"), needed));
    };
    let mut names: Vec<&[u8]> = dialect.cells(names).skip(1).collect();
    while names.last().is_some_and(|name| name.is_empty()) {
        names.pop();
    }
    if names.iter().all(|name| name.is_empty()) {
        return Err(FileProblem::in_line(names_line, format!("{name} without {what}"), needed));
    }
    let mut doubts = Vec::new();
    if let Some(stated) = number(count_key).filter(|stated| *stated != names.len() as f64) {
        let used = names.len();
        doubts
            .push(format!("{what}: found {stated} ({count_key}) and {used} ({keys}), used {used}"));
    }

    let cells: Vec<&[u8]> = dialect.cells(row).collect();
    let is_padded = cells.last().is_some_and(|cell| cell.is_empty());
    let each = if is_6d { BODY_COLUMNS } else { 3 };
    let leading = match cells.len().checked_sub(each * names.len()) {
        Some(more @ 1..=3) if is_padded => more - 1,
        Some(more @ 0..=2) => more,
        _ => {
            let found = format!("{} columns for {} {what}", cells.len(), names.len());
            let needed = format!(
                "{each} columns for each of the {what} in {keys}{}, after the frame and the time",
                if is_6d { " (X to Rot[8])" } else { "" }
            );
            return Err(FileProblem::in_line(line, found, needed));
        }
    };
    let mut columns = match (leading, cells[0]) {
        (0, _) => Vec::new(),
        (1, cell) if is_time(cell) => vec![Column::Time],
        (1, cell) if is_frame(cell) || !cell.iter().any(|byte| b".,".contains(byte)) => {
            vec![Column::Frame]
        }
        (1, _) => vec![Column::Time],
        _ => vec![Column::Frame, Column::Time],
    };
    let mut labels = Vec::new();
    let mut bodies = Vec::new();
    for name in names {
        let marker = labels.len() as u32;
        if name.is_empty() {
            columns.extend(std::iter::repeat_n(Column::Other, each));
        } else if is_6d {
            columns.extend([0, 1, 2].map(|axis| Column::Axis(marker, axis)));
            columns.extend([Column::Other; BODY_COLUMNS - 12]);
            columns.extend((0..9).map(|component| Column::Rotation(marker, component)));
            bodies.push((marker, Rotation::Matrix));
            let name = label_text(name);
            labels.extend((0..body::POINTS).map(|point| body::point_label(&name, point)));
        } else {
            columns.extend([0, 1, 2].map(|axis| Column::Axis(marker, axis)));
            labels.push(label_text(name));
        }
    }
    Ok(Header {
        system: System::Qualisys,
        dialect,
        rate_hz: number("FREQUENCY"),
        unit: LengthUnit::Mm,
        labels,
        columns,
        bodies,
        line,
        body: rest,
        frames: number("NO_OF_FRAMES").map(|frames| (frames as usize, "NO_OF_FRAMES")),
        doubts,
    })
}
