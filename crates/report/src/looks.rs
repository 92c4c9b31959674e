//! Colours, dashes and marker shapes in figures: one palette, and one plot style per model.

use trilink_plot::RGBColor;
use trilink_plot::{DASHES, Dash, INK, LINE_WIDTH, Look, SOLID, Shape, THICK, THIN};
use trilink_robot::metrics::{Bifurcation, BranchKind};
use trilink_robot::{MAX_LINKS, Model};
use trilink_tables::config::{ModelConfig, Models};

/// Colour palette of Okabe and Ito, whose colours can be distinguished by colour-blind readers
/// (<https://jfly.uni-koeln.de/color/>); orange and sky blue are darker here, for a contrast of 3:1 on white
/// (<https://www.w3.org/TR/WCAG21/#non-text-contrast>).
mod okabe_ito {
    use trilink_plot::RGBColor;
    pub(super) const ORANGE: RGBColor = RGBColor(196, 127, 0);
    pub(super) const GREEN: RGBColor = RGBColor(0, 158, 115);
    pub(super) const BLUE: RGBColor = RGBColor(0, 114, 178);
    pub(super) const VERMILLION: RGBColor = RGBColor(213, 94, 0);
    pub(super) const PURPLE: RGBColor = RGBColor(204, 121, 167);
    pub(super) const SKY: RGBColor = RGBColor(30, 144, 210);
}

/// Colours for the figures that compare runs of the program: baseline, candidate run and trend.
pub mod colours {
    use trilink_plot::RGBColor;
    pub const BASELINE: RGBColor = RGBColor(140, 140, 140);
    pub const CANDIDATE: RGBColor = super::okabe_ito::VERMILLION;
    pub const TREND: RGBColor = super::okabe_ito::BLUE;
}

/// Plot styles for the figures of results over many runs of the program: the baseline, the trend, and a single run.
pub mod trends {
    use super::{DASHES, Look, SOLID, Shape, colours, line};
    pub const BASELINE: Look = line(colours::BASELINE, DASHES);
    pub const TREND: Look = line(colours::TREND, SOLID);
    pub const RUN: Look =
        Look::Marker { colour: colours::TREND, shape: Shape::Circle, filled: true };
    /// A value out of tolerance.
    pub const OUT: Look =
        Look::Marker { colour: colours::CANDIDATE, shape: Shape::Square, filled: true };
}

/// Fill colour for the confidence band behind a line.
pub(crate) const BAND: RGBColor = RGBColor(232, 240, 246);
/// Fill colour for the part of a confidence interval that is due to scatter alone.
pub(crate) const INNER_BAND: RGBColor = RGBColor(206, 223, 236);

const LONG_DASHES: Dash = Some((11.0, 4.0));
const SPARSE_DASHES: Dash = Some((8.0, 8.0));
const SHORT_DASHES: Dash = Some((3.5, 2.5));
const DOTS: Dash = Some((1.8, 3.0));

/// Grey for what is secondary in a figure, such as commanded motions, transients and cycles that are not in use.
const OTHER: RGBColor = RGBColor(120, 120, 120);

const fn line(colour: RGBColor, dash: Dash) -> Look {
    Look::Line { colour, dash, width_px: LINE_WIDTH }
}

/// Shapes of the markers of the campaigns in a panel.
const SHAPES: [Shape; 4] = [Shape::Circle, Shape::Square, Shape::Triangle, Shape::Diamond];

/// Returns the plot style for the measurements of the `nth` campaign in a panel.
pub(crate) fn measured(nth: usize) -> Look {
    marker(INK, nth, true)
}

/// Returns the plot style for the measurements from flagged trials of the `nth` campaign in a panel: open markers.
pub(crate) fn flagged(nth: usize) -> Look {
    marker(INK, nth, false)
}

/// Marker for cycles that are not included in the trial means.
pub(crate) const UNUSED: Look = Look::Marker { colour: OTHER, shape: Shape::Circle, filled: false };

fn marker(colour: RGBColor, nth: usize, filled: bool) -> Look {
    Look::Marker { colour, shape: SHAPES[nth % SHAPES.len()], filled }
}

/// Line style for a recording, or for the only series in a panel.
pub(crate) const RECORDED: Look = line(INK, SOLID);
/// Line style for a recording over which simulated motions are drawn, so thick that it remains visible.
pub(crate) const BENEATH: Look = Look::Line { colour: INK, dash: SOLID, width_px: THICK };
/// Line styles for the roll and the skid velocity of a wheel, solid because they are noisy.
pub(crate) const ROLL: Look = line(INK, SOLID);
pub(crate) const SKID: Look = line(okabe_ito::VERMILLION, SOLID);
/// Line style for a commanded quantity.
pub(crate) const COMMANDED: Look = line(OTHER, DASHES);
/// Line style for a simulated robot with very large skid coefficients.
pub(crate) const STIFF: Look = line(okabe_ito::PURPLE, SHORT_DASHES);
/// Line style for the transient before a steady-state motion.
pub(crate) const TRANSIENT: Look = Look::Line { colour: OTHER, dash: SOLID, width_px: THIN };
/// Line style for a curve fitted to a recording.
pub(crate) const FITTED: Look = line(okabe_ito::VERMILLION, DASHES);

/// Colours and dashes of the components of a quantity: as many as a robot can have links.
const COMPONENTS: [(RGBColor, Dash); MAX_LINKS] = [
    (INK, SOLID),
    (okabe_ito::BLUE, LONG_DASHES),
    (okabe_ito::VERMILLION, SHORT_DASHES),
    (okabe_ito::GREEN, SOLID),
    (okabe_ito::PURPLE, LONG_DASHES),
    (okabe_ito::ORANGE, SHORT_DASHES),
    (okabe_ito::SKY, DOTS),
    (OTHER, SPARSE_DASHES),
];
/// Number of colours that distinguish campaigns, besides the shapes of their markers.
const CAMPAIGN_COLOURS: usize = 3;

/// Returns the line style for the stable or unstable motions on a solution branch: the colour shows the kind of branch,
/// and dashes show that the motions are unstable.
pub(crate) const fn branch(kind: BranchKind, is_stable: bool) -> Look {
    let colour = match kind {
        BranchKind::Symmetric | BranchKind::Periodic => INK,
        BranchKind::SymmetryBroken => okabe_ito::VERMILLION,
        BranchKind::PeriodDoubled => okabe_ito::BLUE,
    };
    line(colour, if is_stable { SOLID } else { SHORT_DASHES })
}

/// Returns the marker for a kind of bifurcation.
pub(crate) const fn bifurcation(bifurcation: Bifurcation) -> Look {
    let (colour, shape, filled) = match bifurcation {
        Bifurcation::Fold => (INK, Shape::Circle, false),
        Bifurcation::SymmetryBreaking => (okabe_ito::VERMILLION, Shape::Square, true),
        Bifurcation::PeriodDoubling => (okabe_ito::BLUE, Shape::Circle, true),
        Bifurcation::Torus => (okabe_ito::PURPLE, Shape::Square, false),
    };
    Look::Marker { colour, shape, filled }
}

/// Marker for an optimal gait.
pub(crate) const OPTIMUM: Look =
    Look::Marker { colour: okabe_ito::VERMILLION, shape: Shape::Circle, filled: true };
/// Marker for the configured gait of a campaign, for comparison with optimal gaits.
pub(crate) const PRESENT: Look = Look::Marker { colour: INK, shape: Shape::Square, filled: false };
/// Markers for the optimal gaits of bootstrap replicates.
pub(crate) const REPLICATES: Look =
    Look::Marker { colour: okabe_ito::ORANGE, shape: Shape::Circle, filled: false };
/// Line style for the boundary of the feasible gaits.
pub(crate) const EDGE: Look = line(OTHER, SHORT_DASHES);
/// Line style for the boundary of the range covered by the trials to which the coefficients were fitted.
pub(crate) const TRIALS_EDGE: Look = line(okabe_ito::ORANGE, LONG_DASHES);
/// Marker for a gait outside the range covered by the trials to which the coefficients were fitted.
pub(crate) const EXTRAPOLATED: Look =
    Look::Marker { colour: okabe_ito::VERMILLION, shape: Shape::Circle, filled: false };

/// Returns the colour of a signed value between -1 and 1: blue for negative, orange for positive values.
pub(crate) fn signed(value: f64) -> RGBColor {
    let RGBColor(red, green, blue) =
        if value < 0.0 { okabe_ito::BLUE } else { okabe_ito::VERMILLION };
    let part = value.abs().min(1.0);
    let mixed = |full: u8| (255.0 - part * (255.0 - f64::from(full))).round() as u8;
    RGBColor(mixed(red), mixed(green), mixed(blue))
}

/// Sequential blues of ColorBrewer: <https://colorbrewer2.org/#type=sequential&scheme=Blues>
const BLUES: [(RGBColor, Dash); 5] = [
    (RGBColor(8, 48, 107), SOLID),
    (RGBColor(8, 81, 156), LONG_DASHES),
    (RGBColor(33, 113, 181), DASHES),
    (RGBColor(49, 130, 189), SHORT_DASHES),
    (RGBColor(66, 146, 198), DOTS),
];

/// Returns the line style for the `nth` contour line around the best value, counted outwards.
pub(crate) fn within(nth: usize) -> Look {
    let (colour, dash) = BLUES[nth % BLUES.len()];
    line(colour, dash)
}

/// Returns the plot style for the `nth` component of a quantity, such as one link, wheel, joint or direction.
pub(crate) fn component(nth: usize) -> Look {
    let (colour, dash) = COMPONENTS[nth % COMPONENTS.len()];
    line(colour, dash)
}

/// Returns the colour for the `nth` campaign in a figure.
pub(crate) fn component_colour(nth: usize) -> RGBColor {
    COMPONENTS[nth % CAMPAIGN_COLOURS].0
}

/// Returns the markers for the `nth` campaign in a figure that distinguishes campaigns by colour.
pub(crate) fn campaign(nth: usize) -> Look {
    marker(component_colour(nth), nth, true)
}

/// Returns the plot style for frames in which the pose of a link is not measured: found from other markers (`nth` = 0),
/// interpolated (1) or missing (2).
pub(crate) fn gap(nth: usize) -> Look {
    Look::Spans([okabe_ito::ORANGE, okabe_ito::BLUE, INK][nth % 3])
}

/// Colours and dashes for the paper's models in all figures.
const PAPER: [(Model, RGBColor, Dash); 6] = [
    (Model::NO_SKID, okabe_ito::BLUE, DASHES),
    (Model::NO_SKID_MEASURED, okabe_ito::SKY, DOTS),
    (Model::NO_SKID_DAMPED, okabe_ito::PURPLE, LONG_DASHES),
    (Model::NO_SKID_ROLL, okabe_ito::ORANGE, SHORT_DASHES),
    (Model::SKID, okabe_ito::GREEN, SPARSE_DASHES),
    (Model::SKID_ROLL, okabe_ito::VERMILLION, SOLID),
];

/// Colours and dashes for models that are not in the paper, assigned in the order of their names, from Paul Tol's muted
/// palette, with an indigo that is far from black and a darker olive:
/// <https://sronpersonalpages.nl/~pault/>
const OTHERS: [(RGBColor, Dash); 6] = [
    (INDIGO, SOLID),
    (WINE, DASHES),
    (OLIVE, LONG_DASHES),
    (INDIGO, SHORT_DASHES),
    (WINE, DOTS),
    (OLIVE, SPARSE_DASHES),
];
const INDIGO: RGBColor = RGBColor(110, 80, 200);
const WINE: RGBColor = RGBColor(136, 34, 85);
const OLIVE: RGBColor = RGBColor(117, 117, 30);

/// Colour and dashes with which a model is plotted in all figures.
#[derive(Debug, Clone, Copy)]
pub struct ModelLook {
    pub colour: RGBColor,
    dash: Dash,
    is_of_trials: bool,
}

impl ModelLook {
    /// Returns the colour and dashes for a model; `models` are the configured models.
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

    /// Returns the plot style with dots in the model's colour, optionally joined by a line.
    pub fn dots(self, joined: bool) -> Look {
        Look::Dots { colour: self.colour, joined }
    }

    /// Returns the line style for the model, even if [`Self::of_campaign`] shows the model by markers.
    pub fn line(self) -> Look {
        line(self.colour, self.dash)
    }

    /// Returns the line style for the only curve in a panel.
    pub(crate) fn solid(self) -> Look {
        line(self.colour, SOLID)
    }

    /// Returns a line style that stands out from thin lines.
    pub(crate) fn thick(self) -> Look {
        Look::Line { colour: self.colour, dash: SOLID, width_px: THICK }
    }

    /// Returns a dashed line style for the fitted model, so that the recording beneath the line remains visible.
    pub(crate) fn over_recorded(self) -> Look {
        line(self.colour, LONG_DASHES)
    }

    /// Returns the plot style of the model for the `nth` campaign in a panel: the model's colour with the dashes that
    /// mark the campaign.
    ///
    /// A model that is driven by the measured gait of each trial has no curve and is shown by open markers, as in the
    /// paper.
    pub fn of_campaign(self, nth: usize) -> Look {
        let Self { colour, dash, is_of_trials } = self;
        match nth {
            _ if is_of_trials => Look::Marker { colour, shape: Shape::Diamond, filled: false },
            0 => line(colour, dash),
            _ => line(colour, [SHORT_DASHES, DASHES, LONG_DASHES, DOTS][nth % 4]),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use trilink_tables::config::Config;

    use super::*;

    #[test]
    fn user_defined_models_have_distinct_plot_styles() {
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
        // Removing a model does not change the plot styles of the models configured before it.
        let ours = ModelLook::new(Model::new("ours"), &models).line();
        models.remove(&Model::new("theirs"));
        assert_eq!(ModelLook::new(Model::new("ours"), &models).line(), ours);
    }

    /// Returns the relative luminance of a colour: <https://www.w3.org/TR/WCAG21/#dfn-relative-luminance>
    fn luminance(RGBColor(red, green, blue): RGBColor) -> f64 {
        let [red, green, blue] = [red, green, blue].map(|part| {
            let part = f64::from(part) / 255.0;
            if part <= 0.04045 { part / 12.92 } else { ((part + 0.055) / 1.055).powf(2.4) }
        });
        0.2126 * red + 0.7152 * green + 0.0722 * blue
    }

    fn contrast(one: RGBColor, other: RGBColor) -> f64 {
        let [low, high] = trilink_statistics::extremes([one, other].map(luminance));
        (high + 0.05) / (low + 0.05)
    }

    fn colour(hexadecimal: &str) -> RGBColor {
        let part = |nth: usize| u8::from_str_radix(&hexadecimal[1 + 2 * nth..][..2], 16).unwrap();
        RGBColor(part(0), part(1), part(2))
    }

    /// Returns the colour of every line and marker in the figures.
    fn all() -> BTreeSet<[u8; 3]> {
        let looks = (0..6)
            .flat_map(|nth| {
                [measured(nth), flagged(nth), component(nth), campaign(nth), within(nth), gap(nth)]
            })
            .chain(Bifurcation::ALL.map(bifurcation))
            .chain(BranchKind::ALL.map(|kind| branch(kind, false)))
            .chain([
                UNUSED, RECORDED, BENEATH, ROLL, SKID, COMMANDED, STIFF, TRANSIENT, FITTED,
                OPTIMUM, PRESENT,
            ])
            .chain([REPLICATES, EDGE, TRIALS_EDGE, EXTRAPOLATED, trends::BASELINE, trends::RUN]);
        let looks = looks.filter_map(|look| match look {
            Look::Line { colour, .. } | Look::Marker { colour, .. } | Look::Spans(colour) => {
                Some(colour)
            }
            _ => None,
        });
        let models =
            PAPER.iter().map(|(_, colour, _)| *colour).chain(OTHERS.map(|(colour, _)| colour));
        looks.chain(models).map(|RGBColor(red, green, blue)| [red, green, blue]).collect()
    }

    #[test]
    fn every_line_and_marker_is_visible_on_white_and_on_dark_pages() {
        let style = include_str!("page/style.css");
        let pages: Vec<&str> = style.split("--page: ").skip(1).map(|rest| &rest[..7]).collect();
        let dark = colour(pages[1]);
        let all = all();
        assert!(all.len() > 12, "{all:?}");
        for [red, green, blue] in all {
            let on_white = RGBColor(red, green, blue);
            let name = format!("#{red:02x}{green:02x}{blue:02x}");
            let rule = format!(".sheet [stroke=\"{name}\"] {{ stroke: ");
            let on_dark = style.split_once(&rule).map_or(on_white, |(_, rest)| match &rest[..7] {
                "var(--i" => RGBColor(230, 232, 234),
                shown => colour(shown),
            });
            let contrasts = [(on_white, RGBColor(255, 255, 255)), (on_dark, dark)];
            for (of, page) in contrasts {
                assert!(contrast(of, page) >= 3.0, "{name} on {page:?}: {}", contrast(of, page));
            }
        }
    }

    #[test]
    fn models_differ_without_colour() {
        let looks: Vec<(RGBColor, Dash)> =
            PAPER.map(|(_, colour, dash)| (colour, dash)).into_iter().chain(OTHERS).collect();
        for (nth, (colour, dash)) in looks.iter().enumerate() {
            for (other, of_other) in &looks[..nth] {
                let differ = dash != of_other || contrast(*colour, *other) >= 1.3;
                assert!(differ, "{colour:?} and {other:?} with {dash:?}");
            }
        }
    }
}
