//! Output of a comparison: HTML page, JUnit XML and JSON.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Value as Json, json};
use trilink_base::numbers::{percent, significant};
use trilink_report::{AcceptedBaseline, Changes, fill, image, notice_of_folders};
use trilink_tables::config::{Compare, Paths};
use trilink_tables::{Reader, StoreError};

use super::figures::figures;
use super::snapshot::{Acceptance, SCORECARD};
use super::{CompareError, ComparisonResult, Difference, RowId, RunTime, Snapshot, Verdict};

/// Renders the page `compare.html`, with a notice if the trials in `paths` are synthetic.
///
/// # Errors
/// Returns an error if a figure cannot be drawn or the template cannot be rendered.
pub fn page(
    compared: &ComparisonResult,
    baseline: &Snapshot,
    candidate: &Snapshot,
    paths: &Paths,
) -> Result<String, CompareError> {
    let synthetic = notice_of_folders(paths);
    let not_judged = compared
        .differences
        .iter()
        .filter(|difference| difference.judgement.verdict == Verdict::NotJudged);
    let causes = compared.causes.iter().map(|cause| {
        let differences = cause.differences.iter().map(|index| row(&compared.differences[*index]));
        json!({ "sentence": cause.sentence, "rows": differences.collect::<Vec<_>>() })
    });
    let mut figures = figures(compared, baseline, candidate);
    figures.iter_mut().for_each(|figure| figure.is_synthetic = !synthetic.is_empty());
    let figures = figures.iter().map(image).collect::<Result<Vec<_>, _>>()?;
    let page = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "synthetic": synthetic,
        "baseline_version": baseline.version,
        "passes": compared.passes(),
        "cells": compared.cells,
        "records": compared.records.len(),
        "within": compared.count(Verdict::Within),
        "not_judged": not_judged.map(row).collect::<Vec<_>>(),
        "out": compared.out().count(),
        "causes": causes.collect::<Vec<_>>(),
        "vanished": compared.vanished.iter().map(RowId::name).collect::<Vec<_>>(),
        "appeared": compared.appeared.iter().map(RowId::name).collect::<Vec<_>>(),
        "figures": figures,
        "run_times": compared.run_times.iter().map(run_time).collect::<Vec<_>>(),
        "accepted": baseline.accepted,
    });
    fill("compare.html", include_str!("compare.html"), &page)
        .map_err(|error| CompareError::File { file: "compare.html", message: error.to_string() })
}

impl RowId {
    /// Returns the name of the table, followed by the name of the row.
    pub fn name(&self) -> String {
        format!("{}: {}", self.table, self.row)
    }
}

/// Difference between the runs with all fields formatted as text; unknown fields are empty.
#[derive(Serialize)]
struct ChangedValue {
    table: String,
    /// Name of the table row.
    of: String,
    column: String,
    baseline: String,
    candidate: String,
    /// Relative change, in per cent.
    change: String,
    /// Difference as a multiple of its standard error.
    errors: String,
    /// Largest difference within tolerance.
    limit: String,
}

/// Formats a difference for human readers, with the relative change and the difference in standard errors.
fn row(difference: &Difference) -> ChangedValue {
    let Difference { table, row, column, baseline, candidate, judgement } = difference;
    let numbers = baseline.as_f64().zip(candidate.as_f64());
    ChangedValue {
        table: (*table).to_owned(),
        of: row.clone(),
        column: column.clone(),
        baseline: text(baseline),
        candidate: text(candidate),
        change: numbers.map(|(then, now)| percent(now, then)).unwrap_or_default(),
        errors: judgement.errors.map(|errors| format!("{errors:.1}")).unwrap_or_default(),
        limit: judgement.limit.map(|limit| significant(limit, 3)).unwrap_or_default(),
    }
}

fn text(value: &Json) -> String {
    match (value.as_f64(), value.as_str()) {
        (Some(number), _) => significant(number, 6),
        (_, Some(text)) => text.to_owned(),
        _ => "missing".to_owned(),
    }
}

fn run_time(time: &RunTime) -> [String; 4] {
    let RunTime { stage, baseline_s, candidate_s, is_longer } = time;
    let remark = if *is_longer { "longer" } else { "" };
    [stage.clone(), format!("{baseline_s:.2}"), format!("{candidate_s:.2}"), remark.to_owned()]
}

/// Maximum number of causes that the report names on its first screen.
const MAX_NAMED: usize = 3;

/// Returns the changes from the baseline for the first screen of the report; `None` if there is no baseline. The
/// scorecard and the run times are left out, because the report itself produces them; `trilink compare` includes them.
///
/// # Errors
/// Returns an error if a table cannot be read.
pub fn changes(
    config: &Compare,
    paths: &Paths,
    reader: &Reader,
) -> Result<Option<Changes>, StoreError> {
    let path = &paths.baseline;
    if !reader.0.contains_key(path) {
        return Ok(None);
    }
    let mut baseline = match Snapshot::parse(&reader.bytes(path)?) {
        Ok(baseline) => baseline,
        Err(problem) => {
            let problem = format!("{} {problem}", paths.name_of(path));
            return Ok(Some(Changes::NotCompared { problem }));
        }
    };
    baseline.tables.remove(SCORECARD);
    let candidate = Snapshot::from_tables(&paths.derived, reader)?;
    baseline.match_trials(&candidate);
    let compared = super::compare(config, &baseline, &candidate);
    // The rows of other tables follow from those of the trials and fits.
    let names = |rows: &[RowId]| -> Vec<String> {
        let named = rows.iter().filter(|row| ["trials", "fits"].contains(&row.table));
        named.map(RowId::name).collect()
    };
    let out = compared.count(Verdict::Out);
    let within = compared.count(Verdict::Within);
    let not_judged = compared.count(Verdict::NotJudged);
    let accepted = baseline.accepted.last().cloned();
    Ok(Some(Changes::Compared {
        accepted: accepted.map(|Acceptance { time, reason, .. }| AcceptedBaseline { time, reason }),
        out,
        within,
        not_judged,
        same: compared.cells - out - within - not_judged,
        causes: compared.causes.iter().take(MAX_NAMED).map(|of| of.sentence.clone()).collect(),
        more_causes: compared.causes.len().saturating_sub(MAX_NAMED),
        appeared: names(&compared.appeared),
    }))
}

/// Renders JUnit XML for continuous integration servers: a test suite for each table, a test case for each row.
///
/// # Errors
/// Returns an error if the template cannot be rendered.
pub fn junit(compared: &ComparisonResult) -> Result<String, CompareError> {
    let mut tables: BTreeMap<&str, BTreeMap<&str, Vec<String>>> = BTreeMap::new();
    let mut add = |table, row, failure: Option<String>| {
        tables.entry(table).or_default().entry(row).or_default().extend(failure);
    };
    compared.records.iter().for_each(|id| add(id.table, &id.row, None));
    for difference in compared.out() {
        add(difference.table, &difference.row, Some(difference.sentence()));
    }
    for RowId { table, row } in &compared.vanished {
        add(table, row, Some("vanished".to_owned()));
    }
    for time in &compared.run_times {
        let RunTime { stage, baseline_s, candidate_s, .. } = time;
        let is_slow = compared.slow().any(|slow| slow == time);
        let failure = is_slow.then(|| format!("{candidate_s:.2} s, baseline {baseline_s:.2} s"));
        add("run time", stage, failure);
    }
    let suites = tables.iter().map(|(name, cases)| {
        let failures = cases.values().filter(|failures| !failures.is_empty()).count();
        let cases: Vec<Json> = cases
            .iter()
            .map(|(name, failures)| json!({ "name": name, "failures": failures }))
            .collect();
        json!({ "name": name, "cases": cases, "failures": failures })
    });
    let suites: Vec<Json> = suites.collect();
    fill("junit.xml", include_str!("junit.xml"), &json!({ "suites": suites }))
        .map_err(|error| CompareError::File { file: "compare.xml", message: error.to_string() })
}

impl Difference {
    /// Describes the difference between the runs in words.
    pub fn sentence(&self) -> String {
        let ChangedValue { baseline, candidate, change, errors, limit, .. } = row(self);
        let mut details = Vec::new();
        if !change.is_empty() {
            details.push(change);
        }
        if !errors.is_empty() {
            details.push(format!("{errors} standard errors"));
        }
        if !limit.is_empty() {
            details.push(format!("limit {limit}"));
        }
        let details =
            if details.is_empty() { String::new() } else { format!(" ({})", details.join(", ")) };
        format!("{}: {candidate}, baseline {baseline}{details}", self.column)
    }
}

/// Converts a comparison to JSON.
pub fn to_json(compared: &ComparisonResult) -> Json {
    json!({
        "within_tolerance": compared.passes(),
        "cells": compared.cells,
        "causes": compared.causes,
        "differences": compared.differences,
        "appeared": compared.appeared,
        "vanished": compared.vanished,
        "run_times": compared.run_times,
    })
}
