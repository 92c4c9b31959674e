//! Drawing of layers in axis coordinates.

use std::collections::BTreeSet;

use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::element::{
    Circle, DashedPathElement, EmptyElement, PathElement, Polygon, Rectangle, Text,
};
use plotters::style::text_anchor::HPos;
use plotters::style::{Color, RGBColor, ShapeStyle};

use super::axis::{Axis, Range};
use super::figure::{Layer, Point};
use super::style::{self, Dash, Look, Shape, stroke, units};
use crate::polyline::{envelope, visible};
use crate::svg::{Markup, Svg, escaped};

/// Area of the drawing, with coordinates in the backend's units from its upper left corner.
pub(crate) type Area<'b> = DrawingArea<Svg<'b>, Shift>;
pub(crate) type Drawn = Result<(), DrawingAreaErrorKind<std::convert::Infallible>>;
type AreaOfAxes<'b> = DrawingArea<Svg<'b>, Cartesian2d<Axis, Axis>>;

const LINK_WIDTH: f64 = 4.0;
const ARROW_HEAD: f64 = 9.0;
/// Outline width of a marker that is not filled, px.
const MARKER_WALL: f64 = 1.5;
/// Height of a horizontal bar of [`Look::Spans`], in units of the vertical axis.
const SPAN_HEIGHT: f64 = 0.28;
/// Maximum number of points for which every point of a line is drawn; a longer line is reduced to its
/// envelope.
const MAX_LINE_POINTS: usize = 4000;
/// Maximum number of points for which every point of a layer other than a line is drawn.
const MAX_POINTS: usize = 200;
/// Minimum distance between drawn points in layers with more than [`MAX_POINTS`] points, px.
const MIN_MARKER_DISTANCE: f64 = 2.5;
const BAND_OPACITY: f64 = 0.2;
/// Maximum number of points of a band that are written for the report page's script.
const MAX_BAND_POINTS: usize = 60;
/// Minimum distance between the points of a curve, px; closer points are indistinguishable.
const MIN_CURVE_DISTANCE: f64 = 0.3;

/// Area of the drawing in which lengths and positions are given in axis coordinates.
pub(crate) struct Frame<'b> {
    area: AreaOfAxes<'b>,
    pub x: Range,
    pub y: Range,
    /// Width and height of a pixel in axis coordinates.
    pixel: (f64, f64),
}

impl<'b> Frame<'b> {
    pub(crate) fn new(area: AreaOfAxes<'b>, pixel: (f64, f64)) -> Self {
        let axes = area.as_coord_spec();
        let x = axes.x_spec().range;
        let y = axes.y_spec().range;
        Self { area, x, y, pixel }
    }

    /// Returns a frame whose coordinates are pixels from the upper left corner.
    pub(crate) fn in_pixels(area: &Area<'b>) -> Self {
        let (across, down) = area.get_pixel_range();
        let [x, y] = [&across, &down].map(|units| {
            Axis::linear(Range { low: 0.0, high: units.len() as f64 / style::UNITS_PER_PX })
        });
        let axes = Cartesian2d::new(x, y, (across, down));
        Self::new(area.apply_coord_spec(axes), (1.0, 1.0))
    }

    /// Converts a point of a layer to axis coordinates.
    fn at(&self, point: &Point) -> (f64, f64) {
        let axes = self.area.as_coord_spec();
        (axes.x_spec().scaled(point.x), axes.y_spec().scaled(point.y))
    }

    /// Draws the band around a line, as a group with the line's name.
    pub(crate) fn draw_band(&self, layer: &Layer) -> Drawn {
        let Look::Line { colour, .. } = layer.look else { return Ok(()) };
        if layer.band.is_empty() {
            return Ok(());
        }
        // Lower and upper sides of the band at each point, limited to the panel.
        let mut sides: Vec<[(f64, f64); 2]> = Vec::new();
        for (point, band) in layer.points.iter().zip(&layer.band) {
            sides.push(band.map(|y| match self.at(&Point { y, ..*point }) {
                (x, y) if y < self.y.low => (x, self.y.low),
                (x, y) if y > self.y.high => (x, self.y.high),
                at => at,
            }));
        }
        self.area.draw(&Markup(format!("<g data-name=\"{}\">\n", escaped(&layer.name))))?;
        let parts = sides.split(|sides| sides.iter().any(|(x, y)| !(x + y).is_finite()));
        for part in parts.filter(|part| part.len() > 1) {
            let lower = part.iter().map(|sides| sides[0]);
            let upper = part.iter().rev().map(|sides| sides[1]);
            let outline: Vec<(f64, f64)> = lower.chain(upper).collect();
            self.area.draw(&Polygon::new(outline, colour.mix(BAND_OPACITY).filled()))?;
        }
        self.area.draw(&Markup("</g>\n".to_owned()))
    }

    /// Draws a layer as a group with the layer's name, and writes the data of its markers, trials or band for
    /// the report page's script. `shifts` are the horizontal distances (px) by which its points are displaced.
    pub(crate) fn draw_group(&self, layer: &Layer, shifts: &[f64]) -> Drawn {
        let name = escaped(&layer.name);
        let mut numbers = String::new();
        if matches!(layer.look, Look::Marker { .. }) || !layer.trials.is_empty() {
            numbers = format!(" data-points=\"{}\"", self.point_lines(layer));
            if shifts.iter().any(|shift| *shift != 0.0) {
                numbers += &format!(" data-shifts=\"{}\"", self.shift_list(layer, shifts));
            }
        }
        if !layer.band.is_empty() {
            numbers = format!(" data-band=\"{}\"", self.band_lines(layer));
        }
        self.area.draw(&Markup(format!("<g data-name=\"{name}\"{numbers}>\n")))?;
        if shifts.iter().any(|shift| *shift != 0.0) {
            self.draw(&self.shifted(layer, shifts))?;
        } else {
            self.draw(layer)?;
        }
        self.area.draw(&Markup("</g>\n".to_owned()))
    }

    /// Returns a layer whose points are displaced horizontally.
    fn shifted(&self, layer: &Layer, shifts: &[f64]) -> Layer {
        let is_logarithmic = self.area.as_coord_spec().x_spec().is_logarithmic;
        let mut layer = layer.clone();
        for (point, shift) in layer.points.iter_mut().zip(shifts) {
            let shift = shift * self.pixel.0;
            point.x = if is_logarithmic { point.x * 10_f64.powf(shift) } else { point.x + shift };
        }
        layer
    }

    /// Returns the horizontal position of a value, px.
    pub(crate) fn x_px(&self, value: f64) -> f64 {
        self.area.as_coord_spec().x_spec().scaled(value) / self.pixel.0
    }

    /// Formats the horizontal displacements of the visible points of a layer, in the backend's units.
    fn shift_list(&self, layer: &Layer, shifts: &[f64]) -> String {
        let points: Vec<(f64, f64)> = layer.points.iter().map(|point| self.at(point)).collect();
        let shown = self.shown(&points).into_iter().map(|i| units(shifts[i]).to_string());
        shown.collect::<Vec<_>>().join(" ")
    }

    /// Formats the visible points of a layer as lines of x, y, error and trial.
    fn point_lines(&self, layer: &Layer) -> String {
        let points: Vec<(f64, f64)> = layer.points.iter().map(|point| self.at(point)).collect();
        let mut lines = String::new();
        for i in self.shown(&points) {
            let Point { x, y, error } = layer.points[i];
            let [x, y, error] = [x, y, error].map(five_digits);
            let trial = layer.trials.get(i).map_or(String::new(), |trial| escaped(trial));
            lines.push_str(&format!("{x} {y} {error} {trial}\n"));
        }
        lines
    }

    /// Formats the band of a layer, at a limited number of points, as lines of x, y and both limits.
    fn band_lines(&self, layer: &Layer) -> String {
        let all = layer.points.iter().zip(&layer.band);
        let all: Vec<_> = all.filter(|(point, _)| self.shows(self.at(point))).collect();
        let mut lines = String::new();
        for (point, [low, high]) in all.iter().step_by(all.len().div_ceil(MAX_BAND_POINTS).max(1)) {
            let [x, y, low, high] = [point.x, point.y, *low, *high].map(five_digits);
            lines.push_str(&format!("{x} {y} {low} {high}\n"));
        }
        lines
    }

    /// Draws the lines, markers and other shapes of a layer.
    pub(crate) fn draw(&self, layer: &Layer) -> Drawn {
        let points: Vec<(f64, f64)> = layer.points.iter().map(|point| self.at(point)).collect();
        let line = |colour| stroke(colour, style::LINE_WIDTH);
        match layer.look {
            Look::Line { colour, dash, width_px } => {
                self.curve(&points, dash, stroke(colour, width_px))
            }
            Look::Dots { colour, joined } => {
                if joined {
                    self.curve(&points, style::SOLID, line(colour))?;
                }
                self.symbols(&points, Shape::Circle, &[(style::DOT_RADIUS, colour)])
            }
            Look::Marker { colour, shape, filled } => {
                self.error_bars(
                    &layer.points,
                    stroke(colour, style::FRAME_WIDTH),
                    style::ERROR_BAR_ENDS,
                )?;
                self.symbols(&points, shape, &marker_symbols(colour, filled))
            }
            Look::Rings => self.symbols(&points, Shape::Circle, &marker_symbols(style::INK, false)),
            Look::Guides => points.into_iter().take(MAX_LINE_POINTS).try_for_each(|(x, y)| {
                let guide = if y.is_nan() {
                    [(x, self.y.low), (x, self.y.high)]
                } else {
                    [(self.x.low, y), (self.x.high, y)]
                };
                self.curve(&guide, style::DASHES, stroke(style::INK, style::FRAME_WIDTH))
            }),
            Look::Bars(colour) => {
                self.error_bars(&layer.points, stroke(colour, style::BAR_WIDTH), 0.0)
            }
            Look::Band(colour) => {
                // A missing or NaN side is replaced by the side of the panel.
                let [from, to] = [0, 1].map(|i| points.get(i).map_or(f64::NAN, |(x, _)| *x));
                let from = self.x.low.max(from);
                let to = self.x.high.min(to);
                self.fill([(from, self.y.high), (to, self.y.low)], colour)
            }
            Look::Spans(colour) => points.chunks_exact(2).try_for_each(|ends| {
                let [(from, centre), (to, _)] = [ends[0], ends[1]];
                // A short span is drawn at least one pixel wide.
                let to = to.max(from + self.pixel.0);
                let half = 0.5 * SPAN_HEIGHT;
                self.fill([(from, centre + half), (to, centre - half)], colour)
            }),
            Look::Cells(colour) => points.iter().try_for_each(|(x, y)| {
                self.fill([(x - 0.5, y + 0.5), (x + 0.5, y - 0.5)], colour)?;
                let ink = style::ink_on(colour);
                let style = style::text_style(HPos::Center).color(&ink);
                let top = y + 0.45 * style::EM * self.pixel.1;
                self.area.draw(&Text::new(layer.name.as_str(), (*x, top), style))
            }),
            Look::Links => {
                let links = stroke(style::LINKS, LINK_WIDTH);
                let shown = self.shown(&points).into_iter().map(|i| points[i]);
                self.path(shown.collect(), style::SOLID, links)?;
                self.symbols(&points, Shape::Circle, &[(LINK_WIDTH, style::LINKS)])
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
        let min_distance = (MIN_CURVE_DISTANCE * self.pixel.0, MIN_CURVE_DISTANCE * self.pixel.1);
        for part in visible(points, [self.y.low, self.y.high], min_distance) {
            if part.len() > MAX_LINE_POINTS {
                let reduced = envelope(&part, MAX_LINE_POINTS / 2).concat();
                self.path(reduced, style::SOLID, stroke)?;
            } else {
                self.path(part, dash, stroke)?;
            }
        }
        Ok(())
    }

    /// Returns the indices of the points within the panel; if there are many, only of those that do not
    /// overlap others.
    fn shown(&self, points: &[(f64, f64)]) -> Vec<usize> {
        let mut taken = BTreeSet::new();
        let mut shown = Vec::new();
        for (i, &(x, y)) in points.iter().enumerate() {
            if !self.shows((x, y)) {
                continue;
            }
            let cell = [(x, self.pixel.0), (y, self.pixel.1)]
                .map(|(at, pixel)| (at / (MIN_MARKER_DISTANCE * pixel)).round() as i64);
            if points.len() <= MAX_POINTS || taken.insert(cell) {
                shown.push(i);
            }
        }
        shown
    }

    fn shows(&self, (x, y): (f64, f64)) -> bool {
        x.is_finite() && self.y.contains(y)
    }

    /// Draws concentric filled symbols of the given shape at every visible point; `symbols` lists their radii (px) and
    /// colours, the outermost first.
    fn symbols(&self, points: &[(f64, f64)], shape: Shape, symbols: &[(f64, RGBColor)]) -> Drawn {
        let shown = self.shown(points);
        let mut each =
            symbols.iter().flat_map(|symbol| shown.iter().map(move |i| (points[*i], symbol)));
        each.try_for_each(|(at, (radius, colour))| {
            let fill = colour.filled();
            let corners: &[(f64, f64)] = match shape {
                Shape::Circle => return self.area.draw(&Circle::new(at, units(*radius), fill)),
                Shape::Square => &[(-0.92, -0.92), (0.92, -0.92), (0.92, 0.92), (-0.92, 0.92)],
                Shape::Triangle => &[(0.0, -1.25), (1.2, 0.85), (-1.2, 0.85)],
                Shape::Diamond => &[(0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)],
            };
            let corners = corners.iter().map(|(x, y)| (units(x * radius), units(y * radius)));
            let shape = Polygon::new(corners.collect::<Vec<_>>(), fill);
            self.area.draw(&(EmptyElement::at(at) + shape))
        })
    }

    fn error_bars(&self, layer: &[Point], stroke: ShapeStyle, ends_px: f64) -> Drawn {
        let points: Vec<(f64, f64)> = layer.iter().map(|point| self.at(point)).collect();
        for i in self.shown(&points).into_iter().filter(|i| layer[*i].error > 0.0) {
            let point = layer[i];
            let (x, _) = points[i];
            let [low, high] = [-point.error, point.error]
                .map(|error| self.at(&Point { y: point.y + error, ..point }).1);
            let inside = |y: &f64| (self.y.low..=self.y.high).contains(y);
            let bar = vec![(x, low.max(self.y.low)), (x, high.min(self.y.high))];
            self.path(bar, style::SOLID, stroke)?;
            let half = units(0.5 * ends_px);
            // An end beyond the axes has no cap.
            for y in [low, high].into_iter().filter(inside).filter(|_| half > 0) {
                let end = PathElement::new([(-half, 0), (half, 0)], stroke);
                self.area.draw(&(EmptyElement::at((x, y)) + end))?;
            }
        }
        Ok(())
    }

    fn fill(&self, corners: [(f64, f64); 2], colour: RGBColor) -> Drawn {
        if corners.iter().all(|(x, y)| x.is_finite() && y.is_finite()) {
            self.area.draw(&Rectangle::new(corners, colour.filled()))?;
        }
        Ok(())
    }

    /// Draws an arrow between two points; one unit must be equally long on both axes.
    fn arrow(&self, points: &[(f64, f64)], stroke: ShapeStyle) -> Drawn {
        let [from, to] = points else { return Ok(()) };
        let [across, up] = [to.0 - from.0, to.1 - from.1];
        let length = across.hypot(up);
        if length.is_nan() || length <= self.pixel.0 {
            return Ok(());
        }
        let fraction = ARROW_HEAD * self.pixel.0 / length;
        let [across, up] = [across * fraction, up * fraction];
        let [left, right] = [1.0, -1.0]
            .map(|side| (to.0 - across + side * 0.45 * up, to.1 - up - side * 0.45 * across));
        self.path(vec![*from, *to], style::SOLID, stroke)?;
        self.path(vec![left, *to, right], style::SOLID, stroke)
    }
}

/// Returns the radii (px) and colours of the concentric filled symbols that form a marker. The inner symbol
/// of an open marker has the background colour, so that lines do not show through.
fn marker_symbols(colour: RGBColor, filled: bool) -> Vec<(f64, RGBColor)> {
    let mut symbols = vec![(style::MARKER_RADIUS, colour)];
    if !filled {
        symbols.push((style::MARKER_RADIUS - MARKER_WALL, style::PAPER));
    }
    symbols
}

/// Rounds a number to five significant digits.
fn five_digits(value: f64) -> f64 {
    format!("{value:.4e}").parse().unwrap_or(value)
}
