//! Text in the font that comes with the program.

use std::sync::LazyLock;

use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, IntoFont, TextStyle, register_font};

use super::style::{INK, units};

/// The family as SVG names it: ours, and where that is not shown, any without serifs.
pub const FAMILY: &str = "Roboto, sans-serif";
pub static ROBOTO: &[u8] = include_bytes!("../../../assets/Roboto-Regular-subset.ttf");

/// Size of all text, px.
pub const EM: f64 = 12.0;
/// From the top of text, from which it hangs, to its baseline, as plotters' SVG has it.
pub const ASCENT: f64 = 0.76 * EM;
/// Plotters writes text into SVG at its size over this,
const SIZE_PER_EM: f64 = 1.24;
/// and measures it as if its size were the height of the font's lines.
const LINE_PER_EM: f64 = 2400.0 / 2048.0;

/// Makes plotters know the font, for measuring.
static IS_KNOWN: LazyLock<bool> =
    LazyLock::new(|| register_font(FAMILY, FontStyle::Normal, ROBOTO).is_ok());

/// How text looks that hangs from its position.
pub fn style(align: HPos) -> TextStyle<'static> {
    LazyLock::force(&IS_KNOWN);
    let size = f64::from(units(EM)) * SIZE_PER_EM;
    let style = TextStyle::from((FAMILY, size).into_font()).color(&INK);
    style.pos(Pos::new(align, VPos::Top))
}

/// Width of a text, px.
pub fn width(text: &str) -> f64 {
    const FINE: f64 = 1000.0;
    LazyLock::force(&IS_KNOWN);
    let font = (FAMILY, FINE * LINE_PER_EM).into_font();
    font.box_size(text).map_or(0.0, |(width, _)| f64::from(width) * EM / FINE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_as_wide_as_the_font_says() {
        assert!(*IS_KNOWN);
        assert!((width("0") / EM - 1150.0 / 2048.0).abs() < 0.01);
    }
}
