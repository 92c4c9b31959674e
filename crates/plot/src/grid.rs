//! Where the panels of a figure are and how large.

use super::axis::{Axis, Range, Scale};
use super::figure::{Figure, Layout, Panel};
use super::legend;
use super::style::{self, WIDE, WIDTH};

/// Room around a panel's frame for its title, ticks and labels, px.
pub(crate) const LEFT: f64 = 66.0;
/// Of `LEFT`, for the labels of ticks.
pub(crate) const TICK_LABELS: f64 = 46.0;
pub(crate) const RIGHT: f64 = 10.0;
pub(crate) const TOP: f64 = 30.0;
pub(crate) const BOTTOM: f64 = 42.0;
/// The same below panels that share the horizontal axis of the last one.
const SHARED_BOTTOM: f64 = 7.0;
/// Of a panel that has others beside it, px.
const LEAST_WIDTH: f64 = 200.0;
/// Around the figure's legend, px.
pub(crate) const MARGIN: f64 = 10.0;
/// Between a note and the frame, px.
pub(crate) const NOTE: f64 = 7.0;
/// Least between a title and what stands beside it, px.
const GAP: f64 = 3.0;

/// A panel and its part of the figure, px.
pub(crate) struct Cell<'f> {
    pub panel: &'f Panel,
    /// The panel's, with its letter where there are several, as far as there is room.
    pub title: String,
    /// The panel's, if there is room for it beside the title.
    pub beyond: String,
    /// What there is no room for above the panel, and the panel's own.
    pub notes: Vec<String>,
    pub left: f64,
    pub top: f64,
    pub width: f64,
    /// Of the panel's frame, and below it.
    pub inner_height: f64,
    pub bottom: f64,
    pub x: Axis,
    pub y: Axis,
    /// Whether it is as wide as the figure, where others are not.
    pub is_whole: bool,
    /// The panel's own.
    pub legend: Vec<legend::Entry>,
}

/// A figure's parts and its size, px.
pub(crate) struct Grid<'f> {
    pub columns: usize,
    pub width: f64,
    pub height: f64,
    /// That of all panels, unless they have their own.
    pub legend: Vec<legend::Entry>,
    pub cells: Vec<Cell<'f>>,
}

impl<'f> Grid<'f> {
    pub(crate) fn new(figure: &'f Figure) -> Self {
        let (panels, is_stack) = (&figure.panels, figure.layout == Layout::Stack);
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
        let columns = columns.min((whole_width / LEAST_WIDTH) as usize).max(1);
        let is_same =
            |of: fn(&Panel, &Panel) -> bool| panels.windows(2).all(|two| of(&two[0], &two[1]));
        // Panels above one another have their own legends if they show different things and their
        // titles leave room.
        let has_room = |panel: &Panel| {
            let texts = style::text_width(&panel.title) + legend::row_width(&panel.samples());
            panel.beyond.is_empty() && texts + 30.0 < whole_width - LEFT - RIGHT
        };
        let is_alike = is_same(|a, b| a.samples() == b.samples());
        let has_own_legends = is_stack && !is_alike && panels.iter().all(has_room);
        let legend = match has_own_legends {
            true => Vec::new(),
            // What is alone needs no name.
            false => match figure.samples() {
                samples if samples.len() < 2 => Vec::new(),
                samples => legend::lay_out(samples, MARGIN, whole_width - MARGIN),
            },
        };
        let rows = legend.iter().map(|entry| entry.row + 1).max();
        let mut top = rows.map_or(0.0, |rows| MARGIN + rows as f64 * legend::ROW);
        let is_shared = is_stack && is_same(|a, b| a.x_label == b.x_label);
        let all_xs: Vec<f64> = panels.iter().flat_map(Panel::xs).collect();
        let height = |cell: &Cell| TOP + cell.inner_height + cell.bottom;
        let mut cells: Vec<Cell> = Vec::new();
        for (nth, (letter, panel)) in figure.lettered().enumerate() {
            let column = nth % columns;
            let is_wide = column == 0 && nth + 1 == panels.len() && columns < 3;
            let width = if is_wide { whole_width } else { whole_width / columns as f64 };
            if column == 0 && nth > 0 {
                let row = &cells[nth - columns..];
                top += row.iter().map(height).fold(0.0, f64::max);
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
            let (title, beyond, notes) = titled(letter + &panel.title, panel, right - LEFT);
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
        let height = (top + cells.last().map_or(0.0, height) + 6.0).round();
        Self { columns, width: whole_width, height, legend, cells }
    }
}

/// The title of a panel, what lies beyond it, and its notes: what is too long for the line above the
/// panel goes on below it, a title from its comma.
fn titled(mut title: String, panel: &Panel, room: f64) -> (String, String, Vec<String>) {
    let mut notes = panel.notes.clone();
    if style::text_width(&title) > room
        && let Some((short, rest)) = title.split_once(", ")
    {
        notes.insert(0, rest.to_owned());
        title = short.to_owned();
    }
    let beyond = &panel.beyond;
    let width = style::text_width(&title) + GAP + style::text_width(beyond);
    if beyond.is_empty() || width <= room {
        return (title, beyond.clone(), notes);
    }
    notes.push(legend::shorten(beyond, room - 2.0 * NOTE));
    (title, String::new(), notes)
}

/// Height of the frame of a map that is as wide as the figure: not more than it needs, and not as
/// high as wide.
fn map_height(panel: &Panel, xs: &[f64], width: f64) -> f64 {
    const LEAST: f64 = 110.0;
    let span = |values: &[f64]| Range::of(values.iter().copied()).map_or(f64::NAN, Range::span);
    let needed = 1.15 * width * span(&panel.ys()) / span(xs);
    let most = LEAST.max(0.6 * width);
    if needed.is_finite() { needed.clamp(LEAST, most) } else { LEAST }
}

/// A panel's axes, with as many ticks as have room for their labels.
fn axes(panel: &Panel, xs: &[f64], width: f64, height: f64) -> (Axis, Axis) {
    let mut x = Axis::new(xs, None, panel.x_scale).named(&panel.x_names);
    let mut y = Axis::new(&panel.ys(), panel.shown, panel.y_scale);
    if panel.x_scale == Scale::Equal {
        Axis::equalise(&mut x, &mut y, width, height);
    }
    let have_room = |x: &Axis| {
        let apart = x.ticks.windows(2).map(|pair| pair[1] - pair[0]);
        let apart = apart.fold(f64::INFINITY, f64::min) / x.range.span() * width;
        apart > x.label_width() + 0.6 * style::EM
    };
    x.set_ticks(((width / 45.0) as usize).max(3) + 1, have_room);
    // A label reaches as far as the panel's edge.
    let (half, per_px) = (0.5 * x.label_width(), x.range.span() / width);
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
    fn a_title_that_is_too_long_goes_on_in_the_panel() {
        let title = "Path of the middle link, d = 472.3 \u{b1} 1.1 mm";
        let width = style::text_width(title);
        let panel = Panel { notes: vec!["a note".to_owned()], ..Panel::default() };
        let of = |room: f64| titled(title.to_owned(), &panel, room);
        assert_eq!(of(width), (title.to_owned(), String::new(), panel.notes.clone()));
        let (short, beside, below) = of(0.7 * width);
        assert_eq!([&short, &beside], ["Path of the middle link", ""]);
        assert_eq!(below, ["d = 472.3 \u{b1} 1.1 mm", "a note"]);
    }

    #[test]
    fn what_lies_beyond_a_panel_is_not_written_over_its_title() {
        let beyond = "skid to \u{2212}100 %".to_owned();
        let room = style::text_width("(c) d") + GAP + style::text_width(&beyond);
        let panel = Panel { beyond, notes: vec!["a note".to_owned()], ..Panel::default() };
        let of = |room: f64| titled("(c) d".to_owned(), &panel, room);
        assert_eq!(of(room), ("(c) d".to_owned(), panel.beyond.clone(), panel.notes.clone()));
        let (title, beside, below) = of(room - 1.0);
        assert_eq!([&title, &beside], ["(c) d", ""]);
        assert_eq!(below, ["a note", &panel.beyond]);
        let (_, _, below) = of(0.6 * room);
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
