//! Draws a figure.

use std::collections::BTreeSet;

use plotters::chart::ChartBuilder;
use plotters::coord::cartesian::Cartesian2d;
use plotters::drawing::DrawingArea;
use plotters::element::{Circle, ErrorBar, Rectangle};
use plotters::prelude::SVGBackend;
use plotters::style::text_anchor::HPos;
use plotters::style::{Color, RGBColor, ShapeStyle, TRANSPARENT};

use super::axis::{Axis, Range};
use super::figure::{Layer, Point};
use super::grid::{BOTTOM, Cell, Grid, LEFT, MARGIN, RIGHT, TOP};
use super::legend::{self, Area, Drawn, draw_marker, draw_path};
use super::style::{self, Dash, Look, Shape, stroke, units};

const TICK: f64 = 4.0;
const LINK_WIDTH: f64 = 4.0;
const ARROW_HEAD: f64 = 9.0;
/// Of a bar, in units of the panel.
const SPAN_HEIGHT: f64 = 0.28;
/// Points of a layer that are all drawn, dashed if the line is; more have no room beside each other.
const MOST: usize = 4000;
/// What very many points are kept apart, px.
const APART_AMONG_MANY: f64 = 2.0;
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
    let area_of_points = chart.plotting_area().clone();
    let frame = Frame { area: area_of_points, x: cell.x, y: cell.y, pixel };
    // Bands lie behind the mesh.
    let (bands, others): (Vec<&Layer>, Vec<_>) =
        panel.layers.iter().partition(|layer| matches!(layer.look, Look::Band(_)));
    bands.into_iter().try_for_each(|layer| frame.draw(layer))?;
    let ink = stroke(style::INK, style::FRAME_WIDTH);
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(stroke(style::GRID, style::FRAME_WIDTH))
        .axis_style(ink)
        .label_style(style::text_style(HPos::Center))
        // Plotters centres text by half the height of an x.
        .y_label_offset(units(0.1 * style::EM))
        .set_all_tick_mark_size(units(TICK))
        .x_desc(&panel.x_label)
        .y_desc(&panel.y_label)
        .draw()?;
    // All four sides, where plotters draws two: from the middle of one and back to it, so that
    // every corner is joined.
    let (x, y) = (frame.x.range, frame.y.range);
    let middle = 0.5 * (y.low + y.high);
    let xs = [x.low, x.low, x.high, x.high, x.low, x.low];
    let ys = [middle, y.low, y.low, y.high, y.high, middle];
    frame.path(xs.into_iter().zip(ys).collect(), style::SOLID, ink)?;
    others.into_iter().try_for_each(|layer| frame.draw(layer))?;
    for (note, row) in panel.notes.iter().zip(1..) {
        write(note, HPos::Right, right - 7.0, TOP + f64::from(row) * 1.3 * style::EM + 2.0)?;
    }
    Ok(())
}

/// A panel's frame; lengths and positions are in the axes' coordinates.
struct Frame<'b> {
    area: DrawingArea<SVGBackend<'b>, Cartesian2d<Axis, Axis>>,
    x: Axis,
    y: Axis,
    /// Width and height of a pixel.
    pixel: (f64, f64),
}

impl Frame<'_> {
    /// A position in the axes' coordinates.
    fn at(&self, point: &Point) -> (f64, f64) {
        (self.x.scaled(point.x), self.y.scaled(point.y))
    }

    fn draw(&self, layer: &Layer) -> Drawn {
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
                self.error_bars(
                    &layer.points,
                    colour,
                    (style::FRAME_WIDTH, style::ERROR_BAR_ENDS),
                )?;
                self.markers(&points, (colour, shape, filled))
            }
            Look::Rings => self.markers(&points, (style::INK, Shape::Circle, false)),
            Look::Guides => points.into_iter().take(MOST).try_for_each(|at| {
                let ends = match at {
                    (across, up) if up.is_nan() && x.contains(across) => {
                        [(across, y.low), (across, y.high)]
                    }
                    (_, up) if y.contains(up) => [(x.low, up), (x.high, up)],
                    _ => return Ok(()),
                };
                self.path(ends.into(), style::DASHES, stroke(style::INK, style::FRAME_WIDTH))
            }),
            Look::Bars(colour) => self.error_bars(&layer.points, colour, (style::BAR_WIDTH, 0.0)),
            Look::Band(colour) => {
                let side = |nth: usize, open: f64| {
                    points.get(nth).map_or(open, |(x, _)| if x.is_finite() { *x } else { open })
                };
                let (from, to) = (side(0, x.low).max(x.low), side(1, x.high).min(x.high));
                self.fill([(from, y.high), (to, y.low)], colour)
            }
            Look::Spans(colour) => points.chunks_exact(2).try_for_each(|ends| {
                let [(from, middle), (to, _)] = [ends[0], ends[1]];
                // What is short still has to be seen.
                let to = to.max(from + self.pixel.0);
                let half = 0.5 * SPAN_HEIGHT;
                self.fill([(from, middle + half), (to, middle - half)], colour)
            }),
            Look::Links => {
                let known =
                    points.iter().copied().filter(|at| self.shows(*at)).take(MOST).collect();
                self.path(known, style::SOLID, stroke(style::LINKS, LINK_WIDTH))?;
                self.dots(&points, LINK_WIDTH, style::LINKS)
            }
            Look::Arrow => self.arrow(&points, stroke(style::INK, style::LINE_WIDTH)),
        }
    }

    fn path(&self, points: Vec<(f64, f64)>, dash: Dash, stroke: ShapeStyle) -> Drawn {
        draw_path(&self.area, points, dash, stroke)
    }

    fn curve(&self, points: &[(f64, f64)], colour: RGBColor, dash: Dash) -> Drawn {
        let apart = (APART * self.pixel.0, APART * self.pixel.1);
        let mut parts = visible(points, self.y.range, apart).into_iter();
        parts.try_for_each(|part| {
            let (part, dash) =
                if part.len() > MOST { (extremes(&part), None) } else { (part, dash) };
            self.path(part, dash, stroke(colour, style::LINE_WIDTH))
        })
    }

    /// The points within the panel; of very many those that do not cover each other.
    fn shown(&self, points: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let mut taken = BTreeSet::new();
        let cell = |at: f64, pixel: f64| (at / (APART_AMONG_MANY * pixel)).round() as i64;
        let is_free = |(x, y): &(f64, f64)| {
            points.len() <= MOST || taken.insert((cell(*x, self.pixel.0), cell(*y, self.pixel.1)))
        };
        points.iter().copied().filter(|at| self.shows(*at)).filter(is_free).collect()
    }

    fn shows(&self, (x, y): (f64, f64)) -> bool {
        x.is_finite() && self.y.range.contains(y)
    }

    fn dots(&self, points: &[(f64, f64)], radius: f64, colour: RGBColor) -> Drawn {
        let dot = |at| self.area.draw(&Circle::new(at, units(radius), colour.filled()));
        self.shown(points).into_iter().try_for_each(dot)
    }

    fn markers(&self, points: &[(f64, f64)], marker: (RGBColor, Shape, bool)) -> Drawn {
        let mut shown = self.shown(points).into_iter();
        shown.try_for_each(|at| draw_marker(&self.area, at, marker))
    }

    fn error_bars(&self, points: &[Point], colour: RGBColor, (width, ends): (f64, f64)) -> Drawn {
        let (ends, stroke) = (units(ends) as u32, stroke(colour, width));
        let has_bar = |point: &&Point| point.error > 0.0 && self.shows(self.at(point));
        let points = &points[..points.len().min(MOST)];
        points.iter().filter(has_bar).try_for_each(|point| {
            let (x, y) = self.at(point);
            let low = self.y.scaled(point.y - point.error).max(self.y.range.low);
            let high = self.y.scaled(point.y + point.error).min(self.y.range.high);
            self.area.draw(&ErrorBar::new_vertical(x, low, y, high, stroke, ends))
        })
    }

    fn fill(&self, corners: [(f64, f64); 2], colour: RGBColor) -> Drawn {
        let is_known = corners.iter().all(|(x, y)| x.is_finite() && y.is_finite());
        match is_known {
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

/// The first point and the least and the greatest values of each of so many parts of a line that
/// [`MOST`] points are left.
fn extremes(line: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut left = Vec::new();
    for part in line.chunks(line.len().div_ceil(MOST / 5).max(1)) {
        let by = |of: fn(&(f64, f64)) -> f64| {
            let indices = 0..part.len();
            let order = |a: &usize, b: &usize| of(&part[*a]).total_cmp(&of(&part[*b]));
            [indices.clone().min_by(order), indices.max_by(order)]
        };
        let kept = [by(|at| at.0), by(|at| at.1)].into_iter().flatten().flatten();
        let kept: BTreeSet<usize> = kept.chain([0]).collect();
        left.extend(kept.into_iter().map(|i| part[i]));
    }
    left
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
