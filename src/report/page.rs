//! `index.html`: one file with everything in it.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use base64::Engine;
use minijinja::syntax::SyntaxConfig;
use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior};
use serde::Serialize;

use super::figure::Figure;
use super::numbers::{NONE, as_configured, fixed, significant, with_error};
use super::parameters::{self, Parameter};
use super::tables::Tables;
use super::truth::{self, Comparison, Truth};
use super::{ReportError, figures};
use crate::config::Config;
use crate::store::{CheckRow, FitRow, TrialRow};

/// The name's ending makes the engine escape what it fills in.
const TEMPLATE: &str = "page.html";

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
    trials: Vec<TrialView<'p>>,
    truth: Option<Comparison>,
    raw: String,
    derived: String,
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

/// A trial that needs a person.
#[derive(Serialize)]
struct Trouble<'p> {
    trial: &'p str,
    status: &'p str,
    messages: Vec<&'p str>,
}

#[derive(Serialize)]
struct CheckCount<'p> {
    check: &'p str,
    warnings: usize,
    errors: usize,
    trials: String,
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
    best: Option<String>,
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
struct ParameterView {
    value: String,
    free: bool,
    marks: Vec<&'static str>,
}

#[derive(Serialize)]
struct TrialView<'p> {
    trial: &'p str,
    campaign: &'p str,
    kind: &'p str,
    omega_commanded: String,
    omega: String,
    d_mm: String,
    v_mm_s: String,
    sigma: [String; 3],
    cycles: i64,
    coverage: String,
    residual: String,
    status: &'p str,
    message: &'p str,
}

/// The page as HTML.
///
/// # Errors
/// The template cannot be filled in.
pub fn html(
    config: &Config,
    tables: &Tables,
    drawn: &[Drawn<'_>],
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
        troubled: troubled(tables),
        checks: check_counts(&tables.checks),
        missing,
        campaigns: campaign_sections(config, tables, drawn),
        comparisons: drawn
            .iter()
            .filter(|drawn| drawn.figure.campaigns.len() > 1)
            .map(figure_view)
            .collect(),
        trials: tables.trials.iter().map(trial_view).collect(),
        truth: truth.map(|truth| truth::compare(truth, tables)),
        raw: relative(&config.paths.reports, &config.paths.raw),
        derived: relative(&config.paths.reports, &config.paths.derived),
    };
    let mut environment = Environment::new();
    let syntax = SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build();
    environment.set_syntax(syntax.map_err(ReportError::Page)?);
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.add_template(TEMPLATE, include_str!("page.html")).map_err(ReportError::Page)?;
    let template = environment.get_template(TEMPLATE).map_err(ReportError::Page)?;
    template.render(Serde(&page)).map_err(ReportError::Page)
}

/// Failed trials first.
fn troubled(tables: &Tables) -> Vec<Trouble<'_>> {
    let with = |status: &'static str| {
        tables.trials.iter().filter(move |row| row.status == status).map(|row| {
            let checks = tables.checks.iter().filter(|check| check.trial == row.trial);
            let mut messages: Vec<&str> = checks
                .filter(|check| check.severity != "ok" && !check.message.is_empty())
                .map(|check| check.message.as_str())
                .collect();
            // A trial's message may be the checks' messages in one line.
            let said = messages.iter().any(|message| row.message.contains(message));
            if !row.message.is_empty() {
                if said {
                    messages.clear();
                }
                messages.insert(0, &row.message);
            }
            Trouble { trial: &row.trial, status: &row.status, messages }
        })
    };
    with("failed").chain(with("flagged")).collect()
}

fn check_counts(checks: &[CheckRow]) -> Vec<CheckCount<'_>> {
    let mut by_check: BTreeMap<&str, Vec<&CheckRow>> = BTreeMap::new();
    for check in checks.iter().filter(|check| check.severity != "ok") {
        by_check.entry(&check.check).or_default().push(check);
    }
    let count = |rows: &[&CheckRow], severity: &str| {
        rows.iter().filter(|row| row.severity == severity).count()
    };
    by_check
        .into_iter()
        .map(|(check, rows)| {
            let mut trials: Vec<&str> = rows.iter().map(|row| row.trial.as_str()).collect();
            trials.dedup();
            let errors = count(&rows, "error");
            let warnings = rows.len() - errors;
            CheckCount { check, warnings, errors, trials: trials.join(", ") }
        })
        .collect()
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
        CampaignSection {
            name,
            robot: setup.map(|campaign| campaign.robot.as_str()),
            gait: setup.map(|campaign| campaign.gait.as_str()),
            trials: tables.trials.iter().filter(|row| row.campaign == name).count(),
            figures: drawn
                .iter()
                .filter(|drawn| drawn.figure.campaigns == [name])
                .map(figure_view)
                .collect(),
            passive: fits.iter().any(|fit| fit.damping_nm_s_rad.is_finite()),
            best: best(&fits),
            notes: not_drawn(tables, name),
            fits: fits.into_iter().map(fit_view).collect(),
        }
    };
    let sections = names.into_iter().map(section);
    sections.filter(|s| s.trials > 0 || !s.fits.is_empty() || !s.figures.is_empty()).collect()
}

/// The sentence on which model is nearest to the measurements.
fn best(fits: &[&FitRow]) -> Option<String> {
    let mut ranked: Vec<&&FitRow> = fits.iter().filter(|fit| fit.j.is_finite()).collect();
    ranked.sort_by(|a, b| a.j.total_cmp(&b.j));
    let (first, rest) = ranked.split_first()?;
    let second = rest.first().map_or(String::new(), |second| {
        format!(", followed by {} with {}", second.model, significant(second.j, 4))
    });
    Some(format!(
        "Nearest to the measurements: {} with J = {}{second}.",
        first.model,
        significant(first.j, 4)
    ))
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

fn figure_view<'p>(drawn: &'p Drawn<'_>) -> FigureView<'p> {
    let (width, height) = drawn.size;
    FigureView {
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
        value: match parameter.free {
            true => significant(parameter.value, 4),
            false => as_configured(parameter.value),
        },
        free: parameter.free,
        marks: truth::marks(*parameter),
    };
    let parameters = parameters::of_fit(fit).map(|parameter| view(&parameter));
    let mut parameters = parameters.into_iter();
    FitView {
        model: &fit.model,
        j: significant(fit.j, 4),
        skid: parameters.by_ref().take(3).collect(),
        roll: parameters.by_ref().take(3).collect(),
        joint: parameters.collect(),
        starts: fit.starts,
        solves: fit.solves,
        status: &fit.status,
    }
}

fn trial_view(row: &TrialRow) -> TrialView<'_> {
    TrialView {
        trial: &row.trial,
        campaign: &row.campaign,
        kind: &row.kind,
        omega_commanded: significant(row.omega_commanded_rad_s, 3),
        omega: with_error(row.omega_rad_s, row.omega_rad_s_se),
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
        message: &row.message,
    }
}

/// `to` as seen from the folder `from`; as it is where one of them is absolute and the other
/// not, or where `from` climbs.
fn relative(from: &Path, to: &Path) -> String {
    let plain = |path: &Path| -> PathBuf {
        path.components().filter(|part| *part != Component::CurDir).collect()
    };
    let (from, to) = (plain(from), plain(to));
    let common = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let rest: Vec<_> = from.components().skip(common).collect();
    let climbs = rest.iter().any(|part| !matches!(part, Component::Normal(_)));
    let path = if climbs || from.is_absolute() != to.is_absolute() {
        to
    } else {
        rest.iter().map(|_| Component::ParentDir).chain(to.components().skip(common)).collect()
    };
    path.to_string_lossy().replace('\\', "/")
}

#[cfg(test)]
mod tests {
    use super::relative;
    use std::path::Path;

    #[test]
    fn places_are_named_as_seen_from_the_page() {
        let from_to = |from, to| relative(Path::new(from), Path::new(to));
        assert_eq!(from_to("reports", "derived"), "../derived");
        assert_eq!(from_to("./a/reports", "a/raw/demo"), "../raw/demo");
        assert_eq!(from_to("/data/x/reports", "/data/x/derived"), "../derived");
        assert_eq!(from_to("../reports", "derived"), "derived");
    }
}
