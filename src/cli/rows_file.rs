//! Tables that a command writes where it is told to, in the format that the file's ending names.

use std::path::Path;

use super::Failure;
use crate::inspect::{View, csv, json};
use crate::store::{Columns, Provenance, write_if_changed};

/// A file of rows.
pub(super) struct RowsFile<'p> {
    pub path: &'p Path,
    format: Format,
}

#[derive(Clone, Copy)]
enum Format {
    Parquet,
    Csv,
    Json,
}

impl<'p> RowsFile<'p> {
    /// The file that an `option` names.
    pub fn new(path: &'p Path, option: &str) -> Result<Self, Failure> {
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        let format = match ending.to_ascii_lowercase().as_str() {
            "parquet" => Format::Parquet,
            "csv" => Format::Csv,
            "json" => Format::Json,
            _ => {
                let found = path.display();
                return Err(format!(
                    "{option}: found `{found}`, needed a file that ends in .parquet, .csv or .json"
                )
                .into());
            }
        };
        Ok(Self { path, format })
    }

    /// Writes the rows, which are made of what has this hash.
    pub fn write<T: Columns>(&self, rows: &[T], input: &blake3::Hash) -> Result<(), Failure> {
        let table = T::to_table(rows);
        match self.format {
            Format::Parquet => {
                let provenance = Provenance { input: input.to_hex().to_string() };
                table.write(self.path, &provenance)?;
            }
            Format::Csv => {
                write_if_changed(self.path, csv(&View::of(table)).as_bytes())?;
            }
            Format::Json => {
                write_if_changed(self.path, (json(&View::of(table)) + "\n").as_bytes())?;
            }
        }
        Ok(())
    }
}
