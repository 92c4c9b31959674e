//! Recording of runs in the history.

use std::collections::BTreeSet;
use std::path::Path;

use trilink_robot::Parameter;
use trilink_robot::metrics::Metric;
use trilink_statistics::HALF_WIDTH_95;
use trilink_tables::clock::utc_now;
use trilink_tables::config::{Config, Paths};
use trilink_tables::{Columns as _, Provenance, RunStatus, TrialStatus, UtcTime};

use super::history::{
    ACCEPTED, History, HistoryRow, INADEQUATE, MEAN, SECONDS, TRIAL, TRIAL_ADDED, TRIAL_REMOVED,
    TRIALS, last_run, next_run,
};
use super::judge::StandardError;
use super::means::{MeanOverFrequencies, campaigns};
use super::snapshot::{Record, RunInputs, Snapshot, number, text};
use super::trend;
use super::{Acceptance, CompareError};

/// Returns whether the history exists and its page is up to date.
pub fn is_history_up_to_date(paths: &Paths) -> bool {
    let modified = |path: &Path| std::fs::metadata(path).and_then(|found| found.modified()).ok();
    let page = modified(&paths.reports.join(trend::PAGE));
    modified(&paths.history).is_some_and(|history| page.is_some_and(|page| page >= history))
}

/// Adds a run to the history, unless its figures of merit equal those of the previous run, and writes the page of
/// trends. Returns a message if the existing history was damaged.
///
/// # Errors
/// Returns an error if a table cannot be read or a file cannot be written.
pub fn record_run(config: &Config) -> Result<Option<String>, CompareError> {
    let paths = &config.paths;
    let candidate = Snapshot::from_run(&paths.derived, &paths.reports)?;
    let History { mut rows, problem } = History::load(paths)?;
    let template = row_template(&candidate, next_run(&rows));
    let new = figures_of_merit(&candidate, &template);
    let last = last_run(&rows);
    let previous = rows.iter().filter(|row| row.run == last && row.is_measured());
    if previous.filter_map(comparison_key).eq(new.iter().filter_map(comparison_key)) {
        trend::write(config, &rows)?;
        return Ok(problem);
    }
    let trials = changed_trials(&rows, &candidate, &template);
    rows.extend(new.into_iter().chain(trials));
    write(config, &rows)?;
    Ok(problem)
}

/// Adds a failed run to the history with the reason. Returns a message if the existing history was damaged.
///
/// # Errors
/// Returns an error if a table cannot be read or a file cannot be written.
pub fn record_failure(
    config: &Config,
    started: &str,
    status: RunStatus,
    reason: &str,
) -> Result<Option<String>, CompareError> {
    let History { mut rows, problem } = History::load(&config.paths)?;
    rows.push(HistoryRow {
        time: UtcTime::parse(started).unwrap_or_default(),
        run: next_run(&rows),
        status: Some(status),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        note: reason.to_owned(),
        ..HistoryRow::blank()
    });
    write(config, &rows)?;
    Ok(problem)
}

/// Adds to the history those acceptances of baselines that it does not yet contain. Acceptances from before the start
/// of the history are skipped, because they come from another laboratory.
///
/// # Errors
/// Returns an error if a table cannot be read or a file cannot be written.
pub fn note_acceptances(config: &Config, accepted: &[Acceptance]) -> Result<(), CompareError> {
    let mut rows = History::load(&config.paths)?.rows;
    let run = last_run(&rows);
    let count = rows.len();
    for Acceptance { time, reason, differences } in accepted {
        let time = UtcTime::parse(time).unwrap_or_default();
        let known = &rows[..count];
        let is_after_start = known.first().is_none_or(|first| first.time <= time);
        if is_after_start && !known.iter().any(|row| row.time == time && row.note == *reason) {
            rows.push(HistoryRow {
                time,
                run,
                version: env!("CARGO_PKG_VERSION").to_owned(),
                quantity: ACCEPTED.to_owned(),
                value: *differences as f64,
                note: reason.clone(),
                ..HistoryRow::blank()
            });
        }
    }
    if rows.len() > count { write(config, &rows) } else { Ok(()) }
}

fn write(config: &Config, rows: &[HistoryRow]) -> Result<(), CompareError> {
    let provenance = Provenance { input: "runs".to_owned() };
    HistoryRow::to_table(rows).write(&config.paths.history, &provenance)?;
    trend::write(config, rows)
}

/// Returns the names and the value by which rows of two runs are recognised as equal; `None` for run times, which
/// differ even between identical runs.
fn comparison_key(row: &HistoryRow) -> Option<([&str; 4], u64)> {
    let HistoryRow { version, campaign, model, quantity, value, .. } = row;
    let names = [version, campaign, model, quantity].map(String::as_str);
    (!quantity.ends_with(SECONDS)).then_some((names, value.to_bits()))
}

/// Returns a row template with the fields that all rows of a run share.
fn row_template(candidate: &Snapshot, run: i64) -> HistoryRow {
    let RunInputs { ended, program, configuration, input } = candidate.inputs.clone();
    HistoryRow {
        time: UtcTime::parse(&ended).or_else(|| UtcTime::parse(&utc_now())).unwrap_or_default(),
        run,
        status: candidate.status,
        version: candidate.version.clone(),
        program,
        configuration,
        input,
        ..HistoryRow::blank()
    }
}

/// Returns the figures of merit of a run: means over the trials of each campaign, objectives and coefficients of the
/// fits, numbers of trials by status, and run times.
fn figures_of_merit(candidate: &Snapshot, template: &HistoryRow) -> Vec<HistoryRow> {
    let mut rows = Vec::new();
    let mut add =
        |names: [&str; 3], value: f64, [lower, upper]: [f64; 2], value_se: f64, basis: &str| {
            let [campaign, model, quantity] = names.map(str::to_owned);
            let row = HistoryRow {
                campaign,
                model,
                quantity,
                value,
                lower,
                upper,
                value_se,
                basis: basis.to_owned(),
                ..template.clone()
            };
            rows.extend(value.is_finite().then_some(row));
        };
    const UNKNOWN: [f64; 2] = [f64::NAN; 2];
    let trials = candidate.records("trials");
    for campaign in campaigns(trials) {
        let trials = trials.values().filter(|trial| text(trial, "campaign") == campaign);
        let trials: Vec<&Record> = trials.collect();
        let metrics = Metric::FITTED.map(Metric::definition);
        let means = metrics.map(|of| of.debiased.unwrap_or(of.column)).into_iter();
        for quantity in means.chain(["residual_mm"]) {
            let Some(mean) = MeanOverFrequencies::new(&trials, quantity) else { continue };
            let MeanOverFrequencies { value, error, frequencies } = mean;
            let half = HALF_WIDTH_95 * error;
            let name = format!("{MEAN}{quantity}");
            let limits = [value - half, value + half];
            add([campaign, "", &name], value, limits, error, &frequencies);
        }
    }
    for fit in candidate.records("fits").values() {
        let campaign = text(fit, "campaign");
        let model = text(fit, "model");
        let free: Vec<&str> = text(fit, "free").split(", ").collect();
        let fitted = Parameter::ALL.map(Parameter::name);
        let fitted = fitted.into_iter().filter(|parameter| free.contains(parameter));
        for quantity in std::iter::once("j").chain(fitted) {
            let value = |column: &str| number(fit, column).unwrap_or(f64::NAN);
            let limits = ["lo", "hi"].map(|end| value(&format!("{quantity}_{end}")));
            let error = StandardError::from_record(quantity, fit).map_or(f64::NAN, |of| of.error);
            let basis = if text(fit, "adequate") == "false" { INADEQUATE } else { "" };
            add([campaign, model, quantity], value(quantity), limits, error, basis);
        }
    }
    for status in TrialStatus::ALL.map(TrialStatus::name) {
        let count = trials.values().filter(|trial| text(trial, "status") == status).count();
        add(["", "", &format!("{TRIALS}{status}")], count as f64, UNKNOWN, f64::NAN, "");
    }
    for (stage, seconds) in &candidate.stages {
        add(["", "", &format!("{stage}{SECONDS}")], *seconds, UNKNOWN, f64::NAN, "");
    }
    rows
}

/// Returns a row for each trial that was added or removed since the previous run or, if the history has no record of
/// trials, for every trial.
fn changed_trials(
    rows: &[HistoryRow],
    candidate: &Snapshot,
    template: &HistoryRow,
) -> Vec<HistoryRow> {
    let mut known = BTreeSet::new();
    for HistoryRow { quantity, note, .. } in rows {
        match quantity.as_str() {
            TRIAL | TRIAL_ADDED => drop(known.insert(note)),
            TRIAL_REMOVED => drop(known.remove(note)),
            _ => {}
        }
    }
    let trials = candidate.records("trials");
    let new = if known.is_empty() { TRIAL } else { TRIAL_ADDED };
    let added = trials.keys().filter(|trial| !known.contains(trial)).map(|trial| (new, trial));
    let removed = known.iter().filter(|trial| !trials.contains_key(**trial));
    let removed = removed.map(|trial| (TRIAL_REMOVED, *trial));
    let rows = added.chain(removed).map(|(quantity, trial)| HistoryRow {
        quantity: quantity.to_owned(),
        note: trial.clone(),
        ..template.clone()
    });
    rows.collect()
}
