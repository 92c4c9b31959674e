//! Small panels side by side, each with its own axes.

use plotters::style::RGBColor;
use plotters::style::text_anchor::HPos;
use plotters_backend::DrawingBackend;

use super::axis::{self, Range};
use super::canvas::{Canvas, Drawn, TextAt};
use super::style;

const LEFT: f64 = 66.0;
const RIGHT: f64 = 10.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 42.0;
const TICK: f64 = 4.0;
const DOT: f64 = 1.7;
/// Widths of the characters of a tick's label are at most this part of its height.
const DIGIT_EM: f64 = 0.6;
/// From this ratio of its ends on an axis of positive values is logarithmic.
const LOGARITHMIC: f64 = 5.0;
const MARGIN: f64 = 0.05;

/// One of the things that a panel shows.
#[derive(Debug, Clone)]
pub enum Layer {
    /// A line through points, which are marked.
    Line { name: String, points: Vec<(f64, f64)>, colour: RGBColor },
    /// Points alone.
    Dots { name: String, points: Vec<(f64, f64)>, colour: RGBColor },
    /// One point that stands out.
    Mark { name: String, point: (f64, f64) },
    /// A dashed line across the panel at a height.
    Level { name: String, y: f64 },
    /// A shaded interval of the horizontal axis; an open side goes on to the panel's.
    Band { name: String, from: Option<f64>, to: Option<f64> },
}

/// One panel.
#[derive(Debug, Clone)]
pub struct Chart {
    pub title: String,
    pub x_label: String,
    pub y_label: String,
    pub layers: Vec<Layer>,
    /// The largest value that the vertical axis has to show, if not all of them.
    pub up_to: Option<f64>,
    /// Whether the horizontal axis counts, so that it is never logarithmic.
    pub counts: bool,
}

/// Values along an axis: where they are between its ends.
#[derive(Debug, Clone, Copy)]
struct Scale {
    is_logarithmic: bool,
    range: Range,
}

impl Scale {
    fn of(values: &[f64], up_to: Option<f64>, counts: bool) -> Self {
        let most = up_to.unwrap_or(f64::INFINITY);
        let shown = values.iter().copied().filter(|value| value.is_finite() && *value <= most);
        let low = shown.clone().fold(f64::NAN, f64::min);
        let high = shown.fold(f64::NAN, f64::max);
        let is_logarithmic = !counts && low > 0.0 && high > LOGARITHMIC * low;
        let of = |value: f64| if is_logarithmic { value.log10() } else { value };
        let (low, high) = (of(low), of(high));
        if !(low.is_finite() && high.is_finite()) {
            return Self { is_logarithmic: false, range: Range { low: 0.0, high: 1.0 } };
        }
        // What is all but one value is not spread over the axis.
        let span = (high - low).max(1e-3 * high.abs()).max(1e-12);
        let margin = MARGIN * span + 0.5 * (span - (high - low));
        let range = Range { low: low - margin, high: high + margin };
        Self { is_logarithmic, range }
    }

    /// 0 at the axis' start and 1 at its end.
    fn part(&self, value: f64) -> f64 {
        let value = if self.is_logarithmic { value.log10() } else { value };
        (value - self.range.low) / (self.range.high - self.range.low)
    }

    fn ticks(&self, about: f64) -> Vec<(f64, String)> {
        if !self.is_logarithmic {
            return axis::ticks(self.range, about);
        }
        let Range { low, high } = self.range;
        let decades = (low.floor() as i32)..=(high.ceil() as i32);
        let within = |factors: &[f64]| -> Vec<f64> {
            let all = decades
                .clone()
                .flat_map(|power| factors.iter().map(move |factor| factor * 10_f64.powi(power)));
            all.filter(|value| (low..=high).contains(&value.log10())).collect()
        };
        let fine = within(&[1.0, 2.0, 5.0]);
        let ticks = if fine.len() as f64 <= about + 1.0 { fine } else { within(&[1.0]) };
        ticks.into_iter().map(|value| (value, format!("{value}"))).collect()
    }
}

/// Columns of a grid of so many charts.
fn columns(charts: usize) -> usize {
    match charts {
        0..=1 => 1,
        2 | 4 => 2,
        _ => 3,
    }
}

/// Width and height of a grid of charts, px.
pub fn size(charts: &[Chart]) -> (f64, f64) {
    let columns = columns(charts.len());
    let rows = charts.len().div_ceil(columns);
    (style::WIDTH * width_factor(columns), 6.0 + rows as f64 * height(columns))
}

fn width_factor(columns: usize) -> f64 {
    if columns == 3 { 1.4 } else { 1.0 }
}

fn height(columns: usize) -> f64 {
    if columns == 1 { 290.0 } else { 215.0 }
}

/// Draws a grid of charts.
///
/// # Errors
/// The backend fails.
pub fn draw<B: DrawingBackend>(charts: &[Chart], canvas: &mut Canvas<'_, B>) -> Drawn<B> {
    let (width, whole) = size(charts);
    canvas.fill((0.0, 0.0), (width, whole), style::PAPER)?;
    let columns = columns(charts.len());
    for (i, chart) in charts.iter().enumerate() {
        let cell = width / columns as f64;
        let (left, top) = ((i % columns) as f64 * cell, (i / columns) as f64 * height(columns));
        let place = Place {
            left: left + LEFT,
            right: left + cell - RIGHT,
            top: top + TOP,
            bottom: top + height(columns) - BOTTOM,
        };
        let letter = (b'a' + (i % 26) as u8) as char;
        let title = match charts.len() {
            1 => chart.title.clone(),
            _ => format!("({letter}) {}", chart.title),
        };
        draw_chart(chart, &title, place, canvas)?;
    }
    Ok(())
}

#[derive(Debug, Clone, Copy)]
struct Place {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
}

fn draw_chart<B: DrawingBackend>(
    chart: &Chart,
    title: &str,
    place: Place,
    canvas: &mut Canvas<'_, B>,
) -> Drawn<B> {
    let (xs, ys) = extent(chart);
    let (x, y) = (Scale::of(&xs, None, chart.counts), Scale::of(&ys, chart.up_to, false));
    let at_x = |value: f64| place.left + x.part(value) * (place.right - place.left);
    let at_y = |value: f64| place.bottom - y.part(value) * (place.bottom - place.top);
    let text = |x, y, align| TextAt { x, y, em: style::SMALL_TEXT, colour: style::INK, align };
    for layer in &chart.layers {
        if let Layer::Band { from, to, .. } = layer {
            let from = from.map_or(place.left, at_x).clamp(place.left, place.right);
            let to = to.map_or(place.right, at_x).clamp(place.left, place.right);
            canvas.fill((from, place.top), (to, place.bottom), style::BAND)?;
        }
    }
    for (value, label) in y.ticks(4.0) {
        let level = at_y(value);
        canvas.line(
            &[(place.left, level), (place.right, level)],
            style::GRID,
            style::FRAME_WIDTH,
        )?;
        let baseline = level + 0.36 * style::SMALL_TEXT;
        canvas.text(&label, text(place.left - TICK, baseline, HPos::Right))?;
    }
    // As many ticks as have room for their labels.
    let mut about = 4.0;
    let mut ticks = x.ticks(about);
    let room = |ticks: &[(f64, String)]| {
        let width = ticks.iter().map(|(_, label)| label.chars().count()).max().unwrap_or(0) as f64;
        let step = ticks.windows(2).map(|pair| at_x(pair[1].0) - at_x(pair[0].0));
        step.fold(f64::INFINITY, f64::min) > (width + 1.0) * DIGIT_EM * style::SMALL_TEXT
    };
    while !room(&ticks) && about > 1.0 {
        about -= 1.0;
        ticks = x.ticks(about);
    }
    let has_room = room(&ticks);
    for (i, (value, label)) in ticks.iter().enumerate() {
        let across = at_x(*value);
        let (low, high) = ((across, place.bottom), (across, place.bottom + TICK));
        canvas.line(&[low, high], style::INK, style::FRAME_WIDTH)?;
        if has_room || i == 0 {
            let below = place.bottom + TICK + style::SMALL_TEXT;
            canvas.text(label, text(across, below, HPos::Center))?;
        }
    }
    let corners = [
        (place.left, place.top),
        (place.right, place.top),
        (place.right, place.bottom),
        (place.left, place.bottom),
        (place.left, place.top),
    ];
    canvas.line(&corners, style::INK, style::FRAME_WIDTH)?;
    for layer in &chart.layers {
        match layer {
            Layer::Band { .. } => {}
            Layer::Level { y, .. } => {
                let level = at_y(*y);
                if (place.top..=place.bottom).contains(&level) {
                    let ends = [(place.left, level), (place.right, level)];
                    for dash in super::polyline::dashes(&ends, &[6.0, 4.0]) {
                        canvas.line(&dash, style::INK, style::FRAME_WIDTH)?;
                    }
                }
            }
            Layer::Line { points, colour, .. } => {
                let line: Vec<_> = points.iter().map(|(x, y)| (at_x(*x), at_y(*y))).collect();
                for part in super::polyline::clip(&line, place.top, place.bottom) {
                    canvas.line(&part, *colour, 1.5)?;
                }
                for point in line.iter().filter(|point| point.1 >= place.top) {
                    canvas.circle(*point, DOT, *colour)?;
                }
            }
            Layer::Dots { points, colour, .. } => {
                for (x, y) in points {
                    canvas.circle((at_x(*x), at_y(*y)), DOT, *colour)?;
                }
            }
            Layer::Mark { point: (x, y), .. } => {
                let centre = (at_x(*x), at_y(*y));
                canvas.marker(centre, style::INK, style::Shape::Circle, false)?;
            }
        }
    }
    canvas.text(title, text(place.left, place.top - 8.0, HPos::Left))?;
    let middle = (place.left + place.right) / 2.0;
    canvas.text(&chart.x_label, text(middle, place.bottom + 34.0, HPos::Center))?;
    let side = place.left - LEFT + 14.0;
    let middle = (place.top + place.bottom) / 2.0;
    canvas.text_upwards(&chart.y_label, text(side, middle, HPos::Center))
}

/// All values that the axes have to show.
fn extent(chart: &Chart) -> (Vec<f64>, Vec<f64>) {
    let (mut xs, mut ys) = (Vec::new(), Vec::new());
    for layer in &chart.layers {
        match layer {
            Layer::Line { points, .. } | Layer::Dots { points, .. } => {
                xs.extend(points.iter().map(|point| point.0));
                ys.extend(points.iter().map(|point| point.1));
            }
            Layer::Mark { point: (x, y), .. } => {
                xs.push(*x);
                ys.push(*y);
            }
            Layer::Level { y, .. } => ys.push(*y),
            Layer::Band { from, to, .. } => xs.extend(from.iter().chain(to)),
        }
    }
    (xs, ys)
}

impl Chart {
    /// Rows of the figure's CSV: panel, title, layer, x, y.
    pub fn csv(&self, letter: char, field: impl Fn(&str) -> String) -> String {
        let mut csv = String::new();
        let mut row = |name: &str, x: Option<f64>, y: Option<f64>| {
            let number =
                |value: Option<f64>| value.map_or(String::new(), super::figure::csv_number);
            let (title, name) = (field(&self.title), field(name));
            csv.push_str(&format!("{letter},{title},{name},{},{}\n", number(x), number(y)));
        };
        for layer in &self.layers {
            match layer {
                Layer::Line { name, points, .. } | Layer::Dots { name, points, .. } => {
                    points.iter().for_each(|(x, y)| row(name, Some(*x), Some(*y)));
                }
                Layer::Mark { name, point: (x, y) } => row(name, Some(*x), Some(*y)),
                Layer::Level { name, y } => row(name, None, Some(*y)),
                Layer::Band { name, from, to } => {
                    row(&format!("{name}, lower"), *from, None);
                    row(&format!("{name}, upper"), *to, None);
                }
            }
        }
        csv
    }
}
