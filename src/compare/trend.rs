//! The page `history.html`: trends of the figures of merit with the tolerance around the accepted baseline.

use std::collections::BTreeMap;

use serde_json::{Value as Json, json};
use trilink_base::numbers::{percent, significant};
use trilink_plot::{Figure, Layer, Layout, Look, Panel, Scale};
use trilink_report::{colours, fill, image, notice_of_folders, trends};
use trilink_tables::config::{Compare, Config, Tolerance, tolerance};
use trilink_tables::write_bytes;

use super::CompareError;
use super::history::{ACCEPTED, HistoryRow, MEAN};
use super::judge::limit;
use super::runs::Runs;
use super::steps::{Step, find_steps};

/// File name of the history page.
pub(super) const PAGE: &str = "history.html";
/// Maximum number of runs that are drawn with markers and error bars.
const MAX_MARKERS: usize = 40;

/// Time series of a figure of merit.
struct Series<'r> {
    rows: Vec<&'r HistoryRow>,
    /// Tolerance for changes from run to run, if one is configured.
    tolerance: Option<Tolerance>,
    steps: Vec<Step>,
}

/// Writes the history page.
///
/// # Errors
/// Returns an error if a figure cannot be drawn or the page cannot be written.
pub(super) fn write(config: &Config, rows: &[HistoryRow]) -> Result<(), CompareError> {
    let runs = Runs::new(rows);
    // The key sorts figures of merit of whole runs, which have no campaign, last.
    let mut groups: BTreeMap<(bool, &str), Vec<Series>> = BTreeMap::new();
    let mut known: BTreeMap<[&str; 3], usize> = BTreeMap::new();
    for row in rows.iter().filter(|row| row.is_measured()) {
        let group = groups.entry((row.campaign.is_empty(), &row.campaign)).or_default();
        let names = [&row.campaign, &row.model, &row.quantity].map(String::as_str);
        let index = *known.entry(names).or_insert(group.len());
        if index == group.len() {
            let tolerance = tolerance_of(&config.compare, row);
            group.push(Series { rows: Vec::new(), tolerance, steps: Vec::new() });
        }
        group[index].rows.push(row);
    }
    groups.values_mut().flatten().for_each(Series::find_steps);
    let mut steps: BTreeMap<i64, Vec<Json>> = BTreeMap::new();
    for series in groups.values().flatten() {
        for step in &series.steps {
            steps.entry(series.rows[step.index].run).or_default().push(series.sentence(step));
        }
    }
    let steps = steps.iter().rev().map(|(run, steps)| {
        json!({ "run": run, "date": runs.date(*run), "why": runs.changes(*run), "steps": steps })
    });
    let synthetic = notice_of_folders(&config.paths);
    let is_synthetic = !synthetic.is_empty();
    let groups = groups.iter();
    let groups = groups.map(|((_, campaign), series)| group(campaign, series, &runs, is_synthetic));
    let accepted = rows.iter().filter(|row| row.quantity == ACCEPTED).rev();
    let accepted = accepted.map(|row| {
        json!({ "run": row.run, "time": &*row.time, "why": row.note, "out": row.value.to_string() })
    });
    let page = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "synthetic": synthetic,
        "groups": groups.collect::<Result<Vec<_>, _>>()?,
        "steps": steps.collect::<Vec<_>>(),
        "accepted": accepted.collect::<Vec<_>>(),
        "runs": runs.rows(),
    });
    let html = fill(PAGE, include_str!("history.html"), &page)
        .map_err(|error| CompareError::File { file: PAGE, message: error.to_string() })?;
    write_bytes(&config.paths.reports.join(PAGE), html.as_bytes())?;
    Ok(())
}

/// Returns the configured tolerance for comparisons of a figure of merit.
fn tolerance_of(config: &Compare, row: &HistoryRow) -> Option<Tolerance> {
    let tolerance = if row.model.is_empty() {
        let column = row.quantity.strip_prefix(MEAN)?;
        tolerance(&config.campaigns, column).or_else(|| tolerance(&config.trials, column))
    } else {
        tolerance(&config.fits, &row.quantity)
    };
    tolerance.filter(Tolerance::judges)
}

impl<'r> Series<'r> {
    fn name(&self) -> String {
        let HistoryRow { model, quantity, .. } = self.rows[0];
        if model.is_empty() { quantity.clone() } else { format!("{model}: {quantity}") }
    }

    fn find_steps(&mut self) {
        let values: Vec<f64> = self.rows.iter().map(|row| row.value).collect();
        self.steps = find_steps(&values, |index, before| {
            let error = self.rows[index].value_se.hypot(self.rows[index - 1].value_se);
            limit(self.tolerance?, before, error)
        });
    }

    /// Returns the values from which the history page forms the sentence about a step in this figure of merit.
    fn sentence(&self, step: &Step) -> Json {
        let Step { index, before, after } = *step;
        let row = self.rows[index];
        json!({
            "name": self.name(),
            "campaign": row.campaign,
            "verb": if after > before { "rose" } else { "fell" },
            "by": percent(after, before).trim_start_matches(['+', '\u{2212}']),
            "from": significant(before, 5),
            "to": significant(after, 5),
        })
    }

    /// Returns the accepted baselines, each with the rows from its acceptance up to the next acceptance.
    fn baselines(&self, runs: &Runs) -> Vec<(&'r HistoryRow, &[&'r HistoryRow])> {
        let accepted: Vec<usize> =
            (0..self.rows.len()).filter(|i| runs.accepted.contains(&self.rows[*i].run)).collect();
        let ends = accepted.iter().skip(1).map(|next| next + 1).chain([self.rows.len()]);
        accepted
            .iter()
            .zip(ends)
            .map(|(from, to)| (self.rows[*from], &self.rows[*from..to]))
            .collect()
    }

    /// Returns the largest difference between `row` and `baseline` that is within tolerance; `None` if there is no
    /// tolerance or if it depends on an unknown standard error.
    fn limit(&self, baseline: &HistoryRow, row: &HistoryRow) -> Option<f64> {
        limit(self.tolerance?, baseline.value, baseline.value_se.hypot(row.value_se))
    }

    /// Returns the relative change since the last baseline, and the run since which all runs have been out of
    /// tolerance, if there is one; `None` without a baseline.
    fn since_baseline(&self, runs: &Runs) -> Option<Json> {
        let (baseline, rows) = *self.baselines(runs).last()?;
        let out = rows.iter().rev().take_while(|row| self.is_out(baseline, row)).last();
        let change = percent(rows.last()?.value, baseline.value);
        Some(json!({ "change": change, "out": out.map(|row| row.run) }))
    }

    /// Returns whether the value in `row` differs from the baseline by more than the tolerance.
    fn is_out(&self, baseline: &HistoryRow, row: &HistoryRow) -> bool {
        let distance = self.tolerance.map(|of| of.distance([baseline.value, row.value]));
        let limit = self.limit(baseline, row);
        distance.zip(limit).is_some_and(|(distance, limit)| distance > limit)
    }

    fn panel(&self, runs: &Runs) -> Panel {
        let x = |row: &HistoryRow| row.run as f64;
        let points = || self.rows.iter().map(|row| (x(row), row.value));
        let trials: Vec<String> = self.rows.iter().map(|row| runs.name(row.run)).collect();
        let mut layers = Vec::new();
        let mut levels = Vec::new();
        let mut band = Vec::new();
        let baselines = self.baselines(runs);
        for (index, (baseline, rows)) in baselines.iter().enumerate() {
            // The line of the last baseline extends a little beyond the last run.
            let is_last = index + 1 == baselines.len();
            let beyond = rows.last().filter(|_| is_last).map(|row| (x(row) + 0.4, *row));
            for (x, row) in rows.iter().map(|row| (x(row), *row)).chain(beyond) {
                let limit = self.limit(baseline, row).unwrap_or(f64::NAN);
                levels.push([x, baseline.value]);
                band.push([baseline.value - limit, baseline.value + limit]);
            }
            levels.push([f64::NAN; 2]);
            band.push([f64::NAN; 2]);
        }
        if !levels.is_empty() {
            let levels = levels.into_iter().map(|[x, y]| (x, y));
            layers.push(Layer { band, ..Layer::new(BASELINE, levels, trends::BASELINE) });
        }
        let is_many = runs.count() > MAX_MARKERS;
        let dots = Look::Dots { colour: colours::TREND, joined: !is_many };
        if is_many {
            if self.rows.iter().any(|row| row.upper > row.lower) {
                let band = self.rows.iter().map(|row| [row.lower, row.upper]).collect();
                layers.push(Layer { band, ..Layer::new(INTERVAL, points(), trends::TREND) });
            }
            layers.push(Layer { trials, ..Layer::new(RUN, points(), dots) });
        } else {
            layers.push(Layer::new("", points(), dots));
            let with_bars =
                self.rows.iter().map(|row| (x(row), row.value, 0.5 * (row.upper - row.lower)));
            let look = trends::RUN;
            layers.push(Layer { trials, ..Layer::with_errors(RUN, with_bars, look) });
        }
        let accepted = runs.accepted.iter().map(|run| (*run as f64, f64::NAN));
        layers.push(Layer::new("accepted", accepted, Look::Guides));
        let rings = self.steps.iter().map(|step| self.rows[step.index]);
        layers.push(Layer::new("step", rings.map(|row| (x(row), row.value)), Look::Rings));
        let panel = Panel::new(self.name(), "run", &*self.rows[0].quantity, layers);
        let x_names = runs.labels().to_vec();
        Panel { x_scale: Scale::Whole, y_scale: Scale::Decades, x_names, ..panel }
    }
}

/// Legend label of the baseline.
const BASELINE: &str = "accepted baseline and tolerance";
/// Legend label of the confidence intervals.
const INTERVAL: &str = "95 % interval";
/// Legend label of the values.
const RUN: &str = "run";

/// Returns the figure and the table for a campaign, or for the figures of merit of whole runs.
fn group(
    campaign: &str,
    series: &[Series],
    runs: &Runs,
    is_synthetic: bool,
) -> Result<Json, CompareError> {
    let name =
        if campaign.is_empty() { "Whole runs".to_owned() } else { format!("Campaign {campaign}") };
    let panels = series.iter().map(|series| series.panel(runs)).collect();
    let texts = [format!("{name}, run by run"), String::new()];
    let layout = if runs.count() > MAX_MARKERS { Layout::Pairs } else { Layout::Grid };
    let figure = Figure { is_synthetic, ..Figure::new("", texts, &[campaign], layout, panels) };
    let rows = series.iter().filter_map(|series| {
        let (now, earlier) = series.rows.split_last()?;
        Some(json!({
            "name": series.name(),
            "last": significant(now.value, 5),
            "since_last": change(earlier.last().copied(), now),
            "since_first": change(series.rows.first().copied(), now),
            "since_baseline": series.since_baseline(runs),
        }))
    });
    let rows: Vec<Json> = rows.collect();
    Ok(json!({ "name": name, "figure": image(&figure)?, "rows": rows }))
}

/// Formats the relative change since an earlier run; empty if there is no earlier run.
fn change(then: Option<&HistoryRow>, now: &HistoryRow) -> String {
    match then {
        Some(then) if then.run < now.run => percent(now.value, then.value),
        _ => String::new(),
    }
}
