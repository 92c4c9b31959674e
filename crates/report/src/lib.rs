//! The report stage: turns the tables of `derived/` into figures, HTML pages, `fits.json` and `scorecard.json`.
//!
//! [`Content::read`] reads the tables and prepares the figures; [`Content::write`] draws and writes all files that
//! have changed.
//!
//! - Inputs: `input` (configuration), `tables`, `truth` (true parameters of synthetic trials), `recording` (measured
//!   motions) and `simulated` (simulated motions), combined in `content`.
//! - Figures: `figures` lists and builds the figures of the report; `series`, `looks` and `contour` turn values into
//!   the layers of a panel; `branches`, `optimum` and `sensitivities` build the figures of the commands with these
//!   names, and `ending` selects their file format.
//! - Pages: `page` (`index.html`), `trials` (one page per trial), `replay` (animations of the robot), `changes`
//!   (comparison with the baseline).
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
//! // The empty sets mean that no existing figure or page is up to date, so all of them are written.
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
use std::path::{Path, PathBuf};

use minijinja::value::Value;
use rayon::prelude::*;
use serde::Serialize;
use trilink_base::cancel::CancelToken;
use trilink_plot::{DrawError, Figure, Format};
use trilink_tables::{Stamp, StoreError, ToDisk, hash};

pub use branches::branches_drawing;
pub use changes::{AcceptedBaseline, Changes};
pub use content::{Content, input_paths};
pub use ending::FigureFile;
pub use figures::FREQUENCY;
pub use input::{ReportInput, print_of};
pub use looks::{colours, trends};
pub use optimum::{front_drawing, optimum_drawing, with_unit};
pub use page::{fill, image, shared_fit_sentence};
pub use replay::{SimulationError, simulation_page};
pub use sensitivities::sensitivities_drawing;
use trials::PagesWritten;
pub use trials::page_of;
pub use truth::notice_of_folders;

/// Error returned by the report stage.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Draw(#[from] DrawError),
    #[error("JSON: {0}")]
    Json(serde_json::Error),
    #[error("the built-in claims of the paper cannot be read: {0}")]
    Claims(toml::de::Error),
    #[error("index.html: {0:#}")]
    Page(minijinja::Error),
}

/// Summary of a report that has been written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reported {
    /// Path of `index.html`.
    pub page: PathBuf,
    /// Path of `scorecard.json`; `None` if no campaign is one of the paper's.
    pub scorecard: Option<PathBuf>,
    /// File names of the figures, without extension.
    pub figures: Vec<String>,
    /// Sentences that explain what is missing from the report, and why.
    pub missing: Vec<String>,
    /// Sentences about damaged or inconsistent trial tables that require a person's attention.
    pub damaged: Vec<String>,
}

impl Reported {
    /// Creates the summary of a report that contains the named figures.
    pub fn new(
        input: &ReportInput,
        figures: Vec<String>,
        missing: Vec<String>,
        damaged: Vec<String>,
    ) -> Self {
        let [page, scorecard] = [PAGE, SCORECARD].map(|name| input.paths.reports.join(name));
        let scorecard = Some(scorecard).filter(|path| path.is_file());
        Self { page, scorecard, figures, missing, damaged }
    }
}

/// Summary of a report, with the stamps (size, time and hash) of its files, each keyed by the file's path within
/// `reports/`.
#[derive(Debug)]
pub struct Written {
    pub reported: Reported,
    /// For each figure (by stem) and each trial page (by path) that was out of date, the stamps of its files, keyed by
    /// path.
    pub targets: BTreeMap<String, BTreeMap<String, Stamp>>,
    /// Stamps of the files that belong to the report as a whole.
    pub outputs: BTreeMap<String, Stamp>,
}

impl Content {
    /// Draws the figures and writes the pages of the report into `paths.reports`.
    ///
    /// The output is reproducible: identical tables produce identical bytes. The figures in `kept` (by stem) and the
    /// pages in `kept_pages` (by path) are up to date and are not written again; files whose contents would not change
    /// are left alone.
    ///
    /// # Errors
    /// Returns an error if a trial's table cannot be read, if a file cannot be written, or if the work is cancelled.
    pub fn write(
        &self,
        input: &ReportInput,
        kept: &BTreeSet<String>,
        kept_pages: &BTreeSet<String>,
        cancel: &CancelToken,
    ) -> Result<Written, ReportError> {
        let stems: Vec<String> = self.figures.iter().map(|figure| figure.stem.clone()).collect();
        let (written, stamps) =
            ToDisk::during(|to_disk| self.write_all(input, kept, kept_pages, (to_disk, cancel)));
        let mut stamps = stamps?;
        let PagesWritten { pages, damaged } = written?;
        let reports = &input.paths.reports;
        let mut targets = BTreeMap::new();
        for stem in stems.iter().filter(|stem| !kept.contains(*stem)) {
            targets.insert(stem.clone(), take_stamps(&mut stamps, reports, file_names(stem)));
        }
        for page in pages {
            targets.insert(page.clone(), take_stamps(&mut stamps, reports, [page]));
        }
        let outputs = take_stamps(&mut stamps, reports, FILES.map(str::to_owned));
        let reported = Reported::new(input, stems, self.missing.clone(), damaged);
        Ok(Written { reported, targets, outputs })
    }

    /// Writes all files of the report that have changed, and returns the trial pages that were written.
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
        let truth = truth.as_ref();
        let is_of_the_paper = figures::are_of_the_paper(&tables.campaigns(input));
        let (drawn, (scores, trials)) = rayon::join(
            || draw_all(figures, kept, cancel, &write),
            || {
                rayon::join(
                    || {
                        if !is_of_the_paper {
                            return Ok(Vec::new());
                        }
                        let is_synthetic = truth.is_some_and(|truth| truth.synthetic);
                        scorecard::scorecard(tables.clone(), input.sigma, is_synthetic)
                    },
                    || trials::write(input, ((tables, truth), reader), pages, kept_pages, to_disk),
                )
            },
        );
        let drawn = drawn?;
        let scores = scores?;
        let trials = trials?;
        write(FITS, &json(&fits_json::fits(tables))?)?;
        write(COEFFICIENTS, latex::coefficients(input, tables, truth).as_bytes())?;
        write(CITATIONS, latex::citations().as_bytes())?;
        if is_of_the_paper {
            write(SCORECARD, &json(&scores)?)?;
            let notice = truth.map_or(String::new(), |truth| truth.notice(tables));
            write(SCORECARD_PAGE, page::scorecard_html(&scores, &notice)?.as_bytes())?;
        } else {
            // Files of an earlier configuration.
            for name in [SCORECARD, SCORECARD_PAGE] {
                let path = input.paths.reports.join(name);
                match std::fs::remove_file(&path) {
                    Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                        return Err(StoreError::Remove { path, source }.into());
                    }
                    _ => {}
                }
            }
        }
        let missing = [missing.as_slice(), &trials.damaged].concat();
        let remarks = page::Remarks { missing: &missing, truth, changes: changes.as_ref() };
        let html = page::html(input, tables, &drawn, pages, &scores, remarks)?;
        write(PAGE, html.as_bytes())?;
        Ok(trials)
    }
}

const PAGE: &str = "index.html";
const FITS: &str = "fits.json";
const COEFFICIENTS: &str = "coefficients.tex";
const CITATIONS: &str = "cite.bib";
const SCORECARD: &str = "scorecard.json";
const SCORECARD_PAGE: &str = "scorecard.html";

/// Names of the files in a report, except the figures and the trial pages.
pub const FILES: [&str; 6] = [PAGE, FITS, COEFFICIENTS, CITATIONS, SCORECARD, SCORECARD_PAGE];

/// Returns the paths of a figure's files within `reports/`, one for each file format.
fn file_names(stem: &str) -> [String; 4] {
    Format::ALL.map(|format| format!("figures/{stem}.{format}"))
}

fn json(value: &impl Serialize) -> Result<Vec<u8>, ReportError> {
    let mut json = serde_json::to_vec_pretty(value).map_err(ReportError::Json)?;
    json.push(b'\n');
    Ok(json)
}

/// Returns the BLAKE3 hash of a value's JSON representation.
fn hash_of(value: &impl Serialize) -> String {
    hash(&serde_json::to_vec(value).expect("a value with text keys can be serialised"))
}

/// Removes the stamps of the named files from `stamps` and returns them, keyed by name. Names are paths within
/// `reports`; those without a stamp are skipped.
fn take_stamps(
    stamps: &mut BTreeMap<PathBuf, Stamp>,
    reports: &Path,
    names: impl IntoIterator<Item = String>,
) -> BTreeMap<String, Stamp> {
    let names = names.into_iter();
    names.filter_map(|name| Some((name.clone(), stamps.remove(&reports.join(name))?))).collect()
}

/// Draws all figures in parallel, and returns each figure with its embedded image for the page.
fn draw_all<'f>(
    figures: &'f [Figure],
    kept: &BTreeSet<String>,
    cancel: &CancelToken,
    write: &(impl Fn(&str, &[u8]) -> Result<(), StoreError> + Sync),
) -> Result<Vec<page::Drawn<'f>>, ReportError> {
    let figures = figures.par_iter().with_max_len(1);
    let images = figures.map(|figure| {
        cancel.check().map_err(StoreError::from)?;
        Ok((figure, draw(figure, kept, write)?))
    });
    images.collect()
}

/// Draws a figure as an embedded image for the page, and writes its files unless `kept` contains its stem.
fn draw(
    figure: &Figure,
    kept: &BTreeSet<String>,
    write: &impl Fn(&str, &[u8]) -> Result<(), StoreError>,
) -> Result<Value, ReportError> {
    if !kept.contains(&figure.stem) {
        for (name, bytes) in file_names(&figure.stem).iter().zip(figure.encode_all()?) {
            write(name, &bytes)?;
        }
    }
    Ok(page::image(figure)?)
}
