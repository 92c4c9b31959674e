//! Figure of the residuals of every model for every trial.

use minijinja::context;
use trilink_base::numbers::fixed;
use trilink_mechanics::Model;
use trilink_plot::{Figure, Layer, Layout, Panel, Range};
use trilink_robot::metrics::Metric;
use trilink_statistics::Estimate;
use trilink_statistics::HALF_WIDTH_95;
use trilink_tables::{PredictionRow, PredictionSource, TrialRow, TrialStatus};

use super::common::OMEGA;
use super::texts::texts;
use crate::looks;
use crate::series::{Quantity, SAME_FREQUENCY, Source, fitted};

/// Largest residual shown in a panel, as a multiple of the largest residual of the best-fitting model.
const MAX_HEIGHT: f64 = 6.0;
/// Residual up to which values are never cut off, %.
const MIN_HEIGHT: f64 = 60.0;

/// Returns the figure of the residuals of a campaign's models, in per cent of the measured values.
pub(super) fn figure(stem: &str, campaign: &str, source: Source<'_>) -> Figure {
    let links = source.links(campaign);
    let is_chain = source.input.is_chain(campaign);
    let free = source.input.free_joints(campaign);
    let metrics = fitted().filter(|metric| {
        let joint = Metric::ALPHA.iter().position(|alpha| alpha == metric);
        !is_chain || joint.is_none_or(|joint| free.contains(&joint))
    });
    let quantities: Vec<Quantity> =
        metrics.map(|metric| Quantity::of_links(metric, &links)).collect();
    let panels = quantities.iter().filter_map(|quantity| panel(quantity, campaign, source));
    let texts = texts("residuals", context! { campaign });
    Figure::new(stem, texts, &[campaign], Layout::Grid, panels.collect())
}

/// Returns the panel with the residuals of a quantity; `None` if there are no predictions.
fn panel(quantity: &Quantity, campaign: &str, source: Source<'_>) -> Option<Panel> {
    let trials: Vec<&TrialRow> = source
        .measured_trials(campaign)
        .filter(|trial| quantity.of_trial(trial, source.sigma).value.is_finite())
        .collect();
    let mut by_omega = trials.clone();
    by_omega.retain(|trial| trial.omega_rad_s.is_finite());
    by_omega.sort_by(|a, b| a.omega_rad_s.total_cmp(&b.omega_rad_s));
    let residuals_of = |model: Model| {
        let rows = source.predicted(campaign, model, PredictionSource::Trial);
        let stable = rows.filter(|row| row.status.is_stable());
        let mut points: Vec<(f64, f64)> = stable
            .filter_map(|row| {
                let measured = quantity.of_trial(nearest(&by_omega, row)?, source.sigma).value;
                let residual = quantity.of(&row.metrics) / measured - 1.0;
                Some((row.omega_rad_s, 100.0 * residual))
            })
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let residuals = points.iter().map(|(_, residual)| *residual);
        let farthest = residuals.max_by(|a, b| a.abs().total_cmp(&b.abs()))?;
        Some((model, points, farthest))
    };
    // Models without skid predict no skid ratios.
    let models = source
        .models(campaign)
        .into_iter()
        .filter(|model| !quantity.is_skid() || source.skids(*model));
    let residuals: Vec<_> = models.filter_map(residuals_of).collect();
    let best_fitting =
        Range::enclosing(residuals.iter().map(|(_, _, farthest)| farthest.abs()))?.low;
    let limit = (MAX_HEIGHT * best_fitting).max(MIN_HEIGHT);
    let mut beyond = residuals.clone();
    beyond.retain(|(_, _, farthest)| farthest.abs() > limit);
    beyond.sort_by(|a, b| b.2.abs().total_cmp(&a.2.abs()));
    let largest = beyond.first().map_or(String::new(), |(_, _, farthest)| fixed(*farthest, 0));
    let beyond = match beyond.as_slice() {
        [] => String::new(),
        [(model, ..)] => format!("{model} off the scale, to {largest} %"),
        several => format!("{} off the scale, to {largest} %", several.len()),
    };
    let error = |trial: &TrialRow| {
        let Estimate { value, se } = quantity.of_trial(trial, source.sigma);
        100.0 * HALF_WIDTH_95 * se / value
    };
    let bars_of = [("flagged", looks::flagged(0), true), ("measured", looks::measured(0), false)]
        .map(|(name, look, flagged)| {
            let known: Vec<&&TrialRow> = trials
                .iter()
                .filter(|trial| {
                    error(trial).is_finite() && flagged == (trial.status == TrialStatus::Flagged)
                })
                .collect();
            let errors = known.iter().map(|trial| (trial.omega_rad_s, 0.0, error(trial)));
            let mut layer = Layer::with_errors(name, errors, look);
            layer.trials = known.iter().map(|trial| trial.trial.clone()).collect();
            (!flagged || !layer.points.is_empty()).then_some(layer)
        });
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

/// Returns the trial whose frequency is closest to that of a prediction (the first trial if several have this
/// frequency); `None` if no trial has nearly the same frequency. `trials` must be sorted by frequency.
fn nearest<'t>(trials: &[&'t TrialRow], row: &PredictionRow) -> Option<&'t TrialRow> {
    let distance = |trial: &TrialRow| (trial.omega_rad_s - row.omega_rad_s).abs();
    let above = trials.partition_point(|trial| trial.omega_rad_s < row.omega_rad_s);
    let below = trials[..above].last().map_or(0.0, |trial| trial.omega_rad_s);
    let below = trials[..above].partition_point(|trial| trial.omega_rad_s < below);
    let around = [trials.get(below), trials.get(above)].into_iter().flatten().copied();
    let nearest = around.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    (distance(nearest) < SAME_FREQUENCY * row.omega_rad_s).then_some(nearest)
}
