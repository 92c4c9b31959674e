//! Tables and figures that a command writes where it is told to, in the format that the file's ending names, and rows that
//! it prints for other programs.

use std::path::Path;

use trilink_base::files::ending;
use trilink_report::{FigureFile, ReportError, notice_of_folders};
use trilink_tables::config::Paths;
use trilink_tables::{Columns, Provenance, write_if_changed};

use super::Failure;
use super::output::write_data;
use super::progress::Progress;
use crate::inspect::{View, csv, json};

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
    pub(super) fn new(path: &'p Path, option: &str) -> Result<Self, Failure> {
        let format = match ending(path).to_ascii_lowercase().as_str() {
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
    pub(super) fn write<T: Columns>(
        &self,
        rows: &[T],
        input: &blake3::Hash,
    ) -> Result<(), Failure> {
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

/// Writes what `drawn` draws for the file's ending, of coefficients that were `fitted_to` the trials of
/// these paths or to none.
pub(super) fn write_figure(
    path: &Path,
    progress: &Progress,
    fitted_to: Option<&Paths>,
    drawn: impl FnOnce(FigureFile<'_>) -> Result<Vec<u8>, ReportError>,
) -> Result<(), Failure> {
    let is_synthetic = fitted_to.is_some_and(|paths| !notice_of_folders(paths).is_empty());
    write_if_changed(path, &drawn(FigureFile { ending: ending(path), is_synthetic })?)?;
    progress.say(&path.display().to_string());
    Ok(())
}

/// Prints rows with every digit as CSV or as JSON; `false` if neither is asked for.
pub(super) fn print_rows<T: Columns>(rows: &[T], as_csv: bool, as_json: bool) -> bool {
    let view = || View::of(T::to_table(rows));
    match (as_csv, as_json) {
        (true, _) => write_data(csv(&view()).trim_end_matches('\n')),
        (_, true) => write_data(&json(&view())),
        _ => return false,
    }
    true
}
