//! `history.html`: figures of merit by run, against the tolerance around the accepted baseline.

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
use super::steps::{Step, steps};

/// The page beside the history.
pub(super) const PAGE: &str = "history.html";
/// Of so many runs each has a marker and an error bar.
const MOST_MARKERS: usize = 40;

/// A figure of merit by run.
struct Series<'r> {
    rows: Vec<&'r HistoryRow>,
    /// What is no change of it.
    tolerance: Option<Tolerance>,
    steps: Vec<Step>,
}

/// Writes the page beside the history.
///
/// # Errors
/// A figure cannot be drawn or the page not written.
pub(super) fn write(config: &Config, rows: &[HistoryRow]) -> Result<(), CompareError> {
    let runs = Runs::new(rows);
    // What is of whole runs comes last.
    let mut groups: BTreeMap<(bool, &str), Vec<Series>> = BTreeMap::new();
    let mut known: BTreeMap<[&str; 3], usize> = BTreeMap::new();
    for row in rows.iter().filter(|row| row.is_measured()) {
        let group = groups.entry((row.campaign.is_empty(), &row.campaign)).or_default();
        let of = [&row.campaign, &row.model, &row.quantity].map(String::as_str);
        let index = *known.entry(of).or_insert(group.len());
        if index == group.len() {
            let tolerance = tolerance_of(&config.compare, row);
            group.push(Series { rows: Vec::new(), tolerance, steps: Vec::new() });
        }
        group[index].rows.push(row);
    }
    groups.values_mut().flatten().for_each(Series::find_steps);
    // The last run first.
    let mut found: Vec<(&Series, &Step)> = groups
        .values()
        .flatten()
        .flat_map(|series| series.steps.iter().map(move |step| (series, step)))
        .collect();
    found.sort_by_key(|(series, step)| -series.rows[step.index].run);
    let run_of = |(series, step): &(&Series, &Step)| series.rows[step.index].run;
    let found = found.chunk_by(|a, b| run_of(a) == run_of(b)).map(|of_run| {
        let run = run_of(&of_run[0]);
        let steps: Vec<Json> = of_run.iter().map(|(series, step)| series.sentence(step)).collect();
        json!({ "run": run, "date": runs.date(run), "why": runs.changed(run), "steps": steps })
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
        "steps": found.collect::<Vec<_>>(),
        "accepted": accepted.collect::<Vec<_>>(),
        "runs": runs.rows(),
    });
    let html = fill(PAGE, include_str!("history.html"), &page)
        .map_err(|error| CompareError::File { file: PAGE, message: error.to_string() })?;
    write_bytes(&config.paths.reports.join(PAGE), html.as_bytes())?;
    Ok(())
}

/// The tolerance of a figure of merit, as comparisons have it.
fn tolerance_of(config: &Compare, row: &HistoryRow) -> Option<Tolerance> {
    let of_mean = || {
        let column = row.quantity.strip_prefix(MEAN)?;
        tolerance(&config.campaigns, column).or_else(|| tolerance(&config.trials, column))
    };
    let found = match row.model.is_empty() {
        true => of_mean(),
        false => tolerance(&config.fits, &row.quantity),
    };
    found.filter(Tolerance::judges)
}

impl<'r> Series<'r> {
    fn name(&self) -> String {
        let HistoryRow { model, quantity, .. } = self.rows[0];
        if model.is_empty() { quantity.clone() } else { format!("{model}: {quantity}") }
    }

    fn find_steps(&mut self) {
        let values: Vec<f64> = self.rows.iter().map(|row| row.value).collect();
        let limit = |at: usize, before| {
            let error = self.rows[at].value_se.hypot(self.rows[at - 1].value_se);
            limit(self.tolerance?, before, error)
        };
        self.steps = steps(&values, limit);
    }

    /// A step in words.
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

    /// Values of the baselines that were accepted, each with its row and the rows from there on.
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

    /// What a value may differ by from its baseline's.
    fn limit(&self, baseline: &HistoryRow, row: &HistoryRow) -> Option<f64> {
        limit(self.tolerance?, baseline.value, baseline.value_se.hypot(row.value_se))
    }

    /// Since which run values are out of the last baseline's tolerance, and the change.
    fn since_baseline(&self, runs: &Runs) -> Option<Json> {
        let (baseline, rows) = *self.baselines(runs).last()?;
        let is_out = |row: &&&HistoryRow| {
            let distance = self.tolerance.map(|of| of.distance([baseline.value, row.value]));
            distance
                .zip(self.limit(baseline, row))
                .is_some_and(|(distance, limit)| distance > limit)
        };
        let out = rows.iter().rev().take_while(is_out).last();
        let change = percent(rows.last()?.value, baseline.value);
        Some(json!({ "change": change, "out": out.map(|row| row.run) }))
    }

    fn panel(&self, runs: &Runs) -> Panel {
        let x = |row: &HistoryRow| row.run as f64;
        let points = || self.rows.iter().map(|row| (x(row), row.value));
        let trials: Vec<String> = self.rows.iter().map(|row| runs.name(row.run)).collect();
        let mut layers = Vec::new();
        let (mut levels, mut band) = (Vec::new(), Vec::new());
        let baselines = self.baselines(runs);
        for (nth, (baseline, rows)) in baselines.iter().enumerate() {
            // The last one goes on a little.
            let is_last = nth + 1 == baselines.len();
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
        let is_many = runs.count() > MOST_MARKERS;
        let dots = Look::Dots { colour: colours::TREND, joined: !is_many };
        if is_many {
            if self.rows.iter().any(|row| row.upper > row.lower) {
                let band = self.rows.iter().map(|row| [row.lower, row.upper]).collect();
                layers.push(Layer { band, ..Layer::new(INTERVAL, points(), trends::TREND) });
            }
            layers.push(Layer { trials, ..Layer::new(RUN, points(), dots) });
        } else {
            layers.push(Layer::new("", points(), dots));
            let half = |row: &HistoryRow| 0.5 * (row.upper - row.lower);
            let with_bars = self.rows.iter().map(|row| (x(row), row.value, half(row)));
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

/// What the legend calls the layers.
const BASELINE: &str = "accepted baseline and tolerance";
const INTERVAL: &str = "95 % interval";
const RUN: &str = "run";

/// The figure and the table of a campaign, or of what is of whole runs.
fn group(
    campaign: &str,
    series: &[Series],
    runs: &Runs,
    is_synthetic: bool,
) -> Result<Json, CompareError> {
    let name = match campaign.is_empty() {
        true => "Whole runs".to_owned(),
        false => format!("Campaign {campaign}"),
    };
    let panels = series.iter().map(|series| series.panel(runs)).collect();
    let texts = [format!("{name}, run by run"), String::new()];
    let layout = if runs.count() > MOST_MARKERS { Layout::Pairs } else { Layout::Grid };
    let figure = Figure { is_synthetic, ..Figure::new("", texts, &[campaign], layout, panels) };
    let row = |series: &Series| {
        let mut last = series.rows.iter().rev();
        let (now, then) = (last.next()?, last.next());
        let change = |then: Option<&&HistoryRow>| match then {
            Some(then) if then.run < now.run => percent(now.value, then.value),
            _ => String::new(),
        };
        Some(json!({
            "name": series.name(),
            "last": significant(now.value, 5),
            "since_last": change(then),
            "since_first": change(series.rows.first()),
            "since_baseline": series.since_baseline(runs),
        }))
    };
    let rows: Vec<Json> = series.iter().filter_map(row).collect();
    Ok(json!({ "name": name, "figure": image(&figure)?, "rows": rows }))
}
