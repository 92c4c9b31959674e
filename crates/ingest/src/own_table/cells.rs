//! Reads the cells of a CSV or Parquet table.

use std::path::Path;

use polars::prelude::AnyValue;
use trilink_base::csv;
use trilink_base::files;
use trilink_tables::{Table, hash};

use super::OwnTableError;

/// Cell texts that stand for a missing value, in lower case.
const MISSING: [&str; 6] = ["", "na", "nan", "n/a", "null", "-"];

/// Content of a cell.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cell {
    Missing,
    /// Number and its text, which is kept because a name may look like a number.
    Number(f64, String),
    Text(String),
}

/// Cells of a table, stored by column.
#[derive(Debug, Default)]
pub(super) struct Cells {
    pub names: Vec<String>,
    pub columns: Vec<Vec<Cell>>,
    /// Names by which messages refer to the rows.
    pub row_names: Vec<String>,
    /// Problems that concern whole lines.
    pub problems: Vec<String>,
    /// Hash of the file's bytes, hexadecimal.
    pub hash: String,
}

impl Cells {
    /// Reads a Parquet file, recognised by its first bytes, or otherwise a CSV file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read or is neither Parquet nor CSV.
    pub(super) fn read(path: &Path) -> Result<Self, OwnTableError> {
        let read = files::read(path, files::TEXT_BYTES);
        let (bytes, _) =
            read.map_err(|source| OwnTableError::Read { path: path.to_owned(), source })?;
        let hash = hash(&bytes);
        if bytes.starts_with(b"PAR1") {
            return Ok(Self { hash, ..Self::from_table(&Table::parse(path, bytes)?) });
        }
        let text = std::str::from_utf8(&bytes);
        let cells = text.map_err(|_| "the file is neither a Parquet file nor UTF-8 text".into());
        let cells = cells.and_then(|text| Self::from_text(text.trim_start_matches('\u{feff}')));
        let cells = cells.map_err(|problem| OwnTableError::wrong(path, vec![problem]))?;
        Ok(Self { hash, ..cells })
    }

    fn from_table(table: &Table) -> Self {
        let columns = table.frame.columns().iter().map(|column| {
            (0..table.len())
                .map(|row| column.get(row).map_or(Cell::Missing, |value| Cell::from_value(&value)))
                .collect()
        });
        let names = table.frame.get_column_names().into_iter().map(ToString::to_string);
        let row_names = (1..=table.len()).map(|row| format!("row {row}")).collect();
        Self { names: names.collect(), columns: columns.collect(), row_names, ..Self::default() }
    }

    /// Reads CSV with a header line. The cell separator is the candidate that occurs most often in the header.
    fn from_text(text: &str) -> Result<Self, String> {
        let names = text.lines().find(|line| !line.trim().is_empty() && !line.starts_with('#'));
        let names =
            names.ok_or("the file is empty; it must have a header line and at least one row")?;
        let separator = [',', ';', '\t']
            .into_iter()
            .rev()
            .max_by_key(|separator| names.matches(*separator).count())
            .unwrap_or(',');
        let mut records = csv::records(text, separator)?.into_iter();
        let (_, names) = records.next().unwrap_or_default();
        let mut row_names = Vec::new();
        let mut problems = Vec::new();
        let mut columns: Vec<Vec<Cell>> = vec![Vec::new(); names.len()];
        for (line, fields) in records {
            if fields.len() != names.len() {
                let found = fields.len();
                let needed = names.len();
                problems.push(format!(
                    "line {line}: found {found} fields, but the header has {needed}"
                ));
                continue;
            }
            row_names.push(format!("line {line}"));
            for (column, field) in columns.iter_mut().zip(fields) {
                column.push(Cell::from_field(&field, separator != ','));
            }
        }
        Ok(Self { names, columns, row_names, problems, hash: String::new() })
    }
}

impl Cells {
    /// Returns whether the table has a column with this name.
    pub(super) fn has_column(&self, name: &str) -> bool {
        self.names.iter().any(|other| other == name)
    }
}

impl Cell {
    fn from_value(value: &AnyValue) -> Self {
        match value {
            AnyValue::Null => Self::Missing,
            // A 32-bit number is converted by way of its shortest decimal form.
            AnyValue::Float32(number) => Self::from_field(&number.to_string(), false),
            value => match (value.get_str(), value.extract::<f64>()) {
                (Some(text), _) => Self::from_field(text, false),
                (None, Some(number)) if value.is_primitive_numeric() && number.is_nan() => {
                    Self::Missing
                }
                (None, Some(number)) if value.is_primitive_numeric() => {
                    Self::Number(number, number.to_string())
                }
                _ => Self::Text(value.to_string()),
            },
        }
    }

    /// Parses a field. With `has_decimal_comma`, a comma is the decimal separator.
    fn from_field(field: &str, has_decimal_comma: bool) -> Self {
        let field = field.trim();
        if MISSING.contains(&field.to_lowercase().as_str()) {
            return Self::Missing;
        }
        let number =
            if has_decimal_comma { field.replacen(',', ".", 1).parse() } else { field.parse() };
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
    fn a_comma_is_the_decimal_separator_where_semicolons_separate_fields() {
        let cells = Cells::from_text("d_m;v_m_s\n0,48;NA\n").unwrap();
        assert_eq!(
            cells.columns,
            [vec![Cell::Number(0.48, "0,48".to_owned())], vec![Cell::Missing]]
        );
        let cells = Cells::from_text("d_m,v_m_s\n0.480,-\n1,2,3\n").unwrap();
        assert_eq!(
            cells.columns,
            [vec![Cell::Number(0.48, "0.480".to_owned())], vec![Cell::Missing]]
        );
        assert_eq!(cells.problems, ["line 3: found 3 fields, but the header has 2"]);
        assert!(Cells::from_text("# nothing\n\n").is_err());
    }
}
