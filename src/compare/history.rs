//! Figures of merit of every run, one below the other, so that a slow drift shows.

use std::path::{Path, PathBuf};

use super::means::campaigns;
use super::snapshot::{Snapshot, number, text};
use super::trend::{self, HistoryRow};
use super::{Acceptance, CompareError};
use crate::clock::utc_now;
use crate::config::Paths;
use crate::robot::Parameter;
use crate::store::{Columns as _, Provenance, Reader, TrialStatus};

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

/// Where the history lies.
pub fn history_path(reports: &Path) -> PathBuf {
    reports.join("history.parquet")
}

/// Adds a run to the history and draws the trends again; nothing if its figures are those of the
/// run before. Gives whether it was added.
///
/// # Errors
/// A table cannot be read, or a file not written.
pub fn remember(paths: &Paths) -> Result<bool, CompareError> {
    let candidate = Snapshot::of_run(&paths.derived, &paths.reports)?;
    let path = history_path(&paths.reports);
    let mut rows = read(&path)?;
    let run = rows.last().map_or(0, |row| row.run);
    let new = figures_of_merit(&candidate, run + 1);
    let last = rows.iter().filter(|row| row.run == run && row.note.is_empty());
    if last.filter_map(merit).eq(new.iter().filter_map(merit)) {
        return Ok(false);
    }
    rows.extend(new);
    write(paths, &rows)?;
    Ok(true)
}

/// Notes in the history that the last run became the new baseline.
///
/// # Errors
/// As [`remember`].
pub fn note_acceptance(paths: &Paths, acceptance: &Acceptance) -> Result<(), CompareError> {
    let mut rows = read(&history_path(&paths.reports))?;
    rows.push(HistoryRow {
        time: acceptance.time.clone(),
        run: rows.last().map_or(1, |row| row.run),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        quantity: "accepted".to_owned(),
        value: acceptance.differences as f64,
        note: acceptance.reason.clone(),
        ..HistoryRow::blank()
    });
    write(paths, &rows)
}

fn read(path: &Path) -> Result<Vec<HistoryRow>, CompareError> {
    Ok(Reader::default().rows_if_there(path)?.unwrap_or_default())
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
