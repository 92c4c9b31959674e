//! What a layer shows, drawn between axes.

use std::collections::BTreeSet;

use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::element::{Circle, DashedPathElement, EmptyElement, PathElement, Polygon, Rectangle};
use plotters::style::{Color, RGBColor, ShapeStyle};

use super::axis::{Axis, Range};
use super::figure::{Layer, Point};
use super::style::{self, Dash, Look, Shape, stroke, units};
use crate::polyline::{envelope, visible};
use crate::svg::{Markup, Svg, escaped};

/// A part of the drawing, with coordinates in the backend's units from its upper left corner.
pub(crate) type Area<'b> = DrawingArea<Svg<'b>, Shift>;
pub(crate) type Drawn = Result<(), DrawingAreaErrorKind<std::convert::Infallible>>;
type AreaOfAxes<'b> = DrawingArea<Svg<'b>, Cartesian2d<Axis, Axis>>;

const LINK_WIDTH: f64 = 4.0;
const ARROW_HEAD: f64 = 9.0;
/// Of a marker that is not filled.
const MARKER_WALL: f64 = 1.5;
/// Of a bar, in units of the panel.
const SPAN_HEIGHT: f64 = 0.28;
/// Points of a line that are all drawn, dashed if the line is; more have no room beside each other.
const MOST: usize = 4000;
/// Markers of a layer that are all drawn.
const MOST_POINTS: usize = 200;
/// What very many points are kept apart, px.
const APART_AMONG_MANY: f64 = 2.5;
/// What a line's band covers of what is behind it.
const BAND_OPACITY: f64 = 0.2;
/// Places along a line at which a page knows its band.
const BAND_PLACES: usize = 60;
/// Points of a curve nearer to each other than this cannot be told apart, px.
const APART: f64 = 0.3;

/// A part of the drawing with axes; lengths and positions are in their coordinates.
pub(crate) struct Frame<'b> {
    area: AreaOfAxes<'b>,
    pub x: Range,
    pub y: Range,
    /// Width and height of a pixel.
    pixel: (f64, f64),
}

impl<'b> Frame<'b> {
    pub(crate) fn new(area: AreaOfAxes<'b>, pixel: (f64, f64)) -> Self {
        let axes = area.as_coord_spec();
        let (x, y) = (axes.x_spec().range, axes.y_spec().range);
        Self { area, x, y, pixel }
    }

    /// With axes of pixels from the upper left corner.
    pub(crate) fn of_pixels(area: &Area<'b>) -> Self {
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

    /// Draws a line's band, as a group of its name.
    pub(crate) fn draw_band(&self, layer: &Layer) -> Drawn {
        let Look::Line { colour, .. } = layer.look else { return Ok(()) };
        if layer.band.is_empty() {
            return Ok(());
        }
        let limit = |point: &Point, y: f64| match self.at(&Point { y, ..*point }) {
            (x, y) if y < self.y.low => (x, self.y.low),
            (x, y) if y > self.y.high => (x, self.y.high),
            at => at,
        };
        let both = layer.points.iter().zip(&layer.band);
        let sides: Vec<[(f64, f64); 2]> =
            both.map(|(point, band)| band.map(|y| limit(point, y))).collect();
        self.area.draw(&Markup(format!("<g data-name=\"{}\">\n", escaped(&layer.name))))?;
        let is_known = |sides: &[(f64, f64); 2]| sides.iter().all(|(x, y)| (x + y).is_finite());
        for part in sides.split(|sides| !is_known(sides)).filter(|part| part.len() > 1) {
            let (below, above) = (part.iter().map(|of| of[0]), part.iter().rev().map(|of| of[1]));
            let around: Vec<(f64, f64)> = below.chain(above).collect();
            self.area.draw(&Polygon::new(around, colour.mix(BAND_OPACITY).filled()))?;
        }
        self.area.draw(&Markup("</g>\n".to_owned()))
    }

    /// Draws a layer as a group of its name, with the numbers of its markers, of points that have
    /// names or of its band.
    pub(crate) fn draw_group(&self, layer: &Layer) -> Drawn {
        let (name, mut numbers) = (escaped(&layer.name), String::new());
        let short = |value: f64| format!("{value:.4e}").parse::<f64>().unwrap_or(value);
        if matches!(layer.look, Look::Marker { .. }) || !layer.trials.is_empty() {
            let points: Vec<(f64, f64)> = layer.points.iter().map(|point| self.at(point)).collect();
            let line = |i: usize| {
                let (Point { x, y, error }, trial) = (layer.points[i], layer.trials.get(i));
                let [x, y, error] = [x, y, error].map(short);
                format!("{x} {y} {error} {}\n", trial.map_or(String::new(), |trial| escaped(trial)))
            };
            let lines = self.shown(&points).into_iter().map(line);
            numbers = format!(" data-points=\"{}\"", lines.collect::<String>());
        }
        if !layer.band.is_empty() {
            let all = layer.points.iter().zip(&layer.band);
            let all: Vec<_> = all.filter(|(point, _)| self.shows(self.at(point))).collect();
            let places = all.iter().step_by(all.len().div_ceil(BAND_PLACES).max(1));
            let line = |(point, [low, high]): &(&Point, &[f64; 2])| {
                let [x, y, low, high] = [point.x, point.y, *low, *high].map(short);
                format!("{x} {y} {low} {high}\n")
            };
            numbers = format!(" data-band=\"{}\"", places.map(line).collect::<String>());
        }
        self.area.draw(&Markup(format!("<g data-name=\"{name}\"{numbers}>\n")))?;
        self.draw(layer)?;
        self.area.draw(&Markup("</g>\n".to_owned()))
    }

    /// Draws the shapes of a layer.
    pub(crate) fn draw(&self, layer: &Layer) -> Drawn {
        let points: Vec<(f64, f64)> = layer.points.iter().map(|point| self.at(point)).collect();
        let line = |colour| stroke(colour, style::LINE_WIDTH);
        // An open marker hides what is under it, so that lines do not strike it through.
        let marker = |colour, filled| match filled {
            true => vec![(style::MARKER_RADIUS, colour)],
            false => {
                let core = style::MARKER_RADIUS - MARKER_WALL;
                vec![(style::MARKER_RADIUS, colour), (core, style::PAPER)]
            }
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
                let shown = self.shown(&points).into_iter().map(|i| points[i]);
                self.path(shown.collect(), style::SOLID, links)?;
                self.discs(&points, Shape::Circle, &[(LINK_WIDTH, style::LINKS)])
            }
            Look::Arrow => self.arrow(&points, line(style::INK)),
        }
    }

    pub(crate) fn path(&self, points: Vec<(f64, f64)>, dash: Dash, stroke: ShapeStyle) -> Drawn {
        match dash.map(|(dash, gap)| (units(dash), units(gap))) {
            None => self.area.draw(&PathElement::new(points, stroke)),
            Some((dash, gap)) => self.area.draw(&DashedPathElement::new(points, dash, gap, stroke)),
        }
    }

    fn curve(&self, points: &[(f64, f64)], dash: Dash, stroke: ShapeStyle) -> Drawn {
        let apart = (APART * self.pixel.0, APART * self.pixel.1);
        visible(points, [self.y.low, self.y.high], apart).into_iter().try_for_each(
            |part| match part.len() > MOST {
                true => self.path(envelope(&part, MOST / 2).concat(), style::SOLID, stroke),
                false => self.path(part, dash, stroke),
            },
        )
    }

    /// The points within the panel; of many those that do not cover each other.
    fn shown(&self, points: &[(f64, f64)]) -> Vec<usize> {
        let mut taken = BTreeSet::new();
        let cell = |at: f64, pixel: f64| (at / (APART_AMONG_MANY * pixel)).round() as i64;
        let mut is_free = |(x, y)| {
            points.len() <= MOST_POINTS
                || taken.insert((cell(x, self.pixel.0), cell(y, self.pixel.1)))
        };
        let is_shown = |i: &usize| self.shows(points[*i]) && is_free(points[*i]);
        (0..points.len()).filter(is_shown).collect()
    }

    fn shows(&self, (x, y): (f64, f64)) -> bool {
        x.is_finite() && self.y.contains(y)
    }

    /// Discs of these radii, px, over each other at every point.
    fn discs(&self, points: &[(f64, f64)], shape: Shape, discs: &[(f64, RGBColor)]) -> Drawn {
        let shown = self.shown(points);
        let mut each = discs.iter().flat_map(|disc| shown.iter().map(move |i| (points[*i], disc)));
        each.try_for_each(|(at, (radius, colour))| {
            let (half, fill) = (units(0.92 * radius), colour.filled());
            let square = Rectangle::new([(-half, -half), (half, half)], fill);
            match shape {
                Shape::Circle => self.area.draw(&Circle::new(at, units(*radius), fill)),
                Shape::Square => self.area.draw(&(EmptyElement::at(at) + square)),
            }
        })
    }

    fn error_bars(&self, layer: &[Point], stroke: ShapeStyle, ends_px: f64) -> Drawn {
        let points: Vec<(f64, f64)> = layer.iter().map(|point| self.at(point)).collect();
        for i in self.shown(&points).into_iter().filter(|i| layer[*i].error > 0.0) {
            let (point, (x, _)) = (layer[i], points[i]);
            let end = |error| self.at(&Point { y: point.y + error, ..point }).1;
            let (low, high) =
                (end(-point.error).max(self.y.low), end(point.error).min(self.y.high));
            self.path(vec![(x, low), (x, high)], style::SOLID, stroke)?;
            let half = units(0.5 * ends_px);
            for y in [low, high].into_iter().filter(|_| half > 0) {
                let end = PathElement::new([(-half, 0), (half, 0)], stroke);
                self.area.draw(&(EmptyElement::at((x, y)) + end))?;
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
