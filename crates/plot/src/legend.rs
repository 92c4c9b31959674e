//! Legends: rows of samples above the panels. (The legend of plotters is a box that covers data.)

use super::figure::Layer;
use super::plotted::symbol;
use super::style::{self, SAMPLE};

pub(crate) const SAMPLE_GAP: f64 = 5.0;
const GAP: f64 = 14.0;
/// Excess over the room that rounding errors of sums of widths can cause, px.
const ROUNDING: f64 = 1e-6;
/// Height of a row in a legend, px.
pub(crate) const ROW: f64 = 19.0;

/// Legend key (sample of the line or marker) with its position in the legend.
pub(crate) struct Entry {
    pub sample: Layer,
    /// Full name of the layer; the name in `sample` may be shortened.
    pub name: String,
    /// Left end of the legend key, px.
    pub x: f64,
    pub row: usize,
}

fn width(sample: &Layer) -> f64 {
    SAMPLE + SAMPLE_GAP + style::text_width(&sample.name)
}

/// Returns the width (px) of the given legend keys, with their names, in a single row.
pub(crate) fn row_width(samples: &[Layer]) -> f64 {
    samples.iter().map(|sample| width(sample) + GAP).sum::<f64>() - GAP
}

/// Returns the height (px) of a legend.
pub(crate) fn height(entries: &[Entry]) -> f64 {
    entries.iter().map(|entry| entry.row + 1).max().map_or(0.0, |rows| rows as f64 * ROW)
}

/// Arranges legend keys and their names in columns between `left` and `right` (px), in as few rows as
/// possible.
pub(crate) fn lay_out(mut samples: Vec<Layer>, left: f64, right: f64) -> Vec<Entry> {
    let room = right - left;
    let names: Vec<String> = samples.iter().map(|sample| sample.name.clone()).collect();
    for sample in &mut samples {
        sample.name = shorten(&sample.name, room - SAMPLE - SAMPLE_GAP + ROUNDING);
    }
    let rows = (1..samples.len())
        .find(|rows| column_widths(&samples, *rows).iter().sum::<f64>() - GAP <= room + ROUNDING)
        .unwrap_or(samples.len())
        .max(1);
    let widths = column_widths(&samples, rows);
    let mut entries = Vec::new();
    for (i, (sample, name)) in samples.into_iter().zip(names).enumerate() {
        let x = left + widths[..i / rows].iter().sum::<f64>();
        entries.push(Entry { sample, name, x, row: i % rows });
    }
    entries
}

/// Returns the widths (px) of a legend's columns with `rows` rows each, including the gaps between the
/// columns.
fn column_widths(samples: &[Layer], rows: usize) -> Vec<f64> {
    let columns = samples.chunks(rows);
    columns.map(|column| column.iter().map(width).fold(0.0, f64::max) + GAP).collect()
}

/// Shortens the label of an axis so that it fits into `room` px: to its symbol and unit, if it has a symbol.
pub(crate) fn fit_label(label: &str, room: f64) -> String {
    let short = label.split_once(" (").and_then(|(words, unit)| {
        let symbol = symbol(words).filter(|_| style::text_width(label) > room)?;
        Some(format!("{symbol} ({unit}"))
    });
    shorten(short.as_deref().unwrap_or(label), room)
}

/// Shortens text with an ellipsis so that it fits into `room` px.
pub(crate) fn shorten(label: &str, room: f64) -> String {
    if style::text_width(label) <= room {
        return label.to_owned();
    }
    let cut_at = |end: usize| format!("{}…", &label[..end]);
    let ends: Vec<usize> = label.char_indices().map(|(end, _)| end).collect();
    let fitting = ends.partition_point(|end| style::text_width(&cut_at(*end)) <= room);
    cut_at(ends[..fitting].last().copied().unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_take_as_few_rows_as_possible() {
        let look = style::Look::Line {
            colour: style::INK,
            dash: style::SOLID,
            width_px: style::LINE_WIDTH,
        };
        let sample = |label: &str| Layer::new(label, [], look);
        let samples: Vec<Layer> = ["first", "second", "third"].map(sample).into();
        let width = row_width(&samples);
        let rows = |room: f64| {
            let entries = lay_out(samples.clone(), 0.0, room);
            entries.into_iter().map(|entry| entry.row).collect::<Vec<_>>()
        };
        assert_eq!(rows(width + 1.0), [0, 0, 0]);
        assert_eq!(rows(width - 20.0), [0, 1, 0]);
        assert_eq!(rows(60.0), [0, 1, 2]);
        assert!(lay_out(samples, 0.0, 60.0).iter().any(|entry| entry.sample.name.contains('…')));
    }

    #[test]
    fn the_label_of_a_narrow_axis_keeps_its_symbol_and_unit() {
        let label = "Actuation frequency ω (rad/s)";
        assert_eq!(fit_label(label, style::text_width(label)), label);
        assert_eq!(fit_label(label, 80.0), "ω (rad/s)");
        assert!(fit_label("Amplitude of joint 2 (deg)", 80.0).ends_with('…'));
    }

    #[test]
    fn a_single_name_is_complete_in_the_room_that_it_needs() {
        let look = style::Look::Line {
            colour: style::INK,
            dash: style::SOLID,
            width_px: style::LINE_WIDTH,
        };
        let samples = vec![Layer::new("φ₁", [], look)];
        let width = row_width(&samples);
        for tenths in 3000..5000 {
            let right = 0.1 * f64::from(tenths);
            let entries = lay_out(samples.clone(), right - width, right);
            assert_eq!(entries[0].sample.name, "φ₁", "{right}");
        }
    }

    #[test]
    fn a_long_name_is_shortened_to_what_fits() {
        let name = "a model's name ".repeat(10_000);
        let short = shorten(&name, 100.0);
        let kept = short.strip_suffix('…').expect("it is too long");
        let longer = format!("{}…", &name[..=kept.len()]);
        assert!(name.starts_with(kept) && style::text_width(&short) <= 100.0, "{short}");
        assert!(style::text_width(&longer) > 100.0, "{longer}");
        assert_eq!([shorten("é", 100.0), shorten("é", 1.0), shorten("", -1.0)], ["é", "…", "…"]);
    }
}
