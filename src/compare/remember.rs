//! What a run adds to the history.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use trilink_robot::Parameter;
use trilink_robot::metrics::Metric;
use trilink_statistics::HALF_WIDTH_95;
use trilink_tables::clock::utc_now;
use trilink_tables::config::Config;
use trilink_tables::{Columns as _, Provenance, RunStatus, TrialStatus, UtcTime};

use super::history::{
    ACCEPTED, CAME, GONE, History, HistoryRow, MEAN, SECONDS, TRIAL, TRIALS, history_path,
    last_run, next_run,
};
use super::judge::StandardError;
use super::means::{campaigns, mean};
use super::snapshot::{MadeOf, Snapshot, number, text};
use super::trend;
use super::{Acceptance, CompareError};

/// Whether the history is there, and the page of it is not older.
pub fn is_drawn(reports: &Path) -> bool {
    let modified = |path: PathBuf| std::fs::metadata(path).and_then(|found| found.modified()).ok();
    let page = modified(reports.join(trend::PAGE));
    modified(history_path(reports)).is_some_and(|history| page.is_some_and(|page| page >= history))
}

/// Adds a run to the history, unless its figures are those of the run before, and draws the trends.
/// Gives what a person should know of the history that was there.
///
/// # Errors
/// A table cannot be read, or a file not written.
pub fn remember(config: &Config) -> Result<Option<String>, CompareError> {
    let paths = &config.paths;
    let candidate = Snapshot::of_run(&paths.derived, &paths.reports)?;
    let History { mut rows, problem } = History::load(&paths.reports)?;
    let whole = whole_run(&candidate, next_run(&rows));
    let new = figures_of_merit(&candidate, &whole);
    let last = last_run(&rows);
    let known = rows.iter().filter(|row| row.run == last && row.is_measured());
    if known.filter_map(merit).eq(new.iter().filter_map(merit)) {
        trend::write(config, &rows)?;
        return Ok(problem);
    }
    let trials = changed_trials(&rows, &candidate, &whole);
    rows.extend(new.into_iter().chain(trials));
    write(config, &rows)?;
    Ok(problem)
}

/// Adds a run to the history that did not come to its end, and why. Gives what [`remember`] gives.
///
/// # Errors
/// As [`remember`].
pub fn remember_failure(
    config: &Config,
    started: &str,
    status: RunStatus,
    why: &str,
) -> Result<Option<String>, CompareError> {
    let History { mut rows, problem } = History::load(&config.paths.reports)?;
    rows.push(HistoryRow {
        time: UtcTime::parse(started).unwrap_or_default(),
        run: next_run(&rows),
        status: Some(status),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        note: why.to_owned(),
        ..HistoryRow::blank()
    });
    write(config, &rows)?;
    Ok(problem)
}

/// Notes in the history which runs became the new baseline, as far as it does not say so. What was
/// accepted before the history began is another laboratory's.
///
/// # Errors
/// As [`remember`].
pub fn note_acceptances(config: &Config, accepted: &[Acceptance]) -> Result<(), CompareError> {
    let mut rows = History::load(&config.paths.reports)?.rows;
    let (known, run) = (rows.clone(), last_run(&rows));
    let is_new = |acceptance: &&Acceptance| {
        let Acceptance { time, reason, .. } = acceptance;
        let time = UtcTime::parse(time).unwrap_or_default();
        known.first().is_none_or(|first| first.time <= time)
            && !known.iter().any(|row| row.time == time && row.note == *reason)
    };
    rows.extend(accepted.iter().filter(is_new).map(|acceptance| HistoryRow {
        time: UtcTime::parse(&acceptance.time).unwrap_or_default(),
        run,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        quantity: ACCEPTED.to_owned(),
        value: acceptance.differences as f64,
        note: acceptance.reason.clone(),
        ..HistoryRow::blank()
    }));
    if rows.len() > known.len() { write(config, &rows) } else { Ok(()) }
}

fn write(config: &Config, rows: &[HistoryRow]) -> Result<(), CompareError> {
    let provenance = Provenance { input: "runs".to_owned() };
    let path = history_path(&config.paths.reports);
    HistoryRow::to_table(rows).write(&path, &provenance)?;
    trend::write(config, rows)
}

/// What is the same when nothing has changed.
fn merit(row: &HistoryRow) -> Option<([&str; 4], u64)> {
    let HistoryRow { version, campaign, model, quantity, value, .. } = row;
    let of = [version, campaign, model, quantity].map(String::as_str);
    (!quantity.ends_with(SECONDS)).then_some((of, value.to_bits()))
}

/// What is the same of all rows of a run.
fn whole_run(candidate: &Snapshot, run: i64) -> HistoryRow {
    let MadeOf { ended, program, configuration, input } = candidate.made_of.clone();
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

fn figures_of_merit(candidate: &Snapshot, whole: &HistoryRow) -> Vec<HistoryRow> {
    let mut rows = Vec::new();
    let mut add = |of: [&str; 3], value: f64, [lower, upper]: [f64; 2], value_se: f64| {
        let [campaign, model, quantity] = of.map(str::to_owned);
        let row = HistoryRow {
            campaign,
            model,
            quantity,
            value,
            lower,
            upper,
            value_se,
            ..whole.clone()
        };
        rows.extend(value.is_finite().then_some(row));
    };
    const UNKNOWN: [f64; 2] = [f64::NAN; 2];
    let trials = candidate.records("trials");
    for campaign in campaigns(trials) {
        let of_campaign = trials.values().filter(|trial| text(trial, "campaign") == campaign);
        let metrics = Metric::FITTED.map(Metric::definition);
        let means = metrics.map(|of| of.debiased.unwrap_or(of.column)).into_iter();
        for quantity in means.chain(["residual_mm"]) {
            let value = |trial| {
                let unknown = StandardError { error: f64::NAN, freedom: f64::INFINITY };
                let error = StandardError::of(quantity, trial).unwrap_or(unknown);
                Some((number(trial, quantity)?, error))
            };
            let values: Vec<_> = of_campaign.clone().filter_map(value).collect();
            let Some((value, of_mean)) = mean(values.into_iter()) else { continue };
            let half = HALF_WIDTH_95 * of_mean.error;
            let name = format!("{MEAN}{quantity}");
            add([campaign, "", &name], value, [value - half, value + half], of_mean.error);
        }
    }
    for fit in candidate.records("fits").values() {
        let (campaign, model) = (text(fit, "campaign"), text(fit, "model"));
        let free: Vec<&str> = text(fit, "free").split(", ").collect();
        let fitted = Parameter::ALL.map(Parameter::name);
        let fitted = fitted.into_iter().filter(|parameter| free.contains(parameter));
        for quantity in std::iter::once("j").chain(fitted) {
            let of = |name: &str| number(fit, name).unwrap_or(f64::NAN);
            let limits = ["lo", "hi"].map(|end| of(&format!("{quantity}_{end}")));
            let error = StandardError::of(quantity, fit).map_or(f64::NAN, |of| of.error);
            add([campaign, model, quantity], of(quantity), limits, error);
        }
    }
    for status in TrialStatus::ALL.map(TrialStatus::name) {
        let count = trials.values().filter(|trial| text(trial, "status") == status).count();
        add(["", "", &format!("{TRIALS}{status}")], count as f64, UNKNOWN, f64::NAN);
    }
    for (stage, seconds) in &candidate.stages {
        add(["", "", &format!("{stage}{SECONDS}")], *seconds, UNKNOWN, f64::NAN);
    }
    rows
}

/// Rows of trials that came or are gone since the runs before; of all trials, if these do not know
/// theirs.
fn changed_trials(
    rows: &[HistoryRow],
    candidate: &Snapshot,
    whole: &HistoryRow,
) -> Vec<HistoryRow> {
    let mut known = BTreeSet::new();
    for HistoryRow { quantity, note, .. } in rows {
        match quantity.as_str() {
            TRIAL | CAME => drop(known.insert(note)),
            GONE => drop(known.remove(note)),
            _ => {}
        }
    }
    let trials = candidate.records("trials");
    let came = trials.keys().filter(|trial| !known.contains(trial));
    let gone = known.iter().filter(|trial| !trials.contains_key(**trial));
    let row = |quantity: &str, trial: &String| {
        let (quantity, note) = (quantity.to_owned(), trial.clone());
        HistoryRow { quantity, note, ..whole.clone() }
    };
    let new = if known.is_empty() { TRIAL } else { CAME };
    came.map(|trial| row(new, trial)).chain(gone.map(|trial| row(GONE, trial))).collect()
}
