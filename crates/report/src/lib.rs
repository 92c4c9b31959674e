//! The report: tables of `derived/` to figures, `fits.json`, `scorecard.json` and a page.
//!
//! [`Content::read`] reads and prepares everything, [`Content::write`] draws and writes what changed.
//!
//! - What it is made of: `input`, `tables`, `truth` (what was planted), `recording` and `simulated`
//!   (motions over time), put together in `content`.
//! - Figures: `figures`, which there are; `series`, `looks` and `contour`, how numbers become layers;
//!   `branches`, `optimum` and `sensitivities`, those of single commands, with `ending` for their
//!   format.
//! - Pages: `page` (`index.html`), `trials` (one a trial), `replay` (the robot in motion), `changes`
//!   (the run against its baseline).
//! - For scripts and papers: `fits_json`, `parameters`, `scorecard` (the paper's claims), `latex`.
//!
//! ```no_run
//! use std::collections::BTreeSet;
//! use trilink_base::cancel::CancelToken;
//! use trilink_report::{Content, ReportInput};
//! use trilink_tables::{Reader, config::Config};
//!
//! let config = Config::load("pipeline.toml".as_ref())?;
//! let input = ReportInput::new(&config, BTreeSet::new());
//! let content = Content::read(&input, Reader::default())?;
//! // Nothing is kept from an earlier report: every figure and page is made anew.
//! let cancel = CancelToken::default();
//! let none = BTreeSet::new();
//! let written = content.write(&input, &none, &none, &cancel)?;
//! println!("{}", written.reported.page.display());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod branches;
mod changes;
mod content;
mod contour;
mod ending;
mod figures;
mod fits_json;
mod input;
mod latex;
mod looks;
mod optimum;
mod page;
mod parameters;
mod recording;
mod replay;
mod scorecard;
mod sensitivities;
mod series;
mod simulated;
mod tables;
#[cfg(test)]
mod tests;
mod trials;
mod truth;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use minijinja::value::Value;
use rayon::prelude::*;
use serde::Serialize;
use trilink_base::cancel::CancelToken;
use trilink_plot::{DrawError, Figure, Format};
use trilink_tables::{Stamp, StoreError, ToDisk, hash};

pub use branches::branches_drawing;
pub use changes::{AcceptedBaseline, ChangedValue, Changes};
pub use content::{Content, input_paths};
pub use ending::FigureFile;
pub use figures::FREQUENCY;
pub use input::ReportInput;
pub use looks::{colours, trends};
pub use optimum::{front_drawing, optimum_drawing, with_unit};
pub use page::{fill, image, shared_fit_sentence};
pub use replay::{SimulationError, simulation_page};
pub use sensitivities::sensitivities_drawing;
use trials::PagesWritten;
pub use trials::page_of;
pub use truth::notice_of_folders;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Draw(#[from] DrawError),
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
    /// `paths.reports`. The same tables give the same bytes. Files of figures that are `kept` and
    /// `kept_pages` are not written again; files that would get the bytes that they have are left
    /// alone.
    ///
    /// # Errors
    /// A table of a trial cannot be read, a file not be written, or the work was cancelled.
    pub fn write(
        &self,
        input: &ReportInput,
        kept: &BTreeSet<String>,
        kept_pages: &BTreeSet<String>,
        cancel: &CancelToken,
    ) -> Result<Written, ReportError> {
        let stems = self.figures.iter().map(|figure| figure.stem.clone());
        let drawn_now: Vec<String> = stems.clone().filter(|stem| !kept.contains(stem)).collect();
        let (of_trials, stamps) =
            ToDisk::during(|to_disk| self.write_all(input, kept, kept_pages, (to_disk, cancel)));
        let (mut stamps, PagesWritten { pages, damaged }) = (stamps?, of_trials?);
        let mut stamps_of = |names: Vec<String>| -> BTreeMap<String, Stamp> {
            let of = |name: String| {
                let stamp = stamps.remove(&input.paths.reports.join(&name))?;
                Some((name, stamp))
            };
            names.into_iter().filter_map(of).collect()
        };
        let figures = drawn_now.into_iter().map(|stem| (file_names(&stem).into(), stem));
        let pages = pages.into_iter().map(|name| (vec![name.clone()], name));
        let targets = figures.chain(pages).map(|(names, target)| (target, stamps_of(names)));
        let targets = targets.collect();
        let outputs = stamps_of(FILES.map(str::to_owned).into());
        let reported = Reported::new(input, stems.collect(), self.missing.clone(), damaged);
        Ok(Written { reported, targets, outputs })
    }

    /// As [`Content::write`]. Gives what became of the trials' pages.
    fn write_all(
        &self,
        input: &ReportInput,
        kept: &BTreeSet<String>,
        kept_pages: &BTreeSet<String>,
        (to_disk, cancel): (&ToDisk, &CancelToken),
    ) -> Result<PagesWritten, ReportError> {
        let Self { tables, figures, missing, truth, pages, changes, reader, .. } = self;
        let write = |name: &str, bytes: &[u8]| {
            to_disk.write_if_changed(&input.paths.reports.join(name), bytes)
        };
        let draw = |figure| {
            cancel.check().map_err(StoreError::from)?;
            draw(figure, kept, &write).map(|image| (figure, image))
        };
        let draw_all =
            || figures.par_iter().with_max_len(1).map(draw).collect::<Result<Vec<_>, _>>();
        let is_synthetic = truth.as_ref().is_some_and(|truth| truth.synthetic);
        let judge = || scorecard::scorecard(tables.clone(), input.sigma, is_synthetic);
        let known = (&**tables, truth.as_ref());
        let of_trials = || trials::write(input, (known, reader), pages, kept_pages, to_disk);
        let (drawn, (scores, of_trials)) = rayon::join(draw_all, || rayon::join(judge, of_trials));
        let (drawn, scores, of_trials) = (drawn?, scores?, of_trials?);
        write(FITS, &json(&fits_json::fits(tables))?)?;
        write(COEFFICIENTS, latex::coefficients(input, tables, truth.as_ref()).as_bytes())?;
        write(CITATIONS, latex::citations().as_bytes())?;
        write(SCORECARD, &json(&scores)?)?;
        let notice = truth.as_ref().map_or(String::new(), |truth| truth.notice(tables));
        write(SCORECARD_PAGE, page::scorecard_html(&scores, &notice)?.as_bytes())?;
        let said = [missing.as_slice(), &of_trials.damaged].concat();
        let (truth, changes) = (truth.as_ref(), changes.as_ref());
        let remarks = page::Remarks { missing: &said, truth, changes };
        let html = page::html(input, tables, &drawn, pages, &scores, remarks)?;
        write(PAGE, html.as_bytes())?;
        Ok(of_trials)
    }
}

const PAGE: &str = "index.html";
const FITS: &str = "fits.json";
const COEFFICIENTS: &str = "coefficients.tex";
const CITATIONS: &str = "cite.bib";
const SCORECARD: &str = "scorecard.json";
const SCORECARD_PAGE: &str = "scorecard.html";

/// Files that a report writes, but for the figures and the trials' pages.
pub const FILES: [&str; 6] = [PAGE, FITS, COEFFICIENTS, CITATIONS, SCORECARD, SCORECARD_PAGE];

/// Of a figure, inside of `reports/`.
fn file_names(stem: &str) -> [String; 4] {
    Format::ALL.map(|format| format!("figures/{stem}.{format}"))
}

fn json(value: &impl Serialize) -> Result<Vec<u8>, ReportError> {
    let mut json = serde_json::to_vec_pretty(value).map_err(ReportError::Json)?;
    json.push(b'\n');
    Ok(json)
}

/// The blake3 of a value as JSON.
fn hash_of(value: &impl Serialize) -> String {
    hash(&serde_json::to_vec(value).expect("plain data with text keys"))
}

/// Draws a figure as a page shows it, and writes its files unless they are `kept`.
fn draw(
    figure: &Figure,
    kept: &BTreeSet<String>,
    write: &impl Fn(&str, &[u8]) -> Result<(), StoreError>,
) -> Result<Value, ReportError> {
    if kept.contains(&figure.stem) {
        return Ok(page::image(figure)?);
    }
    let (drawing, files) = figure.encode_all()?;
    for (name, bytes) in file_names(&figure.stem).iter().zip(&files) {
        write(name, bytes)?;
    }
    Ok(page::image_of_drawing(figure, &drawing))
}
