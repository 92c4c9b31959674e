//! The page `history.html`: trends of the figures of merit with the tolerance around the accepted baseline.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Value as Json, json};
use trilink_base::Named as _;
use trilink_base::numbers::{percent, significant, with_error};
use trilink_plot::{Figure, Layer, Layout, Look, Panel, Scale};
use trilink_report::{colours, fill, image, notice_of_folders, trends};
use trilink_robot::Parameter;
use trilink_robot::metrics::Metric;
use trilink_tables::config::{Compare, Config, Tolerance, tolerance};
use trilink_tables::write_bytes;

use super::CompareError;
use super::causes::{CoefficientCause, CoefficientChange, by_coefficient, coefficient};
use super::history::{ACCEPTED, HistoryRow, INADEQUATE, MEAN, SECONDS, TRIALS};
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
    let all: Vec<&Series> = groups.values().flatten().collect();
    let mut steps: BTreeMap<i64, Vec<(&Series, &Step)>> = BTreeMap::new();
    for series in &all {
        for step in &series.steps {
            steps.entry(series.rows[step.index].run).or_default().push((series, step));
        }
    }
    let steps = steps.iter().rev().map(|(run, steps)| {
        let sentences = sentences(steps, &all, *run);
        json!({ "run": run, "date": runs.date(*run), "why": runs.changes(*run), "steps": sentences })
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

/// Names of a figure of merit.
struct Names {
    /// Title of its panel.
    title: String,
    /// Label of its axis: symbol or model, with the unit.
    label: String,
    /// Symbol of the mean of a metric; empty for other figures of merit.
    symbol: &'static str,
    /// Unit; empty if there is none.
    unit: &'static str,
}

impl Names {
    fn new(HistoryRow { model, quantity, .. }: &HistoryRow) -> Self {
        let names = |title: &str, label: &str, unit| Self {
            title: title.to_owned(),
            label: label.to_owned(),
            symbol: "",
            unit,
        };
        if let Some(parameter) = Parameter::of_name(quantity).filter(|_| !model.is_empty()) {
            let of_wheel = coefficient(&[parameter]);
            let title = of_wheel.split(" (").next().unwrap_or_default();
            return names(title, &format!("{model} ({})", parameter.unit()), parameter.unit());
        }
        if let Some(column) = quantity.strip_prefix(MEAN) {
            let mut metrics = Metric::ALL.into_iter().map(Metric::definition);
            let metric = metrics.find(|of| of.column == column || of.debiased == Some(column));
            return match metric {
                Some(of) => Self {
                    title: of.in_words(),
                    label: of.dimension.with_unit(&format!("mean {}", of.symbol)),
                    symbol: of.plain,
                    unit: of.dimension.units()[0],
                },
                None if column == "residual_mm" => names("Marker residual", "mean (mm)", "mm"),
                None => names(quantity, "", ""),
            };
        }
        if let Some(stage) = quantity.strip_suffix(SECONDS) {
            names(&format!("Run time of {stage}"), "s", "s")
        } else if let Some(status) = quantity.strip_prefix(TRIALS) {
            names(&format!("Trials {status}"), "number", "")
        } else if quantity == "j" {
            names("Objective J", model, "")
        } else {
            names(quantity, model, "")
        }
    }
}

impl<'r> Series<'r> {
    fn names(&self) -> Names {
        Names::new(self.rows[0])
    }

    fn in_words(&self) -> String {
        let Names { title, .. } = self.names();
        let model = &self.rows[0].model;
        if model.is_empty() { title } else { format!("{model}: {title}") }
    }

    /// Returns whether the values are numbers of trials.
    fn is_count(&self) -> bool {
        self.rows[0].quantity.starts_with(TRIALS)
    }

    /// Returns whether the series is drawn: models that never fitted the trials and counts of zero are only listed.
    fn is_drawn(&self) -> bool {
        let fits = |row: &&HistoryRow| row.model.is_empty() || row.basis != INADEQUATE;
        let has_value =
            |row: &&HistoryRow| row.value.is_finite() && (row.value != 0.0 || !self.is_count());
        self.rows.iter().filter(|row| fits(row)).any(has_value)
    }

    fn shown(&self, value: f64) -> String {
        if self.is_count() { value.to_string() } else { significant(value, 5) }
    }

    /// Finds steps among the values with the same basis.
    fn find_steps(&mut self) {
        let mut by_basis: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (index, row) in self.rows.iter().enumerate() {
            by_basis.entry(&row.basis).or_default().push(index);
        }
        by_basis.remove(INADEQUATE);
        for indices in by_basis.into_values() {
            let rows: Vec<&HistoryRow> = indices.iter().map(|index| self.rows[*index]).collect();
            let values: Vec<f64> = rows.iter().map(|row| row.value).collect();
            let found = find_steps(&values, |index, before| {
                let error = rows[index].value_se.hypot(rows[index - 1].value_se);
                limit(self.tolerance?, before, error)
            });
            let found = found.into_iter().map(|step| Step { index: indices[step.index], ..step });
            self.steps.extend(found);
        }
        self.steps.sort_by_key(|step| step.index);
    }

    /// Returns the coefficient that the series shows; `None` for other figures of merit.
    fn parameter(&self) -> Option<Parameter> {
        Parameter::of_name(&self.rows[0].quantity).filter(|_| !self.rows[0].model.is_empty())
    }

    /// Describes a step in words.
    fn sentence(&self, Step { before, after, .. }: &Step) -> String {
        let [from, to] = [before, after].map(|level| self.shown(*level));
        let by = percent(*after, *before);
        let Names { symbol, .. } = self.names();
        let name = if symbol.is_empty() { self.in_words() } else { format!("mean {symbol}") };
        format!("{name} {by}, from {from} to {to}")
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
        if runs.accepted.iter().max() != Some(&baseline.run) {
            return None;
        }
        let last = rows.last().filter(|last| last.basis == baseline.basis)?;
        let out = rows.iter().rev().take_while(|row| self.is_out(baseline, row)).last();
        let change = percent(last.value, baseline.value);
        Some(json!({ "change": change, "out": out.map(|row| row.run) }))
    }

    /// Returns whether the value in `row` differs from the baseline by more than the tolerance.
    fn is_out(&self, baseline: &HistoryRow, row: &HistoryRow) -> bool {
        if row.basis != baseline.basis || row.basis == INADEQUATE {
            return false;
        }
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
                // Values with another basis are not judged.
                let limit = self.limit(baseline, row).filter(|_| row.basis == baseline.basis);
                let limit = limit.unwrap_or(f64::NAN);
                let is_one_sided = self.tolerance.is_some_and(|of| of.rises_only);
                let below = if is_one_sided { 0.0 } else { limit };
                levels.push([x, baseline.value]);
                band.push([baseline.value - below, baseline.value + limit]);
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
        let Names { title, label, .. } = self.names();
        let panel = Panel::new(title, "run", label, layers);
        let x_names = runs.labels().to_vec();
        let y_scale = if self.is_count() { Scale::Whole } else { Scale::Decades };
        Panel { x_scale: Scale::Whole, y_scale, x_names, ..panel }
    }
}

/// Describes the steps of a run in words, coefficients first. Steps of a coefficient in several campaigns share a
/// sentence.
fn sentences(steps: &[(&Series, &Step)], all: &[&Series], run: i64) -> Vec<String> {
    let changes = steps.iter().filter_map(|(series, step)| {
        let HistoryRow { campaign, model, .. } = series.rows[0];
        let ratio = step.after / step.before;
        let parameter = series.parameter().filter(|_| ratio.is_finite() && ratio != 0.0)?;
        Some(CoefficientChange { campaign, model, parameter, ratio })
    });
    let judged = |parameter: Parameter| {
        let series = all.iter().filter(|series| series.parameter() == Some(parameter));
        let rows = series.flat_map(|series| &series.rows);
        let rows = rows.filter(|row| row.run == run && row.basis != INADEQUATE);
        rows.map(|row| &row.campaign).collect::<BTreeSet<_>>().len()
    };
    let causes = by_coefficient(&changes.collect::<Vec<_>>(), judged);
    let grouped = causes.into_iter().map(|CoefficientCause { sentence, parameters, .. }| {
        let is_own =
            |series: &Series| series.parameter().is_some_and(|of| parameters.contains(&of));
        let own: Vec<_> = steps.iter().filter(|(series, _)| is_own(series)).collect();
        match own[..] {
            [(_, Step { before, after, .. })] => {
                let [from, to] = [before, after].map(|level| significant(*level, 5));
                format!("{sentence}, from {from} to {to}")
            }
            _ => sentence,
        }
    });
    // Steps in other figures of merit of a campaign share a sentence.
    let mut others: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for (series, step) in steps.iter().filter(|(series, _)| series.parameter().is_none()) {
        others.entry(&series.rows[0].campaign).or_default().push(series.sentence(step));
    }
    let others = others.into_iter().map(|(campaign, all)| {
        let all = all.join("; ");
        if campaign.is_empty() { all } else { format!("{campaign}: {all}") }
    });
    grouped.chain(others).collect()
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
    let drawn = series.iter().filter(|series| series.is_drawn() && runs.count() > 1);
    let panels: Vec<Panel> = drawn.map(|series| series.panel(runs)).collect();
    let texts = [format!("{name}, run by run"), String::new()];
    let layout = if runs.count() > MAX_MARKERS { Layout::Pairs } else { Layout::Grid };
    let figure = Figure { is_synthetic, ..Figure::new("", texts, &[campaign], layout, panels) };
    let rows = series.iter().filter_map(|series| {
        let now = *series.rows.last()?;
        let mut earlier =
            series.rows.iter().filter(|row| row.run < now.run && row.basis == now.basis);
        Some(json!({
            "name": series.in_words(),
            "last": if series.is_count() { series.shown(now.value) } else { with_error(now.value, now.value_se) },
            "unit": series.names().unit,
            "since_last": change(earlier.clone().next_back(), now),
            "since_first": change(earlier.next(), now),
            "since_baseline": series.since_baseline(runs),
        }))
    });
    let rows: Vec<Json> = rows.collect();
    let figure = if figure.is_empty() { Json::Null } else { json!(image(&figure)?) };
    Ok(json!({ "name": name, "figure": figure, "rows": rows, "is_first": runs.count() < 2 }))
}

/// Formats the relative change since an earlier run; empty if there is no earlier run.
fn change(then: Option<&&HistoryRow>, now: &HistoryRow) -> String {
    then.map(|then| percent(now.value, then.value)).unwrap_or_default()
}
