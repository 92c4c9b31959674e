//! Lists all tables in an exported file, whether they are read as markers or not.

use serde::Serialize;

use super::FileProblem;
use super::cells::{Dialect, Lines, shown};
use super::header::{self, Header};
use super::systems::System;
use crate::LengthUnit;

/// Maximum number of sections listed; exports have fewer than ten.
const MAX_SECTIONS: usize = 64;

/// Table in an exported file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Section {
    /// Title; empty if the table has none.
    pub name: String,
    /// Number of the table's first line, counted from 1; 0 in a binary file.
    pub line: usize,
    /// Rate of the table, Hz; `None` if the file states none.
    pub rate_hz: Option<f64>,
    /// Number of rows with a frame number.
    pub rows: usize,
}

/// Lists all sections of a text file; systems other than Vicon write a single table.
pub(super) fn list_all(text: &[u8], unit: LengthUnit) -> Result<Vec<Section>, FileProblem> {
    let system = System::detect(text);
    if system == System::Vicon {
        return Ok(list(Dialect::detect(text), text));
    }
    let Header { dialect, rate_hz, line, body, bodies, .. } = header::find(text, unit)?;
    let rows = body.filter(|(_, row)| !dialect.is_blank(row)).count();
    let what = if bodies.is_empty() { "Markers" } else { "Rigid bodies" };
    Ok(vec![Section { name: format!("{what} ({})", system.name()), line, rate_hz, rows }])
}

/// Lists all sections of a text file by Vicon. A title is the only cell in its row, and is followed by a rate or by
/// labels and axes.
pub(super) fn list(dialect: Dialect, text: &[u8]) -> Vec<Section> {
    let mut found: Vec<Section> = Vec::new();
    let mut title: Option<(usize, &[u8])> = None;
    // Whether the row of axes in the last section has been passed.
    let mut in_table = false;
    for (line, row) in Lines::new(text) {
        if dialect.is_blank(row) {
            title = None;
            continue;
        }
        let number = dialect.number(dialect.first_cell(row));
        let axes = dialect.is_axis_row(row);
        let just_titled = title.is_some_and(|(above, _)| above + 1 == line);
        if axes && !in_table && !found.is_empty() && title.is_none() {
            in_table = true;
        } else if axes || number.is_some() && just_titled {
            let (start, name) = title.take().unwrap_or((line, b""));
            if found.len() == MAX_SECTIONS {
                break;
            }
            let name = shown(name);
            found.push(Section { name, line: start, rate_hz: number, rows: 0 });
            in_table = axes;
        } else if number.is_some() {
            title = None;
            if let Some(section) = found.last_mut().filter(|_| in_table) {
                section.rows += 1;
            }
        } else if let Some(name) = dialect.lone_cell(row) {
            title = Some((line, name));
        }
    }
    found
}
