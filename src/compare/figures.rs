//! Figures of the differences between the compared runs, with their tolerances.

use std::collections::BTreeSet;

use trilink_plot::{Figure, Layer, Layout, Panel};
use trilink_report::trends;
use trilink_robot::metrics::{Metric, MetricDefinition};
use trilink_statistics::HALF_WIDTH_95;

use super::means::campaigns;
use super::snapshot::{Record, Records, Snapshot, number, text};
use super::{ComparisonResult, Difference};

/// Legend label of the tolerances.
const TOLERANCE: &str = "no change, with the tolerance around it";
/// Legend labels of the differences within and out of tolerance.
const CHANGES: [&str; 2] = ["this run minus baseline (bars: 95 %)", "out of tolerance"];

/// Differences between the candidate run and the baseline run against frequency: metrics of a campaign's trials, or
/// predictions of a model.
struct Curves<'s> {
    compared: &'s ComparisonResult,
    runs: [&'s Records; 2],
    campaign: &'s str,
    /// Model of the predictions; `None` for trials.
    model: Option<&'s str>,
}

/// Draws a figure for each campaign and each model that has values out of tolerance.
pub(super) fn figures(
    compared: &ComparisonResult,
    baseline: &Snapshot,
    candidate: &Snapshot,
) -> Vec<Figure> {
    let [trials, predictions] =
        ["trials", "predictions"].map(|table| [baseline.records(table), candidate.records(table)]);
    let mut figures = Vec::new();
    for campaign in trials.into_iter().flat_map(campaigns).collect::<BTreeSet<&str>>() {
        let curves = Curves { compared, runs: trials, campaign, model: None };
        let of_means = compared.out().filter(|of| of.table == "campaigns" && of.row == campaign);
        let mut columns: BTreeSet<&str> = of_means.map(metric_column).collect();
        columns.extend(curves.differences().filter(|of| of.is_out()).map(metric_column));
        figures.extend(curves.figure(format!("Trials of {campaign}"), &columns));
        let records = predictions.into_iter().flat_map(Records::values);
        let of_campaign = records.filter(|record| text(record, "campaign") == campaign);
        let models: BTreeSet<&str> = of_campaign.map(|record| text(record, "model")).collect();
        for model in models {
            let curves = Curves { compared, runs: predictions, campaign, model: Some(model) };
            let out = curves.differences().filter(|of| of.is_out());
            let mut columns: BTreeSet<&str> = out.map(metric_column).collect();
            let fit = format!("{campaign} {model}");
            if compared.out().any(|of| of.table == "fits" && of.row == fit) {
                columns.insert(Metric::D.column());
                columns.extend(Metric::SIGMA.map(Metric::column));
            }
            figures.extend(curves.figure(format!("Model {model} of {campaign}"), &columns));
        }
    }
    figures
}

/// Returns the column of a difference; for a debiased skid ratio, the column of the raw one.
fn metric_column(difference: &Difference) -> &str {
    difference.column.trim_end_matches("_debiased")
}

impl<'s> Curves<'s> {
    fn table(&self) -> &'static str {
        if self.model.is_some() { "predictions" } else { "trials" }
    }

    /// Returns whether a record belongs to these curves.
    fn holds(&self, record: &Record) -> bool {
        text(record, "campaign") == self.campaign
            && self.model.is_none_or(|model| text(record, "model") == model)
    }

    /// Returns the differences in rows of these curves.
    fn differences(&self) -> impl Iterator<Item = &'s Difference> {
        self.compared.differences.iter().filter(|difference| {
            let mut rows = self.runs.iter().filter_map(|run| run.get(&difference.row));
            difference.table == self.table() && rows.any(|record| self.holds(record))
        })
    }

    /// Returns the differences in a metric, debiased if there are such values, with their frequencies, sorted by
    /// frequency.
    fn points(&self, of: &MetricDefinition) -> Vec<(f64, &'s Difference)> {
        let omega = if self.model.is_some() { "omega_rad_s" } else { "omega_commanded_rad_s" };
        let has = |column: &&str| self.differences().any(|of| of.column == *column);
        let column = of.debiased.filter(has).unwrap_or(of.column);
        let own = self.differences().filter(|difference| difference.column == column);
        let points = own.filter_map(|difference| {
            Some((number(self.runs[1].get(&difference.row)?, omega)?, difference))
        });
        let mut points: Vec<_> = points.collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    }

    /// Draws a figure with a panel for each of the `columns`; returns `None` if there is nothing to draw.
    fn figure(&self, title: String, columns: &BTreeSet<&str>) -> Option<Figure> {
        let metrics = Metric::ALL.into_iter().map(Metric::definition);
        let metrics = metrics.filter(|of| columns.contains(of.column));
        let panels =
            metrics.map(|of| (of, self.points(of))).filter(|(_, points)| !points.is_empty());
        let panels = panels.map(|(of, points)| {
            let factor = of.dimension.shown_per_unit();
            let zero = points.iter().map(|(omega, _)| (*omega, 0.0));
            let band = points.iter().map(|(_, difference)| {
                let limit = factor * difference.judgement.limit.unwrap_or(f64::NAN);
                [-limit, limit]
            });
            let band = band.collect();
            let changes = CHANGES.into_iter().zip([trends::RUN, trends::OUT]).zip([false, true]);
            let changes = changes.map(|((name, look), is_out)| {
                let own = points.iter().filter(|(_, difference)| difference.is_out() == is_out);
                let changes = own.filter_map(|(omega, difference)| {
                    let change = difference.candidate.as_f64()? - difference.baseline.as_f64()?;
                    let errors = difference.judgement.errors.filter(|errors| *errors > 0.0);
                    let error = HALF_WIDTH_95 * change.abs() / errors.unwrap_or(f64::NAN);
                    Some(((*omega, factor * change, factor * error), difference.row.clone()))
                });
                let (points, trials): (Vec<_>, Vec<_>) = changes.unzip();
                Layer { trials, ..Layer::with_errors(name, points, look) }
            });
            let tolerance = Layer { band, ..Layer::new(TOLERANCE, zero, trends::BASELINE) };
            let changes = changes.filter(|layer| !layer.points.is_empty());
            let layers = [tolerance].into_iter().chain(changes).collect();
            let label = of.dimension.with_shown_unit(&format!("Change in {}", of.symbol));
            Panel::new(of.in_words(), "ω (rad/s)", label, layers)
        });
        let texts = [title, String::new()];
        let figure = Figure::new("", texts, &[self.campaign], Layout::Grid, panels.collect());
        (!figure.is_empty()).then_some(figure)
    }
}
