//! The whole way from a trial folder to the page, and a record of how it went.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

use serde::Serialize;

use crate::config::{Config, ConfigError};
use crate::fit::{FitEvent, Fitted, fit_folder};
use crate::ingest::{IngestError, Ingested, ingest_folder};
use crate::report::{ReportError, Reported, report};
use crate::store::{ComparisonRow, FitRow, RobotParameterRow, StoreError, TrialRow, write_bytes};
use crate::trial::TrialList;

/// Somebody who watches a run.
pub trait Watch: Sync {
    /// A stage begins that has `total` steps.
    fn begin(&self, stage: &'static str, total: usize);
    /// A step is done; steps may end on any thread.
    fn step(&self, what: &str);
    /// Something smaller than a step is done: `done` of `total` parts of `what`.
    fn part(&self, what: &str, done: usize, total: usize);
}

/// Why a run ended before its end.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    #[error(transparent)]
    Trials(#[from] ConfigError),
    #[error(transparent)]
    Ingest(#[from] IngestError),
    #[error(transparent)]
    Fit(#[from] StoreError),
    #[error(transparent)]
    Report(#[from] ReportError),
}

/// `run.json`: what ran, how long it took and what failed.
#[derive(Debug, Clone, Serialize)]
pub struct RunRecord {
    pub program: &'static str,
    pub version: &'static str,
    /// Trial folder.
    pub folder: PathBuf,
    pub threads: usize,
    pub stages: Vec<StageRecord>,
    pub trials: TrialCounts,
    /// Trials that need a person, with the reason.
    pub attention: Vec<Attention>,
    pub fits: Vec<FitRecord>,
    /// Figures drawn.
    pub figures: Vec<String>,
    /// What could not be drawn, and why.
    pub missing: Vec<String>,
    pub page: PathBuf,
}

/// One stage of a run.
#[derive(Debug, Clone, Serialize)]
pub struct StageRecord {
    pub stage: &'static str,
    pub seconds: f64,
}

/// How many trials ended how.
#[derive(Debug, Clone, Default, Serialize)]
pub struct TrialCounts {
    pub total: usize,
    pub ok: usize,
    pub flagged: usize,
    pub failed: usize,
}

/// A trial that needs a person.
#[derive(Debug, Clone, Serialize)]
pub struct Attention {
    pub trial: String,
    pub status: String,
    pub message: String,
}

/// How one fit ended.
#[derive(Debug, Clone, Serialize)]
pub struct FitRecord {
    pub campaign: String,
    pub model: String,
    pub status: String,
    /// Missing where there is no fit.
    pub j: Option<f64>,
}

/// Everything that a run gives.
#[derive(Debug)]
pub struct Finished {
    pub record: RunRecord,
    /// What releases and coast-downs say of the robots.
    pub parameters: Vec<RobotParameterRow>,
    pub fits: Vec<FitRow>,
    pub comparison: Vec<ComparisonRow>,
    /// Where the record was written.
    pub record_path: PathBuf,
}

/// Ingests, fits and reports the folder that `config` names, and writes `run.json`.
///
/// # Errors
/// A stage that cannot be done at all. Trials and fits that fail are rows with a status.
pub fn run(config: &Config, watch: &dyn Watch) -> Result<Finished, RunError> {
    let mut stages = Vec::new();
    let ingested = timed(&mut stages, "ingest", || ingest(config, watch))?;
    let fitted = timed(&mut stages, "fit", || fit(config, watch))?;
    let reported = timed(&mut stages, "report", || draw(config, watch))?;
    let record = RunRecord {
        program: env!("CARGO_PKG_NAME"),
        version: env!("CARGO_PKG_VERSION"),
        folder: config.paths.raw.clone(),
        threads: rayon::current_num_threads(),
        stages,
        trials: count(&ingested.trials),
        attention: attention(&ingested.trials),
        fits: fitted.fits.iter().map(FitRecord::new).collect(),
        figures: reported.figures,
        missing: reported.missing,
        page: reported.page,
    };
    let record_path = config.paths.reports.join("run.json");
    let json = serde_json::to_string_pretty(&record).expect("a record is plain data") + "\n";
    write_bytes(&record_path, json.as_bytes())?;
    let Fitted { fits, comparison, .. } = fitted;
    Ok(Finished { record, parameters: ingested.parameters, fits, comparison, record_path })
}

/// The first stage: marker files to tables.
///
/// # Errors
/// The list of trials cannot be read, or a table not written.
pub fn ingest(config: &Config, watch: &dyn Watch) -> Result<Ingested, RunError> {
    let folder: &Path = &config.paths.raw;
    watch.begin("ingest", TrialList::load(folder)?.trial.len());
    let on_trial = |trial: &TrialRow| watch.step(&format!("{} {}", trial.trial, trial.status));
    Ok(ingest_folder(config, folder, &config.paths.derived, &on_trial)?)
}

/// The second stage: tables to fitted models.
///
/// # Errors
/// The table of trials cannot be read, or a table not written.
pub fn fit(config: &Config, watch: &dyn Watch) -> Result<Fitted, RunError> {
    watch.begin("fit", config.campaign.values().map(|campaign| campaign.models.len()).sum());
    let done: Mutex<BTreeMap<String, usize>> = Mutex::default();
    let on_event = |event: FitEvent| match event {
        FitEvent::Fitted(fit) => watch.step(&format!("{} {}", fit.campaign, fit.model)),
        FitEvent::Replicate { campaign, model, total } => {
            if let Ok(mut done) = done.lock() {
                let what = format!("{campaign} {model} replicate");
                let count = done.entry(what.clone()).or_default();
                *count += 1;
                watch.part(&what, *count, total);
            }
        }
    };
    Ok(fit_folder(config, &config.paths.derived, &on_event)?)
}

/// The third stage: figures and the page.
///
/// # Errors
/// A table cannot be read, or a file not written.
pub fn draw(config: &Config, watch: &dyn Watch) -> Result<Reported, RunError> {
    watch.begin("report", 1);
    let reported = report(config)?;
    watch.step(&format!("{} figures", reported.figures.len()));
    Ok(reported)
}

fn timed<T>(
    stages: &mut Vec<StageRecord>,
    stage: &'static str,
    work: impl FnOnce() -> Result<T, RunError>,
) -> Result<T, RunError> {
    let begin = Instant::now();
    let result = work()?;
    stages.push(StageRecord { stage, seconds: begin.elapsed().as_secs_f64() });
    Ok(result)
}

/// Counts trials by their status.
pub fn count(trials: &[TrialRow]) -> TrialCounts {
    let with = |status: &str| trials.iter().filter(|trial| trial.status == status).count();
    TrialCounts {
        total: trials.len(),
        ok: with("ok"),
        flagged: with("flagged"),
        failed: with("failed"),
    }
}

/// The trials that are not `ok`.
pub fn attention(trials: &[TrialRow]) -> Vec<Attention> {
    let others = trials.iter().filter(|trial| trial.status != "ok");
    others
        .map(|trial| Attention {
            trial: trial.trial.clone(),
            status: trial.status.clone(),
            message: trial.message.clone(),
        })
        .collect()
}

impl FitRecord {
    fn new(fit: &FitRow) -> Self {
        Self {
            campaign: fit.campaign.clone(),
            model: fit.model.clone(),
            status: fit.status.clone(),
            j: fit.j.is_finite().then_some(fit.j),
        }
    }
}
