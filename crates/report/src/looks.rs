//! What figures show things by: one palette, one look for each model.

use trilink_plot::RGBColor;
use trilink_plot::{DASHES, Dash, INK, Look, SOLID, Shape};
use trilink_robot::Model;
use trilink_robot::metrics::{Bifurcation, BranchKind};
use trilink_tables::config::{ModelConfig, Models};

/// Okabe and Ito's palette, which colour-blind readers can tell apart.
/// <https://jfly.uni-koeln.de/color/>
mod okabe_ito {
    use trilink_plot::RGBColor;
    pub(super) const ORANGE: RGBColor = RGBColor(230, 159, 0);
    pub(super) const GREEN: RGBColor = RGBColor(0, 158, 115);
    pub(super) const BLUE: RGBColor = RGBColor(0, 114, 178);
    pub(super) const VERMILLION: RGBColor = RGBColor(213, 94, 0);
    pub(super) const PURPLE: RGBColor = RGBColor(204, 121, 167);
    pub(super) const SKY: RGBColor = RGBColor(86, 180, 233);
}

/// Of two runs over each other, and of a run after the other.
pub mod colours {
    use trilink_plot::RGBColor;
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
pub(crate) const BAND: RGBColor = RGBColor(232, 240, 246);
pub(crate) const INNER_BAND: RGBColor = RGBColor(206, 223, 236);

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
pub(crate) fn measured(nth: usize) -> Look {
    marker(INK, nth)
}

/// Those of them that were flagged.
pub(crate) fn flagged(nth: usize) -> Look {
    marker(okabe_ito::ORANGE, nth)
}

/// Cycles that do not count.
pub(crate) const UNUSED: Look = Look::Marker { colour: OTHER, shape: Shape::Circle, filled: false };

fn marker(colour: RGBColor, nth: usize) -> Look {
    let (shape, filled) = MARKERS[nth % MARKERS.len()];
    Look::Marker { colour, shape, filled }
}

/// What was recorded or is shown alone, as a line.
pub(crate) const RECORDED: Look = line(INK, SOLID);
/// What was commanded.
pub(crate) const COMMANDED: Look = line(OTHER, DASHES);
/// A robot that hardly can skid.
pub(crate) const STIFF: Look = line(okabe_ito::PURPLE, SHORT_DASHES);
/// The transient into a steady motion.
pub(crate) const TRANSIENT: Look = line(OTHER, SOLID);
/// What was fitted to a recording.
pub(crate) const FITTED: Look = line(okabe_ito::VERMILLION, DASHES);

const COMPONENTS: [(RGBColor, Dash); 3] =
    [(INK, SOLID), (okabe_ito::SKY, LONG_DASHES), (okabe_ito::VERMILLION, SHORT_DASHES)];

/// The stable motions of a branch, or those that are not.
pub(crate) const fn branch(kind: BranchKind, is_stable: bool) -> Look {
    let colour = match kind {
        BranchKind::Symmetric | BranchKind::Periodic => INK,
        BranchKind::SymmetryBroken => okabe_ito::VERMILLION,
        BranchKind::PeriodDoubled => okabe_ito::BLUE,
    };
    line(colour, if is_stable { SOLID } else { SHORT_DASHES })
}

/// What happens on a branch.
pub(crate) const fn bifurcation(bifurcation: Bifurcation) -> Look {
    let (colour, shape, filled) = match bifurcation {
        Bifurcation::Fold => (INK, Shape::Circle, false),
        Bifurcation::SymmetryBreaking => (okabe_ito::VERMILLION, Shape::Square, true),
        Bifurcation::PeriodDoubling => (okabe_ito::BLUE, Shape::Circle, true),
        Bifurcation::Torus => (okabe_ito::PURPLE, Shape::Square, false),
    };
    Look::Marker { colour, shape, filled }
}

/// Where an optimum, the present gait and the optima of replicates are, and around the gaits that count.
pub(crate) const OPTIMUM: Look =
    Look::Marker { colour: okabe_ito::VERMILLION, shape: Shape::Circle, filled: true };
pub(crate) const PRESENT: Look = Look::Marker { colour: INK, shape: Shape::Square, filled: false };
pub(crate) const REPLICATES: Look =
    Look::Marker { colour: okabe_ito::ORANGE, shape: Shape::Circle, filled: false };
pub(crate) const EDGE: Look = line(OTHER, SHORT_DASHES);
/// Where the trials end that the coefficients were fitted to, and gaits beyond.
pub(crate) const TRIALS_EDGE: Look = line(okabe_ito::ORANGE, LONG_DASHES);
pub(crate) const EXTRAPOLATED: Look =
    Look::Marker { colour: okabe_ito::VERMILLION, shape: Shape::Circle, filled: false };

/// ColorBrewer's blues.
/// <https://colorbrewer2.org/#type=sequential&scheme=Blues>
const BLUES: [RGBColor; 5] = [
    RGBColor(8, 48, 107),
    RGBColor(8, 81, 156),
    RGBColor(33, 113, 181),
    RGBColor(107, 174, 214),
    RGBColor(158, 202, 225),
];

/// The line of a value that is the `nth` nearest to the best.
pub(crate) fn within(nth: usize) -> Look {
    line(BLUES[nth % BLUES.len()], SOLID)
}

/// The `nth` of the same quantity of several links, wheels, joints or directions.
pub(crate) fn component(nth: usize) -> Look {
    let (colour, dash) = COMPONENTS[nth % COMPONENTS.len()];
    line(colour, dash)
}

pub(crate) fn component_colour(nth: usize) -> RGBColor {
    COMPONENTS[nth % COMPONENTS.len()].0
}

/// Markers of the `nth` campaign where each has a colour.
pub(crate) fn campaign(nth: usize) -> Look {
    marker(component_colour(nth), nth)
}

/// Frames that are not measured: the `nth` of the reasons.
pub(crate) fn gap(nth: usize) -> Look {
    Look::Spans([okabe_ito::SKY, okabe_ito::ORANGE, okabe_ito::VERMILLION][nth % 3])
}

/// The paper's models: colours and dashes, the same in every figure.
const PAPER: [(Model, RGBColor, Dash); 6] = [
    (Model::NO_SKID, okabe_ito::BLUE, DASHES),
    (Model::NO_SKID_MEASURED, okabe_ito::SKY, DOTS),
    (Model::NO_SKID_DAMPED, okabe_ito::PURPLE, LONG_DASHES),
    (Model::NO_SKID_ROLL, okabe_ito::ORANGE, SHORT_DASHES),
    (Model::SKID, okabe_ito::GREEN, LONG_DASHES),
    (Model::SKID_ROLL, okabe_ito::VERMILLION, SOLID),
];

/// Of other models, by their order in the configuration, from Tol's muted colours.
/// <https://sronpersonalpages.nl/~pault/>
const OTHERS: [(RGBColor, Dash); 6] = [
    (RGBColor(51, 34, 136), SOLID),
    (RGBColor(136, 34, 85), DASHES),
    (RGBColor(153, 153, 51), LONG_DASHES),
    (RGBColor(51, 34, 136), SHORT_DASHES),
    (RGBColor(136, 34, 85), DOTS),
    (RGBColor(153, 153, 51), SOLID),
];

/// What a model is shown by.
#[derive(Debug, Clone, Copy)]
pub struct ModelLook {
    pub colour: RGBColor,
    dash: Dash,
    is_of_trials: bool,
}

impl ModelLook {
    /// Of a model among those that are configured.
    pub fn new(model: Model, models: &Models) -> Self {
        let of_paper = |model: Model| PAPER.into_iter().find(|(name, ..)| *name == model);
        let (colour, dash) = of_paper(model).map_or_else(
            || {
                let before = models.range(..model).filter(|(name, _)| of_paper(**name).is_none());
                OTHERS[before.count() % OTHERS.len()]
            },
            |(_, colour, dash)| (colour, dash),
        );
        let is_of_trials = models.get(&model).is_some_and(ModelConfig::is_of_trials);
        Self { colour, dash, is_of_trials }
    }

    /// As points.
    pub fn dots(self, joined: bool) -> Look {
        Look::Dots { colour: self.colour, joined }
    }

    /// As a line, also where it is driven by a measured gait.
    pub fn line(self) -> Look {
        line(self.colour, self.dash)
    }

    /// As fitted, over what was recorded, which it may cover.
    pub(crate) fn over_recorded(self) -> Look {
        line(self.colour, LONG_DASHES)
    }

    /// For the `nth` campaign in a panel: its colour, another dash. One that is driven by each
    /// trial's own gait has no curve and is shown as open markers, as in the paper.
    pub fn of_campaign(self, nth: usize) -> Look {
        let Self { colour, dash, is_of_trials } = self;
        match nth {
            _ if is_of_trials => Look::Marker { colour, shape: Shape::Circle, filled: false },
            0 => line(colour, dash),
            _ => line(colour, [SHORT_DASHES, DASHES, LONG_DASHES, DOTS][nth % 4]),
        }
    }
}

#[cfg(test)]
mod tests {
    use trilink_tables::config::Config;

    use super::*;

    #[test]
    fn models_of_one_s_own_have_the_next_colours_and_take_none_of_another() {
        let mut models = Config::default().model;
        let looks = |models: &Models| -> Vec<Look> {
            models.keys().map(|name| ModelLook::new(*name, models).line()).collect()
        };
        let before: Vec<Look> = Model::PAPER.map(|of| ModelLook::new(of, &models).line()).into();
        for name in ["ours", "a", "theirs"] {
            models.insert(Model::new(name), models[&Model::SKID].clone());
        }
        let all = looks(&models);
        for (nth, look) in all.iter().enumerate() {
            assert!(!all[..nth].contains(look), "{look:?}");
        }
        assert_eq!(Model::PAPER.map(|of| ModelLook::new(of, &models).line()).to_vec(), before);
        // Another one after it does not change it.
        let ours = ModelLook::new(Model::new("ours"), &models).line();
        models.remove(&Model::new("theirs"));
        assert_eq!(ModelLook::new(Model::new("ours"), &models).line(), ours);
    }

    /// Relative luminance.
    /// <https://www.w3.org/TR/WCAG21/#dfn-relative-luminance>
    fn luminance(colour: &str) -> f64 {
        let part = |nth: usize| {
            let part = u8::from_str_radix(&colour[1 + 2 * nth..][..2], 16).unwrap();
            let part = f64::from(part) / 255.0;
            if part <= 0.04045 { part / 12.92 } else { ((part + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * part(0) + 0.7152 * part(1) + 0.0722 * part(2)
    }

    #[test]
    fn every_model_s_line_can_be_seen_on_dark_pages() {
        let style = include_str!("page/style.css");
        let pages: Vec<&str> = style.split("--page: ").skip(1).map(|rest| &rest[..7]).collect();
        let dark = luminance(pages[1]);
        let colours = PAPER.iter().map(|(_, colour, _)| *colour);
        for RGBColor(red, green, blue) in colours.chain(OTHERS.iter().map(|(colour, _)| *colour)) {
            let colour = format!("#{red:02x}{green:02x}{blue:02x}");
            let rule = format!(".sheet [stroke=\"{colour}\"] {{ stroke: ");
            let on_dark = style.split_once(&rule).map_or(&colour[..], |(_, rest)| &rest[..7]);
            let contrast = (luminance(on_dark) + 0.05) / (dark + 0.05);
            assert!(contrast >= 3.0, "{colour} as {on_dark}: {contrast}");
        }
    }
}
