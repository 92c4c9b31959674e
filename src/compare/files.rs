//! A comparison as files: a page, JUnit's XML and JSON.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Value as Json, json};

use super::figures::figures;
use super::{Cell, CompareError, Compared, Difference, Lone, RunTime, Snapshot, Verdict};
use crate::report::{Image, fill, percent, significant};

/// A difference as people read it.
#[derive(Serialize)]
struct Row {
    table: &'static str,
    of: String,
    column: String,
    baseline: String,
    tonight: String,
    /// Relative, or empty.
    change: String,
    /// In standard errors, or empty.
    errors: String,
    limit: String,
}

#[derive(Serialize)]
struct Page<'p> {
    version: &'static str,
    baseline_version: &'p str,
    is_well: bool,
    cells: usize,
    records: usize,
    within: usize,
    not_judged: Vec<Row>,
    out: Vec<Row>,
    vanished: Vec<String>,
    appeared: Vec<String>,
    figures: Vec<Image>,
    run_times: Vec<[String; 4]>,
    accepted: &'p [super::Acceptance],
}

/// `compare.html`.
///
/// # Errors
/// A figure cannot be drawn or the template not filled in.
pub fn page(
    compared: &Compared,
    baseline: &Snapshot,
    tonight: &Snapshot,
) -> Result<String, CompareError> {
    let not_judged = compared.differences.iter().filter(|d| d.verdict == Verdict::NotJudged);
    let figures = figures(compared, baseline, tonight);
    let figures = figures.iter().map(Image::draw).collect::<Result<_, _>>()?;
    let page = Page {
        version: env!("CARGO_PKG_VERSION"),
        baseline_version: &baseline.version,
        is_well: compared.is_well(),
        cells: compared.cells,
        records: compared.records.len(),
        within: compared.count(Verdict::Within),
        not_judged: not_judged.map(row).collect(),
        out: compared.out().map(row).collect(),
        vanished: compared.vanished.iter().map(Lone::name).collect(),
        appeared: compared.appeared.iter().map(Lone::name).collect(),
        figures,
        run_times: compared.run_times.iter().map(run_time).collect(),
        accepted: &baseline.accepted,
    };
    fill("compare.html", include_str!("compare.html"), &page)
        .map_err(|error| CompareError::File { file: "compare.html", message: error.to_string() })
}

impl Lone {
    /// Its table and what names it there.
    pub fn name(&self) -> String {
        format!("{}: {}", self.table, self.of)
    }
}

fn row(difference: &Difference) -> Row {
    let numbers = difference.baseline.number().zip(difference.tonight.number());
    Row {
        table: difference.table,
        of: difference.of.clone(),
        column: difference.column.clone(),
        baseline: text(&difference.baseline),
        tonight: text(&difference.tonight),
        change: numbers.map_or(String::new(), |(then, now)| percent(now, then)),
        errors: difference.errors.map_or(String::new(), |errors| format!("{errors:.1}")),
        limit: difference.limit.map_or(String::new(), |limit| significant(limit, 3)),
    }
}

fn text(cell: &Cell) -> String {
    match cell {
        Cell::Number(number) => significant(*number, 6),
        Cell::Text(text) => super::kind(text).to_owned(),
        Cell::Missing(()) => "missing".to_owned(),
    }
}

fn run_time(time: &RunTime) -> [String; 4] {
    let RunTime { stage, baseline_s, tonight_s, is_longer } = time;
    let remark = if *is_longer { "longer" } else { "" };
    [stage.clone(), format!("{baseline_s:.2}"), format!("{tonight_s:.2}"), remark.to_owned()]
}

#[derive(Serialize)]
struct Suite<'c> {
    name: &'c str,
    cases: Vec<Case<'c>>,
    failures: usize,
}

#[derive(Serialize)]
struct Case<'c> {
    name: &'c str,
    failures: Vec<String>,
}

/// JUnit's XML, by which servers that build software show what failed: a suite for each table, a
/// case for each of its rows.
///
/// # Errors
/// The template cannot be filled in.
pub fn junit(compared: &Compared) -> Result<String, CompareError> {
    let mut tables: BTreeMap<&str, BTreeMap<&str, Vec<String>>> = BTreeMap::new();
    for Lone { table, of } in &compared.records {
        tables.entry(table).or_default().entry(of).or_default();
    }
    let mut fail = |table, of, sentence| {
        tables.entry(table).or_default().entry(of).or_default().push(sentence);
    };
    for difference in compared.out() {
        fail(difference.table, &difference.of, difference.sentence());
    }
    for Lone { table, of } in &compared.vanished {
        fail(table, of, "vanished".to_owned());
    }
    for time in &compared.run_times {
        let RunTime { stage, baseline_s, tonight_s, .. } = time;
        let is_slow = compared.slow().any(|slow| slow == time);
        let sentence = format!("{tonight_s:.2} s, baseline {baseline_s:.2} s");
        let failures = tables.entry("run time").or_default().entry(stage).or_default();
        failures.extend(is_slow.then_some(sentence));
    }
    let suite = |(name, cases): (_, BTreeMap<_, Vec<String>>)| Suite {
        name,
        failures: cases.values().filter(|failures| !failures.is_empty()).count(),
        cases: cases.into_iter().map(|(name, failures)| Case { name, failures }).collect(),
    };
    let suites: Vec<Suite> = tables.into_iter().map(suite).collect();
    fill("junit.xml", include_str!("junit.xml"), &json!({ "suites": suites }))
        .map_err(|error| CompareError::File { file: "compare.xml", message: error.to_string() })
}

impl Difference {
    /// The difference in words.
    pub fn sentence(&self) -> String {
        let row = row(self);
        let parts =
            [("", row.change, ""), ("", row.errors, " standard errors"), ("limit ", row.limit, "")];
        let parts: Vec<String> = parts
            .into_iter()
            .filter(|(_, text, _)| !text.is_empty())
            .map(|(before, text, after)| format!("{before}{text}{after}"))
            .collect();
        let parts =
            if parts.is_empty() { String::new() } else { format!(" ({})", parts.join(", ")) };
        format!("{}: {}, baseline {}{parts}", self.column, row.tonight, row.baseline)
    }
}

/// The comparison for other programs.
pub fn to_json(compared: &Compared) -> Json {
    let cell = |cell: &Cell| serde_json::to_value(cell).unwrap_or_default();
    let difference = |difference: &Difference| {
        json!({
            "table": difference.table,
            "of": difference.of,
            "column": difference.column,
            "baseline": cell(&difference.baseline),
            "tonight": cell(&difference.tonight),
            "verdict": difference.verdict,
            "limit": difference.limit,
            "standard_errors": difference.errors,
        })
    };
    let lone = |lone: &Lone| json!({ "table": lone.table, "of": lone.of });
    let time = |time: &RunTime| {
        json!({
            "stage": time.stage,
            "baseline_s": time.baseline_s,
            "tonight_s": time.tonight_s,
            "longer": time.is_longer,
        })
    };
    json!({
        "within_tolerance": compared.is_well(),
        "cells": compared.cells,
        "differences": compared.differences.iter().map(difference).collect::<Vec<_>>(),
        "appeared": compared.appeared.iter().map(lone).collect::<Vec<_>>(),
        "vanished": compared.vanished.iter().map(lone).collect::<Vec<_>>(),
        "run_times": compared.run_times.iter().map(time).collect::<Vec<_>>(),
    })
}
