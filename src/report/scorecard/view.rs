//! The scorecard as the page shows it.

use serde::Serialize;

use super::Entry;
use super::claims::Printed;
use super::verdict::Verdict;
use crate::report::numbers::{NONE, fixed, percent, significant};

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
    /// What the numbers are and when they count as reproduced; may be empty.
    test: String,
    unit: &'e str,
    printed: String,
    /// Whether that is several numbers.
    is_text: bool,
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
            test: test(entry),
            unit: &entry.unit,
            printed: match &entry.printed {
                Some(Printed::Number(number)) => number.to_string(),
                Some(Printed::Text(text)) => text.clone(),
                None => String::new(),
            },
            is_text: matches!(entry.printed, Some(Printed::Text(_))),
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

/// The quantity with its unit, where the printed number does not show it, and the criterion.
fn test(entry: &Entry) -> String {
    let unit = if entry.printed.is_none() { entry.unit.as_str() } else { "" };
    let quantity = [entry.quantity.as_str(), unit].into_iter().filter(|text| !text.is_empty());
    let quantity = quantity.collect::<Vec<_>>().join(", ");
    let criterion = entry.criterion.as_deref().unwrap_or_default();
    let parts = [quantity.as_str(), criterion].into_iter().filter(|text| !text.is_empty());
    let text = parts.collect::<Vec<_>>().join(": ");
    let mut letters = text.chars();
    match letters.next() {
        Some(first) => format!("{}{}.", first.to_uppercase(), letters.as_str()),
        None => text,
    }
}

/// Four significant digits, a whole number as such, and a power of ten for next to nothing.
fn short(value: f64) -> String {
    match value {
        _ if (value - value.round()).abs() < 1e-9 && value.round() != 0.0 => fixed(value, 0),
        _ if value != 0.0 && value.abs() < 1e-4 => format!("{value:.0e}"),
        _ => significant(value, 4),
    }
}
