//! Reads and decompresses the bytes of files.

use std::borrow::Cow;
use std::fs::Metadata;
use std::io::{ErrorKind, Read};
use std::path::Path;

use flate2::read::MultiGzDecoder;
use trilink_base::files;

use super::{FileProblem, ReadError};

/// Maximum size of a decompressed file, bytes: about ten hours of ten markers at 120 Hz.
const MAX_UNPACKED_BYTES: u64 = 1 << 30;
/// Size up to which a file is decompressed whatever its compression ratio, bytes: half an hour of ten markers at 120
/// Hz.
const MIN_LIMIT_BYTES: u64 = 1 << 26;
/// Maximum ratio of decompressed to compressed size above [`MIN_LIMIT_BYTES`]. Marker files shrink to a quarter; only
/// recordings without any visible marker, and files made to exhaust the memory, shrink to a hundredth.
const MAX_RATIO: u64 = 100;

const GZIP_MAGIC: &[u8] = &[0x1f, 0x8b];
const UTF8_MARK: &[u8] = &[0xef, 0xbb, 0xbf];
const BYTE_ORDER_MARK: char = '\u{feff}';

/// Reads the bytes and the metadata of a file.
///
/// # Errors
/// Returns an error if the file is missing or unreadable.
pub fn read_file(path: &Path) -> Result<(Vec<u8>, Metadata), ReadError> {
    files::read(path, files::DATA_BYTES).map_err(|error| match error.kind() {
        ErrorKind::NotFound => FileProblem::Missing.in_file(path),
        _ => FileProblem::Read(error).in_file(path),
    })
}

/// Returns the content of a file, decompressed if it is gzipped.
pub(super) fn unpack(file: &[u8]) -> Result<Cow<'_, [u8]>, FileProblem> {
    let by_ratio = MAX_RATIO.saturating_mul(file.len() as u64);
    unpack_at_most(file, by_ratio.clamp(MIN_LIMIT_BYTES, MAX_UNPACKED_BYTES))
}

/// Returns the content of a file, decompressed if it is gzipped; returns an error if the decompressed content is larger
/// than `limit_bytes`.
pub(super) fn unpack_at_most(file: &[u8], limit_bytes: u64) -> Result<Cow<'_, [u8]>, FileProblem> {
    if !file.starts_with(GZIP_MAGIC) {
        return Ok(Cow::Borrowed(file));
    }
    let mut content = Vec::new();
    MultiGzDecoder::new(file)
        .take(limit_bytes.saturating_add(1))
        .read_to_end(&mut content)
        .map_err(FileProblem::Unpack)?;
    if content.len() as u64 > limit_bytes {
        let found = format!("more than {limit_bytes} bytes when unpacked");
        return Err(FileProblem::new(found, "a smaller file"));
    }
    Ok(Cow::Owned(content))
}

/// Returns the text in a file's content, without a byte-order mark; UTF-16 becomes UTF-8.
pub(super) fn text(content: &[u8]) -> Cow<'_, [u8]> {
    let decode = |pair: fn([u8; 2]) -> u16| {
        let units = content.as_chunks::<2>().0.iter().map(|bytes| pair(*bytes));
        let text = char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER));
        let text: String = text.filter(|c| *c != BYTE_ORDER_MARK).collect();
        Cow::Owned(text.into_bytes())
    };
    match utf16_order(content) {
        Some(Utf16::LittleEndian) => decode(u16::from_le_bytes),
        Some(Utf16::BigEndian) => decode(u16::from_be_bytes),
        None => Cow::Borrowed(content.strip_prefix(UTF8_MARK).unwrap_or(content)),
    }
}

/// Byte order of UTF-16.
enum Utf16 {
    LittleEndian,
    BigEndian,
}

/// Detects UTF-16 by its byte-order mark or, without one, by the zero in every other byte of Latin letters and digits.
fn utf16_order(content: &[u8]) -> Option<Utf16> {
    const EXAMINED: usize = 64;
    match content {
        [0xff, 0xfe, ..] => return Some(Utf16::LittleEndian),
        [0xfe, 0xff, ..] => return Some(Utf16::BigEndian),
        _ => {}
    }
    let begin = content.get(..EXAMINED.min(content.len() & !1))?;
    let [even, odd] = [0, 1]
        .map(|parity| begin.iter().skip(parity).step_by(2).filter(|byte| **byte == 0).count());
    match (even, odd) {
        _ if begin.len() < 8 || 4 * even.max(odd) <= begin.len() => None,
        (0, _) => Some(Utf16::LittleEndian),
        (_, 0) => Some(Utf16::BigEndian),
        _ => None,
    }
}
