//! A figure as SVG with its font inside, and that as PNG.

use std::sync::{Arc, LazyLock};

use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use plotters::prelude::{IntoDrawingArea, SVGBackend};
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg;

use super::draw;
use super::figure::Figure;
use super::grid::Grid;
use super::style::{self, units};
use crate::report::ReportError;

/// Pixels of the PNG per px of the figure: 1380 across, 394 dots per inch in a column.
const PNG_SCALE: f32 = 3.0;
const COLUMN_WIDTH_M: f64 = 0.0889;

/// Width and height of a figure, px.
pub fn size(figure: &Figure) -> (f64, f64) {
    let grid = Grid::new(figure);
    (grid.width, grid.height)
}

/// A figure as SVG with its font inside.
///
/// # Errors
/// The backend fails.
pub fn svg(figure: &Figure) -> Result<String, ReportError> {
    let grid = Grid::new(figure);
    let (width, height) = (grid.width, grid.height);
    let (fine_width, fine_height) = (units(width), units(height));
    let mut drawing = String::new();
    let backend = SVGBackend::with_string(&mut drawing, (fine_width as u32, fine_height as u32));
    draw::draw(grid, &backend.into_drawing_area()).map_err(|error| draw_error(figure, error))?;
    let body = drawing.split_once('\n').map_or("", |(_, body)| body);
    let font = BASE64.encode(style::ROBOTO);
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {fine_width} {fine_height}\">\n\
         <style>@font-face{{font-family:Roboto;src:url(data:font/ttf;base64,{font}) format(\"truetype\")}}</style>\n\
         {body}"
    ))
}

/// The PNG of an SVG of a figure. It knows its size in print.
///
/// # Errors
/// It cannot be parsed or encoded.
pub fn png(figure: &Figure, svg: &str) -> Result<Vec<u8>, ReportError> {
    rasterise(svg).map_err(|message| draw_error(figure, message))
}

fn draw_error(figure: &Figure, error: impl std::fmt::Display) -> ReportError {
    ReportError::Draw { figure: figure.stem.clone(), message: error.to_string() }
}

fn rasterise(svg: &str) -> Result<Vec<u8>, String> {
    /// The font of the figures and no other, so that the machine's do not matter.
    static FONTS: LazyLock<Arc<usvg::fontdb::Database>> = LazyLock::new(|| {
        let mut fonts = usvg::fontdb::Database::new();
        fonts.load_font_source(usvg::fontdb::Source::Binary(Arc::new(style::ROBOTO)));
        Arc::new(fonts)
    });
    let options = usvg::Options { fontdb: Arc::clone(&FONTS), ..usvg::Options::default() };
    let tree = usvg::Tree::from_str(svg, &options).map_err(|error| error.to_string())?;
    let [width, height] = [tree.size().width(), tree.size().height()]
        .map(|length| (length * PNG_SCALE).round() as u32);
    let mut pixels = Pixmap::new(width, height).ok_or("it has no size")?;
    resvg::render(&tree, Transform::from_scale(PNG_SCALE, PNG_SCALE), &mut pixels.as_mut());
    let png = pixels.encode_png().map_err(|error| error.to_string())?;
    Ok(with_resolution(&png, (f64::from(width) / COLUMN_WIDTH_M).round() as u32))
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
        let png = |sign: char| {
            let text = format!(
                "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"20\" height=\"20\">\
                 <text y=\"15\" font-family=\"{}\">{sign}</text></svg>",
                style::FAMILY
            );
            rasterise(&text).expect("draws")
        };
        let (nothing, missing) = (png(' '), png('\u{6f22}'));
        for sign in "0123456789.,;:()/-+±×–…·²³°₀₁₂σωφθλαΔéü\u{2212}".chars()
        {
            let sign_png = png(sign);
            assert!(sign_png != nothing && sign_png != missing, "{sign}");
        }
    }
}
