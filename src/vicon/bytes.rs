//! Files as bytes, lines and cells.

use std::borrow::Cow;
use std::io::{ErrorKind, Read};
use std::path::Path;

use flate2::read::MultiGzDecoder;

use super::ViconError;

/// Largest file that is unpacked, bytes: some ten hours of ten markers.
const UNPACKED_LIMIT_BYTES: u64 = 1 << 30;

const GZIP_MAGIC: &[u8] = &[0x1f, 0x8b];
const BYTE_ORDER_MARK: &[u8] = &[0xef, 0xbb, 0xbf];

/// The bytes of a file as they are.
///
/// # Errors
/// The file is missing or unreadable.
pub fn read_file(path: &Path) -> Result<Vec<u8>, ViconError> {
    std::fs::read(path).map_err(|source| match source.kind() {
        ErrorKind::NotFound => ViconError::Missing { path: path.to_owned() },
        _ => ViconError::Read { path: path.to_owned(), source },
    })
}

/// The text of a file: unpacked if it is packed, without a byte-order mark.
pub(super) fn unpack<'f>(path: &Path, file: &'f [u8]) -> Result<Cow<'f, [u8]>, ViconError> {
    unpack_at_most(path, file, UNPACKED_LIMIT_BYTES)
}

pub(super) fn unpack_at_most<'f>(
    path: &Path,
    file: &'f [u8],
    limit_bytes: u64,
) -> Result<Cow<'f, [u8]>, ViconError> {
    if !file.starts_with(GZIP_MAGIC) {
        return Ok(Cow::Borrowed(file.strip_prefix(BYTE_ORDER_MARK).unwrap_or(file)));
    }
    let mut text = Vec::new();
    MultiGzDecoder::new(file)
        .take(limit_bytes.saturating_add(1))
        .read_to_end(&mut text)
        .map_err(|source| ViconError::Unpack { path: path.to_owned(), source })?;
    if text.len() as u64 > limit_bytes {
        return Err(ViconError::TooLarge { path: path.to_owned(), limit_bytes });
    }
    if text.starts_with(BYTE_ORDER_MARK) {
        text.drain(..BYTE_ORDER_MARK.len());
    }
    Ok(Cow::Owned(text))
}

/// The lines of a text without their ends, numbered from 1.
#[derive(Clone)]
pub(super) struct Lines<'t> {
    rest: &'t [u8],
    number: usize,
}

impl<'t> Lines<'t> {
    pub fn new(text: &'t [u8]) -> Self {
        Self { rest: text, number: 0 }
    }
}

impl<'t> Iterator for Lines<'t> {
    type Item = (usize, &'t [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let end = self.rest.iter().position(|&byte| byte == b'\n').unwrap_or(self.rest.len());
        let line = &self.rest[..end];
        self.rest = self.rest.get(end + 1..).unwrap_or_default();
        self.number += 1;
        Some((self.number, line.strip_suffix(b"\r").unwrap_or(line)))
    }
}

/// The cells of a line without surrounding spaces and quotes.
pub(super) fn cells(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|&byte| byte == b',').map(bare)
}

/// A cell without surrounding spaces and quotes.
pub(super) fn bare(cell: &[u8]) -> &[u8] {
    let cell = cell.trim_ascii();
    let unquoted = cell.strip_prefix(b"\"").and_then(|cell| cell.strip_suffix(b"\""));
    unquoted.map_or(cell, <[u8]>::trim_ascii)
}

/// Whether a line has nothing in any cell.
pub(super) fn is_blank(line: &[u8]) -> bool {
    line.iter().all(|&byte| byte == b',' || byte.is_ascii_whitespace())
}

/// A line's only cell that is not empty, if it is the first one.
pub(super) fn lone_cell(line: &[u8]) -> Option<&[u8]> {
    let comma = line.iter().position(|&byte| byte == b',').unwrap_or(line.len());
    let first = bare(&line[..comma]);
    (!first.is_empty() && is_blank(&line[comma..])).then_some(first)
}

/// A finite number that fills the whole cell.
pub(super) fn number(cell: &[u8]) -> Option<f64> {
    fast_float2::parse::<f64, _>(cell).ok().filter(|value| value.is_finite())
}

/// A cell for a message: readable, and not longer than a message should be.
pub(super) fn shown(cell: &[u8]) -> String {
    const LONGEST: usize = 40;
    let text = String::from_utf8_lossy(&cell[..cell.len().min(4 * LONGEST)]);
    let clean = |c: char| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c };
    let mut short: String = text.chars().take(LONGEST).map(clean).collect();
    if text.chars().nth(LONGEST).is_some() {
        short.push_str("...");
    }
    short
}
