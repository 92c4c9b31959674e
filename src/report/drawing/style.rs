//! What everything looks like: one palette, one look for each model.

use plotters::style::{Color, RGBColor, ShapeStyle};

use crate::motion::Model;

/// Okabe and Ito's palette, which colour-blind readers can tell apart.
/// <https://jfly.uni-koeln.de/color/>
mod okabe_ito {
    use plotters::style::RGBColor;
    pub const ORANGE: RGBColor = RGBColor(230, 159, 0);
    pub const GREEN: RGBColor = RGBColor(0, 158, 115);
    pub const BLUE: RGBColor = RGBColor(0, 114, 178);
    pub const VERMILLION: RGBColor = RGBColor(213, 94, 0);
    pub const PURPLE: RGBColor = RGBColor(204, 121, 167);
    pub const SKY: RGBColor = RGBColor(86, 180, 233);
}

/// Of two runs over each other, and of a run after the other.
pub mod colours {
    use plotters::style::RGBColor;
    pub const BASELINE: RGBColor = RGBColor(150, 150, 150);
    pub const CANDIDATE: RGBColor = super::okabe_ito::VERMILLION;
    pub const TREND: RGBColor = super::okabe_ito::BLUE;
}

/// Text, frames and measurements.
pub const INK: RGBColor = RGBColor(34, 34, 34);
pub const GRID: RGBColor = RGBColor(226, 226, 226);
/// An interval behind a line.
pub const BAND: RGBColor = RGBColor(232, 240, 246);
pub const PAPER: RGBColor = RGBColor(255, 255, 255);
/// The robot's links on a map.
pub const LINKS: RGBColor = RGBColor(110, 110, 110);
/// Commands and transients.
const OTHER: RGBColor = RGBColor(120, 120, 120);

/// Width of a figure that fits a column of a page, px.
pub const WIDTH: f64 = 460.0;
/// Width of a figure with more panels side by side, px.
pub const WIDE: f64 = 644.0;
pub const LINE_WIDTH: f64 = 1.6;
pub const FRAME_WIDTH: f64 = 1.0;
pub const MARKER_RADIUS: f64 = 3.6;
/// Radius of points that stand for one of many values, px.
pub const DOT_RADIUS: f64 = 1.7;

/// The backend has whole coordinates: this many to a pixel, so that curves are smooth.
pub const UNITS_PER_PX: f64 = 10.0;

/// Pixels in the backend's units.
pub fn units(px: f64) -> i32 {
    (px * UNITS_PER_PX).round() as i32
}

/// A line of a colour, `width_px` wide; what is not a line is filled.
pub fn stroke(colour: RGBColor, width_px: f64) -> ShapeStyle {
    colour.filled().stroke_width(units(width_px) as u32)
}

/// Lengths of dashes and of the gaps between them, px.
pub type Dash = Option<(f64, f64)>;

pub const SOLID: Dash = None;
pub const DASHES: Dash = Some((6.0, 4.0));
const LONG_DASHES: Dash = Some((11.0, 4.0));
const SHORT_DASHES: Dash = Some((3.5, 2.5));
const DOTS: Dash = Some((1.8, 3.0));

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    Circle,
    Square,
}

/// How the points of a layer are shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Look {
    /// A line that the legend names.
    Line { colour: RGBColor, dash: Dash },
    /// Markers with error bars, which the legend names.
    Marker { colour: RGBColor, shape: Shape, filled: bool },
    /// A line through points, which are marked.
    Dotted(RGBColor),
    /// Points alone.
    Dots(RGBColor),
    /// Points that stand out.
    Rings,
    /// Dashed lines across the panel: level where only y is known, upright where only x is.
    Guides,
    /// A shaded interval of the horizontal axis from the first point to the second; a side that
    /// is not known is the panel's.
    Band,
    /// Bars from every other point to the next, which the legend names if they have a name.
    Spans(RGBColor),
    /// The robot's links, joined.
    Links,
    /// From the first point to the second.
    Arrow,
}

impl Look {
    pub fn colour(self) -> RGBColor {
        match self {
            Self::Line { colour, .. }
            | Self::Marker { colour, .. }
            | Self::Dotted(colour)
            | Self::Dots(colour)
            | Self::Spans(colour) => colour,
            Self::Rings | Self::Guides | Self::Arrow => INK,
            Self::Band => BAND,
            Self::Links => LINKS,
        }
    }
}

const fn line(colour: RGBColor, dash: Dash) -> Look {
    Look::Line { colour, dash }
}

/// Measurements of the `nth` campaign in a panel.
pub fn measured(nth: usize) -> Look {
    let (shape, filled) = [(Shape::Circle, true), (Shape::Square, false)][nth % 2];
    Look::Marker { colour: INK, shape, filled }
}

/// What was recorded or is shown alone, as a line.
pub const RECORDED: Look = line(INK, SOLID);
/// What was commanded.
pub const COMMANDED: Look = line(OTHER, DASHES);
/// The transient into a steady motion.
pub const TRANSIENT: Look = line(OTHER, SOLID);
/// What was fitted to a recording.
pub const FITTED: Look = line(okabe_ito::VERMILLION, DASHES);

/// The `nth` of the same quantity of several links, wheels, joints or directions.
pub fn component(nth: usize) -> Look {
    let looks =
        [(INK, SOLID), (okabe_ito::SKY, LONG_DASHES), (okabe_ito::VERMILLION, SHORT_DASHES)];
    let (colour, dash) = looks[nth % looks.len()];
    line(colour, dash)
}

/// Markers of the `nth` campaign where each has a colour.
pub fn campaign(nth: usize) -> Look {
    let shapes = [(Shape::Circle, true), (Shape::Square, false), (Shape::Circle, false)];
    let (shape, filled) = shapes[nth % shapes.len()];
    Look::Marker { colour: component(nth).colour(), shape, filled }
}

/// Frames that are not measured: the `nth` of the reasons.
pub fn gap(nth: usize) -> Look {
    Look::Spans([okabe_ito::SKY, okabe_ito::ORANGE, okabe_ito::VERMILLION][nth % 3])
}

/// A model as a line, also where it is driven by a measured gait.
pub fn model_line(of: Model) -> Look {
    match model(of) {
        Look::Marker { colour, .. } => line(colour, DOTS),
        line => line,
    }
}

/// A model, the same in every figure. One that is driven by each trial's own gait has no
/// curve and is shown as open markers, as in the paper.
pub fn model(model: Model) -> Look {
    match model {
        Model::NoSkid => line(okabe_ito::BLUE, DASHES),
        Model::NoSkidMeasured => {
            Look::Marker { colour: okabe_ito::BLUE, shape: Shape::Circle, filled: false }
        }
        Model::NoSkidDamped => line(okabe_ito::PURPLE, LONG_DASHES),
        Model::NoSkidRoll => line(okabe_ito::ORANGE, SHORT_DASHES),
        Model::Skid => line(okabe_ito::GREEN, LONG_DASHES),
        Model::SkidRoll => line(okabe_ito::VERMILLION, SOLID),
    }
}

/// The same model for the `nth` campaign in a panel: its colour, another dash.
pub fn model_of_campaign(of: Model, nth: usize) -> Look {
    match model(of) {
        Look::Line { colour, .. } if nth > 0 => line(colour, DASHES),
        look => look,
    }
}
