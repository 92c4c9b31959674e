//! Page on one trial: `trials/<trial>.html`.

use minijinja::context;
use minijinja::value::{Serde, Value};
use serde::Serialize;
use trilink_mechanics::Model;
use trilink_robot::metrics::Metric;
use trilink_statistics::Estimate;
use trilink_tables::{CheckRow, Fill, JointGait, RobotParameterRow, RobotQuantity, TrialRow};

use super::parts::Parts;
use super::{TrialPages, fill};
use crate::figures::subscripted;
use crate::recording::Recording;
use crate::replay::Replay;
use crate::series::{Quantity, fitted};
use crate::tables::Tables;
use crate::{ReportError, ReportInput};

/// Renders the page on a trial. Without a recording, the page shows only the trial's results and checks.
///
/// # Errors
/// Returns an error if the template cannot be rendered.
pub(crate) fn html(
    trial: &TrialRow,
    (tables, input): (&Tables, &ReportInput),
    pages: &TrialPages,
    is_synthetic: bool,
    recording: Option<&Recording>,
    replay: Option<&Replay>,
    figures: &[Value],
) -> Result<String, ReportError> {
    let robots = tables.robots.iter().filter(|row| row.trial == trial.trial);
    let basis: Vec<String> = robots.clone().map(RobotParameterRow::basis).collect();
    let quantities: Vec<RobotQuantity> = robots.flat_map(RobotParameterRow::quantities).collect();
    let checks = tables.checks.iter().filter(|check| check.trial == trial.trial);
    let (models, predicted) = predicted(trial, tables, input);
    let parts = Parts::of_cycles(trial, recording, input);
    let links = input.links(&trial.campaign);
    let page = context! {
        version => env!("CARGO_PKG_VERSION"),
        synthetic => if is_synthetic { "This trial is synthetic." } else { "" },
        trial => Serde(trial),
        rate_hz => recording.and_then(Recording::rate_hz),
        neighbours => Serde(neighbours(trial, tables, pages)),
        quantities => Serde(quantities),
        basis => basis,
        models => models.iter().map(|model| model.name()).collect::<Vec<_>>(),
        predicted => Serde(predicted),
        figures => figures,
        replay => replay.map(|replay| replay.value(&format!("Motion of trial {}", trial.trial))),
        gaps => Serde(recording.map(|recording| gaps(recording, trial, input))),
        parts => parts.heads(&links),
        cycles => Serde(recording.map(|recording| parts.cycles(recording))),
        skid_and_amplitudes => Serde(skid_and_amplitudes(trial, &links)),
        gait => Serde(gait(trial)),
        checks => Serde(checks.collect::<Vec<&CheckRow>>()),
    };
    fill("trial.html", include_str!("trial.html"), &page).map_err(ReportError::Page)
}

/// Returns the names and page files of the trials before and after `trial` in the order of frequency, among the trials
/// of the same campaign and kind that have a page; `None` where there is no such trial.
pub(crate) fn neighbours<'t>(
    trial: &TrialRow,
    tables: &'t Tables,
    pages: &'t TrialPages,
) -> [Option<(&'t str, &'t str)>; 2] {
    let with_page = tables.trials.iter().filter_map(|other| {
        let is_of = (&other.campaign, other.kind) == (&trial.campaign, trial.kind);
        let (name, page) = pages.get_key_value(&other.trial).filter(|_| is_of)?;
        Some((name.as_str(), page.as_str()))
    });
    let all: Vec<(&str, &str)> = with_page.collect();
    let Some(own) = all.iter().position(|(name, _)| *name == trial.trial) else { return [None; 2] };
    [own.checked_sub(1), Some(own + 1)].map(|nth| all.get(nth?).copied())
}

/// Quantity measured in a trial, with the predictions of all models.
#[derive(Debug, Serialize)]
struct Predicted {
    symbol: &'static str,
    unit: &'static str,
    measured: Estimate,
    of_models: Vec<Option<Prediction>>,
}

/// Prediction of a quantity by a model.
#[derive(Debug, Serialize)]
struct Prediction {
    value: f64,
    /// Predicted minus measured value, divided by the standard error of the measured value.
    in_errors: f64,
    /// Status of the predicted motion if the prediction has no value; otherwise `None`.
    status: Option<&'static str>,
}

/// Returns the models that have predictions for a trial, and the predicted quantities.
///
/// Models without skid do not predict skid ratios, and the amplitude of joint 1 is included only if this joint is
/// passive.
fn predicted(
    trial: &TrialRow,
    tables: &Tables,
    input: &ReportInput,
) -> (Vec<Model>, Vec<Predicted>) {
    let source = tables.source(input);
    let models = source.models(&trial.campaign).into_iter();
    let rows = models.filter_map(|model| source.of_trial(trial, model)).collect::<Vec<_>>();
    let free = input.free_joints(&trial.campaign);
    let is_chain = input.is_chain(&trial.campaign);
    let shown =
        fitted().filter(|metric| match Metric::ALPHA.iter().position(|alpha| alpha == metric) {
            Some(joint) if joint == 0 || is_chain => free.contains(&joint),
            _ => metric.is_of_three_links() || trial.metrics[*metric].is_finite(),
        });
    let of_quantity = shown.map(Quantity::new).map(|quantity| {
        let measured = quantity.of_trial(trial, source.sigma);
        let of_model = rows.iter().map(|row| {
            let is_stable = row.status.is_stable();
            let value = if is_stable { quantity.of(&row.metrics) } else { f64::NAN };
            let in_errors = (value - measured.value) / measured.se;
            let status = (!is_stable).then(|| row.status.name());
            let has_value = !quantity.is_skid() || source.skids(row.model);
            has_value.then_some(Prediction { value, in_errors, status })
        });
        let symbol = quantity.symbol;
        let unit = quantity.unit();
        Predicted { symbol, unit, measured, of_models: of_model.collect() }
    });
    (rows.iter().map(|row| row.model).collect(), of_quantity.collect())
}

/// Row of the table of results: name, value, standard error (0 if unknown) and unit.
type Row = (String, f64, f64, &'static str);

/// Returns the rows with the skid ratios, also corrected for noise, and the amplitudes of the joints; `links` are the
/// names of the links by number.
fn skid_and_amplitudes(trial: &TrialRow, links: &[String]) -> Vec<Row> {
    let TrialRow { metrics, metrics_se, .. } = trial;
    let link = |wheel: usize| links.get(wheel).map_or(format!("link {wheel}"), String::clone);
    let symbol = |wheel: usize| subscripted('σ', wheel);
    let skid = (0..).zip(metrics.sigma).zip(metrics_se.sigma).map(|((wheel, value), se)| {
        let link = link(wheel);
        let wheel_of = if link.contains("link") {
            format!("wheel of {link}")
        } else {
            format!("{link} wheel")
        };
        (format!("{}, {wheel_of}", symbol(wheel)), value, se, "")
    });
    let debiased = (0..).zip(trial.all_debiased()).map(|(wheel, Estimate { value, se })| {
        (format!("{}, {}, corrected for noise", symbol(wheel), link(wheel)), value, se, "")
    });
    let amplitudes = (1..).zip(metrics.alpha_rad).zip(metrics_se.alpha_rad);
    let amplitudes = amplitudes.map(|((joint, value), se)| {
        (subscripted('α', joint), value.to_degrees(), se.to_degrees(), "deg")
    });
    skid.chain(debiased).chain(amplitudes).collect()
}

/// Returns the rows with the measured gait of the joints.
fn gait(trial: &TrialRow) -> Vec<Row> {
    let rows = (1..).zip(trial.joints()).flat_map(
        |(joint, JointGait { offset_rad, amplitude_rad, .. })| {
            let symbol = subscripted('φ', joint);
            [("Offset", offset_rad), ("Amplitude", amplitude_rad)]
                .map(|(name, rad)| (format!("{name} of {symbol}"), rad.to_degrees(), 0.0, "deg"))
        },
    );
    rows.collect()
}

/// Returns, for each link, its name, the fractions of frames in which the pose is measured, found from other markers,
/// interpolated and missing, and the duration (s) of the longest span without a pose (`None` if there is none).
fn gaps(
    recording: &Recording,
    trial: &TrialRow,
    input: &ReportInput,
) -> Vec<(String, [f64; 4], Option<f64>)> {
    let step_s = match recording.time_s.as_slice() {
        [first, second, ..] => second - first,
        _ => f64::NAN,
    };
    let names =
        if input.is_chain(&trial.campaign) { input.links(&trial.campaign) } else { Vec::new() };
    let links = recording.fill.iter().enumerate().map(|(link, fill)| {
        let missing = fill.chunk_by(|a, b| a == b).filter(|run| run[0] == Fill::Missing);
        let longest_s = missing.map(|run| run.len() as f64 * step_s).max_by(f64::total_cmp);
        let shares = Fill::ALL.map(|kind| {
            fill.iter().filter(|fill| **fill == kind).count() as f64 / fill.len().max(1) as f64
        });
        let name = names.get(link).map_or(String::new(), |name| format!(": {name}"));
        (format!("{link}{name}"), shares, longest_s)
    });
    links.collect()
}
