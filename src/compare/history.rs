//! Figures of merit of every run, one below the other, so that a slow drift shows.

use std::path::{Path, PathBuf};

use super::snapshot::{Cell, Record, Snapshot};
use super::trend;
use super::{Acceptance, CompareError};
use crate::clock::utc_now;
use crate::config::Paths;
use crate::robot::Parameter;
use crate::store::{Provenance, Rows as _, Table, history_rows};

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

history_rows! {
    /// One figure of merit of one run: `history.parquet`.
    pub struct HistoryRow {
        /// When the run ended, UTC.
        pub time: String,
        /// Counts the runs.
        pub run: i64,
        pub version: String,
        /// Empty for what is of the whole run, as is the model.
        pub campaign: String,
        pub model: String,
        pub quantity: String,
        pub value: f64,
        /// Why a run became the new baseline.
        pub note: String,
    }
}

/// Where the history lies.
pub fn history_path(reports: &Path) -> PathBuf {
    reports.join("history.parquet")
}

/// Adds a run to the history and draws the trends again; nothing if it came to the same as the
/// one before. Gives whether it was added.
///
/// # Errors
/// A table cannot be read, or a file not written.
pub fn remember(paths: &Paths) -> Result<bool, CompareError> {
    let tonight = Snapshot::of_run(&paths.derived, &paths.reports)?;
    let path = history_path(&paths.reports);
    let mut rows = read(&path)?;
    let run = rows.last().map_or(0, |row| row.run);
    let new = figures_of_merit(&tonight, run + 1);
    let last: Vec<&HistoryRow> =
        rows.iter().filter(|row| row.run == run && row.note.is_empty()).collect();
    if is_same(&last, &new) {
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
    match path.exists() {
        true => Ok(HistoryRow::from_table(&Table::read(path)?)?),
        false => Ok(Vec::new()),
    }
}

fn write(paths: &Paths, rows: &[HistoryRow]) -> Result<(), CompareError> {
    let provenance = Provenance { input: "runs".to_owned() };
    HistoryRow::to_table(rows).write(&history_path(&paths.reports), &provenance)?;
    trend::write(&paths.reports, rows)
}

fn is_same(last: &[&HistoryRow], new: &[HistoryRow]) -> bool {
    let key = |row: &HistoryRow| {
        let HistoryRow { version, campaign, model, quantity, value, .. } = row;
        let of = [version, campaign, model, quantity].map(String::clone);
        (!quantity.ends_with(SECONDS)).then_some((of, value.to_bits()))
    };
    let last: Vec<_> = last.iter().filter_map(|row| key(row)).collect();
    let new: Vec<_> = new.iter().filter_map(key).collect();
    last == new
}

fn figures_of_merit(tonight: &Snapshot, run: i64) -> Vec<HistoryRow> {
    let time = utc_now();
    let mut rows = Vec::new();
    let mut add = |campaign: &str, model: &str, quantity: &str, value: f64| {
        if value.is_finite() {
            rows.push(HistoryRow {
                time: time.clone(),
                run,
                version: tonight.version.clone(),
                campaign: campaign.to_owned(),
                model: model.to_owned(),
                quantity: quantity.to_owned(),
                value,
                note: String::new(),
            });
        }
    };
    let trials = tonight.records("trials");
    let mut campaigns: Vec<&str> = trials.values().map(|trial| text(trial, "campaign")).collect();
    campaigns.sort_unstable();
    campaigns.dedup();
    for campaign in campaigns.into_iter().filter(|name| !name.is_empty()) {
        let of: Vec<&Record> =
            trials.values().filter(|trial| text(trial, "campaign") == campaign).collect();
        for quantity in MEANS {
            let values = of.iter().filter_map(|trial| trial.get(quantity)?.number());
            let (sum, count) = values.fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
            add(campaign, "", &format!("mean {quantity}"), sum / count);
        }
    }
    for fit in tonight.records("fits").values() {
        let (campaign, model) = (text(fit, "campaign"), text(fit, "model"));
        let number = |name: &str| fit.get(name).and_then(Cell::number).unwrap_or(f64::NAN);
        add(campaign, model, "j", number("j"));
        let free: Vec<&str> = text(fit, "free").split(", ").collect();
        let columns = Parameter::ALL.map(Parameter::column);
        for parameter in columns.into_iter().filter(|parameter| free.contains(parameter)) {
            add(campaign, model, parameter, number(parameter));
        }
    }
    for status in ["ok", "flagged", "failed"] {
        let count = trials.values().filter(|trial| text(trial, "status") == status).count();
        add("", "", &format!("trials {status}"), count as f64);
    }
    for (stage, seconds) in &tonight.stages {
        add("", "", &format!("{stage}{SECONDS}"), *seconds);
    }
    rows
}

fn text<'r>(record: &'r Record, column: &str) -> &'r str {
    match record.get(column) {
        Some(Cell::Text(text)) => text,
        _ => "",
    }
}
