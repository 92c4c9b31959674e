//! `run.json`: how a run went.

use std::path::Path;

use serde::Serialize;
use trilink_robot::Model;
use trilink_tables::config::Config;
use trilink_tables::{CheckRow, FitStatus, RunStatus, TrialRow, TrialStatus};

use super::plan::hash_of;
use super::{Finished, StagePlan};

/// `run.json`: what ran and how long it took, however it ended.
#[derive(Serialize)]
pub(super) struct RunRecord<'r> {
    pub program: &'static str,
    pub version: &'static str,
    /// Of the tables: hashes of the program's source and of the settings.
    pub source: String,
    pub configuration: String,
    pub status: RunStatus,
    /// Why it did not come to its end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// UTC.
    pub started: &'r str,
    pub ended: Option<String>,
    pub seconds: f64,
    /// Trial folders, as seen from the configuration.
    pub folders: Vec<String>,
    pub threads: usize,
    /// Those that were done.
    pub stages: &'r [StageRecord],
    #[serde(flatten)]
    pub results: Option<RunResults<'r>>,
}

/// Hash of the settings that results depend on, not places and looks.
pub(super) fn results_configuration(config: &Config) -> String {
    let mut settings = serde_json::to_value(config).expect("a configuration is plain data");
    if let Some(tables) = settings.as_object_mut() {
        tables.retain(|name, _| !["paths", "report", "compare"].contains(&name.as_str()));
    }
    hash_of(&settings)
}

/// What came of a run that came to its end, as `run.json` has it.
#[derive(Serialize)]
pub struct RunResults<'r> {
    trials: TrialCounts,
    attention: Vec<Attention<'r>>,
    fits: Vec<FitRecord<'r>>,
    /// Figures drawn.
    figures: &'r [String],
    /// What could not be drawn, and why.
    missing: &'r [String],
    page: &'r Path,
    scorecard: &'r Path,
}

/// A trial that needs a person, with the reason.
#[derive(Serialize)]
struct Attention<'r> {
    trial: &'r str,
    status: TrialStatus,
    message: &'r str,
}

/// How one fit ended.
#[derive(Serialize)]
struct FitRecord<'r> {
    campaign: &'r str,
    model: Model,
    status: &'r FitStatus,
    /// Missing where there is no fit.
    j: Option<f64>,
}

impl<'r> RunResults<'r> {
    pub fn new(finished: &'r Finished) -> Self {
        let Finished { ingested, fitted, reported, .. } = finished;
        let attention = |row: &'r TrialRow| Attention {
            trial: &row.trial,
            status: row.status,
            message: &row.message,
        };
        let of_several = |row: &'r CheckRow| Attention {
            trial: &row.trial,
            status: TrialStatus::Failed,
            message: &row.message,
        };
        let trials = ingested.trials.iter().filter(|trial| trial.status != TrialStatus::Ok);
        let attention = trials.map(attention).chain(ingested.together().map(of_several));
        let fits = fitted.fits.iter().map(|fit| FitRecord {
            campaign: &fit.campaign,
            model: fit.model,
            status: &fit.status,
            j: fit.j.is_finite().then_some(fit.j),
        });
        Self {
            trials: count(&ingested.trials),
            attention: attention.collect(),
            fits: fits.collect(),
            figures: &reported.figures,
            missing: &reported.missing,
            page: &reported.page,
            scorecard: &reported.scorecard,
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
            redone: plan.targets.iter().map(|planned| planned.target.name.clone()).collect(),
            up_to_date: plan.up_to_date,
            removed: plan.removed.iter().map(|target| target.name.clone()).collect(),
        }
    }
}

/// How many trials ended how.
#[derive(Debug, Serialize)]
pub struct TrialCounts {
    pub total: usize,
    pub ok: usize,
    pub flagged: usize,
    pub failed: usize,
}

/// Counts trials by their status.
pub fn count(trials: &[TrialRow]) -> TrialCounts {
    let with = |status| trials.iter().filter(|trial| trial.status == status).count();
    let [ok, flagged, failed] = TrialStatus::ALL.map(with);
    TrialCounts { total: trials.len(), ok, flagged, failed }
}
