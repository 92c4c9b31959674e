//! What everything looks like: one font, one palette, one look for each model.

use plotters::style::RGBColor;

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
/// Lines that help the eye and should not be seen otherwise.
pub const GRID: RGBColor = RGBColor(226, 226, 226);
/// An interval behind a line.
pub const BAND: RGBColor = RGBColor(232, 240, 246);
pub const PAPER: RGBColor = RGBColor(255, 255, 255);
/// The robot's links on a map.
pub const LINKS: RGBColor = RGBColor(110, 110, 110);
/// Models that the palette does not know.
const OTHER: RGBColor = RGBColor(120, 120, 120);

/// Sizes, px of a figure [`WIDTH`] wide.
pub const WIDTH: f64 = 460.0;
/// Width of figures with panels side by side, px.
pub const WIDE: f64 = 644.0;
pub const TEXT: f64 = 13.0;
pub const SMALL_TEXT: f64 = 12.0;
pub const LINE_WIDTH: f64 = 2.0;
pub const CHART_LINE_WIDTH: f64 = 1.5;
pub const FRAME_WIDTH: f64 = 1.0;
pub const MARKER_RADIUS: f64 = 3.6;

/// Lengths of dashes and of the gaps after them, px; nothing is a solid line.
pub type Dash = &'static [f64];

pub const SOLID: Dash = &[];
const LONG_DASHES: Dash = &[11.0, 4.0];
const DASHES: Dash = &[6.0, 4.0];
const DOTS: Dash = &[2.0, 3.0];
const DASH_DOT: Dash = &[9.0, 3.0, 2.0, 3.0];

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    Circle,
    Square,
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Look {
    Line { colour: RGBColor, dash: Dash },
    Marker { colour: RGBColor, shape: Shape, filled: bool },
}

impl Look {
    pub fn colour(self) -> RGBColor {
        match self {
            Self::Line { colour, .. } | Self::Marker { colour, .. } => colour,
        }
    }
}

/// Measurements of the `nth` campaign in a panel.
pub fn measured(nth: usize) -> Look {
    let (shape, filled) = [(Shape::Circle, true), (Shape::Square, false)][nth % 2];
    Look::Marker { colour: INK, shape, filled }
}

/// What was recorded or is shown alone, as a line.
pub const RECORDED: Look = Look::Line { colour: INK, dash: SOLID };
/// What was commanded.
pub const COMMANDED: Look = Look::Line { colour: OTHER, dash: DASHES };

/// The way into a steady motion.
pub const TRANSIENT: Look = Look::Line { colour: OTHER, dash: SOLID };
/// What was fitted to it.
pub const FITTED: Look = Look::Line { colour: okabe_ito::VERMILLION, dash: DASHES };

/// The `nth` of the same quantity of several links, wheels, joints or directions.
pub fn component(nth: usize) -> Look {
    let looks = [(INK, SOLID), (okabe_ito::SKY, LONG_DASHES), (okabe_ito::VERMILLION, DASH_DOT)];
    let (colour, dash) = looks[nth % looks.len()];
    Look::Line { colour, dash }
}

/// The `nth` way in which frames are not measured.
pub fn gap(nth: usize) -> RGBColor {
    [okabe_ito::SKY, okabe_ito::ORANGE, okabe_ito::VERMILLION][nth % 3]
}

/// A model as a line, also where it is driven by a measured gait.
pub fn model_line(name: &str) -> Look {
    match model(name) {
        Look::Marker { colour, .. } => Look::Line { colour, dash: DOTS },
        line => line,
    }
}

/// A model, the same in every figure. One that is driven by each trial's own gait has no
/// curve and is shown as open markers, as in the paper.
pub fn model(name: &str) -> Look {
    let line = |colour, dash| Look::Line { colour, dash };
    match name {
        "no-skid" => line(okabe_ito::BLUE, DASHES),
        "no-skid-measured" => {
            Look::Marker { colour: okabe_ito::BLUE, shape: Shape::Circle, filled: false }
        }
        "no-skid-damped" => line(okabe_ito::PURPLE, LONG_DASHES),
        "no-skid-roll" => line(okabe_ito::ORANGE, DASH_DOT),
        "skid" => line(okabe_ito::GREEN, LONG_DASHES),
        "skid-roll" => line(okabe_ito::VERMILLION, SOLID),
        _ => line(OTHER, DOTS),
    }
}

/// The same model for the `nth` campaign in a panel: its colour, another dash.
pub fn model_of_campaign(name: &str, nth: usize) -> Look {
    match model(name) {
        Look::Line { colour, .. } if nth > 0 => Look::Line { colour, dash: DASHES },
        look => look,
    }
}

/// Place of a model in legends and tables.
pub fn model_rank(name: &str) -> usize {
    let order =
        ["no-skid", "no-skid-measured", "no-skid-damped", "no-skid-roll", "skid", "skid-roll"];
    order.iter().position(|&known| known == name).unwrap_or(order.len())
}
