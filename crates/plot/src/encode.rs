//! Encoding of a figure in the supported file formats.

use trilink_base::named;

use crate::{Drawing, Figure, pdf, plotted, raster};

named! {
    /// File format of a figure.
    pub enum Format {
        /// SVG with an embedded font.
        Svg = "svg",
        /// PNG with 350 dots per inch.
        Png = "png",
        /// PDF with a single page of the figure's size.
        Pdf = "pdf",
        /// Plotted data as CSV.
        Csv = "csv",
    }
}

/// Error that occurred while a figure was drawn.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("figure {figure}: cannot be drawn: {message}")]
pub struct DrawError {
    /// Name of the figure that could not be drawn.
    pub figure: String,
    pub message: String,
}

impl Figure {
    /// Encodes the figure in one format.
    ///
    /// # Errors
    /// Returns an error if the figure cannot be drawn.
    pub fn encode(&self, format: Format) -> Result<Vec<u8>, DrawError> {
        if format == Format::Csv {
            return Ok(plotted::csv(self).into_bytes());
        }
        let svg = Drawing::new(self)?.svg();
        match format {
            Format::Png => self.png(&self.parsed(&svg)?),
            Format::Pdf => self.pdf(&self.parsed(&svg)?),
            _ => Ok(svg.into_bytes()),
        }
    }

    /// Encodes the figure in all formats, in the order of [`Format::ALL`].
    ///
    /// # Errors
    /// Returns an error if the figure cannot be drawn.
    pub fn encode_all(&self) -> Result<[Vec<u8>; 4], DrawError> {
        let svg = Drawing::new(self)?.svg();
        let tree = self.parsed(&svg)?;
        Ok([svg.into_bytes(), self.png(&tree)?, self.pdf(&tree)?, plotted::csv(self).into_bytes()])
    }

    fn parsed(&self, svg: &str) -> Result<resvg::usvg::Tree, DrawError> {
        raster::parsed(svg).map_err(|message| self.error(message))
    }

    fn png(&self, tree: &resvg::usvg::Tree) -> Result<Vec<u8>, DrawError> {
        raster::png(tree, self.comment()).map_err(|message| self.error(message))
    }

    fn pdf(&self, tree: &resvg::usvg::Tree) -> Result<Vec<u8>, DrawError> {
        pdf::pdf(tree, &self.title, self.comment()).map_err(|error| self.error(error.to_string()))
    }

    pub(crate) fn error(&self, message: String) -> DrawError {
        DrawError { figure: self.stem.clone(), message }
    }
}
