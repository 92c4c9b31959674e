//! Description of figures: panels, layers, points and print size.

use serde::Serialize;

use super::axis::{Range, Scale};
use super::grid;
use super::style::{EM, Look, SAMPLE, Shape};

/// Notice for figures that show synthetic trials, drawn below the panels and stored as a comment in every
/// file.
pub(crate) const SYNTHETIC: &str = "Synthetic trials, not recorded";

/// Size of a pixel in print, as in SVG and HTML, points.
pub(crate) const PT_PER_PX: f32 = 0.75;
pub(crate) const PX_PER_INCH: f32 = 96.0;
const MM_PER_INCH: f64 = 25.4;
/// Height that the text of a journal's page has, mm.
const MAX_HEIGHT_MM: f64 = 240.0;

/// Point of a layer with the half-width of its error bar; unknown values are NaN.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Point {
    pub x: f64,
    pub y: f64,
    pub error: f64,
}

/// Series of points in a panel, such as a line or a set of markers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Layer {
    pub name: String,
    pub points: Vec<Point>,
    pub look: Look,
    /// Name of the trial for each point; empty if the points do not belong to trials.
    pub trials: Vec<String>,
    /// Lower and upper limit of the band around a line at each point; empty if there is no band.
    pub band: Vec<[f64; 2]>,
}

/// Panel with its axes.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Panel {
    pub title: String,
    pub x_label: String,
    pub y_label: String,
    pub layers: Vec<Layer>,
    pub x_scale: Scale,
    pub y_scale: Scale,
    /// Labels on the horizontal axis in place of numeric ticks, each with its integer position, in ascending
    /// order.
    pub x_names: Vec<(f64, String)>,
    /// Labels on the vertical axis in place of numeric ticks, likewise.
    pub y_names: Vec<(f64, String)>,
    /// Range to which the vertical axis is limited; `None` to show all values.
    pub shown: Option<Range>,
    /// Range that the vertical axis covers even if no value is there, so that panels can have one scale.
    pub covered: Option<Range>,
    /// Lines of text in the upper right corner of the panel.
    pub notes: Vec<String>,
    /// Remark about values outside the panel's range, written to the right of the title.
    pub beyond: String,
}

/// Arrangement of the panels in a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub enum Layout {
    /// Up to three panels per row.
    #[default]
    Grid,
    /// Two panels per row; a single panel in the last row is as wide as both.
    Pairs,
    /// One panel per row; panels with the same quantity on their horizontal axes share the axis.
    Stack,
}

/// Size of a figure in print.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Print {
    /// Width in print, mm; `None` for the width that the panels need.
    pub width_mm: Option<f64>,
    pub font_pt: f64,
}

/// A column of a journal.
impl Default for Print {
    fn default() -> Self {
        Self { width_mm: Some(88.0), font_pt: 7.5 }
    }
}

impl Print {
    /// Returns the ratio of the printed size to the drawn size.
    pub fn scale(self) -> f64 {
        self.font_pt / (f64::from(PT_PER_PX) * EM)
    }

    /// Returns the width of the drawing, px; `None` for the width that the panels need.
    pub fn width(self) -> Option<f64> {
        self.width_mm.map(|mm| self.px(mm))
    }

    /// Returns the maximum height of the drawing, px.
    pub(crate) fn max_height(self) -> f64 {
        self.px(MAX_HEIGHT_MM)
    }

    fn px(self, mm: f64) -> f64 {
        mm / MM_PER_INCH * f64::from(PX_PER_INCH) / self.scale()
    }
}

/// Figure: a grid of panels.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Figure {
    /// Name of the figure's files without their extension, such as `fig16`.
    pub stem: String,
    /// Title of the figure, in one line.
    pub title: String,
    /// Caption, with everything that a reader needs to know beyond the title.
    pub caption: String,
    /// Names of the campaigns that the figure shows.
    pub campaigns: Vec<String>,
    pub panels: Vec<Panel>,
    pub layout: Layout,
    pub print: Print,
    /// Whether the figure shows synthetic trials or fits to them; if so, its files say so.
    pub is_synthetic: bool,
    /// Data to write as CSV in place of the panels' data; `None` for the panels' data.
    pub csv: Option<String>,
    /// Text alternative of the figure; `None` to derive it from titles and labels.
    pub alternative: Option<String>,
}

impl Layer {
    pub fn new(name: &str, points: impl IntoIterator<Item = (f64, f64)>, look: Look) -> Self {
        let points = points.into_iter().map(|(x, y)| (x, y, f64::NAN));
        Self::with_errors(name, points, look)
    }

    /// Creates a layer from points `(x, y, half-width of the error bar)`.
    pub fn with_errors(
        name: &str,
        points: impl IntoIterator<Item = (f64, f64, f64)>,
        look: Look,
    ) -> Self {
        let points = points.into_iter().map(|(x, y, error)| Point { x, y, error });
        Self {
            name: name.to_owned(),
            points: points.collect(),
            look,
            trials: Vec::new(),
            band: Vec::new(),
        }
    }

    /// Returns a layer that represents this layer in a legend: a line or a marker, with an error bar if any point of
    /// this layer has one. Its coordinates are in px from the centre of the legend key. Returns `None` if legends do
    /// not list the layer.
    fn sample(&self) -> Option<Self> {
        let mut errors = self.points.iter().map(|point| point.error);
        let has_bar = errors.any(|error| error > 0.0 && error.is_finite());
        let bar = if has_bar { 7.0 } else { 0.0 };
        let half = 0.5 * SAMPLE;
        let (points, look) = match self.look {
            Look::Line { .. } => (vec![(-half, 0.0, 0.0), (half, 0.0, 0.0)], self.look),
            Look::Marker { .. } => (vec![(0.0, 0.0, bar)], self.look),
            Look::Spans(colour) if !self.name.is_empty() => {
                (vec![(0.0, 0.0, 0.0)], Look::Marker { colour, shape: Shape::Square, filled: true })
            }
            _ => return None,
        };
        Some(Self::with_errors(&self.name, points, look))
    }
}

impl Panel {
    pub fn new(
        title: impl Into<String>,
        x_label: &str,
        y_label: impl Into<String>,
        layers: Vec<Layer>,
    ) -> Self {
        Self {
            title: title.into(),
            x_label: x_label.to_owned(),
            y_label: y_label.into(),
            layers,
            ..Self::default()
        }
    }

    /// Returns whether the panel has no values to show.
    pub fn is_empty(&self) -> bool {
        !self.points().any(|point| point.x.is_finite() && point.y.is_finite())
    }

    fn points(&self) -> impl Iterator<Item = &Point> {
        self.layers.iter().flat_map(|layer| &layer.points)
    }

    /// Returns all values on the panel's horizontal axis.
    pub(crate) fn xs(&self) -> Vec<f64> {
        let cells = self.cells().flat_map(|point| [point.x - 0.5, point.x + 0.5]);
        self.points().map(|point| point.x).chain(cells).collect()
    }

    fn cells(&self) -> impl Iterator<Item = &Point> {
        let cells = self.layers.iter().filter(|layer| matches!(layer.look, Look::Cells(_)));
        cells.flat_map(|layer| &layer.points)
    }

    /// Returns all values on the panel's vertical axis, including the ends of error bars and bands.
    pub(crate) fn ys(&self) -> Vec<f64> {
        let mut ys = Vec::new();
        for point in self.points() {
            let half = if point.error.is_finite() { point.error } else { 0.0 };
            ys.extend([point.y - half, point.y + half]);
        }
        ys.extend(self.layers.iter().flat_map(|layer| layer.band.as_flattened()));
        ys.extend(self.cells().flat_map(|point| [point.y - 0.5, point.y + 0.5]));
        ys.extend(self.covered.iter().flat_map(|range| [range.low, range.high]));
        ys
    }

    /// Returns the lines and markers that represent the panel's layers in a legend.
    pub fn samples(&self) -> Vec<Layer> {
        self.layers.iter().filter_map(Layer::sample).collect()
    }
}

impl Figure {
    pub fn new(
        stem: &str,
        [title, caption]: [String; 2],
        campaigns: &[&str],
        layout: Layout,
        panels: Vec<Panel>,
    ) -> Self {
        let campaigns = campaigns.iter().map(|&campaign| campaign.to_owned()).collect();
        Self { stem: stem.to_owned(), title, caption, campaigns, layout, panels, ..Self::default() }
    }

    /// Splits a figure with more panels than fit on a printed page into several figures, whose names and titles are
    /// numbered.
    pub fn pages(self) -> Vec<Self> {
        let max_panels = grid::max_panels(&self);
        if self.panels.len() <= max_panels || self.csv.is_some() {
            return vec![self];
        }
        let count = self.panels.len().div_ceil(max_panels);
        let parts = self.panels.chunks(self.panels.len().div_ceil(count)).zip(1..);
        let page = |(panels, nth): (&[Panel], usize)| Self {
            stem: if nth == 1 { self.stem.clone() } else { format!("{}-{nth}", self.stem) },
            title: format!("{} ({nth} of {count})", self.title),
            panels: panels.to_vec(),
            ..self.clone()
        };
        parts.map(page).collect()
    }

    /// Returns the comment to store in the figure's files; `None` unless the figure shows synthetic trials.
    pub fn comment(&self) -> Option<&'static str> {
        self.is_synthetic.then_some(SYNTHETIC)
    }

    /// Returns whether the figure has nothing to draw.
    pub fn is_empty(&self) -> bool {
        self.panels.iter().all(Panel::is_empty)
    }

    /// Returns the lines and markers that represent the layers of all panels in a legend. Each combination of
    /// name and look occurs once, with an error bar if it has one in any panel; those with error bars come
    /// first.
    pub fn samples(&self) -> Vec<Layer> {
        let mut samples: Vec<Layer> = Vec::new();
        for sample in self.panels.iter().flat_map(Panel::samples) {
            let mut known = samples.iter_mut();
            match known.find(|one| (&one.name, one.look) == (&sample.name, sample.look)) {
                Some(known) if known.points[0].error >= sample.points[0].error => {}
                Some(known) => *known = sample,
                None => samples.push(sample),
            }
        }
        samples.sort_by_key(|sample| sample.points[0].error == 0.0);
        samples
    }

    /// Iterates over the panels with the letters that denote them in titles and in the CSV.
    pub(crate) fn lettered(&self) -> impl Iterator<Item = (char, &Panel)> {
        ('a'..).zip(&self.panels)
    }
}
