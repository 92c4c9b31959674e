//! Progress of a stage: reports and counts its steps.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::plan::Stage;
use super::{RunError, Watch};

/// Progress of a stage or of one of its shards.
pub(super) struct Steps<'w> {
    pub watch: &'w dyn Watch,
    /// Name of the shard; empty for an undivided stage.
    shard: &'w str,
    total: usize,
    done: AtomicUsize,
}

impl<'w> Steps<'w> {
    /// Announces the start of a stage of `total` steps, or of its shard with the given name (empty for the whole
    /// stage).
    pub(super) fn begin<S: Stage>(watch: &'w dyn Watch, total: usize, shard: &'w str) -> Self {
        watch.begin(S::NAME, total);
        Self { watch, shard, total, done: AtomicUsize::new(0) }
    }

    /// Reports and counts a completed step.
    pub(super) fn step(&self, what: &str) {
        let separator = if self.shard.is_empty() { "" } else { ", " };
        self.watch.step(&format!("{what}{separator}{}", self.shard));
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    /// Reports progress within a step: `done` of `total` parts of `what`.
    pub(super) fn part(&self, what: &str, done: usize, total: usize) {
        let separator = if self.shard.is_empty() { "" } else { " of " };
        self.watch.part(&format!("{what}{separator}{}", self.shard), done, total);
    }

    /// Returns `result`; if it is a cancellation error, adds the number of completed steps to the error.
    pub(super) fn end<S: Stage, T>(&self, result: Result<T, RunError>) -> Result<T, RunError> {
        let done = self.done.load(Ordering::Relaxed);
        let done = match S::STEPS {
            "" => String::new(),
            steps => format!("{done} of {} {steps}", self.total),
        };
        result.map_err(|error| error.interrupted(S::NAME, done))
    }
}
