//! The whole way from a trial folder to the page, as far as something changed, and a record of
//! how it went.

mod look;
mod stages;
mod summary;

use std::path::PathBuf;
use std::time::Instant;

use serde::Serialize;

use crate::clock::utc_now;
use crate::config::{Config, ConfigError};
use crate::fit::Fitted;
use crate::ingest::{IngestError, Ingested};
use crate::interrupt::{Interrupted, abandonable};
use crate::report::{ReportError, Reported};
use crate::store::{
    ComparisonRow, FitRow, How, Record, Redo, RobotParameterRow, Stamp, StoreError, write_bytes,
};

pub use look::{Ahead, look};
pub use stages::{draw, fit, ingest};
use summary::BrokenRecord;

pub use summary::{Attention, FitRecord, RunRecord, StageRecord, TrialCounts, attention, count};

/// Somebody who watches a run.
pub trait Watch: Sync {
    /// A stage begins that has `total` steps.
    fn begin(&self, stage: &'static str, total: usize);
    /// A step is done; steps may end on any thread.
    fn step(&self, what: &str);
    /// Something smaller than a step is done: `done` of `total` parts of `what`.
    fn part(&self, what: &str, done: usize, total: usize);
    /// What a stage is about to do again.
    fn planned(&self, _redo: &Redo) {}
    /// Something that a person should know.
    fn note(&self, _message: &str) {}
}

/// Why a run ended before its end.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    #[error(transparent)]
    Trials(#[from] ConfigError),
    #[error(transparent)]
    Ingest(#[from] IngestError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Report(#[from] ReportError),
    #[error("{0}; --wait waits for it")]
    Held(StoreError),
    #[error(
        "interrupted during {stage}{}; left: {}. Every file is whole, as this run or the one \
         before wrote it",
        after(done),
        left(stage)
    )]
    Interrupted { stage: &'static str, done: String },
}

/// The stages of a run, in order.
const STAGES: [&str; 3] = ["ingest", "fit", "report"];

fn after(done: &str) -> String {
    if done.is_empty() { String::new() } else { format!(" after {done}") }
}

/// The stages that were not done when one was interrupted.
fn left(stage: &str) -> String {
    let done = STAGES.iter().position(|known| *known == stage).unwrap_or(0);
    STAGES[done..].join(", ")
}

/// How a run is done.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Options {
    pub how: How,
    /// Wait for another run on the same folder, instead of giving up.
    pub wait: bool,
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
    /// Whether there was nothing to do, and nothing was written.
    pub was_up_to_date: bool,
    /// Why the run is not in the history.
    pub history_problem: Option<String>,
}

/// Ingests, fits and reports what has changed of the folder that `config` names, and writes
/// `run.json`. The results are those of a run from scratch, to the last byte. Where nothing has
/// changed, nothing is written.
///
/// # Errors
/// A stage that cannot be done at all, or another run that is busy with the same folder. Trials
/// and fits that fail are rows with a status.
pub fn run(config: &Config, options: Options, watch: &dyn Watch) -> Result<Finished, RunError> {
    let (known, problem) = Record::load(&config.paths.derived);
    problem.iter().for_each(|problem| watch.note(problem));
    // Looking comes first: an unchanged folder is not even locked.
    match look::up_to_date(config, &known, options.how) {
        Ok(Some(results)) => return Ok(results.into_finished(config, &Begun::now(), true)),
        // Somebody else may be changing what was looked at; the lock tells.
        Err(_) if config.paths.derived.is_dir() => {}
        Err(error) => return Err(error),
        Ok(None) => {}
    }
    let _lock = stages::take_over(config, options.wait, watch)?;
    let (begun, mut stages) = (Begun::now(), Vec::new());
    let finished = run_locked(config, options.how, watch, &begun, &mut stages);
    if let Err(error) = &finished {
        // Why the run ended is to be said, not why that could not be recorded.
        let _ = write_record(config, &BrokenRecord::new(config, error, &begun, &stages));
    }
    finished
}

/// When a run began.
struct Begun {
    /// UTC.
    at: String,
    instant: Instant,
}

impl Begun {
    fn now() -> Self {
        Self { at: utc_now(), instant: Instant::now() }
    }
}

fn run_locked(
    config: &Config,
    how: How,
    watch: &dyn Watch,
    begun: &Begun,
    stages: &mut Vec<StageRecord>,
) -> Result<Finished, RunError> {
    // Whoever held the lock may have been faster.
    let (known, _) = Record::load(&config.paths.derived);
    let mut record = known.clone();
    let ingested =
        timed(stages, "ingest", || stages::ingest_planned(config, &mut record, how, watch))?;
    let fitted = timed(stages, "fit", || stages::fit_planned(config, &mut record, how, watch))?;
    let reported =
        timed(stages, "report", || stages::draw_planned(config, &mut record, how, watch))?;

    let is_new = |stage: &StageRecord| stage.did_something;
    let did_nothing = !stages.iter().any(is_new) && look::is_recorded(config, &known, how);
    let results = Results { ingested, fitted, reported, stages: std::mem::take(stages) };
    let mut finished = results.into_finished(config, begun, did_nothing);
    if !did_nothing {
        record.run = Some(write_record(config, &finished.record)?);
        let remembered = crate::compare::remember(&config.paths);
        finished.history_problem = remembered.err().map(|error| error.to_string());
    }
    // Last, so that what it says is there.
    record.save(&config.paths.derived)?;
    Ok(finished)
}

/// Writes `run.json`.
fn write_record(config: &Config, record: &impl Serialize) -> Result<Stamp, StoreError> {
    let json = serde_json::to_string_pretty(record).expect("a record is plain data");
    write_bytes(&record_path(config), (json + "\n").as_bytes())
}

fn timed<T>(
    stages: &mut Vec<StageRecord>,
    stage: &'static str,
    work: impl FnOnce() -> Result<(T, Redo), RunError>,
) -> Result<T, RunError> {
    let begin = Instant::now();
    tracing::info!(stage, "stage begins");
    let interrupted = |Interrupted { done }| Err(RunError::Interrupted { stage, done });
    let (result, redo) = abandonable(work).unwrap_or_else(interrupted)?;
    let seconds = begin.elapsed().as_secs_f64();
    tracing::info!(stage, seconds, "stage done");
    stages.push(StageRecord::new(stage, seconds, redo));
    Ok(result)
}

/// What the stages gave.
struct Results {
    ingested: Ingested,
    fitted: Fitted,
    reported: Reported,
    stages: Vec<StageRecord>,
}

impl Results {
    fn into_finished(self, config: &Config, begun: &Begun, was_up_to_date: bool) -> Finished {
        let Self { ingested, fitted, reported, stages } = self;
        let trials = count(&ingested.trials);
        let record = RunRecord {
            program: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            status: if trials.failed == 0 { "ok" } else { "attention" },
            started: begun.at.clone(),
            ended: utc_now(),
            seconds: begun.instant.elapsed().as_secs_f64(),
            folder: config.paths.raw.clone(),
            threads: rayon::current_num_threads(),
            stages,
            trials,
            attention: attention(&ingested.trials),
            fits: fitted.fits.iter().map(FitRecord::new).collect(),
            figures: reported.figures,
            missing: reported.missing,
            page: reported.page,
            scorecard: reported.scorecard,
        };
        let Fitted { fits, comparison, .. } = fitted;
        let (parameters, record_path) = (ingested.parameters, record_path(config));
        Finished {
            record,
            parameters,
            fits,
            comparison,
            record_path,
            was_up_to_date,
            history_problem: None,
        }
    }
}

fn record_path(config: &Config) -> PathBuf {
    config.paths.reports.join("run.json")
}

impl RunError {
    fn of_lock(error: StoreError) -> Self {
        match error {
            StoreError::Held { .. } => Self::Held(error),
            other => Self::Store(other),
        }
    }
}
