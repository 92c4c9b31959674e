//! Rows of results: printed for other programs, or written as tables and figures in the format that the file extension
//! indicates.

use std::path::{Path, PathBuf};

use trilink_base::files::ending;
use trilink_report::{FigureFile, ReportError, notice_of_folders, print_of};
use trilink_tables::{Columns, Provenance, Table, write_if_changed};

use super::output::{to_caller, write_data};
use super::{Context, Failure};
use crate::inspect::{View, csv, json};

/// Machine-readable formats for printed results; by default, a table for human readers is printed.
#[derive(clap::Args)]
pub(super) struct Format {
    /// Print CSV with all digits.
    #[arg(long, conflicts_with = "json")]
    pub csv: bool,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

impl Format {
    /// Prints a view (selected rows and columns of a table) with all digits; returns `false`, and prints nothing, if
    /// neither CSV nor JSON is requested.
    pub(super) fn view(&self, view: &View) -> bool {
        match (self.csv, self.json) {
            (true, _) => write_data(csv(view).trim_end_matches('\n')),
            (_, true) => write_data(&json(view)),
            _ => return false,
        }
        true
    }

    /// Returns rows to the caller of the command or prints them with all digits; returns `false`, and prints nothing,
    /// on a command line that requests neither CSV nor JSON.
    pub(super) fn rows<T: Columns>(&self, rows: &[T]) -> bool {
        self.table(T::to_table(rows))
    }

    /// Returns or prints the rows of a table as [`Format::rows`] does.
    pub(super) fn table(&self, table: Table) -> bool {
        return_table("rows", &table)
            || (self.csv || self.json) && self.view(&View::from_table(table))
    }
}

/// Files to which results are written.
#[derive(clap::Args)]
pub(super) struct Files {
    /// Write all rows to a file; its extension selects Parquet, CSV or JSON.
    #[arg(long, value_name = "FILE")]
    pub table: Option<PathBuf>,
    /// Draw a figure; the file extension selects SVG, PNG or PDF.
    #[arg(long, value_name = "FILE")]
    pub figure: Option<PathBuf>,
}

impl Files {
    /// Checks the format of the table file before anything is computed.
    pub(super) fn check(&self) -> Result<(), Failure> {
        self.table.as_deref().map_or(Ok(()), |path| check_ending(path, "--table"))
    }

    /// Writes the rows to a file, if one is requested, and prints its path and the number of rows, which are called
    /// `what`, such as "points". A Parquet file stores a hash of `input` as its provenance.
    pub(super) fn write<T: Columns>(
        &self,
        context: &Context,
        rows: &[T],
        input: &str,
        what: &str,
    ) -> Result<(), Failure> {
        if let Some(path) = &self.table {
            write_rows(path, rows, input)?;
            context.say(&format!("{}: {} {what}", path.display(), rows.len()));
        }
        Ok(())
    }

    /// Draws a figure with `draw` and writes it to a file, if a figure is requested. The figure is marked as synthetic
    /// if it shows a fit (`is_fitted`) to synthetic trials.
    pub(super) fn draw(
        &self,
        context: &Context,
        is_fitted: bool,
        draw: impl FnOnce(FigureFile<'_>) -> Result<Vec<u8>, ReportError>,
    ) -> Result<(), Failure> {
        if let Some(path) = &self.figure {
            let is_synthetic = is_fitted && !notice_of_folders(&context.config.paths).is_empty();
            let print = print_of(&context.config.report);
            let file = FigureFile { ending: ending(path), is_synthetic, print };
            write_if_changed(path, &draw(file)?)?;
            context.say(&path.display().to_string());
        }
        Ok(())
    }
}

/// Passes rows to the caller of a command as a table; does nothing and returns `false` on the command line.
pub(super) fn return_rows<T: Columns>(name: &'static str, rows: &[T]) -> bool {
    to_caller(|returned| returned.tables.push((name, T::to_table(rows).frame)))
}

fn return_table(name: &'static str, table: &Table) -> bool {
    to_caller(|returned| returned.tables.push((name, table.frame.clone())))
}

/// Checks that the extension of a table file, given with `option`, denotes a known format.
pub(super) fn check_ending(path: &Path, option: &str) -> Result<(), Failure> {
    match ending(path).to_ascii_lowercase().as_str() {
        "parquet" | "csv" | "json" => Ok(()),
        _ => {
            let needed = "needed a file name that ends in .parquet, .csv or .json";
            Err(format!("{option}: found `{}`, {needed}", path.display()).into())
        }
    }
}

/// Writes rows to a file; a Parquet file stores a hash of `input` as its provenance.
pub(super) fn write_rows<T: Columns>(path: &Path, rows: &[T], input: &str) -> Result<(), Failure> {
    write_table(path, T::to_table(rows), input)
}

/// Writes a table to a file as [`write_rows`] does.
pub(super) fn write_table(path: &Path, table: Table, input: &str) -> Result<(), Failure> {
    let text = match ending(path).to_ascii_lowercase().as_str() {
        "csv" => csv(&View::from_table(table)),
        "json" => json(&View::from_table(table)) + "\n",
        _ => {
            let input = blake3::hash(input.as_bytes()).to_hex().to_string();
            return Ok(table.write(path, &Provenance { input })?);
        }
    };
    write_if_changed(path, text.as_bytes())?;
    Ok(())
}
