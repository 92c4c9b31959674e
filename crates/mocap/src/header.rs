//! Locates the marker table and reads its header; here that of Vicon.
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
use super::rotation::Rotation;
use super::systems::System;
use super::{FileProblem, motive, qualisys, table, trc, units};
use crate::LengthUnit;
use trilink_base::body;

/// Titles of the sections with markers and, in a file without markers, with rigid bodies.
pub(super) const SECTIONS: [&str; 2] = ["Trajectories", "Objects"];
/// Maximum number of lines, including blank ones, from the title to the row of axes.
const HEADER_LINES: usize = 8;

/// Header of the marker section, and the text below it.
pub(super) struct Header<'t> {
    pub system: System,
    pub dialect: Dialect,
    pub rate_hz: Option<f64>,
    /// Unit of the coordinates in the table.
    pub unit: LengthUnit,
    pub labels: Vec<String>,
    /// Content of each column in the table.
    pub columns: Vec<Column>,
    /// Rigid bodies: index of the first of the labels of each, and the rotation that its columns state.
    pub bodies: Vec<(u32, Rotation)>,
    /// Line number of the last line of the header.
    pub line: usize,
    /// Lines of the text below the header.
    pub body: Lines<'t>,
    /// Number of frames that the header states, and where.
    pub frames: Option<(usize, &'static str)>,
    /// Notes on missing or contradictory metadata.
    pub doubts: Vec<String>,
}

/// Content of a column in the marker table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Column {
    Frame,
    Time,
    /// Coordinate of a marker or of the origin of a rigid body, given by the index of its (first) label and the axis (0,
    /// 1, 2).
    Axis(u32, u8),
    /// Component (0 to 8) of the rotation of a rigid body, given by the index of the body's first label.
    Rotation(u32, u8),
    /// Subframe, magnitude or padding; not read.
    Other,
}

/// Finds the marker section and reads its header. A Vicon file whose first table has no title may still be the marker
/// table with its title removed by hand; if so, the rate may be unknown. `unit` applies to a file without a row of
/// units.
pub(super) fn find(text: &[u8], unit: LengthUnit) -> Result<Header<'_>, FileProblem> {
    match System::detect(text) {
        System::Vicon => {}
        System::Motive => return motive::header(text, unit),
        System::Trc => return trc::header(text, unit),
        System::Qualisys => return qualisys::header(text),
        System::Table => return table::header(text),
    }
    let dialect = Dialect::detect(text);
    if dialect.is_blank(text) {
        return Err(FileProblem::new("an empty file", NEEDED_SECTION));
    }
    for section in SECTIONS {
        let mut lines = Lines::new(text);
        if let Some(line) = title_line(dialect, section, &mut lines) {
            return read(dialect, lines, line, unit);
        }
    }
    if starts_without_title(dialect, text) {
        return read(dialect, Lines::new(text), 0, unit);
    }
    Err(foreign::describe(dialect, text))
}

/// Returns the number of the next line that contains only the title `section`; `None` if there is none.
pub(super) fn title_line<'t>(
    dialect: Dialect,
    section: &str,
    mut lines: impl Iterator<Item = (usize, &'t [u8])>,
) -> Option<usize> {
    lines
        .find(|(_, line)| {
            dialect
                .lone_cell(line)
                .is_some_and(|title| title.eq_ignore_ascii_case(section.as_bytes()))
        })
        .map(|(line, _)| line)
}

/// Returns whether the first rows are a header that lacks its title and possibly its rate.
fn starts_without_title(dialect: Dialect, text: &[u8]) -> bool {
    let mut filled = Lines::new(text).filter(|(_, line)| !dialect.is_blank(line));
    let is_titled = filled.next().is_some_and(|(_, line)| {
        dialect.lone_cell(line).is_some_and(|cell| dialect.number(cell).is_none())
    });
    !is_titled
        && filled.take(2).any(|(_, line)| dialect.is_axis_row(line) && dialect.count(line) > 4)
}

/// Reads the header below the line with the title.
fn read(
    dialect: Dialect,
    mut lines: Lines<'_>,
    title: usize,
    unit: LengthUnit,
) -> Result<Header<'_>, FileProblem> {
    const NEEDED_AXES: &str = "a row that starts with `Frame,Sub Frame,X,Y,Z`";
    let mut above = Vec::new();
    let (line, axes) = loop {
        let (line, row) =
            lines.next().filter(|(line, _)| *line <= title + HEADER_LINES).ok_or_else(|| {
                FileProblem::in_line(title, "no row of axes in the next lines", NEEDED_AXES)
            })?;
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
            let needed = "the frame rate, a number above 0 (in Hz)";
            let Some(rate_hz) = rate_hz else {
                return Err(FileProblem::in_line(line, quoted(cell), needed));
            };
            (Some(rate_hz), labels)
        }
        [] => {
            let needed = "a row of marker labels above the row of axes";
            return Err(FileProblem::in_line(
                line,
                "the row of axes without a row above it",
                needed,
            ));
        }
        [.., (line, row)] => return Err(FileProblem::in_line(line, quoted(row), NEEDED_AXES)),
    };
    let (labels, columns, bodies) = markers(dialect, labels_row, axes);
    if labels.is_empty() {
        let needed = "at least one marker label with X, Y, Z below the label, or the label of an object with RX, RY, \
                      RZ, TX, TY, TZ";
        return Err(FileProblem::in_line(line, quoted(axes), needed));
    }
    let mut header = Header {
        system: System::Vicon,
        dialect,
        rate_hz,
        unit,
        labels,
        columns,
        bodies,
        line,
        body: lines.clone(),
        frames: None,
        doubts: Vec::new(),
    };
    if let Some((line, row)) = lines.next().filter(|(_, row)| is_unit_row(dialect, row)) {
        header.unit = read_units(&header, line, row)?.unwrap_or(unit);
        read_angle_unit(&mut header, line, row)?;
        header.line = line;
        header.body = lines;
    }
    Ok(header)
}

/// Reads the row of units, which must give the same unit for all markers; `None` if all cells are empty.
fn read_units(header: &Header, line: usize, row: &[u8]) -> Result<Option<LengthUnit>, FileProblem> {
    let mut stated: Option<LengthUnit> = None;
    for (column, cell) in header.columns.iter().zip(header.dialect.cells(row)) {
        let Column::Axis(marker, _) = column else { continue };
        if cell.is_empty() {
            continue;
        }
        let found = || format!("unit {} of {}", quoted(cell), header.labels[*marker as usize]);
        let unit = units::parse(cell)
            .ok_or_else(|| FileProblem::in_line(line, found(), units::needed()))?;
        if let Some(other) = stated.replace(unit).filter(|other| *other != unit) {
            let found = format!("{} beside `{other}`", found());
            return Err(FileProblem::in_line(line, found, "one unit for all markers"));
        }
    }
    Ok(stated)
}

/// Reads the unit of the rotations from the row of units; without one, it is rad.
fn read_angle_unit(header: &mut Header, line: usize, row: &[u8]) -> Result<(), FileProblem> {
    for (column, cell) in header.columns.iter().zip(header.dialect.cells(row)) {
        let Column::Rotation(first, _) = column else { continue };
        let degrees = match cell.to_ascii_lowercase().as_slice() {
            b"" | b"rad" => continue,
            b"deg" => true,
            // The components of a quaternion have no unit; Tracker states that of the translation.
            _ => false,
        };
        for (_, rotation) in header.bodies.iter_mut().filter(|(body, _)| body == first) {
            match rotation {
                Rotation::Vector { unit_rad } if degrees => *unit_rad = 1_f64.to_radians(),
                Rotation::Vector { .. } => {
                    let found = format!("unit {} of a rotation", quoted(cell));
                    return Err(FileProblem::in_line(line, found, "`rad` or `deg`"));
                }
                _ => {}
            }
        }
    }
    Ok(())
}

fn quoted(cell: &[u8]) -> String {
    format!("`{}`", shown(cell))
}

/// Labels, columns and rigid bodies of a table.
type Contents = (Vec<String>, Vec<Column>, Vec<(u32, Rotation)>);

/// Finds the columns of complete markers, X, Y, Z side by side under a label, and of the rigid bodies of Tracker: RX,
/// RY, RZ, which are the components of a rotation vector or, with RW, of a quaternion, then TX, TY, TZ.
fn markers(dialect: Dialect, labels_row: &[u8], axes: &[u8]) -> Contents {
    const BODY: [&[u8]; 7] = [b"RX", b"RY", b"RZ", b"RW", b"TX", b"TY", b"TZ"];
    let mut names = Vec::with_capacity(dialect.count(axes));
    names.extend(dialect.cells(axes));
    let mut columns = vec![Column::Other; names.len()];
    columns[0] = Column::Frame;
    let mut labels = Vec::new();
    let mut bodies = Vec::new();
    for (start, label) in dialect.cells(labels_row).enumerate().skip(1) {
        if label.is_empty() {
            continue;
        }
        let index = labels.len() as u32;
        let next = |count| names.get(start..start + count).unwrap_or_default();
        if next(3) == [b"X", b"Y", b"Z"] {
            for axis in 0..3 {
                columns[start + usize::from(axis)] = Column::Axis(index, axis);
            }
            labels.push(label_text(label));
        } else if next(7) == BODY {
            // The components of a quaternion are stored as w, x, y, z.
            for (i, component) in [1, 2, 3, 0].into_iter().enumerate() {
                columns[start + i] = Column::Rotation(index, component);
            }
            (0..3).for_each(|axis| columns[start + 4 + axis] = Column::Axis(index, axis as u8));
            bodies.push((index, Rotation::Quaternion));
            labels.extend(
                (0..body::POINTS).map(|point| body::point_label(&label_text(label), point)),
            );
        } else if next(6) == [BODY[0], BODY[1], BODY[2], BODY[4], BODY[5], BODY[6]] {
            for i in 0..3 {
                columns[start + usize::from(i)] = Column::Rotation(index, i);
                columns[start + 3 + usize::from(i)] = Column::Axis(index, i);
            }
            bodies.push((index, Rotation::Vector { unit_rad: 1.0 }));
            labels.extend(
                (0..body::POINTS).map(|point| body::point_label(&label_text(label), point)),
            );
        }
    }
    (labels, columns, bodies)
}

/// Returns whether a row consists of units, which are words; a data row without a frame number consists of numbers.
fn is_unit_row(dialect: Dialect, line: &[u8]) -> bool {
    let mut filled = dialect.cells(line).filter(|cell| !cell.is_empty());
    dialect.first_cell(line).is_empty()
        && filled.next().is_some_and(|cell| cell[0].is_ascii_alphabetic())
}
