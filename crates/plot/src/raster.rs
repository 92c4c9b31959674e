//! Conversion of a figure's SVG to PNG.

use std::sync::{Arc, LazyLock};

use flate2::Compression;
use png::{BitDepth, ColorType, Encoder, EncodingError, PixelDimensions, Unit, chunk};
use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

use crate::figure::PX_PER_INCH;
use crate::pdf::compress;
use crate::style;

const DOTS_PER_INCH: f32 = 350.0;
/// Maximum number of pixels; very large figures get a lower resolution.
const MAX_PIXELS: f32 = 2e7;
const INCHES_PER_METRE: f32 = 1.0 / 0.0254;

/// Parses the SVG of a figure.
///
/// # Errors
/// Returns the reason if the SVG cannot be parsed.
pub(crate) fn parsed(svg: &str) -> Result<Tree, String> {
    /// Font database that contains only the font of the figures, so that the result does not depend on
    /// installed fonts.
    static FONTS: LazyLock<Arc<fontdb::Database>> = LazyLock::new(|| {
        let mut fonts = fontdb::Database::new();
        fonts.load_font_source(fontdb::Source::Binary(Arc::new(style::ROBOTO)));
        Arc::new(fonts)
    });
    let options = Options { fontdb: Arc::clone(&FONTS), ..Options::default() };
    // Clipping is disabled, because nothing is drawn outside a panel and clipping takes longer than drawing.
    let svg = svg.replace("<svg class=", "<svg overflow=\"visible\" class=");
    Tree::from_str(&svg, &options).map_err(|error| error.to_string())
}

/// Renders a figure as PNG, in which its resolution and the comment are stored.
///
/// # Errors
/// Returns the reason if the figure cannot be encoded.
pub(crate) fn png(svg: &Tree, comment: Option<&str>) -> Result<Vec<u8>, String> {
    let area = svg.size().width() * svg.size().height();
    let scale = (DOTS_PER_INCH / PX_PER_INCH).min((MAX_PIXELS / area).sqrt());
    let [width, height] =
        [svg.size().width(), svg.size().height()].map(|length| (length * scale).round() as u32);
    let mut pixels =
        Pixmap::new(width, height).ok_or("the width or height of the figure is zero")?;
    // The figure's background covers the last column and row only in part.
    pixels.fill(Color::WHITE);
    resvg::render(svg, Transform::from_scale(scale, scale), &mut pixels.as_mut());
    encode(&pixels, (scale * PX_PER_INCH * INCHES_PER_METRE).round() as u32, comment)
        .map_err(|error| error.to_string())
}

/// Encodes opaque pixels as PNG. Each row is stored as its difference from the row above; lines on a white
/// background then compress well with little effort.
fn encode(
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
    /// Number of pixels of neighbouring rows that are compared at once.
    const CHUNK: usize = 32;
    let width = pixels.width() as usize;
    let rows = pixels.data().as_chunks::<4>().0.chunks_exact(width);
    let first = vec![[0; 4]; width];
    let above = std::iter::once(first.as_slice()).chain(rows.clone());
    let mut filtered = vec![0; rows.len() * (1 + 3 * width)];
    for (into, (row, above)) in filtered.chunks_exact_mut(1 + 3 * width).zip(rows.zip(above)) {
        into[0] = UP;
        let chunks =
            into[1..].chunks_mut(3 * CHUNK).zip(row.chunks(CHUNK).zip(above.chunks(CHUNK)));
        for (into, (row, above)) in chunks {
            // Most chunks equal the one above, and their differences are zero already.
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
    writer.write_chunk(chunk::IDAT, &compress(&filtered, Compression::fast())?)?;
    writer.finish()?;
    Ok(png)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_has_the_signs_of_the_figures() {
        let render = |sign: char| {
            let text = format!(
                "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"20\" height=\"20\">\
                 <rect width=\"20\" height=\"20\" fill=\"#ffffff\"/>\
                 <text y=\"15\" font-family=\"{}\">{sign}</text></svg>",
                style::FAMILY
            );
            parsed(&text).and_then(|svg| png(&svg, None)).expect("draws")
        };
        let blank = render(' ');
        let missing = render('\u{6f22}');
        for sign in "0123456789.,;:()/-+±×–…·²³°₀₁₂σωφθλαΔéü\u{2212}".chars()
        {
            let png = render(sign);
            assert!(png != blank && png != missing, "{sign}");
        }
    }

    #[test]
    fn a_width_that_is_no_whole_number_of_pixels_leaves_no_line_at_the_edge() {
        let text = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"21\" height=\"21\">\
                    <rect width=\"21\" height=\"21\" fill=\"#ffffff\"/></svg>";
        let png = parsed(text).and_then(|svg| png(&svg, None)).expect("draws");
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().expect("a PNG");
        let mut pixels = vec![0; reader.output_buffer_size().expect("a small image")];
        reader.next_frame(&mut pixels).expect("an image");
        assert!(pixels.iter().all(|value| *value == 255));
    }
}
