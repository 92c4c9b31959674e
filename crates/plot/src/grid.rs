//! Layout of a figure: positions and sizes of its panels.

use super::axis::{Axis, Range, Scale};
use super::figure::{Figure, Layout, Panel};
use super::legend;
use super::style::{self, WIDE, WIDTH};

/// Space to the left of a panel's frame, px.
pub(crate) const LEFT: f64 = 66.0;
/// Part of [`LEFT`] that is reserved for the tick labels, px.
pub(crate) const TICK_LABELS: f64 = 46.0;
/// Space to the right of a panel's frame, px.
pub(crate) const RIGHT: f64 = 10.0;
/// Space above a panel's frame, px.
pub(crate) const TOP: f64 = 30.0;
/// Space below a panel's frame, px.
pub(crate) const BOTTOM: f64 = 42.0;
/// Space below a panel that shares the horizontal axis of the last panel, px.
const SHARED_BOTTOM: f64 = 7.0;
/// Minimum width of a panel that has others beside it, px.
const MIN_WIDTH: f64 = 200.0;
/// Margin around the figure's legend, px.
pub(crate) const MARGIN: f64 = 10.0;
/// Distance of a note from the frame, px.
pub(crate) const NOTE: f64 = 7.0;
/// Minimum distance between a title and the text beside it, px.
const MIN_GAP: f64 = 3.0;

/// Panel with its position and size in the figure, px.
pub(crate) struct Cell<'f> {
    pub panel: &'f Panel,
    /// Title of the panel, shortened to fit, with the panel's letter if there are several panels.
    pub title: String,
    /// Remark about values outside the panel's range; empty if there is no room for it beside the title.
    pub beyond: String,
    /// Notes in the panel, including text that does not fit above it.
    pub notes: Vec<String>,
    pub left: f64,
    pub top: f64,
    pub width: f64,
    /// Height of the panel's frame.
    pub inner_height: f64,
    /// Space below the panel's frame.
    pub bottom: f64,
    pub x: Axis,
    pub y: Axis,
    /// Whether the panel is as wide as the figure, in a figure with several columns of panels.
    pub is_whole: bool,
    /// Legend of the panel; empty unless the panels have their own legends.
    pub legend: Vec<legend::Entry>,
}

/// Layout of a figure, px.
pub(crate) struct Grid<'f> {
    pub columns: usize,
    pub width: f64,
    pub height: f64,
    /// Common legend of all panels; empty if the panels have their own legends.
    pub legend: Vec<legend::Entry>,
    pub cells: Vec<Cell<'f>>,
}

impl<'f> Grid<'f> {
    pub(crate) fn new(figure: &'f Figure) -> Self {
        let panels = &figure.panels;
        let is_stack = figure.layout == Layout::Stack;
        let (columns, width, inner_height) = match (figure.layout, panels.len()) {
            (Layout::Stack, 0..=1) => (1, WIDTH, 230.0),
            (Layout::Stack, 2) => (1, WIDTH, 180.0),
            (Layout::Stack, _) => (1, WIDTH, 140.0),
            (Layout::Pairs, _) => (2, WIDE, 163.0),
            (Layout::Grid, 0..=1) => (1, WIDTH, 218.0),
            (Layout::Grid, 2 | 4) => (2, WIDTH, 143.0),
            (Layout::Grid, _) => (3, WIDE, 143.0),
        };
        let whole_width = figure.print.width().unwrap_or(width);
        let columns = columns.min((whole_width / MIN_WIDTH) as usize).max(1);
        let has_own_legends = is_stack && has_own_legends(panels, whole_width);
        let samples = if has_own_legends { Vec::new() } else { figure.samples() };
        // A single sample needs no legend.
        let legend = if samples.len() < 2 {
            Vec::new()
        } else {
            legend::lay_out(samples, MARGIN, whole_width - MARGIN)
        };
        let rows = legend.iter().map(|entry| entry.row + 1).max();
        let mut top = rows.map_or(0.0, |rows| MARGIN + rows as f64 * legend::ROW);
        let is_shared = is_stack && panels.windows(2).all(|two| two[0].x_label == two[1].x_label);
        let all_xs: Vec<f64> = panels.iter().flat_map(Panel::xs).collect();
        let mut cells: Vec<Cell> = Vec::new();
        for (nth, (letter, panel)) in figure.lettered().enumerate() {
            let column = nth % columns;
            let is_wide = column == 0 && nth + 1 == panels.len() && columns < 3;
            let width = if is_wide { whole_width } else { whole_width / columns as f64 };
            if column == 0 && nth > 0 {
                let row = &cells[nth - columns..];
                top += row.iter().map(Cell::height).fold(0.0, f64::max);
            }
            let right = width - RIGHT;
            let xs = if is_shared { all_xs.clone() } else { panel.xs() };
            let inner_height = match panel.x_scale {
                Scale::Equal if is_wide || columns == 1 => map_height(panel, &xs, right - LEFT),
                _ => inner_height,
            };
            let (x, y) = axes(panel, &xs, right - LEFT, inner_height);
            let has_x_labels = !is_shared || nth + 1 == panels.len();
            let bottom = if has_x_labels { BOTTOM } else { SHARED_BOTTOM };
            let letter = if panels.len() > 1 { format!("({letter}) ") } else { String::new() };
            let (title, beyond, notes) = fit_title(letter + &panel.title, panel, right - LEFT);
            let samples = if has_own_legends { panel.samples() } else { Vec::new() };
            let from = right - legend::row_width(&samples);
            let legend = legend::lay_out(samples, from, right);
            let left = column as f64 * width;
            let is_whole = is_wide && columns > 1;
            cells.push(Cell {
                panel,
                title,
                beyond,
                notes,
                left,
                top,
                width,
                inner_height,
                bottom,
                x,
                y,
                is_whole,
                legend,
            });
        }
        let height = (top + cells.last().map_or(0.0, Cell::height) + 6.0).round();
        Self { columns, width: whole_width, height, legend, cells }
    }
}

impl Cell<'_> {
    fn height(&self) -> f64 {
        TOP + self.inner_height + self.bottom
    }
}

/// Returns whether stacked panels get their own legends: they do if they show different layers and their
/// titles leave room.
fn has_own_legends(panels: &[Panel], whole_width: f64) -> bool {
    let are_equal = panels.windows(2).all(|two| two[0].samples() == two[1].samples());
    let have_room = panels.iter().all(|panel| {
        let texts = style::text_width(&panel.title) + legend::row_width(&panel.samples());
        panel.beyond.is_empty() && texts + 30.0 < whole_width - LEFT - RIGHT
    });
    !are_equal && have_room
}

/// Returns the title of a panel, the remark about values outside its range, and its notes. Text that is too
/// long for the line above the panel (`room` px) becomes a note; a title is split at its comma.
fn fit_title(mut title: String, panel: &Panel, room: f64) -> (String, String, Vec<String>) {
    let mut notes = panel.notes.clone();
    if style::text_width(&title) > room
        && let Some((short, rest)) = title.split_once(", ")
    {
        notes.insert(0, rest.to_owned());
        title = short.to_owned();
    }
    let beyond = &panel.beyond;
    let width = style::text_width(&title) + MIN_GAP + style::text_width(beyond);
    if beyond.is_empty() || width <= room {
        return (title, beyond.clone(), notes);
    }
    notes.push(legend::shorten(beyond, room - 2.0 * NOTE));
    (title, String::new(), notes)
}

/// Returns the height (px) of the frame of a map (a panel with the same scale on both axes) that is as wide
/// as the figure: the height that the map needs, within limits. `width` is the width of the frame, px.
fn map_height(panel: &Panel, xs: &[f64], width: f64) -> f64 {
    const MIN_HEIGHT: f64 = 110.0;
    let needed = 1.15 * width * span(&panel.ys()) / span(xs);
    let max_height = MIN_HEIGHT.max(0.6 * width);
    if needed.is_finite() { needed.clamp(MIN_HEIGHT, max_height) } else { MIN_HEIGHT }
}

/// Returns the difference between the largest and the smallest value; NaN if there are none.
fn span(values: &[f64]) -> f64 {
    Range::enclosing(values.iter().copied()).map_or(f64::NAN, Range::span)
}

/// Returns the axes of a panel, with as many ticks as have room for their labels.
fn axes(panel: &Panel, xs: &[f64], width: f64, height: f64) -> (Axis, Axis) {
    let mut x = Axis::new(xs, None, panel.x_scale).named(&panel.x_names);
    let mut y = Axis::new(&panel.ys(), panel.shown, panel.y_scale);
    if panel.x_scale == Scale::Equal {
        Axis::equalise(&mut x, &mut y, width, height);
    }
    x.set_ticks(((width / 45.0) as usize).max(3) + 1, |x| {
        let distances = x.ticks.windows(2).map(|pair| pair[1] - pair[0]);
        let distance = distances.fold(f64::INFINITY, f64::min) / x.range.span() * width;
        distance > x.label_width() + 0.6 * style::EM
    });
    // Tick labels must not extend beyond the panel's edge.
    let half = 0.5 * x.label_width();
    let per_px = x.range.span() / width;
    let last = x.range.high - (half - RIGHT).max(0.0) * per_px;
    x.ticks.retain(|tick| *tick <= last);
    y.set_ticks((height / 28.0) as usize + 1, |y| {
        y.ticks.len() <= 2 || y.label_width() <= TICK_LABELS
    });
    (x, y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_title_that_is_too_long_continues_in_the_panel() {
        let title = "Path of the middle link, d = 472.3 \u{b1} 1.1 mm";
        let width = style::text_width(title);
        let panel = Panel { notes: vec!["a note".to_owned()], ..Panel::default() };
        let fit = |room: f64| fit_title(title.to_owned(), &panel, room);
        assert_eq!(fit(width), (title.to_owned(), String::new(), panel.notes.clone()));
        let (short, beside, below) = fit(0.7 * width);
        assert_eq!([&short, &beside], ["Path of the middle link", ""]);
        assert_eq!(below, ["d = 472.3 \u{b1} 1.1 mm", "a note"]);
    }

    #[test]
    fn a_remark_about_values_outside_a_panel_does_not_overlap_its_title() {
        let beyond = "skid to \u{2212}100 %".to_owned();
        let room = style::text_width("(c) d") + MIN_GAP + style::text_width(&beyond);
        let panel = Panel { beyond, notes: vec!["a note".to_owned()], ..Panel::default() };
        let fit = |room: f64| fit_title("(c) d".to_owned(), &panel, room);
        assert_eq!(fit(room), ("(c) d".to_owned(), panel.beyond.clone(), panel.notes.clone()));
        let (title, beside, below) = fit(room - 1.0);
        assert_eq!([&title, &beside], ["(c) d", ""]);
        assert_eq!(below, ["a note", &panel.beyond]);
        let (_, _, below) = fit(0.6 * room);
        assert!(below[1].starts_with("skid") && below[1].ends_with('\u{2026}'), "{below:?}");
        assert!(style::text_width(&below[1]) <= 0.6 * room - 2.0 * NOTE);
    }

    #[test]
    fn a_narrow_axis_has_more_than_one_number() {
        let panel = Panel { x_scale: Scale::Equal, ..Panel::default() };
        let (x, _) = axes(&panel, &[-30.0, 30.0], 172.0, 110.0);
        assert!(x.ticks.len() > 1, "{x:?}");
    }
}
