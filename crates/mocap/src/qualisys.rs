//! Reads the header of a TSV export of Qualisys Track Manager, which is always in mm.
//!
//! ```text
//! NO_OF_FRAMES   600
//! NO_OF_MARKERS  2
//! FREQUENCY      120
//! DATA_INCLUDED  3D
//! MARKER_NAMES   M1    M2
//! Frame  Time  M1 X  M1 Y  M1 Z  M2 X  M2 Y  M2 Z   optional, as are both columns
//! ```

use super::FileProblem;
use super::cells::{Dialect, Lines, label_text, shown};
use super::header::{Column, Header};
use super::systems::System;
use crate::LengthUnit;

/// Maximum number of lines of the header; each event of a recording has one.
const HEADER_LINES: usize = 4096;

pub(super) fn header(text: &[u8]) -> Result<Header<'_>, FileProblem> {
    let name = System::Qualisys.name();
    let mut lines = Lines::new(text);
    let mut entries: Vec<(usize, &[u8])> = Vec::new();
    let dialect = Dialect::of_first_line(text);
    let is_time = |cell: &[u8]| cell.eq_ignore_ascii_case(b"time");
    let is_frame = |cell: &[u8]| cell.eq_ignore_ascii_case(b"frame");
    // The first row below the entries, and the text below the header.
    let (line, row, body) = loop {
        let body = lines.clone();
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
            break (line, row, body);
        }
        entries.push((line, row));
    };
    let entry = |key: &str| {
        let of_key = |row: &[u8]| dialect.first_cell(row).eq_ignore_ascii_case(key.as_bytes());
        entries.iter().copied().find(|(_, row)| of_key(row))
    };
    let value = |key: &str| dialect.cells(entry(key)?.1).nth(1).filter(|cell| !cell.is_empty());
    let number = |key: &str| dialect.number(value(key)?).filter(|number| *number > 0.0);
    let needed =
        "3D data with MARKER_NAMES; export the labelled trajectories as 3D data, with the header";
    if let Some(other) = value("DATA_INCLUDED").filter(|found| !found.eq_ignore_ascii_case(b"3D")) {
        return Err(FileProblem::new(format!("{name} with {} data", shown(other)), needed));
    }
    if entry("NO_OF_BODIES").is_some() {
        return Err(FileProblem::new(format!("{name} with 6D data of rigid bodies"), needed));
    }
    let Some((names_line, names)) = entry("MARKER_NAMES") else {
        return Err(FileProblem::new(format!("{name} without markers"), needed));
    };
    let mut names: Vec<&[u8]> = dialect.cells(names).skip(1).collect();
    while names.last().is_some_and(|name| name.is_empty()) {
        names.pop();
    }
    if names.iter().all(|name| name.is_empty()) {
        return Err(FileProblem::in_line(names_line, format!("{name} without markers"), needed));
    }
    let mut doubts = Vec::new();
    if let Some(stated) = number("NO_OF_MARKERS").filter(|stated| *stated != names.len() as f64) {
        let used = names.len();
        doubts.push(format!(
            "markers: found {stated} (NO_OF_MARKERS) and {used} (MARKER_NAMES), used {used}"
        ));
    }

    let cells: Vec<&[u8]> = dialect.cells(row).collect();
    let is_padded = cells.last().is_some_and(|cell| cell.is_empty());
    let leading = match cells.len().checked_sub(3 * names.len()) {
        Some(more @ 1..=3) if is_padded => more - 1,
        Some(more @ 0..=2) => more,
        _ => {
            let found = format!("{} columns for {} markers", cells.len(), names.len());
            let needed = "X, Y, Z for each marker in MARKER_NAMES, after the frame and the time";
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
    for name in names {
        let marker = labels.len() as u32;
        if name.is_empty() {
            columns.extend([Column::Other; 3]);
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
        line,
        body,
        frames: number("NO_OF_FRAMES").map(|frames| (frames as usize, "NO_OF_FRAMES")),
        doubts,
    })
}
