//! Aligned columns on standard output.

use console::measure_text_width;

use super::output::say;

const GAP: &str = "  ";

/// A table of some rows, a column after the other.
pub(super) struct Table<'r, R> {
    rows: &'r [R],
    columns: Vec<Column>,
}

/// A column's heading and cells, and whether these end at its right.
struct Column {
    cells: Vec<String>,
    width: usize,
    is_right: bool,
}

impl<'r, R> Table<'r, R> {
    pub(super) fn of(rows: &'r [R]) -> Self {
        Self { rows, columns: Vec::new() }
    }

    /// Adds a column of text.
    pub(super) fn left(self, name: &str, cell: impl Fn(&R) -> String) -> Self {
        self.column(name, false, cell)
    }

    /// Adds a column of numbers.
    pub(super) fn right(self, name: &str, cell: impl Fn(&R) -> String) -> Self {
        self.column(name, true, cell)
    }

    /// Adds a column whose cells end at its right or not.
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

    /// Prints it.
    pub(super) fn print(&self) {
        self.print_fitting(None);
    }

    /// Prints it, and gives the number of columns at its end that do not fit into `width`.
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

/// How many columns fit, one at least.
fn fitting(widths: &[usize], width: Option<usize>) -> usize {
    let Some(most) = width else { return widths.len() };
    let mut end = 0;
    let fits = |width: &&usize| {
        end += **width + if end == 0 { 0 } else { GAP.len() };
        end <= most
    };
    widths.iter().take_while(fits).count().max(1)
}

/// Columns of the terminal; `None` where results go elsewhere.
pub(super) fn terminal_width() -> Option<usize> {
    let terminal = console::Term::stdout();
    terminal.is_term().then(|| usize::from(terminal.size().1))
}

/// Six significant digits without zeros at the end.
pub(super) fn short(number: f64) -> String {
    if number == 0.0 || !number.is_finite() {
        return number.to_string();
    }
    // As it is rounded: 999999.7 has a digit more than it seems.
    let rounded: f64 = format!("{number:.5e}").parse().unwrap_or(number);
    match (1e-4..1e15).contains(&rounded.abs()) {
        true => rounded.to_string(),
        false => format!("{rounded:e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_short_have_six_digits_at_most() {
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
    fn the_columns_that_fit_are_shown_and_one_at_least() {
        for (width, expected) in [(None, 3), (Some(14), 3), (Some(13), 2), (Some(3), 1)] {
            assert_eq!(fitting(&[4, 4, 2], width), expected);
        }
    }
}
