//! Draws a figure.

use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::cartesian::Cartesian2d;
use plotters::element::{Circle, ErrorBar, Rectangle};
use plotters::prelude::SVGBackend;
use plotters::style::text_anchor::HPos;
use plotters::style::{Color, RGBColor, ShapeStyle, TRANSPARENT};

use super::axis::Axis;
use super::figure::{Layer, Point};
use super::grid::{BOTTOM, Cell, Grid, LEFT, MARGIN, RIGHT, TOP};
use super::legend::{self, Area, Drawn, draw_marker, draw_path};
use super::polyline;
use super::style::{self, Dash, Look, Shape, stroke, units};

const TICK: f64 = 4.0;
const LINK_WIDTH: f64 = 4.0;
const ARROW_HEAD: f64 = 9.0;
/// Of a bar, in units of the panel.
const SPAN_HEIGHT: f64 = 0.28;
/// Points of a curve nearer to each other than this cannot be told apart, px.
const APART: f64 = 0.3;

/// Draws a figure with its legend onto an area of the grid's size.
pub fn draw(grid: Grid<'_>, area: &Area<'_>) -> Drawn {
    area.fill(&style::PAPER)?;
    grid.legend.iter().try_for_each(|entry| legend::draw(entry, MARGIN, area))?;
    grid.cells.into_iter().try_for_each(|cell| draw_panel(cell, area))
}

fn draw_panel(cell: Cell<'_>, figure: &Area<'_>) -> Drawn {
    let area = figure
        .clone()
        .shrink((units(cell.left), units(cell.top)), (units(cell.width), units(cell.height())));
    let (panel, right) = (cell.panel, cell.width - RIGHT);
    let write = |label: &str, align: HPos, x: f64, baseline: f64| {
        let at = (units(x), units(baseline - style::ASCENT));
        area.draw_text(label, &style::text_style(align), at)
    };
    write(&cell.title, HPos::Left, LEFT, TOP - 8.0)?;
    write(&panel.beyond, HPos::Right, right, TOP - 8.0)?;
    let legend_top = TOP - 12.0 - 0.5 * legend::ROW;
    cell.legend.iter().try_for_each(|entry| legend::draw(entry, legend_top, &area))?;
    let pixel = (cell.x.range.span() / cell.inner_width(), cell.y.range.span() / cell.inner_height);
    let labels = if cell.has_x_labels { BOTTOM - 5.0 } else { 0.0 };
    let mut chart = ChartBuilder::on(&area)
        .margin_top(units(TOP))
        .margin_right(units(RIGHT))
        .margin_bottom(units(cell.bottom() - labels))
        .margin_left(units(1.0))
        .y_label_area_size(units(LEFT - 1.0))
        .x_label_area_size(units(labels))
        .build_cartesian_2d(cell.x.clone(), cell.y.clone())?;
    let mut frame = Frame { chart: &mut chart, x: cell.x, y: cell.y, pixel };
    // Bands lie behind the mesh.
    let (bands, others): (Vec<&Layer>, Vec<_>) =
        panel.layers.iter().partition(|layer| layer.look == Look::Band);
    bands.into_iter().try_for_each(|layer| frame.draw(layer))?;
    frame.draw_mesh(&panel.x_label, &panel.y_label)?;
    others.into_iter().try_for_each(|layer| frame.draw(layer))?;
    for (note, row) in panel.notes.iter().zip(1..) {
        write(note, HPos::Right, right - 7.0, TOP + f64::from(row) * 1.3 * style::EM + 2.0)?;
    }
    Ok(())
}

/// A panel's frame; lengths and positions are in the axes' coordinates.
struct Frame<'c, 'a, 'b> {
    chart: &'c mut ChartContext<'a, SVGBackend<'b>, Cartesian2d<Axis, Axis>>,
    x: Axis,
    y: Axis,
    /// Width and height of a pixel.
    pixel: (f64, f64),
}

impl Frame<'_, '_, '_> {
    fn draw_mesh(&mut self, x_label: &str, y_label: &str) -> Drawn {
        let ink = stroke(style::INK, style::FRAME_WIDTH);
        self.chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(stroke(style::GRID, style::FRAME_WIDTH))
            .axis_style(ink)
            .label_style(style::text_style(HPos::Center))
            // Plotters centres text by half the height of an x.
            .y_label_offset(units(0.1 * style::EM))
            .set_all_tick_mark_size(units(TICK))
            .x_desc(x_label)
            .y_desc(y_label)
            .draw()?;
        // All four sides, where plotters draws two: from the middle of one and back to it, so that
        // every corner is joined.
        let (x, y) = (self.x.range, self.y.range);
        let middle = 0.5 * (y.low + y.high);
        let xs = [x.low, x.low, x.high, x.high, x.low, x.low];
        let ys = [middle, y.low, y.low, y.high, y.high, middle];
        self.path(xs.into_iter().zip(ys).collect(), style::SOLID, ink)
    }

    /// A position in the axes' coordinates.
    fn at(&self, point: &Point) -> (f64, f64) {
        (self.x.scaled(point.x), self.y.scaled(point.y))
    }

    fn draw(&mut self, layer: &Layer) -> Drawn {
        let points: Vec<(f64, f64)> = layer.points.iter().map(|point| self.at(point)).collect();
        let (x, y) = (self.x.range, self.y.range);
        match layer.look {
            Look::Line { colour, dash } => self.curve(&points, colour, dash),
            Look::Dotted(colour) => {
                self.curve(&points, colour, style::SOLID)?;
                self.dots(&points, style::DOT_RADIUS, colour)
            }
            Look::Dots(colour) => self.dots(&points, style::DOT_RADIUS, colour),
            Look::Marker { colour, shape, filled } => {
                self.error_bars(&layer.points, colour)?;
                self.markers(&points, (colour, shape, filled))
            }
            Look::Rings => self.markers(&points, (style::INK, Shape::Circle, false)),
            Look::Guides => points.into_iter().try_for_each(|at| {
                let ends = match at {
                    (across, up) if up.is_nan() => [(across, y.low), (across, y.high)],
                    (_, up) if y.contains(up) => [(x.low, up), (x.high, up)],
                    _ => return Ok(()),
                };
                self.path(ends.into(), style::DASHES, stroke(style::INK, style::FRAME_WIDTH))
            }),
            Look::Band => {
                let side = |nth: usize, open: f64| {
                    points.get(nth).map_or(open, |(x, _)| if x.is_finite() { *x } else { open })
                };
                let (from, to) = (side(0, x.low).max(x.low), side(1, x.high).min(x.high));
                self.fill([(from, y.high), (to, y.low)], style::BAND)
            }
            Look::Spans(colour) => points.chunks_exact(2).try_for_each(|ends| {
                let [(from, middle), (to, _)] = [ends[0], ends[1]];
                // What is short still has to be seen.
                let to = to.max(from + self.pixel.0);
                let half = 0.5 * SPAN_HEIGHT;
                self.fill([(from, middle + half), (to, middle - half)], colour)
            }),
            Look::Links => {
                self.path(points.clone(), style::SOLID, stroke(style::LINKS, LINK_WIDTH))?;
                self.dots(&points, LINK_WIDTH, style::LINKS)
            }
            Look::Arrow => self.arrow(&points, stroke(style::INK, style::LINE_WIDTH)),
        }
    }

    fn path(&mut self, points: Vec<(f64, f64)>, dash: Dash, stroke: ShapeStyle) -> Drawn {
        draw_path(self.chart.plotting_area(), points, dash, stroke)
    }

    fn curve(&mut self, points: &[(f64, f64)], colour: RGBColor, dash: Dash) -> Drawn {
        let apart = (APART * self.pixel.0, APART * self.pixel.1);
        let mut parts = polyline::visible(points, self.y.range, apart).into_iter();
        parts.try_for_each(|part| self.path(part, dash, stroke(colour, style::LINE_WIDTH)))
    }

    fn shows(&self, (x, y): (f64, f64)) -> bool {
        x.is_finite() && self.y.range.contains(y)
    }

    fn dots(&mut self, points: &[(f64, f64)], radius: f64, colour: RGBColor) -> Drawn {
        let shown = points.iter().copied().filter(|at| self.shows(*at)).collect::<Vec<_>>();
        let dot = |at| Circle::new(at, units(radius), colour.filled());
        self.chart.draw_series(shown.into_iter().map(dot)).map(|_| ())
    }

    fn markers(&self, points: &[(f64, f64)], marker: (RGBColor, Shape, bool)) -> Drawn {
        let mut shown = points.iter().filter(|at| self.shows(**at));
        shown.try_for_each(|at| draw_marker(self.chart.plotting_area(), *at, marker))
    }

    fn error_bars(&mut self, points: &[Point], colour: RGBColor) -> Drawn {
        let bar = |point: &Point| {
            let (x, y) = self.at(point);
            let low = self.y.scaled(point.y - point.error).max(self.y.range.low);
            let high = self.y.scaled(point.y + point.error).min(self.y.range.high);
            let stroke = stroke(colour, style::FRAME_WIDTH);
            let bar = ErrorBar::new_vertical(
                x,
                low,
                y,
                high,
                stroke,
                units(style::ERROR_BAR_ENDS) as u32,
            );
            (point.error.is_finite() && self.shows((x, y))).then_some(bar)
        };
        let bars: Vec<_> = points.iter().filter_map(bar).collect();
        self.chart.draw_series(bars).map(|_| ())
    }

    fn fill(&mut self, corners: [(f64, f64); 2], colour: RGBColor) -> Drawn {
        let rectangle = Rectangle::new(corners, colour.filled());
        self.chart.draw_series([rectangle]).map(|_| ())
    }

    /// An arrow, which plotters does not have, between two points of axes with equal units.
    fn arrow(&mut self, points: &[(f64, f64)], stroke: ShapeStyle) -> Drawn {
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
