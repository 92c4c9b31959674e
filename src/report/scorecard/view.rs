//! The scorecard as the page shows it.

use serde::Serialize;

use super::Entry;
use super::claims::Printed;
use super::verdict::Verdict;
use crate::report::numbers::{NONE, percent, significant};

/// The section of the page.
#[derive(Debug, Serialize)]
pub struct View<'e> {
    pub total: usize,
    pub reproduced: usize,
    pub differ: usize,
    pub not_testable: usize,
    /// Of those that are judged by the trials at hand.
    pub by_trials: usize,
    pub parts: Vec<Part<'e>>,
}

/// A part of the paper.
#[derive(Debug, Serialize)]
pub struct Part<'e> {
    name: &'e str,
    rows: Vec<Row<'e>>,
}

#[derive(Debug, Serialize)]
struct Row<'e> {
    id: &'e str,
    place: &'e str,
    claim: &'e str,
    quantity: &'e str,
    criterion: &'e str,
    unit: &'e str,
    printed: String,
    computed: String,
    measured: String,
    difference: String,
    verdict: &'static str,
    /// Class of the verdict's text.
    look: &'static str,
    remark: &'e str,
}

impl<'e> View<'e> {
    pub fn new(entries: &'e [Entry]) -> Self {
        let count = |verdict: Verdict| {
            entries.iter().filter(|entry| entry.verdict == verdict.name()).count()
        };
        let [reproduced, differ, not_testable] = Verdict::ALL.map(count);
        let by_trials = |entry: &&Entry| entry.judged_by == Some(super::Judged::Measured);
        let parts = entries.chunk_by(|a, b| a.part == b.part);
        Self {
            total: entries.len(),
            reproduced,
            differ,
            not_testable,
            by_trials: entries.iter().filter(by_trials).count(),
            parts: parts
                .map(|entries| Part {
                    name: &entries[0].part,
                    rows: entries.iter().map(Row::new).collect(),
                })
                .collect(),
        }
    }
}

impl<'e> Row<'e> {
    fn new(entry: &'e Entry) -> Self {
        let number = |value: Option<f64>| value.map_or(NONE.to_owned(), short);
        Self {
            id: &entry.id,
            place: &entry.place,
            claim: &entry.claim,
            quantity: &entry.quantity,
            criterion: entry.criterion.as_deref().unwrap_or_default(),
            unit: &entry.unit,
            printed: match &entry.printed {
                Some(Printed::Number(number)) => number.to_string(),
                Some(Printed::Text(text)) => text.clone(),
                None => String::new(),
            },
            computed: number(entry.computed),
            measured: number(entry.measured),
            difference: match entry.relative_difference {
                Some(difference) => percent(1.0 + difference, 1.0),
                None => String::new(),
            },
            verdict: entry.verdict,
            look: match entry.verdict {
                "reproduced" => "ok",
                "differs" => "flagged",
                _ => "soft",
            },
            remark: &entry.remark,
        }
    }
}

/// Four significant digits, and a power of ten for what is next to nothing.
fn short(value: f64) -> String {
    if value != 0.0 && value.abs() < 1e-4 { format!("{value:.0e}") } else { significant(value, 4) }
}
