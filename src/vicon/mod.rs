//! Marker files of the camera system: a file's bytes in, markers over time out.
//!
//! A Nexus export is several ragged tables in one file. The `Trajectories` section is found by
//! its name; its header says which columns are markers; its rows are parsed byte by byte
//! straight into one flat vector. Nothing is interpolated and nothing is guessed: what the
//! file leaves empty is missing.

mod bytes;
mod error;
mod header;
mod markers;
mod rows;

use std::path::Path;

pub use bytes::read_file;
pub use error::ViconError;
pub use markers::MarkerFile;

/// Reads the markers of an exported file; `.csv` as it is or packed by gzip.
///
/// # Errors
/// The file is missing, unreadable, empty or too large when unpacked; has no `Trajectories`
/// section with named markers; has text where a number should be, or frame numbers that do
/// not increase. Every message names the file and line, what was found and what was needed.
pub fn read_markers(path: &Path) -> Result<MarkerFile, ViconError> {
    parse_markers(path, &read_file(path)?)
}

/// [`read_markers`] of bytes at hand, packed or not; `path` is the file that errors name.
///
/// # Errors
/// As [`read_markers`].
pub fn parse_markers(path: &Path, file: &[u8]) -> Result<MarkerFile, ViconError> {
    let text = bytes::unpack(path, file)?;
    let header = header::find(path, &text)?;
    rows::parse(path, &text, header)
}

#[cfg(test)]
mod tests;
