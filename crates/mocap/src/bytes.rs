//! Files as bytes, packed or not.

use std::borrow::Cow;
use std::fs::Metadata;
use std::io::{ErrorKind, Read};
use std::path::Path;

use flate2::read::MultiGzDecoder;
use trilink_base::files;

use super::{FileProblem, ReadError};

/// Largest text that is unpacked, bytes: some ten hours of ten markers.
const UNPACKED_LIMIT_BYTES: u64 = 1 << 30;
/// Smallest limit, bytes: half an hour of ten markers.
const LEAST_LIMIT_BYTES: u64 = 1 << 26;
/// Beyond that, times the packed size. Marker files shrink to a quarter; only those in which
/// nothing was seen shrink to a hundredth, and those that are made to fill the memory.
const LARGEST_RATIO: u64 = 100;

const GZIP_MAGIC: &[u8] = &[0x1f, 0x8b];
const BYTE_ORDER_MARK: &[u8] = &[0xef, 0xbb, 0xbf];
const UTF16_MARKS: [&[u8]; 2] = [&[0xff, 0xfe], &[0xfe, 0xff]];

/// The bytes of a file as they are, with what the system says of it.
///
/// # Errors
/// The file is missing or unreadable.
pub fn read_file(path: &Path) -> Result<(Vec<u8>, Metadata), ReadError> {
    files::read(path, files::DATA_BYTES).map_err(|error| match error.kind() {
        ErrorKind::NotFound => FileProblem::Missing.of(path),
        _ => FileProblem::Read(error).of(path),
    })
}

/// The content of a file: unpacked if it is packed.
pub(super) fn unpack(file: &[u8]) -> Result<Cow<'_, [u8]>, FileProblem> {
    let by_ratio = LARGEST_RATIO.saturating_mul(file.len() as u64);
    unpack_at_most(file, by_ratio.clamp(LEAST_LIMIT_BYTES, UNPACKED_LIMIT_BYTES))
}

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
        return Err(FileProblem::new(found, "at most that"));
    }
    Ok(Cow::Owned(content))
}

/// The text of a file's content, without a byte-order mark.
pub(super) fn text(content: &[u8]) -> Result<&[u8], FileProblem> {
    if UTF16_MARKS.iter().any(|mark| content.starts_with(mark)) {
        return Err(FileProblem::new("UTF-16", "a text in UTF-8; save it as `CSV UTF-8`"));
    }
    Ok(content.strip_prefix(BYTE_ORDER_MARK).unwrap_or(content))
}
