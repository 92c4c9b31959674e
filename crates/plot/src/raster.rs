//! The PNG of a figure, from its SVG.

use std::sync::{Arc, LazyLock};

use flate2::Compression;
use png::{BitDepth, ColorType, Encoder, EncodingError, PixelDimensions, Unit, chunk};
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

use crate::figure::PX_PER_INCH;
use crate::pdf::packed;
use crate::style;

/// Figures of very many panels are coarser.
const MOST_PIXELS: f32 = 2e7;
const INCHES_PER_METRE: f32 = 1.0 / 0.0254;

/// An SVG of a figure as a tree.
///
/// # Errors
/// A sentence on why it cannot be parsed.
pub(crate) fn parsed(svg: &str) -> Result<Tree, String> {
    /// The font of the figures and no other, so that the machine's do not matter.
    static FONTS: LazyLock<Arc<fontdb::Database>> = LazyLock::new(|| {
        let mut fonts = fontdb::Database::new();
        fonts.load_font_source(fontdb::Source::Binary(Arc::new(style::ROBOTO)));
        Arc::new(fonts)
    });
    let options = Options { fontdb: Arc::clone(&FONTS), ..Options::default() };
    // Nothing is drawn outside a panel, and to clip each takes longer than to draw it.
    let svg = svg.replace("<svg class=", "<svg overflow=\"visible\" class=");
    Tree::from_str(&svg, &options).map_err(|error| error.to_string())
}

/// The PNG of a figure with so many dots per inch. It knows its size in print, and has the comment.
///
/// # Errors
/// A sentence on why it cannot be encoded.
pub(crate) fn png(
    svg: &Tree,
    dots_per_inch: f32,
    comment: Option<&str>,
) -> Result<Vec<u8>, String> {
    let area = svg.size().width() * svg.size().height();
    let scale = (dots_per_inch / PX_PER_INCH).min((MOST_PIXELS / area).sqrt());
    let [width, height] =
        [svg.size().width(), svg.size().height()].map(|length| (length * scale).round() as u32);
    let mut pixels = Pixmap::new(width, height).ok_or("it has no size")?;
    resvg::render(svg, Transform::from_scale(scale, scale), &mut pixels.as_mut());
    encoded(&pixels, (scale * PX_PER_INCH * INCHES_PER_METRE).round() as u32, comment)
        .map_err(|error| error.to_string())
}

/// Opaque pixels as PNG: lines on white, each row as its difference to the one above, are packed well
/// with little effort.
fn encoded(
    pixels: &Pixmap,
    per_metre: u32,
    comment: Option<&str>,
) -> Result<Vec<u8>, EncodingError> {
    let mut png = Vec::new();
    let mut encoder = Encoder::new(&mut png, pixels.width(), pixels.height());
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_pixel_dims(Some(PixelDimensions {
        xppu: per_metre,
        yppu: per_metre,
        unit: Unit::Meter,
    }));
    if let Some(comment) = comment {
        encoder.add_text_chunk("Comment".to_owned(), comment.to_owned())?;
    }
    const UP: u8 = 2;
    /// Pixels that are compared at once.
    const PART: usize = 32;
    let width = pixels.width() as usize;
    let rows = pixels.data().as_chunks::<4>().0.chunks_exact(width);
    let first = vec![[0; 4]; width];
    let above = std::iter::once(first.as_slice()).chain(rows.clone());
    let mut filtered = vec![0; rows.len() * (1 + 3 * width)];
    for (into, (row, above)) in filtered.chunks_exact_mut(1 + 3 * width).zip(rows.zip(above)) {
        into[0] = UP;
        let parts = into[1..].chunks_mut(3 * PART).zip(row.chunks(PART).zip(above.chunks(PART)));
        for (into, (row, above)) in parts {
            // Most are.
            if row.as_flattened() == above.as_flattened() {
                continue;
            }
            let pixels = into.as_chunks_mut().0.iter_mut().zip(row.iter().zip(above));
            for (into, (pixel, above)) in pixels {
                *into = [0, 1, 2].map(|colour| pixel[colour].wrapping_sub(above[colour]));
            }
        }
    }
    let mut writer = encoder.write_header()?;
    writer.write_chunk(chunk::IDAT, &packed(&filtered, Compression::fast())?)?;
    writer.finish()?;
    Ok(png)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_has_the_signs_of_the_figures() {
        let drawn = |sign: char| {
            let text = format!(
                "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"20\" height=\"20\">\
                 <rect width=\"20\" height=\"20\" fill=\"#ffffff\"/>\
                 <text y=\"15\" font-family=\"{}\">{sign}</text></svg>",
                style::FAMILY
            );
            parsed(&text).and_then(|svg| png(&svg, PX_PER_INCH, None)).expect("draws")
        };
        let (nothing, missing) = (drawn(' '), drawn('\u{6f22}'));
        for sign in "0123456789.,;:()/-+±×–…·²³°₀₁₂σωφθλαΔéü\u{2212}".chars()
        {
            let sign_png = drawn(sign);
            assert!(sign_png != nothing && sign_png != missing, "{sign}");
        }
    }
}
