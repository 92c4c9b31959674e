//! Drawings inside of pages other than the report's own.

use base64::Engine;
use serde::Serialize;

use crate::report::ReportError;
use crate::report::drawing::{self, Figure};

/// A figure inside a page.
#[derive(Serialize)]
pub struct Image {
    pub title: String,
    pub caption: String,
    pub alternative: String,
    pub image_base64: String,
    pub width: u32,
    pub height: u32,
}

impl Image {
    /// Draws a figure.
    ///
    /// # Errors
    /// It cannot be drawn.
    pub fn draw(figure: &Figure) -> Result<Self, ReportError> {
        let (width, height) = drawing::size(figure);
        Ok(Self {
            title: figure.title.clone(),
            caption: figure.caption.clone(),
            alternative: figure.text_alternative(),
            image_base64: base64::engine::general_purpose::STANDARD.encode(drawing::svg(figure)?),
            width: width.round() as u32,
            height: height.round() as u32,
        })
    }
}
