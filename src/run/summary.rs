//! `run.json`: how a run went.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{Begun, RunError};
use crate::clock::utc_now;
use crate::config::Config;
use crate::motion::Model;
use crate::store::{FitRow, FitStatus, Redo, TrialRow, TrialStatus};

/// `run.json`: what ran, how long it took and what failed.
#[derive(Debug, Clone, Serialize)]
pub struct RunRecord {
    pub program: &'static str,
    pub version: &'static str,
    /// `ok`, or `attention` where something needs a person.
    pub status: &'static str,
    /// UTC.
    pub started: String,
    pub ended: String,
    pub seconds: f64,
    /// Trial folder.
    pub folder: PathBuf,
    pub threads: usize,
    pub stages: Vec<StageRecord>,
    pub trials: TrialCounts,
    /// Trials that need a person, with the reason.
    pub attention: Vec<Attention>,
    pub fits: Vec<FitRecord>,
    /// Figures drawn.
    pub figures: Vec<String>,
    /// What could not be drawn, and why.
    pub missing: Vec<String>,
    pub page: PathBuf,
    pub scorecard: PathBuf,
}

/// `run.json` of a run that did not come to its end.
#[derive(Debug, Clone, Serialize)]
pub(super) struct BrokenRecord<'r> {
    program: &'static str,
    version: &'static str,
    /// `failed` or `interrupted`.
    status: &'static str,
    error: String,
    started: &'r str,
    ended: String,
    seconds: f64,
    folder: &'r Path,
    threads: usize,
    /// Those that were done.
    stages: &'r [StageRecord],
}

impl<'r> BrokenRecord<'r> {
    pub fn new(
        config: &'r Config,
        error: &RunError,
        begun: &'r Begun,
        stages: &'r [StageRecord],
    ) -> Self {
        let is_interrupted = matches!(error, RunError::Interrupted { .. });
        Self {
            program: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            status: if is_interrupted { "interrupted" } else { "failed" },
            error: error.to_string(),
            started: &begun.at,
            ended: utc_now(),
            seconds: begun.instant.elapsed().as_secs_f64(),
            folder: &config.paths.raw,
            threads: rayon::current_num_threads(),
            stages,
        }
    }
}

/// One stage of a run.
#[derive(Debug, Clone, Serialize)]
pub struct StageRecord {
    pub stage: &'static str,
    pub seconds: f64,
    /// Whether any file of it was looked at again.
    #[serde(skip)]
    pub did_something: bool,
    /// Trials, fits or figures that were made again, and how many were not.
    pub redone: Vec<String>,
    pub up_to_date: usize,
    /// Those that are no more.
    pub removed: Vec<String>,
}

impl StageRecord {
    pub(super) fn new(stage: &'static str, seconds: f64, redo: Redo) -> Self {
        Self {
            stage,
            seconds,
            did_something: !redo.is_empty(),
            redone: redo.names(),
            up_to_date: redo.up_to_date,
            removed: redo.removed,
        }
    }
}

/// How many trials ended how.
#[derive(Debug, Clone, Default, Serialize)]
pub struct TrialCounts {
    pub total: usize,
    pub ok: usize,
    pub flagged: usize,
    pub failed: usize,
}

/// A trial that needs a person.
#[derive(Debug, Clone, Serialize)]
pub struct Attention {
    pub trial: String,
    pub status: TrialStatus,
    pub message: String,
}

/// How one fit ended.
#[derive(Debug, Clone, Serialize)]
pub struct FitRecord {
    pub campaign: String,
    pub model: Model,
    pub status: FitStatus,
    /// Missing where there is no fit.
    pub j: Option<f64>,
}

/// Counts trials by their status.
pub fn count(trials: &[TrialRow]) -> TrialCounts {
    let with = |status| trials.iter().filter(|trial| trial.status == status).count();
    TrialCounts {
        total: trials.len(),
        ok: with(TrialStatus::Ok),
        flagged: with(TrialStatus::Flagged),
        failed: with(TrialStatus::Failed),
    }
}

/// The trials that are not `ok`.
pub fn attention(trials: &[TrialRow]) -> Vec<Attention> {
    let others = trials.iter().filter(|trial| trial.status != TrialStatus::Ok);
    others
        .map(|trial| Attention {
            trial: trial.trial.clone(),
            status: trial.status,
            message: trial.message.clone(),
        })
        .collect()
}

impl FitRecord {
    pub(super) fn new(fit: &FitRow) -> Self {
        Self {
            campaign: fit.campaign.clone(),
            model: fit.model,
            status: fit.status.clone(),
            j: fit.j.is_finite().then_some(fit.j),
        }
    }
}
