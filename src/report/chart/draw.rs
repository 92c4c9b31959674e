//! Draws panels and puts them together.

use plotters::style::RGBColor;
use plotters::style::text_anchor::HPos;
use plotters_backend::DrawingBackend;

use super::scale::Scale;
use super::{Axes, Chart, Layer, Layout};
use crate::report::canvas::{Canvas, Drawn, TextAt};
use crate::report::font::Typeface;
use crate::report::legend;
use crate::report::polyline;
use crate::report::style::{self, Look};

/// Room around a panel for its title, ticks and labels, px.
const LEFT: f64 = 66.0;
const RIGHT: f64 = 10.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 42.0;
const TICK: f64 = 4.0;
const DOT: f64 = 1.7;
const LINK_WIDTH: f64 = 4.0;
const ARROW_HEAD: f64 = 9.0;
const SPAN: f64 = 9.0;
const DASHES: [f64; 2] = [6.0, 4.0];
/// Widths of the characters of a tick's label are at most this part of its height.
const DIGIT_EM: f64 = 0.6;
/// Points of a curve nearer to each other than this cannot be told apart, px.
const APART: f64 = 0.3;

/// A part of the figure that holds one panel, px.
#[derive(Debug, Clone, Copy)]
struct Cell {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
}

/// The cells of the panels.
fn cells(charts: &[Chart], layout: Layout) -> Vec<Cell> {
    let columns = match (layout, charts.len()) {
        (Layout::Stack(_), _) | (_, 0..=1) => 1,
        (Layout::Pairs | Layout::PairsAndWide, _) | (_, 2 | 4) => 2,
        (Layout::Grid, _) => 3,
    };
    let height = match (layout, columns) {
        (Layout::Stack(height), _) => height,
        (_, 1) => 290.0,
        (Layout::PairsAndWide, _) => 235.0,
        _ => 215.0,
    };
    let whole = match layout {
        Layout::Grid if columns < 3 => style::WIDTH,
        Layout::Stack(_) => style::WIDTH,
        _ => style::WIDE,
    };
    let cell = |(i, chart): (usize, &Chart)| {
        let is_wide = layout == Layout::PairsAndWide && i + 1 == charts.len() && i % 2 == 0;
        let width = if is_wide { whole } else { whole / columns as f64 };
        let (left, top) =
            ((i % columns) as f64 * whole / columns as f64, (i / columns) as f64 * height);
        match chart.axes {
            Axes::Map if columns == 1 || is_wide => {
                Cell { left, top, width, height: map_height(chart, width) }
            }
            _ => Cell { left, top, width, height },
        }
    };
    charts.iter().enumerate().map(cell).collect()
}

/// Height of a map that is as wide as the figure: not more than it needs, and not as high as wide.
fn map_height(chart: &Chart, width: f64) -> f64 {
    const LEAST: f64 = 110.0;
    let (xs, ys) = chart.extent();
    let range = |values: &[f64]| {
        let values = values.iter().copied().filter(|value| value.is_finite());
        values.clone().fold(f64::NAN, f64::max) - values.fold(f64::NAN, f64::min)
    };
    let inner = width - LEFT - RIGHT;
    let needed = 1.15 * inner * range(&ys) / range(&xs);
    let inner_height = if needed.is_finite() { needed.clamp(LEAST, 0.6 * inner) } else { LEAST };
    TOP + inner_height + BOTTOM
}

/// Width and height of the panels together, px.
pub fn size(charts: &[Chart], layout: Layout) -> (f64, f64) {
    let cells = cells(charts, layout);
    let most = |of: fn(&Cell) -> f64| cells.iter().map(of).fold(0.0, f64::max);
    (most(|cell| cell.left + cell.width), 6.0 + most(|cell| cell.top + cell.height))
}

/// Whether every panel says beside its title what its lines are: where panels above one another
/// show different things, and their titles leave room.
pub fn have_own_legends(charts: &[Chart], layout: Layout, font: Typeface) -> bool {
    let has_room = |chart: &Chart| {
        let title = font.width_em(&chart.title) * style::SMALL_TEXT + 25.0;
        title + own_legend_width(chart, font) < style::WIDTH - LEFT - RIGHT
    };
    let first: Vec<_> = charts.first().into_iter().flat_map(Chart::samples).collect();
    let differ = charts.iter().any(|chart| chart.samples().ne(first.iter().cloned()));
    matches!(layout, Layout::Stack(_)) && differ && charts.iter().all(has_room)
}

fn own_legend_width(chart: &Chart, font: Typeface) -> f64 {
    chart.samples().map(|sample| legend::width(&sample, font) + legend::ENTRY_GAP).sum()
}

/// Draws the panels from `top` px on.
///
/// # Errors
/// The backend fails.
pub fn draw<B: DrawingBackend>(
    charts: &[Chart],
    layout: Layout,
    top: f64,
    canvas: &mut Canvas<'_, B>,
) -> Drawn<B> {
    let own_legends = have_own_legends(charts, layout, canvas.font);
    for ((chart, cell), letter) in charts.iter().zip(cells(charts, layout)).zip('a'..) {
        let title = match charts.len() {
            1 => chart.title.clone(),
            _ => format!("({letter}) {}", chart.title),
        };
        let frame = Frame::new(chart, cell, top);
        frame.draw(chart, &title, canvas)?;
        if own_legends {
            frame.draw_legend(chart, canvas)?;
        }
    }
    Ok(())
}

/// A panel's sides and axes.
struct Frame {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
    x: Scale,
    y: Scale,
}

impl Frame {
    fn new(chart: &Chart, cell: Cell, top: f64) -> Self {
        let (xs, ys) = chart.extent();
        let mut x = Scale::of(&xs, None, chart.axes != Axes::ByValues);
        let is_linear = matches!(chart.axes, Axes::Linear | Axes::Map);
        let mut y = Scale::of(&ys, chart.shown, is_linear);
        let (left, right) = (cell.left + LEFT, cell.left + cell.width - RIGHT);
        let (top, bottom) = (top + cell.top + TOP, top + cell.top + cell.height - BOTTOM);
        if chart.axes == Axes::Map {
            Scale::equalise(&mut x, &mut y, right - left, bottom - top);
        }
        Self { left, right, top, bottom, x, y }
    }

    fn x(&self, value: f64) -> f64 {
        self.left + self.x.part(value) * (self.right - self.left)
    }

    fn y(&self, value: f64) -> f64 {
        self.bottom - self.y.part(value) * (self.bottom - self.top)
    }

    fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        (self.x(x), self.y(y))
    }

    /// Whether a place in px is within the panel's height.
    fn shows(&self, (_, y): (f64, f64)) -> bool {
        (self.top..=self.bottom).contains(&y)
    }

    fn draw<B: DrawingBackend>(
        &self,
        chart: &Chart,
        title: &str,
        canvas: &mut Canvas<'_, B>,
    ) -> Drawn<B> {
        for layer in &chart.layers {
            if let Layer::Band { from, to, .. } = layer {
                let from = from.map_or(self.left, |x| self.x(x)).clamp(self.left, self.right);
                let to = to.map_or(self.right, |x| self.x(x)).clamp(self.left, self.right);
                canvas.fill((from, self.top), (to, self.bottom), style::BAND)?;
            }
        }
        self.draw_axes(canvas)?;
        for layer in &chart.layers {
            self.draw_layer(layer, canvas)?;
        }
        for (note, row) in chart.notes.iter().zip(1..) {
            let y = self.top + f64::from(row) * 1.3 * style::SMALL_TEXT + 2.0;
            canvas.text(note, text(self.right - 7.0, y, HPos::Right))?;
        }
        canvas.text(title, text(self.left, self.top - 8.0, HPos::Left))?;
        canvas.text(&chart.beyond, text(self.right, self.top - 8.0, HPos::Right))?;
        let middle = (self.left + self.right) / 2.0;
        canvas.text(&chart.x_label, text(middle, self.bottom + 34.0, HPos::Center))?;
        let middle = (self.top + self.bottom) / 2.0;
        canvas.text_upwards(&chart.y_label, text(self.left - LEFT + 14.0, middle, HPos::Center))
    }

    /// The panel's own legend, at the right end of its title.
    fn draw_legend<B: DrawingBackend>(
        &self,
        chart: &Chart,
        canvas: &mut Canvas<'_, B>,
    ) -> Drawn<B> {
        let mut x = self.right - own_legend_width(chart, canvas.font) + legend::ENTRY_GAP;
        for sample in chart.samples() {
            legend::draw(&sample, x, self.top - 12.0, canvas)?;
            x += legend::width(&sample, canvas.font) + legend::ENTRY_GAP;
        }
        Ok(())
    }

    fn draw_axes<B: DrawingBackend>(&self, canvas: &mut Canvas<'_, B>) -> Drawn<B> {
        for (value, label) in self.y.ticks((self.bottom - self.top) / 36.0) {
            let level = self.y(value);
            let ends = [(self.left, level), (self.right, level)];
            canvas.line(&ends, style::GRID, style::FRAME_WIDTH)?;
            let baseline = level + 0.36 * style::SMALL_TEXT;
            canvas.text(&label, text(self.left - TICK, baseline, HPos::Right))?;
        }
        // As many ticks as have room for their labels.
        let mut about = ((self.right - self.left) / 45.0).max(3.0);
        let mut ticks = self.x.ticks(about);
        let has_room = |ticks: &[(f64, String)]| {
            let most = ticks.iter().map(|(_, label)| label.chars().count()).max().unwrap_or(0);
            let step = ticks.windows(2).map(|pair| self.x(pair[1].0) - self.x(pair[0].0));
            let needed = (most as f64 + 1.0) * DIGIT_EM * style::SMALL_TEXT;
            step.fold(f64::INFINITY, f64::min) > needed
        };
        while !has_room(&ticks) && about > 1.0 {
            about -= 1.0;
            ticks = self.x.ticks(about);
        }
        let all_have_room = has_room(&ticks);
        for (i, (value, label)) in ticks.iter().enumerate() {
            let across = self.x(*value);
            let ends = [(across, self.bottom), (across, self.bottom + TICK)];
            canvas.line(&ends, style::INK, style::FRAME_WIDTH)?;
            if all_have_room || i == 0 {
                let below = self.bottom + TICK + style::SMALL_TEXT;
                canvas.text(label, text(across, below, HPos::Center))?;
            }
        }
        // From the middle of a side and back to it, so that every corner is joined.
        let side = (self.left, (self.top + self.bottom) / 2.0);
        let corners = [
            side,
            (self.left, self.top),
            (self.right, self.top),
            (self.right, self.bottom),
            (self.left, self.bottom),
            side,
        ];
        canvas.line(&corners, style::INK, style::FRAME_WIDTH)
    }

    fn draw_layer<B: DrawingBackend>(&self, layer: &Layer, canvas: &mut Canvas<'_, B>) -> Drawn<B> {
        match layer {
            Layer::Band { .. } => Ok(()),
            Layer::Curve { points, look, .. } => self.draw_curve(points, *look, canvas),
            Layer::Bars { points, look, .. } => self.draw_bars(points, *look, canvas),
            Layer::Level { y, .. } => {
                let level = self.y(*y);
                if !self.shows((self.left, level)) {
                    return Ok(());
                }
                draw_dashes([(self.left, level), (self.right, level)], canvas)
            }
            Layer::Rules { xs, .. } => xs.iter().try_for_each(|x| {
                draw_dashes([(self.x(*x), self.top), (self.x(*x), self.bottom)], canvas)
            }),
            Layer::Line { points, colour, .. } => {
                let line: Vec<_> = points.iter().map(|point| self.at(*point)).collect();
                for part in polyline::clip(&line, self.top, self.bottom) {
                    canvas.line(&part, *colour, 1.5)?;
                }
                let mut shown = line.iter().filter(|point| self.shows(**point));
                shown.try_for_each(|point| canvas.circle(*point, DOT, *colour))
            }
            Layer::Dots { points, colour, .. } => {
                points.iter().try_for_each(|point| canvas.circle(self.at(*point), DOT, *colour))
            }
            Layer::Mark { point, .. } => {
                canvas.marker(self.at(*point), style::INK, style::Shape::Circle, false)
            }
            Layer::Links { points, .. } => {
                let line: Vec<_> = points.iter().map(|point| self.at(*point)).collect();
                canvas.line(&line, style::LINKS, LINK_WIDTH)?;
                line.iter().try_for_each(|joint| canvas.circle(*joint, LINK_WIDTH, style::LINKS))
            }
            Layer::Arrow { from, to, .. } => self.draw_arrow(*from, *to, canvas),
            Layer::Spans { spans, colour, .. } => spans.iter().try_for_each(|(from, to, y)| {
                let (from, up) = self.at((*from, *y));
                // What is short still has to be seen.
                let to = self.x(*to).max(from + 1.0);
                canvas.fill((from, up - SPAN / 2.0), (to, up + SPAN / 2.0), *colour)
            }),
        }
    }

    fn draw_curve<B: DrawingBackend>(
        &self,
        points: &[(f64, f64)],
        look: Look,
        canvas: &mut Canvas<'_, B>,
    ) -> Drawn<B> {
        let Look::Line { colour, dash } = look else { return Ok(()) };
        for run in points.split(|(x, y)| !(x.is_finite() && y.is_finite())) {
            let line = polyline::thin(run.iter().map(|point| self.at(*point)), APART);
            for part in polyline::clip(&line, self.top, self.bottom) {
                for dash in polyline::dashes(&part, dash) {
                    canvas.line(&dash, colour, style::CHART_LINE_WIDTH)?;
                }
            }
        }
        Ok(())
    }

    fn draw_bars<B: DrawingBackend>(
        &self,
        points: &[(f64, f64, Option<f64>)],
        look: Look,
        canvas: &mut Canvas<'_, B>,
    ) -> Drawn<B> {
        let Look::Marker { colour, shape, filled } = look else { return Ok(()) };
        for (x, y, error) in points {
            let (across, up) = self.at((*x, *y));
            if !(across.is_finite() && self.shows((across, up))) {
                continue;
            }
            if let Some(error) = error {
                let ends = [self.y(y - error), self.y(y + error)];
                let [low, high] = ends.map(|end| end.clamp(self.top, self.bottom));
                canvas.error_bar(across, low, high, colour)?;
            }
            canvas.marker((across, up), colour, shape, filled)?;
        }
        Ok(())
    }

    fn draw_arrow<B: DrawingBackend>(
        &self,
        from: (f64, f64),
        to: (f64, f64),
        canvas: &mut Canvas<'_, B>,
    ) -> Drawn<B> {
        let (from, to) = (self.at(from), self.at(to));
        let (along, up) = (to.0 - from.0, to.1 - from.1);
        let length = along.hypot(up);
        if length < 1.0 {
            return Ok(());
        }
        let (along, up) = (along / length * ARROW_HEAD, up / length * ARROW_HEAD);
        let head = |side: f64| (to.0 - along + side * 0.45 * up, to.1 - up - side * 0.45 * along);
        canvas.line(&[from, to], style::INK, style::CHART_LINE_WIDTH)?;
        canvas.line(&[head(1.0), to, head(-1.0)], style::INK, style::CHART_LINE_WIDTH)
    }
}

fn draw_dashes<B: DrawingBackend>(ends: [(f64, f64); 2], canvas: &mut Canvas<'_, B>) -> Drawn<B> {
    let dashes = polyline::dashes(&ends, &DASHES);
    dashes.iter().try_for_each(|dash| canvas.line(dash, style::INK, style::FRAME_WIDTH))
}

fn text(x: f64, y: f64, align: HPos) -> TextAt {
    const COLOUR: RGBColor = style::INK;
    TextAt { x, y, em: style::SMALL_TEXT, colour: COLOUR, align }
}
