//! Drawings inside of pages.

use base64::Engine;
use serde::Serialize;

use crate::report::ReportError;
use crate::report::drawing::{self, Figure};
use crate::report::plotted;

/// A figure inside a page.
#[derive(Serialize)]
pub struct Image {
    stem: String,
    number: String,
    title: String,
    caption: String,
    alternative: String,
    /// The SVG.
    image_base64: String,
    width: u32,
    height: u32,
    /// Whether it needs the whole width of the page.
    wide: bool,
}

impl Image {
    /// Draws a figure.
    ///
    /// # Errors
    /// It cannot be drawn.
    pub fn draw(figure: &Figure) -> Result<Self, ReportError> {
        Ok(Self::of_svg(figure, &drawing::svg(figure)?))
    }

    /// A figure that was drawn.
    pub fn of_svg(figure: &Figure, svg: &str) -> Self {
        let (width, height) = drawing::size(figure);
        Self {
            stem: figure.stem.clone(),
            number: figure.number.clone(),
            title: figure.title.clone(),
            caption: figure.caption.clone(),
            alternative: plotted::text_alternative(figure),
            image_base64: base64::engine::general_purpose::STANDARD.encode(svg),
            width: width.round() as u32,
            height: height.round() as u32,
            wide: width > drawing::style::WIDTH,
        }
    }
}
