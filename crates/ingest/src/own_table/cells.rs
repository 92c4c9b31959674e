//! The cells of a table, of CSV or of Parquet.

use std::path::Path;

use polars::prelude::AnyValue;
use trilink_base::csv;
use trilink_base::files;
use trilink_tables::{Table, hash};

use super::OwnTableError;

/// What stands where nothing was measured, in small letters.
const MISSING: [&str; 6] = ["", "na", "nan", "n/a", "null", "-"];

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cell {
    Missing,
    /// With how it is written: a name may look like a number.
    Number(f64, String),
    Text(String),
}

/// A table column by column.
#[derive(Debug, Default)]
pub(super) struct Cells {
    pub names: Vec<String>,
    pub columns: Vec<Vec<Cell>>,
    /// What each row is called in messages.
    pub places: Vec<String>,
    /// What is wrong with lines as a whole.
    pub problems: Vec<String>,
    /// Of the file's bytes.
    pub hash: String,
}

impl Cells {
    /// Reads Parquet, which a file's first bytes tell, else CSV.
    ///
    /// # Errors
    /// The file cannot be read, or is neither.
    pub(super) fn read(path: &Path) -> Result<Self, OwnTableError> {
        let read = files::read(path, files::TEXT_BYTES);
        let (bytes, _) =
            read.map_err(|source| OwnTableError::Read { path: path.to_owned(), source })?;
        let hash = hash(&bytes);
        if bytes.starts_with(b"PAR1") {
            return Ok(Self { hash, ..Self::of_frame(&Table::parse(path, bytes)?) });
        }
        let text = std::str::from_utf8(&bytes);
        let cells = text.map_err(|_| "found neither Parquet nor UTF-8, needed one of them".into());
        let cells = cells.and_then(|text| Self::of_text(text.trim_start_matches('\u{feff}')));
        let cells = cells.map_err(|problem| OwnTableError::wrong(path, vec![problem]))?;
        Ok(Self { hash, ..cells })
    }

    fn of_frame(table: &Table) -> Self {
        let columns = table.frame.columns().iter().map(|column| {
            let cell = |row| column.get(row).map_or(Cell::Missing, |value| Cell::of_value(&value));
            (0..table.len()).map(cell).collect()
        });
        let names = table.frame.get_column_names().into_iter().map(ToString::to_string);
        let places = (1..=table.len()).map(|row| format!("row {row}")).collect();
        Self { names: names.collect(), columns: columns.collect(), places, ..Self::default() }
    }

    /// Of CSV with a line of names. What separates fields is what the line of names has most of.
    fn of_text(text: &str) -> Result<Self, String> {
        let names = text.lines().find(|line| !line.trim().is_empty() && !line.starts_with('#'));
        let names =
            names.ok_or("found an empty file, needed a line of names and a row at least")?;
        let count = |of: &char| names.matches(*of).count();
        let separator = [',', ';', '\t'].into_iter().rev().max_by_key(count).unwrap_or(',');
        let mut records = csv::records(text, separator)?.into_iter();
        let (_, names) = records.next().unwrap_or_default();
        let (mut places, mut problems) = (Vec::new(), Vec::new());
        let mut columns: Vec<Vec<Cell>> = vec![Vec::new(); names.len()];
        for (line, fields) in records {
            if fields.len() != names.len() {
                let (found, needed) = (fields.len(), names.len());
                problems.push(format!("line {line}: found {found} fields, needed {needed}"));
                continue;
            }
            places.push(format!("line {line}"));
            for (column, field) in columns.iter_mut().zip(fields) {
                column.push(Cell::of_field(&field, separator != ','));
            }
        }
        Ok(Self { names, columns, places, problems, hash: String::new() })
    }
}

impl Cell {
    fn of_value(value: &AnyValue) -> Self {
        match value {
            AnyValue::Null => Self::Missing,
            // A number of 32 bits is as short as it was written.
            AnyValue::Float32(number) => Self::of_field(&number.to_string(), false),
            value => match (value.get_str(), value.extract::<f64>()) {
                (Some(text), _) => Self::of_field(text, false),
                (None, Some(number)) if value.is_primitive_numeric() => match number.is_nan() {
                    true => Self::Missing,
                    false => Self::Number(number, number.to_string()),
                },
                _ => Self::Text(value.to_string()),
            },
        }
    }

    /// Of a field in which a comma may be the decimal one.
    fn of_field(field: &str, has_decimal_comma: bool) -> Self {
        let field = field.trim();
        if MISSING.contains(&field.to_lowercase().as_str()) {
            return Self::Missing;
        }
        let number = match has_decimal_comma {
            true => field.replacen(',', ".", 1).parse(),
            false => field.parse(),
        };
        match number {
            Ok(number) => Self::Number(number, field.to_owned()),
            Err(_) => Self::Text(field.to_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_semicolons_separate_a_comma_is_the_decimal_one() {
        let number = |text: &str| vec![Cell::Number(0.48, text.to_owned())];
        let cells = Cells::of_text("d_m;v_m_s\n0,48;NA\n").unwrap();
        assert_eq!(cells.columns, [number("0,48"), vec![Cell::Missing]]);
        let cells = Cells::of_text("d_m,v_m_s\n0.480,-\n1,2,3\n").unwrap();
        assert_eq!(cells.columns, [number("0.480"), vec![Cell::Missing]]);
        assert_eq!(cells.problems, ["line 3: found 3 fields, needed 2"]);
        assert!(Cells::of_text("# nothing\n\n").is_err());
    }
}
