//! Aligned columns on standard output.

use console::measure_text_width;

use super::output::say;

const GAP: &str = "  ";

/// Prints a table and gives the number of columns at its end that do not fit into `width`. A
/// heading is a column's name, and whether its cells end at its right.
pub(super) fn print(
    headings: &[(&str, bool)],
    rows: &[Vec<String>],
    width: Option<usize>,
) -> usize {
    let mut widths: Vec<usize> =
        headings.iter().map(|(name, _)| measure_text_width(name)).collect();
    for row in rows {
        for (width, cell) in widths.iter_mut().zip(row) {
            *width = measure_text_width(cell).max(*width);
        }
    }
    let fitting = fitting(&widths, width);
    let line = |cells: &mut dyn Iterator<Item = &str>| {
        let mut line = String::new();
        for ((cell, (_, right)), width) in cells.zip(headings).zip(&widths).take(fitting) {
            let space = " ".repeat(width - measure_text_width(cell));
            let (before, after) = if *right { (&*space, "") } else { ("", &*space) };
            line.push_str(if line.is_empty() { "" } else { GAP });
            line.extend([before, cell, after]);
        }
        say!("{}", line.trim_end());
    };
    line(&mut headings.iter().map(|(name, _)| *name));
    for row in rows {
        line(&mut row.iter().map(String::as_str));
    }
    headings.len() - fitting
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
