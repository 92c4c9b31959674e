//! Legends: rows of samples above panels. Plotters' own is a box that covers data.

use super::figure::Layer;
use super::style::{self, SAMPLE};

pub(crate) const SAMPLE_GAP: f64 = 5.0;
const GAP: f64 = 14.0;
/// Height of a row, px.
pub(crate) const ROW: f64 = 19.0;

/// A sample and its position: the left end, px, and the row.
pub(crate) struct Entry {
    pub sample: Layer,
    /// As the layers have it; the sample's may be shorter.
    pub name: String,
    pub x: f64,
    pub row: usize,
}

fn width(sample: &Layer) -> f64 {
    SAMPLE + SAMPLE_GAP + style::text_width(&sample.name)
}

/// Width of all samples in a row, px.
pub(crate) fn row_width(samples: &[Layer]) -> f64 {
    samples.iter().map(|sample| width(sample) + GAP).sum::<f64>() - GAP
}

/// Layers in columns between `left` and `right`: as few rows as that allows.
pub(crate) fn lay_out(mut samples: Vec<Layer>, left: f64, right: f64) -> Vec<Entry> {
    let room = right - left;
    let names: Vec<String> = samples.iter().map(|sample| sample.name.clone()).collect();
    for sample in &mut samples {
        sample.name = shorten(&sample.name, room - SAMPLE - SAMPLE_GAP);
    }
    let widths = |rows: usize| -> Vec<f64> {
        let width = |column: &[Layer]| column.iter().map(width).fold(0.0, f64::max) + GAP;
        samples.chunks(rows).map(width).collect()
    };
    let fits = |rows: &usize| widths(*rows).iter().sum::<f64>() - GAP <= room + 1e-6;
    let rows = (1..samples.len()).find(fits).unwrap_or(samples.len()).max(1);
    let widths = widths(rows);
    let entry = |(nth, (sample, name))| {
        let x = left + widths[..nth / rows].iter().sum::<f64>();
        Entry { sample, name, x, row: nth % rows }
    };
    samples.into_iter().zip(names).enumerate().map(entry).collect()
}

/// The text, or as much of it as fits.
pub(crate) fn shorten(label: &str, room: f64) -> String {
    if style::text_width(label) <= room {
        return label.to_owned();
    }
    let cut = |end: usize| format!("{}…", &label[..end]);
    let ends: Vec<usize> = label.char_indices().map(|(end, _)| end).collect();
    let fitting = ends.partition_point(|end| style::text_width(&cut(*end)) <= room);
    cut(ends[..fitting].last().copied().unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_take_as_few_rows_as_there_is_room_for() {
        let look = style::Look::Line { colour: style::INK, dash: style::SOLID };
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
    fn as_much_of_a_name_is_shown_as_fits_however_long_it_is() {
        let name = "a model's name ".repeat(10_000);
        let short = shorten(&name, 100.0);
        let kept = short.strip_suffix('…').expect("it is too long");
        let longer = format!("{}…", &name[..=kept.len()]);
        assert!(name.starts_with(kept) && style::text_width(&short) <= 100.0, "{short}");
        assert!(style::text_width(&longer) > 100.0, "{longer}");
        assert_eq!([shorten("é", 100.0), shorten("é", 1.0), shorten("", -1.0)], ["é", "…", "…"]);
    }
}
