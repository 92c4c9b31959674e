//! What drawings are made of: colours, sizes, text in the font that comes with the program, and the
//! looks that a layer can have.

use std::sync::LazyLock;

use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontStyle, IntoFont, RGBColor, ShapeStyle, TextStyle, register_font};
use serde::Serialize;

/// Text, frames and measurements.
pub const INK: RGBColor = RGBColor(34, 34, 34);
/// Of what a figure's file warns of.
pub(crate) const MARK: &str = "#a8201a";
pub(crate) const GRID: RGBColor = RGBColor(226, 226, 226);
pub(crate) const PAPER: RGBColor = RGBColor(255, 255, 255);
/// The robot's links on a map.
pub(crate) const LINKS: RGBColor = RGBColor(110, 110, 110);

/// Width of a figure that fits a column of a page, px.
pub const WIDTH: f64 = 460.0;
/// Width of a figure with more panels side by side, px.
pub(crate) const WIDE: f64 = 644.0;
pub(crate) const LINE_WIDTH: f64 = 1.6;
pub(crate) const FRAME_WIDTH: f64 = 1.0;
/// Width of a part of an error bar, px.
pub(crate) const BAR_WIDTH: f64 = 3.0;
pub(crate) const MARKER_RADIUS: f64 = 3.6;
/// Width of an error bar's ends, px.
pub(crate) const ERROR_BAR_ENDS: f64 = 6.4;
/// Length of a line's sample in a legend, px.
pub(crate) const SAMPLE: f64 = 27.0;
/// Radius of points that stand for one of many values, px.
pub(crate) const DOT_RADIUS: f64 = 1.7;

/// The backend has whole coordinates: this many to a pixel, so that curves are smooth.
pub(crate) const UNITS_PER_PX: f64 = 10.0;

/// Pixels in the backend's units.
pub(crate) fn units(px: f64) -> i32 {
    (px * UNITS_PER_PX).round() as i32
}

/// A line of a colour, `width_px` wide; what is not a line is filled.
pub(crate) fn stroke(colour: RGBColor, width_px: f64) -> ShapeStyle {
    colour.filled().stroke_width(units(width_px) as u32)
}

/// The family as SVG names it: ours, and where that is not shown, any without serifs.
pub(crate) const FAMILY: &str = "Roboto, sans-serif";
pub static ROBOTO: &[u8] = include_bytes!("../assets/Roboto-Regular-subset.ttf");

/// Size of all text, px.
pub(crate) const EM: f64 = 12.0;
/// From the top of text, from which it hangs, to its baseline, as plotters' SVG has it.
pub(crate) const ASCENT: f64 = 0.76 * EM;
/// Plotters writes text into SVG at its size over this,
const SIZE_PER_EM: f64 = 1.24;
/// and measures it as if its size were the height of the font's lines.
const LINE_PER_EM: f64 = 2400.0 / 2048.0;

/// Makes plotters know the font, for measuring.
static IS_KNOWN: LazyLock<bool> =
    LazyLock::new(|| register_font(FAMILY, FontStyle::Normal, ROBOTO).is_ok());

/// How text looks that hangs from its position.
pub(crate) fn text_style(align: HPos) -> TextStyle<'static> {
    LazyLock::force(&IS_KNOWN);
    let size = f64::from(units(EM)) * SIZE_PER_EM;
    let style = TextStyle::from((FAMILY, size).into_font()).color(&INK);
    style.pos(Pos::new(align, VPos::Top))
}

/// Width of a text, px.
pub(crate) fn text_width(text: &str) -> f64 {
    const FINE: f64 = 1000.0;
    LazyLock::force(&IS_KNOWN);
    let font = (FAMILY, FINE * LINE_PER_EM).into_font();
    font.box_size(text).map_or(0.0, |(width, _)| f64::from(width) * EM / FINE)
}

/// Lengths of dashes and of the gaps between them, px.
pub type Dash = Option<(f64, f64)>;

pub const SOLID: Dash = None;
pub const DASHES: Dash = Some((6.0, 4.0));

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub enum Shape {
    Circle,
    Square,
}

/// What a colour is serialised as.
#[derive(Serialize)]
#[serde(remote = "RGBColor")]
struct Rgb(u8, u8, u8);

/// How the points of a layer are shown.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub enum Look {
    /// A line that the legend names.
    Line {
        #[serde(with = "Rgb")]
        colour: RGBColor,
        dash: Dash,
    },
    /// Markers with error bars, which the legend names.
    Marker {
        #[serde(with = "Rgb")]
        colour: RGBColor,
        shape: Shape,
        filled: bool,
    },
    /// Points, and the line through them where they are joined.
    Dots {
        #[serde(with = "Rgb")]
        colour: RGBColor,
        joined: bool,
    },
    /// Points that stand out.
    Rings,
    /// Dashed lines across the panel: level where only y is known, upright where only x is.
    Guides,
    /// A shaded interval of the horizontal axis from the first point to the second; a side that
    /// is not known is the panel's.
    Band(#[serde(with = "Rgb")] RGBColor),
    /// Thick error bars alone.
    Bars(#[serde(with = "Rgb")] RGBColor),
    /// Bars from every other point to the next, which the legend names if they have a name.
    Spans(#[serde(with = "Rgb")] RGBColor),
    /// The robot's links, joined.
    Links,
    /// From the first point to the second.
    Arrow,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_as_wide_as_the_font_says() {
        assert!(*IS_KNOWN);
        assert!((text_width("0") / EM - 1150.0 / 2048.0).abs() < 0.01);
    }
}
