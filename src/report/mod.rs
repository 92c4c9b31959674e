//! The report: tables of `derived/` to figures, `fits.json`, `scorecard.json` and a page.

mod content;
mod drawing;
mod figures;
mod fits_json;
mod input;
mod latex;
mod looks;
mod numbers;
mod page;
mod parameters;
mod pdf;
mod plotted;
mod polyline;
mod raster;
mod recording;
mod replay;
mod scorecard;
mod series;
mod simulated;
mod svg;
mod tables;
#[cfg(test)]
mod tests;
mod trials;
mod truth;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;

use crate::store::{Stamp, StoreError, write_if_changed};

pub use content::{Content, input_paths};
pub(crate) use drawing::{Figure, Layer, Layout, Look, Panel, Scale};
pub use input::ReportInput;
pub(crate) use looks::{colours, trends};
pub(crate) use numbers::{percent, significant};
pub(crate) use page::{fill, image};
pub use replay::{SimulationError, simulation_page};
pub use trials::page_of;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("figure {figure}: cannot be drawn: {message}")]
    Draw { figure: String, message: String },
    #[error("JSON: {0}")]
    Json(serde_json::Error),
    #[error("the claims that come with the program cannot be read: {0}")]
    Claims(toml::de::Error),
    #[error("index.html: {0:#}")]
    Page(minijinja::Error),
}

/// What a report came to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reported {
    /// `index.html`.
    pub page: PathBuf,
    /// `scorecard.json`.
    pub scorecard: PathBuf,
    /// Names of the figures that were drawn, without extension.
    pub figures: Vec<String>,
    /// Sentences on what is not in the report and why.
    pub missing: Vec<String>,
    /// Sentences on tables of trials that are damaged or do not belong together: they need a
    /// person.
    pub damaged: Vec<String>,
}

impl Reported {
    /// A report with these figures.
    pub fn new(
        input: &ReportInput,
        figures: Vec<String>,
        missing: Vec<String>,
        damaged: Vec<String>,
    ) -> Self {
        let [page, scorecard] = [PAGE, SCORECARD].map(|name| input.paths.reports.join(name));
        Self { page, scorecard, figures, missing, damaged }
    }
}

/// A report with the files that were written, each by its path inside of `reports/`.
#[derive(Debug)]
pub struct Written {
    pub reported: Reported,
    /// Of the figures and pages that were not kept, by stem or path.
    pub targets: BTreeMap<String, BTreeMap<String, Stamp>>,
    /// Of the report as a whole.
    pub outputs: BTreeMap<String, Stamp>,
}

impl Content {
    /// Draws the figures and writes the pages, from the tables in `paths.derived` into
    /// `paths.reports`. The same tables give the same bytes. Figures of which the SVG is `kept`
    /// are not drawn again, nor `kept_pages` written; files that would get the bytes that they
    /// have are left alone.
    ///
    /// # Errors
    /// A table of a trial cannot be read, or a file not be written.
    pub fn write(
        &self,
        input: &ReportInput,
        mut kept: BTreeMap<String, String>,
        kept_pages: &BTreeSet<String>,
    ) -> Result<Written, ReportError> {
        let reports = &input.paths.reports;
        let Self { tables, figures, missing, damaged, truth, pages, changes, reader, .. } = self;
        let with_svg: Vec<_> =
            figures.iter().map(|figure| (figure, kept.remove(&figure.stem))).collect();
        let drawn = with_svg
            .into_par_iter()
            .map(|(figure, svg)| {
                crate::interrupt::stop_if_asked(String::new);
                let (svg, outputs) = match svg {
                    Some(svg) => (svg, None),
                    None => draw(reports, figure).map(|(svg, outputs)| (svg, Some(outputs)))?,
                };
                Ok(((figure, page::image_of_svg(figure, &svg)), outputs))
            })
            .collect::<Result<Vec<_>, ReportError>>()?;
        let (drawn, outputs): (Vec<page::Drawn>, Vec<_>) = drawn.into_iter().unzip();
        let drawn_now = figures.iter().zip(outputs);
        let mut targets: BTreeMap<String, BTreeMap<String, Stamp>> = drawn_now
            .filter_map(|(figure, outputs)| Some((figure.stem.clone(), outputs?)))
            .collect();
        let pages_now = trials::write(input, (&**tables, reader), pages, kept_pages)?.into_iter();
        targets.extend(pages_now.map(|(name, stamp)| (name.clone(), [(name, stamp)].into())));

        let mut outputs = BTreeMap::new();
        let mut write = |name: &str, bytes: &[u8]| -> Result<(), StoreError> {
            outputs.insert(name.to_owned(), write_if_changed(&reports.join(name), bytes)?);
            Ok(())
        };
        write(FITS, &json(&fits_json::fits(tables))?)?;
        write(COEFFICIENTS, latex::coefficients(input, tables).as_bytes())?;
        write(CITATIONS, latex::citations().as_bytes())?;
        let is_synthetic = truth.as_ref().is_some_and(|truth| truth.synthetic);
        let scores = scorecard::scorecard(tables.clone(), input.sigma, is_synthetic)?;
        write(SCORECARD, &json(&scores)?)?;
        write(SCORECARD_PAGE, page::scorecard_html(&scores, is_synthetic)?.as_bytes())?;
        let said = [missing.as_slice(), damaged].concat();
        let (truth, changes) = (truth.as_ref(), changes.as_ref());
        let remarks = page::Remarks { missing: &said, truth, changes };
        let html = page::html(input, tables, &drawn, pages, &scores, remarks)?;
        write(PAGE, html.as_bytes())?;
        let figures = figures.iter().map(|figure| figure.stem.clone()).collect();
        let reported = Reported::new(input, figures, missing.clone(), damaged.clone());
        Ok(Written { reported, targets, outputs })
    }
}

const PAGE: &str = "index.html";
const FITS: &str = "fits.json";
const COEFFICIENTS: &str = "coefficients.tex";
const CITATIONS: &str = "cite.bib";
const SCORECARD: &str = "scorecard.json";
const SCORECARD_PAGE: &str = "scorecard.html";
const EXTENSIONS: [&str; 4] = ["svg", "png", "pdf", "csv"];

/// Files that a report writes, but for the figures and the trials' pages.
pub const FILES: [&str; 6] = [PAGE, FITS, COEFFICIENTS, CITATIONS, SCORECARD, SCORECARD_PAGE];

/// Of a figure, inside of `reports/`.
fn file_name(stem: &str, extension: &str) -> String {
    format!("figures/{stem}.{extension}")
}

fn json(value: &impl Serialize) -> Result<Vec<u8>, ReportError> {
    let mut json = serde_json::to_vec_pretty(value).map_err(ReportError::Json)?;
    json.push(b'\n');
    Ok(json)
}

/// Draws a figure and writes its files; gives the SVG and the files' stamps.
fn draw(reports: &Path, figure: &Figure) -> Result<(String, BTreeMap<String, Stamp>), ReportError> {
    let error = |message| ReportError::Draw { figure: figure.stem.clone(), message };
    let svg = drawing::svg(figure).map_err(error)?;
    let tree = raster::parsed(&svg).map_err(error)?;
    let png = raster::png(&tree, figure.print.dots_per_inch()).map_err(error)?;
    let pdf = pdf::pdf(&tree, &figure.title).map_err(|why| error(why.to_string()))?;
    let csv = plotted::csv(figure);
    let mut outputs = BTreeMap::new();
    let files = EXTENSIONS.into_iter().zip([svg.as_bytes(), &png, &pdf, csv.as_bytes()]);
    for (extension, bytes) in files {
        let name = file_name(&figure.stem, extension);
        let stamp = write_if_changed(&reports.join(&name), bytes)?;
        outputs.insert(name, stamp);
    }
    Ok((svg, outputs))
}
