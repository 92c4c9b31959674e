//! Reads the header of a CSV export of OptiTrack Motive, with markers or rigid bodies.
//!
//! ```text
//! Format Version,1.23,...,Export Frame Rate,120.000000,...,Length Units,Meters
//!
//! ,,Rigid Body,...,Marker,Marker,Marker      type; newer versions write `Type` into the second cell
//! ,,Snake,...,Snake:M1,Snake:M1,Snake:M1     name
//! ,,1,...,2,2,2                              identifier; newer versions also state the parent
//! ,,Rotation,...,Position,Position,Position
//! Frame,Time (Seconds),X,...,X,Y,Z
//! ```
//!
//! If a file has labelled markers, only these are read: the columns of rigid bodies, and the positions at which a rigid
//! body expects its markers, are results of a fit to them. Otherwise the rigid bodies are read. Rotations are
//! quaternions, or angles of intrinsic rotations in the order that `Rotation Type` states, such as `XYZ`.

use trilink_base::body;

use super::cells::{Dialect, Lines, label_text, shown};
use super::header::{Column, Header};
use super::rotation::Rotation;
use super::systems::System;
use super::{FileProblem, units};
use crate::LengthUnit;

/// Maximum number of lines from the first to the row of axes.
const HEADER_LINES: usize = 12;
/// Beginning of the names of markers that nobody labelled.
const UNLABELLED: &[u8] = b"unlabeled";

/// Reads the header; `unit` applies to a file without `Length Units`.
pub(super) fn header(text: &[u8], unit: LengthUnit) -> Result<Header<'_>, FileProblem> {
    let dialect = Dialect::detect(text);
    let mut lines = Lines::new(text);
    let mut rows = Vec::new();
    let (line, axes) = loop {
        let (line, row) =
            lines.next().filter(|(line, _)| *line <= HEADER_LINES).ok_or_else(|| {
                FileProblem::new(
                    format!("{} without a row `Frame,Time (Seconds),X,Y,Z`", System::Motive.name()),
                    "the header; enable it in the export settings of Motive",
                )
            })?;
        if dialect.is_axis_row(row) {
            break (line, row);
        }
        if !dialect.is_blank(row) {
            rows.push(row);
        }
    };
    let [first, types, names, .., kinds] = rows[..] else {
        let needed = "rows of types, names and kinds of columns above the row of axes";
        return Err(FileProblem::in_line(
            line,
            "the row of axes without a header above it",
            needed,
        ));
    };
    let row_named = |name: &str| {
        let mut named = rows.iter().filter(|row| {
            dialect.cells(row).nth(1).is_some_and(|cell| cell.eq_ignore_ascii_case(name.as_bytes()))
        });
        named.next().copied()
    };
    let types: Vec<&[u8]> = dialect.cells(row_named("Type").unwrap_or(types)).collect();
    let names: Vec<&[u8]> = dialect.cells(row_named("Name").unwrap_or(names)).collect();
    let kinds: Vec<&[u8]> = dialect.cells(kinds).collect();
    let axes: Vec<&[u8]> = dialect.cells(axes).collect();

    let metadata: Vec<&[u8]> = dialect.cells(first).collect();
    let value = |key: &str| {
        let at = metadata.iter().position(|cell| cell.eq_ignore_ascii_case(key.as_bytes()))?;
        metadata.get(at + 1).copied().filter(|cell| !cell.is_empty())
    };
    let number = |key: &str| dialect.number(value(key)?).filter(|number| *number > 0.0);
    let mut doubts = Vec::new();
    let unit = match value("Length Units") {
        Some(name) => units::parse(name).ok_or_else(|| {
            FileProblem::in_line(1, format!("Length Units `{}`", shown(name)), units::needed())
        })?,
        None => {
            doubts.push(format!("unit: found none (Length Units), used {unit} (vicon.unit)"));
            unit
        }
    };

    let mut columns = vec![Column::Other; axes.len()];
    columns[0] = Column::Frame;
    if axes.get(1).is_some_and(|cell| cell.to_ascii_lowercase().starts_with(b"time")) {
        columns[1] = Column::Time;
    }
    let is = |at: usize, kind: &str, what: &str| {
        let has = |cells: &[&[u8]], needed: &str| {
            cells.get(at).is_some_and(|cell| cell.eq_ignore_ascii_case(needed.as_bytes()))
        };
        has(&types, kind) && has(&kinds, what)
    };
    let is_position = |at: usize| is(at, "Marker", "Position");
    let mut labels = Vec::new();
    let mut unlabelled = 0;
    let mut at = 2;
    while at + 3 <= axes.len() {
        let order =
            [0, 1, 2].map(|i| [b"X", b"Y", b"Z"].iter().position(|axis| axes[at + i] == *axis));
        let (true, [Some(i), Some(j), Some(k)]) = ((at..at + 3).all(is_position), order) else {
            at += 1;
            continue;
        };
        let name = names.get(at).copied().unwrap_or_default();
        let is_one = names.get(at + 1) == Some(&name) && names.get(at + 2) == Some(&name);
        if !is_one || i == j || j == k || i == k {
            let found = format!("X, Y, Z of `{}` that are not side by side", shown(name));
            return Err(FileProblem::in_line(line, found, "three columns for each marker"));
        }
        let begin = name.get(..UNLABELLED.len()).unwrap_or_default();
        if name.is_empty() || begin.eq_ignore_ascii_case(UNLABELLED) {
            unlabelled += 1;
        } else {
            for (i, axis) in [i, j, k].into_iter().enumerate() {
                columns[at + i] = Column::Axis(labels.len() as u32, axis as u8);
            }
            labels.push(label_text(name));
        }
        at += 3;
    }
    let mut bodies = Vec::new();
    let mut at = 2;
    while labels.len() == body::POINTS * bodies.len() && at < axes.len() {
        let count_of_body = |what: &str, from: usize| {
            let is_next = |i: &usize| is(*i, "Rigid Body", what) && names.get(*i) == names.get(at);
            (from..axes.len()).take_while(is_next).count()
        };
        let turns = count_of_body("Rotation", at);
        let end = at + turns;
        if turns == 0 || count_of_body("Position", end) < 3 {
            at += 1;
            continue;
        }
        let name = names.get(at).copied().unwrap_or_default();
        let axis_of = |i: usize| b"XYZW".iter().position(|axis| axes[i] == [*axis]);
        let order = value("Rotation Type").and_then(euler_order);
        let first = labels.len() as u32;
        let rotation = match (turns, order) {
            (4, _) => Some(Rotation::Quaternion),
            (3, Some(order)) => Some(Rotation::Euler { order, unit_rad: 1_f64.to_radians() }),
            _ => None,
        };
        let components: Option<Vec<usize>> = (at..end).map(axis_of).collect();
        let position: Option<Vec<usize>> = (end..end + 3).map(axis_of).collect();
        let (Some(rotation), Some(components), Some(position)) = (rotation, components, position)
        else {
            let found = format!(
                "rotation of `{}` in {turns} columns, with the Rotation Type `{}`",
                shown(name),
                shown(value("Rotation Type").unwrap_or_default())
            );
            let needed = "X, Y, Z, W of a quaternion or three angles with their order, such as XYZ; export the file \
                          again with the Rotation Type `Quaternion`";
            return Err(FileProblem::in_line(line, found, needed));
        };
        for (i, axis) in components.into_iter().enumerate() {
            let component = match rotation {
                Rotation::Euler { order, .. } => {
                    order.iter().position(|other| usize::from(*other) == axis).unwrap_or(0)
                }
                // The components of a quaternion are stored as w, x, y, z.
                _ => (axis + 1) % 4,
            };
            columns[at + i] = Column::Rotation(first, component as u8);
        }
        for (i, axis) in position.into_iter().enumerate() {
            columns[end + i] = Column::Axis(first, axis.min(2) as u8);
        }
        let name = label_text(name);
        labels.extend((0..body::POINTS).map(|point| body::point_label(&name, point)));
        bodies.push((first, rotation));
        at = end + 3;
    }
    if labels.is_empty() {
        return Err(no_markers(&types, unlabelled));
    }
    Ok(Header {
        system: System::Motive,
        dialect,
        rate_hz: number("Export Frame Rate").or_else(|| number("Capture Frame Rate")),
        unit,
        labels,
        columns,
        bodies,
        line,
        body: lines,
        frames: number("Total Exported Frames")
            .map(|frames| (frames as usize, "Total Exported Frames")),
        doubts,
    })
}

/// Parses the order of three angles, such as `XYZ`.
fn euler_order(text: &[u8]) -> Option<[u8; 3]> {
    let axes =
        text.iter().map(|axis| b"XYZ".iter().position(|known| known.eq_ignore_ascii_case(axis)));
    let order: Vec<u8> = axes.map(|axis| Some(axis? as u8)).collect::<Option<_>>()?;
    let order: [u8; 3] = order.try_into().ok()?;
    (0..3).all(|axis| order.contains(&axis)).then_some(order)
}

fn no_markers(types: &[&[u8]], unlabelled: usize) -> FileProblem {
    let name = System::Motive.name();
    if unlabelled > 0 {
        let found = format!("{name} with {unlabelled} unlabelled markers and no other");
        return FileProblem::new(
            found,
            "labelled markers; label them in Motive and export the file again",
        );
    }
    let mut others: Vec<String> = Vec::new();
    for cell in types.iter().skip(2).filter(|cell| !cell.is_empty()) {
        let kind = format!("`{}`", shown(cell));
        if !others.contains(&kind) {
            others.push(kind);
        }
    }
    let others = if others.is_empty() { "none".to_owned() } else { others.join(", ") };
    let found = format!("{name} without markers (types of columns: {others})");
    FileProblem::new(
        found,
        "columns of the type `Marker` or `Rigid Body`; enable `Markers` or `Rigid Bodies` in the export settings of \
         Motive",
    )
}
