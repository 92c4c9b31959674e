//! Identifies files without a marker section and suggests how to obtain a marker file.

use super::FileProblem;
use super::cells::{Dialect, Lines, begins_with, is_frame_cell, shown};
use super::sections;

pub(super) const NEEDED_SECTION: &str = "a `Trajectories` section";

/// First bytes of files in other formats, each with a description of the format and advice on how to obtain a marker
/// file instead.
const KINDS: [(&[u8], &str, &str); 5] = [
    (
        b"frame,time_s,",
        "a table written by `trilink export`",
        "use the marker file from which it was made",
    ),
    (b"pk\x03\x04", "a zip archive or an Excel workbook", "save or unpack it as CSV"),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook", "save it as CSV"),
    (b"<", "HTML or XML", "export CSV or C3D"),
    (b"{", "JSON", "export CSV or C3D"),
];

/// Returns the error for text without a marker section.
pub(super) fn describe(dialect: Dialect, text: &[u8]) -> FileProblem {
    if let Some((_, what, instead)) = KINDS.iter().find(|(start, ..)| begins_with(text, start)) {
        return FileProblem::new(*what, format!("{NEEDED_SECTION}; {instead}"));
    }
    if let Some(line) = indexed_line(dialect, text) {
        let found =
            format!("a column with an index before `Frame` in line {line}, as pandas writes it");
        return FileProblem::new(found, format!("{NEEDED_SECTION}; save the file without it"));
    }
    let found =
        if text.contains(&0) { "a binary file".to_owned() } else { other_tables(dialect, text) };
    FileProblem::new(found, NEEDED_SECTION)
}

/// Returns the number of the row of axes if a column with an index precedes it.
fn indexed_line(dialect: Dialect, text: &[u8]) -> Option<usize> {
    let is_indexed = |line| {
        let mut cells = dialect.cells(line);
        let (index, frame) = (cells.next().unwrap_or_default(), cells.next().unwrap_or_default());
        is_frame_cell(frame) && (index.is_empty() || dialect.number(index).is_some())
    };
    Lines::new(text).find(|(_, line)| is_indexed(line)).map(|(line, _)| line)
}

/// Describes the sections in text that has no marker section.
fn other_tables(dialect: Dialect, text: &[u8]) -> String {
    let sections = sections::list(dialect, text);
    let names = sections.iter().map(|section| section.name.as_str());
    let names: Vec<&str> = names.filter(|name| !name.is_empty()).collect();
    match names[..] {
        ["Objects"] => {
            "only the section `Objects` (poses of rigid bodies, from Tracker)".to_owned()
        }
        [one] => format!("only the section `{one}`"),
        [] => untitled(dialect, text),
        _ => format!("only the sections `{}`", names.join("`, `")),
    }
}

/// Describes text that has no section titles.
fn untitled(dialect: Dialect, text: &[u8]) -> String {
    let mut filled = Lines::new(text).filter(|(_, line)| !dialect.is_blank(line));
    let (_, first) = filled.next().unwrap_or_default();
    if first.starts_with(b"\"") && first.ends_with(b"\"") {
        return "a table of quoted cells (a graph plot, from Tracker)".to_owned();
    }
    if let Some((line, _)) = Lines::new(text).find(|(_, line)| dialect.is_axis_row(line)) {
        return format!("a row of axes in line {line} without a title above it");
    }
    if dialect.number(dialect.first_cell(first)).is_some() && dialect.count(first) > 3 {
        return "numbers without a header (title, rate, labels and axes)".to_owned();
    }
    format!("no section at all in a text that begins with `{}`", shown(first))
}
