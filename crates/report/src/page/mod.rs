//! HTML pages: `index.html`, which is a single self-contained file, and a page for each trial.

mod campaigns;
mod engine;
mod image;
mod optima;
mod parts;
mod shared;
mod trial;

use std::collections::{BTreeMap, BTreeSet};

use minijinja::context;
use minijinja::value::{Serde, Value};

pub use engine::fill;
pub use image::image;
pub use shared::shared_fit_sentence;
pub(crate) use trial::{html as trial_html, neighbours};

use trilink_base::files::relative;
use trilink_plot::Figure;
use trilink_statistics::Estimate;
use trilink_tables::config::{SigmaKind, Smoothing};
use trilink_tables::{CheckRow, CommonCause, Severity, TrialRow, TrialStatus};

use self::parts::{Parts, WheelNames};
use super::Changes;
use super::scorecard::JudgedClaim;
use super::tables::Tables;
use super::truth::{self, Truth};
use super::{ReportError, ReportInput, figures};

/// File names of the trial pages in `trials/`, keyed by trial name.
pub(crate) type TrialPages = BTreeMap<String, String>;

/// Figure with the template values that embed it in the page.
pub(crate) type Drawn<'f> = (&'f Figure, Value);

/// Content of the report page that does not come from the tables.
pub(crate) struct Remarks<'r> {
    /// Sentences that explain what is missing from the report.
    pub missing: &'r [String],
    pub truth: Option<&'r Truth>,
    /// Changes in the results since the baseline; `None` if there is no baseline.
    pub changes: Option<&'r Changes>,
}

/// Returns the numbers and anchors of the figures that correspond to a figure of the paper, in the paper's order.
fn paper_figures(drawn: &[Drawn<'_>]) -> BTreeMap<u32, String> {
    let numbered = drawn.iter().filter_map(|(figure, _)| {
        let number = figures::number(&figure.stem);
        Some((number.strip_prefix("Fig. ")?.parse().ok()?, figures::id(&figure.stem)))
    });
    numbered.collect()
}

/// Renders the main report page, `index.html`.
///
/// # Errors
/// Returns an error if the template cannot be rendered.
pub(crate) fn html(
    input: &ReportInput,
    tables: &Tables,
    drawn: &[Drawn<'_>],
    pages: &TrialPages,
    scores: &[JudgedClaim],
    Remarks { missing, truth, changes }: Remarks<'_>,
) -> Result<String, ReportError> {
    let robots = tables.robots.iter();
    let robots =
        robots.flat_map(|row| row.quantities().map(move |quantity| (row, quantity, row.basis())));
    // For each trial, the messages of the checks that need attention.
    let mut messages: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for check in tables.checks.iter().filter(|check| check.severity > Severity::Info) {
        let message = Some(check.message.as_str()).filter(|message| !message.is_empty());
        messages.entry(&check.trial).or_default().extend(message);
    }
    // Checks that concern campaigns or folders instead of single trials.
    let trials: BTreeSet<&str> = tables.trials.iter().map(|row| row.trial.as_str()).collect();
    let is_common = |check: &CheckRow| !trials.contains(check.trial.as_str());
    let troubling = tables.checks.iter().filter(|check| check.severity >= Severity::Warning);
    // Number of trials with a finding, for each check.
    let own = troubling.clone().filter(|check| !is_common(check));
    let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
    own.for_each(|row| *reasons.entry(&row.check).or_default() += 1);
    let mut codes: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for check in troubling.clone() {
        codes.entry(&check.trial).or_default().extend(check.check.split(' ').next());
    }
    let parts = Parts::of_trials(&tables.trials, input);
    // Skid ratios are of the kind (raw or debiased) that the fits use.
    let listed = |rows: Vec<&TrialRow>| {
        let listed = rows.into_iter().map(|row| {
            let sigma = row.sigma(input.sigma);
            let sigma: Vec<Estimate> = parts.wheels.iter().map(|wheel| sigma[*wheel]).collect();
            let [alpha_rad, se_rad] = [&row.metrics, &row.metrics_se].map(|of| of.alpha_rad);
            let alpha = parts.joints.iter().map(|of| Estimate::new(alpha_rad[*of], se_rad[*of]));
            let alpha: Vec<Estimate> = alpha.collect();
            Value::from(Serde((row, sigma, alpha, codes.get(&*row.trial))))
        });
        listed.collect::<Vec<_>>()
    };
    let WheelNames { in_head, of_campaigns } = WheelNames::new(&tables.trials, input);
    let (first, folded) = listed_first(&tables.trials);
    // Notes on fits that replace missing data, by campaign.
    let notes = tables.fits.iter().map(|fit| (&fit.campaign, &fit.notes));
    let raw = input.paths.raw.iter().map(|raw| relative(&input.paths.reports, raw));
    let page = context! {
        version => env!("CARGO_PKG_VERSION"),
        synthetic => truth.map_or(String::new(), |truth| truth.notice(tables)),
        fits => tables.fits.len(),
        figures => drawn.len(),
        pages => Serde(pages),
        messages => Serde(messages),
        fit_notes => Serde(notes.filter(|(_, note)| !note.is_empty()).collect::<BTreeSet<_>>()),
        checks => Serde(&tables.checks),
        common => Serde(troubling.filter(|check| is_common(check)).collect::<Vec<_>>()),
        names => trials.len(),
        causes => Serde(
            [TrialStatus::Failed, TrialStatus::Flagged]
                .into_iter()
                .flat_map(|status| CommonCause::find(&tables.trials, status))
                .collect::<Vec<_>>(),
        ),
        missing => Serde(missing),
        changes => Serde(changes),
        campaigns => campaigns::sections(input, (tables, truth), drawn)?,
        shared => shared::sections(tables, input),
        not_shared => Serde(shared::not_tested(input, tables)),
        paper_figures => Serde(paper_figures(drawn)),
        comparisons => images(drawn, |figure| {
            figure.campaigns.len() > 1 && figure.stem != figures::TRUTH
        }),
        releases => images(drawn, |figure| figure.campaigns.is_empty()),
        recovered => images(drawn, |figure| figure.stem == figures::TRUTH),
        robots => Serde(robots.collect::<Vec<_>>()),
        decays => Serde(tables.robots.iter().map(|row| (row, row.laws())).collect::<Vec<_>>()),
        trials => Serde(&tables.trials),
        trials_first => listed(first),
        trials_folded => listed(folded),
        parts => parts.heads(&in_head),
        wheel_names => Serde(of_campaigns),
        subject => subject(tables, input),
        has_chains => has_chains(tables, input),
        debiased => input.sigma == SigmaKind::Debiased,
        kalman => input.smoothing() == Smoothing::Kalman,
        truth => truth.map(|truth| truth::compare(truth, tables, input)),
        scorecard => Serde(scores),
        of_the_paper => !scores.is_empty(),
        reasons => Serde(reasons.into_iter().collect::<Vec<_>>()),
        raw => Serde(raw.collect::<Vec<_>>()),
        derived => relative(&input.paths.reports, &input.paths.derived),
        input => &tables.input,
        configuration => input.configuration(),
    };
    fill("index.html", include_str!("index.html"), &page).map_err(ReportError::Page)
}

/// Returns whether a campaign in the tables has a chain.
fn has_chains(tables: &Tables, input: &ReportInput) -> bool {
    let trials = tables.trials.iter().map(|row| &row.campaign);
    let mut campaigns = trials.chain(tables.fits.iter().map(|fit| &fit.campaign));
    campaigns.any(|campaign| input.is_chain(campaign))
}

/// Returns a noun phrase for the robots of the report.
fn subject(tables: &Tables, input: &ReportInput) -> &'static str {
    if !has_chains(tables, input) {
        return "a wheeled three-link robot";
    }
    let robots = tables.trials.iter().filter_map(|row| input.robot_name(&row.campaign));
    match robots.collect::<BTreeSet<_>>().len() {
        1 => "a wheeled robot",
        _ => "wheeled robots",
    }
}

/// Maximum number of trials in the table that is not folded.
const MAX_LISTED: usize = 100;

/// Returns the trials of the table that is not folded and those of the folded one. If there are many trials, the first
/// table contains only failed and flagged trials, failed ones first.
fn listed_first(trials: &[TrialRow]) -> (Vec<&TrialRow>, Vec<&TrialRow>) {
    if trials.len() <= MAX_LISTED {
        return (trials.iter().collect(), Vec::new());
    }
    let of = |status| trials.iter().filter(move |row| row.status == status);
    let mut first: Vec<&TrialRow> =
        of(TrialStatus::Failed).chain(of(TrialStatus::Flagged)).collect();
    let mut folded = first.split_off(first.len().min(MAX_LISTED));
    folded.extend(of(TrialStatus::Ok));
    (first, folded)
}

/// Renders the scorecard page. `synthetic` is the notice that trials are synthetic; it is empty if none are.
///
/// # Errors
/// Returns an error if the template cannot be rendered.
pub(crate) fn scorecard_html(
    scores: &[JudgedClaim],
    synthetic: &str,
) -> Result<String, ReportError> {
    let page = context! {
        version => env!("CARGO_PKG_VERSION"),
        synthetic,
        scorecard => Serde(scores),
    };
    let page = fill("scorecard-page.html", include_str!("scorecard-page.html"), &page);
    page.map_err(ReportError::Page)
}

/// Returns the template values of the figures for which `is_wanted` returns true.
fn images(drawn: &[Drawn<'_>], is_wanted: impl Fn(&Figure) -> bool) -> Vec<Value> {
    let wanted = drawn.iter().filter(|(figure, _)| is_wanted(figure));
    wanted.map(|(_, image)| image.clone()).collect()
}
