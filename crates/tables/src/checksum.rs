//! A checksum of a table's file in its own metadata: what a disk or a copy made of it is seen before it
//! is read.
//!
//! The value of `trilink.blake3` is the BLAKE3 of the file's bytes in which the value's own 64 digits
//! are zeros.

use std::ops::Range;
use std::path::Path;

use super::StoreError;

/// Key of the file's metadata.
pub const KEY: &str = "trilink.blake3";
/// What stands there until [`put`].
pub const NONE: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// Between key and value: in Thrift's compact protocol, the next field is a string, of 64 bytes.
const NEXT: &[u8] = &[0x18, NONE.len() as u8];
/// After the value: the end of the pairs, and a string of 6 bytes that names the writer. Other libraries keep the
/// pairs of what they read and write it anew.
const WRITER: &[u8] = b"\0\x18\x06Polars";
/// The writer's name is followed by a few bytes of each column.
const END: usize = 1 << 16;

/// Puts the checksum of a file that has [`NONE`] into it; says whether there was a place for it.
#[must_use]
pub fn put(bytes: &mut [u8]) -> bool {
    let Some(at) = place(bytes) else { return false };
    let sum = of(bytes, &at);
    bytes[at].copy_from_slice(sum.as_bytes());
    true
}

/// Checks that a file's bytes are those that were written. What another program wrote has no checksum, or
/// that of what it read.
///
/// # Errors
/// They are not.
pub fn check(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let holds = place(bytes).is_none_or(|at| of(bytes, &at).as_bytes() == &bytes[at]);
    if holds { Ok(()) } else { Err(StoreError::Damaged { path: path.to_owned() }) }
}

/// Where the value stands.
fn place(bytes: &[u8]) -> Option<Range<usize>> {
    let end = &bytes[bytes.len().saturating_sub(END)..];
    let before = [KEY.as_bytes(), NEXT].concat();
    let found = end.windows(before.len()).rposition(|part| part == before)?;
    let start = bytes.len() - end.len() + found + before.len();
    let value = start..start + NONE.len();
    bytes.get(value.end..)?.starts_with(WRITER).then_some(value)
}

fn of(bytes: &[u8], value: &Range<usize>) -> String {
    let mut hash = blake3::Hasher::new();
    hash.update(&bytes[..value.start]).update(NONE.as_bytes()).update(&bytes[value.end..]);
    hash.finalize().to_hex().to_string()
}
