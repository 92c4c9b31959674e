//! `index.html`, one file with everything in it, and a page for each trial.

mod campaigns;
mod engine;
mod image;
mod trial;

use std::collections::BTreeMap;

use base64::Engine;
use serde::Serialize;

pub use engine::{fill, texts};
pub use image::Image;
pub use trial::html as trial_html;

use super::drawing::{self, Figure};
use super::numbers::{NONE, as_configured, fixed, significant, with_error};
use super::places::relative;
use super::tables::Tables;
use super::truth::{self, Comparison, Truth};
use super::warnings::{CheckCount, Trouble, check_counts, troubled};
use super::{ReportError, figures, scorecard};
use crate::report::ReportInput;
use crate::store::{RobotParameterRow, TrialRow, TrialStatus};

/// Trials' names, and the files of their pages in `trials/`.
pub type TrialPages = BTreeMap<String, String>;

const INDEX: &str = include_str!("index.html");

/// A drawn figure.
pub struct Drawn<'f> {
    pub figure: &'f Figure,
    pub svg: String,
}

#[derive(Serialize)]
struct Page<'p> {
    version: &'static str,
    synthetic: bool,
    counts: Counts,
    troubled: Vec<Trouble<'p>>,
    checks: Vec<CheckCount<'p>>,
    missing: &'p [String],
    campaigns: Vec<campaigns::CampaignSection<'p>>,
    comparisons: Vec<FigureView<'p>>,
    robots: Vec<RobotView<'p>>,
    /// Figures of joints that were let go.
    releases: Vec<FigureView<'p>>,
    trials: Vec<TrialGroup<'p>>,
    truth: Option<Comparison>,
    /// Figures of planted truth.
    recovered: Vec<FigureView<'p>>,
    scorecard: scorecard::View<'p>,
    raw: String,
    derived: String,
    /// Fingerprint of the trials, if their table has one.
    input: Option<&'p str>,
    /// As TOML, with paths as seen from the page.
    configuration: String,
}

#[derive(Serialize)]
struct Counts {
    trials: usize,
    ok: usize,
    flagged: usize,
    failed: usize,
    fits: usize,
    figures: usize,
}

#[derive(Serialize)]
struct FigureView<'p> {
    stem: &'p str,
    number: &'p str,
    title: &'p str,
    caption: &'p str,
    alternative: String,
    /// The SVG.
    image_base64: String,
    width: u32,
    height: u32,
    /// Whether its files lie in `figures/`.
    files: bool,
    /// Whether it needs the whole width of the page.
    wide: bool,
}

/// A measured parameter of a robot.
#[derive(Serialize)]
struct RobotView<'p> {
    robot: &'p str,
    trial: &'p str,
    name: &'static str,
    unit: &'static str,
    measured: String,
    configured: String,
}

/// Trials of one campaign, or of one kind where they belong to no campaign.
#[derive(Serialize)]
struct TrialGroup<'p> {
    name: &'p str,
    trials: Vec<TrialView<'p>>,
}

#[derive(Serialize)]
struct TrialView<'p> {
    trial: &'p str,
    /// File of its own page in `trials/`.
    page: Option<&'p str>,
    omega_commanded: String,
    omega: String,
    d_mm: String,
    v_mm_s: String,
    sigma: [String; 3],
    cycles: i64,
    coverage: String,
    residual: String,
    status: TrialStatus,
}

/// The page as HTML.
///
/// # Errors
/// The template cannot be filled in.
pub fn html(
    config: &ReportInput,
    tables: &Tables,
    drawn: &[Drawn<'_>],
    pages: &TrialPages,
    scores: &[scorecard::Entry],
    missing: &[String],
    truth: Option<&Truth>,
) -> Result<String, ReportError> {
    let with_status = |status| tables.trials.iter().filter(|row| row.status == status).count();
    let page = Page {
        version: env!("CARGO_PKG_VERSION"),
        synthetic: truth.is_some_and(|truth| truth.synthetic),
        counts: Counts {
            trials: tables.trials.len(),
            ok: with_status(TrialStatus::Ok),
            flagged: with_status(TrialStatus::Flagged),
            failed: with_status(TrialStatus::Failed),
            fits: tables.fits.len(),
            figures: drawn.len(),
        },
        troubled: troubled(tables, pages),
        checks: check_counts(&tables.checks),
        missing,
        campaigns: campaigns::sections(config, tables, drawn),
        comparisons: views(drawn, |figure| {
            figure.campaigns.len() > 1 && figure.stem != figures::TRUTH
        }),
        releases: views(drawn, |figure| figure.campaigns.is_empty()),
        recovered: views(drawn, |figure| figure.stem == figures::TRUTH),
        robots: tables.robots.iter().flat_map(robot_views).collect(),
        trials: trial_groups(&tables.trials, pages),
        truth: truth.map(|truth| truth::compare(truth, tables)),
        scorecard: scorecard::View::new(scores),
        raw: relative(&config.paths.reports, &config.paths.raw),
        derived: relative(&config.paths.reports, &config.paths.derived),
        input: tables.input.as_deref(),
        configuration: config.configuration(),
    };
    engine::fill("index.html", INDEX, &page).map_err(ReportError::Page)
}

fn views<'p>(drawn: &'p [Drawn<'_>], is_wanted: impl Fn(&Figure) -> bool) -> Vec<FigureView<'p>> {
    let wanted = drawn.iter().filter(|drawn| is_wanted(drawn.figure));
    wanted.map(|drawn| figure_view(drawn, true)).collect()
}

/// A drawn figure as a page shows it; `files` if it lies in `figures/` too.
fn figure_view<'p>(drawn: &'p Drawn<'_>, files: bool) -> FigureView<'p> {
    let (width, height) = drawing::size(drawn.figure);
    FigureView {
        files,
        wide: width > drawing::style::WIDTH,
        stem: &drawn.figure.stem,
        number: &drawn.figure.number,
        title: &drawn.figure.title,
        caption: &drawn.figure.caption,
        alternative: drawn.figure.text_alternative(),
        image_base64: base64::engine::general_purpose::STANDARD.encode(&drawn.svg),
        width: width.round() as u32,
        height: height.round() as u32,
    }
}

fn robot_views(row: &RobotParameterRow) -> impl Iterator<Item = RobotView<'_>> {
    row.quantities().map(|quantity| RobotView {
        robot: &row.robot,
        trial: &row.trial,
        name: quantity.name,
        unit: quantity.unit,
        measured: with_error(quantity.measured.value, quantity.measured.se),
        configured: as_configured(quantity.configured),
    })
}

fn trial_groups<'p>(trials: &'p [TrialRow], pages: &'p TrialPages) -> Vec<TrialGroup<'p>> {
    fn name(row: &TrialRow) -> &str {
        if row.campaign.is_empty() { row.kind.name() } else { &row.campaign }
    }
    let groups = trials.chunk_by(|a, b| name(a) == name(b));
    groups
        .map(|rows| TrialGroup {
            name: name(&rows[0]),
            trials: rows.iter().map(|row| trial_view(row, pages)).collect(),
        })
        .collect()
}

fn trial_view<'p>(row: &'p TrialRow, pages: &'p TrialPages) -> TrialView<'p> {
    TrialView {
        trial: &row.trial,
        page: pages.get(&row.trial).map(String::as_str),
        omega_commanded: as_configured(row.omega_commanded_rad_s),
        omega: significant(row.omega_rad_s, 4),
        d_mm: with_error(1e3 * row.metrics.d_m, 1e3 * row.metrics_se.d_m),
        v_mm_s: with_error(1e3 * row.metrics.v_m_s, 1e3 * row.metrics_se.v_m_s),
        sigma: row.metrics.sigma.map(|sigma| fixed(sigma, 4)),
        cycles: row.cycles,
        coverage: match fixed(100.0 * row.coverage, 1) {
            none if none == NONE => none,
            percent => format!("{percent} %"),
        },
        residual: significant(row.residual_mm, 2),
        status: row.status,
    }
}
