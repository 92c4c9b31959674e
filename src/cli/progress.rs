//! Progress: bars on a terminal, plain lines elsewhere, nothing when asked to be quiet.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use trilink_base::cancel::{CancelToken, Cancelled};

use trilink_base::text::harmless;

use super::Interrupted;
use super::output::{note, write_note};
use crate::build::{Kind, PlannedTarget, StagePlan, Watch};
use crate::interrupt;

/// How progress is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shown {
    Nothing,
    Lines,
    Bars,
}

/// Shows progress and messages.
#[derive(Debug, Clone, Copy)]
pub(super) struct Progress {
    shown: Shown,
    /// Takes a line.
    line: fn(&str),
}

impl Progress {
    /// There are no bars where lines of the log (`logged`) come between.
    pub(super) fn new(quiet: bool, logged: bool) -> Self {
        let shown = match (quiet, std::io::stderr().is_terminal() && !logged) {
            (true, _) => Shown::Nothing,
            (false, true) => Shown::Bars,
            (false, false) => Shown::Lines,
        };
        Self { shown, line: write_note }
    }

    /// A message beside the results.
    pub(super) fn say(self, message: &str) {
        if self.shown != Shown::Nothing {
            (self.line)(message);
        }
    }

    /// A stage of `total` steps.
    pub(super) fn stage(self, name: &'static str, total: usize) -> Stage {
        let bar = match self.shown {
            Shown::Bars => ProgressBar::new(total as u64),
            Shown::Nothing | Shown::Lines => ProgressBar::hidden(),
        };
        let style =
            ProgressStyle::with_template("{prefix:>10} {bar:30} {pos}/{len} {eta:>4} left {msg}");
        bar.set_style(style.expect("the template is well-formed"));
        bar.set_prefix(name);
        let (begin, done) = (Instant::now(), AtomicUsize::new(0));
        Stage { progress: self, name, total, begin, done, bar }
    }

    /// Shows the stages of a run, one after the other, and the reasons if it is to `explain`.
    pub(super) fn watch(self, explain: bool) -> Watcher {
        let cancel = interrupt::token().clone();
        Watcher { progress: self, explain, cancel, stage: Mutex::new(None) }
    }
}

/// Shows a run as `trilink run` does: with `bars` on standard error, which must be a terminal then, else by
/// lines that are given to `line`; `cancel` cancels the run.
pub fn watch(bars: bool, line: fn(&str), cancel: CancelToken) -> impl Watch {
    let shown = if bars { Shown::Bars } else { Shown::Lines };
    Watcher { progress: Progress { shown, line }, explain: false, cancel, stage: Mutex::new(None) }
}

/// Shows a whole run, one stage after the other.
pub(super) struct Watcher {
    progress: Progress,
    explain: bool,
    cancel: CancelToken,
    stage: Mutex<Option<Stage>>,
}

impl Watcher {
    fn with_stage(&self, show: impl Fn(&Stage)) {
        if let Ok(stage) = self.stage.lock() {
            stage.iter().for_each(show);
        }
    }
}

impl Watch for Watcher {
    fn planned(&self, plan: &StagePlan) {
        if self.explain {
            for PlannedTarget { target, why } in &plan.targets {
                note!("{target}: {}", why.join("; "));
            }
            plan.removed.iter().for_each(|target| note!("{target}: is no more"));
            plan.whole.iter().for_each(|why| note!("{why}"));
        }
        let trials = plan.removed.iter().filter(|target| target.kind == Kind::Trial);
        let trials: Vec<String> = trials.map(|target| target.name.clone()).collect();
        if !trials.is_empty() {
            let trials = trials.join(", ");
            self.note(&format!("not in the list of trials any more, removed: {trials}"));
        }
    }

    fn cancel_token(&self) -> CancelToken {
        self.cancel.clone()
    }

    fn note(&self, message: &str) {
        self.progress.say(message);
    }

    fn begin(&self, stage: &'static str, total: usize) {
        if let Ok(mut current) = self.stage.lock() {
            // The old bar goes before the new one comes.
            *current = None;
            *current = Some(self.progress.stage(stage, total));
        }
    }

    fn step(&self, what: &str) {
        self.with_stage(|stage| stage.step(what));
    }

    fn part(&self, what: &str, done: usize, total: usize) {
        self.with_stage(|stage| stage.part(what, done, total));
    }
}

/// Lines show no remaining time of a stage that has run for less.
const SHORT: Duration = Duration::from_secs(5);

/// Progress of one stage; its steps may end on any thread.
pub(super) struct Stage {
    progress: Progress,
    name: &'static str,
    total: usize,
    begin: Instant,
    done: AtomicUsize,
    bar: ProgressBar,
}

impl Stage {
    /// One more step is done.
    pub(super) fn step(&self, message: &str) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        if self.progress.shown == Shown::Lines {
            let left = self.time_left(done);
            self.progress.say(&format!("{} {done}/{} {message}{left}", self.name, self.total));
        }
        self.bar.set_message(harmless(message).into_owned());
        self.bar.inc(1);
    }

    /// How long the rest will take if it goes on like this.
    fn time_left(&self, done: usize) -> String {
        let elapsed = self.begin.elapsed();
        if elapsed < SHORT || done >= self.total {
            return String::new();
        }
        let left_s = elapsed.as_secs_f64() * (self.total - done) as f64 / done as f64;
        match left_s {
            ..90.0 => format!(", {left_s:.0} s left"),
            ..5400.0 => format!(", {:.0} min left", left_s / 60.0),
            _ => format!(", {:.1} h left", left_s / 3600.0),
        }
    }

    /// Shows on a bar the progress within a step.
    pub(super) fn part(&self, what: &str, done: usize, total: usize) {
        self.bar.set_message(harmless(&format!("{what} {done}/{total}")).into_owned());
    }

    /// One more step is done that is too small for a line of its own.
    pub(super) fn tick(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
        self.bar.inc(1);
    }

    /// Ends the command with `?` once it was cancelled.
    ///
    /// # Errors
    /// The command was cancelled.
    pub(super) fn check(&self, steps: &str) -> Result<(), Interrupted> {
        interrupt::token().check().map_err(|Cancelled| self.interrupted(steps))
    }

    /// How many of its `steps`, such as trials, were done when it was cancelled.
    pub(super) fn interrupted(&self, steps: &str) -> Interrupted {
        let done = self.done.load(Ordering::Relaxed);
        Interrupted { done: format!("{done} of {} {steps}", self.total) }
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
