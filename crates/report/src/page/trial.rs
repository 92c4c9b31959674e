//! The page of one trial: `trials/<trial>.html`.

use minijinja::context;
use minijinja::value::{Serde, Value};
use serde::Serialize;
use trilink_mechanics::Model;
use trilink_robot::metrics::Metric;
use trilink_statistics::Estimate;
use trilink_tables::{CheckRow, Fill, RobotParameterRow, RobotQuantity, TrialRow};

use super::{TrialPages, fill};
use crate::recording::Recording;
use crate::replay::Replay;
use crate::series::fitted;
use crate::tables::Tables;
use crate::{ReportError, ReportInput};

/// The page as HTML; without a recording it shows the trial's row and checks.
///
/// # Errors
/// The template cannot be filled in.
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
    let quantities: Vec<RobotQuantity> = robots.flat_map(RobotParameterRow::quantities).collect();
    let checks = tables.checks.iter().filter(|check| check.trial == trial.trial);
    let (models, predicted) = predicted(trial, tables, input);
    let page = context! {
        version => env!("CARGO_PKG_VERSION"),
        synthetic => if is_synthetic { "This trial is synthetic." } else { "" },
        trial => Serde(trial),
        rate_hz => recording.and_then(Recording::rate_hz),
        beside => Serde(neighbours(trial, tables, pages)),
        quantities => Serde(quantities),
        models => models.iter().map(|model| model.name()).collect::<Vec<_>>(),
        predicted => Serde(predicted),
        figures => figures,
        replay => replay.map(|replay| replay.value(&format!("Motion of trial {}", trial.trial))),
        gaps => Serde(recording.map(gaps)),
        cycles => Serde(recording.map(|recording| &recording.cycles)),
        checks => Serde(checks.collect::<Vec<&CheckRow>>()),
    };
    fill("trial.html", include_str!("trial.html"), &page).map_err(ReportError::Page)
}

/// The trials before and after one among those of its campaign by frequency, and their pages.
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

/// A quantity of a trial beside what every model says of it.
#[derive(Debug, Serialize)]
struct Predicted {
    symbol: &'static str,
    unit: &'static str,
    measured: Estimate,
    of_models: Vec<Option<OfModel>>,
}

#[derive(Debug, Serialize)]
struct OfModel {
    value: f64,
    /// Less what was measured, in standard errors.
    in_errors: f64,
    /// Why there is no value.
    status: Option<&'static str>,
}

/// The models that predict something of a trial, and what they say of each quantity. Models without
/// skid say nothing of skid ratios, and the amplitude is a result only where the joint is passive.
fn predicted(
    trial: &TrialRow,
    tables: &Tables,
    input: &ReportInput,
) -> (Vec<Model>, Vec<Predicted>) {
    let source = tables.source(input);
    let models = source.models(&trial.campaign).into_iter();
    let rows = models.filter_map(|model| source.of_trial(trial, model)).collect::<Vec<_>>();
    let passive = input.campaign_setup(&trial.campaign).and_then(|(_, gait)| gait.passive_joint());
    let shown = fitted().into_iter().filter(|of| of.metric != Metric::Alpha1 || passive == Some(0));
    let of_quantity = shown.map(|quantity| {
        let measured = quantity.of_trial(trial, source.sigma);
        let of_model = rows.iter().map(|row| {
            let is_stable = row.status.is_stable();
            let value = if is_stable { quantity.of(&row.metrics) } else { f64::NAN };
            let in_errors = (value - measured.value) / measured.se;
            let status = (!is_stable).then(|| row.status.name());
            let says = !quantity.is_skid() || source.skids(row.model);
            says.then_some(OfModel { value, in_errors, status })
        });
        let (symbol, unit) = (quantity.symbol, quantity.unit());
        Predicted { symbol, unit, measured, of_models: of_model.collect() }
    });
    (rows.iter().map(|row| row.model).collect(), of_quantity.collect())
}

/// Of every link, the parts of its frames that are measured, from other markers, interpolated and
/// missing, and how long it is missing at most, s.
fn gaps(recording: &Recording) -> [([f64; 4], Option<f64>); 3] {
    let step_s = match recording.time_s.as_slice() {
        [first, second, ..] => second - first,
        _ => f64::NAN,
    };
    recording.fill.each_ref().map(|fill| {
        let frames = |of: Fill| fill.iter().filter(|fill| **fill == of).count();
        let part = |of: Fill| frames(of) as f64 / fill.len().max(1) as f64;
        let missing = fill.chunk_by(|a, b| a == b).filter(|run| run[0] == Fill::Missing);
        let longest_s = missing.map(|run| run.len() as f64 * step_s).max_by(f64::total_cmp);
        (Fill::ALL.map(part), longest_s)
    })
}
