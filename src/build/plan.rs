//! What a stage has to do again and why, and doing it: one engine for all stages.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;
use trilink_report::page_of;
use trilink_tables::{Reader, StoreError, hash};

use super::record::{Files, Inputs, Made, Record, StageState, changed_outputs};
use super::steps::Steps;
use super::target::{Key, Kind, SETTINGS, Target, changed_settings, reasons};
use super::{RunError, Watch};

/// How a stage is done again.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RerunOptions {
    /// Redo all.
    pub force: bool,
    /// Read files again whose size and time have not changed.
    pub verify: bool,
    /// Remove the trials of folders that are not named.
    pub only: bool,
}

impl RerunOptions {
    /// Redo all, as who asks for a single stage means it.
    pub const FORCE: Self = Self { force: true, verify: false, only: false };
}

/// What a stage has to do again.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct StagePlan {
    pub targets: Vec<PlannedTarget>,
    pub up_to_date: usize,
    /// Targets that are there and should no longer be.
    pub removed: Vec<Target>,
    /// Why files of the stage as a whole are looked at again, if no target gives a reason.
    pub whole: Vec<String>,
    /// What the targets are of that are made again or removed.
    pub(super) touched: BTreeSet<String>,
}

/// A target to make again, and why.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlannedTarget {
    pub target: Target,
    pub why: Vec<String>,
}

impl StagePlan {
    /// Whether all is up to date.
    pub fn is_empty(&self) -> bool {
        self.targets.is_empty() && self.removed.is_empty() && self.whole.is_empty()
    }

    /// A plan for `wanted` targets. All are made again for the `common` reasons, new ones anyway,
    /// those that were made for `other` reasons, too.
    fn new(
        known: &StageState,
        wanted: &[Wanted],
        common: &[String],
        force: bool,
        other: impl Fn(&Made, &Wanted) -> Vec<String> + Sync,
    ) -> Self {
        let mut made = known.by_target();
        let reasons = |wanted: &Wanted| match made.get(&wanted.target) {
            None if !force => vec!["new".to_owned()],
            Some(made) if !force => [common, &other(made, wanted)].concat(),
            _ => common.to_vec(),
        };
        let why: Vec<Vec<String>> = wanted.par_iter().map(reasons).collect();
        let mut plan = Self::default();
        for (Wanted { target, of, .. }, why) in wanted.iter().zip(why) {
            made.remove(target);
            if why.is_empty() {
                plan.up_to_date += 1;
                continue;
            }
            plan.touched.extend(of.iter().cloned());
            plan.targets.push(PlannedTarget { target: target.clone(), why });
        }
        plan.touched.extend(made.values().flat_map(|made| made.of.iter().cloned()));
        plan.removed = made.into_keys().cloned().collect();
        plan
    }
}

/// A target as it would be made now.
#[derive(Debug, Clone)]
pub(super) struct Wanted {
    pub target: Target,
    pub settings: Value,
    pub parts: Key,
    /// The trial, campaigns and robot that it is of, such as `trial a`: it may change when they do.
    pub of: Vec<String>,
}

impl Wanted {
    /// A target that is made of `settings` and other parts.
    pub(super) fn new(
        target: Target,
        settings: &impl Serialize,
        mut parts: Key,
        of: Vec<String>,
    ) -> Self {
        let settings = serde_json::to_value(settings).expect("settings have text keys");
        if !settings.is_null() {
            parts.insert(SETTINGS.to_owned(), hash_of(&settings));
        }
        Self { target, settings, parts, of }
    }

    /// It as made, with the files that it left.
    pub(super) fn made(self, outputs: Files) -> Made {
        let Self { target, parts, of, .. } = self;
        Made { target, parts, of, outputs }
    }
}

/// Of the value as JSON.
pub(super) fn hash_of(value: &impl Serialize) -> String {
    hash(&serde_json::to_vec(value).expect("plain data with text keys"))
}

/// What a fit is made of if it reads what was measured of its robot.
pub(super) const ROBOTS: &str = "robot_parameters.parquet";

/// What figures are of that are of no campaign, and trials that measure a robot.
pub(super) const ANY_ROBOT: &str = "any robot";

/// Why a target may have to be made again once the stages before are done that have `touched`
/// trials, campaigns and robots.
fn perhaps(made: &Made, touched: &BTreeSet<String>) -> Vec<String> {
    let is_touched =
        |kind: &str| made.of.iter().any(|of| of.starts_with(kind) && touched.contains(of));
    let mut why = Vec::new();
    match made.target.kind {
        Kind::Trial => {}
        Kind::Fit | Kind::SharedFit => {
            let parts = made.parts.keys().filter(|part| touched.contains(*part));
            why.extend(parts.map(|part| format!("if {part} changes")));
            if made.parts.contains_key(ROBOTS) && is_touched("robot ") {
                why.push(format!("if {ROBOTS} changes"));
            }
            if why.is_empty() && is_touched("campaign ") {
                why.push("if its trials change".to_owned());
            }
        }
        Kind::Figure | Kind::Page => {
            let mut trials = touched.iter().filter_map(|of| of.strip_prefix("trial "));
            if trials.any(|trial| page_of(trial) == made.target.name) {
                why.push("if its trial changes".to_owned());
            } else if is_touched("") {
                why.push("if what it shows changes".to_owned());
            }
        }
    }
    why
}

/// A stage as the engine sees it. It reads files, makes targets of them, each with files of its
/// own, and files of the stage as a whole.
pub(super) trait Stage: Sync {
    /// What the targets are made of, read.
    type Sources;
    type Output: Clone;
    /// What the stage has of one target beside its files.
    type Rows: Sync;

    const NAME: &'static str;
    /// Hash of the stage's source, see `build.rs`.
    const SOURCE: &'static str;
    /// What its steps are; empty where there are none.
    const STEPS: &'static str;
    /// Whether the files of the stage as a whole are the rows of its targets; else they are made
    /// of everything that is read.
    const ROWS_OF_TARGETS: bool;
    /// What to say where targets have another order than they had.
    const OTHER_ORDER: &'static str;

    /// The stage's part of the record.
    fn state(record: &Record) -> &StageState;

    /// The folder that it writes to.
    fn home(&self) -> &Path;

    /// The settings of the stage as a whole.
    fn whole(&self) -> Value {
        Value::Null
    }

    /// The files that it reads for the plan, and whether they are the program's own.
    fn input_paths(&self, known: &StageState) -> Result<Vec<(PathBuf, bool)>, RunError>;

    /// The targets in order, with the parts of their keys that are known before anything is read.
    fn foreseen(&self, known: &StageState) -> Vec<Wanted>;

    /// Reads what the targets are made of.
    fn read(&self, inputs: Inputs) -> Result<Self::Sources, RunError>;

    /// The targets in order.
    fn wanted(&self, sources: &Self::Sources) -> Vec<Wanted>;

    /// What the stage gave the last time, as it was `written`.
    fn earlier(&self, known: &StageState, written: &Reader) -> Result<Self::Output, StoreError>;

    /// What there is of each target.
    fn by_target(&self, known: &StageState, earlier: Self::Output) -> BTreeMap<Target, Self::Rows>;

    /// What is there that nobody accounts for.
    fn leftovers(&self, _known: &StageState) -> Result<Vec<String>, RunError> {
        Ok(Vec::new())
    }

    /// Makes what is not kept and the files of the stage as a whole. Gives of the record its
    /// targets in order, the whole stage's files, what is missing, and the stamps of files as they
    /// were when they were read, where that was not for the plan.
    fn make(&self, work: Work<Self>, steps: &Steps)
    -> Result<(Self::Output, StageState), RunError>;
}

/// Targets that stay, as they were made, with what the stage has of them.
pub(super) type Kept<S> = BTreeMap<Target, (Made, <S as Stage>::Rows)>;

/// What there is to do.
pub(super) struct Work<S: Stage + ?Sized> {
    pub sources: S::Sources,
    /// All targets in order.
    pub wanted: Vec<Wanted>,
    pub kept: Kept<S>,
}

/// A plan with what it takes to carry it out.
pub(super) struct Planned<'k, S: Stage> {
    pub plan: StagePlan,
    next: Next<S>,
    /// The files that were read for the plan, by their path from `derived/`.
    inputs: Files,
    known: &'k StageState,
}

enum Next<S: Stage> {
    /// All is up to date: what there is.
    Nothing(S::Output),
    Make(Box<Work<S>>),
}

/// Compares what a stage would make now with what the record has of it.
///
/// # Errors
/// What the stage reads cannot be used.
pub(super) fn plan<'k, S: Stage>(
    stage: &S,
    derived: &Path,
    record: &'k Record,
    options: RerunOptions,
) -> Result<Planned<'k, S>, RunError> {
    let RerunOptions { force, verify, .. } = options;
    let (home, known) = (stage.home(), S::state(record));
    let changed = |outputs: &Files| changed_outputs(home, outputs, verify);
    let mut common = common::<S>(known, force);
    let mut whole = if force { Vec::new() } else { changed(&known.outputs) };
    let mut earlier = None;
    if common.is_empty() && (whole.is_empty() || !S::ROWS_OF_TARGETS) {
        let found = stage.earlier(known, &Reader::of(home, &known.outputs));
        earlier = found.map_err(|error| whole.push(error.to_string())).ok();
    }
    if S::ROWS_OF_TARGETS {
        common.append(&mut whole);
    }
    whole.splice(..0, common.iter().cloned());
    whole.extend(changed_settings(&known.whole, &stage.whole()));
    whole.extend(stage.leftovers(known)?);

    let looked = Inputs::look(stage.input_paths(known)?, (derived, record), known, verify);
    let (inputs, are_whole) = (looked.stamps(derived), looked.are_whole());
    let changed_inputs = changed_files(&known.inputs, &inputs);
    if let Some(output) = &earlier
        && whole.is_empty()
        && are_whole
        && changed_inputs.is_none()
        && are_as_foreseen(&known.targets, &stage.foreseen(known))
        && known.targets.par_iter().all(|made| changed(&made.outputs).is_empty())
    {
        let plan = StagePlan { up_to_date: known.targets.len(), ..StagePlan::default() };
        return Ok(Planned { plan, next: Next::Nothing(output.clone()), inputs, known });
    }

    let sources = stage.read(looked)?;
    let wanted = stage.wanted(&sources);
    let mut rows =
        earlier.clone().map(|earlier| stage.by_target(known, earlier)).unwrap_or_default();
    let other = |made: &Made, wanted: &Wanted| {
        let mut why = known.reasons(&made.parts, wanted);
        why.extend(changed(&made.outputs));
        if why.is_empty() && common.is_empty() && !rows.contains_key(&made.target) {
            why.push("its rows are not there".to_owned());
        }
        why
    };
    let mut plan = StagePlan::new(known, &wanted, &common, force, other);
    if plan.is_empty() {
        let order = known.targets.iter().map(|made| &made.target);
        if !order.eq(wanted.iter().map(|wanted| &wanted.target)) {
            plan.whole.push(S::OTHER_ORDER.to_owned());
        }
        plan.whole.extend(whole);
        plan.whole.extend(changed_inputs.filter(|_| !S::ROWS_OF_TARGETS));
    }
    if let Some(output) = earlier
        && plan.is_empty()
    {
        return Ok(Planned { plan, next: Next::Nothing(output), inputs, known });
    }
    let redone: BTreeSet<&Target> = plan.targets.iter().map(|planned| &planned.target).collect();
    let made = known.by_target();
    let stays = |Wanted { target, .. }: &Wanted| {
        let made = Made::clone(made.get(target).filter(|_| !redone.contains(target))?);
        Some((target.clone(), (made, rows.remove(target)?)))
    };
    let kept = wanted.iter().filter_map(stays).collect();
    let next = Next::Make(Box::new(Work { sources, wanted, kept }));
    Ok(Planned { plan, next, inputs, known })
}

/// Plans to join targets that were all made elsewhere.
pub(super) fn join<'k, S: Stage>(
    stage: &S,
    sources: S::Sources,
    record: &'k Record,
    kept: Kept<S>,
) -> Planned<'k, S> {
    let known = S::state(record);
    let wanted = stage.foreseen(known);
    let plan = StagePlan::new(known, &wanted, &[], true, |_, _| Vec::new());
    let next = Next::Make(Box::new(Work { sources, wanted, kept }));
    Planned { plan, next, inputs: Files::new(), known }
}

/// What a stage will have to do once those before it are done that have `touched` something: more
/// than that only if other tables than the record knows lie about.
pub(super) fn plan_after<S: Stage>(
    stage: &S,
    record: &Record,
    options: RerunOptions,
    touched: &BTreeSet<String>,
) -> StagePlan {
    let (known, force) = (S::state(record), options.force);
    let other = |made: &Made, wanted: &Wanted| {
        let mut old = made.parts.clone();
        old.retain(|name, _| wanted.parts.contains_key(name));
        [known.reasons(&old, wanted), perhaps(made, touched)].concat()
    };
    let common = common::<S>(known, force);
    let mut plan = StagePlan::new(known, &stage.foreseen(known), &common, force, other);
    if !S::ROWS_OF_TARGETS {
        let is_new = known.targets.is_empty();
        plan.whole.push(if is_new { "new" } else { "if a table changes" }.to_owned());
    }
    plan
}

/// Why all of a stage is made again, whatever it is made of.
fn common<S: Stage>(known: &StageState, force: bool) -> Vec<String> {
    match force {
        true => vec!["--force".to_owned()],
        false if known.source == S::SOURCE => Vec::new(),
        false if known.source.is_empty() => vec!["new".to_owned()],
        false => vec![format!("the program's {} has changed", S::NAME)],
    }
}

/// Whether what was made is what is foreseen, as far as that is known without reading anything.
fn are_as_foreseen(made: &[Made], foreseen: &[Wanted]) -> bool {
    let has = |made: &Made, wanted: &Wanted| {
        made.target == wanted.target
            && wanted.parts.iter().all(|(name, part)| made.parts.get(name) == Some(part))
    };
    made.len() == foreseen.len() && made.iter().zip(foreseen).all(|(made, of)| has(made, of))
}

/// Which files have another content than when they were read.
fn changed_files(old: &Files, new: &Files) -> Option<String> {
    let content = |inputs: &Files| -> Key {
        inputs.iter().map(|(path, stamp)| (path.clone(), stamp.blake3.clone())).collect()
    };
    let changed = reasons(&content(old), &content(new), Vec::new);
    let (first, others) = changed.split_first()?;
    Some(match others.len() {
        0 => first.clone(),
        others => format!("{first}, and so of {others} other files"),
    })
}

impl StageState {
    /// The targets that were made.
    fn by_target(&self) -> BTreeMap<&Target, &Made> {
        self.targets.iter().map(|made| (&made.target, made)).collect()
    }

    /// Why a target that was made of `old` parts is to be made again.
    fn reasons(&self, old: &Key, wanted: &Wanted) -> Vec<String> {
        reasons(old, &wanted.parts, || {
            let settings = old.get(SETTINGS).and_then(|hash| self.settings.get(hash));
            settings.map_or(Vec::new(), |old| changed_settings(old, &wanted.settings))
        })
    }
}

impl<S: Stage> Planned<'_, S> {
    /// What there is already, if there is nothing to do and nothing worth to be recorded.
    pub(super) fn up_to_date(self) -> Option<(S::Output, StagePlan)> {
        let Next::Nothing(output) = self.next else { return None };
        let mut both = self.inputs.iter().zip(&self.known.inputs);
        let is_confirmed = self.inputs.len() == self.known.inputs.len()
            && both.all(|((path, new), (old_path, old))| path == old_path && new.confirms(old));
        is_confirmed.then_some((output, self.plan))
    }

    /// Does what is planned; gives what to record, too. Says with every step of which part it is.
    ///
    /// # Errors
    /// A file cannot be written or removed, or the work was cancelled.
    pub(super) fn carry_out(
        self,
        stage: &S,
        (watch, of): (&dyn Watch, &str),
    ) -> Result<(S::Output, StagePlan, StageState), RunError> {
        let Self { plan, next, mut inputs, known } = self;
        watch.planned(&plan);
        let work = match next {
            Next::Nothing(output) => {
                return Ok((output, plan, StageState { inputs, ..known.clone() }));
            }
            Next::Make(work) => work,
        };
        let of_target = |wanted: &Wanted| {
            wanted.parts.get(SETTINGS).map(|hash| (hash.clone(), wanted.settings.clone()))
        };
        let settings = work.wanted.iter().filter_map(of_target).collect();
        let total = if S::STEPS.is_empty() { 1 } else { plan.targets.len() };
        let steps = Steps::begin::<S>(watch, total, of);
        let (output, made) = steps.end::<S, _>(stage.make(*work, &steps))?;
        remove_outdated(stage.home(), known, &made)?;
        inputs.extend(made.inputs);
        let (source, whole) = (S::SOURCE.to_owned(), stage.whole());
        Ok((output, plan, StageState { source, whole, settings, inputs, ..made }))
    }
}

/// Removes what the stage wrote before and does not have any more, if it is as it was written.
fn remove_outdated(home: &Path, known: &StageState, made: &StageState) -> Result<(), StoreError> {
    let current: BTreeSet<&String> = made.written().map(|(name, _)| name).collect();
    for (name, stamp) in known.written().filter(|(name, _)| !current.contains(name)) {
        let path = home.join(name);
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
    fn a_figure_of_a_robot_may_change_with_the_robot_s_trials() {
        let target = Target::new(Kind::Figure, "fig08");
        let of = vec![ANY_ROBOT.to_owned()];
        let made = Wanted::new(target, &(), Key::new(), of).made(Files::new());
        let mut touched = BTreeSet::from(["campaign semi-passive-symmetric".to_owned()]);
        assert!(perhaps(&made, &touched).is_empty());
        touched.extend(["robot semi-passive", ANY_ROBOT].map(str::to_owned));
        assert_eq!(perhaps(&made, &touched), ["if what it shows changes"]);
    }
}
