//! Legends: rows of samples above the panels, where they cover no data.

use super::figure::Figure;
use super::font::Typeface;
use super::series::Kind;
use super::style::{self, Look};

/// Length of a line's sample, px.
pub const SAMPLE: f64 = 27.0;
pub const ROW: f64 = 19.0;
const SAMPLE_GAP: f64 = 5.0;
const ENTRY_GAP: f64 = 14.0;

/// A sample with its text.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    pub label: String,
    pub look: Look,
    /// Measurements have error bars, in the legend too.
    pub bar: bool,
    pub x: f64,
    pub row: usize,
}

impl Entry {
    pub fn text_x(&self) -> f64 {
        self.x + SAMPLE + SAMPLE_GAP
    }
}

/// Entries of all panels' series, each once, in columns between `left` and `right`: as few
/// rows as that allows.
pub fn lay_out(figure: &Figure, font: Typeface, left: f64, right: f64) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    for series in figure.panels.iter().flat_map(|panel| &panel.series) {
        let known = |entry: &Entry| entry.look == series.look && entry.label == series.label;
        if !entries.iter().any(known) {
            let room = right - left - SAMPLE - SAMPLE_GAP;
            let label = shorten(&series.label, font, room / style::SMALL_TEXT);
            let bar = series.kind == Kind::Measured;
            entries.push(Entry { label, look: series.look, bar, x: left, row: 0 });
        }
    }
    let width =
        |entry: &Entry| SAMPLE + SAMPLE_GAP + font.width_em(&entry.label) * style::SMALL_TEXT;
    for rows in 1..=entries.len() {
        let columns = entries.chunks(rows);
        let widths: Vec<f64> =
            columns.map(|column| column.iter().map(width).fold(0.0, f64::max)).collect();
        let total = widths.iter().sum::<f64>() + ENTRY_GAP * (widths.len() - 1) as f64;
        if total > right - left && rows < entries.len() {
            continue;
        }
        let mut x = left;
        for (column, width) in entries.chunks_mut(rows).zip(widths) {
            for (row, entry) in column.iter_mut().enumerate() {
                (entry.x, entry.row) = (x, row);
            }
            x += width + ENTRY_GAP;
        }
        break;
    }
    entries
}

/// The text, or as much of it as fits.
fn shorten(text: &str, font: Typeface, width_em: f64) -> String {
    if font.width_em(text) <= width_em {
        return text.to_owned();
    }
    let mut short: String = text.to_owned();
    while short.pop().is_some() && font.width_em(&format!("{short}…")) > width_em {}
    short + "…"
}
