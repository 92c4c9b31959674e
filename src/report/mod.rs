//! The report: tables of `derived/` to figures, `fits.json` and a page.

mod axis;
mod canvas;
mod chart;
mod figure;
mod figures;
mod fits_json;
mod font;
mod legend;
mod numbers;
mod page;
mod parameters;
mod places;
mod plot;
mod polyline;
mod recording;
mod render;
mod series;
mod simulated;
mod style;
mod tables;
#[cfg(test)]
mod tests;
mod trials;
mod truth;
mod warnings;

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::config::Config;
use crate::store::{StoreError, write_bytes};
use figure::Figure;
use font::Typeface;
use tables::Tables;
use truth::Truth;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("the font that comes with the program cannot be read")]
    Font,
    #[error("figure {figure}: cannot be drawn: {message}")]
    Draw { figure: String, message: String },
    #[error("figure {figure}: cannot be written as PNG: {source}")]
    Png { figure: String, source: png::EncodingError },
    #[error("fits.json: {0}")]
    Json(serde_json::Error),
    #[error("index.html: {0:#}")]
    Page(minijinja::Error),
    #[error("{}: is of an earlier report and cannot be removed: {source}", path.display())]
    Remove { path: PathBuf, source: std::io::Error },
}

/// What a report came to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reported {
    /// `index.html`.
    pub page: PathBuf,
    /// Names of the figures that were drawn, without extension.
    pub figures: Vec<String>,
    /// Sentences on what is not in the report and why.
    pub missing: Vec<String>,
}

/// Draws the figures and writes the page, from the tables in `config.paths.derived` into
/// `config.paths.reports`. The same tables give the same bytes.
///
/// # Errors
/// `trials.parquet` is not there, a table cannot be read, or a file cannot be written.
pub fn report(config: &Config) -> Result<Reported, ReportError> {
    let reports = &config.paths.reports;
    let tables = Tables::read(&config.paths.derived)?;
    let mut missing = tables.missing.clone();
    let truth = Truth::read(&config.paths.raw).unwrap_or_else(|problem| {
        missing.push(problem);
        None
    });
    let found = figures::figures(&tables, config, truth.as_ref());
    missing.extend(found.missing);

    let folder = reports.join("figures");
    remove_stale(&folder, &found.figures)?;
    let font = Typeface::load()?;
    let drawn = found
        .figures
        .par_iter()
        .map(|figure| {
            let svg = write_figure(&folder, figure)?;
            let size = plot::size(figure, font);
            Ok(page::Drawn { figure, svg, size })
        })
        .collect::<Result<Vec<_>, ReportError>>()?;

    write_bytes(&reports.join("fits.json"), &fits_json::json(&tables.fits, &tables.comparison)?)?;
    let pages = trials::pages(&tables);
    trials::write(config, &tables, &pages)?;
    let html = page::html(config, &tables, &drawn, &pages, &missing, truth.as_ref())?;
    let page = reports.join("index.html");
    write_bytes(&page, html.as_bytes())?;
    let figures = found.figures.iter().map(|figure| figure.stem.clone()).collect();
    Ok(Reported { page, figures, missing })
}

const EXTENSIONS: [&str; 3] = ["svg", "png", "csv"];

fn write_figure(folder: &Path, figure: &Figure) -> Result<String, ReportError> {
    let svg = render::svg(figure)?;
    let [svg_file, png_file, csv_file] =
        EXTENSIONS.map(|extension| folder.join(format!("{}.{extension}", figure.stem)));
    write_bytes(&svg_file, svg.as_bytes())?;
    write_bytes(&png_file, &render::png(figure)?)?;
    write_bytes(&csv_file, figure.csv().as_bytes())?;
    Ok(svg)
}

/// Removes figures of the paper's campaigns that an earlier report drew and this one does not.
fn remove_stale(folder: &Path, figures: &[Figure]) -> Result<(), ReportError> {
    let drawn = |stem: &str| figures.iter().any(|figure| figure.stem == stem);
    for stem in figures::known_stems().iter().filter(|stem| !drawn(stem)) {
        for extension in EXTENSIONS {
            let path = folder.join(format!("{stem}.{extension}"));
            match std::fs::remove_file(&path) {
                Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                    return Err(ReportError::Remove { path, source });
                }
                _ => {}
            }
        }
    }
    Ok(())
}
