//! Legends: rows of samples above panels. Plotters' own is a box that covers data.

use plotters::coord::{CoordTranslate, Shift};
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::element::{
    Circle, DashedPathElement, EmptyElement, ErrorBar, PathElement, Rectangle,
};
use plotters::prelude::SVGBackend;
use plotters::style::text_anchor::HPos;
use plotters::style::{Color, RGBColor, ShapeStyle};

use super::figure::Sample;
use super::style::{self, Dash, Look, Shape, units};

/// A part of the drawing, with coordinates in the backend's units from its upper left corner.
pub type Area<'b> = DrawingArea<SVGBackend<'b>, Shift>;
pub type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// Length of a line's sample, px.
const SAMPLE: f64 = 27.0;
const SAMPLE_GAP: f64 = 5.0;
const GAP: f64 = 14.0;
/// Height of a row, px.
pub const ROW: f64 = 19.0;

/// A sample and its position: the left end, px, and the row.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    pub sample: Sample,
    pub x: f64,
    pub row: usize,
}

fn width(sample: &Sample) -> f64 {
    SAMPLE + SAMPLE_GAP + style::text_width(&sample.label)
}

/// Width of all samples in a row, px.
pub fn row_width(samples: &[Sample]) -> f64 {
    samples.iter().map(|sample| width(sample) + GAP).sum::<f64>() - GAP
}

/// Samples in columns between `left` and `right`: as few rows as that allows.
pub fn lay_out(mut samples: Vec<Sample>, left: f64, right: f64) -> Vec<Entry> {
    let room = right - left;
    for sample in &mut samples {
        sample.label = shorten(&sample.label, room - SAMPLE - SAMPLE_GAP);
    }
    let widths = |rows: usize| -> Vec<f64> {
        let width = |column: &[Sample]| column.iter().map(width).fold(0.0, f64::max) + GAP;
        samples.chunks(rows).map(width).collect()
    };
    let fits = |rows: &usize| widths(*rows).iter().sum::<f64>() - GAP <= room + 1e-6;
    let rows = (1..samples.len()).find(fits).unwrap_or(samples.len()).max(1);
    let widths = widths(rows);
    let entry = |(nth, sample)| {
        let x = left + widths[..nth / rows].iter().sum::<f64>();
        Entry { sample, x, row: nth % rows }
    };
    samples.into_iter().enumerate().map(entry).collect()
}

/// The text, or as much of it as fits.
fn shorten(label: &str, room: f64) -> String {
    let (mut short, mut left) = (label.to_owned(), label.chars());
    while style::text_width(&short) > room && left.next_back().is_some() {
        short = format!("{}…", left.as_str());
    }
    short
}

/// Draws a sample and its text in a legend from the height `top` on.
pub fn draw(Entry { sample, x, row }: &Entry, top: f64, area: &Area<'_>) -> Drawn {
    let y = top + (*row as f64 + 0.5) * ROW;
    let at = (units(x + SAMPLE / 2.0), units(y));
    let bar = |half: f64| [at.1 - units(half), at.1, at.1 + units(half)];
    match sample.look {
        Look::Line { colour, dash } => {
            let line = vec![(units(*x), at.1), (units(x + SAMPLE), at.1)];
            draw_path(area, line, dash, style::stroke(colour, style::LINE_WIDTH))?;
        }
        Look::Marker { colour, shape, filled } => {
            if sample.has_bar {
                let [top, middle, bottom] = bar(7.0);
                let stroke = style::stroke(colour, style::FRAME_WIDTH);
                let ends = units(style::ERROR_BAR_ENDS) as u32;
                area.draw(&ErrorBar::new_vertical(at.0, top, middle, bottom, stroke, ends))?;
            }
            draw_marker(area, at, (colour, shape, filled))?;
        }
        Look::Spans(colour) => draw_marker(area, at, (colour, Shape::Square, true))?,
        _ => {}
    }
    let (x, y) = (x + SAMPLE + SAMPLE_GAP, y + 0.36 * style::EM - style::ASCENT);
    area.draw_text(&sample.label, &style::text_style(HPos::Left), (units(x), units(y)))
}

/// Draws a line.
pub fn draw_path<'b, T: CoordTranslate<From: Clone + 'static>>(
    area: &DrawingArea<SVGBackend<'b>, T>,
    points: Vec<T::From>,
    dash: Dash,
    stroke: ShapeStyle,
) -> Drawn {
    match dash {
        None => area.draw(&PathElement::new(points, stroke)),
        Some((dash, gap)) => {
            area.draw(&DashedPathElement::new(points, units(dash), units(gap), stroke))
        }
    }
}

/// Draws a marker; an open one hides what is under it, so that lines do not strike it through.
pub fn draw_marker<'b, T: CoordTranslate<From: Copy>>(
    area: &DrawingArea<SVGBackend<'b>, T>,
    at: T::From,
    (colour, shape, filled): (RGBColor, Shape, bool),
) -> Drawn {
    const WALL: f64 = 1.5;
    let core_colour = if filled { colour } else { style::PAPER };
    let [radius, core] = [style::MARKER_RADIUS, style::MARKER_RADIUS - WALL];
    for (radius, colour) in [(radius, colour), (core, core_colour)] {
        let (half, fill) = (units(0.92 * radius), colour.filled());
        match shape {
            Shape::Circle => area.draw(&Circle::new(at, units(radius), fill))?,
            Shape::Square => area.draw(
                &(EmptyElement::at(at) + Rectangle::new([(-half, -half), (half, half)], fill)),
            )?,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_take_as_few_rows_as_there_is_room_for() {
        let sample = |label: &str| Sample {
            label: label.to_owned(),
            look: style::Look::Line { colour: style::INK, dash: style::SOLID },
            has_bar: false,
        };
        let samples: Vec<Sample> = ["first", "second", "third"].map(sample).into();
        let width = row_width(&samples);
        let rows = |room: f64| {
            let entries = lay_out(samples.clone(), 0.0, room);
            entries.into_iter().map(|entry| entry.row).collect::<Vec<_>>()
        };
        assert_eq!(rows(width + 1.0), [0, 0, 0]);
        assert_eq!(rows(width - 20.0), [0, 1, 0]);
        assert_eq!(rows(60.0), [0, 1, 2]);
        assert!(lay_out(samples, 0.0, 60.0).iter().any(|entry| entry.sample.label.contains('…')));
    }
}
