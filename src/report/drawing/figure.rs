//! A figure before it is drawn.

use super::axis::{Range, Scale};
use super::style::Look;
use crate::csv::field as csv_field;

/// A point of a layer with the half-width of its error bar. What is not a number is not known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    pub x: f64,
    pub y: f64,
    pub error: f64,
}

/// One of the things that a panel shows.
#[derive(Debug, Clone)]
pub struct Layer {
    pub name: String,
    pub points: Vec<Point>,
    pub look: Look,
}

/// One panel with its axes.
#[derive(Debug, Clone, Default)]
pub struct Panel {
    pub title: String,
    pub x_label: String,
    pub y_label: String,
    pub layers: Vec<Layer>,
    pub x_scale: Scale,
    pub y_scale: Scale,
    /// What the vertical axis has to show, if not all values.
    pub shown: Option<Range>,
    /// Lines of text in the panel's upper right corner.
    pub notes: Vec<String>,
    /// What lies beyond the panel, at the right end of its title.
    pub beyond: String,
}

/// How panels are put together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Layout {
    /// Side by side, up to three in a row.
    #[default]
    Grid,
    /// Two in a row; one that is left over is as wide as both.
    Pairs,
    /// Above one another. They share the horizontal axis if it is of the same quantity.
    Stack,
}

/// A grid of panels.
#[derive(Debug, Clone, Default)]
pub struct Figure {
    /// Name of its files without extension, such as `fig16`.
    pub stem: String,
    /// `Fig. 16` or empty for figures that the paper does not have.
    pub number: String,
    /// What is plotted, in a line.
    pub title: String,
    /// What a reader has to know beyond the title.
    pub caption: String,
    /// Campaigns that are in it.
    pub campaigns: Vec<String>,
    pub panels: Vec<Panel>,
    pub layout: Layout,
    /// The plotted numbers as CSV and what they show as text, where these have more to them than
    /// the panels.
    pub csv: Option<String>,
    pub alternative: Option<String>,
}

/// What a legend has of a layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    pub label: String,
    pub look: Look,
    /// Measurements have error bars, in the legend too.
    pub has_bar: bool,
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
        Self { name: name.to_owned(), points: points.collect(), look }
    }

    /// A dashed line across the panel at a height.
    pub fn level(name: &str, y: f64) -> Self {
        Self::new(name, [(f64::NAN, y)], Look::Guides)
    }

    /// Dashed lines up the panel.
    pub fn uprights(name: &str, xs: impl IntoIterator<Item = f64>) -> Self {
        Self::new(name, xs.into_iter().map(|x| (x, f64::NAN)), Look::Guides)
    }

    /// A shaded interval of the horizontal axis; a side that is not finite is the panel's.
    pub fn band(name: &str, from: f64, to: f64) -> Self {
        Self::new(name, [(from, f64::NAN), (to, f64::NAN)], Look::Band)
    }

    /// Bars `(from, to, height)`, for each of which the panel has a unit of height.
    pub fn spans(name: &str, spans: &[(f64, f64, f64)], look: Look) -> Self {
        let ends = spans.iter().flat_map(|(from, to, y)| [(*from, *y, 0.5), (*to, *y, 0.5)]);
        Self::with_errors(name, ends, look)
    }

    fn sample(&self) -> Option<Sample> {
        let is_named = match self.look {
            Look::Line { .. } | Look::Marker { .. } => true,
            Look::Spans(_) => !self.name.is_empty(),
            _ => false,
        };
        let has_bar = matches!(self.look, Look::Marker { .. })
            && self.points.iter().any(|point| point.error.is_finite());
        is_named.then(|| Sample { label: self.name.clone(), look: self.look, has_bar })
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

    /// A map, or whatever else has the same unit along both axes.
    pub fn equal(self) -> Self {
        Self { x_scale: Scale::Equal, y_scale: Scale::Equal, ..self }
    }

    /// Whether there is a value to show.
    pub fn is_empty(&self) -> bool {
        !self.points().any(|point| point.x.is_finite() && point.y.is_finite())
    }

    fn points(&self) -> impl Iterator<Item = &Point> {
        self.layers.iter().flat_map(|layer| &layer.points)
    }

    /// All values that the horizontal axis has to show.
    pub fn xs(&self) -> Vec<f64> {
        self.points().map(|point| point.x).collect()
    }

    /// All values that the vertical axis has to show, ends of error bars included.
    pub fn ys(&self) -> Vec<f64> {
        let ends = |point: &Point| match point.error.is_finite() {
            true => [point.y - point.error, point.y + point.error],
            false => [point.y; 2],
        };
        self.points().flat_map(ends).collect()
    }

    /// What the legend has of the panel's layers, each look of a name once.
    pub fn samples(&self) -> Vec<Sample> {
        let samples = self.layers.iter().filter_map(Layer::sample);
        samples.fold(Vec::new(), add_new)
    }
}

fn add_new(mut samples: Vec<Sample>, sample: Sample) -> Vec<Sample> {
    if !samples.contains(&sample) {
        samples.push(sample);
    }
    samples
}

impl Figure {
    /// A figure without a caption, its panels in a [`Layout::Grid`].
    pub fn new(stem: &str, title: String, campaigns: &[&str], panels: Vec<Panel>) -> Self {
        Self {
            stem: stem.to_owned(),
            title,
            campaigns: campaigns.iter().map(|&campaign| campaign.to_owned()).collect(),
            panels,
            ..Self::default()
        }
    }

    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        self.panels.iter().all(Panel::is_empty)
    }

    /// What the legend has of all panels, measurements first.
    pub fn samples(&self) -> Vec<Sample> {
        let samples = self.panels.iter().flat_map(Panel::samples);
        let mut samples = samples.fold(Vec::new(), add_new);
        samples.sort_by_key(|sample| !sample.has_bar);
        samples
    }

    /// Panels with the letters that their titles and the CSV have.
    pub fn lettered(&self) -> impl Iterator<Item = (char, &Panel)> {
        ('a'..).zip(&self.panels)
    }

    /// What the figure shows for those who cannot see it.
    pub fn text_alternative(&self) -> String {
        let of_panels = || {
            let titles = self.lettered().map(|(letter, panel)| {
                format!(" ({letter}) {}: {} against {}.", panel.title, panel.y_label, panel.x_label)
            });
            format!("{}.{}", self.title, titles.collect::<String>())
        };
        self.alternative.clone().unwrap_or_else(of_panels)
    }

    /// The plotted numbers, one row per point; `error_95` is the half-width of the error bar.
    pub fn csv(&self) -> String {
        if let Some(csv) = &self.csv {
            return csv.clone();
        }
        let mut csv = "panel,title,layer,x,y,error_95\n".to_owned();
        for (letter, panel) in self.lettered() {
            let title = csv_field(&panel.title);
            for layer in &panel.layers {
                let name = csv_field(&layer.name);
                for Point { x, y, error } in &layer.points {
                    let [x, y, error] = [x, y, error].map(|value| csv_number(*value));
                    csv.push_str(&format!("{letter},{title},{name},{x},{y},{error}\n"));
                }
            }
        }
        csv
    }
}

/// Ten digits: what the tables are good for, without the noise of a change of units. Nothing for
/// what is not a number.
pub fn csv_number(value: f64) -> String {
    if !value.is_finite() {
        return String::new();
    }
    let rounded: f64 = format!("{value:.9e}").parse().unwrap_or(value);
    rounded.to_string()
}
