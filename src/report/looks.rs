//! What figures show things by: one palette, one look for each model.

use plotters::style::RGBColor;

use super::drawing::style::{DASHES, Dash, INK, Look, SOLID, Shape};
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

/// The baseline of a trend, the trend of very many runs, and a run.
pub mod trends {
    use super::{DASHES, Look, SOLID, Shape, colours, line};
    pub const BASELINE: Look = line(colours::BASELINE, DASHES);
    pub const TREND: Look = line(colours::TREND, SOLID);
    pub const RUN: Look =
        Look::Marker { colour: colours::TREND, shape: Shape::Circle, filled: true };
}

/// An interval behind a line, and a part of it.
pub const BAND: RGBColor = RGBColor(232, 240, 246);
pub const INNER_BAND: RGBColor = RGBColor(206, 223, 236);

const LONG_DASHES: Dash = Some((11.0, 4.0));
const SHORT_DASHES: Dash = Some((3.5, 2.5));
const DOTS: Dash = Some((1.8, 3.0));

/// Commands and transients.
const OTHER: RGBColor = RGBColor(120, 120, 120);

const fn line(colour: RGBColor, dash: Dash) -> Look {
    Look::Line { colour, dash }
}

const MARKERS: [(Shape, bool); 4] =
    [(Shape::Circle, true), (Shape::Square, false), (Shape::Circle, false), (Shape::Square, true)];

/// Measurements of the `nth` campaign in a panel.
pub fn measured(nth: usize) -> Look {
    marker(INK, nth)
}

/// Those of them that were flagged.
pub fn flagged(nth: usize) -> Look {
    marker(okabe_ito::ORANGE, nth)
}

/// Cycles that do not count.
pub const UNUSED: Look = Look::Marker { colour: OTHER, shape: Shape::Circle, filled: false };

fn marker(colour: RGBColor, nth: usize) -> Look {
    let (shape, filled) = MARKERS[nth % MARKERS.len()];
    Look::Marker { colour, shape, filled }
}

/// What was recorded or is shown alone, as a line.
pub const RECORDED: Look = line(INK, SOLID);
/// What was commanded.
pub const COMMANDED: Look = line(OTHER, DASHES);
/// A robot that hardly can skid.
pub const STIFF: Look = line(okabe_ito::PURPLE, SHORT_DASHES);
/// The transient into a steady motion.
pub const TRANSIENT: Look = line(OTHER, SOLID);
/// What was fitted to a recording.
pub const FITTED: Look = line(okabe_ito::VERMILLION, DASHES);

const COMPONENTS: [(RGBColor, Dash); 3] =
    [(INK, SOLID), (okabe_ito::SKY, LONG_DASHES), (okabe_ito::VERMILLION, SHORT_DASHES)];

/// The `nth` of the same quantity of several links, wheels, joints or directions.
pub fn component(nth: usize) -> Look {
    let (colour, dash) = COMPONENTS[nth % COMPONENTS.len()];
    line(colour, dash)
}

pub fn component_colour(nth: usize) -> RGBColor {
    COMPONENTS[nth % COMPONENTS.len()].0
}

/// Markers of the `nth` campaign where each has a colour.
pub fn campaign(nth: usize) -> Look {
    marker(component_colour(nth), nth)
}

/// Frames that are not measured: the `nth` of the reasons.
pub fn gap(nth: usize) -> Look {
    Look::Spans([okabe_ito::SKY, okabe_ito::ORANGE, okabe_ito::VERMILLION][nth % 3])
}

/// The colour of a model, the same in every figure, and its dashes.
const fn of_model(model: Model) -> (RGBColor, Dash) {
    match model {
        Model::NoSkid => (okabe_ito::BLUE, DASHES),
        Model::NoSkidMeasured => (okabe_ito::SKY, DOTS),
        Model::NoSkidDamped => (okabe_ito::PURPLE, LONG_DASHES),
        Model::NoSkidRoll => (okabe_ito::ORANGE, SHORT_DASHES),
        Model::Skid => (okabe_ito::GREEN, LONG_DASHES),
        Model::SkidRoll => (okabe_ito::VERMILLION, SOLID),
    }
}

/// The colour of a model.
pub const fn model_colour(model: Model) -> RGBColor {
    of_model(model).0
}

/// Points of a model.
pub fn model_dots(model: Model, joined: bool) -> Look {
    Look::Dots { colour: of_model(model).0, joined }
}

/// A model as a line, also where it is driven by a measured gait.
pub const fn model_line(model: Model) -> Look {
    let (colour, dash) = of_model(model);
    line(colour, dash)
}

/// A fitted model over what was recorded, which it may cover.
pub const fn fitted_over(model: Model) -> Look {
    line(of_model(model).0, LONG_DASHES)
}

/// A model for the `nth` campaign in a panel: its colour, another dash. One that is driven by each
/// trial's own gait has no curve and is shown as open markers, as in the paper.
pub fn model_of_campaign(model: Model, nth: usize) -> Look {
    let (colour, dash) = of_model(model);
    match model {
        Model::NoSkidMeasured => Look::Marker { colour, shape: Shape::Circle, filled: false },
        _ if nth > 0 => line(colour, [SHORT_DASHES, DASHES, LONG_DASHES, DOTS][nth % 4]),
        _ => line(colour, dash),
    }
}
