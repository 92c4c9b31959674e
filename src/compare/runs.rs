//! Runs in a history: times, statuses and changes from one run to the next.

use std::collections::{BTreeMap, BTreeSet};

use chrono::{DateTime, Datelike as _, Utc};
use serde_json::{Value as Json, json};
use trilink_tables::{RunStatus, TrialStatus};

use super::history::{ACCEPTED, HistoryRow, SECONDS, TRIAL_ADDED, TRIAL_REMOVED, TRIALS};

/// Maximum number of trials that a message names.
const MAX_NAMED: usize = 3;
/// Number of digits of a hash that are shown on the history page.
const HASH_DIGITS: usize = 8;

/// All runs in a history.
pub(super) struct Runs<'r> {
    runs: BTreeMap<i64, Run<'r>>,
    /// Numbers of the runs that became the baseline.
    pub accepted: BTreeSet<i64>,
    /// Axis labels for the runs, by run number.
    labels: Vec<(f64, String)>,
}

/// Run in a history.
struct Run<'r> {
    first: &'r HistoryRow,
    added: Vec<&'r str>,
    removed: Vec<&'r str>,
    /// Numbers of trials by status, such as `12 ok`.
    trials: Vec<String>,
    seconds: f64,
}

impl<'r> Runs<'r> {
    pub(super) fn new(rows: &'r [HistoryRow]) -> Self {
        let mut runs: BTreeMap<i64, Run> = BTreeMap::new();
        let accepted = rows.iter().filter(|row| row.quantity == ACCEPTED).map(|row| row.run);
        for row in rows.iter().filter(|row| row.quantity != ACCEPTED) {
            let run = runs.entry(row.run).or_insert_with(|| Run {
                first: row,
                added: Vec::new(),
                removed: Vec::new(),
                trials: Vec::new(),
                seconds: 0.0,
            });
            match row.quantity.as_str() {
                TRIAL_ADDED => run.added.push(&row.note),
                TRIAL_REMOVED => run.removed.push(&row.note),
                quantity if quantity.ends_with(SECONDS) => run.seconds += row.value,
                quantity => {
                    let status = quantity.strip_prefix(TRIALS).filter(|_| row.campaign.is_empty());
                    let is_all = status == Some(TrialStatus::Ok.name());
                    if let Some(status) = status.filter(|_| is_all || row.value > 0.0) {
                        run.trials.push(format!("{} {status}", row.value));
                    }
                }
            }
        }
        let labels = labels(runs.values().map(|run| run.first));
        Self { accepted: accepted.collect(), labels, runs }
    }

    pub(super) fn count(&self) -> usize {
        self.runs.len()
    }

    pub(super) fn labels(&self) -> &[(f64, String)] {
        &self.labels
    }

    /// Returns the name of a run in figures and tables: its number and time, such as `run 3, 2026-11-12 02:15`.
    pub(super) fn name(&self, run: i64) -> String {
        let time = self.runs.get(&run).map_or("", |run| &run.first.time);
        format!("run {run}, {}", to_the_minute(time))
    }

    pub(super) fn date(&self, run: i64) -> &str {
        let time = self.runs.get(&run).map_or("", |run| &run.first.time);
        time.get(..10).unwrap_or(time)
    }

    /// Describes the changes to the program, configuration and trials since the previous run with figures of merit.
    pub(super) fn changes(&self, run: i64) -> String {
        let Some(run_now) = self.runs.get(&run) else { return String::new() };
        let now = run_now.first;
        let mut earlier = self.runs.range(..run).rev().map(|(_, run)| run.first);
        let Some(then) = earlier.find(|first| first.is_measured()) else { return String::new() };
        let mut changes = Vec::new();
        let differs = |a: &str, b: &str| !a.is_empty() && !b.is_empty() && a != b;
        if then.version != now.version {
            changes.push(format!("trilink {} replaced trilink {}", now.version, then.version));
        } else if differs(&then.program, &now.program) {
            changes.push("the program changed".to_owned());
        }
        if differs(&then.configuration, &now.configuration) {
            changes.push("the configuration changed".to_owned());
        }
        for (trials, verb) in [(&run_now.added, "added"), (&run_now.removed, "removed")] {
            let named = trials.iter().take(MAX_NAMED).copied().collect::<Vec<_>>().join(", ");
            let more = if trials.len() > MAX_NAMED { ", ..." } else { "" };
            let noun = if trials.len() == 1 { "trial" } else { "trials" };
            if !trials.is_empty() {
                changes.push(format!("{} {noun} {verb}: {named}{more}", trials.len()));
            }
        }
        if changes.is_empty() && differs(&then.input, &now.input) {
            changes.push("the marker files of the trials changed".to_owned());
        }
        if changes.is_empty() {
            let is_known = !then.program.is_empty() && !now.program.is_empty();
            let text = if is_known {
                "neither the program, the configuration nor the trials changed"
            } else {
                "the cause is unknown, because the history has no hash of the program"
            };
            changes.push(text.to_owned());
        }
        changes.join("; ")
    }

    /// Returns the rows for the table of runs on the history page, last run first.
    pub(super) fn rows(&self) -> Vec<Json> {
        let rows = self.runs.iter().rev().map(|(number, run)| {
            let Run { first, trials, seconds, .. } = run;
            let failure = Some(&first.note).filter(|_| first.quantity.is_empty());
            json!({
                "run": number,
                "name": self.name(*number),
                "date": self.date(*number),
                "status": first.status.map(RunStatus::name),
                "trials": trials.join(", "),
                "seconds": format!("{seconds:.1}"),
                "version": first.version,
                "program": first.program.get(..HASH_DIGITS).unwrap_or_default(),
                "configuration": first.configuration.get(..HASH_DIGITS).unwrap_or_default(),
                "changed": failure.map_or_else(|| self.changes(*number), Clone::clone),
                "accepted": self.accepted.contains(number),
            })
        });
        rows.collect()
    }
}

fn to_the_minute(time: &str) -> String {
    time.get(..16).unwrap_or(time).replace('T', " ")
}

/// Returns the axis labels for runs: the time if all runs are from the same day, the day if all are from the same year,
/// and otherwise the month.
fn labels<'r>(runs: impl Iterator<Item = &'r HistoryRow> + Clone) -> Vec<(f64, String)> {
    let time = |row: &HistoryRow| {
        DateTime::parse_from_rfc3339(&row.time).ok().map(|time| time.with_timezone(&Utc))
    };
    let times = runs.clone().filter_map(time);
    let first = times.clone().min();
    let format = match first.zip(times.max()) {
        Some((first, last)) if first < last && first.date_naive() == last.date_naive() => "%H:%M",
        Some((first, last)) if first.year() == last.year() => "%-d %b",
        _ => "%b %Y",
    };
    let labels = runs.map(|row| {
        let label =
            time(row).map_or_else(|| row.run.to_string(), |at| at.format(format).to_string());
        (row.run as f64, label)
    });
    labels.collect()
}
