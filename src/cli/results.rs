//! Rows as results: printed for other programs, and tables and figures written where a command is told to, in the
//! format that the file's ending names.

use std::path::{Path, PathBuf};

use trilink_base::files::ending;
use trilink_report::{FigureFile, ReportError, notice_of_folders};
use trilink_tables::{Columns, Provenance, write_if_changed};

use super::output::write_data;
use super::{Context, Failure};
use crate::inspect::{View, csv, json};

/// How results are printed: for people unless one of them is given.
#[derive(clap::Args)]
pub(super) struct Format {
    /// Print CSV with every digit.
    #[arg(long, conflicts_with = "json")]
    pub csv: bool,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

impl Format {
    /// Prints a view with every digit; `false` if it is to be shown to people.
    pub(super) fn view(&self, view: &View) -> bool {
        match (self.csv, self.json) {
            (true, _) => write_data(csv(view).trim_end_matches('\n')),
            (_, true) => write_data(&json(view)),
            _ => return false,
        }
        true
    }

    /// The same of rows.
    pub(super) fn rows<T: Columns>(&self, rows: &[T]) -> bool {
        (self.csv || self.json) && self.view(&View::of(T::to_table(rows)))
    }
}

/// Files of what is found.
#[derive(clap::Args)]
pub(super) struct Files {
    /// Write all rows: Parquet, CSV or JSON, by the file's ending.
    #[arg(long, value_name = "FILE")]
    pub table: Option<PathBuf>,
    /// Draw them: SVG, PNG or PDF, by the file's ending.
    #[arg(long, value_name = "FILE")]
    pub figure: Option<PathBuf>,
}

impl Files {
    /// Refuses a table in a format that is not known, before anything is solved.
    pub(super) fn check(&self) -> Result<(), Failure> {
        self.table.as_deref().map_or(Ok(()), |path| check_ending(path, "--table"))
    }

    /// Writes the table if one is asked for. The rows are made of `input`; they are said to be so many of `what`.
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

    /// Writes what `drawn` draws if a figure is asked for; whether it is of coefficients that were fitted.
    pub(super) fn draw(
        &self,
        context: &Context,
        is_fitted: bool,
        drawn: impl FnOnce(FigureFile<'_>) -> Result<Vec<u8>, ReportError>,
    ) -> Result<(), Failure> {
        if let Some(path) = &self.figure {
            let is_synthetic = is_fitted && !notice_of_folders(&context.config.paths).is_empty();
            let file = FigureFile { ending: ending(path), is_synthetic };
            write_if_changed(path, &drawn(file)?)?;
            context.say(&path.display().to_string());
        }
        Ok(())
    }
}

/// Refuses a file for rows, named by an option, in a format that is not known.
pub(super) fn check_ending(path: &Path, option: &str) -> Result<(), Failure> {
    match ending(path).to_ascii_lowercase().as_str() {
        "parquet" | "csv" | "json" => Ok(()),
        _ => {
            let needed = "needed a file that ends in .parquet, .csv or .json";
            Err(format!("{option}: found `{}`, {needed}", path.display()).into())
        }
    }
}

/// Writes rows that are made of `input`.
pub(super) fn write_rows<T: Columns>(path: &Path, rows: &[T], input: &str) -> Result<(), Failure> {
    let table = T::to_table(rows);
    let text = match ending(path).to_ascii_lowercase().as_str() {
        "csv" => csv(&View::of(table)),
        "json" => json(&View::of(table)) + "\n",
        _ => {
            let input = blake3::hash(input.as_bytes()).to_hex().to_string();
            return Ok(table.write(path, &Provenance { input })?);
        }
    };
    write_if_changed(path, text.as_bytes())?;
    Ok(())
}
