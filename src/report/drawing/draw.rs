//! Draws a figure.

use plotters::chart::ChartBuilder;
use plotters::style::TRANSPARENT;
use plotters::style::text_anchor::HPos;

use super::figure::Layer;
use super::frame::{Area, Drawn, Frame};
use super::grid::{BOTTOM, Cell, Grid, LEFT, MARGIN, RIGHT, TOP};
use super::legend::{Entry, ROW, SAMPLE_GAP};
use super::style::{self, Look, SAMPLE, stroke, units};

const TICK: f64 = 4.0;

/// Draws a figure with its legend onto an area of the grid's size.
pub fn draw(grid: Grid<'_>, area: &Area<'_>) -> Drawn {
    area.fill(&style::PAPER)?;
    draw_legend(&grid.legend, MARGIN, area)?;
    grid.cells.into_iter().try_for_each(|cell| draw_panel(cell, area))
}

/// Draws the samples and texts of a legend from the height `top` on.
fn draw_legend(entries: &[Entry], top: f64, area: &Area<'_>) -> Drawn {
    let frame = Frame::of_pixels(area);
    entries.iter().try_for_each(|Entry { sample, x, row }| {
        let (middle, y) = (x + SAMPLE / 2.0, top + (*row as f64 + 0.5) * ROW);
        let points = sample.points.iter().map(|of| (middle + of.x, y + of.y, of.error));
        frame.draw(&Layer::with_errors(&sample.name, points, sample.look))?;
        write(area, &sample.name, HPos::Left, (x + SAMPLE + SAMPLE_GAP, y + 0.36 * style::EM))
    })
}

/// Writes text above a baseline, px.
fn write(area: &Area<'_>, text: &str, align: HPos, (x, baseline): (f64, f64)) -> Drawn {
    area.draw_text(text, &style::text_style(align), (units(x), units(baseline - style::ASCENT)))
}

fn draw_panel(cell: Cell<'_>, figure: &Area<'_>) -> Drawn {
    let height = TOP + cell.inner_height + cell.bottom;
    let (from, size) = ([cell.left, cell.top].map(units), [cell.width, height].map(units));
    let area = figure.clone().shrink(from.into(), size.into());
    let (panel, right) = (cell.panel, cell.width - RIGHT);
    write(&area, &cell.title, HPos::Left, (LEFT, TOP - 8.0))?;
    write(&area, &panel.beyond, HPos::Right, (right, TOP - 8.0))?;
    draw_legend(&cell.legend, TOP - 12.0 - 0.5 * ROW, &area)?;
    let (across, up) = (cell.x.range.span(), cell.y.range.span());
    let pixel = (across / (right - LEFT), up / cell.inner_height);
    let labels = if cell.bottom == BOTTOM { BOTTOM - 5.0 } else { 0.0 };
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
    let Frame { x, y, .. } = frame;
    let middle = 0.5 * (y.low + y.high);
    let xs = [x.low, x.low, x.high, x.high, x.low, x.low];
    let ys = [middle, y.low, y.low, y.high, y.high, middle];
    frame.path(xs.into_iter().zip(ys).collect(), style::SOLID, ink)?;
    others.into_iter().try_for_each(|layer| frame.draw(layer))?;
    for (note, row) in panel.notes.iter().zip(1..) {
        let baseline = TOP + f64::from(row) * 1.3 * style::EM + 2.0;
        write(&area, note, HPos::Right, (right - 7.0, baseline))?;
    }
    Ok(())
}
