//! The runs of a history: when, how they ended, and what changed from one to the next.

use std::collections::{BTreeMap, BTreeSet};

use chrono::{DateTime, Datelike as _, Utc};
use serde_json::{Value as Json, json};
use trilink_tables::{RunStatus, TrialStatus};

use super::history::{ACCEPTED, CAME, GONE, HistoryRow, SECONDS, TRIALS};

/// So many trials are named.
const NAMED: usize = 3;
/// Of a hash, on the page.
const DIGITS: usize = 8;

/// All runs.
pub(super) struct Runs<'r> {
    runs: BTreeMap<i64, Run<'r>>,
    /// Those that became the baseline.
    pub accepted: BTreeSet<i64>,
    /// What an axis calls them.
    labels: Vec<(f64, String)>,
}

/// One of them.
struct Run<'r> {
    first: &'r HistoryRow,
    came: Vec<&'r str>,
    gone: Vec<&'r str>,
    /// How many trials ended how.
    trials: Vec<String>,
    seconds: f64,
}

impl<'r> Runs<'r> {
    pub(super) fn new(rows: &'r [HistoryRow]) -> Self {
        let mut runs: BTreeMap<i64, Run> = BTreeMap::new();
        let accepted = rows.iter().filter(|row| row.quantity == ACCEPTED).map(|row| row.run);
        for row in rows.iter().filter(|row| row.quantity != ACCEPTED) {
            let new = || Run {
                first: row,
                came: Vec::new(),
                gone: Vec::new(),
                trials: Vec::new(),
                seconds: 0.0,
            };
            let run = runs.entry(row.run).or_insert_with(new);
            match row.quantity.as_str() {
                CAME => run.came.push(&row.note),
                GONE => run.gone.push(&row.note),
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

    /// Its number and time, as links name it.
    pub(super) fn name(&self, run: i64) -> String {
        let time = self.runs.get(&run).map_or("", |run| &run.first.time);
        format!("run {run}, {}", to_the_minute(time))
    }

    pub(super) fn date(&self, run: i64) -> &str {
        let time = self.runs.get(&run).map_or("", |run| &run.first.time);
        time.get(..10).unwrap_or(time)
    }

    /// What else changed from the run before that came to figures of merit.
    pub(super) fn changed(&self, run: i64) -> String {
        let Some(now) = self.runs.get(&run) else { return String::new() };
        let mut earlier = self.runs.range(..run).rev().map(|(_, run)| run);
        let Some(then) = earlier.find(|run| run.first.is_measured()) else { return String::new() };
        let (then, first) = (then.first, now.first);
        let mut said = Vec::new();
        let differs = |a: &str, b: &str| !a.is_empty() && !b.is_empty() && a != b;
        if then.version != first.version {
            said.push(format!("trilink {} in place of {}", first.version, then.version));
        } else if differs(&then.program, &first.program) {
            said.push("the program changed".to_owned());
        }
        if differs(&then.configuration, &first.configuration) {
            said.push("the configuration changed".to_owned());
        }
        for (trials, what) in [(&now.came, "came"), (&now.gone, "went")] {
            let named = trials.iter().take(NAMED).copied().collect::<Vec<_>>().join(", ");
            let more = if trials.len() > NAMED { ", ..." } else { "" };
            let noun = if trials.len() == 1 { "trial" } else { "trials" };
            if !trials.is_empty() {
                said.push(format!("{} {noun} {what}: {named}{more}", trials.len()));
            }
        }
        if said.is_empty() && differs(&then.input, &first.input) {
            said.push("files of the trials changed".to_owned());
        }
        if said.is_empty() {
            let is_known = !then.program.is_empty() && !first.program.is_empty();
            let nothing = "neither the program, the configuration nor the trials changed";
            said.push(if is_known { nothing } else { "what changed was not kept" }.to_owned());
        }
        said.join("; ")
    }

    /// A row of the page's table for each, the last one first.
    pub(super) fn rows(&self) -> Vec<Json> {
        let row = |(number, run): (&i64, &Run)| {
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
                "program": first.program.get(..DIGITS).unwrap_or_default(),
                "configuration": first.configuration.get(..DIGITS).unwrap_or_default(),
                "changed": failure.map_or_else(|| self.changed(*number), Clone::clone),
                "accepted": self.accepted.contains(number),
            })
        };
        self.runs.iter().rev().map(row).collect()
    }
}

fn to_the_minute(time: &str) -> String {
    time.get(..16).unwrap_or(time).replace('T', " ")
}

/// What an axis calls runs: by the time of a day, by the day, or by the month of several years.
fn labels<'r>(runs: impl Iterator<Item = &'r HistoryRow> + Clone) -> Vec<(f64, String)> {
    let time = |row: &HistoryRow| {
        DateTime::parse_from_rfc3339(&row.time).ok().map(|time| time.with_timezone(&Utc))
    };
    let times = runs.clone().filter_map(time);
    let (first, last) = (times.clone().min(), times.max());
    let span = first.zip(last).map(|(first, last)| {
        (first.year() == last.year(), first < last && first.date_naive() == last.date_naive())
    });
    let format = match span {
        Some((_, true)) => "%H:%M",
        Some((true, _)) => "%-d %b",
        _ => "%b %Y",
    };
    let label = |row: &HistoryRow| {
        let label =
            time(row).map_or_else(|| row.run.to_string(), |at| at.format(format).to_string());
        (row.run as f64, label)
    };
    runs.map(label).collect()
}
