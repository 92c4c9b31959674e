//! Figures as SVG and PNG, by the same drawing.

use plotters::backend::{BitMapBackend, SVGBackend};

use super::canvas::{Canvas, Lettering};
use super::figure::Figure;
use super::font::{self, Typeface};
use super::{ReportError, plot};

/// SVG coordinates are whole numbers; a tenth of a pixel is fine enough for smooth curves.
const SVG_SCALE: f64 = 10.0;
/// Pixels of the PNG per px of the figure: 1380 across, 394 dots per inch in a column.
const PNG_SCALE: usize = 3;
/// Drawn finer and averaged, because the backend leaves the edges of wide strokes jagged.
const OVERSAMPLING: usize = 2;
const COLUMN_WIDTH_M: f64 = 0.0889;

/// A figure as SVG with its font inside.
///
/// # Errors
/// The backend fails, or the font cannot be read.
pub fn svg(figure: &Figure) -> Result<String, ReportError> {
    let font = Typeface::load()?;
    let (width, height) = plot::size(figure, font);
    let fine = ((width * SVG_SCALE) as u32, (height * SVG_SCALE) as u32);
    let mut drawing = String::new();
    {
        let mut backend = SVGBackend::with_string(&mut drawing, fine);
        let mut canvas =
            Canvas { backend: &mut backend, scale: SVG_SCALE, lettering: Lettering::Text, font };
        plot::draw(figure, &mut canvas).map_err(|error| draw_error(figure, &error))?;
    }
    let body = drawing.split_once('\n').map_or("", |(_, body)| body);
    let (fine_width, fine_height) = fine;
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {fine_width} {fine_height}\">\n{}\n{body}",
        font::style_sheet()
    ))
}

/// A figure as PNG that knows its size in print.
///
/// # Errors
/// As [`svg`], or the pixels cannot be encoded.
pub fn png(figure: &Figure) -> Result<Vec<u8>, ReportError> {
    let font = Typeface::load()?;
    let (width, height) = plot::size(figure, font);
    let pixels = |length: f64| (length * PNG_SCALE as f64).round() as usize;
    let (width, height) = (pixels(width), pixels(height));
    let fine = (width * OVERSAMPLING, height * OVERSAMPLING);
    let mut buffer = vec![0xff; fine.0 * fine.1 * CHANNELS];
    {
        let size = (fine.0 as u32, fine.1 as u32);
        let mut backend = BitMapBackend::with_buffer(&mut buffer, size);
        let scale = (PNG_SCALE * OVERSAMPLING) as f64;
        let mut canvas =
            Canvas { backend: &mut backend, scale, lettering: Lettering::Pixels, font };
        plot::draw(figure, &mut canvas).map_err(|error| draw_error(figure, &error))?;
    }
    encode(&average(&buffer, width, height), width, height)
        .map_err(|source| ReportError::Png { figure: figure.stem.clone(), source })
}

fn draw_error(figure: &Figure, error: &impl std::fmt::Display) -> ReportError {
    ReportError::Draw { figure: figure.stem.clone(), message: error.to_string() }
}

const CHANNELS: usize = 3;

/// Each pixel the mean of the [`OVERSAMPLING`]² that it was drawn with.
fn average(fine: &[u8], width: usize, height: usize) -> Vec<u8> {
    let row_length = width * OVERSAMPLING * CHANNELS;
    let mut pixels = Vec::with_capacity(width * height * CHANNELS);
    let mut sums = vec![0_u16; width * CHANNELS];
    for rows in fine.chunks_exact(row_length * OVERSAMPLING) {
        sums.fill(0);
        for row in rows.chunks_exact(row_length) {
            let blocks = row.chunks_exact(OVERSAMPLING * CHANNELS);
            for (sum, block) in sums.chunks_exact_mut(CHANNELS).zip(blocks) {
                for pixel in block.chunks_exact(CHANNELS) {
                    for (channel, value) in sum.iter_mut().zip(pixel) {
                        *channel += u16::from(*value);
                    }
                }
            }
        }
        let count = (OVERSAMPLING * OVERSAMPLING) as u16;
        pixels.extend(sums.iter().map(|sum| ((sum + count / 2) / count) as u8));
    }
    pixels
}

fn encode(pixels: &[u8], width: usize, height: usize) -> Result<Vec<u8>, png::EncodingError> {
    let per_metre = (width as f64 / COLUMN_WIDTH_M).round() as u32;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_pixel_dims(Some(png::PixelDimensions {
        xppu: per_metre,
        yppu: per_metre,
        unit: png::Unit::Meter,
    }));
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(bytes)
}
