//! What a stage has to do again and why, and doing it: one engine for all stages.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;
use trilink_tables::{Reader, Stamp, StoreError, hash};

use super::record::{Inputs, Made, Outputs, Record, StageState, changed_outputs};
use super::target::{Fingerprint, SETTINGS, Target, changed_settings, reasons};
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
}

/// A target to make again, and why.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlannedTarget {
    pub target: Target,
    pub why: Vec<String>,
}

impl StagePlan {
    /// Adds a target; without a reason it is up to date.
    fn add(&mut self, target: Target, why: Vec<String>) {
        match why.is_empty() {
            true => self.up_to_date += 1,
            false => self.targets.push(PlannedTarget { target, why }),
        }
    }

    /// Whether all is up to date.
    pub fn is_empty(&self) -> bool {
        self.targets.is_empty() && self.removed.is_empty() && self.whole.is_empty()
    }
}

/// A target as it would be made now.
#[derive(Debug, Clone)]
pub(super) struct Wanted {
    pub target: Target,
    pub settings: Value,
    pub parts: Fingerprint,
    /// Campaigns that a figure shows.
    pub campaigns: Vec<String>,
}

impl Wanted {
    /// A target that is made of `settings` and other parts.
    pub(super) fn new(target: Target, settings: &impl Serialize, mut parts: Fingerprint) -> Self {
        let settings = serde_json::to_value(settings).expect("settings have text keys");
        if !settings.is_null() {
            parts.insert(SETTINGS.to_owned(), hash_of(&settings));
        }
        Self { target, settings, parts, campaigns: Vec::new() }
    }

    /// It as made, with the files that it left.
    pub(super) fn made(self, outputs: Outputs) -> Made {
        let Self { target, parts, campaigns, .. } = self;
        Made { target, parts, campaigns, outputs }
    }
}

/// Of the value as JSON.
pub(super) fn hash_of(value: &impl Serialize) -> String {
    hash(&serde_json::to_vec(value).expect("plain data with text keys"))
}

/// A stage as the engine sees it. It reads files, makes targets of them, each with files of its
/// own, and files of the stage as a whole.
pub(super) trait Stage: Sync {
    /// What the targets are made of, read.
    type Sources;
    /// What stays of a target that is not made again.
    type Kept: Sync;
    type Output: Clone;

    const NAME: &'static str;
    /// Hash of the stage's source, see `build.rs`.
    const SOURCE: &'static str;
    /// Whether the files of the stage as a whole are the rows of its targets; else they are made
    /// of everything that is read.
    const ROWS_OF_TARGETS: bool;
    /// What to say where targets have another order than they had.
    const OTHER_ORDER: &'static str;
    /// What to say where nothing is kept of a target that is up to date.
    const NOT_KEPT: &'static str;

    /// The stage's part of the record.
    fn state(record: &Record) -> &StageState;

    /// The folder that it writes to.
    fn home(&self) -> &Path;

    /// The settings of the stage as a whole.
    fn whole(&self) -> Value {
        Value::Null
    }

    /// Whether a stage that is otherwise unchanged finds everything as it did, as far as that can
    /// be told without reading it.
    fn reads_the_same(&self, _known: &StageState, _inputs: &Inputs) -> Result<bool, RunError> {
        Ok(false)
    }

    /// Reads what the targets are made of.
    fn read(&self, inputs: &Inputs) -> Result<Self::Sources, RunError>;

    /// All targets in order.
    fn wanted(&self, sources: &Self::Sources) -> Vec<Wanted>;

    /// Completes a target's parts by what is looked at only if the target was `made` before; gives
    /// a reason to make it again whatever its parts are.
    fn complete(
        &self,
        _index: usize,
        _wanted: &mut Wanted,
        _made: &Made,
        _inputs: &Inputs,
    ) -> Option<String> {
        None
    }

    /// What the stage gave the last time, as it was `written`; or why its files cannot be used.
    fn earlier(&self, known: &StageState, written: &Reader) -> Result<Self::Output, String>;

    /// What stays of each target that is not made again.
    fn kept(&self, known: &StageState, earlier: Self::Output) -> BTreeMap<Target, Self::Kept>;

    /// What is there that nobody accounts for.
    fn leftovers(&self, _known: &StageState) -> Result<Vec<String>, RunError> {
        Ok(Vec::new())
    }

    /// How many steps it takes to make so many targets.
    fn steps(&self, targets: usize) -> usize {
        targets
    }

    /// Makes what is not kept and the files of the stage as a whole. Gives of the record its
    /// targets in order, the whole stage's files, what is missing, and the stamps of files as they
    /// were when they were read, where that was not for the plan.
    fn make(
        &self,
        work: Work<Self>,
        watch: &dyn Watch,
    ) -> Result<(Self::Output, StageState), RunError>;

    /// Targets that there will be, with the parts of them that are known before the stages before
    /// are done.
    fn foreseen(&self, known: &StageState) -> Vec<Wanted> {
        let of_stage = known.targets.iter();
        of_stage.map(|made| Wanted::new(made.target.clone(), &(), Fingerprint::new())).collect()
    }

    /// Why a target may have to be made again once the stages before are done.
    fn perhaps(&self, _made: &Made, _touched: &Touched) -> Vec<String> {
        Vec::new()
    }
}

/// What there is to do.
pub(super) struct Work<S: Stage + ?Sized> {
    pub sources: S::Sources,
    /// All targets in order.
    pub wanted: Vec<Wanted>,
    /// Those that stay.
    pub kept: BTreeMap<Target, (Made, S::Kept)>,
}

/// What later stages may find changed.
#[derive(Debug, Default)]
pub(super) struct Touched {
    pub trials: BTreeSet<String>,
    pub campaigns: BTreeSet<String>,
    pub robots: BTreeSet<String>,
}

/// A plan with what it takes to carry it out.
pub(super) struct Planned<'k, S: Stage> {
    pub plan: StagePlan,
    next: Next<S>,
    known: &'k StageState,
}

enum Next<S: Stage> {
    /// All is up to date: what there is, and the stamps of the files as they are now, where they
    /// were looked at one by one.
    Nothing(S::Output, Option<BTreeMap<String, Stamp>>),
    /// What there is to do, and the record's part as far as it is known.
    Make(Box<(Work<S>, StageState)>),
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
    let inputs = Inputs::new(derived, record, known, verify);
    let changed = |outputs: &Outputs| changed_outputs(home, outputs, verify);
    let mut damaged = if force { Vec::new() } else { changed(&known.outputs) };
    let mut earlier = None;
    if !force && !known.source.is_empty() && (damaged.is_empty() || !S::ROWS_OF_TARGETS) {
        let found = stage.earlier(known, &Reader::of(home, &known.outputs));
        earlier = found.map_err(|why| damaged.push(why)).ok();
    }
    let (is_same_source, whole) = (known.source == S::SOURCE, stage.whole());
    let mut plan = StagePlan::default();
    if let Some(output) = &earlier
        && damaged.is_empty()
        && is_same_source
        && known.whole == whole
        && stage.reads_the_same(known, &inputs)?
        && known.targets.par_iter().all(|made| changed(&made.outputs).is_empty())
    {
        plan.up_to_date = known.targets.len();
        return Ok(Planned { plan, next: Next::Nothing(output.clone(), None), known });
    }
    let sources = stage.read(&inputs)?;
    let mut rows = earlier.clone().map(|earlier| stage.kept(known, earlier)).unwrap_or_default();
    let made: BTreeMap<&Target, &Made> =
        known.targets.iter().map(|made| (&made.target, made)).collect();
    let mut wanted = stage.wanted(&sources);
    let reasons = |(index, wanted): (usize, &mut Wanted)| {
        let made = match made.get(&wanted.target) {
            _ if force => return vec!["--force".to_owned()],
            None => return vec!["new".to_owned()],
            Some(made) => made,
        };
        let mut why: Vec<String> =
            stage.complete(index, wanted, made, &inputs).into_iter().collect();
        why.extend(source_reason::<S>(known));
        if S::ROWS_OF_TARGETS {
            why.extend(damaged.iter().cloned());
        }
        why.extend(known.reasons(&made.parts, wanted));
        why.extend(changed(&made.outputs));
        if why.is_empty() && !rows.contains_key(&wanted.target) {
            why.push(S::NOT_KEPT.to_owned());
        }
        why
    };
    let why: Vec<Vec<String>> = wanted.par_iter_mut().enumerate().map(reasons).collect();
    let mut kept = Vec::new();
    for (wanted, why) in wanted.iter().zip(why) {
        if why.is_empty() {
            kept.extend(made.get(&wanted.target).zip(rows.remove(&wanted.target)));
        }
        plan.add(wanted.target.clone(), why);
    }
    plan.removed = removed(known, &wanted);
    if plan.is_empty() {
        let order = known.targets.iter().map(|made| &made.target);
        if !order.eq(wanted.iter().map(|wanted| &wanted.target)) {
            plan.whole.push(S::OTHER_ORDER.to_owned());
        }
        plan.whole.extend(force.then(|| "--force".to_owned()));
        plan.whole.extend(damaged);
        plan.whole.extend(source_reason::<S>(known));
        plan.whole.extend(changed_settings(&known.whole, &whole));
        plan.whole.extend(stage.leftovers(known)?);
    }
    let inputs = inputs.named();
    if plan.is_empty() && !S::ROWS_OF_TARGETS {
        plan.whole.extend(changed_files(&known.inputs, &inputs));
    }
    if let Some(earlier) = earlier
        && plan.is_empty()
    {
        return Ok(Planned { plan, next: Next::Nothing(earlier, Some(inputs)), known });
    }
    let with_record =
        |(made, stays): (&&Made, _)| (made.target.clone(), (Made::clone(made), stays));
    let kept = kept.into_iter().map(with_record).collect();
    let state = StageState { inputs, ..ahead::<S>(whole, &wanted) };
    let next = Next::Make(Box::new((Work { sources, wanted, kept }, state)));
    Ok(Planned { plan, next, known })
}

/// Plans to join targets that were all made elsewhere.
pub(super) fn join<'k, S: Stage<Sources = ()>>(
    stage: &S,
    record: &'k Record,
    kept: BTreeMap<Target, (Made, S::Kept)>,
) -> Planned<'k, S> {
    let (known, wanted) = (S::state(record), stage.wanted(&()));
    let removed = removed(known, &wanted);
    let plan = StagePlan { up_to_date: kept.len(), removed, ..StagePlan::default() };
    let state = ahead::<S>(stage.whole(), &wanted);
    Planned { plan, next: Next::Make(Box::new((Work { sources: (), wanted, kept }, state))), known }
}

/// The record of a stage as far as it is known before the stage is done.
fn ahead<S: Stage>(whole: Value, wanted: &[Wanted]) -> StageState {
    let of_target = |wanted: &Wanted| {
        wanted.parts.get(SETTINGS).map(|hash| (hash.clone(), wanted.settings.clone()))
    };
    let (source, settings) = (S::SOURCE.to_owned(), wanted.iter().filter_map(of_target).collect());
    StageState { source, whole, settings, ..StageState::default() }
}

/// What a stage will have to do once those before it are done that have `touched` something: more
/// than that only if other tables than the record knows lie about.
pub(super) fn plan_after<S: Stage>(
    stage: &S,
    known: &StageState,
    options: RerunOptions,
    touched: &Touched,
) -> StagePlan {
    let mut plan = StagePlan::default();
    let made: BTreeMap<&Target, &Made> =
        known.targets.iter().map(|made| (&made.target, made)).collect();
    let foreseen = stage.foreseen(known);
    plan.removed = removed(known, &foreseen);
    for wanted in foreseen {
        let mut why = Vec::new();
        match made.get(&wanted.target) {
            _ if options.force => why.push("--force".to_owned()),
            None => why.push("new".to_owned()),
            Some(made) => {
                let mut old = made.parts.clone();
                old.retain(|name, _| wanted.parts.contains_key(name));
                why.extend(source_reason::<S>(known));
                why.extend(known.reasons(&old, &wanted));
                why.extend(stage.perhaps(made, touched));
            }
        }
        plan.add(wanted.target, why);
    }
    if !S::ROWS_OF_TARGETS {
        let is_new = known.targets.is_empty();
        plan.whole.push(if is_new { "new" } else { "if a table changes" }.to_owned());
    }
    plan
}

/// Targets that are no more.
fn removed(known: &StageState, wanted: &[Wanted]) -> Vec<Target> {
    let wanted: BTreeSet<&Target> = wanted.iter().map(|wanted| &wanted.target).collect();
    let known = known.targets.iter().map(|made| &made.target);
    let removed: BTreeSet<&Target> = known.filter(|target| !wanted.contains(target)).collect();
    removed.into_iter().cloned().collect()
}

/// What is said if the program's source of a stage is another than it was.
fn source_reason<S: Stage>(known: &StageState) -> Option<String> {
    let reason = match known.source.is_empty() {
        true => "new".to_owned(),
        false => format!("the program's {} has changed", S::NAME),
    };
    (known.source != S::SOURCE).then_some(reason)
}

impl StageState {
    /// Why a target that was made of `old` parts is to be made again.
    fn reasons(&self, old: &Fingerprint, wanted: &Wanted) -> Vec<String> {
        reasons(old, &wanted.parts, || {
            let settings = old.get(SETTINGS).and_then(|hash| self.settings.get(hash));
            settings.map_or(Vec::new(), |old| changed_settings(old, &wanted.settings))
        })
    }
}

/// Which files have another content than when they were read.
fn changed_files(old: &BTreeMap<String, Stamp>, new: &BTreeMap<String, Stamp>) -> Option<String> {
    let content = |inputs: &BTreeMap<String, Stamp>| -> Fingerprint {
        inputs.iter().map(|(path, stamp)| (path.clone(), stamp.blake3.clone())).collect()
    };
    let changed = reasons(&content(old), &content(new), Vec::new);
    let (first, others) = changed.split_first()?;
    Some(match others.len() {
        0 => first.clone(),
        others => format!("{first}, and so of {others} other files"),
    })
}

impl<S: Stage> Planned<'_, S> {
    /// What there is already, if there is nothing to do and nothing worth to be recorded.
    pub(super) fn up_to_date(self) -> Option<(S::Output, StagePlan)> {
        let Next::Nothing(output, inputs) = self.next else { return None };
        let is_confirmed = inputs.is_none_or(|inputs| self.known.are_confirmed_by(&inputs));
        is_confirmed.then_some((output, self.plan))
    }

    /// Does what is planned; gives what to record, too.
    ///
    /// # Errors
    /// A file cannot be written or removed.
    pub(super) fn carry_out(
        self,
        stage: &S,
        watch: &dyn Watch,
    ) -> Result<(S::Output, StagePlan, StageState), RunError> {
        let Self { plan, next, known } = self;
        watch.planned(&plan);
        let (work, mut state) = match next {
            Next::Nothing(output, inputs) => {
                let mut state = known.clone();
                state.inputs = inputs.unwrap_or(state.inputs);
                return Ok((output, plan, state));
            }
            Next::Make(work) => *work,
        };
        watch.begin(S::NAME, stage.steps(plan.targets.len()));
        let (output, made) = stage.make(work, watch)?;
        remove_outdated(stage.home(), known, &made)?;
        state.inputs.extend(made.inputs);
        let StageState { targets, outputs, missing, .. } = made;
        Ok((output, plan, StageState { targets, outputs, missing, ..state }))
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
