//! Identifies files without a marker section and suggests how to obtain a marker file.

use super::FileProblem;
use super::cells::{Dialect, Lines, shown};
use super::sections;

pub(super) const NEEDED_SECTION: &str = "a `Trajectories` section";

/// First bytes of files in other formats, each with a description of the format and advice on how to obtain a marker
/// file instead.
const KINDS: [(&[u8], &str, &str); 8] = [
    (
        b"format version,",
        "an OptiTrack Motive export, which is not supported yet",
        "export C3D from Motive instead, with Z up",
    ),
    (b"pathfiletype", "a TRC file (of Motion Analysis or OpenSim)", "export C3D instead"),
    (b"no_of_frames", "a Qualisys TSV export", "export C3D instead"),
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
    let found = if is_utf16(text) {
        "UTF-16".to_owned()
    } else if text.contains(&0) {
        "a binary file".to_owned()
    } else {
        other_tables(dialect, text)
    };
    FileProblem::new(found, NEEDED_SECTION)
}

fn begins_with(text: &[u8], start: &[u8]) -> bool {
    let text = text.trim_ascii_start();
    let text = text.strip_prefix(b"\"").unwrap_or(text);
    text.get(..start.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(start))
}

/// Returns whether every other byte is 0, as in UTF-16 without a byte-order mark.
fn is_utf16(text: &[u8]) -> bool {
    const EXAMINED: usize = 64;
    let begin = text.get(..EXAMINED.min(text.len() & !1)).unwrap_or_default();
    let [even, odd] = [0, 1]
        .map(|parity| begin.iter().skip(parity).step_by(2).filter(|byte| **byte == 0).count());
    begin.len() >= 8 && even.min(odd) == 0 && even.max(odd) * 4 > begin.len()
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
