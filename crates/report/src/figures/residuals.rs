//! What every model misses of every trial.

use minijinja::context;
use trilink_base::numbers::fixed;
use trilink_mechanics::Model;
use trilink_plot::{Figure, Layer, Layout, Look, Panel, Range};
use trilink_statistics::Estimate;
use trilink_statistics::HALF_WIDTH_95;
use trilink_tables::{PredictionRow, PredictionSource, TrialRow, TrialStatus};

use super::common::OMEGA;
use super::texts::texts;
use crate::looks;
use crate::series::{Quantity, SAME_FREQUENCY, Source, fitted};

/// A model that misses more than this many times what the nearest one does is not shown whole.
const FARTHEST: f64 = 6.0;
/// What a panel has room for if models miss so much, %.
const LEAST: f64 = 60.0;

/// Residuals of a campaign's models in per cent of what was measured.
pub(super) fn figure(stem: &str, campaign: &str, source: Source<'_>) -> Figure {
    let quantities = fitted();
    let panels = quantities.iter().filter_map(|quantity| panel(quantity, campaign, source));
    let texts = texts("residuals", context! { campaign });
    Figure::new(stem, texts, &[campaign], Layout::Grid, panels.collect())
}

fn panel(quantity: &Quantity, campaign: &str, source: Source<'_>) -> Option<Panel> {
    let trials: Vec<&TrialRow> = source
        .measured_trials(campaign)
        .filter(|trial| quantity.of_trial(trial, source.sigma).value.is_finite())
        .collect();
    let mut by_omega = trials.clone();
    by_omega.retain(|trial| trial.omega_rad_s.is_finite());
    by_omega.sort_by(|a, b| a.omega_rad_s.total_cmp(&b.omega_rad_s));
    let missed = |model: Model| {
        let rows = source.predicted(campaign, model, PredictionSource::Trial);
        let point = |row: &PredictionRow| {
            let measured = quantity.of_trial(nearest(&by_omega, row)?, source.sigma).value;
            let residual = quantity.of(&row.metrics) / measured - 1.0;
            Some((row.omega_rad_s, 100.0 * residual))
        };
        let stable = rows.filter(|row| row.status.is_stable());
        let mut points: Vec<(f64, f64)> = stable.filter_map(point).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let residuals = points.iter().map(|(_, residual)| *residual);
        let farthest = residuals.max_by(|a, b| a.abs().total_cmp(&b.abs()))?;
        Some((model, points, farthest))
    };
    // Models without skid say nothing of it.
    let says = |model: &Model| !quantity.is_skid() || source.skids(*model);
    let models = source.models(campaign).into_iter().filter(says);
    let residuals: Vec<_> = models.filter_map(missed).collect();
    let nearest_model = Range::of(residuals.iter().map(|(_, _, farthest)| farthest.abs()))?.low;
    let limit = (FARTHEST * nearest_model).max(LEAST);
    let mut beyond = residuals.clone();
    beyond.retain(|(_, _, farthest)| farthest.abs() > limit);
    beyond.sort_by(|a, b| b.2.abs().total_cmp(&a.2.abs()));
    let most = beyond.first().map_or(String::new(), |(_, _, farthest)| fixed(*farthest, 0));
    let beyond = match beyond.as_slice() {
        [] => String::new(),
        [(model, ..)] => format!("{model} to {most} %"),
        several => format!("{} models to {most} %", several.len()),
    };
    let error = |trial: &TrialRow| {
        let Estimate { value, se } = quantity.of_trial(trial, source.sigma);
        100.0 * HALF_WIDTH_95 * se / value
    };
    let bars = |(name, look, flagged): (&str, Look, bool)| {
        let is_one = |trial: &&&TrialRow| {
            error(trial).is_finite() && flagged == (trial.status == TrialStatus::Flagged)
        };
        let known: Vec<&&TrialRow> = trials.iter().filter(is_one).collect();
        let errors = known.iter().map(|trial| (trial.omega_rad_s, 0.0, error(trial)));
        let mut layer = Layer::with_errors(name, errors, look);
        layer.trials = known.iter().map(|trial| trial.trial.clone()).collect();
        (!flagged || !layer.points.is_empty()).then_some(layer)
    };
    let bars_of =
        [("measured", looks::measured(0), false), ("flagged", looks::flagged(0), true)].map(bars);
    let mut layers: Vec<Layer> = bars_of.into_iter().flatten().collect();
    layers.extend(
        residuals
            .into_iter()
            .map(|(model, points, _)| Layer::new(model.name(), points, source.look(model).line())),
    );
    Some(Panel {
        shown: Some(Range { low: -limit, high: limit }),
        beyond,
        ..Panel::new(quantity.symbol, OMEGA, "Residual (%)", layers)
    })
}

/// The trial that a prediction is of: of those by rising frequency the first of the nearest to its
/// frequency, which is that of a trial.
fn nearest<'t>(trials: &[&'t TrialRow], row: &PredictionRow) -> Option<&'t TrialRow> {
    let distance = |trial: &TrialRow| (trial.omega_rad_s - row.omega_rad_s).abs();
    let above = trials.partition_point(|trial| trial.omega_rad_s < row.omega_rad_s);
    let below = trials[..above].last().map_or(0.0, |trial| trial.omega_rad_s);
    let below = trials[..above].partition_point(|trial| trial.omega_rad_s < below);
    let around = [trials.get(below), trials.get(above)].into_iter().flatten().copied();
    let nearest = around.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    (distance(nearest) < SAME_FREQUENCY * row.omega_rad_s).then_some(nearest)
}
