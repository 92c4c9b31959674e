//! `run.json`: how a run went.

use std::path::PathBuf;

use serde::Serialize;

use super::{Begun, StagePlan, Target};
use crate::clock::utc_now;
use crate::config::Config;
use crate::robot::Model;
use crate::store::{FitRow, FitStatus, TrialRow, TrialStatus};

/// What ran and how long it took, however it ended.
#[derive(Debug, Clone, Serialize)]
pub struct RunHeader {
    pub program: &'static str,
    pub version: &'static str,
    /// `ok`, or `attention` where something needs a person; `failed` or `interrupted` where a run
    /// did not come to its end.
    pub status: &'static str,
    /// Why it did not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// UTC.
    pub started: String,
    pub ended: String,
    pub seconds: f64,
    /// Trial folder.
    pub folder: PathBuf,
    pub threads: usize,
    /// Those that were done.
    pub stages: Vec<StageRecord>,
}

/// `run.json`: what ran, how long it took and what failed.
#[derive(Debug, Clone, Serialize)]
pub struct RunRecord {
    #[serde(flatten)]
    pub header: RunHeader,
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

impl RunHeader {
    pub(super) fn new(
        config: &Config,
        status: &'static str,
        begun: &Begun,
        stages: Vec<StageRecord>,
    ) -> Self {
        Self {
            program: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            status,
            error: None,
            started: begun.at.clone(),
            ended: utc_now(),
            seconds: begun.instant.elapsed().as_secs_f64(),
            folder: config.paths.raw.clone(),
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
    pub(super) fn new(stage: &'static str, seconds: f64, plan: &StagePlan) -> Self {
        Self {
            stage,
            seconds,
            did_something: !plan.is_empty(),
            redone: plan.names(),
            up_to_date: plan.up_to_date,
            removed: plan.removed.iter().map(Target::name).collect(),
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
