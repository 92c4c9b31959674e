//! Parses the rows of the marker table.

use super::cells::{Dialect, plain_decimal, shown, trimmed};
use super::header::{self, Column, Header};
use super::markers::{MAX_MM, MISSING};
use super::{FileProblem, Recording, decimals};
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
    let rows = header.body.clone().take_while(|(_, cells)| !dialect.is_blank(cells)).count();
    let rows = rows.min(text.len() / (3 * markers.max(1)));
    let mut frames: Vec<i64> = Vec::with_capacity(rows);
    let mut positions_mm: Vec<[f64; 3]> = Vec::with_capacity(rows * markers);
    let mut rows_without_frame = 0;
    let mut rows_too_long = 0;
    let mut after_blank = false;
    let mut lines = header.body.clone();
    while let Some((line, cells)) = lines.next() {
        if dialect.is_blank(cells) {
            after_blank = true;
            continue;
        }
        if is_next_title(dialect, cells, after_blank) {
            let rest = [(line, cells)].into_iter().chain(lines);
            if let Some(line) = header::title_line(dialect, rest) {
                return Err(FileProblem::in_line(
                    line,
                    "a second `Trajectories` section",
                    "only one",
                ));
            }
            break;
        }
        after_blank = false;
        let row = Row { line, cells, header: &header };
        let Some(frame) = row.frame()? else {
            rows_without_frame += 1;
            continue;
        };
        if let Some(&previous) = frames.last().filter(|&&previous| frame <= previous) {
            let found = format!("frame {frame} after frame {previous}");
            return Err(FileProblem::in_line(line, found, "a larger frame number"));
        }
        frames.push(frame);
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
        if (start + markers) * 3 > text.len() {
            let found = format!("rows much too short for the {markers} markers of the header");
            return Err(FileProblem::in_line(line, found, "one cell for each axis of each marker"));
        }
        positions_mm.resize(start + markers, MISSING);
        let rest = row.positions(&mut positions_mm[start..])?;
        rows_too_long += usize::from(!dialect.is_blank(rest));
    }
    let Header { rate_hz, labels, line, .. } = header;
    if frames.is_empty() {
        return Err(if rows_without_frame == 0 {
            FileProblem::new(format!("no row of numbers below line {line}"), "at least one frame")
        } else {
            let found =
                format!("{rows_without_frame} rows below line {line}, all without a frame number");
            FileProblem::new(found, "at least one row with a frame number")
        });
    }
    let file = Recording {
        rate_hz,
        frames,
        labels,
        rows_without_frame,
        rows_too_long,
        doubts: Vec::new(),
        positions_mm,
    };
    decimals::check(&file)?;
    Ok(file)
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
    fn frame(&self) -> Result<Option<i64>, FileProblem> {
        let dialect = self.header.dialect;
        let cell = dialect.first_cell(self.cells);
        if cell.is_empty() {
            return Ok(None);
        }
        dialect
            .number(cell)
            .filter(|frame| frame.fract() == 0.0 && frame.abs() <= MAX_FRAME)
            .map(|frame| Some(frame as i64))
            .ok_or_else(|| self.not_a_number(0, cell, "a whole frame number".to_owned()))
    }

    /// Stores the positions in the row and returns the cells beyond the table's columns. Empty cells and cells that are
    /// cut off are missing values; a marker that lacks any coordinate is missing as a whole.
    fn positions(&self, positions_mm: &mut [[f64; 3]]) -> Result<&[u8], FileProblem> {
        let mut rest = self.cells;
        for (i, column) in self.header.columns.iter().enumerate() {
            if let &Column::Axis(marker, axis) = column {
                let (value, length) = self.cell(i, rest)?;
                positions_mm[marker as usize][usize::from(axis)] = value;
                rest = &rest[length..];
            } else {
                rest = &rest[self.header.dialect.cell_end(rest)..];
            }
            match rest.split_first() {
                Some((_, after)) => rest = after,
                None => break,
            }
        }
        for position in positions_mm {
            if position.iter().any(|x| x.is_nan()) {
                *position = MISSING;
            }
        }
        Ok(rest)
    }

    /// Parses the number at the start of `rest`, mm (NaN for an empty cell). Also returns the length of the cell.
    #[inline]
    fn cell(&self, column: usize, rest: &[u8]) -> Result<(f64, usize), FileProblem> {
        let dialect = self.header.dialect;
        let ends = |at: usize| rest.get(at).is_none_or(|&byte| byte == dialect.separator);
        if ends(0) {
            return Ok((f64::NAN, 0));
        }
        let mm = self.header.unit.mm();
        let is_plausible = |value: &f64| value.abs() <= MAX_MM;
        let plain = plain_decimal(rest).map(|(value, at)| (value * mm, at));
        if let Some(number) = plain.filter(|(value, at)| is_plausible(value) && ends(*at)) {
            return Ok(number);
        }
        let end = dialect.cell_end(rest);
        let cell = trimmed(&rest[..end]);
        let value = if cell.is_empty() {
            Some(f64::NAN)
        } else {
            dialect.number(cell).map(|value| value * mm).filter(is_plausible)
        };
        let value = value.ok_or_else(|| {
            let needed = format!("a number (in {}) or an empty cell", self.header.unit);
            self.not_a_number(column, cell, needed)
        })?;
        Ok((value, end))
    }

    #[cold]
    fn not_a_number(&self, column: usize, cell: &[u8], needed: String) -> FileProblem {
        let Header { columns, labels, .. } = self.header;
        let name = match columns[column] {
            Column::Axis(marker, axis) => {
                format!("{} {}", labels[marker as usize], ["X", "Y", "Z"][usize::from(axis)])
            }
            _ => "Frame".to_owned(),
        };
        let place = format!(", line {}, column {} ({name})", self.line, column + 1);
        let found = format!("`{}`", shown(cell));
        FileProblem::Content { place, found, needed }
    }
}
