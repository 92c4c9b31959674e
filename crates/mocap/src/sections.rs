//! The tables that an exported file holds, whether they are read or not.

use serde::Serialize;

use super::cells::{Dialect, Lines, shown};

/// More sections are not listed; no export has a tenth of them.
const MOST_SECTIONS: usize = 64;

/// One table of an exported file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Section {
    /// Its title; empty if the file does not have it.
    pub name: String,
    /// Line where it starts, from 1; 0 in a binary file.
    pub line: usize,
    /// Its own rate, Hz, if the file states one.
    pub rate_hz: Option<f64>,
    /// Rows with a frame number.
    pub rows: usize,
}

/// All sections of a text. A title is a lone text cell, above a rate or above labels and axes.
pub(super) fn list(dialect: Dialect, text: &[u8]) -> Vec<Section> {
    let mut found: Vec<Section> = Vec::new();
    let mut title: Option<(usize, &[u8])> = None;
    // Whether the last section's row of axes is passed.
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
            if found.len() == MOST_SECTIONS {
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
