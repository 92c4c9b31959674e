//! Where the markers' table starts and what its columns are.
//!
//! ```text
//! Trajectories          title; a spreadsheet pads it with commas
//! 120                   frame rate, Hz
//! ,,Snake:M1,,,Snake:M2 labels, above each marker's X
//! Frame,Sub Frame,X,Y,Z,X,Y,Z
//! ,,mm,mm,mm,mm,mm,mm   units; the older Workstation export has none
//! ```

use std::path::Path;

use super::ViconError;
use super::bytes::{Lines, cells, is_blank, lone_cell, number, shown};

const SECTION: &[u8] = b"Trajectories";
/// First cell of the row of axes, in Nexus and in the older Workstation.
const FRAME_CELLS: [&[u8]; 2] = [b"Frame", b"Field #"];
/// Lines below the title among which the row of axes must be; blank ones count.
const HEADER_LINES: usize = 8;

/// The header of the `Trajectories` section.
pub(super) struct Header<'t> {
    pub rate_hz: Option<f64>,
    pub labels: Vec<String>,
    /// What each column of the table holds.
    pub columns: Vec<Column>,
    /// Last line of the header.
    pub line: usize,
    /// The lines below.
    pub body: Lines<'t>,
}

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Column {
    Frame,
    /// Axis 0, 1, 2 of a marker.
    Axis {
        marker: usize,
        axis: usize,
    },
    /// Sub frames, magnitudes, padding: not read.
    Other,
}

/// Finds the section and reads its header. A file without any titled section may still be the
/// table itself, its title cut off by hand; then the rate is unknown.
pub(super) fn find<'t>(path: &Path, text: &'t [u8]) -> Result<Header<'t>, ViconError> {
    if is_blank(text) {
        return Err(ViconError::Empty { path: path.to_owned() });
    }
    let mut lines = Lines::new(text);
    let titled = lines
        .by_ref()
        .find(|(_, line)| lone_cell(line).is_some_and(|title| title.eq_ignore_ascii_case(SECTION)));
    if let Some((line, _)) = titled {
        return read(path, lines, line);
    }
    let found = sections(text);
    let untitled = Lines::new(text)
        .filter(|(_, line)| !is_blank(line))
        .take(3)
        .any(|(_, line)| is_axis_row(line) && line.split(|&byte| byte == b',').count() > 4);
    if found.is_empty() && untitled {
        return read(path, Lines::new(text), 0);
    }
    Err(ViconError::NoSection { path: path.to_owned(), found })
}

/// Titles in the text: a row of one text cell above a row that starts with a rate.
fn sections(text: &[u8]) -> Vec<String> {
    let mut found = Vec::new();
    let mut title: Option<&[u8]> = None;
    for (_, line) in Lines::new(text) {
        if let Some(title) = title.take()
            && cells(line).next().and_then(number).is_some()
        {
            found.push(shown(title));
        }
        title = lone_cell(line).filter(|cell| number(cell).is_none());
    }
    found
}

fn is_axis_row(line: &[u8]) -> bool {
    let first = cells(line).next().unwrap_or_default();
    FRAME_CELLS.iter().any(|name| name.eq_ignore_ascii_case(first))
}

fn read<'t>(path: &Path, mut lines: Lines<'t>, title: usize) -> Result<Header<'t>, ViconError> {
    let error = |line: usize, found: String, needed: &str| ViconError::Header {
        path: path.to_owned(),
        line,
        found,
        needed: needed.to_owned(),
    };
    const NEEDED_AXES: &str = "a row that starts with `Frame,Sub Frame,X,Y,Z`";
    let mut above = Vec::new();
    let (axes_line, axes) = loop {
        let next = lines.next().filter(|(line, _)| *line <= title + HEADER_LINES);
        let Some((line, row)) = next else {
            let found = "no row of axes in the next lines".to_owned();
            return Err(error(title, found, NEEDED_AXES));
        };
        if is_axis_row(row) {
            break (line, row);
        }
        if !is_blank(row) {
            above.push((line, row));
        }
    };
    let (rate_hz, labels_row) = match above[..] {
        [(_, labels)] => (None, labels),
        [(line, rate), (_, labels)] => {
            let cell = cells(rate).next().unwrap_or_default();
            let rate_hz = number(cell).filter(|rate_hz| *rate_hz > 0.0);
            let needed = "the frame rate, a number of Hz above 0";
            let quoted = || format!("`{}`", shown(cell));
            (Some(rate_hz.ok_or_else(|| error(line, quoted(), needed))?), labels)
        }
        [] => {
            let found = "the row of axes at once".to_owned();
            return Err(error(axes_line, found, "a row of marker labels above it"));
        }
        [.., (line, row)] => {
            return Err(error(line, format!("`{}`", shown(row)), NEEDED_AXES));
        }
    };
    let (labels, columns) = markers(labels_row, axes);
    if labels.is_empty() {
        let found = format!("`{}`", shown(axes));
        let needed = "at least one label with X, Y, Z below it";
        return Err(error(axes_line, found, needed));
    }
    let mut header = Header { rate_hz, labels, columns, line: axes_line, body: lines.clone() };
    if let Some((line, units)) = lines.next()
        && is_unit_row(units)
    {
        for (column, unit) in header.columns.iter().zip(cells(units)) {
            if let Column::Axis { marker, .. } = column
                && !unit.is_empty()
                && !unit.eq_ignore_ascii_case(b"mm")
            {
                let found = format!("unit `{}` of {}", shown(unit), header.labels[*marker]);
                return Err(error(line, found, "millimetres (`mm`)"));
            }
        }
        header.line = line;
        header.body = lines;
    }
    Ok(header)
}

/// Which columns are whole markers: X, Y, Z side by side under a label.
fn markers(labels_row: &[u8], axes: &[u8]) -> (Vec<String>, Vec<Column>) {
    let axes: Vec<&[u8]> = cells(axes).collect();
    let mut columns = vec![Column::Other; axes.len()];
    columns[0] = Column::Frame;
    let mut labels = Vec::new();
    for (start, label) in cells(labels_row).enumerate().skip(1) {
        let triplet = axes.get(start..start + 3).unwrap_or_default();
        if !label.is_empty() && triplet == [b"X", b"Y", b"Z"] {
            for axis in 0..3 {
                columns[start + axis] = Column::Axis { marker: labels.len(), axis };
            }
            labels.push(String::from_utf8_lossy(label).into_owned());
        }
    }
    (labels, columns)
}

/// Units are words; a row of data without a frame number has numbers.
fn is_unit_row(line: &[u8]) -> bool {
    let mut filled = cells(line).filter(|cell| !cell.is_empty());
    cells(line).next().is_none_or(<[u8]>::is_empty)
        && filled.next().is_some_and(|cell| cell[0].is_ascii_alphabetic())
}
