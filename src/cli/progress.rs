//! Progress display: bars on a terminal, plain lines elsewhere, nothing with `--quiet`.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use trilink_base::cancel::{CancelToken, Cancelled};

use trilink_base::text::escape_controls;

use super::Interrupted;
use super::output::{note, print_note};
use crate::build::{Kind, PlannedTarget, StagePlan, Watch};
use crate::interrupt;

/// Form in which progress is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shown {
    Nothing,
    /// A line for each step.
    Lines,
    /// Progress bars on standard error, which must be a terminal.
    Bars,
}

/// Output for progress and messages, and the token that cancels the command.
#[derive(Debug, Clone)]
pub(super) struct Progress {
    pub shown: Shown,
    /// Function that prints a line.
    pub line: fn(&str),
    pub cancel: CancelToken,
}

impl Progress {
    /// Creates the output for progress and messages, which shows nothing if `quiet` is set. Progress bars are not used
    /// if a log is printed to the same terminal (`logged`).
    pub(super) fn new(quiet: bool, logged: bool) -> Self {
        let shown = match (quiet, std::io::stderr().is_terminal() && !logged) {
            (true, _) => Shown::Nothing,
            (false, true) => Shown::Bars,
            (false, false) => Shown::Lines,
        };
        Self { shown, line: |text| print_note(text), cancel: interrupt::token().clone() }
    }

    /// Whether nothing but results and errors is printed.
    pub(super) fn is_quiet(&self) -> bool {
        self.shown == Shown::Nothing
    }

    /// Prints a message to standard error unless `--quiet` is given.
    pub(super) fn say(&self, message: &str) {
        if self.shown != Shown::Nothing {
            (self.line)(message);
        }
    }

    /// Starts showing the progress of the stage `name`, which has `total` steps.
    pub(super) fn stage(&self, name: &'static str, total: usize) -> Stage {
        let bar = match self.shown {
            Shown::Bars => ProgressBar::new(total as u64),
            Shown::Nothing | Shown::Lines => ProgressBar::hidden(),
        };
        let style = ProgressStyle::with_template(
            "{prefix:>8} {bar:16} {pos}/{len} {eta:>4} left {wide_msg}",
        );
        bar.set_style(style.expect("the template is well-formed"));
        bar.set_prefix(name);
        let done = AtomicUsize::new(0);
        Stage { progress: self.clone(), name, total, begin: Instant::now(), done, bar }
    }

    /// Returns an observer that shows the stages of a run and, with `explain`, the reasons to recompute targets.
    pub(super) fn watch(&self, explain: bool) -> Watcher {
        Watcher { progress: self.clone(), explain, stage: Mutex::new(None) }
    }
}

/// Observer that shows a run, one stage after the other.
pub(super) struct Watcher {
    progress: Progress,
    explain: bool,
    stage: Mutex<Option<Stage>>,
}

impl Watcher {
    /// Calls `show` with the current stage, if there is one.
    fn with_stage(&self, show: impl Fn(&Stage)) {
        if let Ok(stage) = self.stage.lock() {
            stage.iter().for_each(show);
        }
    }

    /// Prints lines above the progress bar, if there is one.
    fn above_bar(&self, print: impl FnOnce()) {
        match self.stage.lock().as_deref() {
            Ok(Some(stage)) => stage.bar.suspend(print),
            _ => print(),
        }
    }
}

impl Watch for Watcher {
    fn planned(&self, plan: &StagePlan) {
        if self.explain {
            self.above_bar(|| {
                for PlannedTarget { target, why } in &plan.targets {
                    note!("{target}: {}", why.join("; "));
                }
                plan.removed.iter().for_each(|target| note!("{target}: no longer listed"));
                plan.whole.iter().for_each(|why| note!("{why}"));
            });
        }
        let trials = plan.removed.iter().filter(|target| target.kind == Kind::Trial);
        let trials: Vec<&str> = trials.map(|target| target.name.as_str()).collect();
        if !trials.is_empty() {
            let more = match trials.len().saturating_sub(MAX_NAMES) {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            let named = trials[..trials.len().min(MAX_NAMES)].join(", ");
            self.note(&format!(
                "these trials were removed, because they are no longer in the list of trials: {named}{more}"
            ));
        }
    }

    fn cancel_token(&self) -> CancelToken {
        self.progress.cancel.clone()
    }

    fn note(&self, message: &str) {
        self.above_bar(|| self.progress.say(message));
    }

    fn begin(&self, stage: &'static str, total: usize) {
        if let Ok(mut current) = self.stage.lock() {
            // The old progress bar is removed before the new one appears.
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

/// Maximum number of removed trials that are named.
const MAX_NAMES: usize = 10;
/// Minimum duration of a stage before the lines of progress state the remaining time.
const MIN_ELAPSED: Duration = Duration::from_secs(5);

/// Progress of one stage, whose steps may end on any thread.
pub(super) struct Stage {
    progress: Progress,
    name: &'static str,
    total: usize,
    begin: Instant,
    done: AtomicUsize,
    bar: ProgressBar,
}

impl Stage {
    /// Counts a completed step and shows it with a message.
    pub(super) fn step(&self, message: &str) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        if self.progress.shown == Shown::Lines {
            let left = self.time_left(done);
            self.progress.say(&format!("{} {done}/{} {message}{left}", self.name, self.total));
        }
        self.bar.set_message(escape_controls(message).into_owned());
        self.bar.inc(1);
    }

    /// Formats the remaining time of the stage, estimated from the mean duration of the `done` steps; empty shortly
    /// after the start and after the last step.
    fn time_left(&self, done: usize) -> String {
        let elapsed = self.begin.elapsed();
        if elapsed < MIN_ELAPSED || done >= self.total {
            return String::new();
        }
        let left_s = elapsed.as_secs_f64() * (self.total - done) as f64 / done as f64;
        match left_s {
            ..90.0 => format!(", {left_s:.0} s left"),
            ..5400.0 => format!(", {:.0} min left", left_s / 60.0),
            _ => format!(", {:.1} h left", left_s / 3600.0),
        }
    }

    /// Shows the progress within a step on the progress bar.
    pub(super) fn part(&self, what: &str, done: usize, total: usize) {
        self.bar.set_message(escape_controls(&format!("{what} {done}/{total}")).into_owned());
    }

    /// Counts a completed step that is too small to get its own line.
    pub(super) fn tick(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
        self.bar.inc(1);
    }

    /// Checks whether the command was cancelled.
    ///
    /// # Errors
    /// Returns an error if the command was cancelled. It states the number of completed steps, which it calls `steps`,
    /// such as "trials".
    pub(super) fn check(&self, steps: &str) -> Result<(), Interrupted> {
        self.progress.cancel.check().map_err(|Cancelled| self.interrupted(steps))
    }

    /// Returns the error for a cancelled command. It states the number of completed steps, which it calls `steps`, such
    /// as "trials".
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
