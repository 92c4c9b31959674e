//! The report: tables of `derived/` to figures, `fits.json`, `scorecard.json` and a page.

mod drawing;
mod figures;
mod fits_json;
mod input;
mod looks;
mod numbers;
mod page;
mod parameters;
mod paths;
mod plan;
mod plotted;
mod recording;
mod scorecard;
mod series;
mod simulated;
mod tables;
#[cfg(test)]
mod tests;
mod trials;
mod truth;
mod warnings;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;

use crate::config::Config;
use crate::store::{How, StageState, Stamp, StoreError, Thing, write_if_changed};
use plan::Content;

pub(crate) use drawing::{Figure, Layer, Look, Panel, Scale};
pub use input::{ReportCampaign, ReportInput};
pub(crate) use looks::colours;
pub(crate) use numbers::{percent, significant};
pub(crate) use page::{Image, fill};
pub use plan::{ReportPlan, plan, plan_after};

/// Raise it when the same tables and configuration give another page or other drawings of the
/// same numbers: then every figure is drawn again once.
pub const REPORT_VERSION: u32 = 2;

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
    #[error("{}: is of an earlier report and cannot be removed: {source}", path.display())]
    Remove { path: PathBuf, source: std::io::Error },
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
}

/// Draws the figures and writes the page, from the tables in `config.paths.derived` into
/// `config.paths.reports`. The same tables give the same bytes.
///
/// # Errors
/// `trials.parquet` is not there, a table cannot be read, or a file cannot be written.
pub fn report(config: &Config) -> Result<Reported, ReportError> {
    let (input, known) = (ReportInput::new(config), StageState::default());
    Ok(report_planned(&input, plan(&input, &known, How::FORCE)?)?.0)
}

/// [`report`], but figures that the plan keeps are not drawn again, and files that would get the
/// bytes that they have are left alone. Gives what to record, too.
///
/// # Errors
/// A file cannot be written.
pub fn report_planned(
    config: &ReportInput,
    plan: ReportPlan,
) -> Result<(Reported, StageState), ReportError> {
    let [page, scorecard] = [PAGE, SCORECARD].map(|name| config.paths.reports.join(name));
    let mut state = plan.state();
    let Some(Content { tables, figures, missing, truth }) = plan.content else {
        let (figures, missing) = (state.order.clone(), state.missing.clone());
        return Ok((Reported { page, scorecard, figures, missing }, state));
    };
    let reports = &config.paths.reports;
    plan::remove_stale(reports, plan.known, &figures)?;
    let drawn = figures
        .par_iter()
        .map(|figure| {
            crate::interrupt::stop_if_asked(String::new);
            let (svg, outputs) = match plan.kept.get(&figure.stem) {
                Some((svg, outputs)) => (svg.clone(), outputs.clone()),
                None => draw(reports, figure)?,
            };
            let image = Image::of_svg(figure, &svg);
            Ok((page::Drawn { figure, image }, outputs))
        })
        .collect::<Result<Vec<_>, ReportError>>()?;
    let (drawn, outputs): (Vec<page::Drawn>, Vec<_>) = drawn.into_iter().unzip();
    for (figure, outputs) in figures.iter().zip(outputs) {
        let parts = plan::parts(figure);
        state.things.insert(figure.stem.clone(), Thing { parts, outputs });
    }

    let mut write = |name: &str, bytes: &[u8]| -> Result<(), StoreError> {
        let stamp = write_if_changed(&reports.join(name), bytes)?;
        state.outputs.insert(name.to_owned(), stamp);
        Ok(())
    };
    write(FITS, &json(&fits_json::fits(&tables.fits, &tables.comparison))?)?;
    let is_synthetic = truth.as_ref().is_some_and(|truth| truth.synthetic);
    let scores = scorecard::scorecard(&tables, config.sigma, is_synthetic)?;
    write(SCORECARD, &json(&scores)?)?;
    let pages = trials::pages(&tables);
    let mut written = trials::write(config, &tables, &pages, &plan.kept_pages)?;
    for (name, parts) in plan.pages {
        let outputs = match (written.remove(&name), plan.known.things.get(&name)) {
            (Some(stamp), _) => BTreeMap::from([(name.clone(), stamp)]),
            (None, known) => known.map_or(BTreeMap::new(), |thing| thing.outputs.clone()),
        };
        state.things.insert(name, Thing { parts, outputs });
    }
    let html = page::html(config, &tables, &drawn, &pages, &scores, &missing, truth.as_ref())?;
    write(PAGE, html.as_bytes())?;
    let figures: Vec<String> = figures.iter().map(|figure| figure.stem.clone()).collect();
    state.order.clone_from(&figures);
    state.missing.clone_from(&missing);
    Ok((Reported { page, scorecard, figures, missing }, state))
}

const PAGE: &str = "index.html";
const FITS: &str = "fits.json";
const SCORECARD: &str = "scorecard.json";
const EXTENSIONS: [&str; 3] = ["svg", "png", "csv"];

/// Files that a report writes, but for the figures.
pub fn file_paths(reports: &Path) -> Vec<PathBuf> {
    [PAGE, FITS, SCORECARD].map(|name| reports.join(name)).into()
}

fn json(value: &impl Serialize) -> Result<Vec<u8>, ReportError> {
    let mut json = serde_json::to_vec_pretty(value).map_err(ReportError::Json)?;
    json.push(b'\n');
    Ok(json)
}

/// Draws a figure and writes its files; gives the SVG and the files' stamps.
fn draw(reports: &Path, figure: &Figure) -> Result<(String, BTreeMap<String, Stamp>), ReportError> {
    let svg = drawing::svg(figure)?;
    let (png, csv) = (drawing::png(figure, &svg)?, plotted::csv(figure));
    let mut outputs = BTreeMap::new();
    let files = EXTENSIONS.into_iter().zip([svg.as_bytes(), &png, csv.as_bytes()]);
    for (extension, bytes) in files {
        let name = plan::file_name(&figure.stem, extension);
        let stamp = write_if_changed(&reports.join(&name), bytes)?;
        outputs.insert(name, stamp);
    }
    Ok((svg, outputs))
}
