//! The stages one by one: planned, done and recorded.

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use super::{RunError, Watch, record_path};
use crate::config::Config;
use crate::fit::{self, FitEvent, Fitted};
use crate::ingest::{self, Ingested};
use crate::interrupt::stop_if_asked;
use crate::report::{self, ReportInput, Reported};
use crate::store::{
    FitRow, How, LOCK_FILE, Lock, RECORD_FILE, Record, Redo, TrialRow, TrialStatus, check_places,
    sweep,
};

/// The first stage, of all trials: marker files to tables.
///
/// # Errors
/// The list of trials cannot be read, a table not written, or another run is busy.
pub fn ingest(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Ingested, RunError> {
    let _lock = take_over(config, wait, watch)?;
    let (mut record, _) = Record::load(&config.paths.derived);
    Ok(ingest_planned(config, &mut record, How::FORCE, watch)?.0)
}

/// The second stage, of all models: tables to fitted models.
///
/// # Errors
/// The table of trials cannot be read, a table not written, or another run is busy.
pub fn fit(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Fitted, RunError> {
    let _lock = take_over(config, wait, watch)?;
    let (mut record, _) = Record::load(&config.paths.derived);
    Ok(fit_planned(config, &mut record, How::FORCE, watch)?.0)
}

/// The third stage, of all figures: figures and the page.
///
/// # Errors
/// A table cannot be read, a file not written, or another run is busy.
pub fn draw(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Reported, RunError> {
    let _lock = take_over(config, wait, watch)?;
    let (mut record, _) = Record::load(&config.paths.derived);
    let (reported, _) = draw_planned(config, &mut record, How::FORCE, watch)?;
    record.save(&config.paths.derived)?;
    Ok(reported)
}

/// Takes the lock of the folder of results, and makes sure that there is where to write to.
pub(super) fn take_over(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Lock, RunError> {
    let (derived, reports) = (&config.paths.derived, &config.paths.reports);
    let folders = folders(config);
    let mut files: Vec<PathBuf> = [LOCK_FILE, RECORD_FILE].map(|name| derived.join(name)).into();
    files.extend(ingest::table_paths(derived));
    files.extend(fit::table_paths(derived));
    files.extend(report::file_paths(reports));
    files.push(record_path(config));
    check_places(&folders[..1], &files[..1])?;
    let waiting = |held: &str| watch.note(&format!("{held}; waiting"));
    let on_wait: Option<&dyn Fn(&str)> = if wait { Some(&waiting) } else { None };
    let lock = Lock::take(derived, on_wait).map_err(RunError::of_lock)?;
    check_places(&folders, &files)?;
    sweep(&lock, &folders)?;
    Ok(lock)
}

/// Folders that are written to, `derived/` first.
pub(super) fn folders(config: &Config) -> Vec<PathBuf> {
    let (derived, reports) = (&config.paths.derived, &config.paths.reports);
    let mut folders =
        vec![derived.clone(), reports.clone(), reports.join("figures"), reports.join("trials")];
    folders.extend(ingest::table_folders(derived));
    folders
}

/// Ingests what has changed and records it.
pub(super) fn ingest_planned(
    config: &Config,
    record: &mut Record,
    how: How,
    watch: &dyn Watch,
) -> Result<(Ingested, Redo), RunError> {
    let (folder, derived) = (&config.paths.raw, &config.paths.derived);
    let known = record.ingest.clone();
    let plan = ingest::plan(config, folder, derived, &known, how)?;
    let redo = plan.redo.clone();
    announce(&redo, "ingest", redo.things.len(), watch);
    let (begin, done, total) = (Instant::now(), AtomicUsize::new(0), redo.things.len());
    let on_trial = |trial: &TrialRow| {
        watch.step(&format!("{} {}", trial.trial, trial.status));
        let (TrialRow { trial, status, message, .. }, seconds) = (trial, begin.elapsed());
        let (is_ok, status) = (*status == TrialStatus::Ok, status.name());
        match is_ok {
            true => tracing::debug!(trial, status, after_s = seconds.as_secs_f64(), "trial"),
            false => tracing::warn!(trial, status, message, "trial"),
        }
        let done = 1 + done.fetch_add(1, Ordering::Relaxed);
        stop_if_asked(|| format!("{done} of {total} trials"));
    };
    let (ingested, state) = ingest::ingest_planned(config, folder, derived, plan, &on_trial)?;
    record.ingest = state;
    if !redo.is_empty() {
        record.save(derived)?;
    }
    Ok((ingested, redo))
}

/// Fits what has changed and records it.
pub(super) fn fit_planned(
    config: &Config,
    record: &mut Record,
    how: How,
    watch: &dyn Watch,
) -> Result<(Fitted, Redo), RunError> {
    let derived = &config.paths.derived;
    let known = record.fit.clone();
    let plan = fit::plan(config, derived, &known, how)?;
    let redo = plan.redo.clone();
    announce(&redo, "fit", plan.total(), watch);
    let (fits, models) = (AtomicUsize::new(0), plan.total());
    let on_event = |event: FitEvent| match event {
        FitEvent::Fitted(fit) => {
            watch.step(&format!("{} {}", fit.campaign, fit.model));
            let FitRow { campaign, model, status, j, .. } = fit;
            tracing::debug!(campaign, %model, j, %status, "fit");
            fits.fetch_add(1, Ordering::Relaxed);
        }
        FitEvent::Replicate { campaign, model, done, total } => {
            stop_if_asked(|| format!("{} of {models} fits", fits.load(Ordering::Relaxed)));
            watch.part(&format!("{campaign} {model} replicate"), done, total);
        }
    };
    let (fitted, state) = fit::fit_planned(config, derived, plan, &on_event)?;
    record.fit = state;
    if !redo.is_empty() {
        record.save(derived)?;
    }
    Ok((fitted, redo))
}

/// Draws what has changed; who calls it records it.
pub(super) fn draw_planned(
    config: &Config,
    record: &mut Record,
    how: How,
    watch: &dyn Watch,
) -> Result<(Reported, Redo), RunError> {
    let known = record.report.clone();
    let plan = report::plan(&ReportInput::new(config), &known, how)?;
    let redo = plan.redo.clone();
    announce(&redo, "report", 1, watch);
    let (reported, state) = report::report_planned(&ReportInput::new(config), plan)?;
    if !redo.is_empty() {
        reported.missing.iter().for_each(|missing| tracing::warn!(missing, "not drawn"));
    }
    record.report = state;
    if !redo.is_empty() {
        watch.step(&format!("{} figures and pages", redo.things.len()));
    }
    Ok((reported, redo))
}

fn announce(redo: &Redo, stage: &'static str, total: usize, watch: &dyn Watch) {
    watch.planned(redo);
    if !redo.is_empty() {
        watch.begin(stage, total);
    }
}
