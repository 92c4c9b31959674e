//! Tables with aligned columns on standard output.

use console::measure_text_width;

use super::output::say;

/// Space between columns.
const GAP: &str = "  ";

/// Table of rows, built column by column.
pub(super) struct Table<'r, R> {
    rows: &'r [R],
    columns: Vec<Column>,
}

/// Column of a table: heading and cells.
struct Column {
    cells: Vec<String>,
    width: usize,
    /// Whether the cells are aligned to the right.
    is_right: bool,
}

impl<'r, R> Table<'r, R> {
    /// Creates a table without columns.
    pub(super) fn new(rows: &'r [R]) -> Self {
        Self { rows, columns: Vec::new() }
    }

    /// Adds a left-aligned column, for text.
    pub(super) fn left(self, name: &str, cell: impl Fn(&R) -> String) -> Self {
        self.column(name, false, cell)
    }

    /// Adds a right-aligned column, for numbers.
    pub(super) fn right(self, name: &str, cell: impl Fn(&R) -> String) -> Self {
        self.column(name, true, cell)
    }

    /// Adds a column with the given alignment.
    pub(super) fn column(
        mut self,
        name: &str,
        is_right: bool,
        cell: impl Fn(&R) -> String,
    ) -> Self {
        let cells = std::iter::once(name.to_owned()).chain(self.rows.iter().map(cell));
        let cells: Vec<String> = cells.collect();
        let width = cells.iter().map(|cell| measure_text_width(cell)).max().unwrap_or(0);
        self.columns.push(Column { cells, width, is_right });
        self
    }

    /// Prints the table.
    pub(super) fn print(&self) {
        self.print_fitting(None);
    }

    /// Prints the columns that fit into `width` characters, or all columns if `width` is `None`; returns the number of
    /// columns left out.
    pub(super) fn print_fitting(&self, width: Option<usize>) -> usize {
        let widths: Vec<usize> = self.columns.iter().map(|column| column.width).collect();
        let fitting = fitting(&widths, width);
        for line in 0..=self.rows.len() {
            let cells = self.columns.iter().take(fitting).map(|column| {
                let cell = &column.cells[line];
                let space = " ".repeat(column.width - measure_text_width(cell));
                if column.is_right { space + cell } else { cell.clone() + &space }
            });
            say!("{}", cells.collect::<Vec<_>>().join(GAP).trim_end());
        }
        self.columns.len() - fitting
    }
}

/// Returns how many columns of these widths fit into `width` characters, at least one; all columns if `width` is
/// `None`.
fn fitting(widths: &[usize], width: Option<usize>) -> usize {
    let Some(max_width) = width else { return widths.len() };
    let mut end = 0;
    let fitting = widths.iter().take_while(|width| {
        end += **width + if end == 0 { 0 } else { GAP.len() };
        end <= max_width
    });
    fitting.count().max(1)
}

/// Returns the width of the terminal in characters, or `None` if standard output is not a terminal.
pub(super) fn terminal_width() -> Option<usize> {
    let terminal = console::Term::stdout();
    terminal.is_term().then(|| usize::from(terminal.size().1))
}

/// Formats a number with at most six significant digits and no trailing zeros.
pub(super) fn short(number: f64) -> String {
    if number == 0.0 || !number.is_finite() {
        return number.to_string();
    }
    // Rounding comes before the choice of the notation, because it may add a digit: 999999.7.
    let rounded: f64 = format!("{number:.5e}").parse().unwrap_or(number);
    if (1e-4..1e15).contains(&rounded.abs()) { rounded.to_string() } else { format!("{rounded:e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_numbers_have_at_most_six_digits() {
        for (number, expected) in [
            (0.43712345678, "0.437123"),
            (3.9, "3.9"),
            (1234567.8, "1234570"),
            (-0.00001234, "-1.234e-5"),
            (0.0, "0"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(short(number), expected);
        }
    }

    #[test]
    fn the_columns_that_fit_are_shown_and_at_least_one() {
        for (width, expected) in [(None, 3), (Some(14), 3), (Some(13), 2), (Some(3), 1)] {
            assert_eq!(fitting(&[4, 4, 2], width), expected);
        }
    }
}
