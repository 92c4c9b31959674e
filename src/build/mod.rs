//! Incremental runs from trial folders to the report page: which targets are stale and why, the stages in order, and
//! the record of each run.

mod clean;
mod fit;
mod ingest;
mod last_run;
mod lock;
mod missing;
mod own_table;
mod plan;
mod record;
mod report;
mod shard;
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
use trilink_tables::trial::{TRIALS_FILE, TrialFolder, find_folders};
use trilink_tables::{Reader, RunStatus, Stamp, StoreError, unfinished, write_bytes};

use clean::remove_comparison;
pub use clean::{Cleaned, clean};
use fit::FitStage;
use ingest::IngestStage;
use last_run::confirm;
pub use last_run::{LastRun, check_finished, hold};
pub use lock::{Lock, share, sweep};
use lock::{folders, record_path, take_over};
use missing::MissingFolders;
pub use own_table::fit_own_table;
pub use plan::{PlannedTarget, RerunOptions, StagePlan};
use plan::{Stage, hash_of, plan, plan_after};
use record::Record;
use report::ReportStage;
pub use shard::Shard;
pub use shards::{
    Merged, ShardStatus, ShardsStatus, fit_shard, ingest_shard, merge, shards_status,
};
use summary::{RunRecord, results_configuration};
pub use summary::{RunResults, StageRecord, TrialCounts, count};
pub use target::{Kind, Target};
pub use unconfigured::{
    check_results, check_unconfigured, check_unconfigured_tables, load_unconfigured,
};

/// Observer of a run.
pub trait Watch: Sync {
    /// Called when a stage of `total` steps begins.
    fn begin(&self, _stage: &'static str, _total: usize) {}
    /// Called when a step is complete, from any thread.
    fn step(&self, _what: &str) {}
    /// Called during a step, when `done` of `total` parts of `what` are complete.
    fn part(&self, _what: &str, _done: usize, _total: usize) {}
    /// Called with the plan of a stage before the plan is carried out.
    fn planned(&self, _plan: &StagePlan) {}
    /// Returns the token that cancels the run. The default token is never cancelled.
    fn cancel_token(&self) -> CancelToken {
        CancelToken::default()
    }
    /// Called with a message for the user.
    fn note(&self, _message: &str) {}
}

/// Observer that ignores everything.
impl Watch for () {}

/// Error that ends a run.
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
        "no pipeline.toml in the current folder, so the paper's experiment is assumed, but {why}; {advice}"
    )]
    Unconfigured { why: String, advice: String },
    /// There is neither a configuration file nor a list of trials or a table.
    #[error("no pipeline.toml and no trials in the current folder; {advice}")]
    NoProject { advice: String },
    #[error(
        "{}: this folder holds the ingested trials, whose fits would be replaced; name another \
         folder for the fits of a table from another program",
        home.display()
    )]
    OwnTablePlace { home: PathBuf },
    /// A target is stale, but the run may only check, not write.
    #[error("something has changed")]
    Outdated,
    #[error(
        "{0}: contains no shards; `trilink ingest --shard 3/8 --into {0}` and `trilink fit --replicates 0..500 --into \
         {0}` write shards to it",
        shards.display()
    )]
    NoShards { shards: PathBuf },
    #[error("nothing was merged, because these shards cannot be used:{problems}{}", to_do(again))]
    Shards { problems: String, again: String },
    #[error("{shard}: found `fit.bootstrap` = {bootstrap}, needed at least {}", shard.to)]
    Replicates { shard: Shard, bootstrap: usize },
    #[error(
        "{}: contains tables for trials in {folder}, but the shards cover only trials in {}; make shards that cover \
         all folders, or remove the tables for {folder}",
        derived.display(),
        shard_folders.join(", ")
    )]
    OtherFolder { derived: PathBuf, folder: String, shard_folders: Vec<String> },
    /// It is not known which files runs have written.
    #[error(
        "{problem}; only this record lists the files that can be removed: `trilink run` writes it again"
    )]
    NoRecord { problem: String },
    #[error("{0}; with --wait, the command waits until the lock is released")]
    Held(StoreError),
    #[error("trials.parquet contains no trial {trial}{meant}")]
    NoTrial { trial: String, meant: String },
    #[error("{}: {problem}; `trilink run` completes and updates the results", path.display())]
    Unfinished { path: PathBuf, problem: String },
    #[error(
        "interrupted during {stage}{}; still to do: {}. Every file is complete, as written by \
         this run or the previous one",
        after(done),
        left(stage)
    )]
    Interrupted { stage: &'static str, done: String },
    /// Cancellation before the first stage started.
    #[error(transparent)]
    Stopped(#[from] Cancelled),
}

impl RunError {
    /// Converts the error of a failed attempt to lock a folder.
    fn from_lock(error: StoreError) -> Self {
        match error {
            StoreError::Held { .. } => Self::Held(error),
            StoreError::Cancelled(_) => Self::Stopped(Cancelled),
            other => Self::Store(other),
        }
    }

    /// Converts a cancellation error into [`Self::Interrupted`], which names the stage and how much of it was `done`;
    /// returns any other error unchanged.
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

    /// Returns whether this error states that a table's content has changed although its size and modification time
    /// have not.
    fn is_of_changed_table(&self) -> bool {
        use ReportError::Store;
        let (Self::Store(error) | Self::Report(Store(error))) = self else { return false };
        matches!(error, StoreError::Changed { .. })
    }
}

/// Formats the last line of a message, which names the option `again` that selects the shards to compute again; empty
/// if there is no such option.
fn to_do(again: &str) -> String {
    if again.is_empty() { String::new() } else { format!("\nmake them again with {again}") }
}

/// Formats how much of a stage was `done` when it was interrupted; empty if this was not counted.
fn after(done: &str) -> String {
    if done.is_empty() { String::new() } else { format!(" after {done}") }
}

/// Lists the stages that are incomplete because `stage` was interrupted.
fn left(stage: &str) -> String {
    let stages = [IngestStage::NAME, FitStage::NAME, ReportStage::NAME];
    let done = stages.iter().position(|known| *known == stage).unwrap_or(0);
    stages[done..].join(", ")
}

/// Results of a completed run.
#[derive(Debug)]
pub struct Finished {
    pub ingested: Ingested,
    pub fitted: Fitted,
    pub reported: Reported,
    pub stages: Vec<StageRecord>,
    /// Whether everything was up to date, so that nothing was written.
    pub was_up_to_date: bool,
    /// Message if the run could not be added to the history; `None` if it was added.
    pub history_problem: Option<String>,
}

/// Ingests, fits and reports whatever has changed in the trial folders that `config` names and in those that already
/// have results, and writes `run.json`. The results are byte-for-byte identical to those of a run of all folders from
/// scratch. If nothing has changed, nothing is written. If another run is using the folder of results, waits for its
/// end if `wait` is set, and otherwise returns an error.
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
/// Returns an error if a stage cannot be carried out at all, or if another run uses the same folder. Trials and fits
/// that fail are not errors but rows with a status.
pub fn run(
    config: &Config,
    options: RerunOptions,
    wait: bool,
    watch: &dyn Watch,
) -> Result<Finished, RunError> {
    let mut check = Sequence::new(config, options, watch);
    check.problem.iter().for_each(|problem| watch.note(problem));
    check.may_write = false;
    // The check comes first, so that an unchanged folder is not even locked.
    match check.run_all() {
        Ok(finished) => {
            confirm(config);
            return Ok(finished);
        }
        Err(RunError::Outdated) => {}
        // Another process may have changed files during the check, so try again with the lock.
        Err(_) if config.paths.derived.is_dir() => {}
        Err(error) => return Err(error),
    }
    let _lock = take_over(config, wait, watch)?;
    // A process that held the lock may have changed the record.
    let mut sequence = Sequence::new(config, options, watch);
    let record_failure = |started: &str, status, why: &str| {
        // The error that ended the run matters more than a failure to record it.
        let problem = crate::compare::record_failure(config, started, status, why);
        problem.ok().flatten().iter().for_each(|problem| watch.note(problem));
    };
    if let Some(LastRun { status: RunStatus::Running, started, .. }) = LastRun::load(config) {
        record_failure(&started, RunStatus::Interrupted, "killed");
    }
    let mut finished = sequence.run_all();
    if let Err(error) = &finished
        && error.is_of_changed_table()
        && !options.verify
    {
        watch.note(&format!("{error}: every file is read again"));
        let options = RerunOptions { verify: true, ..options };
        sequence = Sequence::new(config, options, watch);
        finished = sequence.run_all();
    }
    if let Err(error) = &finished {
        let status = match error {
            RunError::Interrupted { .. } => RunStatus::Interrupted,
            _ => RunStatus::Failed,
        };
        record_failure(&sequence.began_at, status, &error.to_string());
        let _ = sequence.write_record(status, Some(error.to_string()), None);
    }
    finished
}

/// Sequence of stages that work on a folder of results, with the record of these results.
struct Sequence<'s> {
    config: Config,
    options: RerunOptions,
    watch: &'s dyn Watch,
    record: Record,
    /// Reason why the record of earlier results, `up-to-date.json`, is unusable; `None` if it is usable.
    problem: Option<String>,
    /// Whether stages may be carried out; otherwise the sequence only checks that everything is up to date.
    may_write: bool,
    /// Whether the sequence is a run of all stages, which is recorded in `run.json`, and not a single stage.
    is_run: bool,
    /// Completed stages.
    stages: Vec<StageRecord>,
    /// Start time of the sequence (UTC).
    began_at: String,
    began: Instant,
}

impl<'s> Sequence<'s> {
    /// Creates a sequence that may carry out stages.
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

    /// Returns the names of the trial folders that have tables or are gone.
    fn known_folders(&self) -> BTreeSet<String> {
        let known = FolderInput::folders(&self.record.ingest.whole);
        if !known.is_empty() {
            return known;
        }
        // Without a record, the names come from the table of trials.
        let table = Reader::default().table(&self.config.paths.derived.join("trials.parquet"));
        let folders = table.and_then(|table| table.values::<String>("folder")).unwrap_or_default();
        folders.into_iter().filter(|folder| !folder.is_empty()).collect()
    }

    /// Replaces the configured trial folders by those that have tables, if there are any such folders.
    fn take_known_folders(&mut self) {
        let gone = FolderInput::gone(&self.record.ingest.whole);
        let known = self.known_folders();
        let paths = &mut self.config.paths;
        let known = known.iter().filter(|name| !gone.contains_key(*name));
        let known: Vec<PathBuf> = known.map(|name| paths.base.join(name)).collect();
        if !known.is_empty() {
            paths.replace_raw(known);
        }
    }

    /// Finds the trial folders that the configuration names and, unless `only` is set, adds those that have tables.
    fn find_folders(&mut self) -> Result<MissingFolders, RunError> {
        let known = if self.options.only { BTreeSet::new() } else { self.known_folders() };
        let paths = &mut self.config.paths;
        let mut all = find_folders(paths)?;
        let named: BTreeSet<String> = all.iter().map(|path| paths.name_of(path)).collect();
        all.extend(known.difference(&named).map(|name| paths.base.join(name)));
        let (gone, mut there): (Vec<PathBuf>, _) = all.into_iter().partition(|folder| {
            let list = folder.join(TRIALS_FILE).try_exists();
            known.contains(&paths.name_of(folder)) && list.is_ok_and(|is_there| !is_there)
        });
        if there.is_empty() {
            // Nothing can be done without any folder; the error names the first list that cannot be read.
            return Ok(MissingFolders::default());
        }
        let mut missing = MissingFolders::default();
        if !gone.is_empty() {
            let new = there.iter().filter(|folder| !known.contains(&paths.name_of(folder)));
            let new: Vec<TrialFolder> =
                new.filter_map(|folder| TrialFolder::load(paths, folder).ok()).collect();
            let gone = gone.iter().map(|folder| paths.name_of(folder));
            missing = MissingFolders::find(gone, &new, &self.record.ingest);
        }
        there.sort_by_cached_key(|folder| paths.name_of(folder));
        paths.replace_raw(there);
        paths.raw = find_folders(paths)?;
        Ok(missing)
    }

    /// Plans a stage, carries out the plan and saves the record. If the sequence may not write, only checks that the
    /// stage is up to date, and returns an error otherwise.
    fn advance<S: Stage>(&mut self, stage: &S) -> Result<S::Output, RunError> {
        let begin = Instant::now();
        if self.may_write {
            tracing::info!(stage = S::NAME, "stage begins");
        }
        let derived = &self.config.paths.derived;
        let planned = plan(stage, derived, &self.record, self.options)?;
        let (output, plan) = if self.may_write {
            let is_first = !self.stages.iter().any(|stage| stage.did_something);
            if is_first && !planned.plan.is_empty() {
                remove_comparison(&self.config.paths.reports)?;
                if self.is_run {
                    self.write_record(RunStatus::Running, None, None)?;
                }
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

    /// Runs all stages and records the run.
    fn run_all(&mut self) -> Result<Finished, RunError> {
        self.is_run = true;
        let missing = self.find_folders()?;
        let config = &self.config.clone();
        let ingested = self.advance(&IngestStage::new(config)?.without(missing))?;
        let fitted = self.advance(&FitStage::new(config))?;
        let reported = self.advance(&ReportStage::new(config, &self.record.report, &[]))?;
        let did_something = self.stages.iter().any(|stage| stage.did_something);
        let was_up_to_date = !did_something
            && self.is_recorded()
            && unfinished(&folders(config)).is_empty()
            && crate::compare::is_history_up_to_date(&config.paths);
        if !self.may_write && !was_up_to_date {
            return Err(RunError::Outdated);
        }
        let stages = self.stages.clone();
        let history_problem = None;
        let mut finished =
            Finished { ingested, fitted, reported, stages, was_up_to_date, history_problem };
        if !was_up_to_date {
            let status = if finished.ingested.needs_a_person() {
                RunStatus::Attention
            } else {
                RunStatus::Ok
            };
            self.record.run = Some(self.write_record(status, None, Some(&finished))?);
            finished.history_problem = crate::compare::record_run(config).unwrap_or_else(|error| {
                Some(format!("this run was not added to the history: {error}"))
            });
        }
        if self.may_write {
            // The record comes last, so that it describes files that exist.
            self.record.save(&config.paths.derived)?;
        }
        Ok(finished)
    }

    /// Returns whether `run.json` exists and is unchanged since a run wrote it.
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
        let json = serde_json::to_string_pretty(&record).expect("a record can be serialised");
        write_bytes(&record_path(&self.config), (json + "\n").as_bytes())
    }
}

/// Plan of a run. The plan of a stage is exact if the stages before it are up to date; otherwise it is an upper bound.
#[derive(Debug)]
pub struct DryRun {
    pub stages: [StagePlan; 3],
    /// Index of the first stage whose plan is only an upper bound; the number of stages if all plans are exact.
    pub uncertain_from: usize,
    /// Reasons to write files that belong to no stage, such as `run.json`.
    pub others: Vec<&'static str>,
    /// Reason why the record of earlier results, `up-to-date.json`, is unusable; `None` if it is usable.
    pub problem: Option<String>,
}

/// Plans a run without writing anything.
///
/// # Errors
/// Returns an error if a list of trials or a table is unreadable or invalid.
pub fn dry_run(config: &Config, options: RerunOptions) -> Result<DryRun, RunError> {
    let mut sequence = Sequence::new(config, options, &());
    let missing = sequence.find_folders()?;
    let Sequence { config, record, .. } = &sequence;
    let derived = &config.paths.derived;
    let fit_stage = FitStage::new(config);
    let report_stage = ReportStage::new(config, &record.report, &[]);
    let ingest = plan(&IngestStage::new(config)?.without(missing), derived, record, options)?.plan;
    let fit = if ingest.is_empty() {
        plan(&fit_stage, derived, record, options)?.plan
    } else {
        plan_after(&fit_stage, record, options, &ingest.touched)
    };
    let mut uncertain_from = if ingest.is_empty() { 2 } else { 1 };
    let mut others = Vec::new();
    let report = if ingest.is_empty() && fit.is_empty() {
        uncertain_from = 3;
        if !unfinished(&folders(config)).is_empty() {
            others.push("a killed run left unfinished files");
        }
        if !sequence.is_recorded() {
            others.push("run.json has changed since the last run");
        }
        if !crate::compare::is_history_up_to_date(&config.paths) {
            others.push("history.html does not match history.parquet");
        }
        plan(&report_stage, derived, record, options)?.plan
    } else {
        plan_after(&report_stage, record, options, &(&ingest.touched | &fit.touched))
    };
    let stages = [ingest, fit, report];
    Ok(DryRun { stages, uncertain_from, others, problem: sequence.problem })
}

/// Runs the first stage for all trials: processes marker files into tables. Trials in folders that `config` does not
/// name are also processed again if they already have tables; with `only`, these tables are removed instead.
///
/// # Errors
/// Returns an error if a list of trials cannot be read, a table cannot be written, or another run uses the folder.
pub fn ingest(
    config: &Config,
    only: bool,
    wait: bool,
    watch: &dyn Watch,
) -> Result<Ingested, RunError> {
    let options = RerunOptions { only, ..RerunOptions::FORCE };
    run_stage(config, options, wait, watch, |sequence| {
        let missing = sequence.find_folders()?;
        Ok(IngestStage::new(&sequence.config)?.without(missing))
    })
}

/// Runs the second stage for all models: fits them to the tables.
///
/// # Errors
/// Returns an error if the table of trials cannot be read, a table cannot be written, or another run uses the folder.
pub fn fit(config: &Config, wait: bool, watch: &dyn Watch) -> Result<Fitted, RunError> {
    input_paths(&config.paths.derived)?;
    run_stage(config, RerunOptions::FORCE, wait, watch, |sequence| {
        Ok(FitStage::new(&sequence.config))
    })
}

/// Reads the tables of trials and checks from the last ingest; a missing table counts as empty.
///
/// # Errors
/// Returns an error if a table cannot be read.
pub fn ingested(config: &Config) -> Result<Ingested, RunError> {
    let derived = &config.paths.derived;
    let reader = Reader::default();
    let trials = reader.rows_if_there(&derived.join("trials.parquet"))?.unwrap_or_default();
    let checks = reader.rows_if_there(&derived.join("checks.parquet"))?.unwrap_or_default();
    Ok(Ingested { trials, checks, ..Ingested::default() })
}

/// Runs the third stage: draws all figures and writes the report page. Pages of the trials in `asked` are written now
/// and by all later runs.
///
/// # Errors
/// Returns an error if a trial in `asked` does not exist, a table cannot be read, a file cannot be written, or another
/// run uses the folder.
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
    run_stage(config, RerunOptions::FORCE, wait, watch, |sequence| {
        sequence.take_known_folders();
        Ok(ReportStage::new(&sequence.config, &sequence.record.report, asked))
    })
}

/// Runs only the stage that `stage` creates, for all of its targets.
fn run_stage<S: Stage>(
    config: &Config,
    options: RerunOptions,
    wait: bool,
    watch: &dyn Watch,
    stage: impl Fn(&mut Sequence) -> Result<S, RunError>,
) -> Result<S::Output, RunError> {
    // Reading the inputs before the lock leaves no folder behind if there are none.
    stage(&mut Sequence::new(config, options, watch))?;
    let _lock = take_over(config, wait, watch)?;
    let mut sequence = Sequence::new(config, options, watch);
    let stage = stage(&mut sequence)?;
    if S::NAME != ReportStage::NAME {
        // The tables will be newer than the last recorded run.
        sequence.record.run = None;
    }
    sequence.advance(&stage)
}
