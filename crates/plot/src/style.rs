//! Style of the figures: colours, sizes, the embedded font, and the looks of layers.

use std::sync::LazyLock;

use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontStyle, IntoFont, RGBColor, ShapeStyle, TextStyle, register_font};
use serde::Serialize;

/// Colour of text, frames and measurements.
pub const INK: RGBColor = RGBColor(34, 34, 34);
/// Colour of the notice about synthetic trials.
pub(crate) const MARK: &str = "#a8201a";
pub(crate) const GRID: RGBColor = RGBColor(226, 226, 226);
pub(crate) const PAPER: RGBColor = RGBColor(255, 255, 255);
/// Colour of the robot's links on a map.
pub(crate) const LINKS: RGBColor = RGBColor(110, 110, 110);

/// Width of a figure that fits into one column of a page, px.
pub const WIDTH: f64 = 460.0;
/// Width of a figure that has several panels side by side, px.
pub(crate) const WIDE: f64 = 644.0;
/// Width of a line of secondary importance, such as a transient, px.
pub const THIN: f64 = 0.7;
/// Width of a line, px.
pub const LINE_WIDTH: f64 = 1.6;
/// Width of a line that stays visible beneath others, px.
pub const THICK: f64 = 2.8;
pub(crate) const FRAME_WIDTH: f64 = 1.0;
/// Line width of [`Look::Bars`], px.
pub(crate) const BAR_WIDTH: f64 = 3.0;
pub(crate) const MARKER_RADIUS: f64 = 3.2;
/// Width of the caps of an error bar, px.
pub(crate) const ERROR_BAR_ENDS: f64 = 6.4;
/// Length of the line that represents a layer in a legend, px.
pub(crate) const SAMPLE: f64 = 27.0;
/// Radius of the points of [`Look::Dots`], px.
pub(crate) const DOT_RADIUS: f64 = 1.7;

/// Number of backend units per pixel; the coordinates of the backend are integers, so one per pixel would
/// make curves jagged.
pub(crate) const UNITS_PER_PX: f64 = 10.0;

/// Converts pixels to the backend's units.
pub(crate) fn units(px: f64) -> i32 {
    (px * UNITS_PER_PX).round() as i32
}

/// Returns the style of a line with the given colour and width; shapes other than lines are filled.
pub(crate) fn stroke(colour: RGBColor, width_px: f64) -> ShapeStyle {
    colour.filled().stroke_width(units(width_px) as u32)
}

/// Font family in SVG: the embedded font, with any sans-serif font as fallback.
pub(crate) const FAMILY: &str = "Roboto, sans-serif";
pub static ROBOTO: &[u8] = include_bytes!("../assets/Roboto-Regular-subset.ttf");

/// Size of all text, px.
pub(crate) const EM: f64 = 12.0;
/// Distance from the top of a text to its baseline, px. The `plotters` crate positions a text by its top.
pub(crate) const ASCENT: f64 = 0.76 * EM;
/// Ratio of the font size in plotters to the font size in SVG.
const SIZE_PER_EM: f64 = 1.24;
/// Ratio of the font's line height, which plotters takes for the font size when it measures text, to an em.
const LINE_PER_EM: f64 = 2400.0 / 2048.0;

/// Whether the embedded font is registered with plotters, which measures text with it.
static IS_REGISTERED: LazyLock<bool> =
    LazyLock::new(|| register_font(FAMILY, FontStyle::Normal, ROBOTO).is_ok());

/// Returns the style of text that is anchored at its top edge.
pub(crate) fn text_style(align: HPos) -> TextStyle<'static> {
    LazyLock::force(&IS_REGISTERED);
    let size = f64::from(units(EM)) * SIZE_PER_EM;
    let style = TextStyle::from((FAMILY, size).into_font()).color(&INK);
    style.pos(Pos::new(align, VPos::Top))
}

/// Returns the colour of text on a background.
pub(crate) fn ink_on(RGBColor(red, green, blue): RGBColor) -> RGBColor {
    // Perceived brightness (Rec. 601).
    let brightness = 0.299 * f64::from(red) + 0.587 * f64::from(green) + 0.114 * f64::from(blue);
    if brightness < 128.0 { PAPER } else { INK }
}

/// Returns the width of text, px.
pub(crate) fn text_width(text: &str) -> f64 {
    const FINE: f64 = 1000.0;
    LazyLock::force(&IS_REGISTERED);
    let font = (FAMILY, FINE * LINE_PER_EM).into_font();
    font.box_size(text).map_or(0.0, |(width, _)| f64::from(width) * EM / FINE)
}

/// Lengths of the dashes and gaps of a line, px; `None` for a solid line.
pub type Dash = Option<(f64, f64)>;

pub const SOLID: Dash = None;
pub const DASHES: Dash = Some((6.0, 4.0));

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub enum Shape {
    Circle,
    Square,
    Triangle,
    Diamond,
}

/// Serialized form of a colour.
#[derive(Serialize)]
#[serde(remote = "RGBColor")]
struct Rgb(u8, u8, u8);

/// Look of a layer: the way in which its points are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub enum Look {
    /// Line, which the legend lists.
    Line {
        #[serde(with = "Rgb")]
        colour: RGBColor,
        dash: Dash,
        width_px: f64,
    },
    /// Markers with error bars, which the legend lists.
    Marker {
        #[serde(with = "Rgb")]
        colour: RGBColor,
        shape: Shape,
        filled: bool,
    },
    /// Small dots, with a line through them if `joined`.
    Dots {
        #[serde(with = "Rgb")]
        colour: RGBColor,
        joined: bool,
    },
    /// Rings that highlight points.
    Rings,
    /// Dashed lines across the panel: vertical at x if y is NaN, otherwise horizontal at y.
    Guides,
    /// Shaded interval of the horizontal axis from the first point to the second; a point that is missing or
    /// NaN stands for the side of the panel.
    Band(#[serde(with = "Rgb")] RGBColor),
    /// Thick error bars without markers.
    Bars(#[serde(with = "Rgb")] RGBColor),
    /// Horizontal bars, each between two consecutive points, which the legend lists if the layer has a name.
    Spans(#[serde(with = "Rgb")] RGBColor),
    /// Cells of a heat map, one unit wide and high, which contain the layer's name.
    Cells(#[serde(with = "Rgb")] RGBColor),
    /// Links of the robot, as a thick line through the points.
    Links,
    /// Arrow from the first point to the second.
    Arrow,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_have_the_widths_of_the_font() {
        assert!(*IS_REGISTERED);
        assert!((text_width("0") / EM - 1150.0 / 2048.0).abs() < 0.01);
    }
}
