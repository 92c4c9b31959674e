//! Incremental engine for all stages: determines which targets are stale and why, and makes them again.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;
use trilink_report::page_of;
use trilink_tables::{Reader, StoreError, hash};

use super::record::{Files, Inputs, Record, StageState, TargetRecord, changed_outputs};
use super::steps::Steps;
use super::target::{Key, Kind, SETTINGS, Target, changed_settings, reasons};
use super::{RunError, Watch};

/// Options of a rerun.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RerunOptions {
    /// Recompute everything.
    pub force: bool,
    /// Read files again even if their size and modification time have not changed.
    pub verify: bool,
    /// Remove the results of trial folders that are not named in the configuration or on the command line.
    pub only: bool,
}

impl RerunOptions {
    /// Options to recompute everything, for a single stage that the user requests.
    pub const FORCE: Self = Self { force: true, verify: false, only: false };
}

/// Plan of a stage: which targets are stale and why.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct StagePlan {
    pub targets: Vec<PlannedTarget>,
    /// Number of targets that are up to date.
    pub up_to_date: usize,
    /// Targets to remove because they are no longer needed.
    pub removed: Vec<Target>,
    /// Reasons to rewrite the files that belong to no single target, such as a table of all trials, although no target
    /// is stale.
    pub whole: Vec<String>,
    /// Trials, campaigns and robots to which the stale or removed targets belong.
    pub(super) touched: BTreeSet<String>,
}

/// Stale target, with the reasons why it is stale.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlannedTarget {
    pub target: Target,
    pub why: Vec<String>,
}

impl StagePlan {
    /// Whether the plan is empty, because everything is up to date.
    pub fn is_empty(&self) -> bool {
        self.targets.is_empty() && self.removed.is_empty() && self.whole.is_empty()
    }

    /// Determines which of the targets `specs` are stale. The `common` reasons apply to all targets; `target_reasons`
    /// returns further reasons for a target that was made before. With `force`, only the common reasons are stated.
    fn new(
        known: &StageState,
        specs: &[TargetSpec],
        common: &[String],
        force: bool,
        target_reasons: impl Fn(&TargetRecord, &TargetSpec) -> Vec<String> + Sync,
    ) -> Self {
        let mut made = known.by_target();
        let why = specs.par_iter().map(|spec| match made.get(&spec.target) {
            None if !force => vec!["new".to_owned()],
            Some(made) if !force => [common, &target_reasons(made, spec)].concat(),
            _ => common.to_vec(),
        });
        let why: Vec<Vec<String>> = why.collect();
        let mut plan = Self::default();
        for (TargetSpec { target, subjects, .. }, why) in specs.iter().zip(why) {
            made.remove(target);
            if why.is_empty() {
                plan.up_to_date += 1;
                continue;
            }
            plan.touched.extend(subjects.iter().cloned());
            plan.targets.push(PlannedTarget { target: target.clone(), why });
        }
        plan.touched.extend(made.values().flat_map(|made| made.subjects.iter().cloned()));
        plan.removed = made.into_keys().cloned().collect();
        plan
    }
}

/// Specification of a target: the inputs from which it would be made now.
#[derive(Debug, Clone)]
pub(super) struct TargetSpec {
    pub target: Target,
    pub settings: Value,
    pub key: Key,
    /// Trial, campaigns and robot on which the target depends, each with its kind: `trial a`, `campaign b`, `robot c`.
    pub subjects: Vec<String>,
}

impl TargetSpec {
    /// Creates the specification of a target. An entry with the hash of `settings` is added to `key`, unless the
    /// settings are null.
    pub(super) fn new(
        target: Target,
        settings: &impl Serialize,
        mut key: Key,
        subjects: Vec<String>,
    ) -> Self {
        let settings = serde_json::to_value(settings).expect("settings have text keys");
        if !settings.is_null() {
            key.insert(SETTINGS.to_owned(), hash_of(&settings));
        }
        Self { target, settings, key, subjects }
    }

    /// Converts the specification into the record of a target that has been made, with the files `outputs`.
    pub(super) fn into_record(self, outputs: Files) -> TargetRecord {
        let Self { target, key, subjects, .. } = self;
        TargetRecord { target, key, subjects, outputs }
    }
}

/// Returns the hash of a value's JSON representation.
pub(super) fn hash_of(value: &impl Serialize) -> String {
    hash(&serde_json::to_vec(value).expect("a value with text keys can be serialised"))
}

/// Name, in the [`Key`] of a fit, of the entry for the robot's measured parameters.
pub(super) const ROBOTS: &str = "robot_parameters.parquet";

/// Subject ([`TargetSpec::subjects`]) that the figures without a campaign share with all trials that measure robot
/// parameters, because a change to such a trial may change each of these figures.
pub(super) const ANY_ROBOT: &str = "any robot";

/// Returns the reasons why a target may become stale once the preceding stages have changed the `touched` trials,
/// campaigns and robots.
fn possible_reasons(made: &TargetRecord, touched: &BTreeSet<String>) -> Vec<String> {
    let is_touched = |kind: &str| {
        made.subjects.iter().any(|subject| subject.starts_with(kind) && touched.contains(subject))
    };
    let mut why = Vec::new();
    match made.target.kind {
        Kind::Trial => {}
        Kind::Fit | Kind::SharedFit => {
            let entries = made.key.keys().filter(|name| touched.contains(*name));
            why.extend(entries.map(|name| format!("if {name} changes")));
            if made.key.contains_key(ROBOTS) && is_touched("robot ") {
                why.push(format!("if {ROBOTS} changes"));
            }
            if why.is_empty() && is_touched("campaign ") {
                why.push("if its trials change".to_owned());
            }
        }
        Kind::Figure | Kind::Page => {
            let mut trials = touched.iter().filter_map(|subject| subject.strip_prefix("trial "));
            if trials.any(|trial| page_of(trial) == made.target.name) {
                why.push("if its trial changes".to_owned());
            } else if is_touched("") {
                why.push("if the displayed data change".to_owned());
            }
        }
    }
    why
}

/// Stage of the pipeline. A stage reads files and makes targets from them. Each target has its own files; stage-wide
/// files, such as a table of all trials, belong to no single target.
pub(super) trait Stage: Sync {
    /// Data read from the input files.
    type Sources;
    /// Result of the stage.
    type Output: Clone;
    /// Part of the result that belongs to one target, besides the target's files.
    type Rows: Sync;

    /// Name of the stage on the command line.
    const NAME: &'static str;
    /// Hash of the stage's source code, from `build.rs`.
    const SOURCE: &'static str;
    /// Plural noun for the steps of the stage; empty if its progress is not counted.
    const STEPS: &'static str;
    /// Whether the stage-wide files consist of the rows of the targets; otherwise they are made from everything that
    /// the stage reads.
    const HAS_TARGET_ROWS: bool;
    /// Reason that the plan states if only the order of the targets has changed.
    const ORDER_CHANGED: &'static str;

    /// Returns the part of the record that belongs to the stage.
    fn state(record: &Record) -> &StageState;

    /// Returns the folder that the stage writes to.
    fn output_folder(&self) -> &Path;

    /// Returns the settings that affect the stage as a whole, not a single target; null if there are none.
    fn stage_settings(&self) -> Value {
        Value::Null
    }

    /// Returns the paths of the files that the stage reads for its plan, each with a flag that is true if this program
    /// wrote the file.
    fn input_paths(&self, known: &StageState) -> Result<Vec<(PathBuf, bool)>, RunError>;

    /// Returns the specifications of the targets in order, with the key entries that are known before any file is read.
    fn expected_specs(&self, known: &StageState) -> Vec<TargetSpec>;

    /// Reads the data from which the targets are made.
    fn read(&self, inputs: Inputs) -> Result<Self::Sources, RunError>;

    /// Returns the specifications of the targets in order, with complete keys.
    fn specs(&self, sources: &Self::Sources) -> Vec<TargetSpec>;

    /// Reads the result of the last run through the reader `written`, which rejects changed files.
    fn load_previous(
        &self,
        known: &StageState,
        written: &Reader,
    ) -> Result<Self::Output, StoreError>;

    /// Splits the result of the last run by target.
    fn rows_by_target(
        &self,
        known: &StageState,
        previous: Self::Output,
    ) -> BTreeMap<Target, Self::Rows>;

    /// Returns a sentence for each file that belongs to no target.
    fn leftovers(&self, _known: &StageState) -> Result<Vec<String>, RunError> {
        Ok(Vec::new())
    }

    /// Makes the targets that are not retained, and the stage-wide files. The returned record contains the targets in
    /// order, the stage-wide files, notes on what is missing from the report, and the stamps of those files that this
    /// function, not the plan, has read.
    fn make(&self, work: Work<Self>, steps: &Steps)
    -> Result<(Self::Output, StageState), RunError>;
}

/// Up-to-date targets with their records and rows.
pub(super) type Retained<S> = BTreeMap<Target, (TargetRecord, <S as Stage>::Rows)>;

/// Work to be done for a stage that is not up to date.
pub(super) struct Work<S: Stage + ?Sized> {
    pub sources: S::Sources,
    /// Specifications of all targets, in the order of the stage.
    pub specs: Vec<TargetSpec>,
    pub retained: Retained<S>,
}

/// Plan of a stage together with the data to carry it out.
pub(super) struct Planned<'k, S: Stage> {
    pub plan: StagePlan,
    next: Next<S>,
    /// Files read for the plan, indexed by their path relative to `derived/`.
    inputs: Files,
    known: &'k StageState,
}

/// Work that remains for a stage.
enum Next<S: Stage> {
    /// No work: the result of the last run is up to date.
    Nothing(S::Output),
    Make(Box<Work<S>>),
}

/// Plans a stage by comparing its targets with the record of earlier results.
///
/// # Errors
/// Returns an error if an input of the stage cannot be used.
pub(super) fn plan<'k, S: Stage>(
    stage: &S,
    derived: &Path,
    record: &'k Record,
    options: RerunOptions,
) -> Result<Planned<'k, S>, RunError> {
    let RerunOptions { force, verify, .. } = options;
    let folder = stage.output_folder();
    let known = S::state(record);
    let changed = |outputs: &Files| changed_outputs(folder, outputs, verify);
    let mut common = stage_reasons::<S>(known, force);
    let mut whole = if force { Vec::new() } else { changed(&known.outputs) };
    let mut previous = None;
    if common.is_empty() && (whole.is_empty() || !S::HAS_TARGET_ROWS) {
        let found = stage.load_previous(known, &Reader::new(folder, &known.outputs));
        previous = found.map_err(|error| whole.push(error.to_string())).ok();
    }
    if S::HAS_TARGET_ROWS {
        common.append(&mut whole);
    }
    whole.splice(..0, common.iter().cloned());
    whole.extend(changed_settings(&known.whole, &stage.stage_settings()));
    whole.extend(stage.leftovers(known)?);

    let checked = Inputs::check(stage.input_paths(known)?, (derived, record), known, verify);
    let inputs = checked.stamps(derived);
    let are_readable = checked.are_readable();
    let changed_inputs = changed_files(&known.inputs, &inputs);
    if let Some(output) = &previous
        && whole.is_empty()
        && are_readable
        && changed_inputs.is_none()
        && match_specs(&known.targets, &stage.expected_specs(known))
        && known.targets.par_iter().all(|made| changed(&made.outputs).is_empty())
    {
        let plan = StagePlan { up_to_date: known.targets.len(), ..StagePlan::default() };
        return Ok(Planned { plan, next: Next::Nothing(output.clone()), inputs, known });
    }

    let sources = stage.read(checked)?;
    let specs = stage.specs(&sources);
    let mut rows =
        previous.clone().map(|previous| stage.rows_by_target(known, previous)).unwrap_or_default();
    let mut plan = StagePlan::new(known, &specs, &common, force, |made, spec| {
        let mut why = known.reasons(&made.key, spec);
        why.extend(changed(&made.outputs));
        if why.is_empty() && common.is_empty() && !rows.contains_key(&made.target) {
            why.push("its rows are missing from the table".to_owned());
        }
        why
    });
    if plan.is_empty() {
        let order = known.targets.iter().map(|made| &made.target);
        if !order.eq(specs.iter().map(|spec| &spec.target)) {
            plan.whole.push(S::ORDER_CHANGED.to_owned());
        }
        plan.whole.extend(whole);
        plan.whole.extend(changed_inputs.filter(|_| !S::HAS_TARGET_ROWS));
    }
    if let Some(output) = previous
        && plan.is_empty()
    {
        return Ok(Planned { plan, next: Next::Nothing(output), inputs, known });
    }
    let stale: BTreeSet<&Target> = plan.targets.iter().map(|planned| &planned.target).collect();
    let made = known.by_target();
    let retained = specs.iter().filter_map(|TargetSpec { target, .. }| {
        let made = TargetRecord::clone(made.get(target).filter(|_| !stale.contains(target))?);
        Some((target.clone(), (made, rows.remove(target)?)))
    });
    let retained = retained.collect();
    let next = Next::Make(Box::new(Work { sources, specs, retained }));
    Ok(Planned { plan, next, inputs, known })
}

/// Plans the merge of the targets that shards have made, given as `retained`, into the results of the whole stage.
pub(super) fn join<'k, S: Stage>(
    stage: &S,
    sources: S::Sources,
    record: &'k Record,
    retained: Retained<S>,
) -> Planned<'k, S> {
    let known = S::state(record);
    let specs = stage.expected_specs(known);
    let plan = StagePlan::new(known, &specs, &[], true, |_, _| Vec::new());
    let next = Next::Make(Box::new(Work { sources, specs, retained }));
    Planned { plan, next, inputs: Files::new(), known }
}

/// Returns an upper bound for the plan of a stage before the preceding stages change the `touched` trials, campaigns
/// and robots. The bound can be exceeded only if tables have changed that are not in the record.
pub(super) fn plan_after<S: Stage>(
    stage: &S,
    record: &Record,
    options: RerunOptions,
    touched: &BTreeSet<String>,
) -> StagePlan {
    let known = S::state(record);
    let common = stage_reasons::<S>(known, options.force);
    let specs = stage.expected_specs(known);
    let mut plan = StagePlan::new(known, &specs, &common, options.force, |made, spec| {
        let mut old = made.key.clone();
        old.retain(|name, _| spec.key.contains_key(name));
        [known.reasons(&old, spec), possible_reasons(made, touched)].concat()
    });
    if !S::HAS_TARGET_ROWS {
        let is_new = known.targets.is_empty();
        plan.whole.push(if is_new { "new" } else { "if a table changes" }.to_owned());
    }
    plan
}

/// Returns the reasons that make all targets of a stage stale, regardless of their keys.
fn stage_reasons<S: Stage>(known: &StageState, force: bool) -> Vec<String> {
    if force {
        vec!["--force".to_owned()]
    } else if known.source == S::SOURCE {
        Vec::new()
    } else if known.source.is_empty() {
        vec!["new".to_owned()]
    } else {
        vec![format!("the program code of stage {} has changed", S::NAME)]
    }
}

/// Returns whether the targets `made` earlier are the `expected` ones in the same order, and agree with them in all
/// entries that the keys of the expected targets contain.
fn match_specs(made: &[TargetRecord], expected: &[TargetSpec]) -> bool {
    made.len() == expected.len()
        && made.iter().zip(expected).all(|(made, spec)| {
            made.target == spec.target
                && spec.key.iter().all(|(name, content)| made.key.get(name) == Some(content))
        })
}

/// Describes the files whose content has changed since they were read; `None` if there are none.
fn changed_files(old: &Files, new: &Files) -> Option<String> {
    let [old, new] = [old, new].map(|files| -> Key {
        files.iter().map(|(path, stamp)| (path.clone(), stamp.blake3.clone())).collect()
    });
    let changed = reasons(&old, &new, Vec::new);
    let (first, others) = changed.split_first()?;
    Some(match others.len() {
        0 => first.clone(),
        1 => format!("{first}, and 1 more file"),
        others => format!("{first}, and {others} more files"),
    })
}

impl StageState {
    /// Returns the records of the targets, indexed by target.
    fn by_target(&self) -> BTreeMap<&Target, &TargetRecord> {
        self.targets.iter().map(|made| (&made.target, made)).collect()
    }

    /// Returns the reasons why a target that was made with the key `old` is stale, given its current specification;
    /// empty if it is not stale.
    fn reasons(&self, old: &Key, spec: &TargetSpec) -> Vec<String> {
        reasons(old, &spec.key, || {
            let settings = old.get(SETTINGS).and_then(|hash| self.settings.get(hash));
            settings.map_or(Vec::new(), |old| changed_settings(old, &spec.settings))
        })
    }
}

impl<S: Stage> Planned<'_, S> {
    /// Returns the result of the last run, and the plan, if no work remains and the recorded stamps of the input files
    /// are current; otherwise `None`.
    pub(super) fn up_to_date(self) -> Option<(S::Output, StagePlan)> {
        let Next::Nothing(output) = self.next else { return None };
        let mut both = self.inputs.iter().zip(&self.known.inputs);
        let is_confirmed = self.inputs.len() == self.known.inputs.len()
            && both.all(|((path, new), (old_path, old))| path == old_path && new.confirms(old));
        is_confirmed.then_some((output, self.plan))
    }

    /// Carries out the plan and returns the result, the plan and the new record of the stage. Progress messages name
    /// the `shard`, which is empty for an undivided stage.
    ///
    /// # Errors
    /// Returns an error if a file cannot be written or removed, or if the work was cancelled.
    pub(super) fn carry_out(
        self,
        stage: &S,
        (watch, shard): (&dyn Watch, &str),
    ) -> Result<(S::Output, StagePlan, StageState), RunError> {
        let Self { plan, next, mut inputs, known } = self;
        watch.planned(&plan);
        let work = match next {
            Next::Nothing(output) => {
                return Ok((output, plan, StageState { inputs, ..known.clone() }));
            }
            Next::Make(work) => work,
        };
        let settings = work.specs.iter().filter_map(|spec| {
            spec.key.get(SETTINGS).map(|hash| (hash.clone(), spec.settings.clone()))
        });
        let settings = settings.collect();
        let total = if S::STEPS.is_empty() { 1 } else { plan.targets.len() };
        let steps = Steps::begin::<S>(watch, total, shard);
        let (output, made) = steps.end::<S, _>(stage.make(*work, &steps))?;
        remove_outdated(stage.output_folder(), known, &made)?;
        inputs.extend(made.inputs);
        let source = S::SOURCE.to_owned();
        let whole = stage.stage_settings();
        Ok((output, plan, StageState { source, whole, settings, inputs, ..made }))
    }
}

/// Removes files that the stage wrote earlier and no longer produces, unless somebody else has changed them.
fn remove_outdated(folder: &Path, known: &StageState, made: &StageState) -> Result<(), StoreError> {
    let current: BTreeSet<&String> = made.written().map(|(name, _)| name).collect();
    for (name, stamp) in known.written().filter(|(name, _)| !current.contains(name)) {
        let path = folder.join(name);
        if stamp.content_of(&path).is_some() {
            std::fs::remove_file(&path).map_err(|source| StoreError::Remove { path, source })?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_of_any_robot_may_change_when_a_robot_is_measured_again() {
        let target = Target::new(Kind::Figure, "fig08");
        let subjects = vec![ANY_ROBOT.to_owned()];
        let made = TargetSpec::new(target, &(), Key::new(), subjects).into_record(Files::new());
        let mut touched = BTreeSet::from(["campaign semi-passive-symmetric".to_owned()]);
        assert!(possible_reasons(&made, &touched).is_empty());
        touched.extend(["robot semi-passive", ANY_ROBOT].map(str::to_owned));
        assert_eq!(possible_reasons(&made, &touched), ["if the displayed data change"]);
    }
}
