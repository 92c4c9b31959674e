//! A candidate against the baseline: what differs by more than noise.
//!
//! Two runs of the same laboratory differ in every digit that noise reaches. Each column has a
//! tolerance, mostly in standard errors of both runs together; what is systematic and small shows
//! in the means over a campaign's trials before it shows in one of them.

mod figures;
mod files;
mod history;
mod judge;
mod means;
mod remember;
mod runs;
mod snapshot;
mod steps;
mod trend;

use std::collections::BTreeSet;
use std::path::PathBuf;

pub use files::{changes, junit, page, to_json};
pub use history::{HistoryRow, history_path};
pub use judge::{Judged, Verdict};
pub use remember::{is_drawn, note_acceptances, remember, remember_failure};
pub use snapshot::{Acceptance, Record, Records, Snapshot, tables_folder};

use serde::Serialize;
use serde_json::Value as Json;
use trilink_plot::DrawError;
use trilink_report::ReportError;
use trilink_tables::config::{Compare, Tolerances, tolerance};
use trilink_tables::{StoreError, TrialStatus};

use judge::{StandardError, judge};

/// Why runs cannot be compared.
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

/// One cell that differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    pub table: &'static str,
    /// The trial, or campaign and model.
    pub of: String,
    pub column: String,
    pub baseline: Json,
    #[serde(rename = "tonight")]
    pub candidate: Json,
    #[serde(flatten)]
    pub judged: Judged,
}

impl Difference {
    /// How many times the largest difference within it is; infinite where there is no such thing.
    pub fn severity(&self) -> f64 {
        let numbers = self.candidate.as_f64().zip(self.baseline.as_f64());
        let times = |((candidate, baseline), limit): ((f64, f64), f64)| {
            (candidate - baseline).abs() / limit
        };
        numbers.zip(self.judged.limit).map_or(f64::INFINITY, times)
    }
}

/// A record that only one of the runs has.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Lone {
    pub table: &'static str,
    pub of: String,
}

/// How long a stage took.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunTime {
    pub stage: String,
    pub baseline_s: f64,
    #[serde(rename = "tonight_s")]
    pub candidate_s: f64,
    /// Whether it took longer by more than the configuration takes for nothing.
    #[serde(rename = "longer")]
    pub is_longer: bool,
}

/// The outcome of a comparison.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Compared {
    /// All that is not the same; what is out of tolerance first, the worst at the front.
    pub differences: Vec<Difference>,
    pub appeared: Vec<Lone>,
    pub vanished: Vec<Lone>,
    pub run_times: Vec<RunTime>,
    /// Cells that were compared.
    pub cells: usize,
    /// Records that were compared, by table.
    pub records: Vec<Lone>,
    run_time_fails: bool,
}

impl Compared {
    /// Differences out of tolerance.
    pub fn out(&self) -> impl Iterator<Item = &Difference> {
        self.differences.iter().filter(|difference| difference.judged.verdict == Verdict::Out)
    }

    /// How many differences have a verdict.
    pub fn count(&self, verdict: Verdict) -> usize {
        self.differences.iter().filter(|difference| difference.judged.verdict == verdict).count()
    }

    /// Stages that are out of tolerance.
    pub fn slow(&self) -> impl Iterator<Item = &RunTime> {
        self.run_times.iter().filter(|time| time.is_longer && self.run_time_fails)
    }

    /// Whether nothing is out of tolerance and nothing has vanished.
    pub fn is_well(&self) -> bool {
        self.out().next().is_none() && self.vanished.is_empty() && self.slow().next().is_none()
    }
}

/// Ends of columns by which others are judged.
const OF_ERRORS: [&str; 5] = ["_se", "_lo", "_hi", "_scatter", "_systematic"];

/// Columns of text, and whether another text is out of tolerance or only named.
const TEXTS: [(&str, bool); 9] = [
    ("status", true),
    ("free", true),
    ("verdict", true),
    ("measured", true),
    ("identifiable", false),
    ("practically_not", false),
    ("at_bound", false),
    ("adequate", false),
    ("sharing", false),
];

/// Compares two runs.
pub fn compare(config: &Compare, baseline: &Snapshot, candidate: &Snapshot) -> Compared {
    let mut compared = Compared {
        run_times: run_times(config, baseline, candidate),
        run_time_fails: config.run_time_fails,
        ..Compared::default()
    };
    let trials = [baseline, candidate].map(|run| run.records("trials"));
    let [then, now] = &means::of_campaigns(trials);
    for (table, tolerances) in config.tables() {
        let runs = match table {
            "campaigns" => [then, now],
            _ => [baseline.records(table), candidate.records(table)],
        };
        compared.table(table, tolerances, runs);
    }
    let inadequate = models_that_fit_in_neither([baseline, candidate]);
    for difference in &mut compared.differences {
        let Difference { table, of, judged, .. } = difference;
        let record = candidate.records(table).get(of.as_str());
        if judged.verdict == Verdict::Out
            && record.is_some_and(|record| inadequate.contains(&campaign_and_model(record)))
        {
            judged.verdict = Verdict::NotJudged;
        }
    }
    compared.differences.sort_by(|one, other| {
        let rank = |difference: &Difference| difference.judged.verdict != Verdict::Out;
        rank(one).cmp(&rank(other)).then(other.severity().total_cmp(&one.severity()))
    });
    compared
}

/// Campaign and model of the fits that are inadequate in both runs: their coefficients describe
/// neither, and go from one optimum to another by chance.
fn models_that_fit_in_neither(runs: [&Snapshot; 2]) -> BTreeSet<[&str; 2]> {
    let [baseline, candidate] = runs.map(|run| {
        let fits = run.records("fits").values();
        let inadequate = fits.filter(|fit| snapshot::text(fit, "adequate") == "false");
        inadequate.map(campaign_and_model).collect::<BTreeSet<_>>()
    });
    baseline.intersection(&candidate).copied().collect()
}

/// What a fit or a prediction is of.
fn campaign_and_model(record: &Record) -> [&str; 2] {
    ["campaign", "model"].map(|column| snapshot::text(record, column))
}

impl Compared {
    fn table(&mut self, table: &'static str, tolerances: &Tolerances, [then, now]: [&Records; 2]) {
        let lone = |of: &String| Lone { table, of: of.clone() };
        // A table that one of the runs lacks is one line, not a line for each row.
        let all = |records: &Records| Lone { table, of: format!("all {} rows", records.len()) };
        match (then.is_empty(), now.is_empty()) {
            (true, false) => return self.appeared.push(all(now)),
            (false, true) => return self.vanished.push(all(then)),
            _ => {}
        }
        self.vanished.extend(then.keys().filter(|of| !now.contains_key(*of)).map(lone));
        self.appeared.extend(now.keys().filter(|of| !then.contains_key(*of)).map(lone));
        for (of, baseline) in then {
            let Some(candidate) = now.get(of) else { continue };
            self.records.push(lone(of));
            let judged_by = |column: &str| OF_ERRORS.iter().any(|end| column.ends_with(end));
            for (column, cell) in baseline.iter().filter(|(column, _)| !judged_by(column)) {
                let Some(other) = candidate.get(column) else { continue };
                self.cells += 1;
                let judged = judge_values(tolerances, column, [baseline, candidate], [cell, other]);
                self.differences.extend(judged.filter(|of| of.verdict != Verdict::Same).map(
                    |judged| Difference {
                        table,
                        of: of.clone(),
                        column: column.clone(),
                        baseline: cell.clone(),
                        candidate: other.clone(),
                        judged,
                    },
                ));
            }
        }
    }
}

/// `None` if the column is not compared.
fn judge_values(
    tolerances: &Tolerances,
    column: &str,
    records: [&Record; 2],
    values: [&Json; 2],
) -> Option<Judged> {
    let plain = |verdict| Some(Judged { verdict, limit: None, errors: None });
    if let [Json::String(then), Json::String(now)] = values {
        let (_, fails) = TEXTS.iter().find(|(name, _)| *name == column)?;
        let [then, now] = [then, now].map(|text| kind(text));
        return plain(match (then == now, *fails && !is_still_used(then, now)) {
            (true, _) => Verdict::Same,
            (_, true) => Verdict::Out,
            (_, false) => Verdict::NotJudged,
        });
    }
    let tolerance = tolerance(tolerances, column).filter(|tolerance| tolerance.judges())?;
    match values.map(Json::as_f64) {
        [Some(then), Some(now)] => {
            let error = StandardError::of_difference(column, records);
            Some(judge(tolerance, [then, now], error))
        }
        [None, None] => plain(Verdict::Same),
        _ if tolerance.may_be_missing => plain(Verdict::NotJudged),
        _ => plain(Verdict::Out),
    }
}

/// A status without the words that explain it.
fn kind(text: &str) -> &str {
    text.split_once(':').map_or(text, |(kind, _)| kind)
}

/// A trial that is flagged gives results as one that is ok does.
fn is_still_used(then: &str, now: &str) -> bool {
    let used = [TrialStatus::Ok, TrialStatus::Flagged].map(TrialStatus::name);
    used.contains(&then) && used.contains(&now)
}

fn run_times(config: &Compare, baseline: &Snapshot, candidate: &Snapshot) -> Vec<RunTime> {
    let stage = |(stage, baseline_s): (&String, &f64)| {
        let (baseline_s, candidate_s) = (*baseline_s, *candidate.stages.get(stage)?);
        let is_longer = candidate_s > config.run_time_ratio * baseline_s
            && candidate_s - baseline_s > config.run_time_s;
        Some(RunTime { stage: stage.clone(), baseline_s, candidate_s, is_longer })
    };
    baseline.stages.iter().filter_map(stage).collect()
}

#[cfg(test)]
mod tests;
