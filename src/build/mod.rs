//! From a trial folder to the page, as far as something changed: what is up to date, what is
//! redone and why, in which order, and a record of how it went.

mod fit;
mod ingest;
mod lock;
mod plan;
mod record;
mod report;
mod summary;
mod target;

use std::path::PathBuf;
use std::time::Instant;

use serde::Serialize;

use crate::clock::utc_now;
use crate::config::{Config, ConfigError};
use crate::fit::Fitted;
use crate::ingest::{IngestError, Ingested};
use crate::interrupt::{Interrupted, abandonable};
use crate::report::{ReportError, Reported};
use crate::store::{ComparisonRow, FitRow, RobotParameterRow, Stamp, StoreError, write_bytes};

use fit::FitStage;
use ingest::IngestStage;
use lock::{LOCK_FILE, Lock, check_places, sweep, unfinished};
pub use plan::{PlannedTarget, RerunOptions, StagePlan};
use plan::{Stage, plan, plan_after};
use record::{RECORD_FILE, Record, StageState};
use report::ReportStage;
pub use summary::{
    Attention, FitRecord, RunHeader, RunRecord, StageRecord, TrialCounts, attention, count,
};
pub use target::Target;

/// Somebody who watches a run.
pub trait Watch: Sync {
    /// A stage begins that has `total` steps.
    fn begin(&self, _stage: &'static str, _total: usize) {}
    /// A step is done; steps may end on any thread.
    fn step(&self, _what: &str) {}
    /// Something smaller than a step is done: `done` of `total` parts of `what`.
    fn part(&self, _what: &str, _done: usize, _total: usize) {}
    /// What a stage is about to do again.
    fn planned(&self, _plan: &StagePlan) {}
    /// Something that a person should know.
    fn note(&self, _message: &str) {}
}

/// Nobody watches.
impl Watch for () {}

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

fn after(done: &str) -> String {
    if done.is_empty() { String::new() } else { format!(" after {done}") }
}

/// The stages that were not done when one was interrupted.
fn left(stage: &str) -> String {
    let stages = [IngestStage::NAME, FitStage::NAME, ReportStage::NAME];
    let done = stages.iter().position(|known| *known == stage).unwrap_or(0);
    stages[done..].join(", ")
}

/// Everything that a run gives.
#[derive(Debug)]
pub struct Finished {
    pub record: RunRecord,
    /// What releases and coast-downs say of the robots.
    pub parameters: Vec<RobotParameterRow>,
    pub fits: Vec<FitRow>,
    pub comparison: Vec<ComparisonRow>,
    /// Whether there was nothing to do, and nothing was written.
    pub was_up_to_date: bool,
    /// Why the run is not in the history.
    pub history_problem: Option<String>,
}

/// Ingests, fits and reports what has changed of the folder that `config` names, and writes
/// `run.json`. The results are those of a run from scratch, to the last byte. Where nothing has
/// changed, nothing is written. If another run is busy with the folder, `wait` waits for it.
///
/// ```
/// use trilink::build::{RerunOptions, run};
/// use trilink::config::Config;
/// use trilink::synth::{Recipe, synthesise};
///
/// let folder = tempfile::tempdir()?;
/// let mut config = Config::default();
/// config.campaign.retain(|name, _| name == "kinematic-skewed");
/// (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (1, 0, false);
/// for path in [&mut config.paths.raw, &mut config.paths.derived, &mut config.paths.reports] {
///     *path = folder.path().join(&*path);
/// }
/// let recipe = Recipe { omegas_rad_s: vec![3.0, 4.0], ..Recipe::new(1) };
/// synthesise(&config, &config.paths.raw, &recipe, &|_| {})?;
///
/// let finished = run(&config, RerunOptions::default(), false, &())?;
/// assert!(finished.record.page.is_file() && !finished.was_up_to_date);
/// assert!(run(&config, RerunOptions::default(), false, &())?.was_up_to_date);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A stage that cannot be done at all, or another run that is busy with the same folder. Trials
/// and fits that fail are rows with a status.
pub fn run(
    config: &Config,
    options: RerunOptions,
    wait: bool,
    watch: &dyn Watch,
) -> Result<Finished, RunError> {
    let (known, problem) = Record::load(&config.paths.derived);
    problem.iter().for_each(|problem| watch.note(problem));
    // Looking comes first: an unchanged folder is not even locked.
    match up_to_date(config, &known, options) {
        Ok(Some(results)) => return Ok(results.into_finished(config, &Begun::now(), true)),
        // Somebody else may be changing what was looked at; the lock tells.
        Err(_) if config.paths.derived.is_dir() => {}
        Err(error) => return Err(error),
        Ok(None) => {}
    }
    let _lock = take_over(config, wait, watch)?;
    let (begun, mut stages) = (Begun::now(), Vec::new());
    let finished = run_locked(config, options, watch, &begun, &mut stages);
    if let Err(error) = &finished {
        let is_interrupted = matches!(error, RunError::Interrupted { .. });
        let status = if is_interrupted { "interrupted" } else { "failed" };
        let header = RunHeader::new(config, status, &begun, stages);
        // Why the run ended is to be said, not why that could not be recorded.
        let _ = write_record(config, &RunHeader { error: Some(error.to_string()), ..header });
    }
    finished
}

/// The results, if nothing at all has changed and nothing is worth to be recorded.
fn up_to_date(
    config: &Config,
    known: &Record,
    options: RerunOptions,
) -> Result<Option<Results>, RunError> {
    let ingest = plan(&IngestStage::new(config)?, &known.ingest, options)?.up_to_date();
    let Some((ingested, ingest)) = ingest else { return Ok(None) };
    let fit = plan(&FitStage::new(config), &known.fit, options)?.up_to_date();
    let Some((fitted, fit)) = fit else { return Ok(None) };
    let report = plan(&ReportStage::new(config), &known.report, options)?.up_to_date();
    let Some((reported, report)) = report else { return Ok(None) };
    if !is_recorded(config, known, options) || !unfinished(&folders(config)).is_empty() {
        return Ok(None);
    }
    let stages = vec![
        StageRecord::new(IngestStage::NAME, 0.0, &ingest),
        StageRecord::new(FitStage::NAME, 0.0, &fit),
        StageRecord::new(ReportStage::NAME, 0.0, &report),
    ];
    Ok(Some(Results { ingested, fitted, reported, stages }))
}

/// Whether `run.json` is as it was written.
fn is_recorded(config: &Config, known: &Record, options: RerunOptions) -> bool {
    let path = record_path(config);
    known.run.as_ref().is_some_and(|stamp| stamp.is_intact(&path, options.verify))
}

/// What a run would do: certainly if the stages before have nothing to do, else perhaps.
#[derive(Debug)]
pub struct DryRun {
    pub stages: [StagePlan; 3],
    /// The first stage of which only the worst is known.
    pub uncertain_from: usize,
    /// What else would be written.
    pub others: Vec<String>,
    /// Why the record cannot be used.
    pub problem: Option<String>,
}

/// What a run would redo. Writes nothing.
///
/// # Errors
/// The list of trials or a table cannot be used.
pub fn dry_run(config: &Config, options: RerunOptions) -> Result<DryRun, RunError> {
    let (known, problem) = Record::load(&config.paths.derived);
    let certain =
        |stages, uncertain_from, others| Ok(DryRun { stages, uncertain_from, others, problem });
    let (trials, models) = (IngestStage::new(config)?, FitStage::new(config));
    let figures = ReportStage::new(config);
    let ingest = plan(&trials, &known.ingest, options)?.plan;
    let mut touched = trials.touched(&ingest);
    let of_fits = |fit: &StagePlan| -> Vec<String> {
        let targets = fit.targets.iter().map(|planned| &planned.target).chain(&fit.removed);
        let campaign = |target: &Target| match target {
            Target::Fit { campaign, .. } => Some(campaign.clone()),
            _ => None,
        };
        targets.filter_map(campaign).collect()
    };
    let (fit, uncertain_from) = match ingest.is_empty() {
        false => (plan_after(&models, &known.fit, options, &touched), 1),
        true => (plan(&models, &known.fit, options)?.plan, 2),
    };
    if !ingest.is_empty() || !fit.is_empty() {
        touched.campaigns.extend(of_fits(&fit));
        let report = plan_after(&figures, &known.report, options, &touched);
        return certain([ingest, fit, report], uncertain_from, Vec::new());
    }
    let report = plan(&figures, &known.report, options)?.plan;
    let mut others = Vec::new();
    if !unfinished(&folders(config)).is_empty() {
        others.push("a killed run left unfinished files".to_owned());
    }
    if !is_recorded(config, &known, options) {
        others.push("run.json is not as it was written".to_owned());
    }
    certain([ingest, fit, report], 3, others)
}

/// The first stage, of all trials: marker files to tables.
///
/// # Errors
/// The list of trials cannot be read, a table not written, or another run is busy.
pub fn ingest(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Ingested, RunError> {
    alone(config, wait, watch, IngestStage::new, |record| &mut record.ingest)
}

/// The second stage, of all models: tables to fitted models.
///
/// # Errors
/// The table of trials cannot be read, a table not written, or another run is busy.
pub fn fit(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Fitted, RunError> {
    alone(config, wait, watch, |config| Ok(FitStage::new(config)), |record| &mut record.fit)
}

/// The third stage, of all figures: figures and the page.
///
/// # Errors
/// A table cannot be read, a file not written, or another run is busy.
pub fn report(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Reported, RunError> {
    alone(config, wait, watch, |config| Ok(ReportStage::new(config)), |record| &mut record.report)
}

/// One stage, of all targets.
fn alone<S: Stage>(
    config: &Config,
    wait: bool,
    watch: &dyn Watch,
    stage: fn(&Config) -> Result<S, RunError>,
    of: fn(&mut Record) -> &mut StageState,
) -> Result<S::Output, RunError> {
    let _lock = take_over(config, wait, watch)?;
    let (mut record, _) = Record::load(&config.paths.derived);
    Ok(advance(config, &stage(config)?, &mut record, of, RerunOptions::FORCE, watch)?.0)
}

/// Does what a stage has to do, and records it.
fn advance<S: Stage>(
    config: &Config,
    stage: &S,
    record: &mut Record,
    of: fn(&mut Record) -> &mut StageState,
    options: RerunOptions,
    watch: &dyn Watch,
) -> Result<(S::Output, StagePlan), RunError> {
    let known = of(record).clone();
    let (output, plan, state) = plan(stage, &known, options)?.carry_out(stage, watch)?;
    *of(record) = state;
    if !plan.is_empty() {
        record.save(&config.paths.derived)?;
    }
    Ok((output, plan))
}

/// Takes the lock of the folder of results, and makes sure that there is where to write to.
fn take_over(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Lock, RunError> {
    let (derived, reports) = (&config.paths.derived, &config.paths.reports);
    let folders = folders(config);
    let names = [LOCK_FILE, RECORD_FILE].into_iter();
    let names = names.chain(crate::ingest::TABLES).chain(crate::fit::TABLES);
    let mut files: Vec<PathBuf> = names.map(|name| derived.join(name)).collect();
    files.extend(crate::report::FILES.map(|name| reports.join(name)));
    files.push(record_path(config));
    check_places(&folders[..1], &files[..1])?;
    let waiting = |held: &str| watch.note(&format!("{held}; waiting"));
    let on_wait: Option<&dyn Fn(&str)> = if wait { Some(&waiting) } else { None };
    let lock = Lock::take(derived, on_wait).map_err(|error| match error {
        StoreError::Held { .. } => RunError::Held(error),
        other => RunError::Store(other),
    })?;
    check_places(&folders, &files)?;
    sweep(&lock, &folders)?;
    Ok(lock)
}

/// Folders that are written to, `derived/` first.
fn folders(config: &Config) -> Vec<PathBuf> {
    let (derived, reports) = (&config.paths.derived, &config.paths.reports);
    let mut folders =
        vec![derived.clone(), reports.clone(), reports.join("figures"), reports.join("trials")];
    folders.extend(crate::ingest::FOLDERS.map(|folder| derived.join(folder)));
    folders
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
    options: RerunOptions,
    watch: &dyn Watch,
    begun: &Begun,
    stages: &mut Vec<StageRecord>,
) -> Result<Finished, RunError> {
    // Whoever held the lock may have been faster.
    let (known, _) = Record::load(&config.paths.derived);
    let record = &mut known.clone();
    let ingested = timed(stages, IngestStage::NAME, || {
        advance(config, &IngestStage::new(config)?, record, |r| &mut r.ingest, options, watch)
    })?;
    let fitted = timed(stages, FitStage::NAME, || {
        advance(config, &FitStage::new(config), record, |r| &mut r.fit, options, watch)
    })?;
    let reported = timed(stages, ReportStage::NAME, || {
        advance(config, &ReportStage::new(config), record, |r| &mut r.report, options, watch)
    })?;

    let is_new = |stage: &StageRecord| stage.did_something;
    let did_nothing = !stages.iter().any(is_new) && is_recorded(config, &known, options);
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
    work: impl FnOnce() -> Result<(T, StagePlan), RunError>,
) -> Result<T, RunError> {
    let begin = Instant::now();
    tracing::info!(stage, "stage begins");
    let interrupted = |Interrupted { done }| Err(RunError::Interrupted { stage, done });
    let (result, plan) = abandonable(work).unwrap_or_else(interrupted)?;
    let seconds = begin.elapsed().as_secs_f64();
    tracing::info!(stage, seconds, "stage done");
    stages.push(StageRecord::new(stage, seconds, &plan));
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
        let status = if trials.failed == 0 { "ok" } else { "attention" };
        let record = RunRecord {
            header: RunHeader::new(config, status, begun, stages),
            trials,
            attention: attention(&ingested.trials),
            fits: fitted.fits.iter().map(FitRecord::new).collect(),
            figures: reported.figures,
            missing: reported.missing,
            page: reported.page,
            scorecard: reported.scorecard,
        };
        let (Fitted { fits, comparison, .. }, parameters) = (fitted, ingested.parameters);
        Finished { record, parameters, fits, comparison, was_up_to_date, history_problem: None }
    }
}

fn record_path(config: &Config) -> PathBuf {
    config.paths.reports.join("run.json")
}
