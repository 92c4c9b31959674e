//! Figures of merit of every run, one below the other, so that a slow drift shows.

use std::path::{Path, PathBuf};

use super::means::campaigns;
use super::snapshot::{Snapshot, number, text};
use super::trend::{self, ACCEPTED, HistoryRow};
use super::{Acceptance, CompareError};
use crate::clock::utc_now;
use crate::config::Paths;
use crate::robot::Parameter;
use crate::store::{
    Columns as _, Provenance, Reader, RunStatus, StoreError, TrialStatus, repeated,
};

const MEANS: [&str; 7] = [
    "d_m",
    "v_m_s",
    "sigma0_debiased",
    "sigma1_debiased",
    "sigma2_debiased",
    "alpha1_rad",
    "residual_mm",
];
/// What is not the same when nothing has changed.
const SECONDS: &str = "_s of run";
const STATUS: &str = "status";

/// Where the history lies.
pub fn history_path(reports: &Path) -> PathBuf {
    reports.join("history.parquet")
}

/// Whether the history is there, and the page of it is not older.
pub fn is_drawn(reports: &Path) -> bool {
    let modified = |path: PathBuf| std::fs::metadata(path).and_then(|found| found.modified()).ok();
    let page = modified(reports.join(trend::PAGE));
    modified(history_path(reports)).is_some_and(|history| page.is_some_and(|page| page >= history))
}

/// Adds a run to the history, unless its figures are those of the run before, and draws the trends
/// where that is not done. Gives what a person should know of the history that was there.
///
/// # Errors
/// A table cannot be read, or a file not written.
pub fn remember(paths: &Paths) -> Result<Option<String>, CompareError> {
    let candidate = Snapshot::of_run(&paths.derived, &paths.reports)?;
    let History { mut rows, problem } = History::load(&paths.reports)?;
    let last = rows.iter().rfind(|row| row.note.is_empty()).map_or(0, |row| row.run);
    let new = figures_of_merit(&candidate, next_run(&rows));
    let known = rows.iter().filter(|row| row.run == last && row.note.is_empty());
    if !known.filter_map(merit).eq(new.iter().filter_map(merit)) {
        rows.extend(new);
        write(paths, &rows)?;
    } else if !is_drawn(&paths.reports) {
        trend::write(&paths.reports, &rows)?;
    }
    Ok(problem)
}

/// Adds a run to the history that did not come to its end, and why. Gives what [`remember`] gives.
///
/// # Errors
/// As [`remember`].
pub fn remember_failure(
    paths: &Paths,
    started: &str,
    status: RunStatus,
    why: &str,
) -> Result<Option<String>, CompareError> {
    let History { mut rows, problem } = History::load(&paths.reports)?;
    rows.push(HistoryRow {
        time: started.to_owned(),
        run: next_run(&rows),
        status: Some(status),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        note: why.to_owned(),
        ..HistoryRow::blank()
    });
    write(paths, &rows)?;
    Ok(problem)
}

/// Notes in the history which runs became the new baseline, as far as it does not say so. What was
/// accepted before the history began is another laboratory's.
///
/// # Errors
/// As [`remember`].
pub fn note_acceptances(paths: &Paths, accepted: &[Acceptance]) -> Result<(), CompareError> {
    let mut rows = History::load(&paths.reports)?.rows;
    let (known, run) = (rows.clone(), rows.last().map_or(1, |row| row.run));
    let is_new = |acceptance: &&Acceptance| {
        let Acceptance { time, reason, .. } = acceptance;
        known.first().is_none_or(|first| first.time <= *time)
            && !known.iter().any(|row| row.time == *time && row.note == *reason)
    };
    rows.extend(accepted.iter().filter(is_new).map(|acceptance| HistoryRow {
        time: acceptance.time.clone(),
        run,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        quantity: ACCEPTED.to_owned(),
        value: acceptance.differences as f64,
        note: acceptance.reason.clone(),
        ..HistoryRow::blank()
    }));
    if rows.len() > known.len() { write(paths, &rows) } else { Ok(()) }
}

fn next_run(rows: &[HistoryRow]) -> i64 {
    rows.iter().map(|row| row.run).max().unwrap_or(0) + 1
}

/// The history as it is found.
struct History {
    rows: Vec<HistoryRow>,
    /// That it was damaged.
    problem: Option<String>,
}

impl History {
    /// Reads the history. One that is damaged is moved aside, and a new one begins.
    fn load(reports: &Path) -> Result<Self, CompareError> {
        let path = history_path(reports);
        let rows = Reader::default().table(&path).and_then(|mut table| {
            // A history from before there was this column.
            if table.frame.column(STATUS).is_err() {
                let rows = table.frame.height();
                table.frame.with_column(repeated(STATUS, "", rows)).map_err(|error| {
                    StoreError::Table { path: path.clone(), message: error.to_string() }
                })?;
            }
            HistoryRow::from_table(&table)
        });
        let damage = match rows {
            Ok(rows) => return Ok(Self { rows, problem: None }),
            Err(error) if error.is_not_there() => {
                return Ok(Self { rows: Vec::new(), problem: None });
            }
            Err(error @ StoreError::Read { .. }) => return Err(error.into()),
            Err(damage) => damage,
        };
        let aside = (1..).map(|i| reports.join(format!("history.damaged-{i}.parquet")));
        let aside = aside
            .into_iter()
            .find(|path| path.try_exists().is_ok_and(|is_there| !is_there))
            .unwrap_or_else(|| path.clone());
        std::fs::rename(&path, &aside)
            .map_err(|source| StoreError::Write { path: aside.clone(), source })?;
        let problem = format!("{damage}; it is now {}, and a new one begins", aside.display());
        Ok(Self { rows: Vec::new(), problem: Some(problem) })
    }
}

fn write(paths: &Paths, rows: &[HistoryRow]) -> Result<(), CompareError> {
    let provenance = Provenance { input: "runs".to_owned() };
    HistoryRow::to_table(rows).write(&history_path(&paths.reports), &provenance)?;
    trend::write(&paths.reports, rows)
}

/// What is the same when nothing has changed.
fn merit(row: &HistoryRow) -> Option<([&str; 4], u64)> {
    let HistoryRow { version, campaign, model, quantity, value, .. } = row;
    let of = [version, campaign, model, quantity].map(String::as_str);
    (!quantity.ends_with(SECONDS)).then_some((of, value.to_bits()))
}

fn figures_of_merit(candidate: &Snapshot, run: i64) -> Vec<HistoryRow> {
    let whole = HistoryRow {
        time: utc_now(),
        run,
        status: candidate.status,
        version: candidate.version.clone(),
        ..HistoryRow::blank()
    };
    let mut rows = Vec::new();
    let mut add = |campaign: &str, model: &str, quantity: &str, value: f64| {
        let [campaign, model, quantity] = [campaign, model, quantity].map(str::to_owned);
        let row = HistoryRow { campaign, model, quantity, value, ..whole.clone() };
        rows.extend(value.is_finite().then_some(row));
    };
    let trials = candidate.records("trials");
    for campaign in campaigns(trials) {
        let of_campaign = trials.values().filter(|trial| text(trial, "campaign") == campaign);
        for quantity in MEANS {
            let values = of_campaign.clone().filter_map(|trial| number(trial, quantity));
            let (sum, count) = values.fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
            add(campaign, "", &format!("mean {quantity}"), sum / count);
        }
    }
    for fit in candidate.records("fits").values() {
        let (campaign, model) = (text(fit, "campaign"), text(fit, "model"));
        let free: Vec<&str> = text(fit, "free").split(", ").collect();
        let fitted = Parameter::ALL.map(Parameter::name);
        let fitted = fitted.into_iter().filter(|parameter| free.contains(parameter));
        for quantity in std::iter::once("j").chain(fitted) {
            add(campaign, model, quantity, number(fit, quantity).unwrap_or(f64::NAN));
        }
    }
    for status in TrialStatus::ALL.map(TrialStatus::name) {
        let count = trials.values().filter(|trial| text(trial, "status") == status).count();
        add("", "", &format!("trials {status}"), count as f64);
    }
    for (stage, seconds) in &candidate.stages {
        add("", "", &format!("{stage}{SECONDS}"), *seconds);
    }
    rows
}
