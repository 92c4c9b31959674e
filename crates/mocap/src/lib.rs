//! Marker files of the camera system: a file's bytes in, markers over time out.
//!
//! A CSV export is several ragged tables in one file. The `Trajectories` section is found by
//! its name; its header names the columns of markers; its rows are parsed byte by byte
//! straight into one flat vector. C3D files are recognised by their content or name. Nothing is
//! interpolated and nothing is guessed: what the file leaves empty is missing.
//!
//! [`read_markers`] gives a [`Recording`], in mm. The modules in the order that a file passes them:
//!
//! - `bytes` reads and decompresses; then, by format,
//!   - text: `cells`, `sections`, `header`, `units`, `rows`, `decimals`; `foreign` says what another
//!     program's file is;
//!   - C3D: `c3d` (<https://www.c3d.org>), integers and floats of all three processor types;
//! - both give `markers`; `error`: what was found, what was needed, in which line.
//! - `write`: the same files from markers, as Nexus writes them.
//!
//! ```
//! use trilink_mocap::{LengthUnit, Recording, csv_bytes, parse_markers};
//!
//! let seen_then_hidden = vec![[1.5, -2.0, 3.0], [f64::NAN; 3]];
//! let file = Recording::new(Some(120.0), vec![1, 2], vec!["Snake:V_1".into()], seen_then_hidden);
//! let read = parse_markers("trial.csv".as_ref(), &csv_bytes(&file), LengthUnit::Mm)?;
//! assert_eq!((read.rate_hz, &read.labels), (Some(120.0), &file.labels));
//! assert_eq!(read.position_mm(0, 0), [1.5, -2.0, 3.0]);
//! assert!(read.position_mm(1, 0)[0].is_nan());
//! # Ok::<(), trilink_mocap::ReadError>(())
//! ```
//!
//! The example `gaps` prints how well the cameras saw each marker.

mod bytes;
mod c3d;
mod cells;
mod decimals;
mod error;
mod foreign;
mod header;
mod markers;
mod rows;
mod sections;
mod units;
mod write;

use std::path::Path;

pub use bytes::read_file;
pub use error::{FileProblem, ReadError};
pub use markers::Recording;
pub use sections::Section;
pub use trilink_base::LengthUnit;
pub use write::{c3d_bytes, csv_bytes};

/// Names of marker files end like this, packed or not.
const ENDINGS: [&str; 2] = [".csv", ".c3d"];

/// Names of the marker files of a folder, sorted.
///
/// # Errors
/// The folder cannot be read.
pub fn marker_files(folder: &Path) -> std::io::Result<Vec<String>> {
    let is_marker_file = |name: &String| {
        let plain = name.to_ascii_lowercase();
        let plain = plain.strip_suffix(".gz").unwrap_or(&plain);
        ENDINGS.iter().any(|end| plain.ends_with(end)) && !name.starts_with('.')
    };
    let entries = std::fs::read_dir(folder)?.flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<String> = names.filter(is_marker_file).collect();
    names.sort();
    Ok(names)
}

/// Reads the markers of an exported file, CSV or C3D, as it is or packed by gzip; `unit` is that of
/// a file which does not say its own.
///
/// # Errors
/// The file is missing, unreadable, empty or too large when unpacked; has no `Trajectories`
/// section with named markers, or two; has text where a number should be, numbers that lost their
/// decimal point, or frame numbers that do not increase; is a C3D file that is cut or damaged, or
/// whose counts contradict each other. Every message names the file, the line of a text, what was
/// found and what was needed.
pub fn read_markers(path: &Path, unit: LengthUnit) -> Result<Recording, ReadError> {
    parse_markers(path, &read_file(path)?.0, unit)
}

/// [`read_markers`] of bytes at hand, packed or not; `path` is the file that errors name.
///
/// # Errors
/// As [`read_markers`].
pub fn parse_markers(path: &Path, file: &[u8], unit: LengthUnit) -> Result<Recording, ReadError> {
    by_format(path, file, |file| c3d::parse(file, unit), |text| rows::parse(text, unit))
}

/// Every table of a file's bytes, also those that are not read.
///
/// # Errors
/// The file cannot be unpacked, or is neither text nor C3D.
pub fn sections(path: &Path, file: &[u8]) -> Result<Vec<Section>, ReadError> {
    by_format(path, file, c3d::sections, |text| Ok(sections::list(cells::Dialect::of(text), text)))
}

fn by_format<T>(
    path: &Path,
    file: &[u8],
    of_c3d: impl Fn(&[u8]) -> Result<T, FileProblem>,
    of_text: impl Fn(&[u8]) -> Result<T, FileProblem>,
) -> Result<T, ReadError> {
    let read = |content: &[u8]| match c3d::is_c3d(path, content) {
        true => of_c3d(content),
        false => of_text(bytes::text(content)?),
    };
    bytes::unpack(file).and_then(|content| read(&content)).map_err(|problem| problem.of(path))
}

#[cfg(test)]
mod tests;
