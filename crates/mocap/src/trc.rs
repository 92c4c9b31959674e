//! Reads the header of a TRC file, as written by Cortex, OpenSim and many others.
//!
//! ```text
//! PathFileType  4  (X/Y/Z)  trial.trc
//! DataRate  CameraRate  NumFrames  NumMarkers  Units  OrigDataRate  OrigDataStartFrame  OrigNumFrames
//! 120       120         600        2           mm     120           1                   600
//! Frame#    Time        M1                     M2
//!                       X1  Y1  Z1             X2  Y2  Z2
//! ```

use super::cells::{Dialect, Lines, label_text, shown};
use super::header::{Column, Header};
use super::systems::System;
use super::{FileProblem, units};
use crate::LengthUnit;

/// Maximum number of lines from the first to the row of labels.
const HEADER_LINES: usize = 8;
/// Number of columns before those of the first marker: frame and time.
const LEADING: usize = 2;

/// Reads the header; `unit` applies to a file without `Units`.
pub(super) fn header(text: &[u8], unit: LengthUnit) -> Result<Header<'_>, FileProblem> {
    let dialect = Dialect::detect(text);
    let mut lines = Lines::new(text);
    let mut rows = Vec::new();
    let (line, labels_row) = loop {
        let (line, row) =
            lines.next().filter(|(line, _)| *line <= HEADER_LINES).ok_or_else(|| {
                FileProblem::new(
                    "TRC without a row of labels",
                    "a row that starts with `Frame#`, `Time`",
                )
            })?;
        if dialect.is_axis_row(row) {
            break (line, row);
        }
        if !dialect.is_blank(row) {
            rows.push((line, row));
        }
    };
    let axes_line = lines.next();
    let axes: Vec<&[u8]> = axes_line.map_or_else(Vec::new, |(_, row)| {
        dialect.cells(row).filter(|cell| !cell.is_empty()).collect()
    });
    let is_axis = |(i, cell): (usize, &&[u8])| cell[0].eq_ignore_ascii_case(&b"XYZ"[i % 3]);
    if axes.is_empty() || !axes.len().is_multiple_of(3) || !axes.iter().enumerate().all(is_axis) {
        let needed = "a row of axes, `X1`, `Y1`, `Z1`, `X2`, ..., below the row of labels";
        let found = axes.first().map_or("no axis".to_owned(), |cell| format!("`{}`", shown(cell)));
        return Err(FileProblem::in_line(line + 1, found, needed));
    }
    let markers = axes.len() / 3;

    let mut doubts = Vec::new();
    let [keys, values] = [1, 2].map(|i| rows.get(i).map_or(&b""[..], |(_, row)| row));
    let value = |key: &str| {
        let mut pairs = dialect.cells(keys).zip(dialect.cells(values));
        let (_, value) = pairs.find(|(found, _)| found.eq_ignore_ascii_case(key.as_bytes()))?;
        Some(value).filter(|value| !value.is_empty())
    };
    let number = |key: &str| dialect.number(value(key)?).filter(|number| *number > 0.0);
    let unit = match value("Units") {
        Some(name) => units::parse(name).ok_or_else(|| {
            let line = rows.get(2).map_or(line, |(line, _)| *line);
            FileProblem::in_line(line, format!("Units `{}`", shown(name)), units::needed())
        })?,
        None => {
            doubts.push(format!("unit: found none (Units), used {unit} (vicon.unit)"));
            unit
        }
    };
    if let Some(stated) = number("NumMarkers").filter(|stated| *stated != markers as f64) {
        doubts.push(format!(
            "markers: found {stated} (NumMarkers) and {markers} (row of axes), used {markers}"
        ));
    }

    let mut columns = vec![Column::Frame, Column::Time];
    columns.resize(LEADING + 3 * markers, Column::Other);
    let cells = dialect.cells(labels_row).enumerate().skip(LEADING);
    let named: Vec<(usize, &[u8])> = cells.filter(|(_, label)| !label.is_empty()).collect();
    // Some programs write the labels side by side instead of above their X; then there must be one for each marker.
    let is_above = named.iter().all(|(column, _)| (column - LEADING).is_multiple_of(3));
    if named.is_empty() || !is_above && named.len() != markers {
        let found = format!("{} labels for {markers} markers", named.len());
        return Err(FileProblem::in_line(line, found, "the label of each marker above its X"));
    }
    let mut labels = Vec::new();
    for (nth, (column, label)) in named.into_iter().enumerate() {
        let start = if is_above { column } else { LEADING + 3 * nth };
        let Some(triplet) = columns.get_mut(start..start + 3) else {
            let found = format!("label `{}` without axes below it", shown(label));
            return Err(FileProblem::in_line(line, found, "X, Y, Z for each marker"));
        };
        for (axis, column) in triplet.iter_mut().enumerate() {
            *column = Column::Axis(labels.len() as u32, axis as u8);
        }
        labels.push(label_text(label));
    }
    Ok(Header {
        system: System::Trc,
        dialect,
        rate_hz: number("DataRate"),
        unit,
        labels,
        columns,
        bodies: Vec::new(),
        line: line + 1,
        body: lines,
        frames: number("NumFrames").map(|frames| (frames as usize, "NumFrames")),
        doubts,
    })
}
