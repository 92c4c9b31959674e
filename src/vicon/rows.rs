//! The numbers of the markers' table.

use std::path::Path;

use super::cells::{Dialect, bare, plain_decimal, shown};
use super::header::{self, Column, Header};
use super::markers::{LARGEST_MM, MISSING};
use super::{MarkerFile, ViconError};

/// Largest frame number that is believed, so that differences of two cannot overflow.
const LARGEST_FRAME: f64 = 1e12;

/// Parses the rows below a header up to the next section or the end of the text.
pub(super) fn parse(
    path: &Path,
    text: &[u8],
    header: Header<'_>,
) -> Result<MarkerFile, ViconError> {
    let dialect = header.dialect;
    let markers = header.labels.len();
    let mut frames: Vec<i64> = Vec::new();
    let mut positions_mm: Vec<[f64; 3]> = Vec::new();
    let mut rows_without_frame = 0;
    let mut after_blank = false;
    let mut lines = header.body.clone();
    while let Some((line, row)) = lines.next() {
        if dialect.is_blank(row) {
            after_blank = true;
            continue;
        }
        if is_next_title(dialect, row, after_blank) {
            let rest = [(line, row)].into_iter().chain(lines);
            if let Some(line) = header::title_line(dialect, rest) {
                return Err(ViconError::TwoSections { path: path.to_owned(), line });
            }
            break;
        }
        after_blank = false;
        let at = RowOf { path, line, header: &header };
        let Some(frame) = at.frame(row)? else {
            rows_without_frame += 1;
            continue;
        };
        if let Some(&previous) = frames.last()
            && frame <= previous
        {
            return Err(ViconError::FrameOrder {
                path: path.to_owned(),
                line,
                found: frame,
                previous,
            });
        }
        frames.push(frame);
        if at.is_cut(row, text) {
            let (found, needed) = (dialect.count(row), header.columns.len());
            return Err(ViconError::Cut { path: path.to_owned(), line, found, needed });
        }
        let start = positions_mm.len();
        // A full row has a byte per cell, so this many cells mean that rows are cut short;
        // a crafted file could otherwise ask for far more memory than its own size.
        if (start + markers) * 3 > text.len() {
            return Err(ViconError::ShortRows { path: path.to_owned(), line, markers });
        }
        positions_mm.resize(start + markers, MISSING);
        at.positions(row, &mut positions_mm[start..])?;
    }
    if frames.is_empty() {
        let (path, line) = (path.to_owned(), header.line);
        return Err(match rows_without_frame {
            0 => ViconError::NoRows { path, line },
            rows => ViconError::NoFrameNumbers { path, line, rows },
        });
    }
    let Header { rate_hz, labels, .. } = header;
    Ok(MarkerFile { rate_hz, frames, labels, rows_without_frame, positions_mm })
}

/// A title is a lone text cell; without a blank row above it could be damage, so then only the
/// names that the camera system writes are believed.
fn is_next_title(dialect: Dialect, row: &[u8], after_blank: bool) -> bool {
    const NAMES: [&[u8]; 7] = [
        b"Devices",
        b"Events",
        b"Joints",
        b"Model Outputs",
        b"Segments",
        b"Trajectories",
        b"Trajectory Count",
    ];
    dialect.lone_cell(row).is_some_and(|cell| {
        let named = NAMES.iter().any(|name| name.eq_ignore_ascii_case(cell));
        named || after_blank && dialect.number(cell).is_none()
    })
}

/// One row of a file, to be read and to be named in errors.
struct RowOf<'a> {
    path: &'a Path,
    line: usize,
    header: &'a Header<'a>,
}

impl RowOf<'_> {
    /// Whether the file ends in the middle of this row: it has neither all its cells nor a line
    /// end. Exports without a line end after the last full row are common.
    fn is_cut(&self, row: &[u8], text: &[u8]) -> bool {
        row.as_ptr_range().end == text.as_ptr_range().end
            && self.header.dialect.count(row) < self.header.columns.len()
    }

    /// The row's frame number; `None` if the cell is empty.
    fn frame(&self, row: &[u8]) -> Result<Option<i64>, ViconError> {
        let dialect = self.header.dialect;
        let cell = dialect.first_cell(row);
        if cell.is_empty() {
            return Ok(None);
        }
        match dialect.number(cell) {
            Some(frame) if frame.fract() == 0.0 && frame.abs() <= LARGEST_FRAME => {
                Ok(Some(frame as i64))
            }
            _ => Err(self.not_a_number(0, cell, "a whole frame number")),
        }
    }

    /// Fills in what the row has. Cells that are empty or cut off stay missing, and a marker
    /// of which only some coordinates are there is missing as a whole.
    fn positions(&self, row: &[u8], positions_mm: &mut [[f64; 3]]) -> Result<(), ViconError> {
        let mut rest = row;
        for (i, column) in self.header.columns.iter().enumerate() {
            if let &Column::Axis { marker, axis } = column {
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
        Ok(())
    }

    /// The number at the start of `rest` (NaN for an empty cell) and the length of its cell.
    #[inline]
    fn cell(&self, column: usize, rest: &[u8]) -> Result<(f64, usize), ViconError> {
        let dialect = self.header.dialect;
        let ends = |at: usize| rest.get(at).is_none_or(|&byte| byte == dialect.separator);
        if ends(0) {
            return Ok((f64::NAN, 0));
        }
        let number =
            plain_decimal(rest).filter(|(value, at)| value.abs() <= LARGEST_MM && ends(*at));
        if let Some(number) = number {
            return Ok(number);
        }
        let end = dialect.cell_end(rest);
        let cell = bare(&rest[..end]);
        if cell.is_empty() {
            return Ok((f64::NAN, end));
        }
        let value = dialect.number(cell).filter(|value| value.abs() <= LARGEST_MM);
        value
            .map(|value| (value, end))
            .ok_or_else(|| self.not_a_number(column, cell, "a number of mm or an empty cell"))
    }

    #[cold]
    fn not_a_number(&self, column: usize, cell: &[u8], needed: &'static str) -> ViconError {
        let name = match self.header.columns[column] {
            Column::Axis { marker, axis } => {
                let label = &self.header.labels[marker as usize];
                format!("{label} {}", ["X", "Y", "Z"][usize::from(axis)])
            }
            _ => "Frame".to_owned(),
        };
        ViconError::NotANumber {
            path: self.path.to_owned(),
            line: self.line,
            column: column + 1,
            name,
            found: shown(cell),
            needed,
        }
    }
}
