//! Tables with aligned columns on standard output.

use super::output::print_wrapped;
use super::terminal::{Text, Tone, stdout_width};

/// Space between columns.
const GAP: &str = "  ";
/// Minimum space for a column of prose, characters; with less space, prose is printed below the row.
const MIN_PROSE: usize = 24;

/// Table of rows, built column by column.
pub(super) struct Table<'r, R> {
    rows: &'r [R],
    columns: Vec<Column>,
    indent: usize,
}

/// Column of a table: heading and cells.
struct Column {
    name: String,
    cells: Vec<Text>,
    width: usize,
    form: Form,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Left,
    Right,
    /// Text that may be broken into lines.
    Prose,
}

impl<'r, R> Table<'r, R> {
    /// Creates a table without columns.
    pub(super) fn new(rows: &'r [R]) -> Self {
        Self { rows, columns: Vec::new(), indent: 0 }
    }

    /// Indents the table.
    pub(super) fn indented(self, indent: usize) -> Self {
        Self { indent, ..self }
    }

    /// Adds a left-aligned column, for text.
    pub(super) fn left<T: Into<Text>>(self, name: &str, cell: impl Fn(&'r R) -> T) -> Self {
        self.with(name, Form::Left, cell)
    }

    /// Adds a right-aligned column, for numbers.
    pub(super) fn right<T: Into<Text>>(self, name: &str, cell: impl Fn(&'r R) -> T) -> Self {
        self.with(name, Form::Right, cell)
    }

    /// Adds a column with the given alignment.
    pub(super) fn column<T: Into<Text>>(
        self,
        name: &str,
        is_right: bool,
        cell: impl Fn(&'r R) -> T,
    ) -> Self {
        self.with(name, if is_right { Form::Right } else { Form::Left }, cell)
    }

    /// Adds the last column, for text that is broken into lines if it is longer than the remaining space.
    pub(super) fn prose<T: Into<Text>>(self, name: &str, cell: impl Fn(&'r R) -> T) -> Self {
        self.with(name, Form::Prose, cell)
    }

    fn with<T: Into<Text>>(mut self, name: &str, form: Form, cell: impl Fn(&'r R) -> T) -> Self {
        let cells: Vec<Text> = self.rows.iter().map(|row| cell(row).into()).collect();
        let widths = cells.iter().map(Text::width);
        let width = widths.chain([Text::from(name).width()]).max().unwrap_or_default();
        self.columns.push(Column { name: name.to_owned(), cells, width, form });
        self
    }

    /// Prints the table. Columns that do not fit on the terminal are printed below each row.
    pub(super) fn print(&self) {
        self.print_at(stdout_width(), true);
    }

    /// Whether all columns fit on the terminal.
    pub(super) fn fits(&self) -> bool {
        let width = stdout_width().map(|width| width.saturating_sub(self.indent));
        fitting(&self.widths(), width) == self.columns.len()
    }

    /// Prints the columns that fit on the terminal; returns the names of the columns left out.
    pub(super) fn print_fitting(self) -> Vec<String> {
        let fitting = self.print_at(stdout_width(), false);
        self.columns.into_iter().skip(fitting).map(|column| column.name).collect()
    }

    /// Prints the table at a width; returns the number of columns that fit.
    fn print_at(&self, width: Option<usize>, below: bool) -> usize {
        let width = width.map(|width| width.saturating_sub(self.indent));
        let fitting = fitting(&self.widths(), width);
        if self.rows.is_empty() && below {
            return fitting;
        }
        let mut lines = self.row(None, fitting, width);
        // Columns without names need no headings.
        lines.retain(|line| line.width() > 0);
        for row in 0..self.rows.len() {
            let below = if below { self.below(row, fitting, width) } else { None };
            let above = self.row(Some(row), fitting, width);
            let is_blank = below.is_some() && above.iter().all(|line| line.width() == 0);
            lines.extend(above.into_iter().filter(|_| !is_blank));
            lines.extend(below);
        }
        let indent = Text::from(" ".repeat(self.indent));
        let lines: Vec<Text> = lines.into_iter().map(|line| indent.clone() + line).collect();
        if !lines.is_empty() {
            print_wrapped(&Text::lines(&lines));
        }
        fitting
    }

    fn widths(&self) -> Vec<(usize, Form)> {
        self.columns.iter().map(|column| (column.width, column.form)).collect()
    }

    /// Returns the lines of a row, or of the headings, in the first `fitting` columns.
    fn row(&self, row: Option<usize>, fitting: usize, width: Option<usize>) -> Vec<Text> {
        let mut line = Text::default();
        let mut start = 0;
        let columns = &self.columns[..fitting];
        for (n, column) in columns.iter().enumerate() {
            let cell = match row {
                Some(row) => column.cells[row].clone(),
                None => Tone::Heading.paint(&column.name),
            };
            let gap = if n == 0 { "" } else { GAP };
            start += gap.len();
            let space = " ".repeat(column.width.saturating_sub(cell.width()));
            line = match column.form {
                Form::Right => line + gap + space + cell,
                Form::Left if n + 1 < fitting => line + gap + cell + space,
                Form::Left => line + gap + cell,
                Form::Prose => {
                    let broken = cell.broken(width.map_or(usize::MAX, |width| width - start));
                    let hang = Text::from(" ".repeat(start));
                    let starts = std::iter::once(line + gap).chain(std::iter::repeat(hang));
                    let lines = starts.zip(broken).map(|(start, part)| (start + part).trim_end());
                    return lines.collect();
                }
            };
            start += column.width;
        }
        vec![line.trim_end()]
    }

    /// Returns the lines below a row: the cells of the columns that do not fit, each with its heading.
    fn below(&self, row: usize, fitting: usize, width: Option<usize>) -> Option<Text> {
        let columns = self.columns[fitting..].iter();
        let filled = columns.filter(|column| !column.cells[row].is_missing());
        let parts = filled.map(|Column { name, cells, form, .. }| match name.as_str() {
            name if *form != Form::Prose && !name.is_empty() => {
                Text::from(name) + " " + cells[row].clone()
            }
            _ => cells[row].clone(),
        });
        let all = parts.reduce(|all, part| all + ", " + part)?;
        Some((Text::from("  ") + all).wrap(width))
    }
}

/// Returns how many columns of these widths fit into `width` characters, at least one; all columns if `width` is
/// `None`.
fn fitting(columns: &[(usize, Form)], width: Option<usize>) -> usize {
    let Some(max_width) = width else { return columns.len() };
    let mut end = 0;
    let fitting = columns.iter().take_while(|(width, form)| {
        let least = if *form == Form::Prose { MIN_PROSE.min(*width) } else { *width };
        end += least + if end == 0 { 0 } else { GAP.len() };
        end <= max_width
    });
    fitting.count().max(1)
}

/// Formats a number with at most six significant digits and no trailing zeros.
pub(super) fn short(number: f64) -> String {
    rounded(number, 6)
}

/// Formats a number with at most `digits` significant digits and no trailing zeros.
pub(super) fn rounded(number: f64, digits: usize) -> String {
    if number == 0.0 || !number.is_finite() {
        return number.to_string();
    }
    // Rounding comes before the choice of the notation, because it may add a digit: 999999.7.
    let rounded: f64 = format!("{number:.*e}", digits - 1).parse().unwrap_or(number);
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
        let columns = [(4, Form::Left), (4, Form::Right), (90, Form::Prose)];
        for (width, expected) in [(None, 3), (Some(36), 3), (Some(35), 2), (Some(3), 1)] {
            assert_eq!(fitting(&columns, width), expected);
        }
    }

    #[test]
    fn what_does_not_fit_is_below_the_row_and_prose_is_broken() {
        let rows = [("a", "1.5", "one two three four five six"), ("b", "-", "")];
        let table = Table::new(&rows)
            .left("name", |row| row.0)
            .right("value", |row| row.1)
            .prose("remark", |row| row.2);
        let lines = |width| {
            let fitting = fitting(&table.widths(), Some(width));
            let lines = (0..2).flat_map(|row| table.row(Some(row), fitting, Some(width)));
            lines.map(|line| line.to_string()).collect::<Vec<_>>()
        };
        assert_eq!(
            lines(37),
            ["a       1.5  one two three four five", "             six", "b         -"]
        );
        assert_eq!(lines(30), ["a       1.5", "b         -"]);
        let below = |row| table.below(row, 1, Some(30)).map(|below| below.to_string());
        assert_eq!(below(0).unwrap(), "  value 1.5, one two three\n    four five six");
        assert_eq!(below(1), None);
    }
}
