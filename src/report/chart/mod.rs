//! Small panels, each with its own axes.

mod draw;
mod scale;

use plotters::style::RGBColor;

use super::axis::Range;
use super::figure::csv_number;
use super::legend::Sample;
use super::style::{Look, Shape};

pub use draw::{draw, have_own_legends, size};

/// One of the things that a panel shows. Points that are not numbers break a line.
#[derive(Debug, Clone)]
pub enum Layer {
    /// A line that the legend names.
    Curve {
        name: String,
        points: Vec<(f64, f64)>,
        look: Look,
    },
    /// Markers that the legend names, with half-widths of their error bars.
    Bars {
        name: String,
        points: Vec<(f64, f64, Option<f64>)>,
        look: Look,
    },
    /// A line through points, which are marked.
    Line {
        name: String,
        points: Vec<(f64, f64)>,
        colour: RGBColor,
    },
    /// Points alone.
    Dots {
        name: String,
        points: Vec<(f64, f64)>,
        colour: RGBColor,
    },
    /// One point that stands out.
    Mark {
        name: String,
        point: (f64, f64),
    },
    /// A dashed line across the panel at a height.
    Level {
        name: String,
        y: f64,
    },
    /// Dashed lines up the panel.
    Rules {
        name: String,
        xs: Vec<f64>,
    },
    /// A shaded interval of the horizontal axis; an open side goes on to the panel's.
    Band {
        name: String,
        from: Option<f64>,
        to: Option<f64>,
    },
    /// Bars `(from, to, height)` that the legend names, if they have a name.
    Spans {
        name: String,
        spans: Vec<(f64, f64, f64)>,
        colour: RGBColor,
    },
    /// The robot's links, joined.
    Links {
        name: String,
        points: Vec<(f64, f64)>,
    },
    Arrow {
        name: String,
        from: (f64, f64),
        to: (f64, f64),
    },
}

/// One panel.
#[derive(Debug, Clone, Default)]
pub struct Chart {
    pub title: String,
    pub x_label: String,
    pub y_label: String,
    pub layers: Vec<Layer>,
    /// What the vertical axis has to show, if not all values.
    pub shown: Option<Range>,
    pub axes: Axes,
    /// Lines of text in the panel's upper right corner.
    pub notes: Vec<String>,
    /// What lies beyond the panel, said at the right end of its title.
    pub beyond: String,
}

/// How the axes of a panel divide.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Axes {
    /// An axis of positive values that go over decades is logarithmic.
    #[default]
    ByValues,
    /// The horizontal axis is linear.
    LinearAcross,
    Linear,
    /// Linear, and a length is as long along both.
    Map,
}

/// How panels are put together.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Layout {
    /// Side by side, up to three in a row.
    #[default]
    Grid,
    /// Above one another, so high each, px.
    Stack(f64),
    /// Two in a row.
    Pairs,
    /// Two in a row, and below them one as wide as both.
    PairsAndWide,
}

impl Layer {
    /// Room that a bar has above and below.
    const SPAN_HALF_HEIGHT: f64 = 0.5;

    pub fn name(&self) -> &str {
        match self {
            Self::Curve { name, .. }
            | Self::Bars { name, .. }
            | Self::Line { name, .. }
            | Self::Dots { name, .. }
            | Self::Mark { name, .. }
            | Self::Level { name, .. }
            | Self::Rules { name, .. }
            | Self::Band { name, .. }
            | Self::Spans { name, .. }
            | Self::Links { name, .. }
            | Self::Arrow { name, .. } => name,
        }
    }

    /// All places `(x, y)` that the layer has, and the half-width of an error bar; a coordinate
    /// is missing where the layer goes on to the panel's sides.
    fn places(&self) -> Vec<(Option<f64>, Option<f64>, Option<f64>)> {
        let both = |&(x, y): &(f64, f64)| (Some(x), Some(y), None);
        match self {
            Self::Curve { points, .. }
            | Self::Line { points, .. }
            | Self::Dots { points, .. }
            | Self::Links { points, .. } => points.iter().map(both).collect(),
            Self::Bars { points, .. } => {
                points.iter().map(|(x, y, error)| (Some(*x), Some(*y), *error)).collect()
            }
            Self::Mark { point, .. } => vec![both(point)],
            Self::Arrow { from, to, .. } => vec![both(from), both(to)],
            Self::Level { y, .. } => vec![(None, Some(*y), None)],
            Self::Rules { xs, .. } => xs.iter().map(|x| (Some(*x), None, None)).collect(),
            Self::Band { from, to, .. } => vec![(*from, None, None), (*to, None, None)],
            Self::Spans { spans, .. } => {
                let half = Some(Self::SPAN_HALF_HEIGHT);
                let ends = |(from, to, y): &(f64, f64, f64)| {
                    [(Some(*from), Some(*y), half), (Some(*to), Some(*y), half)]
                };
                spans.iter().flat_map(ends).collect()
            }
        }
    }

    fn sample(&self) -> Option<Sample> {
        let (name, look, bar) = match self {
            Self::Spans { name, colour, .. } if !name.is_empty() => {
                let look = Look::Marker { colour: *colour, shape: Shape::Square, filled: true };
                (name, look, false)
            }
            Self::Curve { name, look, .. } => (name, *look, false),
            Self::Bars { name, look, points } => {
                (name, *look, points.iter().any(|(_, _, error)| error.is_some()))
            }
            _ => return None,
        };
        Some(Sample { label: name.clone(), look, bar })
    }
}

impl Chart {
    /// Whether there is a value to show.
    pub fn is_empty(&self) -> bool {
        let is_number = |value: Option<f64>| value.is_some_and(f64::is_finite);
        let mut places = self.layers.iter().flat_map(Layer::places);
        !places.any(|(x, y, _)| is_number(x) && is_number(y))
    }

    /// What the legend says of the panel's layers.
    pub fn samples(&self) -> impl Iterator<Item = Sample> {
        self.layers.iter().filter_map(Layer::sample)
    }

    /// All values that the axes have to show.
    fn extent(&self) -> (Vec<f64>, Vec<f64>) {
        let (mut xs, mut ys) = (Vec::new(), Vec::new());
        for (x, y, error) in self.layers.iter().flat_map(Layer::places) {
            xs.extend(x);
            let error = error.unwrap_or(0.0);
            ys.extend(y.iter().flat_map(|y| [y - error, y + error]));
        }
        (xs, ys)
    }

    /// Rows of the figure's CSV: panel, title, layer, x, y, half-width of the error bar.
    pub fn csv(&self, letter: char, field: impl Fn(&str) -> String) -> String {
        let mut csv = String::new();
        for layer in &self.layers {
            let (title, name) = (field(&self.title), field(layer.name()));
            for (x, y, error) in layer.places() {
                let number = |value: Option<f64>| {
                    value.filter(|value| value.is_finite()).map_or(String::new(), csv_number)
                };
                let [x, y, error] = [x, y, error].map(number);
                csv.push_str(&format!("{letter},{title},{name},{x},{y},{error}\n"));
            }
        }
        csv
    }
}
