//! What a layer shows, drawn between axes.

use std::collections::BTreeSet;

use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::element::{
    Circle, DashedPathElement, EmptyElement, ErrorBar, PathElement, Rectangle,
};
use plotters::prelude::SVGBackend;
use plotters::style::{Color, RGBColor, ShapeStyle};

use super::axis::{Axis, Range};
use super::figure::{Layer, Point};
use super::style::{self, Dash, Look, Shape, stroke, units};

/// A part of the drawing, with coordinates in the backend's units from its upper left corner.
pub type Area<'b> = DrawingArea<SVGBackend<'b>, Shift>;
pub type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;
type AreaOfAxes<'b> = DrawingArea<SVGBackend<'b>, Cartesian2d<Axis, Axis>>;

const LINK_WIDTH: f64 = 4.0;
const ARROW_HEAD: f64 = 9.0;
/// Of a marker that is not filled.
const MARKER_WALL: f64 = 1.5;
/// Of a bar, in units of the panel.
const SPAN_HEIGHT: f64 = 0.28;
/// Points of a layer that are all drawn, dashed if the line is; more have no room beside each other.
const MOST: usize = 4000;
/// What very many points are kept apart, px.
const APART_AMONG_MANY: f64 = 2.5;
/// Points of a curve nearer to each other than this cannot be told apart, px.
const APART: f64 = 0.3;

/// A part of the drawing with axes; lengths and positions are in their coordinates.
pub struct Frame<'b> {
    area: AreaOfAxes<'b>,
    pub x: Range,
    pub y: Range,
    /// Width and height of a pixel.
    pixel: (f64, f64),
}

impl<'b> Frame<'b> {
    pub fn new(area: AreaOfAxes<'b>, pixel: (f64, f64)) -> Self {
        let axes = area.as_coord_spec();
        let (x, y) = (axes.x_spec().range, axes.y_spec().range);
        Self { area, x, y, pixel }
    }

    /// With axes of pixels from the upper left corner.
    pub fn of_pixels(area: &Area<'b>) -> Self {
        let (across, down) = area.get_pixel_range();
        let axis = |units: &std::ops::Range<i32>| {
            Axis::linear(Range { low: 0.0, high: units.len() as f64 / style::UNITS_PER_PX })
        };
        let axes = Cartesian2d::new(axis(&across), axis(&down), (across, down));
        Self::new(area.apply_coord_spec(axes), (1.0, 1.0))
    }

    /// A position in the axes' coordinates.
    fn at(&self, point: &Point) -> (f64, f64) {
        let axes = self.area.as_coord_spec();
        (axes.x_spec().scaled(point.x), axes.y_spec().scaled(point.y))
    }

    pub fn draw(&self, layer: &Layer) -> Drawn {
        let points: Vec<(f64, f64)> = layer.points.iter().map(|point| self.at(point)).collect();
        let line = |colour| stroke(colour, style::LINE_WIDTH);
        // An open marker hides what is under it, so that lines do not strike it through.
        let marker = |colour, filled| {
            let core = if filled { colour } else { style::PAPER };
            [(style::MARKER_RADIUS, colour), (style::MARKER_RADIUS - MARKER_WALL, core)]
        };
        match layer.look {
            Look::Line { colour, dash } => self.curve(&points, dash, line(colour)),
            Look::Dots { colour, joined } => {
                if joined {
                    self.curve(&points, style::SOLID, line(colour))?;
                }
                self.discs(&points, Shape::Circle, &[(style::DOT_RADIUS, colour)])
            }
            Look::Marker { colour, shape, filled } => {
                let stroke = stroke(colour, style::FRAME_WIDTH);
                self.error_bars(&layer.points, stroke, style::ERROR_BAR_ENDS)?;
                self.discs(&points, shape, &marker(colour, filled))
            }
            Look::Rings => self.discs(&points, Shape::Circle, &marker(style::INK, false)),
            Look::Guides => points.into_iter().take(MOST).try_for_each(|(x, y)| {
                let (upright, level) =
                    ([(x, self.y.low), (x, self.y.high)], [(self.x.low, y), (self.x.high, y)]);
                let guide = if y.is_nan() { upright } else { level };
                self.curve(&guide, style::DASHES, stroke(style::INK, style::FRAME_WIDTH))
            }),
            Look::Bars(colour) => {
                self.error_bars(&layer.points, stroke(colour, style::BAR_WIDTH), 0.0)
            }
            Look::Band(colour) => {
                let side = |nth: usize| points.get(nth).map_or(f64::NAN, |(x, _)| *x);
                // What is not known is the panel's side.
                let (from, to) = (self.x.low.max(side(0)), self.x.high.min(side(1)));
                self.fill([(from, self.y.high), (to, self.y.low)], colour)
            }
            Look::Spans(colour) => points.chunks_exact(2).try_for_each(|ends| {
                let [(from, middle), (to, _)] = [ends[0], ends[1]];
                // What is short still has to be seen.
                let to = to.max(from + self.pixel.0);
                let half = 0.5 * SPAN_HEIGHT;
                self.fill([(from, middle + half), (to, middle - half)], colour)
            }),
            Look::Links => {
                let links = stroke(style::LINKS, LINK_WIDTH);
                self.path(self.shown(&points), style::SOLID, links)?;
                self.discs(&points, Shape::Circle, &[(LINK_WIDTH, style::LINKS)])
            }
            Look::Arrow => self.arrow(&points, line(style::INK)),
        }
    }

    pub fn path(&self, points: Vec<(f64, f64)>, dash: Dash, stroke: ShapeStyle) -> Drawn {
        match dash.map(|(dash, gap)| (units(dash), units(gap))) {
            None => self.area.draw(&PathElement::new(points, stroke)),
            Some((dash, gap)) => self.area.draw(&DashedPathElement::new(points, dash, gap, stroke)),
        }
    }

    fn curve(&self, points: &[(f64, f64)], dash: Dash, stroke: ShapeStyle) -> Drawn {
        let apart = (APART * self.pixel.0, APART * self.pixel.1);
        visible(points, self.y, apart).into_iter().try_for_each(|part| match part.len() > MOST {
            true => self.path(envelope(&part, MOST / 2).concat(), style::SOLID, stroke),
            false => self.path(part, dash, stroke),
        })
    }

    /// The points within the panel; of very many those that do not cover each other.
    fn shown(&self, points: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let mut taken = BTreeSet::new();
        let cell = |at: f64, pixel: f64| (at / (APART_AMONG_MANY * pixel)).round() as i64;
        let mut is_free = |(x, y)| {
            points.len() <= MOST || taken.insert((cell(x, self.pixel.0), cell(y, self.pixel.1)))
        };
        points.iter().copied().filter(|at| self.shows(*at) && is_free(*at)).collect()
    }

    fn shows(&self, (x, y): (f64, f64)) -> bool {
        x.is_finite() && self.y.contains(y)
    }

    /// Discs of these radii, px, over each other at every point.
    fn discs(&self, points: &[(f64, f64)], shape: Shape, discs: &[(f64, RGBColor)]) -> Drawn {
        let points = self.shown(points).into_iter();
        let mut each = points.flat_map(|at| discs.iter().map(move |disc| (at, disc)));
        each.try_for_each(|(at, (radius, colour))| {
            let (half, fill) = (units(0.92 * radius), colour.filled());
            let square = Rectangle::new([(-half, -half), (half, half)], fill);
            match shape {
                Shape::Circle => self.area.draw(&Circle::new(at, units(*radius), fill)),
                Shape::Square => self.area.draw(&(EmptyElement::at(at) + square)),
            }
        })
    }

    fn error_bars(&self, points: &[Point], stroke: ShapeStyle, ends_px: f64) -> Drawn {
        for point in points.iter().take(MOST).filter(|point| point.error > 0.0) {
            let (at, ends) = (self.at(point), units(ends_px) as u32);
            let end = |error| self.at(&Point { y: point.y + error, ..*point }).1;
            let (low, high) =
                (end(-point.error).max(self.y.low), end(point.error).min(self.y.high));
            if self.shows(at) {
                self.area.draw(&ErrorBar::new_vertical(at.0, low, at.1, high, stroke, ends))?;
            }
        }
        Ok(())
    }

    fn fill(&self, corners: [(f64, f64); 2], colour: RGBColor) -> Drawn {
        match corners.iter().all(|(x, y)| x.is_finite() && y.is_finite()) {
            true => self.area.draw(&Rectangle::new(corners, colour.filled())),
            false => Ok(()),
        }
    }

    /// An arrow, which plotters does not have, between two points of axes with equal units.
    fn arrow(&self, points: &[(f64, f64)], stroke: ShapeStyle) -> Drawn {
        let [from, to] = points else { return Ok(()) };
        let (along, up) = (to.0 - from.0, to.1 - from.1);
        let length = along.hypot(up);
        if length.is_nan() || length <= self.pixel.0 {
            return Ok(());
        }
        let part = ARROW_HEAD * self.pixel.0 / length;
        let (along, up) = (along * part, up * part);
        let head = |side: f64| (to.0 - along + side * 0.45 * up, to.1 - up - side * 0.45 * along);
        self.path(vec![*from, *to], style::SOLID, stroke)?;
        self.path(vec![head(1.0), *to, head(-1.0)], style::SOLID, stroke)
    }
}

/// The parts of a line with y in `range`, where plotters moves what lies outside onto the panel's
/// sides; points that are not numbers break it, too. Of points nearer to each other than `apart`
/// along both axes, which cannot be told apart, one is left.
fn visible(line: &[(f64, f64)], range: Range, apart: (f64, f64)) -> Vec<Vec<(f64, f64)>> {
    let runs = line.split(|(x, y)| !(x.is_finite() && y.is_finite()));
    runs.flat_map(|run| clip(&thin(run, apart), range)).collect()
}

/// The parts of a line within a range, with points where it enters and leaves them.
fn clip(line: &[(f64, f64)], range: Range) -> Vec<Vec<(f64, f64)>> {
    let mut cut = line.first().copied().into_iter().collect::<Vec<_>>();
    for pair in line.windows(2) {
        let [(x, y), to] = [pair[0], pair[1]];
        let bounds = if y < to.1 { [range.low, range.high] } else { [range.high, range.low] };
        let crossed = bounds.into_iter().filter(|bound| (y < *bound) != (to.1 < *bound));
        cut.extend(crossed.map(|bound| (x + (to.0 - x) * (bound - y) / (to.1 - y), bound)));
        cut.push(to);
    }
    let parts = cut.split(|(_, y)| !range.contains(*y));
    parts.filter(|part| part.len() > 1).map(<[(f64, f64)]>::to_vec).collect()
}

/// The points of the least and of the greatest value of each of so many parts of a line, in their
/// order; none where no value is known.
pub fn envelope(line: &[(f64, f64)], parts: usize) -> Vec<[(f64, f64); 2]> {
    let of_part = |part: &[(f64, f64)]| {
        let seen = || (0..part.len()).filter(|i| part[*i].1.is_finite());
        let by_value = |i: &usize, j: &usize| part[*i].1.total_cmp(&part[*j].1);
        let ends = seen().min_by(by_value).zip(seen().max_by(by_value));
        ends.map_or([(f64::NAN, f64::NAN); 2], |(i, j)| [part[i.min(j)], part[i.max(j)]])
    };
    line.chunks(line.len().div_ceil(parts).max(1)).map(of_part).collect()
}

/// The line without points that are near to the one before, but for its end.
fn thin(line: &[(f64, f64)], apart: (f64, f64)) -> Vec<(f64, f64)> {
    let mut thin = line.to_vec();
    thin.dedup_by(|b, a| ((b.0 - a.0) / apart.0).hypot((b.1 - a.1) / apart.1) < 1.0);
    let end = line.last().filter(|end| thin.last() != Some(end));
    thin.extend(end);
    thin
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: Range = Range { low: 0.0, high: 10.0 };

    #[test]
    fn a_line_that_leaves_the_panel_and_comes_back_is_cut_in_two() {
        let parts = clip(&[(0.0, 5.0), (10.0, -5.0), (20.0, 5.0)], RANGE);
        assert_eq!(parts, [[(0.0, 5.0), (5.0, 0.0)], [(15.0, 0.0), (20.0, 5.0)]]);
    }

    #[test]
    fn a_line_outside_the_panel_is_gone() {
        assert!(clip(&[(0.0, -5.0), (10.0, -1.0)], RANGE).is_empty());
        assert!(clip(&[(0.0, 15.0), (10.0, 15.0)], RANGE).is_empty());
    }

    #[test]
    fn a_gap_breaks_a_line_and_its_end_stays() {
        let line = [(0.0, 1.0), (0.1, 1.0), (5.0, 1.0), (f64::NAN, 1.0), (6.0, 1.0), (6.1, 1.0)];
        let parts = visible(&line, RANGE, (0.5, 0.5));
        assert_eq!(parts, [[(0.0, 1.0), (5.0, 1.0)], [(6.0, 1.0), (6.1, 1.0)]]);
    }
}
