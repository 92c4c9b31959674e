//! Draws a figure.

use plotters::chart::ChartBuilder;
use plotters::style::TRANSPARENT;
use plotters::style::text_anchor::HPos;

use super::axis::{Axis, Range};
use super::figure::Layer;
use super::frame::{Area, Drawn, Frame};
use super::grid::{BOTTOM, Cell, Grid, LEFT, MARGIN, NOTE, RIGHT, TICK_LABELS, TOP};
use super::legend::{Entry, ROW, SAMPLE_GAP};
use super::style::{self, Look, SAMPLE, stroke, units};
use crate::svg::{Markup, escaped};

const TICK: f64 = 4.0;

/// Draws the legend and the panels of a figure onto areas of the grid's size.
pub(crate) fn draw(grid: Grid<'_>, [legend, panels]: [&Area<'_>; 2]) -> Drawn {
    draw_legend(&grid.legend, MARGIN, true, legend)?;
    grid.cells.into_iter().try_for_each(|cell| draw_panel(cell, panels))
}

/// Draws the samples and texts of a legend from the height `top` on, each as a group or as a
/// `drawing` of its own.
fn draw_legend(entries: &[Entry], top: f64, are_drawings: bool, area: &Area<'_>) -> Drawn {
    let frame = Frame::of_pixels(area);
    entries.iter().try_for_each(|Entry { sample, name, x, row }| {
        let (middle, y) = (x + SAMPLE / 2.0, top + (*row as f64 + 0.5) * ROW);
        let key = format!("class=\"key\" data-name=\"{}\"", escaped(name));
        let width = SAMPLE + SAMPLE_GAP + style::text_width(&sample.name);
        let (begin, end) = match are_drawings {
            true => drawing(&key, [*x, y - 0.5 * ROW, width, ROW]),
            false => (format!("<g {key}>\n"), "</g>\n".to_owned()),
        };
        area.draw(&Markup(begin))?;
        let points = sample.points.iter().map(|of| (middle + of.x, y + of.y, of.error));
        frame.draw(&Layer::with_errors(&sample.name, points, sample.look))?;
        write(area, &sample.name, HPos::Left, (x + SAMPLE + SAMPLE_GAP, y + 0.36 * style::EM))?;
        area.draw(&Markup(end))
    })
}

/// The begin and the end of a drawing of its own in a part of the figure, px.
fn drawing(attributes: &str, part: [f64; 4]) -> (String, String) {
    let ([x, y, width, height], [left, top, across, down]) = (part, part.map(units));
    let place = format!("x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\"");
    let begin = format!("<svg {attributes} {place} viewBox=\"{left} {top} {across} {down}\">\n");
    (begin, "</svg>\n".to_owned())
}

/// Writes text above a baseline, px.
fn write(area: &Area<'_>, text: &str, align: HPos, (x, baseline): (f64, f64)) -> Drawn {
    area.draw_text(text, &style::text_style(align), (units(x), units(baseline - style::ASCENT)))
}

fn draw_panel(cell: Cell<'_>, figure: &Area<'_>) -> Drawn {
    let height = TOP + cell.inner_height + cell.bottom;
    let (from, size) = ([cell.left, cell.top].map(units), [cell.width, height].map(units));
    let area = figure.clone().shrink(from.into(), size.into());
    // From where to where the axes go in the drawing and in values, for the page's script.
    let axis = |name: &str, ends: [f64; 2], axis: &Axis, label: &str| {
        let ([from, to], Range { low, high }) = (ends.map(units), axis.range);
        let (kind, label) = (u8::from(axis.is_logarithmic), escaped(label));
        format!(" data-{name}=\"{from} {to} {low} {high} {kind} {label}\"")
    };
    let (across, down) = ([LEFT, cell.width - RIGHT], [TOP + cell.inner_height, TOP]);
    let axes = axis("x", across.map(|x| cell.left + x), &cell.x, &cell.panel.x_label)
        + &axis("y", down.map(|y| cell.top + y), &cell.y, &cell.panel.y_label);
    let class = if cell.is_whole { "whole panel" } else { "panel" };
    let part = [cell.left, cell.top, cell.width, height];
    let (begin, end) = drawing(&format!("class=\"{class}\"{axes}"), part);
    area.draw(&Markup(begin))?;
    let (panel, right) = (cell.panel, cell.width - RIGHT);
    write(&area, &cell.title, HPos::Left, (LEFT, TOP - 8.0))?;
    write(&area, &cell.beyond, HPos::Right, (right, TOP - 8.0))?;
    draw_legend(&cell.legend, TOP - 12.0 - 0.5 * ROW, false, &area)?;
    let (across, up) = (cell.x.range.span(), cell.y.range.span());
    let pixel = (across / (right - LEFT), up / cell.inner_height);
    let labels = if cell.bottom == BOTTOM { BOTTOM - 5.0 } else { 0.0 };
    // Values that hardly differ have too many digits for both.
    let y_label = if cell.y.label_width() <= TICK_LABELS { &panel.y_label } else { "" };
    let mut chart = ChartBuilder::on(&area)
        .margin_top(units(TOP))
        .margin_right(units(RIGHT))
        .margin_bottom(units(cell.bottom - labels))
        .margin_left(units(1.0))
        .y_label_area_size(units(LEFT - 1.0))
        .x_label_area_size(units(labels))
        .build_cartesian_2d(cell.x, cell.y)?;
    let frame = Frame::new(chart.plotting_area().clone(), pixel);
    // Bands lie behind the mesh.
    let (bands, others): (Vec<&Layer>, Vec<_>) =
        panel.layers.iter().partition(|layer| matches!(layer.look, Look::Band(_)));
    bands.into_iter().try_for_each(|layer| frame.draw_group(layer))?;
    others.iter().try_for_each(|layer| frame.draw_band(layer))?;
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
        .y_desc(y_label)
        .draw()?;
    // All four sides, where plotters draws two: from the middle of one and back to it, so that
    // every corner is joined.
    let Frame { x, y, .. } = frame;
    let middle = 0.5 * (y.low + y.high);
    let xs = [x.low, x.low, x.high, x.high, x.low, x.low];
    let ys = [middle, y.low, y.low, y.high, y.high, middle];
    frame.path(xs.into_iter().zip(ys).collect(), style::SOLID, ink)?;
    others.into_iter().try_for_each(|layer| frame.draw_group(layer))?;
    for (note, row) in cell.notes.iter().zip(1..) {
        let baseline = TOP + f64::from(row) * 1.3 * style::EM + 2.0;
        write(&area, note, HPos::Right, (right - NOTE, baseline))?;
    }
    area.draw(&Markup(end))
}
