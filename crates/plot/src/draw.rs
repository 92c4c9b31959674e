//! Drawing of the legend and the panels of a figure.

use plotters::chart::ChartBuilder;
use plotters::style::TRANSPARENT;
use plotters::style::text_anchor::HPos;

use super::axis::{Axis, Range};
use super::dodge;
use super::figure::Layer;
use super::frame::{Area, Drawn, Frame};
use super::grid::{BOTTOM, Cell, EDGE, Grid, MARGIN, NOTE, RIGHT, TOP};
use super::legend::{self, Entry, ROW, SAMPLE_GAP};
use super::style::{self, Look, SAMPLE, stroke, units};
use crate::svg::{Markup, escaped};

const TICK: f64 = 4.0;

/// Draws the legend of a figure onto one area and its panels onto another; both areas are as large as the
/// whole figure.
pub(crate) fn draw(grid: Grid<'_>, [legend, panels]: [&Area<'_>; 2]) -> Drawn {
    draw_legend(&grid.legend, MARGIN, true, legend)?;
    grid.cells.into_iter().try_for_each(|cell| draw_panel(cell, panels))
}

/// Draws the entries of a legend (samples of lines and markers, with names) downwards from the vertical position `top`
/// (px). Each entry is an SVG group or, if `are_drawings`, a nested SVG.
fn draw_legend(entries: &[Entry], top: f64, are_drawings: bool, area: &Area<'_>) -> Drawn {
    let frame = Frame::in_pixels(area);
    for Entry { sample, name, x, row } in entries {
        let centre = x + SAMPLE / 2.0;
        let y = top + (*row as f64 + 0.5) * ROW;
        let key = format!("class=\"key\" data-name=\"{}\"", escaped(name));
        let width = SAMPLE + SAMPLE_GAP + style::text_width(&sample.name);
        let (start, end) = if are_drawings {
            nested_svg(&key, [*x, y - 0.5 * ROW, width, ROW])
        } else {
            (format!("<g {key}>\n"), "</g>\n".to_owned())
        };
        area.draw(&Markup(start))?;
        let points = sample.points.iter();
        let points = points.map(|point| (centre + point.x, y + point.y, point.error));
        frame.draw(&Layer::with_errors(&sample.name, points, sample.look))?;
        write(area, &sample.name, HPos::Left, (x + SAMPLE + SAMPLE_GAP, y + 0.36 * style::EM))?;
        area.draw(&Markup(end))?;
    }
    Ok(())
}

/// Returns the start and end tags of a nested SVG; `rectangle` is its left, top, width and height, px.
fn nested_svg(attributes: &str, rectangle: [f64; 4]) -> (String, String) {
    let [x, y, width, height] = rectangle;
    let position = format!("x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\"");
    let [left, top, across, down] = rectangle.map(units);
    let start = format!("<svg {attributes} {position} viewBox=\"{left} {top} {across} {down}\">\n");
    (start, "</svg>\n".to_owned())
}

/// Writes text with the given baseline; `x` is the position of the end or centre of the text that `align` selects. Both
/// positions are in px.
fn write(area: &Area<'_>, text: &str, align: HPos, (x, baseline): (f64, f64)) -> Drawn {
    area.draw_text(text, &style::text_style(align), (units(x), units(baseline - style::ASCENT)))
}

/// Returns the attribute that describes an axis for the report page's script: the positions of its ends in
/// the backend's units, the values there, whether it is logarithmic (0 or 1), and its label.
fn axis_attribute(name: &str, ends_px: [f64; 2], axis: &Axis, label: &str) -> String {
    let [from, to] = ends_px.map(units);
    let Range { low, high } = axis.range;
    let is_logarithmic = u8::from(axis.is_logarithmic);
    format!(" data-{name}=\"{from} {to} {low} {high} {is_logarithmic} {}\"", escaped(label))
}

fn draw_panel(cell: Cell<'_>, figure: &Area<'_>) -> Drawn {
    let Cell { margin, head, .. } = cell;
    let height = head + cell.inner_height + cell.bottom;
    let corner = [cell.left, cell.top].map(units);
    let area = figure.clone().shrink(corner.into(), [cell.width, height].map(units).into());
    let panel = cell.panel;
    let right = cell.width - RIGHT;
    let x_ends = [margin, right].map(|x| cell.left + x);
    let y_ends = [head + cell.inner_height, head].map(|y| cell.top + y);
    let axes = axis_attribute("x", x_ends, &cell.x, &panel.x_label)
        + &axis_attribute("y", y_ends, &cell.y, &panel.y_label);
    let class = if cell.is_whole { "whole panel" } else { "panel" };
    let rectangle = [cell.left, cell.top, cell.width, height];
    let (start, end) = nested_svg(&format!("class=\"{class}\"{axes}"), rectangle);
    area.draw(&Markup(start))?;
    // A title that is wider than its panel extends to the left, over the axis labels.
    let title = legend::shorten(&cell.title, right - EDGE);
    let start = margin.min(right - style::text_width(&title));
    write(&area, &title, HPos::Left, (start, TOP - 8.0))?;
    write(&area, &cell.beyond, HPos::Right, (right, TOP - 8.0))?;
    let legend_top = if head > TOP { TOP - 4.0 } else { TOP - 12.0 - 0.5 * ROW };
    draw_legend(&cell.legend, legend_top, false, &area)?;
    let pixel = (cell.x.range.span() / (right - margin), cell.y.range.span() / cell.inner_height);
    let across = right - margin + 2.0 * (RIGHT - EDGE);
    let up = cell.inner_height + 2.0 * cell.bottom.min(head - EDGE);
    let labels = if cell.bottom == BOTTOM { BOTTOM - 5.0 } else { 0.0 };
    let mut chart = ChartBuilder::on(&area)
        .margin_top(units(head))
        .margin_right(units(RIGHT))
        .margin_bottom(units(cell.bottom - labels))
        .margin_left(units(EDGE))
        .y_label_area_size(units(margin - EDGE))
        .x_label_area_size(units(labels))
        .build_cartesian_2d(cell.x, cell.y)?;
    let frame = Frame::new(chart.plotting_area().clone(), pixel);
    // Bands are drawn behind the grid lines.
    let (bands, others): (Vec<&Layer>, Vec<_>) =
        panel.layers.iter().partition(|layer| matches!(layer.look, Look::Band(_)));
    let shifts = dodge::shifts(&others, |x| frame.x_px(x));
    bands.into_iter().try_for_each(|layer| frame.draw_group(layer, &[]))?;
    others.iter().try_for_each(|layer| frame.draw_band(layer))?;
    let ink = stroke(style::INK, style::FRAME_WIDTH);
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(stroke(style::GRID, style::FRAME_WIDTH))
        .axis_style(ink)
        .label_style(style::text_style(HPos::Center))
        // Plotters centres text vertically by half the height of an x.
        .y_label_offset(units(0.1 * style::EM))
        .set_all_tick_mark_size(units(TICK))
        .x_desc(legend::fit_label(&panel.x_label, across))
        .y_desc(legend::fit_label(cell.y_label, up))
        .draw()?;
    // Plotters draws only two sides of the frame. Draw all four as one path that starts and ends in the
    // middle of a side, so that all corners are joined.
    let Frame { x, y, .. } = frame;
    let midpoint = 0.5 * (y.low + y.high);
    let xs = [x.low, x.low, x.high, x.high, x.low, x.low];
    let ys = [midpoint, y.low, y.low, y.high, y.high, midpoint];
    frame.path(xs.into_iter().zip(ys).collect(), style::SOLID, ink)?;
    let mut drawn = others.into_iter().zip(&shifts);
    drawn.try_for_each(|(layer, shifts)| frame.draw_group(layer, shifts))?;
    for (note, row) in cell.notes.iter().zip(1..) {
        let baseline = head + f64::from(row) * 1.3 * style::EM + 2.0;
        write(&area, note, HPos::Right, (right - NOTE, baseline))?;
    }
    area.draw(&Markup(end))
}
