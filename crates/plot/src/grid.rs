//! Layout of a figure: positions and sizes of its panels.

use super::axis::{Axis, Range, Scale};
use super::figure::{Figure, Layer, Layout, Panel, Print};
use super::legend;
use super::render::SYNTHETIC_ROW;
use super::style::{self, WIDE, WIDTH};

/// Distance of the outermost text from the edges of the figure, px.
pub(crate) const EDGE: f64 = 6.0;
/// Space to the left of a panel's frame without tick labels: for the axis label, the tick marks and the gaps.
const LEFT: f64 = EDGE + 1.2 * style::EM + 11.0;
/// Space for tick labels to the left of a panel's frame: the least and the most, px.
const TICK_LABELS: [f64; 2] = [14.0, 46.0];
/// Space to the right of a panel's frame, px.
pub(crate) const RIGHT: f64 = 10.0;
/// Space above a panel's frame without a legend, px.
pub(crate) const TOP: f64 = 30.0;
/// Space below a panel's frame, px.
pub(crate) const BOTTOM: f64 = 42.0;
/// Space below a panel that shares the horizontal axis of the last panel, px.
const SHARED_BOTTOM: f64 = 7.0;
/// Minimum width of a panel that has others beside it, px.
const MIN_WIDTH: f64 = 180.0;
/// Height of a panel's frame in a figure that would otherwise be higher than a page, px.
const MIN_HEIGHT: f64 = 60.0;
/// Height of a legend for which there is room above the panels of a page, px.
const MAX_LEGEND: f64 = 120.0;
/// Margin around the figure's legend, px.
pub(crate) const MARGIN: f64 = 10.0;
/// Distance of a note from the frame, px.
pub(crate) const NOTE: f64 = 7.0;
/// Minimum distance between a title and the text beside it, px.
const MIN_GAP: f64 = 3.0;
/// Minimum distance between a title and the legend beside it, px.
const LEGEND_GAP: f64 = 30.0;

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
    /// Space to the left of the panel's frame.
    pub margin: f64,
    /// Space above the panel's frame.
    pub head: f64,
    /// Height of the panel's frame.
    pub inner_height: f64,
    /// Space below the panel's frame.
    pub bottom: f64,
    pub x: Axis,
    pub y: Axis,
    /// Label of the vertical axis; empty if long tick labels leave no room for it.
    pub y_label: &'f str,
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

/// Number of columns of panels, width of the figure and height of a panel's frame (px).
struct Size {
    columns: usize,
    width: f64,
    inner_height: f64,
}

impl Size {
    /// Returns the size of a figure in print or, without `print`, on the screen.
    fn new(figure: &Figure, print: Option<Print>) -> Self {
        let (columns, width, inner_height) = match (figure.layout, figure.panels.len()) {
            (Layout::Stack, 0..=1) => (1, WIDTH, 230.0),
            (Layout::Stack, 2) => (1, WIDTH, 180.0),
            (Layout::Stack, _) => (1, WIDTH, 140.0),
            (Layout::Pairs, _) => (2, WIDE, 163.0),
            (Layout::Grid, 0..=1) => (1, WIDTH, 218.0),
            (Layout::Grid, 2 | 4) => (2, WIDTH, 143.0),
            (Layout::Grid, _) => (3, WIDE, 143.0),
        };
        let panel_width = width / columns as f64;
        let width = print.and_then(Print::width).unwrap_or(width);
        let columns = columns.min((width / MIN_WIDTH) as usize).max(1);
        // The proportions of the panels stay similar.
        let ratio = width / columns as f64 / panel_width;
        Self { columns, width, inner_height: inner_height * ratio.clamp(0.8, 1.25) }
    }
}

/// Returns the maximum number of panels of a figure that is not higher than a page.
pub(crate) fn max_panels(figure: &Figure) -> usize {
    let rows = (max_height(figure, figure.print) - MAX_LEGEND) / (TOP + MIN_HEIGHT + BOTTOM);
    Size::new(figure, Some(figure.print)).columns * (rows as usize).max(1)
}

/// Returns the maximum height of a figure in print without the notice about synthetic trials, px.
fn max_height(figure: &Figure, print: Print) -> f64 {
    print.max_height() - if figure.is_synthetic { SYNTHETIC_ROW } else { 0.0 }
}

impl<'f> Grid<'f> {
    /// Lays out a figure for print or, without `print`, for the screen. In print, the panels are low enough for the
    /// figure to fit on a page (see [`max_panels`]).
    pub(crate) fn new(figure: &'f Figure, print: Option<Print>) -> Self {
        let size = Size::new(figure, print);
        let grid = Self::of_size(figure, &size, |height| height);
        let excess = print.map_or(0.0, |print| grid.height - max_height(figure, print));
        if excess <= 0.0 {
            return grid;
        }
        let rows = grid.cells.chunks(size.columns);
        let frames: f64 =
            rows.map(|row| row.iter().map(|cell| cell.inner_height).fold(0.0, f64::max)).sum();
        let ratio = 1.0 - (excess + 1.0) / frames;
        Self::of_size(figure, &size, |height| (ratio * height).max(MIN_HEIGHT))
    }

    /// Lays out a figure; `lowered` returns the height of a frame whose height would be that given.
    fn of_size(figure: &'f Figure, size: &Size, lowered: impl Fn(f64) -> f64) -> Self {
        let panels = &figure.panels;
        let is_stack = figure.layout == Layout::Stack;
        let Size { columns, width: whole_width, inner_height } = *size;
        let has_own_legends = has_own_legends(panels, is_stack, whole_width);
        let samples = if has_own_legends { Vec::new() } else { figure.samples() };
        // A single sample needs no legend.
        let legend = if samples.len() < 2 {
            Vec::new()
        } else {
            legend::lay_out(samples, MARGIN, whole_width - MARGIN)
        };
        let mut top = legend::height(&legend);
        if top > 0.0 {
            top += MARGIN;
        }
        let is_shared = is_stack && panels.windows(2).all(|two| two[0].x_label == two[1].x_label);
        let all_xs: Vec<f64> = panels.iter().flat_map(Panel::xs).collect();
        let axes_of = |panel: &Panel, width: f64, is_wide: bool| {
            let xs = if is_shared { all_xs.clone() } else { panel.xs() };
            let height = match panel.x_scale {
                Scale::Equal if is_wide || columns == 1 => map_height(panel, &xs, width),
                _ => inner_height,
            };
            let height = lowered(height);
            let (x, y) = axes(panel, &xs, width, height);
            (height, x, y)
        };
        let is_wide =
            |nth: usize| nth.is_multiple_of(columns) && nth + 1 == panels.len() && columns < 3;
        let width_of =
            |nth: usize| if is_wide(nth) { whole_width } else { whole_width / columns as f64 };
        // The frames of a column are aligned, with room for the widest of its tick labels.
        let mut margins = vec![TICK_LABELS[0]; columns];
        for (nth, panel) in panels.iter().enumerate() {
            let width = width_of(nth) - LEFT - TICK_LABELS[1] - RIGHT;
            let (_, _, y) = axes_of(panel, width, is_wide(nth));
            let margin = &mut margins[nth % columns];
            *margin = margin.max(y.label_width().min(TICK_LABELS[1]));
        }
        let mut cells: Vec<Cell> = Vec::new();
        for (nth, (letter, panel)) in figure.lettered().enumerate() {
            let column = nth % columns;
            let width = width_of(nth);
            if column == 0 && nth > 0 {
                let row = &cells[nth - columns..];
                top += row.iter().map(Cell::height).fold(0.0, f64::max);
            }
            let right = width - RIGHT;
            let margin = LEFT + margins[column];
            let (inner_height, x, y) = axes_of(panel, right - margin, is_wide(nth));
            let has_x_labels = !is_shared || nth + 1 == panels.len();
            let bottom = if has_x_labels { BOTTOM } else { SHARED_BOTTOM };
            let letter = if panels.len() > 1 { format!("({letter}) ") } else { String::new() };
            let (title, beyond, notes) = fit_title(letter + &panel.title, panel, right - margin);
            let samples = if has_own_legends { panel.samples() } else { Vec::new() };
            let from = right - legend::row_width(&samples);
            let is_beside = has_room(&title, &beyond, &samples, right - margin);
            let legend = legend::lay_out(samples, if is_beside { from } else { margin }, right);
            let head = TOP + if is_beside { 0.0 } else { legend::height(&legend) };
            // Tick labels with many digits, for values that barely differ, leave no room for the axis label.
            let has_y_label = y.label_width() <= TICK_LABELS[1];
            cells.push(Cell {
                panel,
                title,
                beyond,
                notes,
                left: column as f64 * whole_width / columns as f64,
                top,
                width,
                margin,
                head,
                inner_height,
                bottom,
                x,
                y,
                y_label: if has_y_label { &panel.y_label } else { "" },
                is_whole: is_wide(nth) && columns > 1,
                legend,
            });
        }
        let last = cells.len().saturating_sub(1) / columns * columns;
        let last = cells[last.min(cells.len())..].iter().map(Cell::height).fold(0.0, f64::max);
        Self { columns, width: whole_width, height: (top + last + 6.0).round(), legend, cells }
    }
}

impl Cell<'_> {
    fn height(&self) -> f64 {
        self.head + self.inner_height + self.bottom
    }
}

/// Returns whether panels get their own legends: they do if a common legend would give one look two meanings,
/// or if stacked panels show different layers and have room for legends beside their titles.
fn has_own_legends(panels: &[Panel], is_stack: bool, whole_width: f64) -> bool {
    let samples: Vec<Vec<Layer>> = panels.iter().map(Panel::samples).collect();
    let is_ambiguous = samples.iter().flatten().any(|one| {
        let mut others = samples.iter().flatten();
        others.any(|other| one.look == other.look && one.name != other.name)
    });
    let room = whole_width - LEFT - TICK_LABELS[1] - RIGHT;
    let have_room = || {
        let mut all = panels.iter().zip(&samples);
        all.all(|(panel, samples)| has_room(&panel.title, &panel.beyond, samples, room))
    };
    let are_equal = samples.windows(2).all(|two| two[0] == two[1]);
    !are_equal && (is_ambiguous || is_stack && have_room())
}

/// Returns whether the line above a panel (`room` px) has room for a legend beside the title.
fn has_room(title: &str, beyond: &str, samples: &[Layer], room: f64) -> bool {
    let texts = style::text_width(title) + LEGEND_GAP + legend::row_width(samples);
    beyond.is_empty() && texts <= room
}

/// Returns the title of a panel, the remark about values outside its range, and its notes. Text that is too
/// long for the line above the panel (`room` px) becomes a note; a title is split at its comma, and a remark
/// ends there.
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
    // The first part of the remark may have room.
    if let Some((short, _)) = beyond.split_once(", ")
        && style::text_width(&title) + MIN_GAP + style::text_width(short) <= room
    {
        return (title, short.to_owned(), notes);
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
    let mut y = Axis::new(&panel.ys(), panel.shown, panel.y_scale).named(&panel.y_names);
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
        y.ticks.len() <= 2 || y.label_width() <= TICK_LABELS[1]
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
        let beyond = "3 off the scale, to \u{2212}100 %".to_owned();
        let remark = Panel { beyond, ..Panel::default() };
        let (title, beside, below) = fit_title("(c) d".to_owned(), &remark, 150.0);
        assert_eq!([&title, &beside], ["(c) d", "3 off the scale"]);
        assert!(below.is_empty());
        let (_, _, below) = fit(0.6 * room);
        assert!(below[1].starts_with("skid") && below[1].ends_with('\u{2026}'), "{below:?}");
        assert!(style::text_width(&below[1]) <= 0.6 * room - 2.0 * NOTE);
    }

    fn figure(layout: Layout, panels: Vec<Panel>) -> Figure {
        Figure::new("any", Default::default(), &[], layout, panels)
    }

    #[test]
    fn panels_in_which_a_look_has_different_names_have_their_own_legends() {
        let look =
            style::Look::Line { colour: style::INK, dash: None, width_px: style::LINE_WIDTH };
        let panel = |names: [&str; 2]| {
            let layers = names.map(|name| Layer::new(name, [(0.0, 0.0), (1.0, 1.0)], look));
            Panel::new("A title that leaves no room beside it", "", "", layers.into())
        };
        let narrow = Some(Print { width_mm: Some(60.0), font_pt: 8.0 });
        let names = ["a velocity", "another"];
        let own = figure(Layout::Stack, vec![panel(names), panel(["a force", "another force"])]);
        let grid = Grid::new(&own, narrow);
        assert!(grid.legend.is_empty());
        assert!(grid.cells.iter().all(|cell| cell.legend.len() == 2 && cell.head > TOP));
        let common = figure(Layout::Stack, vec![panel(names), panel(names)]);
        assert_eq!(Grid::new(&common, narrow).legend.len(), 2);
    }

    #[test]
    fn a_figure_with_many_panels_is_split_into_pages() {
        let panel =
            Panel::new("", "x", "y", vec![Layer::new("", [(0.0, 1.0)], style::Look::Rings)]);
        for count in 1..60 {
            let whole = figure(Layout::Grid, vec![panel.clone(); count]);
            let pages = Figure { title: "Many".to_owned(), ..whole }.pages();
            assert_eq!(pages.iter().map(|page| page.panels.len()).sum::<usize>(), count);
            for page in &pages {
                let grid = Grid::new(page, Some(page.print));
                assert!(grid.height <= page.print.max_height(), "{count}: {}", grid.height);
            }
            let [first, .., last] = &pages[..] else { continue };
            assert_eq!([&*first.stem, &last.stem], ["any", &format!("any-{}", pages.len())]);
            assert_eq!(first.title, format!("Many (1 of {})", pages.len()));
        }
    }

    #[test]
    fn a_narrow_axis_has_more_than_one_number() {
        let panel = Panel { x_scale: Scale::Equal, ..Panel::default() };
        let (x, _) = axes(&panel, &[-30.0, 30.0], 172.0, 110.0);
        assert!(x.ticks.len() > 1, "{x:?}");
    }
}
