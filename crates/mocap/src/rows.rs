//! The numbers of the markers' table.

use super::cells::{Dialect, plain_decimal, shown, trimmed};
use super::header::{self, Column, Header};
use super::markers::{LARGEST_MM, MISSING};
use super::{FileProblem, Recording, decimals};
use crate::LengthUnit;

/// Largest frame number that is believed, so that differences of two cannot overflow.
const LARGEST_FRAME: f64 = 1e12;

/// Parses the markers' table, up to the next section or the end of the text; `unit` is that of a
/// table which does not say its own.
pub(super) fn parse(text: &[u8], unit: LengthUnit) -> Result<Recording, FileProblem> {
    let header = header::find(text, unit)?;
    let dialect = header.dialect;
    let markers = header.labels.len();
    // Up to the next section; a long recording would be copied to have more room. A full row has a byte per cell.
    let rows = header.body.clone().take_while(|(_, cells)| !dialect.is_blank(cells)).count();
    let rows = rows.min(text.len() / (3 * markers.max(1)));
    let mut frames: Vec<i64> = Vec::with_capacity(rows);
    let mut positions_mm: Vec<[f64; 3]> = Vec::with_capacity(rows * markers);
    let (mut rows_without_frame, mut rows_too_long) = (0, 0);
    let mut after_blank = false;
    let mut lines = header.body.clone();
    while let Some((line, cells)) = lines.next() {
        if dialect.is_blank(cells) {
            after_blank = true;
            continue;
        }
        if is_next_title(dialect, cells, after_blank) {
            let rest = [(line, cells)].into_iter().chain(lines);
            match header::title_line(dialect, rest) {
                Some(line) => {
                    return Err(FileProblem::in_line(
                        line,
                        "a second `Trajectories` section",
                        "one",
                    ));
                }
                None => break,
            }
        }
        after_blank = false;
        let row = Row { line, cells, header: &header };
        let Some(frame) = row.frame()? else {
            rows_without_frame += 1;
            continue;
        };
        if let Some(&previous) = frames.last().filter(|&&previous| frame <= previous) {
            let found = format!("frame {frame} after frame {previous}");
            return Err(FileProblem::in_line(line, found, "a larger number"));
        }
        frames.push(frame);
        if row.is_cut(text) {
            let found = format!("the file's end after {} cells of a row", dialect.count(cells));
            let needed = format!("{}; is the copy complete?", header.columns.len());
            return Err(FileProblem::in_line(line, found, needed));
        }
        let start = positions_mm.len();
        // A full row has a byte per cell, so this many cells mean that rows are cut short;
        // a crafted file could otherwise ask for far more memory than its own size.
        if (start + markers) * 3 > text.len() {
            let found = format!("rows much shorter than the {markers} markers of the header");
            return Err(FileProblem::in_line(line, found, "one cell per axis"));
        }
        positions_mm.resize(start + markers, MISSING);
        let rest = row.positions(&mut positions_mm[start..])?;
        rows_too_long += usize::from(!dialect.is_blank(rest));
    }
    let Header { rate_hz, labels, line, .. } = header;
    if frames.is_empty() {
        let unnumbered =
            || format!("{rows_without_frame} rows below line {line} and none with a frame number");
        return Err(match rows_without_frame {
            0 => FileProblem::new(
                format!("no row of numbers below line {line}"),
                "at least one frame",
            ),
            _ => FileProblem::new(unnumbered(), "at least one"),
        });
    }
    let doubts = Vec::new();
    let file = Recording {
        rate_hz,
        frames,
        labels,
        rows_without_frame,
        rows_too_long,
        doubts,
        positions_mm,
    };
    decimals::check(&file)?;
    Ok(file)
}

/// A title is a lone text cell; without a blank row above it could be damage, so then only the
/// names that the camera system writes are believed.
fn is_next_title(dialect: Dialect, row: &[u8], after_blank: bool) -> bool {
    const NAMES: &str =
        "devices,events,joints,model outputs,segments,trajectories,trajectory count";
    dialect.lone_cell(row).is_some_and(|cell| {
        let named = NAMES.split(',').any(|name| cell.eq_ignore_ascii_case(name.as_bytes()));
        named || after_blank && dialect.number(cell).is_none()
    })
}

/// One row of the table.
struct Row<'a> {
    line: usize,
    cells: &'a [u8],
    header: &'a Header<'a>,
}

impl Row<'_> {
    /// Whether the file ends in the middle of this row: it has neither all its cells nor a line
    /// end. Exports without a line end after the last full row are common.
    fn is_cut(&self, text: &[u8]) -> bool {
        self.cells.as_ptr_range().end == text.as_ptr_range().end
            && self.header.dialect.count(self.cells) < self.header.columns.len()
    }

    /// The row's frame number; `None` if the cell is empty.
    fn frame(&self) -> Result<Option<i64>, FileProblem> {
        let dialect = self.header.dialect;
        let cell = dialect.first_cell(self.cells);
        if cell.is_empty() {
            return Ok(None);
        }
        let is_whole = |frame: &f64| frame.fract() == 0.0 && frame.abs() <= LARGEST_FRAME;
        let frame = dialect.number(cell).filter(is_whole).map(|frame| Some(frame as i64));
        frame.ok_or_else(|| self.not_a_number(0, cell, "a whole frame number".to_owned()))
    }

    /// Fills in what the row has, and gives what is beyond its columns. Cells that are empty or cut
    /// off stay missing, and a marker of which only some coordinates are there is missing as a
    /// whole.
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

    /// The number at the start of `rest`, mm (NaN for an empty cell), and the length of its cell.
    #[inline]
    fn cell(&self, column: usize, rest: &[u8]) -> Result<(f64, usize), FileProblem> {
        let dialect = self.header.dialect;
        let ends = |at: usize| rest.get(at).is_none_or(|&byte| byte == dialect.separator);
        if ends(0) {
            return Ok((f64::NAN, 0));
        }
        let mm = self.header.unit.mm();
        let is_near = |value: &f64| value.abs() <= LARGEST_MM;
        let plain = plain_decimal(rest).map(|(value, at)| (value * mm, at));
        if let Some(number) = plain.filter(|(value, at)| is_near(value) && ends(*at)) {
            return Ok(number);
        }
        let end = dialect.cell_end(rest);
        let cell = trimmed(&rest[..end]);
        let number = || dialect.number(cell).map(|value| value * mm);
        let value = if cell.is_empty() { Some(f64::NAN) } else { number().filter(is_near) };
        let needed = || format!("a number of {} or an empty cell", self.header.unit);
        let error = || self.not_a_number(column, cell, needed());
        Ok((value.ok_or_else(error)?, end))
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
