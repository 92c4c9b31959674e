//! Parses the rows of the marker table.

use trilink_base::body;

use super::cells::{Dialect, plain_decimal, shown, trimmed};
use super::header::{self, Column, Header, SECTIONS};
use super::markers::{MAX_MM, MISSING};
use super::rotation::Rotation;
use super::systems::System;
use super::{FileProblem, Recording, decimals, table, vertical};
use crate::LengthUnit;

/// Maximum plausible frame number; with larger ones, differences could overflow.
const MAX_FRAME: f64 = 1e12;

/// Parses the marker table up to the next section or the end of the text; `unit` applies to a table that does not state
/// a unit.
pub(super) fn parse(text: &[u8], unit: LengthUnit) -> Result<Recording, FileProblem> {
    let header = header::find(text, unit)?;
    let dialect = header.dialect;
    let markers = header.labels.len();
    // Number of rows up to the next section: memory is allocated once, so that a long recording need not be copied to
    // grow.
    let is_blank = |(_, cells): &(usize, &[u8])| dialect.is_blank(cells);
    let rows = header.body.clone().skip_while(is_blank).take_while(|row| !is_blank(row)).count();
    let is_read = |column: &&Column| matches!(column, Column::Axis(..) | Column::Rotation(..));
    let cells_read = header.columns.iter().filter(is_read).count();
    let rows = rows.min(text.len() / cells_read.max(1));
    let mut frames: Vec<i64> = Vec::with_capacity(rows);
    let mut positions_mm: Vec<[f64; 3]> = Vec::with_capacity(rows * markers);
    let mut rows_without_frame = 0;
    let mut rows_too_long = 0;
    let mut incomplete = vec![0; markers];
    // The column of frame numbers is the first, except in tables of other programs.
    let frame_column = header.columns.iter().position(|column| *column == Column::Frame);
    let has_frame_numbers = frame_column.is_some();
    let time_column = header.columns.iter().position(|column| *column == Column::Time);
    let time_column = time_column.filter(|_| header.system == System::Table);
    let mut times_s = Vec::new();
    // First and last row of the table.
    let mut ends: Option<(&[u8], &[u8])> = None;
    let mut after_blank = false;
    let mut lines = header.body.clone();
    while let Some((line, cells)) = lines.next() {
        // Without a column of frame numbers, a row of empty cells is a frame in which no marker is visible.
        let is_frame = !has_frame_numbers && cells.contains(&dialect.separator);
        if dialect.is_blank(cells) && !is_frame {
            after_blank = true;
            continue;
        }
        if header.system == System::Vicon && is_next_title(dialect, cells, after_blank) {
            let rest = [(line, cells)].into_iter().chain(lines);
            let section = SECTIONS[usize::from(!header.bodies.is_empty())];
            if let Some(line) = header::title_line(dialect, section, rest) {
                let found = format!("a second `{section}` section");
                return Err(FileProblem::in_line(line, found, "only one"));
            }
            break;
        }
        after_blank = false;
        let row = Row { line, cells, header: &header };
        let frame = match frame_column {
            Some(column) => row.frame(column)?,
            None => Some(frames.len() as i64 + 1),
        };
        let Some(frame) = frame else {
            rows_without_frame += 1;
            continue;
        };
        if let Some(&previous) = frames.last().filter(|&&previous| frame <= previous) {
            let found = format!("frame {frame} after frame {previous}");
            return Err(FileProblem::in_line(line, found, "a larger frame number"));
        }
        frames.push(frame);
        if let Some(column) = time_column {
            let cell = dialect.cells(cells).nth(column).unwrap_or_default();
            times_s.push(dialect.number(cell).unwrap_or(f64::NAN));
        }
        if row.is_cut(text) {
            let found =
                format!("the end of the file after {} cells of a row", dialect.count(cells));
            let needed =
                format!("{} cells; is the copy of the file complete?", header.columns.len());
            return Err(FileProblem::in_line(line, found, needed));
        }
        let start = positions_mm.len();
        // A full row has at least one byte per cell, so a larger number of cells means that rows are cut short.
        // Otherwise a crafted file could request far more memory than its own size.
        if frames.len() * cells_read > text.len() {
            let found = format!("rows much too short for the {markers} markers of the header");
            return Err(FileProblem::in_line(line, found, "one cell for each axis of each marker"));
        }
        ends = Some((ends.map_or(cells, |(first, _)| first), cells));
        positions_mm.resize(start + markers, MISSING);
        let rest = row.positions(&mut positions_mm[start..], &mut incomplete)?;
        rows_too_long += usize::from(!dialect.is_blank(rest));
    }
    if let Some((first, last)) = ends {
        if rows_too_long == frames.len() {
            check_commas(&header, last)?;
        }
        check_times(&header, [first, last], &frames)?;
    }
    let Header { system, mut rate_hz, labels, line, mut doubts, .. } = header;
    if frames.is_empty() {
        return Err(if rows_without_frame == 0 {
            FileProblem::new(format!("no row of numbers below line {line}"), "at least one frame")
        } else {
            let found =
                format!("{rows_without_frame} rows below line {line}, all without a frame number");
            FileProblem::new(found, "at least one row with a frame number")
        });
    }
    if time_column.is_some() {
        if has_frame_numbers {
            rate_hz = table::rate_hz(&frames, &times_s);
        } else {
            (frames, rate_hz) = table::frames_of_times(&times_s)?;
        }
    }
    let count = frames.len();
    if let Some((stated, place)) = header.frames.filter(|(stated, _)| *stated != count) {
        doubts.push(format!("frames: found {stated} ({place}) and {count} (rows), used {count}"));
    }
    let mut file = Recording {
        rate_hz,
        frames,
        labels,
        rows_without_frame,
        rows_too_long,
        incomplete,
        doubts,
        positions_mm,
    };
    decimals::check(&file)?;
    if let Some(axis) = system.usual_up_axis() {
        vertical::turn_z_up(&mut file, axis);
    }
    Ok(file)
}

/// Checks that the numbers have no decimal commas if cells are separated by commas, too: each would take up two cells.
fn check_commas(header: &Header, row: &[u8]) -> Result<(), FileProblem> {
    let (cells, columns) = (header.dialect.count(row), header.columns.len());
    if header.dialect.separator != b',' || 2 * cells <= 3 * columns {
        return Ok(());
    }
    let found = format!("rows of {cells} cells below a header of {columns}");
    let needed = "decimal points: decimal commas cannot be told from the commas between cells; export the file again";
    Err(FileProblem::in_line(header.line, found, needed))
}

/// Checks that the times in the first and the last row of a table, if it has a column of times, match the frame rate.
fn check_times(header: &Header, rows: [&[u8]; 2], frames: &[i64]) -> Result<(), FileProblem> {
    /// Maximum relative difference between two rates that count as equal.
    const TOLERANCE: f64 = 1e-4;
    let Header { dialect, columns, rate_hz: Some(rate_hz), .. } = header else { return Ok(()) };
    let Some(column) = columns.iter().position(|column| *column == Column::Time) else {
        return Ok(());
    };
    let time_s = |row| dialect.number(dialect.cells(row).nth(column)?);
    let (Some(first_s), Some(last_s), [first, .., last]) =
        (time_s(rows[0]), time_s(rows[1]), frames)
    else {
        return Ok(());
    };
    let duration_s = last_s - first_s;
    let intervals = (last - first) as f64;
    // Times are rounded.
    if (duration_s * rate_hz - intervals).abs() <= 0.5 + TOLERANCE * intervals {
        return Ok(());
    }
    let found = format!(
        "contradictory frame rates, Hz: {rate_hz} (header) and {:.6} (times of the first and the last frame)",
        intervals / duration_s
    );
    let needed = "one frame rate, because it is unknown which is correct; export the file again";
    Err(FileProblem::new(found, needed))
}

/// Returns whether a row is the title of the next section: a row whose only cell is text. After a blank row, any text
/// is accepted; otherwise only titles that the camera system writes, because the row may be a damaged row of data.
fn is_next_title(dialect: Dialect, row: &[u8], after_blank: bool) -> bool {
    const NAMES: &str =
        "devices,events,joints,model outputs,segments,trajectories,trajectory count";
    dialect.lone_cell(row).is_some_and(|cell| {
        let named = NAMES.split(',').any(|name| cell.eq_ignore_ascii_case(name.as_bytes()));
        named || after_blank && dialect.number(cell).is_none()
    })
}

/// Row of the marker table.
struct Row<'a> {
    line: usize,
    cells: &'a [u8],
    header: &'a Header<'a>,
}

impl Row<'_> {
    /// Returns whether the file ends in the middle of this row, so that the row lacks cells and a line end. Exports
    /// whose last row is complete but lacks a line end are common.
    fn is_cut(&self, text: &[u8]) -> bool {
        self.cells.as_ptr_range().end == text.as_ptr_range().end
            && self.header.dialect.count(self.cells) < self.header.columns.len()
    }

    /// Parses the frame number in the row; `None` if the cell is empty.
    fn frame(&self, column: usize) -> Result<Option<i64>, FileProblem> {
        let dialect = self.header.dialect;
        let cell = match column {
            0 => dialect.first_cell(self.cells),
            _ => dialect.cells(self.cells).nth(column).unwrap_or_default(),
        };
        if cell.is_empty() {
            return Ok(None);
        }
        dialect
            .number(cell)
            .filter(|frame| frame.fract() == 0.0 && frame.abs() <= MAX_FRAME)
            .map(|frame| Some(frame as i64))
            .ok_or_else(|| self.not_a_number(column, cell, "a whole frame number".to_owned()))
    }

    /// Stores the positions in the row and returns the cells beyond the table's columns. Empty cells and cells that are
    /// cut off are missing values; a marker or body that lacks any of its numbers is missing as a whole and, if it has
    /// others, counted as incomplete.
    fn positions(
        &self,
        positions_mm: &mut [[f64; 3]],
        incomplete: &mut [usize],
    ) -> Result<&[u8], FileProblem> {
        let mut rest = self.cells;
        let mm = self.header.unit.mm();
        for (i, column) in self.header.columns.iter().enumerate() {
            let target = match *column {
                Column::Axis(marker, axis) => Some((marker as usize, axis, mm)),
                Column::Rotation(body, part) => {
                    Some((body as usize + 1 + usize::from(part / 3), part % 3, 1.0))
                }
                _ => None,
            };
            let length = if let Some((point, axis, unit)) = target {
                let (value, length) = self.cell(i, rest, unit)?;
                positions_mm[point][usize::from(axis)] = value;
                length
            } else {
                self.header.dialect.cell_end(rest)
            };
            rest = &rest[length..];
            match rest.split_first() {
                Some((_, after)) => rest = after,
                None => break,
            }
        }
        for &(first, rotation) in &self.header.bodies {
            let first = first as usize;
            let is_incomplete = self.pose(rotation, first, &mut positions_mm[first..])?;
            incomplete[first] += usize::from(is_incomplete);
        }
        // Qualisys writes zeros for an occluded marker.
        let zeros_are_missing = self.header.system == System::Qualisys;
        for (position, incomplete) in positions_mm.iter_mut().zip(incomplete) {
            if position.iter().any(|x| x.is_nan()) {
                *incomplete += usize::from(position.iter().any(|x| !x.is_nan()));
                *position = MISSING;
            } else if zeros_are_missing && *position == [0.0; 3] {
                *position = MISSING;
            }
        }
        Ok(rest)
    }

    /// Replaces the pose of a rigid body, its position and the components of its rotation, by the positions of the
    /// body's points; three NaN each if a part of the pose is missing. `first` is the index of the body's first label.
    /// Returns whether the row has only a part of the pose.
    fn pose(
        &self,
        rotation: Rotation,
        first: usize,
        positions_mm: &mut [[f64; 3]],
    ) -> Result<bool, FileProblem> {
        let Some((points, _)) = positions_mm.split_first_chunk_mut::<{ body::POINTS }>() else {
            return Ok(false);
        };
        let [origin_mm, rows @ ..] = *points;
        let mut components = [0.0; 9];
        components.copy_from_slice(rows.as_flattened());
        let needed = &components[..rotation.components()];
        let mut numbers = origin_mm.iter().chain(needed);
        // Systems write zeros for a body that they did not find; no measured position is exactly zero.
        let is_untracked = origin_mm == [0.0; 3];
        if is_untracked || numbers.clone().any(|x| x.is_nan()) {
            *points = [MISSING; body::POINTS];
            return Ok(!is_untracked && numbers.any(|x| !x.is_nan()));
        }
        let Some(axes) = rotation.axes(&components) else {
            let found = format!(
                "{} of `{}` that are not those of a rotation: {needed:?}",
                if rotation == Rotation::Quaternion { "components" } else { "matrix elements" },
                body::name(&self.header.labels[first])
            );
            let needed = "a unit quaternion or an orthonormal matrix of a right-handed frame";
            return Err(FileProblem::in_line(self.line, found, needed));
        };
        *points = body::points(origin_mm, &axes);
        Ok(false)
    }

    /// Parses the number at the start of `rest` and multiplies it by `unit` (NaN for an empty cell). Also returns the
    /// length of the cell.
    #[inline]
    fn cell(&self, column: usize, rest: &[u8], unit: f64) -> Result<(f64, usize), FileProblem> {
        let dialect = self.header.dialect;
        let ends = |at: usize| rest.get(at).is_none_or(|&byte| byte == dialect.separator);
        if ends(0) {
            return Ok((f64::NAN, 0));
        }
        let is_plausible = |value: &f64| value.abs() <= MAX_MM;
        let plain = plain_decimal(rest).map(|(value, at)| (value * unit, at));
        if let Some(number) = plain.filter(|(value, at)| is_plausible(value) && ends(*at)) {
            return Ok(number);
        }
        let end = dialect.cell_end(rest);
        let cell = trimmed(&rest[..end]);
        let value = if cell.is_empty() || self.is_missing(cell) {
            Some(f64::NAN)
        } else {
            dialect.number(cell).map(|value| value * unit).filter(is_plausible)
        };
        let value = value.ok_or_else(|| {
            let needed = match self.header.columns[column] {
                Column::Rotation(..) => "a number or an empty cell".to_owned(),
                _ => format!("a number (in {}) or an empty cell", self.header.unit),
            };
            self.not_a_number(column, cell, needed)
        })?;
        Ok((value, end))
    }

    /// Returns whether a text stands for a missing value, as programs other than Vicon's write it.
    #[cold]
    fn is_missing(&self, cell: &[u8]) -> bool {
        let words: [&[u8]; 2] = [b"nan", b"null"];
        self.header.system != System::Vicon
            && words.iter().any(|word| cell.eq_ignore_ascii_case(word))
    }

    #[cold]
    fn not_a_number(&self, column: usize, cell: &[u8], needed: String) -> FileProblem {
        let Header { columns, labels, .. } = self.header;
        let name = match columns[column] {
            Column::Axis(marker, axis) => {
                let axis = ["X", "Y", "Z"][usize::from(axis)];
                format!("{} {axis}", body::name(&labels[marker as usize]))
            }
            Column::Rotation(first, _) => {
                format!("rotation of {}", body::name(&labels[first as usize]))
            }
            _ => "Frame".to_owned(),
        };
        let place = format!(", line {}, column {} ({name})", self.line, column + 1);
        let found = format!("`{}`", shown(cell));
        FileProblem::Content { place, found, needed }
    }
}
