//! `index.html`, one file with everything in it, and a page for each trial.

mod engine;
mod image;
mod trial;

use std::collections::BTreeMap;

use base64::Engine;
use serde::Serialize;

pub use engine::{fill, texts};
pub use image::Image;
pub use trial::html as trial_html;

use super::figure::Figure;
use super::numbers::{NONE, as_configured, fixed, significant, with_error};
use super::parameters::{self, Parameter};
use super::places::relative;
use super::tables::Tables;
use super::truth::{self, Comparison, Truth};
use super::warnings::{CheckCount, Trouble, check_counts, troubled};
use super::{ReportError, figures, scorecard};
use crate::config::Config;
use crate::store::{ComparisonRow, FitRow, RobotParameterRow, TrialRow};

/// Trials' names, and the files of their pages in `trials/`.
pub type TrialPages = BTreeMap<String, String>;

const INDEX: &str = include_str!("index.html");

/// A drawn figure.
pub struct Drawn<'f> {
    pub figure: &'f Figure,
    pub svg: String,
    /// Width and height, px.
    pub size: (f64, f64),
}

#[derive(Serialize)]
struct Page<'p> {
    version: &'static str,
    synthetic: bool,
    counts: Counts,
    troubled: Vec<Trouble<'p>>,
    checks: Vec<CheckCount<'p>>,
    missing: &'p [String],
    campaigns: Vec<CampaignSection<'p>>,
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
struct CampaignSection<'p> {
    name: &'p str,
    robot: Option<&'p str>,
    gait: Option<&'p str>,
    trials: usize,
    figures: Vec<FigureView<'p>>,
    fits: Vec<FitView<'p>>,
    /// Whether a model of it has a passive joint.
    passive: bool,
    /// Which model the measurements prefer.
    best: Option<&'p str>,
    comparison: Vec<ComparisonView<'p>>,
    /// Fits with the other gait input, and which that is.
    otherwise: Option<Otherwise<'p>>,
    notes: Vec<String>,
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

#[derive(Serialize)]
struct FitView<'p> {
    model: &'p str,
    j: String,
    skid: Vec<ParameterView>,
    roll: Vec<ParameterView>,
    joint: Vec<ParameterView>,
    starts: i64,
    solves: i64,
    status: &'p str,
}

#[derive(Serialize)]
struct ComparisonView<'p> {
    model: &'p str,
    j: String,
    /// Of d, v, sigma, alpha.
    parts: [String; 4],
    left_out: String,
    free: i64,
    criterion: String,
    wins: String,
}

#[derive(Serialize)]
struct Otherwise<'p> {
    gait_input: &'p str,
    rows: Vec<OtherwiseRow<'p>>,
}

#[derive(Serialize)]
struct OtherwiseRow<'p> {
    model: &'p str,
    j: String,
    other_j: String,
    /// Of the wheels; as the other input gives them.
    skid: [String; 3],
}

#[derive(Serialize)]
struct ParameterView {
    value: String,
    free: bool,
    /// 95 % confidence interval.
    interval: String,
    marks: Vec<&'static str>,
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
    status: &'p str,
}

/// The page as HTML.
///
/// # Errors
/// The template cannot be filled in.
pub fn html(
    config: &Config,
    tables: &Tables,
    drawn: &[Drawn<'_>],
    pages: &TrialPages,
    scores: &[scorecard::Entry],
    missing: &[String],
    truth: Option<&Truth>,
) -> Result<String, ReportError> {
    let with_status =
        |status: &str| tables.trials.iter().filter(|row| row.status == status).count();
    let page = Page {
        version: env!("CARGO_PKG_VERSION"),
        synthetic: truth.is_some_and(|truth| truth.synthetic),
        counts: Counts {
            trials: tables.trials.len(),
            ok: with_status("ok"),
            flagged: with_status("flagged"),
            failed: with_status("failed"),
            fits: tables.fits.len(),
            figures: drawn.len(),
        },
        troubled: troubled(tables, pages),
        checks: check_counts(&tables.checks),
        missing,
        campaigns: campaign_sections(config, tables, drawn),
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
        configuration: configuration(config),
    };
    engine::fill("index.html", INDEX, &page).map_err(ReportError::Page)
}

/// The whole configuration, defaults too.
fn configuration(config: &Config) -> String {
    let mut config = config.clone();
    let reports = config.paths.reports.clone();
    for path in [&mut config.paths.raw, &mut config.paths.derived, &mut config.paths.reports] {
        *path = relative(&reports, path).into();
    }
    toml::to_string(&config).unwrap_or_default()
}

fn campaign_sections<'p>(
    config: &'p Config,
    tables: &'p Tables,
    drawn: &'p [Drawn<'_>],
) -> Vec<CampaignSection<'p>> {
    let mut names: Vec<&str> = tables.campaigns(config).into_iter().collect();
    let rank = |name: &str| {
        let paper = figures::PAPER_CAMPAIGNS;
        paper.iter().position(|&known| known == name).unwrap_or(paper.len())
    };
    names.sort_by_key(|&name| (rank(name), name));
    let section = |name: &'p str| {
        let fits: Vec<&FitRow> = tables.fits.iter().filter(|fit| fit.campaign == name).collect();
        let setup = config.campaign.get(name);
        let of_campaign = tables.comparison.iter().filter(|row| row.campaign == name);
        let compared: Vec<&ComparisonRow> = of_campaign.collect();
        CampaignSection {
            name,
            robot: setup.map(|campaign| campaign.robot.as_str()),
            gait: setup.map(|campaign| campaign.gait.as_str()),
            trials: tables.trials.iter().filter(|row| row.campaign == name).count(),
            figures: views(drawn, |figure| {
                figure.campaigns == [name] && figure.stem != figures::TRUTH
            }),
            passive: fits.iter().any(|fit| fit.damping_nm_s_rad.is_finite()),
            best: compared.first().map(|row| row.sentence.as_str()),
            comparison: compared.iter().map(|row| comparison_view(row)).collect(),
            otherwise: otherwise(&compared),
            notes: remarks(tables, name),
            fits: fits.into_iter().map(fit_view).collect(),
        }
    };
    let sections = names.into_iter().map(section);
    sections.filter(|s| s.trials > 0 || !s.fits.is_empty() || !s.figures.is_empty()).collect()
}

/// What is to be said of a campaign's predictions: those that the figures leave out, and those
/// that the robot does not get into from rest.
fn remarks(tables: &Tables, campaign: &str) -> Vec<String> {
    let mut remarks = not_drawn(tables, campaign);
    let mut counts: BTreeMap<(usize, &str, &str), usize> = BTreeMap::new();
    for row in tables.predictions.iter().filter(|row| row.campaign == campaign) {
        if matches!(row.from_rest.as_str(), "another" | "unsettled") {
            let rank = super::style::model_rank(&row.model);
            *counts.entry((rank, &row.model, &row.from_rest)).or_default() += 1;
        }
    }
    remarks.extend(counts.iter().map(|((_, model, from_rest), count)| {
        let goes = match *from_rest {
            "another" => "gets into another motion than the one that is shown",
            _ => "does not settle",
        };
        let at = if *count == 1 { "frequency" } else { "frequencies" };
        format!("{model}: at {count} {at} of the trials the robot that starts from rest {goes}.")
    }));
    remarks
}

/// Predictions that the figures leave out, by model and reason.
fn not_drawn(tables: &Tables, campaign: &str) -> Vec<String> {
    let mut counts: BTreeMap<(usize, &str, &str, &str), usize> = BTreeMap::new();
    for row in tables.predictions.iter().filter(|row| row.campaign == campaign) {
        let rank = super::style::model_rank(&row.model);
        *counts.entry((rank, &row.model, &row.source, &row.status)).or_default() += 1;
    }
    let total = |model: &str, source: &str| -> usize {
        let of = counts.iter().filter(|(key, _)| key.1 == model && key.2 == source);
        of.map(|(_, count)| count).sum()
    };
    counts
        .iter()
        .filter(|((_, _, _, status), _)| *status != "stable")
        .map(|((_, model, source, status), count)| {
            let total = total(model, source);
            let at = if *source == "trial" { "the trials' frequencies" } else { "the curve" };
            format!("{model}: {count} of {total} points of {at} are not drawn, status {status}.")
        })
        .collect()
}

fn views<'p>(drawn: &'p [Drawn<'_>], is_wanted: impl Fn(&Figure) -> bool) -> Vec<FigureView<'p>> {
    let wanted = drawn.iter().filter(|drawn| is_wanted(drawn.figure));
    wanted.map(|drawn| figure_view(drawn, true)).collect()
}

/// A drawn figure as a page shows it; `files` if it lies in `figures/` too.
fn figure_view<'p>(drawn: &'p Drawn<'_>, files: bool) -> FigureView<'p> {
    let (width, height) = drawn.size;
    FigureView {
        files,
        wide: width > super::style::WIDTH,
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

fn fit_view(fit: &FitRow) -> FitView<'_> {
    let view = |parameter: &Parameter| ParameterView {
        value: parameter.text(),
        free: parameter.free,
        interval: parameter.interval(),
        marks: parameter.marks(),
    };
    let parameters = parameters::of_fit(fit).map(|parameter| view(&parameter));
    let mut parameters = parameters.into_iter();
    FitView {
        model: &fit.model,
        j: significant(fit.j, 4),
        skid: parameters.by_ref().take(3).collect(),
        roll: parameters.by_ref().take(3).collect(),
        // The sum of the roll coefficients is not shown.
        joint: parameters.skip(1).collect(),
        starts: fit.starts,
        solves: fit.solves,
        status: &fit.status,
    }
}

fn comparison_view(row: &ComparisonRow) -> ComparisonView<'_> {
    let wins = fixed(100.0 * row.wins, 1);
    ComparisonView {
        model: &row.model,
        j: significant(row.j, 4),
        parts: [row.j_d, row.j_v, row.j_sigma, row.j_alpha].map(|part| significant(part, 3)),
        left_out: significant(row.j_left_out, 4),
        free: row.free,
        criterion: fixed(row.criterion, 1),
        wins: if wins == NONE { wins } else { format!("{wins} %") },
    }
}

/// What the other gait input than the configured one gives.
fn otherwise<'p>(rows: &[&'p ComparisonRow]) -> Option<Otherwise<'p>> {
    let with = |row: &&&ComparisonRow| row.other_gait_j.is_finite();
    let gait_input = rows.iter().find(with)?.other_gait_input.as_str();
    let view = |row: &&'p ComparisonRow| OtherwiseRow {
        model: &row.model,
        j: significant(row.j, 4),
        other_j: significant(row.other_gait_j, 4),
        skid: [row.other_gait_skid0_kg_s, row.other_gait_skid1_kg_s, row.other_gait_skid2_kg_s]
            .map(|skid| significant(skid, 4)),
    };
    Some(Otherwise { gait_input, rows: rows.iter().filter(with).map(view).collect() })
}

fn robot_views(row: &RobotParameterRow) -> impl Iterator<Item = RobotView<'_>> {
    row.quantities().map(|quantity| RobotView {
        robot: &row.robot,
        trial: &row.trial,
        name: quantity.name,
        unit: quantity.unit,
        measured: with_error(quantity.measured, quantity.se),
        configured: as_configured(quantity.configured),
    })
}

fn trial_groups<'p>(trials: &'p [TrialRow], pages: &'p TrialPages) -> Vec<TrialGroup<'p>> {
    fn name(row: &TrialRow) -> &str {
        if row.campaign.is_empty() { &row.kind } else { &row.campaign }
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
        d_mm: with_error(1e3 * row.d_m, 1e3 * row.d_m_se),
        v_mm_s: with_error(1e3 * row.v_m_s, 1e3 * row.v_m_s_se),
        sigma: [row.sigma0, row.sigma1, row.sigma2].map(|sigma| fixed(sigma, 4)),
        cycles: row.cycles,
        coverage: match fixed(100.0 * row.coverage, 1) {
            none if none == NONE => none,
            percent => format!("{percent} %"),
        },
        residual: significant(row.residual_mm, 2),
        status: &row.status,
    }
}
