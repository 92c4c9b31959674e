//! Where the markers' table starts and what its columns are.
//!
//! ```text
//! Trajectories          title; a spreadsheet pads it with commas
//! 120                   frame rate, Hz
//! ,,Snake:M1,,,Snake:M2 labels, above each marker's X
//! Frame,Sub Frame,X,Y,Z,X,Y,Z
//! ,,mm,mm,mm,mm,mm,mm   units; the older Workstation export has none
//! ```

use super::cells::{Dialect, Lines, label_text, shown};
use super::foreign::{self, NEEDED_SECTION};
use super::{FileProblem, units};
use crate::LengthUnit;

const SECTION: &[u8] = b"Trajectories";
/// Lines below the title among which the row of axes must be; blank ones count.
const HEADER_LINES: usize = 8;

/// The header of the section, and what comes below it.
pub(super) struct Header<'t> {
    pub dialect: Dialect,
    pub rate_hz: Option<f64>,
    /// Of the coordinates.
    pub unit: LengthUnit,
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
    /// Index of a marker, and its axis 0, 1, 2.
    Axis(u32, u8),
    /// Sub frames, magnitudes, padding: not read.
    Other,
}

/// Finds the section and reads its header. A file whose first table has no title may still be
/// the markers, their title cut off by hand; then the rate may be unknown. `unit` is that of a file
/// without a row of units.
pub(super) fn find(text: &[u8], unit: LengthUnit) -> Result<Header<'_>, FileProblem> {
    let dialect = Dialect::of(text);
    if dialect.is_blank(text) {
        return Err(FileProblem::new("an empty file", NEEDED_SECTION));
    }
    let mut lines = Lines::new(text);
    if let Some(line) = title_line(dialect, &mut lines) {
        return read(dialect, lines, line, unit);
    }
    if starts_without_title(dialect, text) {
        return read(dialect, Lines::new(text), 0, unit);
    }
    Err(foreign::describe(dialect, text))
}

/// The line of the next title of the markers' section.
pub(super) fn title_line<'t>(
    dialect: Dialect,
    mut lines: impl Iterator<Item = (usize, &'t [u8])>,
) -> Option<usize> {
    let is_title = |line| dialect.lone_cell(line).is_some_and(|t| t.eq_ignore_ascii_case(SECTION));
    lines.find(|(_, line)| is_title(line)).map(|(line, _)| line)
}

/// Whether the first rows are a header that lacks its title and perhaps its rate.
fn starts_without_title(dialect: Dialect, text: &[u8]) -> bool {
    let filled = || Lines::new(text).filter(|(_, line)| !dialect.is_blank(line));
    let titled = filled().next().is_some_and(|(_, line)| {
        dialect.lone_cell(line).is_some_and(|cell| dialect.number(cell).is_none())
    });
    let is_axes = |line: &[u8]| dialect.is_axis_row(line) && dialect.count(line) > 4;
    !titled && filled().take(3).skip(1).any(|(_, line)| is_axes(line))
}

/// Reads the header below a title's line.
fn read(
    dialect: Dialect,
    mut lines: Lines<'_>,
    title: usize,
    unit: LengthUnit,
) -> Result<Header<'_>, FileProblem> {
    const NEEDED_AXES: &str = "a row that starts with `Frame,Sub Frame,X,Y,Z`";
    let quoted = |cell: &[u8]| format!("`{}`", shown(cell));
    let mut above = Vec::new();
    let (line, axes) = loop {
        let next = lines.next().filter(|(line, _)| *line <= title + HEADER_LINES);
        let none = || FileProblem::in_line(title, "no row of axes in the next lines", NEEDED_AXES);
        let (line, row) = next.ok_or_else(none)?;
        if dialect.is_axis_row(row) {
            break (line, row);
        }
        if !dialect.is_blank(row) {
            above.push((line, row));
        }
    };
    let (rate_hz, labels_row) = match above[..] {
        [(_, labels)] => (None, labels),
        [(line, rate), (_, labels)] => {
            let cell = dialect.first_cell(rate);
            let rate_hz = dialect.number(cell).filter(|rate_hz| *rate_hz > 0.0);
            let needed = "the frame rate, a number of Hz above 0";
            let error = || FileProblem::in_line(line, quoted(cell), needed);
            (Some(rate_hz.ok_or_else(error)?), labels)
        }
        [] => {
            let needed = "a row of marker labels above it";
            return Err(FileProblem::in_line(line, "the row of axes at once", needed));
        }
        [.., (line, row)] => return Err(FileProblem::in_line(line, quoted(row), NEEDED_AXES)),
    };
    let (labels, columns) = markers(dialect, labels_row, axes);
    if labels.is_empty() {
        let needed = "at least one label with X, Y, Z below it";
        return Err(FileProblem::in_line(line, quoted(axes), needed));
    }
    let mut header = Header { dialect, rate_hz, unit, labels, columns, line, body: lines.clone() };
    if let Some((line, row)) = lines.next().filter(|(_, row)| is_unit_row(dialect, row)) {
        let mut said: Option<LengthUnit> = None;
        for (column, cell) in header.columns.iter().zip(dialect.cells(row)) {
            let Column::Axis(marker, _) = column else { continue };
            if cell.is_empty() {
                continue;
            }
            let found = || format!("unit {} of {}", quoted(cell), header.labels[*marker as usize]);
            let unit = units::of_text(cell)
                .ok_or_else(|| FileProblem::in_line(line, found(), units::needed()))?;
            if let Some(other) = said.replace(unit).filter(|other| *other != unit) {
                let found = format!("{} beside `{other}`", found());
                return Err(FileProblem::in_line(line, found, "one unit for all markers"));
            }
        }
        header.unit = said.unwrap_or(unit);
        (header.line, header.body) = (line, lines);
    }
    Ok(header)
}

/// Which columns are whole markers: X, Y, Z side by side under a label.
fn markers(dialect: Dialect, labels_row: &[u8], axes: &[u8]) -> (Vec<String>, Vec<Column>) {
    let mut names = Vec::with_capacity(dialect.count(axes));
    names.extend(dialect.cells(axes));
    let mut columns = vec![Column::Other; names.len()];
    columns[0] = Column::Frame;
    let mut labels = Vec::new();
    for (start, label) in dialect.cells(labels_row).enumerate().skip(1) {
        let triplet = names.get(start..start + 3).unwrap_or_default();
        if !label.is_empty() && triplet == [b"X", b"Y", b"Z"] {
            for axis in 0..3 {
                columns[start + usize::from(axis)] = Column::Axis(labels.len() as u32, axis);
            }
            labels.push(label_text(label));
        }
    }
    (labels, columns)
}

/// Units are words; a row of data without a frame number has numbers.
fn is_unit_row(dialect: Dialect, line: &[u8]) -> bool {
    let mut filled = dialect.cells(line).filter(|cell| !cell.is_empty());
    dialect.first_cell(line).is_empty()
        && filled.next().is_some_and(|cell| cell[0].is_ascii_alphabetic())
}
