//! Checksum that a Parquet file stores in its own metadata. It reveals damage, for example by a faulty disk,
//! before the file is parsed.
//!
//! The value of the key `trilink.blake3` is the BLAKE3 hash of the file with the 64 digits of that value set to zeros.

use std::ops::Range;
use std::path::Path;

use super::StoreError;

/// Key of the checksum in the key-value metadata of a Parquet file.
pub const KEY: &str = "trilink.blake3";
/// Placeholder for the checksum until [`insert`] fills it in.
pub const PLACEHOLDER: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// Bytes between the key and the value of the checksum: the header of a 64-byte string field in Thrift's
/// compact protocol.
const VALUE_HEADER: &[u8] = &[0x18, PLACEHOLDER.len() as u8];
/// Bytes after the value of the checksum: the end of the key-value pairs, and a 6-byte string that names the
/// library that wrote the file. Other libraries may copy the key-value pairs from a file that they read, but
/// they write another name.
const WRITER: &[u8] = b"\0\x18\x06Polars";
/// Number of bytes at the end of a file that are searched for the checksum, which is followed by the
/// writer's name and a few bytes for each column.
const SEARCHED: usize = 1 << 16;

/// Replaces the [`PLACEHOLDER`] in the bytes of a file by the file's checksum; returns whether there was a
/// placeholder.
#[must_use]
pub fn insert(bytes: &mut [u8]) -> bool {
    let Some(value) = find_value(bytes) else { return false };
    let checksum = compute(bytes, &value);
    bytes[value].copy_from_slice(checksum.as_bytes());
    true
}

/// Checks that the bytes of a file match its checksum. A file written by another program is not checked.
///
/// # Errors
/// Returns [`StoreError::Damaged`] if the bytes do not match the checksum.
pub fn check(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    match find_value(bytes) {
        Some(value) if compute(bytes, &value).as_bytes() != &bytes[value.clone()] => {
            Err(StoreError::Damaged { path: path.to_owned() })
        }
        _ => Ok(()),
    }
}

/// Finds the position of the checksum in the bytes of a file that trilink wrote; `None` for any other file.
fn find_value(bytes: &[u8]) -> Option<Range<usize>> {
    let end = &bytes[bytes.len().saturating_sub(SEARCHED)..];
    let before = [KEY.as_bytes(), VALUE_HEADER].concat();
    let position = end.windows(before.len()).rposition(|part| part == before)?;
    let start = bytes.len() - end.len() + position + before.len();
    let value = start..start + PLACEHOLDER.len();
    bytes.get(value.end..)?.starts_with(WRITER).then_some(value)
}

/// Computes the checksum of the bytes of a file; `value` is the position at which the checksum is stored.
fn compute(bytes: &[u8], value: &Range<usize>) -> String {
    let mut hash = blake3::Hasher::new();
    hash.update(&bytes[..value.start]).update(PLACEHOLDER.as_bytes()).update(&bytes[value.end..]);
    hash.finalize().to_hex().to_string()
}
