//! Reads the header of a table of markers, rigid bodies or both that any program may have written. The z axis points up.
//!
//! ```text
//! frame,time_s,M1_x_mm,M1_y_mm,M1_z_mm,middle_x_m,middle_y_m,middle_z_m,middle_qw,middle_qx,middle_qy,middle_qz
//! ```
//!
//! The first row names the columns, in any order:
//!
//! - `frame`: frame number; `time_s`: time, s. At least one of them; without frame numbers, the times give them, and with
//!   times, they give the frame rate.
//! - `NAME_x_mm`, `NAME_y_mm`, `NAME_z_mm`: position of a marker, or of the origin of a rigid body; `_cm`, `_m` and `_in`
//!   in place of `_mm` for other units, the same for all positions;
//! - `NAME_qw`, `NAME_qx`, `NAME_qy`, `NAME_qz`: rotation of a rigid body as a unit quaternion; or, if there is none,
//!   `NAME_roll_deg`, `NAME_pitch_deg`, `NAME_yaw_deg` (or `_rad`, for all three): rotations about z (yaw), then the new y
//!   (pitch), then the new x (roll).
//!
//! Other columns are ignored. A Parquet file is read as the CSV file with the same columns.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};

use polars::prelude::{
    DataFrame, DataType, ParallelStrategy, ParquetReader, PolarsResult, SerReader,
};
use trilink_base::{LengthUnit, Named as _, body};

use super::FileProblem;
use super::cells::{Dialect, Lines, label_text, trimmed};
use super::header::{Column, Header};
use super::rotation::Rotation;
use super::systems::System;

/// Maximum number of values of a Parquet file: about ten hours of three rigid bodies at 120 Hz.
const MAX_CELLS: usize = 1 << 27;

/// First bytes of a Parquet file.
pub(super) const PARQUET_MAGIC: &[u8] = b"PAR1";

const NEEDED: &str = "columns `NAME_x_mm`, `NAME_y_mm`, `NAME_z_mm` (or `_cm`, `_m`, `_in`) of at least one marker or \
                      rigid body, beside `frame` or `time_s`";

/// Columns of a marker or a rigid body.
#[derive(Default)]
struct Entry {
    position: [Option<(usize, LengthUnit)>; 3],
    quaternion: [Option<usize>; 4],
    /// Columns of yaw, pitch and roll, with the unit, rad.
    angles: [Option<(usize, f64)>; 3],
}

/// Returns whether a text begins with the header of a table: a row with `frame` or `time_s` and the height of a marker.
pub(super) fn is_table(text: &[u8]) -> bool {
    let Some((_, line)) = Lines::new(text).next() else { return false };
    let dialect = Dialect::of_first_line(line);
    let is_clock = |cell: &[u8]| cell == b"frame" || cell == b"time_s";
    let is_coordinate =
        |cell: &[u8]| part(&label_text(cell)).is_some_and(|(_, part)| part.is_height());
    dialect.cells(line).any(is_clock) && dialect.cells(line).any(is_coordinate)
}

/// Meaning of a column of a marker or a rigid body.
enum Part {
    Position(usize, LengthUnit),
    Quaternion(usize),
    Angle(usize, f64),
}

impl Part {
    fn is_height(&self) -> bool {
        matches!(self, Self::Position(2, _))
    }
}

/// Returns the name of the marker or body to which a column belongs, and the meaning of the column.
fn part(column: &str) -> Option<(&str, Part)> {
    let (rest, last) = column.rsplit_once('_')?;
    let part = if let Some(unit) = LengthUnit::of_name(last) {
        let (name, axis) = rest.rsplit_once('_')?;
        let axis = ["x", "y", "z"].iter().position(|known| *known == axis)?;
        return (!name.is_empty()).then_some((name, Part::Position(axis, unit)));
    } else if let Some(unit_rad) = match last {
        "deg" => Some(1_f64.to_radians()),
        "rad" => Some(1.0),
        _ => None,
    } {
        let (name, angle) = rest.rsplit_once('_')?;
        let angle = ["yaw", "pitch", "roll"].iter().position(|known| *known == angle)?;
        return (!name.is_empty()).then_some((name, Part::Angle(angle, unit_rad)));
    } else {
        Part::Quaternion(["qw", "qx", "qy", "qz"].iter().position(|known| *known == last)?)
    };
    (!rest.is_empty()).then_some((rest, part))
}

/// Reads the header.
pub(super) fn header(text: &[u8]) -> Result<Header<'_>, FileProblem> {
    let mut lines = Lines::new(text);
    let first = lines.next().map_or(&b""[..], |(_, line)| line);
    let dialect = Dialect::of_first_line(first);
    let names: Vec<String> = dialect.cells(first).map(|cell| label_text(trimmed(cell))).collect();
    let mut columns = vec![Column::Other; names.len()];
    // Markers and bodies in the order of their first columns.
    let mut order: Vec<&str> = Vec::new();
    let mut entries: BTreeMap<&str, Entry> = BTreeMap::new();
    let mut twice: Option<&str> = None;
    for (i, column) in names.iter().enumerate() {
        match column.as_str() {
            "frame" | "time_s" => {
                columns[i] = if column == "frame" { Column::Frame } else { Column::Time };
                if names[..i].iter().any(|other| other == column) {
                    twice = Some(column);
                }
            }
            column => {
                let Some((name, part)) = part(column) else { continue };
                if !entries.contains_key(name) {
                    order.push(name);
                }
                let entry = entries.entry(name).or_default();
                let is_taken = match part {
                    Part::Position(axis, unit) => entry.position[axis].replace((i, unit)).is_some(),
                    Part::Quaternion(component) => entry.quaternion[component].replace(i).is_some(),
                    Part::Angle(angle, unit) => entry.angles[angle].replace((i, unit)).is_some(),
                };
                if is_taken {
                    twice = Some(column);
                }
            }
        }
    }
    if let Some(column) = twice {
        let found = format!("more than one column for the same as `{column}`");
        return Err(FileProblem::in_line(1, found, "one column for each coordinate"));
    }
    let mut labels = Vec::new();
    let mut bodies = Vec::new();
    let mut unit: Option<LengthUnit> = None;
    for name in order {
        let Entry { position, quaternion, angles } = entries[name];
        let has_rotation =
            quaternion.iter().any(Option::is_some) || angles.iter().any(Option::is_some);
        let [Some(x), Some(y), Some(z)] = position else {
            if has_rotation {
                let found = format!("a rotation of `{name}` without its position");
                let needed = format!("`{name}_x_mm`, `{name}_y_mm`, `{name}_z_mm`");
                return Err(FileProblem::in_line(1, found, needed));
            }
            continue;
        };
        let first = labels.len() as u32;
        for (axis, (column, own)) in [x, y, z].into_iter().enumerate() {
            columns[column] = Column::Axis(first, axis as u8);
            if let Some(other) = unit.replace(own).filter(|other| *other != own) {
                let found = format!("positions of `{name}` in {own} beside others in {other}");
                return Err(FileProblem::in_line(1, found, "one unit for all positions"));
            }
        }
        let rotation = match (quaternion, angles) {
            ([Some(w), Some(x), Some(y), Some(z)], _) => {
                Some((vec![w, x, y, z], Rotation::Quaternion))
            }
            (_, [Some((yaw, unit_rad)), Some((pitch, unit2)), Some((roll, unit3))])
                if unit_rad == unit2 && unit_rad == unit3 =>
            {
                Some((vec![yaw, pitch, roll], Rotation::Euler { order: [2, 1, 0], unit_rad }))
            }
            _ if has_rotation => {
                let found = format!("only a part of the rotation of `{name}`");
                let needed = format!(
                    "`{name}_qw`, `{name}_qx`, `{name}_qy`, `{name}_qz`, or `{name}_roll_deg`, `{name}_pitch_deg`, \
                     `{name}_yaw_deg`"
                );
                return Err(FileProblem::in_line(1, found, needed));
            }
            _ => None,
        };
        let Some((components, rotation)) = rotation else {
            labels.push(name.to_owned());
            continue;
        };
        for (component, column) in components.into_iter().enumerate() {
            columns[column] = Column::Rotation(first, component as u8);
        }
        bodies.push((first, rotation));
        labels.extend((0..body::POINTS).map(|point| body::point_label(name, point)));
    }
    let Some(unit) = unit else {
        return Err(FileProblem::in_line(1, "a table without positions", NEEDED));
    };
    Ok(Header {
        system: System::Table,
        dialect,
        rate_hz: None,
        unit,
        labels,
        columns,
        bodies,
        line: 1,
        body: lines,
        frames: None,
        doubts: Vec::new(),
    })
}

/// Returns the frame numbers, and the frame rate, Hz, of rows with these times.
///
/// # Errors
/// Returns an error if a time is missing or not later than the one before, or if the times are not multiples of a frame
/// interval.
pub(super) fn frames_of_times(times_s: &[f64]) -> Result<(Vec<i64>, Option<f64>), FileProblem> {
    /// Maximum deviation of a time between two rows from a multiple of the frame interval, in intervals.
    const MAX_JITTER: f64 = 0.3;
    let row_of = |index: usize| format!("row {} below the header", index + 1);
    let mut intervals_s = Vec::with_capacity(times_s.len());
    for (i, pair) in times_s.windows(2).enumerate() {
        let interval_s = pair[1] - pair[0];
        if interval_s.is_nan() || interval_s <= 0.0 {
            let found = format!("time {} s after {} s in {}", pair[1], pair[0], row_of(i + 1));
            return Err(FileProblem::new(found, "a later time in every row, or a column `frame`"));
        }
        intervals_s.push(interval_s);
    }
    let mut sorted = intervals_s.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    let Some(&usual_s) = sorted.get(sorted.len() / 2) else {
        return Ok((vec![1; times_s.len()], None));
    };
    // Unlike the median, the mean over the intervals of a single frame is not affected by the rounding of the times.
    sorted.retain(|interval_s| (0.6..1.4).contains(&(interval_s / usual_s)));
    let interval_s = sorted.iter().sum::<f64>() / sorted.len() as f64;
    let mut frames = vec![1];
    for (i, ratio) in intervals_s.iter().map(|own_s| own_s / interval_s).enumerate() {
        let steps = ratio.round();
        if (ratio - steps).abs() > MAX_JITTER || !(1.0..=1e9).contains(&steps) {
            let found = format!(
                "{} s from the time before in {}, {ratio:.2} times the usual {interval_s} s",
                intervals_s[i],
                row_of(i + 1)
            );
            let needed =
                "times at a constant frame rate: resample the table, or add a column `frame`";
            return Err(FileProblem::new(found, needed));
        }
        frames.push(frames[i] + steps as i64);
    }
    let rate_hz = rate_hz(&frames, times_s);
    Ok((frames, rate_hz))
}

/// Returns the frame rate of rows with these frame numbers and times, Hz, to a thousandth; `None` if the times do not
/// give it.
pub(super) fn rate_hz(frames: &[i64], times_s: &[f64]) -> Option<f64> {
    let timed = || frames.iter().zip(times_s).filter(|(_, time_s)| time_s.is_finite());
    let ((first, from_s), (last, to_s)) = (timed().next()?, timed().next_back()?);
    let rate_hz = (last - first) as f64 / (to_s - from_s);
    (rate_hz.is_finite() && rate_hz > 0.0).then(|| (1e3 * rate_hz).round() / 1e3)
}

/// Returns the content of a Parquet file as the text of a CSV file; columns without numbers are left out.
pub(super) fn text_of_parquet(content: &[u8]) -> Result<Vec<u8>, FileProblem> {
    let damaged = || FileProblem::new("a damaged Parquet file", "a complete copy of the file");
    let mut reader = ParquetReader::new(Cursor::new(content)).read_parallel(ParallelStrategy::None);
    let mut read = || -> PolarsResult<Option<DataFrame>> {
        let cells = reader.get_metadata()?.num_rows.saturating_mul(reader.schema()?.len());
        let reader = ParquetReader::new(Cursor::new(content));
        let is_small = cells <= MAX_CELLS;
        is_small.then(|| reader.read_parallel(ParallelStrategy::None).finish()).transpose()
    };
    // A damaged file can make the reader panic.
    let frame = catch_unwind(AssertUnwindSafe(&mut read)).map_err(|_| damaged())?;
    let Some(frame) = frame.map_err(|_| damaged())? else {
        let found = format!("a Parquet file with more than {MAX_CELLS} values");
        return Err(FileProblem::new(found, "a smaller file"));
    };
    let mut names = Vec::new();
    let mut columns: Vec<Vec<Option<f64>>> = Vec::new();
    for column in frame.columns() {
        let name = column.name().as_str();
        let is_plain = !name.contains([',', ';', '\t', '\n', '\r', '"']);
        let numbers = column
            .cast(&DataType::Float64)
            .ok()
            .filter(|_| is_plain && (column.dtype().is_primitive_numeric()));
        let Some(numbers) = numbers else { continue };
        let numbers =
            numbers.as_materialized_series().f64().map_err(|_| damaged())?.iter().collect();
        names.push(name);
        columns.push(numbers);
    }
    let mut text = names.join(",");
    text.push('\n');
    for row in 0..frame.height() {
        for (i, column) in columns.iter().enumerate() {
            if i > 0 {
                text.push(',');
            }
            if let Some(x) = column[row].filter(|x| x.is_finite()) {
                write!(text, "{x}").expect("memory");
            }
        }
        text.push('\n');
    }
    Ok(text.into_bytes())
}
