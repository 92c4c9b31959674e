//! `run.json`: the summary of a run.

use std::path::Path;

use serde::Serialize;
use trilink_robot::Model;
use trilink_tables::config::Config;
use trilink_tables::{FitStatus, RunStatus, TrialRow, TrialStatus};

use super::plan::hash_of;
use super::{Finished, StagePlan};

/// Content of `run.json`: stages, durations and outcome of a run.
#[derive(Serialize)]
pub(super) struct RunRecord<'r> {
    pub program: &'static str,
    pub version: &'static str,
    /// Hash of the source code of the stages that write tables.
    pub source: String,
    /// Hash of the settings on which the tables depend.
    pub configuration: String,
    pub status: RunStatus,
    /// Error that ended the run; `None` if there was none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Start time of the run (UTC).
    pub started: &'r str,
    pub ended: Option<String>,
    pub seconds: f64,
    /// Trial folders, relative to the folder of the configuration file.
    pub folders: Vec<String>,
    pub threads: usize,
    /// Completed stages.
    pub stages: &'r [StageRecord],
    #[serde(flatten)]
    pub results: Option<RunResults<'r>>,
}

/// Hashes the settings on which results depend: all except those in the tables `paths`, `report` and `compare`.
pub(super) fn results_configuration(config: &Config) -> String {
    let mut settings = serde_json::to_value(config).expect("a configuration can be serialised");
    if let Some(tables) = settings.as_object_mut() {
        tables.retain(|name, _| !["paths", "report", "compare"].contains(&name.as_str()));
    }
    hash_of(&settings)
}

/// Results of a completed run, as listed in `run.json`.
#[derive(Serialize)]
pub struct RunResults<'r> {
    trials: TrialCounts,
    attention: Vec<Attention<'r>>,
    fits: Vec<FitRecord<'r>>,
    /// Names of the figures that were drawn.
    figures: &'r [String],
    /// Sentences about figures that could not be drawn, each with the reason.
    missing: &'r [String],
    page: &'r Path,
    scorecard: Option<&'r Path>,
}

/// Trial that needs attention, with the reason.
#[derive(Serialize)]
struct Attention<'r> {
    trial: &'r str,
    status: TrialStatus,
    message: &'r str,
}

/// Outcome of a fit.
#[derive(Serialize)]
struct FitRecord<'r> {
    campaign: &'r str,
    model: Model,
    status: FitStatus,
    /// Reason why the fit failed; empty if it did not.
    failure: &'r str,
    /// Objective, or `None` if the fit failed.
    j: Option<f64>,
}

impl<'r> RunResults<'r> {
    /// Summarises the results of a completed run.
    pub fn new(finished: &'r Finished) -> Self {
        let Finished { ingested, fitted, reported, .. } = finished;
        let trials = ingested
            .trials
            .iter()
            .filter(|trial| matches!(trial.status, TrialStatus::Flagged | TrialStatus::Failed));
        let attention = trials
            .map(|row| Attention { trial: &row.trial, status: row.status, message: &row.message })
            .chain(ingested.together().map(|row| Attention {
                trial: &row.trial,
                status: TrialStatus::Failed,
                message: &row.message,
            }));
        let fits = fitted.fits.iter().map(|fit| FitRecord {
            campaign: &fit.campaign,
            model: fit.model,
            status: fit.status,
            failure: &fit.failure,
            j: fit.j.is_finite().then_some(fit.j),
        });
        Self {
            trials: count(&ingested.trials),
            attention: attention.collect(),
            fits: fits.collect(),
            figures: &reported.figures,
            missing: &reported.missing,
            page: &reported.page,
            scorecard: reported.scorecard.as_deref(),
        }
    }
}

/// Record of one stage of a run.
#[derive(Debug, Clone, Serialize)]
pub struct StageRecord {
    pub stage: &'static str,
    pub seconds: f64,
    /// Whether the stage had anything to recompute or remove.
    #[serde(skip)]
    pub did_something: bool,
    /// Names of the recomputed trials, fits or figures.
    pub redone: Vec<String>,
    /// Number of trials, fits or figures that were up to date.
    pub up_to_date: usize,
    /// Names of the trials, fits or figures that were removed.
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

/// Number of trials with each status.
#[derive(Debug, Serialize)]
pub struct TrialCounts {
    pub total: usize,
    pub ok: usize,
    pub flagged: usize,
    pub failed: usize,
    pub ignored: usize,
}

/// Counts trials by their status.
pub fn count(trials: &[TrialRow]) -> TrialCounts {
    let [ok, flagged, failed, ignored] =
        TrialStatus::ALL.map(|status| trials.iter().filter(|trial| trial.status == status).count());
    TrialCounts { total: trials.len(), ok, flagged, failed, ignored }
}
