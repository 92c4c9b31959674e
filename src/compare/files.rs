//! A comparison as files: a page, JUnit's XML and JSON.

use std::collections::BTreeMap;

use serde_json::{Value as Json, json};
use trilink_base::numbers::{percent, significant};
use trilink_report::{AcceptedBaseline, ChangedValue, Changes, fill, image, notice_of_folders};
use trilink_tables::config::{Compare, Paths};
use trilink_tables::{Reader, StoreError};

use super::figures::figures;
use super::snapshot::{Acceptance, SCORECARD};
use super::{CompareError, Compared, Difference, Lone, RunTime, Snapshot, Verdict};

/// `compare.html`. Of `paths` it says whether their trials are synthetic.
///
/// # Errors
/// A figure cannot be drawn or the template not filled in.
pub fn page(
    compared: &Compared,
    baseline: &Snapshot,
    candidate: &Snapshot,
    paths: &Paths,
) -> Result<String, CompareError> {
    let synthetic = notice_of_folders(paths);
    let not_judged = compared.differences.iter().filter(|d| d.judged.verdict == Verdict::NotJudged);
    let mut figures = figures(compared, baseline, candidate);
    figures.iter_mut().for_each(|figure| figure.is_synthetic = !synthetic.is_empty());
    let figures = figures.iter().map(image).collect::<Result<Vec<_>, _>>()?;
    let page = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "synthetic": synthetic,
        "baseline_version": baseline.version,
        "is_well": compared.is_well(),
        "cells": compared.cells,
        "records": compared.records.len(),
        "within": compared.count(Verdict::Within),
        "not_judged": not_judged.map(row).collect::<Vec<_>>(),
        "out": compared.out().map(row).collect::<Vec<_>>(),
        "vanished": compared.vanished.iter().map(Lone::name).collect::<Vec<_>>(),
        "appeared": compared.appeared.iter().map(Lone::name).collect::<Vec<_>>(),
        "figures": figures,
        "run_times": compared.run_times.iter().map(run_time).collect::<Vec<_>>(),
        "accepted": baseline.accepted,
    });
    fill("compare.html", include_str!("compare.html"), &page)
        .map_err(|error| CompareError::File { file: "compare.html", message: error.to_string() })
}

impl Lone {
    /// Its table and what names it there.
    pub fn name(&self) -> String {
        format!("{}: {}", self.table, self.of)
    }
}

/// A difference as people read it; its change is relative, its errors are standard errors.
fn row(difference: &Difference) -> ChangedValue {
    let Difference { table, of, column, baseline, candidate, judged } = difference;
    let numbers = baseline.as_f64().zip(candidate.as_f64());
    ChangedValue {
        table: (*table).to_owned(),
        of: of.clone(),
        column: column.clone(),
        baseline: text(baseline),
        candidate: text(candidate),
        change: numbers.map(|(then, now)| percent(now, then)).unwrap_or_default(),
        errors: judged.errors.map(|errors| format!("{errors:.1}")).unwrap_or_default(),
        limit: judged.limit.map(|limit| significant(limit, 3)).unwrap_or_default(),
    }
}

fn text(value: &Json) -> String {
    match (value.as_f64(), value.as_str()) {
        (Some(number), _) => significant(number, 6),
        (_, Some(text)) => super::kind(text).to_owned(),
        _ => "missing".to_owned(),
    }
}

fn run_time(time: &RunTime) -> [String; 4] {
    let RunTime { stage, baseline_s, candidate_s, is_longer } = time;
    let remark = if *is_longer { "longer" } else { "" };
    [stage.clone(), format!("{baseline_s:.2}"), format!("{candidate_s:.2}"), remark.to_owned()]
}

/// Differences that the report's first screen names.
const NAMED: usize = 3;

/// What the report says on its first screen of the tables that it is made of against the baseline;
/// `None` if there is none. What the report makes itself, the scorecard and its run time, is
/// compared by `trilink compare` alone.
///
/// # Errors
/// A table cannot be read.
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
    let candidate = Snapshot::of_tables(&paths.derived, reader)?;
    let compared = super::compare(config, &baseline, &candidate);
    // Other tables follow from these.
    let names = |lone: &[Lone]| -> Vec<String> {
        let of_table = lone.iter().filter(|lone| ["trials", "fits"].contains(&lone.table));
        of_table.map(Lone::name).collect()
    };
    let [out, within, not_judged] =
        [Verdict::Out, Verdict::Within, Verdict::NotJudged].map(|verdict| compared.count(verdict));
    let accepted = |Acceptance { time, reason, .. }: &Acceptance| AcceptedBaseline {
        time: time.clone(),
        reason: reason.clone(),
    };
    Ok(Some(Changes::Compared {
        accepted: baseline.accepted.last().map(accepted),
        out,
        within,
        not_judged,
        same: compared.cells - out - within - not_judged,
        largest: compared.out().take(NAMED).map(row).collect(),
        vanished: names(&compared.vanished),
        appeared: names(&compared.appeared),
    }))
}

/// JUnit's XML, by which servers that build software show what failed: a suite for each table, a
/// case for each of its rows.
///
/// # Errors
/// The template cannot be filled in.
pub fn junit(compared: &Compared) -> Result<String, CompareError> {
    let mut tables: BTreeMap<&str, BTreeMap<&str, Vec<String>>> = BTreeMap::new();
    let mut add = |table, of, failure: Option<String>| {
        tables.entry(table).or_default().entry(of).or_default().extend(failure);
    };
    compared.records.iter().for_each(|lone| add(lone.table, &lone.of, None));
    for difference in compared.out() {
        add(difference.table, &difference.of, Some(difference.sentence()));
    }
    for Lone { table, of } in &compared.vanished {
        add(table, of, Some("vanished".to_owned()));
    }
    for time in &compared.run_times {
        let RunTime { stage, baseline_s, candidate_s, .. } = time;
        let sentence = || format!("{candidate_s:.2} s, baseline {baseline_s:.2} s");
        add("run time", stage, compared.slow().any(|slow| slow == time).then(sentence));
    }
    let case =
        |(name, failures): (&&str, &Vec<String>)| json!({ "name": name, "failures": failures });
    let suite = |(name, cases): (&str, BTreeMap<&str, Vec<String>>)| {
        let failures = cases.values().filter(|failures| !failures.is_empty()).count();
        let cases: Vec<Json> = cases.iter().map(case).collect();
        json!({ "name": name, "cases": cases, "failures": failures })
    };
    let suites: Vec<Json> = tables.into_iter().map(suite).collect();
    fill("junit.xml", include_str!("junit.xml"), &json!({ "suites": suites }))
        .map_err(|error| CompareError::File { file: "compare.xml", message: error.to_string() })
}

impl Difference {
    /// The difference in words.
    pub fn sentence(&self) -> String {
        let row = row(self);
        let parts = [
            ("", &row.change, ""),
            ("", &row.errors, " standard errors"),
            ("limit ", &row.limit, ""),
        ];
        let part = |(before, text, after): (&str, &String, &str)| {
            (!text.is_empty()).then(|| format!("{before}{text}{after}"))
        };
        let parts: Vec<String> = parts.into_iter().filter_map(part).collect();
        let parts = match parts.is_empty() {
            true => String::new(),
            false => format!(" ({})", parts.join(", ")),
        };
        let [baseline, candidate] = [&self.baseline, &self.candidate].map(text);
        format!("{}: {candidate}, baseline {baseline}{parts}", self.column)
    }
}

/// The comparison for other programs.
pub fn to_json(compared: &Compared) -> Json {
    json!({
        "within_tolerance": compared.is_well(),
        "cells": compared.cells,
        "differences": compared.differences,
        "appeared": compared.appeared,
        "vanished": compared.vanished,
        "run_times": compared.run_times,
    })
}
