//! Reads and writes marker files of motion-capture systems.
//!
//! The format is recognised by the content, except that a damaged C3D file is also recognised by its name. Vicon's CSV
//! export consists of several tables of different widths in one file; the `Trajectories` section is found by its title.
//! OptiTrack Motive (CSV), Qualisys (TSV) and TRC files, and tables of other programs (CSV or Parquet), have one table
//! each. The header names the columns of the markers or, in exports of rigid bodies, of the poses; the rows are parsed
//! byte by byte into one flat vector. Nothing is interpolated: empty cells are missing values. If a format leaves open
//! whether y or z points up, the axis along which the markers move less does.
//!
//! [`read_markers`] returns a [`Recording`], in mm. The modules are, in the order in which a file passes through them:
//!
//! - `bytes` reads and decompresses files; the next step depends on the format:
//!   - text: `systems`, `cells`, `sections`, `header` (`motive`, `trc`, `qualisys`, `table`), `units`, `rows`,
//!     `rotation`, `decimals`, `vertical`; `foreign` identifies other files;
//!   - C3D: `c3d` (<https://www.c3d.org>), with the integers and floats of all three processor types;
//! - `markers`: the resulting recording; `error`: what was found, what was needed, and in which line;
//! - `write` writes the same formats.
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
//! The example `gaps` prints the coverage of each marker.

mod bytes;
mod c3d;
mod cells;
mod decimals;
mod error;
mod foreign;
mod header;
mod markers;
mod motive;
mod qualisys;
mod rotation;
mod rows;
mod sections;
mod systems;
mod table;
mod trc;
mod units;
mod vertical;
mod write;

use std::path::Path;

pub use bytes::read_file;
pub use error::{FileProblem, ReadError};
pub use markers::Recording;
pub use sections::Section;
pub use trilink_base::LengthUnit;
pub use write::{Format, c3d_bytes, csv_bytes, trc_bytes};

/// File-name extensions of marker files, with which they are found in a folder; `.gz` may follow.
pub const ENDINGS: [&str; 5] = [".csv", ".c3d", ".trc", ".tsv", ".parquet"];

/// Lists the names of the marker files in a folder, sorted.
///
/// # Errors
/// Returns an error if the folder cannot be read.
pub fn marker_files(folder: &Path) -> std::io::Result<Vec<String>> {
    let entries = std::fs::read_dir(folder)?.flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<String> = names.filter(|name| is_marker_file(name)).collect();
    names.sort();
    Ok(names)
}

fn is_marker_file(name: &str) -> bool {
    let plain = name.to_ascii_lowercase();
    let plain = plain.strip_suffix(".gz").unwrap_or(&plain);
    ENDINGS.iter().any(|ending| plain.ends_with(ending)) && !name.starts_with('.')
}

/// Reads the markers in an exported file of any known format, plain or gzipped; `unit` applies if the file does not
/// state a unit.
///
/// # Errors
/// Returns an error if the file is missing, unreadable, empty or too large when decompressed; if it has no table with
/// named markers, or more than one; if it has text in place of a number, numbers that lost their decimal point, frame
/// numbers that do not increase, or times that contradict the frame rate; or if it is a C3D file that is truncated,
/// damaged or inconsistent. Every message names the file, the line if it is a text file, what was found and what was
/// needed.
pub fn read_markers(path: &Path, unit: LengthUnit) -> Result<Recording, ReadError> {
    parse_markers(path, &read_file(path)?.0, unit)
}

/// Parses the markers in the bytes of a file, plain or gzipped; error messages refer to the file as `path`.
///
/// # Errors
/// Returns an error in the same cases as [`read_markers`].
pub fn parse_markers(path: &Path, file: &[u8], unit: LengthUnit) -> Result<Recording, ReadError> {
    by_format(path, file, |file| c3d::parse(file, unit), |text| rows::parse(text, unit))
}

/// Lists all tables in the bytes of a file, including those that are not read as markers.
///
/// # Errors
/// Returns an error if the file cannot be decompressed or is neither text nor C3D.
pub fn sections(path: &Path, file: &[u8]) -> Result<Vec<Section>, ReadError> {
    by_format(path, file, c3d::sections, |text| sections::list_all(text, LengthUnit::Mm))
}

fn by_format<T>(
    path: &Path,
    file: &[u8],
    of_c3d: impl Fn(&[u8]) -> Result<T, FileProblem>,
    of_text: impl Fn(&[u8]) -> Result<T, FileProblem>,
) -> Result<T, ReadError> {
    let parse = || {
        let content = bytes::unpack(file)?;
        if content.starts_with(table::PARQUET_MAGIC) {
            of_text(&table::text_of_parquet(&content)?)
        } else if c3d::is_c3d(path, &content) {
            of_c3d(&content)
        } else {
            of_text(&bytes::text(&content))
        }
    };
    parse().map_err(|problem: FileProblem| problem.in_file(path))
}

#[cfg(test)]
mod tests;
