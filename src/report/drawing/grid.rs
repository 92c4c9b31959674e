//! Where the panels of a figure are and how large.

use super::axis::{Axis, Range, Scale};
use super::figure::{Figure, Layout, Panel};
use super::style::{WIDE, WIDTH};
use super::{legend, text};

/// Room around a panel's frame for its title, ticks and labels, px.
pub const LEFT: f64 = 66.0;
pub const RIGHT: f64 = 10.0;
pub const TOP: f64 = 30.0;
pub const BOTTOM: f64 = 42.0;
/// The same below panels that share the horizontal axis of the last one.
const SHARED_BOTTOM: f64 = 4.0;
/// Around the figure's legend, px.
const MARGIN: f64 = 10.0;

/// A panel and its part of the figure.
pub struct Cell<'f> {
    pub panel: &'f Panel,
    /// The panel's, with its letter where there are several.
    pub title: String,
    pub left: f64,
    pub top: f64,
    pub width: f64,
    /// Of the panel's frame.
    pub inner_height: f64,
    pub has_x_labels: bool,
    pub x: Axis,
    pub y: Axis,
}

/// A figure's parts.
pub struct Grid<'f> {
    pub width: f64,
    pub height: f64,
    /// The legend of all panels, unless they have their own.
    pub entries: Vec<legend::Entry>,
    pub has_own_legends: bool,
    pub cells: Vec<Cell<'f>>,
}

impl Cell<'_> {
    pub fn inner_width(&self) -> f64 {
        self.width - LEFT - RIGHT
    }

    pub fn bottom(&self) -> f64 {
        if self.has_x_labels { BOTTOM } else { SHARED_BOTTOM }
    }

    fn height(&self) -> f64 {
        TOP + self.inner_height + self.bottom()
    }
}

impl<'f> Grid<'f> {
    pub fn new(figure: &'f Figure) -> Self {
        let (panels, layout) = (&figure.panels, figure.layout);
        let (columns, inner_height) = match (layout, panels.len()) {
            (Layout::Stack, 0..=1) => (1, 230.0),
            (Layout::Stack, 2) => (1, 180.0),
            (Layout::Stack, _) => (1, 140.0),
            (Layout::Pairs, _) => (2, 163.0),
            (Layout::Grid, 0..=1) => (1, 218.0),
            (Layout::Grid, 2 | 4) => (2, 143.0),
            (Layout::Grid, _) => (3, 143.0),
        };
        let width = if columns == 3 || layout == Layout::Pairs { WIDE } else { WIDTH };
        let has_own_legends = layout == Layout::Stack && have_own_legends(panels);
        let entries = match has_own_legends {
            true => Vec::new(),
            false => legend::lay_out(figure.samples(), MARGIN, width - MARGIN),
        };
        let rows = entries.iter().map(|entry| entry.row + 1).max();
        let mut top = rows.map_or(0.0, |rows| MARGIN + rows as f64 * legend::ROW);
        let first = panels.first();
        let is_shared = layout == Layout::Stack
            && panels.iter().all(|panel| first.is_some_and(|first| first.x_label == panel.x_label));
        let all_xs: Vec<f64> = panels.iter().flat_map(Panel::xs).collect();
        let mut lettered = figure.lettered();
        let mut cells = Vec::new();
        for row in panels.chunks(columns) {
            let is_wide = row.len() == 1 && columns < 3;
            let width = if is_wide { width } else { width / columns as f64 };
            let start = cells.len();
            for (nth, (letter, panel)) in lettered.by_ref().take(row.len()).enumerate() {
                let inner_width = width - LEFT - RIGHT;
                let xs = panel.xs();
                let xs = if is_shared { &all_xs } else { &xs };
                let inner_height = match panel.x_scale {
                    Scale::Equal if is_wide => map_height(xs, &panel.ys(), inner_width),
                    _ => inner_height,
                };
                let (x, y) = axes(panel, xs, inner_width, inner_height);
                let title = match panels.len() {
                    1 => panel.title.clone(),
                    _ => format!("({letter}) {}", panel.title),
                };
                let left = nth as f64 * width;
                let has_x_labels = !is_shared || start + 1 == panels.len();
                cells.push(Cell {
                    panel,
                    title,
                    left,
                    top,
                    width,
                    inner_height,
                    has_x_labels,
                    x,
                    y,
                });
            }
            top += cells[start..].iter().map(Cell::height).fold(0.0, f64::max);
        }
        let height = (top + 6.0).round();
        Self { width, height, entries, has_own_legends, cells }
    }

    /// Height of the middle of a legend's row, px.
    pub fn row_middle(row: usize) -> f64 {
        MARGIN + (row as f64 + 0.5) * legend::ROW
    }
}

/// Whether every panel has beside its title what its lines are: where panels above one another
/// show different things, and their titles leave room.
fn have_own_legends(panels: &[Panel]) -> bool {
    let has_room = |panel: &Panel| {
        let taken = text::width(&panel.title) + 30.0 + legend::row_width(&panel.samples());
        panel.beyond.is_empty() && taken < WIDTH - LEFT - RIGHT
    };
    let differ = panels.windows(2).any(|pair| pair[0].samples() != pair[1].samples());
    differ && panels.iter().all(has_room)
}

/// Height of the frame of a map that is as wide as the figure: not more than it needs, and not as
/// high as wide.
fn map_height(xs: &[f64], ys: &[f64], width: f64) -> f64 {
    const LEAST: f64 = 110.0;
    let span = |values: &[f64]| Range::of(values.iter().copied()).map_or(f64::NAN, Range::span);
    let needed = 1.15 * width * span(ys) / span(xs);
    if needed.is_finite() { needed.clamp(LEAST, 0.6 * width) } else { LEAST }
}

/// A panel's axes, with as many ticks as have room for their labels.
fn axes(panel: &Panel, xs: &[f64], width: f64, height: f64) -> (Axis, Axis) {
    let mut x = Axis::new(xs, None, panel.x_scale);
    let mut y = Axis::new(&panel.ys(), panel.shown, panel.y_scale);
    if panel.x_scale == Scale::Equal {
        Axis::equalise(&mut x, &mut y, width, height);
    }
    let have_room = |x: &Axis| {
        let widest = x.ticks().iter().map(|tick| text::width(&x.label(*tick))).fold(0.0, f64::max);
        let apart = x.ticks().windows(2).map(|pair| pair[1] - pair[0]);
        let apart = apart.fold(f64::INFINITY, f64::min) / x.range().span() * width;
        apart > widest + 0.6 * text::EM
    };
    x.set_ticks(((width / 45.0) as usize).max(3) + 1, have_room);
    y.set_ticks((height / 28.0) as usize + 1, |_| true);
    (x, y)
}
