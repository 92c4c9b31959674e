//! Splits texts into lines and lines into cells, whatever the line ends and separators.

/// Possible cell separators.
const SEPARATORS: [u8; 3] = [b',', b';', b'\t'];

/// Possible first cells of the row that names the columns: the cells written by Vicon Nexus and OptiTrack Motive, by
/// the older Vicon Workstation, and in TRC files.
const FRAME_CELLS: [&[u8]; 3] = [b"Frame", b"Field #", b"Frame#"];

/// Maximum length of a number with a decimal comma, bytes.
const MAX_NUMBER_BYTES: usize = 64;

/// Iterator over lines of text, numbered from 1, without their line ends (LF, CR LF, or CR alone).
#[derive(Clone)]
pub(super) struct Lines<'t> {
    rest: &'t [u8],
    /// Last byte of a line end, LF or CR.
    end: u8,
    number: usize,
}

impl<'t> Lines<'t> {
    pub(crate) fn new(text: &'t [u8]) -> Self {
        let first = memchr::memchr2(b'\r', b'\n', text).map_or(&[][..], |at| &text[at..]);
        let after = first.iter().find(|&&byte| byte != b'\r');
        let is_cr = first.starts_with(b"\r") && after != Some(&b'\n');
        Self { rest: text, end: if is_cr { b'\r' } else { b'\n' }, number: 0 }
    }
}

impl<'t> Iterator for Lines<'t> {
    type Item = (usize, &'t [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let end = memchr::memchr(self.end, self.rest).unwrap_or(self.rest.len());
        let line = &self.rest[..end];
        self.rest = self.rest.get(end + 1..).unwrap_or_default();
        self.number += 1;
        Some((self.number, line.strip_suffix(b"\r").unwrap_or(line)))
    }
}

/// Separator between the cells in a text file. If the separator is not a comma, a comma in a number is the decimal
/// separator, as is usual for spreadsheets in many countries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Dialect {
    pub separator: u8,
}

impl Dialect {
    /// Detects the separator from the first row of axes (such as `Frame,Sub Frame,X,Y,Z`); without such a row, a comma
    /// is assumed.
    pub(crate) fn detect(text: &[u8]) -> Self {
        let separator = Lines::new(text).find_map(|(_, line)| {
            let end = line.iter().position(|byte| SEPARATORS.contains(byte))?;
            is_frame_cell(trimmed(&line[..end])).then_some(line[end])
        });
        Self { separator: separator.unwrap_or(b',') }
    }

    /// Returns the separator after the first cell of the text.
    pub(crate) fn of_first_line(text: &[u8]) -> Self {
        let separator = text.iter().find(|byte| SEPARATORS.contains(byte));
        Self { separator: separator.copied().unwrap_or(b'\t') }
    }

    /// Iterates over the cells in a line, without surrounding spaces and quotes.
    pub(crate) fn cells(self, line: &[u8]) -> impl Iterator<Item = &[u8]> {
        line.split(move |&byte| byte == self.separator).map(trimmed)
    }

    /// Returns the number of cells in a line.
    pub(crate) fn count(self, line: &[u8]) -> usize {
        line.iter().filter(|&&byte| byte == self.separator).count() + 1
    }

    /// Returns the length of the first cell in `rest`, bytes.
    pub(crate) fn cell_end(self, rest: &[u8]) -> usize {
        rest.iter().position(|&byte| byte == self.separator).unwrap_or(rest.len())
    }

    /// Returns the first cell in a line, without surrounding spaces and quotes.
    pub(crate) fn first_cell(self, line: &[u8]) -> &[u8] {
        trimmed(&line[..self.cell_end(line)])
    }

    /// Returns whether all cells in a line are empty.
    pub(crate) fn is_blank(self, line: &[u8]) -> bool {
        line.iter().all(|&byte| byte == self.separator || byte.is_ascii_whitespace())
    }

    /// Returns the first cell in a line if all other cells are empty; otherwise `None`.
    pub(crate) fn lone_cell(self, line: &[u8]) -> Option<&[u8]> {
        let end = self.cell_end(line);
        let first = trimmed(&line[..end]);
        (!first.is_empty() && self.is_blank(&line[end..])).then_some(first)
    }

    /// Returns whether a line is a row of axes, which names the columns below it, as in `Frame,Sub Frame,X,Y,Z`.
    pub(crate) fn is_axis_row(self, line: &[u8]) -> bool {
        is_frame_cell(self.first_cell(line))
    }

    /// Parses a finite number that takes up a whole cell; `None` if the cell has no such number.
    pub(crate) fn number(self, cell: &[u8]) -> Option<f64> {
        if self.separator == b',' || !cell.contains(&b',') {
            return parse(cell);
        }
        let mut with_point = [0; MAX_NUMBER_BYTES];
        let with_point = with_point.get_mut(..cell.len())?;
        for (to, &from) in with_point.iter_mut().zip(cell) {
            *to = if from == b',' { b'.' } else { from };
        }
        parse(with_point)
    }
}

/// Parses a plain number at the start of `text`: at most 15 digits, with an optional minus sign and decimal point.
/// Returns the number and its length in bytes; `None` if there is no plain number. A plain number is the quotient of
/// two exactly represented numbers, so that it is rounded only once (Clinger 1990).
#[inline]
pub(super) fn plain_decimal(text: &[u8]) -> Option<(f64, usize)> {
    const MAX_DIGITS: usize = 15;
    const POWERS: [f64; MAX_DIGITS + 1] =
        [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];
    let (is_negative, number) = match text {
        [b'-', number @ ..] => (true, number),
        number => (false, number),
    };
    let (digits, rest) = append_digits(0, number);
    let whole = number.len() - rest.len();
    let (digits, rest, places) = match rest {
        [b'.', fraction @ ..] => {
            let (digits, rest) = append_digits(digits, fraction);
            (digits, rest, fraction.len() - rest.len())
        }
        rest => (digits, rest, 0),
    };
    if !(1..=MAX_DIGITS).contains(&(whole + places)) {
        return None;
    }
    let value = digits as f64 / POWERS[places];
    Some((if is_negative { -value } else { value }, text.len() - rest.len()))
}

/// Appends the decimal digits at the start of `text` to a number, which wraps around on overflow. Returns the number
/// and the rest of the text.
#[inline]
fn append_digits(mut number: u64, mut text: &[u8]) -> (u64, &[u8]) {
    while let [digit @ b'0'..=b'9', rest @ ..] = text {
        number = number.wrapping_mul(10).wrapping_add((digit - b'0').into());
        text = rest;
    }
    (number, text)
}

pub(super) fn is_frame_cell(cell: &[u8]) -> bool {
    FRAME_CELLS.iter().any(|name| name.eq_ignore_ascii_case(cell))
}

fn parse(cell: &[u8]) -> Option<f64> {
    fast_float2::parse::<f64, _>(cell).ok().filter(|value| value.is_finite())
}

/// Returns whether a text begins with `start` (in lower case), ignoring case, spaces and a quote before it.
pub(super) fn begins_with(text: &[u8], start: &[u8]) -> bool {
    let text = text.trim_ascii_start();
    let text = text.strip_prefix(b"\"").unwrap_or(text);
    text.get(..start.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(start))
}

/// Removes surrounding spaces and quotes from a cell.
pub(super) fn trimmed(cell: &[u8]) -> &[u8] {
    let cell = cell.trim_ascii();
    let unquoted = cell.strip_prefix(b"\"").and_then(|cell| cell.strip_suffix(b"\""));
    unquoted.map_or(cell, <[u8]>::trim_ascii)
}

/// Characters for the bytes 0x80 to 0x9f in Windows-1252; higher bytes are as in Latin-1.
const WINDOWS_1252: [char; 32] = [
    '\u{20ac}', '\u{81}', '\u{201a}', '\u{192}', '\u{201e}', '\u{2026}', '\u{2020}', '\u{2021}',
    '\u{2c6}', '\u{2030}', '\u{160}', '\u{2039}', '\u{152}', '\u{8d}', '\u{17d}', '\u{8f}',
    '\u{90}', '\u{2018}', '\u{2019}', '\u{201c}', '\u{201d}', '\u{2022}', '\u{2013}', '\u{2014}',
    '\u{2dc}', '\u{2122}', '\u{161}', '\u{203a}', '\u{153}', '\u{9d}', '\u{17e}', '\u{178}',
];

/// Decodes a label from UTF-8 or, if it is not valid UTF-8, from Windows-1252, which older programs and spreadsheets
/// write.
pub(super) fn label_text(label: &[u8]) -> String {
    match std::str::from_utf8(label) {
        Ok(text) => text.to_owned(),
        Err(_) => label.iter().map(|&byte| windows_1252(byte)).collect(),
    }
}

fn windows_1252(byte: u8) -> char {
    match byte {
        0x80..=0x9f => WINDOWS_1252[usize::from(byte - 0x80)],
        _ => char::from(byte),
    }
}

/// Formats a cell for a message: printable and limited in length.
pub(super) fn shown(cell: &[u8]) -> String {
    const MAX_CHARS: usize = 40;
    let text = String::from_utf8_lossy(&cell[..cell.len().min(4 * MAX_CHARS)]);
    let mut short: String = text
        .chars()
        .take(MAX_CHARS)
        .map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c })
        .collect();
    if text.chars().nth(MAX_CHARS).is_some() {
        short.push_str("...");
    }
    short
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        #[test]
        fn plain_decimals_are_read_as_the_standard_library_does(
            text in "-?[0-9]{0,9}(\\.[0-9]{0,8})?",
            rest in "|,.*|\\..*|e.*",
        ) {
            let found = plain_decimal((text.clone() + &rest).as_bytes());
            if let Some((value, length)) = found {
                let read = (text + &rest)[..length].parse::<f64>().unwrap();
                prop_assert_eq!(value.to_bits(), read.to_bits());
            } else {
                let digits = text.bytes().filter(u8::is_ascii_digit).count();
                prop_assert!(digits == 0 || digits > 15 || !rest.is_empty());
            }
        }
    }
}
