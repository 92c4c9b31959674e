//! A figure before it is drawn.

use serde::Serialize;

use super::axis::{Range, Scale};
use super::style::{EM, Look, SAMPLE, Shape};

/// Notice in every file of a figure that shows synthetic trials: drawn below the panels and stored as a comment.
pub(crate) const SYNTHETIC: &str = "Synthetic trials, not recorded";

/// Of a pixel in print, as SVG and pages have it.
pub(crate) const PT_PER_PX: f32 = 0.75;
pub(crate) const PX_PER_INCH: f32 = 96.0;
const MM_PER_INCH: f64 = 25.4;

/// A point of a layer with the half-width of its error bar. What is not a number is not known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Point {
    pub x: f64,
    pub y: f64,
    pub error: f64,
}

/// One of the things that a panel shows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Layer {
    pub name: String,
    pub points: Vec<Point>,
    pub look: Look,
    /// Trials that the points are of, if they are of trials.
    pub trials: Vec<String>,
    /// Limits of a line's interval at each of its points, if it has any.
    pub band: Vec<[f64; 2]>,
}

/// One panel with its axes.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Panel {
    pub title: String,
    pub x_label: String,
    pub y_label: String,
    pub layers: Vec<Layer>,
    pub x_scale: Scale,
    pub y_scale: Scale,
    /// What ticks at these whole numbers are called, in order; there are no others.
    pub x_names: Vec<(f64, String)>,
    /// What the vertical axis has to show, if not all values.
    pub shown: Option<Range>,
    /// Lines of text in the panel's upper right corner.
    pub notes: Vec<String>,
    /// What lies beyond the panel, at the right end of its title.
    pub beyond: String,
}

/// How panels are put together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub enum Layout {
    /// Side by side, up to three in a row.
    #[default]
    Grid,
    /// Two in a row; one that is left over is as wide as both.
    Pairs,
    /// Above one another. They share the horizontal axis if it is of the same quantity.
    Stack,
}

/// The size of a figure in print.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Print {
    /// As wide as the panels need if there is none.
    pub width_mm: Option<f64>,
    pub font_pt: f64,
}

impl Default for Print {
    fn default() -> Self {
        Self { width_mm: None, font_pt: f64::from(PT_PER_PX) * EM }
    }
}

impl Print {
    /// How much larger than drawn it is printed.
    pub fn scale(self) -> f64 {
        self.font_pt / Self::default().font_pt
    }

    /// Of its pixels: more where it is to be printed.
    pub(crate) fn dots_per_inch(self) -> f32 {
        if self.width_mm.is_some() { 600.0 } else { 288.0 }
    }

    /// The width to draw it with, px.
    pub fn width(self) -> Option<f64> {
        self.width_mm.map(|mm| mm / MM_PER_INCH * f64::from(PX_PER_INCH) / self.scale())
    }
}

/// A grid of panels.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Figure {
    /// Name of its files without extension, such as `fig16`.
    pub stem: String,
    /// What is plotted, in a line.
    pub title: String,
    /// What a reader has to know beyond the title.
    pub caption: String,
    /// Campaigns that are in it.
    pub campaigns: Vec<String>,
    pub panels: Vec<Panel>,
    pub layout: Layout,
    pub print: Print,
    /// It shows trials that were computed, or what was fitted to them; its files say so.
    pub is_synthetic: bool,
    /// The plotted numbers as CSV and what they show as text, where these have more to them than
    /// the panels.
    pub csv: Option<String>,
    pub alternative: Option<String>,
}

impl Layer {
    pub fn new(name: &str, points: impl IntoIterator<Item = (f64, f64)>, look: Look) -> Self {
        let points = points.into_iter().map(|(x, y)| (x, y, f64::NAN));
        Self::with_errors(name, points, look)
    }

    /// Points with half-widths of error bars.
    pub fn with_errors(
        name: &str,
        points: impl IntoIterator<Item = (f64, f64, f64)>,
        look: Look,
    ) -> Self {
        let points = points.into_iter().map(|(x, y, error)| Point { x, y, error });
        let (name, points) = (name.to_owned(), points.collect());
        Self { name, points, look, trials: Vec::new(), band: Vec::new() }
    }

    /// What a legend has of the layer, px from its middle: measurements have error bars there, too.
    fn sample(&self) -> Option<Self> {
        let has_bar = self.points.iter().any(|of| of.error > 0.0 && of.error.is_finite());
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
        let (title, x_label, y_label) = (title.into(), x_label.to_owned(), y_label.into());
        Self { title, x_label, y_label, layers, ..Self::default() }
    }

    /// Whether there is a value to show.
    pub fn is_empty(&self) -> bool {
        !self.points().any(|point| point.x.is_finite() && point.y.is_finite())
    }

    fn points(&self) -> impl Iterator<Item = &Point> {
        self.layers.iter().flat_map(|layer| &layer.points)
    }

    /// All values that the horizontal axis has to show.
    pub(crate) fn xs(&self) -> Vec<f64> {
        self.points().map(|point| point.x).collect()
    }

    /// All values that the vertical axis has to show, ends of error bars and bands included.
    pub(crate) fn ys(&self) -> Vec<f64> {
        let half = |point: &Point| if point.error.is_finite() { point.error } else { 0.0 };
        let ends = |point: &Point| [point.y - half(point), point.y + half(point)];
        let bands = self.layers.iter().flat_map(|layer| layer.band.as_flattened());
        self.points().flat_map(ends).chain(bands.copied()).collect()
    }

    /// What the legend has of the panel's layers.
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

    /// What its files say beside the picture.
    pub fn comment(&self) -> Option<&'static str> {
        self.is_synthetic.then_some(SYNTHETIC)
    }

    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        self.panels.iter().all(Panel::is_empty)
    }

    /// What the legend has of all panels, each look of a name once and with error bars if a panel
    /// has them, measurements first.
    pub fn samples(&self) -> Vec<Layer> {
        let mut samples: Vec<Layer> = Vec::new();
        for sample in self.panels.iter().flat_map(Panel::samples) {
            let is_same = |of: &&mut Layer| (&of.name, of.look) == (&sample.name, sample.look);
            match samples.iter_mut().find(is_same) {
                Some(known) if known.points[0].error >= sample.points[0].error => {}
                Some(known) => *known = sample,
                None => samples.push(sample),
            }
        }
        samples.sort_by_key(|sample| sample.points[0].error == 0.0);
        samples
    }

    /// Panels with the letters that their titles and the CSV have.
    pub(crate) fn lettered(&self) -> impl Iterator<Item = (char, &Panel)> {
        ('a'..).zip(&self.panels)
    }
}
