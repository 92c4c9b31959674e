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
const BYTE_ORDER_MARK: &[u8] = &[0xef, 0xbb, 0xbf];
const UTF16_MARKS: [&[u8]; 2] = [&[0xff, 0xfe], &[0xfe, 0xff]];

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

/// Returns the text in a file's content, without a byte-order mark.
pub(super) fn text(content: &[u8]) -> Result<&[u8], FileProblem> {
    if UTF16_MARKS.iter().any(|mark| content.starts_with(mark)) {
        return Err(FileProblem::new("UTF-16", "UTF-8 text; save the file as `CSV UTF-8`"));
    }
    Ok(content.strip_prefix(BYTE_ORDER_MARK).unwrap_or(content))
}
