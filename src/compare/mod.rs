//! Comparison of a candidate run with the baseline run: differences that exceed noise.
//!
//! Two runs of the same laboratory differ by noise in almost every value. Each column has a tolerance, mostly in
//! combined standard errors of both runs. A small systematic shift shows in the mean over a campaign's trials before it
//! shows in a single trial.

mod causes;
mod figures;
mod files;
mod history;
mod judge;
mod means;
mod names;
mod noise;
mod record;
mod runs;
mod snapshot;
mod steps;
mod trend;

use std::collections::BTreeSet;
use std::path::PathBuf;

pub use causes::{Cause, CauseKind, by_table};
pub use files::{changes, junit, page, to_json};
pub use history::HistoryRow;
pub use judge::{Judgement, Verdict};
pub use record::{is_history_up_to_date, note_acceptances, record_failure, record_run};
pub use snapshot::{Acceptance, Record, Records, Snapshot, tables_folder};

use serde::Serialize;
use serde_json::Value as Json;
use trilink_plot::DrawError;
use trilink_report::ReportError;
use trilink_tables::config::{Compare, Tolerances, tolerance};
use trilink_tables::{StoreError, TrialStatus};

use judge::{StandardError, judge};

/// Reason why two runs cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("{}: {message}", path.display())]
    Baseline { path: PathBuf, message: String },
    #[error(transparent)]
    Report(#[from] ReportError),
    #[error(transparent)]
    Draw(#[from] DrawError),
    #[error("{file}: cannot be written: {message}")]
    File { file: &'static str, message: String },
}

/// Table cell that differs between the runs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    pub table: &'static str,
    /// Name of the row: the trial, or the campaign and the model.
    #[serde(rename = "of")]
    pub row: String,
    pub column: String,
    pub baseline: Json,
    #[serde(rename = "tonight")]
    pub candidate: Json,
    #[serde(flatten)]
    pub judgement: Judgement,
}

impl Difference {
    /// Returns whether the difference is out of tolerance.
    pub fn is_out(&self) -> bool {
        self.judgement.verdict == Verdict::Out
    }

    /// Returns the ratio of the difference to the largest difference within tolerance; infinite if no such limit
    /// exists.
    pub fn severity(&self) -> f64 {
        let numbers = self.candidate.as_f64().zip(self.baseline.as_f64());
        numbers.zip(self.judgement.limit).map_or(f64::INFINITY, |((candidate, baseline), limit)| {
            (candidate - baseline).abs() / limit
        })
    }
}

/// Identifier of a table row.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RowId {
    pub table: &'static str,
    /// Name of the row: the trial, or the campaign and the model.
    #[serde(rename = "of")]
    pub row: String,
}

/// Run times of a stage.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunTime {
    pub stage: String,
    pub baseline_s: f64,
    #[serde(rename = "tonight_s")]
    pub candidate_s: f64,
    /// Whether the candidate took longer by more than the tolerance of the configuration.
    #[serde(rename = "longer")]
    pub is_longer: bool,
}

/// Result of a comparison.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ComparisonResult {
    /// All differences: first those out of tolerance, then the others, each group in order of decreasing severity.
    pub differences: Vec<Difference>,
    /// Rows that only the candidate has.
    pub appeared: Vec<RowId>,
    /// Rows that only the baseline has.
    pub vanished: Vec<RowId>,
    /// Causes of the differences out of tolerance and of the vanished rows, the most informative first.
    pub causes: Vec<Cause>,
    pub run_times: Vec<RunTime>,
    /// Number of table cells that were compared.
    pub cells: usize,
    /// Rows that were compared, grouped by table.
    pub records: Vec<RowId>,
    run_time_fails: bool,
}

impl ComparisonResult {
    /// Returns the differences that are out of tolerance.
    pub fn out(&self) -> impl Iterator<Item = &Difference> {
        self.differences.iter().filter(|difference| difference.is_out())
    }

    /// Returns the number of differences with the given verdict.
    pub fn count(&self, verdict: Verdict) -> usize {
        self.differences.iter().filter(|difference| difference.judgement.verdict == verdict).count()
    }

    /// Returns the stages whose run times are out of tolerance.
    pub fn slow(&self) -> impl Iterator<Item = &RunTime> {
        self.run_times.iter().filter(|time| time.is_longer && self.run_time_fails)
    }

    /// Returns whether all values and run times are within tolerance and no row has vanished.
    pub fn passes(&self) -> bool {
        self.out().next().is_none() && self.vanished.is_empty() && self.slow().next().is_none()
    }
}

/// Suffixes of columns that hold the uncertainty of other columns and are not compared themselves.
const ERROR_SUFFIXES: [&str; 10] = [
    "_se",
    "_lo",
    "_hi",
    "_scatter",
    "_systematic",
    "_u_a",
    "_u_b",
    "_dof",
    "_coverage_factor",
    noise::BETWEEN,
];

/// Column with the objective of a fit.
const OBJECTIVE: &str = "j";
/// Column that says whether a model is adequate.
const ADEQUATE: &str = "adequate";

/// Text columns that are compared. The flag is true if a change is out of tolerance, and false if it is only listed.
const TEXT_COLUMNS: [(&str, bool); 9] = [
    ("status", true),
    ("free", true),
    ("verdict", true),
    ("measured", true),
    ("identifiable", false),
    ("practically_not", false),
    ("at_bound", false),
    (ADEQUATE, false),
    ("sharing", false),
];

/// Compares a candidate run with the baseline run.
pub fn compare(config: &Compare, baseline: &Snapshot, candidate: &Snapshot) -> ComparisonResult {
    let mut compared = ComparisonResult {
        run_times: run_times(config, baseline, candidate),
        run_time_fails: config.run_time_fails,
        ..ComparisonResult::default()
    };
    let trials = [baseline, candidate].map(|run| run.records("trials"));
    let [then, now] = &means::campaign_means(trials);
    for (table, tolerances) in config.tables() {
        let runs = if table == "campaigns" {
            [then, now]
        } else {
            [baseline.records(table), candidate.records(table)]
        };
        compared.compare_table(table, tolerances, runs);
    }
    compared.leave_inadequate_models_unjudged([baseline, candidate]);
    compared.differences.sort_by(|one, other| {
        let [is_one_out, is_other_out] =
            [one, other].map(|difference| difference.judgement.verdict == Verdict::Out);
        is_other_out.cmp(&is_one_out).then(other.severity().total_cmp(&one.severity()))
    });
    compared.causes = causes::find(&compared, [baseline, candidate]);
    compared
}

impl ComparisonResult {
    /// Takes back verdicts on models that are inadequate in either run, whose coefficients and predictions mean
    /// nothing. That an adequate model has become inadequate is out of tolerance if its objective is: near the limit of
    /// the misfit ratio, chance decides about adequacy.
    fn leave_inadequate_models_unjudged(&mut self, [baseline, candidate]: [&Snapshot; 2]) {
        let [then, now] = [baseline, candidate].map(|run| noise::inadequate(run.records("fits")));
        let risen: BTreeSet<String> = self
            .out()
            .filter(|difference| difference.table == "fits" && difference.column == OBJECTIVE)
            .map(|difference| difference.row.clone())
            .collect();
        for Difference { table, row, column, judgement, .. } in &mut self.differences {
            let Some(record) = candidate.records(table).get(row.as_str()) else { continue };
            let fit = noise::campaign_and_model(record);
            match column.as_str() {
                ADEQUATE if now.contains(&fit) && risen.contains(row.as_str()) => {
                    judgement.verdict = Verdict::Out;
                }
                // A model that has become inadequate is judged by its objective.
                OBJECTIVE if !then.contains(&fit) => {}
                _ if judgement.verdict == Verdict::Out
                    && (then.contains(&fit) || now.contains(&fit)) =>
                {
                    judgement.verdict = Verdict::NotJudged;
                }
                _ => {}
            }
        }
    }

    /// Adds the comparison of a table to the result.
    fn compare_table(
        &mut self,
        table: &'static str,
        tolerances: &Tolerances,
        [then, now]: [&Records; 2],
    ) {
        let row_id = |row: &String| RowId { table, row: row.clone() };
        // A table that one of the runs lacks is one entry, not one for each row.
        let all_rows = |rows: &Records| RowId { table, row: format!("all {} rows", rows.len()) };
        match (then.is_empty(), now.is_empty()) {
            (true, false) => return self.appeared.push(all_rows(now)),
            (false, true) => return self.vanished.push(all_rows(then)),
            _ => {}
        }
        self.vanished.extend(then.keys().filter(|row| !now.contains_key(*row)).map(row_id));
        self.appeared.extend(now.keys().filter(|row| !then.contains_key(*row)).map(row_id));
        for (row, baseline) in then {
            let Some(candidate) = now.get(row) else { continue };
            self.records.push(row_id(row));
            for (column, cell) in baseline {
                let Some(other) = candidate.get(column) else { continue };
                if ERROR_SUFFIXES.iter().any(|suffix| column.ends_with(suffix)) {
                    continue;
                }
                self.cells += 1;
                let judgement =
                    judge_values(tolerances, column, [baseline, candidate], [cell, other]);
                let Some(judgement) = judgement.filter(|of| of.verdict != Verdict::Same) else {
                    continue;
                };
                self.differences.push(Difference {
                    table,
                    row: row.clone(),
                    column: column.clone(),
                    baseline: cell.clone(),
                    candidate: other.clone(),
                    judgement,
                });
            }
        }
    }
}

/// Judges two values of a column; returns `None` if the column is not compared.
fn judge_values(
    tolerances: &Tolerances,
    column: &str,
    records: [&Record; 2],
    values: [&Json; 2],
) -> Option<Judgement> {
    if let Some((_, fails)) = TEXT_COLUMNS.iter().find(|(name, _)| *name == column) {
        let verdict = match values.map(Json::as_str) {
            [then, now] if then == now => Verdict::Same,
            [Some(then), Some(now)] => {
                let has_recovered = then == TrialStatus::Failed.name();
                let is_out = *fails && !has_recovered && !is_still_used(then, now);
                if is_out { Verdict::Out } else { Verdict::NotJudged }
            }
            [None, _] => Verdict::NotJudged,
            [Some(_), None] => Verdict::Out,
        };
        return Some(verdict.into());
    }
    let tolerance = tolerance(tolerances, column).filter(|tolerance| tolerance.judges())?;
    match values.map(Json::as_f64) {
        [Some(then), Some(now)] => {
            let error = StandardError::of_difference(column, records);
            let judgement = judge(tolerance, [then, now], error);
            let is_noise = column == OBJECTIVE && is_within_noise(records[1]);
            Some(match judgement.verdict {
                Verdict::Out if is_noise => Judgement { verdict: Verdict::Within, ..judgement },
                _ => judgement,
            })
        }
        [None, None] => Some(Verdict::Same.into()),
        [None, Some(_)] => Some(Verdict::NotJudged.into()),
        _ if tolerance.may_be_missing => Some(Verdict::NotJudged.into()),
        _ => Some(Verdict::Out.into()),
    }
}

/// Returns whether the objective of a fit is no higher than noise explains, however low it was in the baseline.
fn is_within_noise(fit: &Record) -> bool {
    let value = |column| snapshot::number(fit, column);
    value("lack_of_fit")
        .zip(value("lack_of_fit_limit"))
        .is_some_and(|(ratio, limit)| ratio <= limit)
}

/// Returns whether a trial is used (ok or flagged) both with its status in the baseline run, `then`, and with its
/// status in the candidate run, `now`.
fn is_still_used(then: &str, now: &str) -> bool {
    let used = [TrialStatus::Ok, TrialStatus::Flagged].map(TrialStatus::name);
    used.contains(&then) && used.contains(&now)
}

/// Compares the run times of the stages that both runs have.
fn run_times(config: &Compare, baseline: &Snapshot, candidate: &Snapshot) -> Vec<RunTime> {
    let times = baseline.stages.iter().filter_map(|(stage, &baseline_s)| {
        let candidate_s = *candidate.stages.get(stage)?;
        let is_longer = candidate_s > config.run_time_ratio * baseline_s
            && candidate_s - baseline_s > config.run_time_s;
        Some(RunTime { stage: stage.clone(), baseline_s, candidate_s, is_longer })
    });
    times.collect()
}

#[cfg(test)]
mod tests;
