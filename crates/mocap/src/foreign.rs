//! What a file is that has no section of markers, and what to do about it.

use super::FileProblem;
use super::cells::{Dialect, Lines, shown};
use super::sections;

pub(super) const NEEDED_SECTION: &str = "a `Trajectories` section";

/// Files by how they begin: what they are, and how markers are got from there.
const KINDS: [(&[u8], &str, &str); 8] = [
    (
        b"format version,",
        "an OptiTrack Motive export, which is not read yet",
        "export C3D from Motive instead, with Z up",
    ),
    (b"pathfiletype", "a TRC file (of Motion Analysis or OpenSim)", "export C3D instead"),
    (b"no_of_frames", "a Qualisys TSV export", "export C3D instead"),
    (b"frame,time_s,", "a table of `trilink export`", "take the marker file that it was made from"),
    (b"pk\x03\x04", "a zip archive or an Excel workbook", "save or unpack it as CSV"),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook", "save it as CSV"),
    (b"<", "HTML or XML", "export CSV or C3D"),
    (b"{", "JSON", "export CSV or C3D"),
];

/// What a text without the section is.
pub(super) fn describe(dialect: Dialect, text: &[u8]) -> FileProblem {
    if let Some((_, what, instead)) = KINDS.iter().find(|(start, ..)| begins_with(text, start)) {
        return FileProblem::new(*what, format!("{NEEDED_SECTION}; {instead}"));
    }
    let found = match is_utf16(text) {
        true => "UTF-16".to_owned(),
        false if text.contains(&0) => "a binary file".to_owned(),
        false => other_tables(dialect, text),
    };
    FileProblem::new(found, NEEDED_SECTION)
}

fn begins_with(text: &[u8], start: &[u8]) -> bool {
    let text = text.trim_ascii_start();
    let text = text.strip_prefix(b"\"").unwrap_or(text);
    text.get(..start.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(start))
}

/// Whether every other byte is 0, as in UTF-16 without a byte-order mark.
fn is_utf16(text: &[u8]) -> bool {
    const LOOKED_AT: usize = 64;
    let begin = text.get(..LOOKED_AT.min(text.len() & !1)).unwrap_or_default();
    let zeros =
        |parity: usize| begin.iter().skip(parity).step_by(2).filter(|byte| **byte == 0).count();
    let (even, odd) = (zeros(0), zeros(1));
    begin.len() >= 8 && even.min(odd) == 0 && even.max(odd) * 4 > begin.len()
}

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

/// A text without any title.
fn untitled(dialect: Dialect, text: &[u8]) -> String {
    let quoted = |line: &[u8]| line.starts_with(b"\"") && line.ends_with(b"\"");
    let mut filled = Lines::new(text).filter(|(_, line)| !dialect.is_blank(line));
    let (_, first) = filled.next().unwrap_or_default();
    if quoted(first) {
        return "a table of quoted cells (a graph plot, from Tracker)".to_owned();
    }
    if let Some((line, _)) = Lines::new(text).find(|(_, line)| dialect.is_axis_row(line)) {
        return format!("a row of axes in line {line}, and no title above it");
    }
    if dialect.number(dialect.first_cell(first)).is_some() && dialect.count(first) > 3 {
        return "numbers without a header (title, rate, labels and axes)".to_owned();
    }
    format!("no section at all in a text that begins with `{}`", shown(first))
}
