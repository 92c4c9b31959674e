//! From trial folders to the page, as far as something changed: what is up to date, what is
//! redone and why, in which order, and a record of how it went.

mod fit;
mod ingest;
mod last_run;
mod lock;
mod own_table;
mod part;
mod plan;
mod record;
mod report;
mod shards;
mod steps;
mod summary;
mod target;
mod unconfigured;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::Instant;

use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_fit::{Fitted, input_paths};
use trilink_ingest::own_table::OwnTableError;
use trilink_ingest::{FolderInput, Ingested};
use trilink_report::{ReportError, Reported};
use trilink_tables::clock::utc_now;
use trilink_tables::config::{Config, ConfigError, did_you_mean};
use trilink_tables::trial::{TRIALS_FILE, find_folders};
use trilink_tables::{Reader, RunStatus, Stamp, StoreError, unfinished, write_bytes};

use fit::FitStage;
use ingest::IngestStage;
use last_run::{LastRun, confirm};
pub use last_run::{check_finished, hold};
pub use lock::{Lock, share, sweep};
use lock::{folders, record_path, take_over};
pub use own_table::fit_own_table;
pub use part::Part;
pub use plan::{PlannedTarget, RerunOptions, StagePlan};
use plan::{Stage, hash_of, plan, plan_after};
use record::Record;
use report::ReportStage;
pub use shards::{Merged, PartStatus, ShardsStatus, fit_shard, ingest_shard, merge, shards_status};
use summary::{RunRecord, results_configuration};
pub use summary::{RunResults, StageRecord, TrialCounts, count};
pub use target::{Kind, Target};
pub use unconfigured::{check_unconfigured, check_unconfigured_tables};

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
    /// Cancels the run; by default nothing does.
    fn cancel_token(&self) -> CancelToken {
        CancelToken::default()
    }
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
    Store(#[from] StoreError),
    #[error(transparent)]
    Report(#[from] ReportError),
    #[error(transparent)]
    OwnTable(#[from] OwnTableError),
    #[error(
        "found no pipeline.toml here, without which the paper's experiment is assumed, but {why}; needed the \
         configuration of these trials: name it with -c FILE, or begin one with `trilink init {folders}` \
         (`trilink demo` shows the paper's)"
    )]
    Unconfigured { why: String, folders: String },
    #[error(
        "{}: found the place of ingested trials, whose fits would be replaced; needed another folder \
         for a table that was made elsewhere",
        home.display()
    )]
    OwnTablePlace { home: PathBuf },
    /// There is something to do, and nothing may be written.
    #[error("something has changed")]
    Outdated,
    #[error(
        "{}: found no trials.toml, needed the folder because {} has tables of its trials; --only \
         removes those of folders that are not named",
        folder.display(),
        derived.display()
    )]
    FolderGone { folder: PathBuf, derived: PathBuf },
    #[error(
        "{0}: found no parts, needed those that `trilink ingest --shard 3/8 --into {0}` or `trilink \
         fit --replicates 0..500 --into {0}` leaves",
        shards.display()
    )]
    NoShards { shards: PathBuf },
    #[error("nothing is merged because of{problems}{}", to_do(again))]
    Shards { problems: String, again: String },
    #[error("{part}: found `fit.bootstrap` = {bootstrap}, needed {} at least", part.to)]
    Replicates { part: Part, bootstrap: usize },
    #[error(
        "{}: found tables of trials of {folder}, needed only those of the folders that the parts \
         are of: {}; make parts of all folders, or remove the tables",
        derived.display(),
        of.join(", ")
    )]
    OtherFolder { derived: PathBuf, folder: String, of: Vec<String> },
    #[error("{0}; --wait waits for it")]
    Held(StoreError),
    #[error("found no trial {trial} in trials.parquet, needed one of its{meant}")]
    NoTrial { trial: String, meant: String },
    #[error("{}: {problem}; needed the results of a run that came to its end: `trilink run`", path.display())]
    Unfinished { path: PathBuf, problem: String },
    #[error(
        "interrupted during {stage}{}; left: {}. Every file is whole, as this run or the one \
         before wrote it",
        after(done),
        left(stage)
    )]
    Interrupted { stage: &'static str, done: String },
    /// Cancelled before the first stage.
    #[error(transparent)]
    Stopped(#[from] Cancelled),
}

impl RunError {
    /// Of a lock that was not taken.
    fn of_lock(error: StoreError) -> Self {
        match error {
            StoreError::Held { .. } => Self::Held(error),
            StoreError::Cancelled(_) => Self::Stopped(Cancelled),
            other => Self::Store(other),
        }
    }

    /// It as the end of a stage of which so much was `done`, if the work was cancelled.
    fn interrupted(self, stage: &'static str, done: String) -> Self {
        match self {
            Self::Stopped(Cancelled)
            | Self::Store(StoreError::Cancelled(_))
            | Self::Report(ReportError::Store(StoreError::Cancelled(_))) => {
                Self::Interrupted { stage, done }
            }
            other => other,
        }
    }

    /// Whether a table is not as it was written, although its size and time are.
    fn is_of_changed_table(&self) -> bool {
        use ReportError::Store;
        let (Self::Store(error) | Self::Report(Store(error))) = self else { return false };
        matches!(error, StoreError::Changed { .. })
    }
}

fn to_do(again: &str) -> String {
    if again.is_empty() { String::new() } else { format!("\nto do again: {again}") }
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
    pub ingested: Ingested,
    pub fitted: Fitted,
    pub reported: Reported,
    pub stages: Vec<StageRecord>,
    /// Whether there was nothing to do, and nothing was written.
    pub was_up_to_date: bool,
    /// What is wrong with the history.
    pub history_problem: Option<String>,
}

/// Ingests, fits and reports what has changed of the trial folders that `config` names and of those
/// of which there are results, and writes `run.json`. The results are those of a run of all of them
/// from scratch, to the last byte. Where nothing has changed, nothing is written. If another run is
/// busy with the results, `wait` waits for it.
///
/// ```
/// use trilink::build::{RerunOptions, run};
/// use trilink_tables::config::Config;
/// use trilink_synth::{Recipe, synthesise};
///
/// let folder = tempfile::tempdir()?;
/// let mut config = Config::default();
/// config.campaign.retain(|name, _| name == "kinematic-skewed");
/// (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (1, 0, false);
/// config.paths.start_at(folder.path());
/// let recipe = Recipe { omegas_rad_s: vec![3.0, 4.0], ..Recipe::new(1) };
/// synthesise(&config, &config.paths.raw[0], &recipe, &|_| Ok(()))?;
///
/// let finished = run(&config, RerunOptions::default(), false, &())?;
/// assert!(finished.reported.page.is_file() && !finished.was_up_to_date);
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
    let mut look = Sequence::new(config, options, watch);
    look.problem.iter().for_each(|problem| watch.note(problem));
    look.may_write = false;
    // Looking comes first: an unchanged folder is not even locked.
    match look.all() {
        Ok(finished) => {
            confirm(config);
            return Ok(finished);
        }
        Err(RunError::Outdated) => {}
        // Somebody else may be changing what was looked at; the lock tells.
        Err(_) if config.paths.derived.is_dir() => {}
        Err(error) => return Err(error),
    }
    let _lock = take_over(config, wait, watch)?;
    // Whoever held the lock may have been faster.
    let mut sequence = Sequence::new(config, options, watch);
    let remember_failure = |started: &str, status, why: &str| {
        // Why a run ended is to be said, not why that could not be recorded.
        let problem = crate::compare::remember_failure(config, started, status, why);
        problem.ok().flatten().iter().for_each(|problem| watch.note(problem));
    };
    if let Some(LastRun { status: RunStatus::Running, started, .. }) = LastRun::load(config) {
        remember_failure(&started, RunStatus::Interrupted, "killed");
    }
    let mut finished = sequence.all();
    if let Err(error) = &finished
        && error.is_of_changed_table()
        && !options.verify
    {
        watch.note(&format!("{error}: every file is read again"));
        let options = RerunOptions { verify: true, ..options };
        sequence = Sequence::new(config, options, watch);
        finished = sequence.all();
    }
    if let Err(error) = &finished {
        let status = match error {
            RunError::Interrupted { .. } => RunStatus::Interrupted,
            _ => RunStatus::Failed,
        };
        remember_failure(&sequence.began_at, status, &error.to_string());
        let _ = sequence.write_record(status, Some(error.to_string()), None);
    }
    finished
}

/// The stages, one after the other, of a folder of results with its record.
struct Sequence<'s> {
    config: Config,
    options: RerunOptions,
    watch: &'s dyn Watch,
    record: Record,
    /// Why there is no record that can be used.
    problem: Option<String>,
    /// Else it only looks whether there is something to do.
    may_write: bool,
    /// Whether it is a run, of which `run.json` tells, and not one stage alone.
    is_run: bool,
    /// Those that are done.
    stages: Vec<StageRecord>,
    /// UTC.
    began_at: String,
    began: Instant,
}

impl<'s> Sequence<'s> {
    /// A sequence that may write.
    fn new(config: &Config, options: RerunOptions, watch: &'s dyn Watch) -> Self {
        let (record, problem) = Record::load(&config.paths.derived);
        Self {
            config: config.clone(),
            options,
            watch,
            record,
            problem,
            may_write: true,
            is_run: false,
            stages: Vec::new(),
            began_at: utc_now(),
            began: Instant::now(),
        }
    }

    /// Names of the trial folders of which there are tables.
    fn known_folders(&self) -> Vec<String> {
        let known = FolderInput::folders(&self.record.ingest.whole);
        if !known.is_empty() {
            return known;
        }
        // Without a record, the tables themselves tell.
        let table = Reader::default().table(&self.config.paths.derived.join("trials.parquet"));
        let folders = table.and_then(|table| table.values::<String>("folder")).unwrap_or_default();
        let folders: BTreeSet<String> =
            folders.into_iter().filter(|folder| !folder.is_empty()).collect();
        folders.into_iter().collect()
    }

    /// Takes for the trial folders those of which there are tables, if there are any.
    fn take_known_folders(&mut self) {
        let known = self.known_folders();
        let paths = &mut self.config.paths;
        if !known.is_empty() {
            paths.raw = known.iter().map(|name| paths.base.join(name)).collect();
        }
    }

    /// Finds the trial folders that are named, and unless these are to be the only ones adds those
    /// of which there are tables.
    fn find_folders(&mut self) -> Result<(), RunError> {
        let known = if self.options.only { Vec::new() } else { self.known_folders() };
        let paths = &mut self.config.paths;
        paths.raw = find_folders(paths)?;
        let named: BTreeSet<String> = paths.raw.iter().map(|path| paths.name_of(path)).collect();
        for name in known.iter().filter(|name| !named.contains(*name)) {
            let folder = paths.base.join(name);
            if !folder.join(TRIALS_FILE).exists() {
                return Err(RunError::FolderGone { folder, derived: paths.derived.clone() });
            }
            paths.raw.push(folder);
        }
        paths.raw = find_folders(paths)?;
        Ok(())
    }

    /// Does what a stage has to do, and records it.
    fn advance<S: Stage>(&mut self, stage: &S) -> Result<S::Output, RunError> {
        let begin = Instant::now();
        if self.may_write {
            tracing::info!(stage = S::NAME, "stage begins");
        }
        let derived = &self.config.paths.derived;
        let planned = plan(stage, derived, &self.record, self.options)?;
        let (output, plan) = if self.may_write {
            let is_first = !self.stages.iter().any(|stage| stage.did_something);
            if self.is_run && is_first && !planned.plan.is_empty() {
                self.write_record(RunStatus::Running, None, None)?;
            }
            let (output, plan, state) = planned.carry_out(stage, (self.watch, ""))?;
            *self.record.state_mut(S::NAME) = state;
            if !plan.is_empty() {
                self.record.save(derived)?;
            }
            let seconds = begin.elapsed().as_secs_f64();
            tracing::info!(stage = S::NAME, seconds, "stage done");
            (output, plan)
        } else {
            planned.up_to_date().ok_or(RunError::Outdated)?
        };
        self.stages.push(StageRecord::new(S::NAME, begin.elapsed().as_secs_f64(), &plan));
        Ok(output)
    }

    /// All stages and the record of how they went.
    fn all(&mut self) -> Result<Finished, RunError> {
        self.is_run = true;
        self.find_folders()?;
        let config = &self.config.clone();
        let ingested = self.advance(&IngestStage::new(config)?)?;
        let fitted = self.advance(&FitStage::new(config))?;
        let reported = self.advance(&ReportStage::new(config, &self.record.report, &[]))?;
        let did_something = self.stages.iter().any(|stage| stage.did_something);
        let was_up_to_date = !did_something
            && self.is_recorded()
            && unfinished(&folders(config)).is_empty()
            && crate::compare::is_drawn(&config.paths.reports);
        if !self.may_write && !was_up_to_date {
            return Err(RunError::Outdated);
        }
        let stages = self.stages.clone();
        let history_problem = None;
        let mut finished =
            Finished { ingested, fitted, reported, stages, was_up_to_date, history_problem };
        if !was_up_to_date {
            let status = match finished.ingested.needs_a_person() {
                true => RunStatus::Attention,
                false => RunStatus::Ok,
            };
            self.record.run = Some(self.write_record(status, None, Some(&finished))?);
            let remembered = crate::compare::remember(config);
            let problem = |error| Some(format!("not in the history: {error}"));
            finished.history_problem = remembered.unwrap_or_else(problem);
        }
        if self.may_write {
            // Last, so that what it says is there.
            self.record.save(&config.paths.derived)?;
        }
        Ok(finished)
    }

    /// Whether `run.json` is as it was written.
    fn is_recorded(&self) -> bool {
        let path = record_path(&self.config);
        let run = self.record.run.as_ref();
        run.is_some_and(|stamp| stamp.is_intact(&path, self.options.verify))
    }

    /// Writes `run.json`.
    fn write_record(
        &self,
        status: RunStatus,
        error: Option<String>,
        finished: Option<&Finished>,
    ) -> Result<Stamp, StoreError> {
        let paths = &self.config.paths;
        let record = RunRecord {
            program: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            source: hash_of(&[IngestStage::SOURCE, FitStage::SOURCE]),
            configuration: results_configuration(&self.config),
            status,
            error,
            started: &self.began_at,
            ended: (status != RunStatus::Running).then(utc_now),
            seconds: self.began.elapsed().as_secs_f64(),
            folders: paths.raw.iter().map(|folder| paths.name_of(folder)).collect(),
            threads: rayon::current_num_threads(),
            stages: &self.stages,
            results: finished.map(RunResults::new),
        };
        let json = serde_json::to_string_pretty(&record).expect("a record is plain data");
        write_bytes(&record_path(&self.config), (json + "\n").as_bytes())
    }
}

/// What a run would do: certainly if the stages before have nothing to do, else perhaps.
#[derive(Debug)]
pub struct DryRun {
    pub stages: [StagePlan; 3],
    /// The first stage of which only the worst is known.
    pub uncertain_from: usize,
    /// What else would be written.
    pub others: Vec<&'static str>,
    /// Why the record cannot be used.
    pub problem: Option<String>,
}

/// What a run would redo. Writes nothing.
///
/// # Errors
/// The list of trials or a table cannot be used.
pub fn dry_run(config: &Config, options: RerunOptions) -> Result<DryRun, RunError> {
    let mut sequence = Sequence::new(config, options, &());
    sequence.find_folders()?;
    let Sequence { config, record, .. } = &sequence;
    let (derived, reports) = (&config.paths.derived, &config.paths.reports);
    let models = FitStage::new(config);
    let figures = ReportStage::new(config, &record.report, &[]);
    let ingest = plan(&IngestStage::new(config)?, derived, record, options)?.plan;
    let fit = match ingest.is_empty() {
        true => plan(&models, derived, record, options)?.plan,
        false => plan_after(&models, record, options, &ingest.touched),
    };
    let (mut uncertain_from, mut others) = (if ingest.is_empty() { 2 } else { 1 }, Vec::new());
    let report = if ingest.is_empty() && fit.is_empty() {
        uncertain_from = 3;
        let unlike = [
            (unfinished(&folders(config)).is_empty(), "a killed run left unfinished files"),
            (sequence.is_recorded(), "run.json is not as it was written"),
            (crate::compare::is_drawn(reports), "history.html is not that of history.parquet"),
        ];
        others
            .extend(unlike.into_iter().filter_map(|(is_well, other)| (!is_well).then_some(other)));
        plan(&figures, derived, record, options)?.plan
    } else {
        plan_after(&figures, record, options, &(&ingest.touched | &fit.touched))
    };
    let stages = [ingest, fit, report];
    Ok(DryRun { stages, uncertain_from, others, problem: sequence.problem })
}

/// The first stage, of all trials: marker files to tables. Those of other folders than the
/// configured ones are done again, too, unless these are to be the `only` ones.
///
/// # Errors
/// A list of trials cannot be read, a table not written, or another run is busy.
pub fn ingest(
    config: &Config,
    only: bool,
    wait: bool,
    watch: &dyn Watch,
) -> Result<Ingested, RunError> {
    let options = RerunOptions { only, ..RerunOptions::FORCE };
    alone(config, options, wait, watch, |sequence| {
        sequence.find_folders()?;
        IngestStage::new(&sequence.config)
    })
}

/// The second stage, of all models: tables to fitted models.
///
/// # Errors
/// The table of trials cannot be read, a table not written, or another run is busy.
pub fn fit(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Fitted, RunError> {
    input_paths(&config.paths.derived)?;
    alone(config, RerunOptions::FORCE, wait, watch, |sequence| Ok(FitStage::new(&sequence.config)))
}

/// What the first stage left of the trials and their checks, as far as it is there.
///
/// # Errors
/// A table cannot be read.
pub fn ingested(config: &Config) -> Result<Ingested, RunError> {
    let (derived, reader) = (&config.paths.derived, Reader::default());
    let trials = reader.rows_if_there(&derived.join("trials.parquet"))?.unwrap_or_default();
    let checks = reader.rows_if_there(&derived.join("checks.parquet"))?.unwrap_or_default();
    Ok(Ingested { trials, checks, ..Ingested::default() })
}

/// The third stage, of all figures: figures and the page, and now and later the pages of the
/// trials that are `asked` for.
///
/// # Errors
/// There is no such trial, a table cannot be read, a file not written, or another run is busy.
pub fn report(
    config: &Config,
    asked: &[String],
    wait: bool,
    watch: &dyn Watch,
) -> Result<Reported, RunError> {
    input_paths(&config.paths.derived)?;
    if !asked.is_empty() {
        let trials = ingested(config)?.trials;
        let known: BTreeSet<&str> = trials.iter().map(|row| row.trial.as_str()).collect();
        if let Some(trial) = asked.iter().find(|trial| !known.contains(trial.as_str())) {
            let meant = did_you_mean(trial, known);
            return Err(RunError::NoTrial { trial: trial.clone(), meant });
        }
    }
    alone(config, RerunOptions::FORCE, wait, watch, |sequence| {
        sequence.take_known_folders();
        Ok(ReportStage::new(&sequence.config, &sequence.record.report, asked))
    })
}

/// One stage, of all targets.
fn alone<S: Stage>(
    config: &Config,
    options: RerunOptions,
    wait: bool,
    watch: &dyn Watch,
    stage: impl Fn(&mut Sequence) -> Result<S, RunError>,
) -> Result<S::Output, RunError> {
    // Where there is nothing to read, no folder is left behind.
    stage(&mut Sequence::new(config, options, watch))?;
    let _lock = take_over(config, wait, watch)?;
    let mut sequence = Sequence::new(config, options, watch);
    let stage = stage(&mut sequence)?;
    if S::NAME != ReportStage::NAME {
        // The tables will be younger than the last run.
        sequence.record.run = None;
    }
    sequence.advance(&stage)
}
