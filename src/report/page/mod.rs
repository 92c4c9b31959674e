//! `index.html`, one file with everything in it, and a page for each trial.

mod campaigns;
mod engine;
mod image;
mod trial;

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

pub use engine::fill;
pub use image::Image;
pub use trial::html as trial_html;

use super::drawing::Figure;
use super::input::relative;
use super::tables::Tables;
use super::truth::{self, Comparison, Truth};
use super::warnings::{Trouble, common, fit_notes, troubled};
use super::{ReportError, ReportInput, figures, scorecard};
use crate::store::{CheckRow, RobotParameterRow, RobotQuantity, TrialRow};

/// Trials' names, and the files of their pages in `trials/`.
pub type TrialPages = BTreeMap<String, String>;

const INDEX: &str = include_str!("index.html");

/// A drawn figure.
pub struct Drawn<'f> {
    pub figure: &'f Figure,
    pub image: Image,
}

#[derive(Serialize)]
struct Page<'p> {
    version: &'static str,
    synthetic: bool,
    fits: usize,
    figures: usize,
    pages: &'p TrialPages,
    /// Wrong with more than one trial.
    common: Vec<&'p CheckRow>,
    troubled: Vec<Trouble<'p>>,
    fit_notes: BTreeSet<(&'p str, &'p str)>,
    checks: &'p [CheckRow],
    missing: &'p [String],
    campaigns: Vec<campaigns::CampaignSection<'p>>,
    comparisons: Vec<&'p Image>,
    /// What trials measured of robots.
    robots: Vec<(&'p RobotParameterRow, RobotQuantity)>,
    /// Figures of joints that were let go.
    releases: Vec<&'p Image>,
    trials: &'p [TrialRow],
    truth: Option<Comparison<'p>>,
    /// Figures of planted truth.
    recovered: Vec<&'p Image>,
    scorecard: &'p [scorecard::JudgedClaim],
    raw: String,
    derived: String,
    /// Fingerprint of the trials, if their table has one.
    input: Option<&'p str>,
    /// As TOML, with paths as seen from the page.
    configuration: String,
}

/// The page as HTML.
///
/// # Errors
/// The template cannot be filled in.
pub fn html<'p>(
    input: &ReportInput,
    tables: &'p Tables,
    drawn: &[Drawn<'_>],
    pages: &TrialPages,
    scores: &[scorecard::JudgedClaim],
    missing: &[String],
    truth: Option<&Truth>,
) -> Result<String, ReportError> {
    let quantities =
        |row: &'p RobotParameterRow| row.quantities().map(move |quantity| (row, quantity));
    let page = Page {
        version: env!("CARGO_PKG_VERSION"),
        synthetic: truth.is_some_and(|truth| truth.synthetic),
        fits: tables.fits.len(),
        figures: drawn.len(),
        pages,
        common: common(tables),
        troubled: troubled(tables),
        fit_notes: fit_notes(tables),
        checks: &tables.checks,
        missing,
        campaigns: campaigns::sections(input, tables, drawn),
        comparisons: images(drawn, |figure| {
            figure.campaigns.len() > 1 && figure.stem != figures::TRUTH
        }),
        releases: images(drawn, |figure| figure.campaigns.is_empty()),
        recovered: images(drawn, |figure| figure.stem == figures::TRUTH),
        robots: tables.robots.iter().flat_map(quantities).collect(),
        trials: &tables.trials,
        truth: truth.map(|truth| truth::compare(truth, tables)),
        scorecard: scores,
        raw: relative(&input.paths.reports, &input.paths.raw),
        derived: relative(&input.paths.reports, &input.paths.derived),
        input: tables.input.as_deref(),
        configuration: input.configuration(),
    };
    fill("index.html", INDEX, &page).map_err(ReportError::Page)
}

fn images<'p>(drawn: &'p [Drawn<'_>], is_wanted: impl Fn(&Figure) -> bool) -> Vec<&'p Image> {
    let wanted = drawn.iter().filter(|drawn| is_wanted(drawn.figure));
    wanted.map(|drawn| &drawn.image).collect()
}
