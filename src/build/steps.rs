//! The steps of a stage's work, shown and counted.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::plan::Stage;
use super::{RunError, Watch};

pub(super) struct Steps<'w> {
    pub watch: &'w dyn Watch,
    /// Of which part they are, if of one.
    of: &'w str,
    total: usize,
    done: AtomicUsize,
}

impl<'w> Steps<'w> {
    /// The steps of a stage, or of the part `of` it.
    pub(super) fn begin<S: Stage>(watch: &'w dyn Watch, total: usize, of: &'w str) -> Self {
        watch.begin(S::NAME, total);
        Self { watch, of, total, done: AtomicUsize::new(0) }
    }

    /// One more is done.
    pub(super) fn step(&self, what: &str) {
        let of = if self.of.is_empty() { "" } else { ", " };
        self.watch.step(&format!("{what}{of}{}", self.of));
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    /// Something smaller than a step is done: `done` of `total` parts of `what`.
    pub(super) fn part(&self, what: &str, done: usize, total: usize) {
        let of = if self.of.is_empty() { "" } else { " of " };
        self.watch.part(&format!("{what}{of}{}", self.of), done, total);
    }

    /// The work's result; says how far it was if it was cancelled.
    pub(super) fn end<S: Stage, T>(&self, result: Result<T, RunError>) -> Result<T, RunError> {
        let done = self.done.load(Ordering::Relaxed);
        let done = match S::STEPS {
            "" => String::new(),
            steps => format!("{done} of {} {steps}", self.total),
        };
        result.map_err(|error| error.interrupted(S::NAME, done))
    }
}
