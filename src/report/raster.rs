//! The PNG of a figure, from its SVG.

use std::sync::{Arc, LazyLock};

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

use super::drawing::style;

/// Figures of very many panels are coarser.
const MOST_PIXELS: f32 = 2e7;
const PX_PER_INCH: f32 = 96.0;
const INCHES_PER_METRE: f32 = 1.0 / 0.0254;

/// An SVG of a figure as a tree.
///
/// # Errors
/// A sentence on why it cannot be parsed.
pub fn parsed(svg: &str) -> Result<Tree, String> {
    /// The font of the figures and no other, so that the machine's do not matter.
    static FONTS: LazyLock<Arc<fontdb::Database>> = LazyLock::new(|| {
        let mut fonts = fontdb::Database::new();
        fonts.load_font_source(fontdb::Source::Binary(Arc::new(style::ROBOTO)));
        Arc::new(fonts)
    });
    let options = Options { fontdb: Arc::clone(&FONTS), ..Options::default() };
    Tree::from_str(svg, &options).map_err(|error| error.to_string())
}

/// The PNG of a figure with so many dots per inch. It knows its size in print.
///
/// # Errors
/// A sentence on why it cannot be encoded.
pub fn png(svg: &Tree, dots_per_inch: f32) -> Result<Vec<u8>, String> {
    let area = svg.size().width() * svg.size().height();
    let scale = (dots_per_inch / PX_PER_INCH).min((MOST_PIXELS / area).sqrt());
    let [width, height] =
        [svg.size().width(), svg.size().height()].map(|length| (length * scale).round() as u32);
    let mut pixels = Pixmap::new(width, height).ok_or("it has no size")?;
    resvg::render(svg, Transform::from_scale(scale, scale), &mut pixels.as_mut());
    let png = pixels.encode_png().map_err(|error| error.to_string())?;
    Ok(with_resolution(&png, (scale * PX_PER_INCH * INCHES_PER_METRE).round() as u32))
}

/// A PNG with its resolution, which the encoder does not write, after the first chunk.
fn with_resolution(png: &[u8], per_metre: u32) -> Vec<u8> {
    let resolution = per_metre.to_be_bytes();
    let content = [b"pHYs", &resolution[..], &resolution, &[1]].concat();
    let mut sum = flate2::Crc::new();
    sum.update(&content);
    let (header, rest) = png.split_at(8 + 25);
    [header, &9_u32.to_be_bytes(), &content, &sum.sum().to_be_bytes(), rest].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_has_the_signs_of_the_figures() {
        let drawn = |sign: char| {
            let text = format!(
                "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"20\" height=\"20\">\
                 <text y=\"15\" font-family=\"{}\">{sign}</text></svg>",
                style::FAMILY
            );
            parsed(&text).and_then(|svg| png(&svg, PX_PER_INCH)).expect("draws")
        };
        let (nothing, missing) = (drawn(' '), drawn('\u{6f22}'));
        for sign in "0123456789.,;:()/-+±×–…·²³°₀₁₂σωφθλαΔéü\u{2212}".chars()
        {
            let sign_png = drawn(sign);
            assert!(sign_png != nothing && sign_png != missing, "{sign}");
        }
    }
}
