//! Draws a figure on any plotters backend.

use plotters::style::RGBColor;
use plotters::style::text_anchor::HPos;
use plotters_backend::DrawingBackend;

use super::axis::{self, Range, Shown};
use super::canvas::{Canvas, Drawn, TextAt};
use super::chart;
use super::figure::{Figure, Panel};
use super::font::Typeface;
use super::legend::{self, Entry};
use super::polyline;
use super::series::{Kind, Point, Series};
use super::style::{self, Look};

const LEFT: f64 = 66.0;
const RIGHT: f64 = style::WIDTH - 12.0;
const LEGEND_LEFT: f64 = 10.0;
const MARGIN: f64 = 10.0;
const TITLE: f64 = 29.0;
const FREQUENCY_AXIS: f64 = 46.0;
const TICK: f64 = 5.0;
const FREQUENCY_LABEL: &str = "Actuation frequency ω (rad/s)";

fn panel_height(figure: &Figure) -> f64 {
    match figure.panels.len() {
        1 => 230.0,
        2 => 190.0,
        _ => 150.0,
    }
}

fn legend_height(entries: &[Entry]) -> f64 {
    let rows = entries.iter().map(|entry| entry.row + 1).max().unwrap_or(0);
    rows as f64 * legend::ROW
}

/// Width and height of a figure, px.
pub fn size(figure: &Figure, font: Typeface) -> (f64, f64) {
    let entries = entries(figure, font);
    if !figure.charts.is_empty() {
        let (width, height) = chart::size(&figure.charts, figure.layout);
        return (width, top(&entries) + height);
    }
    let panels = figure.panels.len() as f64 * (TITLE + panel_height(figure));
    (style::WIDTH, MARGIN + legend_height(&entries) + panels + FREQUENCY_AXIS)
}

/// The legend above all panels; panels that have their own have none.
fn entries(figure: &Figure, font: Typeface) -> Vec<Entry> {
    let right = match figure.charts.is_empty() {
        true => RIGHT,
        false if chart::have_own_legends(&figure.charts, figure.layout, font) => return Vec::new(),
        false => chart::size(&figure.charts, figure.layout).0 - MARGIN,
    };
    legend::lay_out(figure.samples(), font, LEGEND_LEFT, right)
}

/// Where the panels of a figure with charts begin.
fn top(entries: &[Entry]) -> f64 {
    if entries.is_empty() { 0.0 } else { MARGIN + legend_height(entries) }
}

/// Where a panel's values are on the figure.
#[derive(Debug, Clone, Copy)]
struct Frame {
    top: f64,
    bottom: f64,
    x: Range,
    y: Range,
}

impl Frame {
    fn x(&self, omega_rad_s: f64) -> f64 {
        LEFT + (omega_rad_s - self.x.low) / (self.x.high - self.x.low) * (RIGHT - LEFT)
    }

    fn y(&self, value: f64) -> f64 {
        let part = (value - self.y.low) / (self.y.high - self.y.low);
        self.bottom - part * (self.bottom - self.top)
    }

    fn at(&self, point: &Point) -> (f64, f64) {
        (self.x(point.omega_rad_s), self.y(point.value))
    }

    fn shows(&self, value: f64) -> bool {
        (self.y.low..=self.y.high).contains(&value)
    }
}

/// Draws the whole figure.
///
/// # Errors
/// The backend fails.
pub fn draw<B: DrawingBackend>(figure: &Figure, canvas: &mut Canvas<'_, B>) -> Drawn<B> {
    canvas.fill((0.0, 0.0), size(figure, canvas.font), style::PAPER)?;
    let entries = entries(figure, canvas.font);
    for entry in &entries {
        let y = MARGIN + entry.row as f64 * legend::ROW + legend::ROW / 2.0;
        legend::draw(&entry.sample, entry.x, y, canvas)?;
    }
    if !figure.charts.is_empty() {
        return chart::draw(&figure.charts, figure.layout, top(&entries), canvas);
    }
    let omegas: Vec<f64> = figure
        .panels
        .iter()
        .flat_map(|panel| panel.series.iter().flat_map(Series::points))
        .map(|point| point.omega_rad_s)
        .collect();
    let x = axis::horizontal(&omegas);
    let mut top = MARGIN + legend_height(&entries) + TITLE;
    for (i, panel) in figure.panels.iter().enumerate() {
        let y = axis::vertical(&shown(panel), panel.from_zero);
        let bottom = top + panel_height(figure);
        let frame = Frame { top, bottom, x, y };
        draw_panel(panel, frame, canvas)?;
        let letter = (b'a' + i as u8) as char;
        let title = match figure.panels.len() {
            1 => panel.quantity.title().to_owned(),
            _ => format!("({letter}) {}", panel.quantity.title()),
        };
        draw_title(&title, panel, frame, canvas)?;
        top = bottom + TITLE;
    }
    draw_frequency_axis(x, top - TITLE, canvas)
}

fn shown(panel: &Panel) -> Shown {
    let mut shown = Shown::default();
    for series in &panel.series {
        for point in series.points() {
            let error = point.error.unwrap_or(0.0);
            match series.kind {
                Kind::Measured => {
                    shown.measured.extend([point.value - error, point.value + error]);
                }
                Kind::Model => shown.modelled.push(point.value),
            }
        }
    }
    shown
}

fn draw_panel<B: DrawingBackend>(
    panel: &Panel,
    frame: Frame,
    canvas: &mut Canvas<'_, B>,
) -> Drawn<B> {
    for (value, label) in axis::ticks(frame.y, 5.0) {
        let y = frame.y(value);
        canvas.line(&[(LEFT, y), (RIGHT, y)], style::GRID, style::FRAME_WIDTH)?;
        canvas.line(&[(LEFT - TICK, y), (LEFT, y)], style::INK, style::FRAME_WIDTH)?;
        let at = text_at(LEFT - TICK - 3.0, y + 0.36 * style::SMALL_TEXT, HPos::Right);
        canvas.text(&label, TextAt { em: style::SMALL_TEXT, ..at })?;
    }
    for (omega, _) in axis::ticks(frame.x, 7.0) {
        let x = frame.x(omega);
        canvas.line(&[(x, frame.top), (x, frame.bottom)], style::GRID, style::FRAME_WIDTH)?;
        canvas.line(
            &[(x, frame.bottom), (x, frame.bottom + TICK)],
            style::INK,
            style::FRAME_WIDTH,
        )?;
    }
    let middle = (frame.top + frame.bottom) / 2.0;
    canvas.text_upwards(panel.quantity.axis_label(), text_at(17.0, middle, HPos::Center))?;
    // From the middle of a side and back to it, so that every corner is joined.
    let side = (LEFT, middle);
    let (top, bottom) = ((LEFT, frame.top), (LEFT, frame.bottom));
    let corners = [side, top, (RIGHT, frame.top), (RIGHT, frame.bottom), bottom, side];
    canvas.line(&corners, style::INK, style::FRAME_WIDTH)?;
    // Models first, so that measurements lie on top of them.
    for kind in [Kind::Model, Kind::Measured] {
        for series in panel.series.iter().filter(|series| series.kind == kind) {
            draw_series(series, frame, canvas)?;
        }
    }
    Ok(())
}

fn draw_series<B: DrawingBackend>(
    series: &Series,
    frame: Frame,
    canvas: &mut Canvas<'_, B>,
) -> Drawn<B> {
    match series.look {
        Look::Line { colour, dash } => {
            for run in &series.runs {
                let line: Vec<_> = run.iter().map(|point| frame.at(point)).collect();
                for part in polyline::clip(&line, frame.top, frame.bottom) {
                    for dash in polyline::dashes(&part, dash) {
                        canvas.line(&dash, colour, style::LINE_WIDTH)?;
                    }
                }
            }
        }
        Look::Marker { colour, shape, filled } => {
            for point in series.points().filter(|point| frame.shows(point.value)) {
                let (x, y) = frame.at(point);
                if let Some(error) = point.error {
                    let (low, high) = (frame.y(point.value - error), frame.y(point.value + error));
                    canvas.error_bar(x, low, high, colour)?;
                }
                canvas.marker((x, y), colour, shape, filled)?;
            }
        }
    }
    Ok(())
}

/// The panel's title, and at its right what lies beyond the panel.
fn draw_title<B: DrawingBackend>(
    title: &str,
    panel: &Panel,
    frame: Frame,
    canvas: &mut Canvas<'_, B>,
) -> Drawn<B> {
    let y = frame.top - 7.0;
    canvas.text(title, text_at(LEFT, y, HPos::Left))?;
    let beyond: Vec<(String, RGBColor)> = panel
        .series
        .iter()
        .filter_map(|series| beyond(series, panel, frame).zip(Some(series.look.colour())))
        .collect();
    let (note, colour) = match beyond.as_slice() {
        [] => return Ok(()),
        [(note, colour)] => (note.clone(), *colour),
        several => (format!("{} models lie above", several.len()), style::INK),
    };
    let at = text_at(RIGHT, y, HPos::Right);
    canvas.text(&note, TextAt { em: style::SMALL_TEXT, colour, ..at })
}

/// How far a series goes above the panel, if it does.
fn beyond(series: &Series, panel: &Panel, frame: Frame) -> Option<String> {
    let above = series.points().filter(|point| point.value > frame.y.high);
    let highest = above.map(|point| point.value).fold(f64::NAN, f64::max);
    let unit = panel.quantity.unit();
    let digits = usize::from(highest < 100.0) + 2 * usize::from(highest < 1.0);
    highest.is_finite().then(|| format!("{} above, up to {highest:.digits$}{unit}", series.label))
}

fn draw_frequency_axis<B: DrawingBackend>(
    x: Range,
    bottom: f64,
    canvas: &mut Canvas<'_, B>,
) -> Drawn<B> {
    let frame = Frame { top: bottom, bottom, x, y: Range { low: 0.0, high: 1.0 } };
    for (omega, label) in axis::ticks(x, 7.0) {
        let at = text_at(frame.x(omega), bottom + TICK + 12.0, HPos::Center);
        canvas.text(&label, TextAt { em: style::SMALL_TEXT, ..at })?;
    }
    let at = text_at((LEFT + RIGHT) / 2.0, bottom + FREQUENCY_AXIS - 10.0, HPos::Center);
    canvas.text(FREQUENCY_LABEL, at)
}

fn text_at(x: f64, y: f64, align: HPos) -> TextAt {
    TextAt { x, y, em: style::TEXT, colour: style::INK, align }
}
