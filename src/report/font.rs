//! The font of the figures, which comes with the program.

use std::sync::OnceLock;

use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};
use base64::Engine;

use super::ReportError;

/// The family as SVG text names it: ours, and where that is not shown, any without serifs.
pub const FAMILY: &str = "Roboto, sans-serif";

static ROBOTO: &[u8] = include_bytes!("../../assets/Roboto-Regular-subset.ttf");

/// A font that can be measured and drawn.
#[derive(Clone, Copy)]
pub struct Typeface(&'static FontRef<'static>);

impl Typeface {
    /// The font that comes with the program.
    ///
    /// # Errors
    /// The font cannot be parsed, which would be a broken build.
    pub fn load() -> Result<Self, ReportError> {
        static FONT: OnceLock<Option<FontRef<'static>>> = OnceLock::new();
        let font = FONT.get_or_init(|| FontRef::try_from_slice(ROBOTO).ok());
        font.as_ref().map(Self).ok_or(ReportError::Font)
    }

    /// Width of a text, em.
    pub fn width_em(self, text: &str) -> f64 {
        let font = self.0.as_scaled(self.scale(1.0));
        text.chars().map(|c| f64::from(font.h_advance(font.glyph_id(c)))).sum()
    }

    /// Calls `draw` with every pixel (x to the right, y down) that the text covers and how
    /// much of it, from 0 to 1. The text starts at `x` on the baseline `y = 0`.
    pub fn draw<E>(
        self,
        text: &str,
        em: f64,
        x: f64,
        mut draw: impl FnMut((i32, i32), f64) -> Result<(), E>,
    ) -> Result<(), E> {
        let font = self.0.as_scaled(self.scale(em));
        let mut x = x as f32;
        for c in text.chars() {
            let glyph = font.glyph_id(c);
            let placed = glyph.with_scale_and_position(self.scale(em), point(x, 0.0));
            x += font.h_advance(glyph);
            let Some(outline) = font.outline_glyph(placed) else { continue };
            let corner = outline.px_bounds().min;
            let mut pixels = Vec::new();
            outline.draw(|x, y, coverage| pixels.push((x, y, coverage)));
            for (x, y, coverage) in pixels {
                let at = (x as i32 + corner.x as i32, y as i32 + corner.y as i32);
                draw(at, f64::from(coverage).clamp(0.0, 1.0))?;
            }
        }
        Ok(())
    }

    /// The library sizes fonts by the height of their line.
    fn scale(self, em: f64) -> PxScale {
        let line_per_em = self.0.height_unscaled() / self.0.units_per_em().unwrap_or(1.0);
        PxScale::from(em as f32 * line_per_em)
    }
}

/// Style sheet that carries the font.
pub fn style_sheet() -> String {
    let font = base64::engine::general_purpose::STANDARD.encode(ROBOTO);
    format!(
        "<style>@font-face{{font-family:Roboto;src:url(data:font/ttf;base64,{font}) format(\"truetype\")}}</style>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_has_the_signs_of_the_figures() {
        let font = Typeface::load().expect("a font");
        for sign in "0123456789.,;:()/-+±×–…·²³°₀₁₂σωφθλαΔéü\u{2212}".chars()
        {
            assert_ne!(font.0.glyph_id(sign).0, 0, "{sign}");
        }
        assert!((font.width_em("0") - 1150.0 / 2048.0).abs() < 0.01);
    }
}
