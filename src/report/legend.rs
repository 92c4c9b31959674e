//! Legends: rows of samples above the panels, where they cover no data.

use plotters::style::text_anchor::HPos;
use plotters_backend::DrawingBackend;

use super::canvas::{Canvas, Drawn, TextAt};
use super::font::Typeface;
use super::polyline;
use super::style::{self, Look};

/// Length of a line's sample, px.
const SAMPLE: f64 = 27.0;
pub const ROW: f64 = 19.0;
const SAMPLE_GAP: f64 = 5.0;
pub const ENTRY_GAP: f64 = 14.0;

/// What the legend says of one look.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    pub label: String,
    pub look: Look,
    /// Measurements have error bars, in the legend too.
    pub bar: bool,
}

/// A sample and its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    pub sample: Sample,
    pub x: f64,
    pub row: usize,
}

/// Width of a sample with its text, px.
pub fn width(sample: &Sample, font: Typeface) -> f64 {
    SAMPLE + SAMPLE_GAP + font.width_em(&sample.label) * style::SMALL_TEXT
}

/// Draws a sample from `x` on at the height `y`, and its text.
///
/// # Errors
/// The backend fails.
pub fn draw<B: DrawingBackend>(
    sample: &Sample,
    x: f64,
    y: f64,
    canvas: &mut Canvas<'_, B>,
) -> Drawn<B> {
    let (from, to) = (x, x + SAMPLE);
    let middle = (from + to) / 2.0;
    match sample.look {
        Look::Line { colour, dash } => {
            for dash in polyline::dashes(&[(from, y), (to, y)], dash) {
                canvas.line(&dash, colour, style::LINE_WIDTH)?;
            }
        }
        Look::Marker { colour, shape, filled } => {
            if sample.bar {
                canvas.error_bar(middle, y - 7.0, y + 7.0, colour)?;
            }
            canvas.marker((middle, y), colour, shape, filled)?;
        }
    }
    let (x, y, em) = (to + SAMPLE_GAP, y + 0.36 * style::SMALL_TEXT, style::SMALL_TEXT);
    canvas.text(&sample.label, TextAt { x, y, em, colour: style::INK, align: HPos::Left })
}

/// Samples, each once, in columns between `left` and `right`: as few rows as that allows.
pub fn lay_out(samples: Vec<Sample>, font: Typeface, left: f64, right: f64) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    let room = right - left - SAMPLE - SAMPLE_GAP;
    for mut sample in samples {
        sample.label = shorten(&sample.label, font, room / style::SMALL_TEXT);
        if !entries.iter().any(|entry| entry.sample == sample) {
            entries.push(Entry { sample, x: left, row: 0 });
        }
    }
    for rows in 1..=entries.len() {
        let columns = entries.chunks(rows);
        let widths: Vec<f64> = columns
            .map(|column| column.iter().map(|entry| width(&entry.sample, font)).fold(0.0, f64::max))
            .collect();
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
