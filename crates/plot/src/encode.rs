//! A figure in the formats of files.

use trilink_base::named;

use crate::{Drawing, Figure, pdf, plotted, raster};

named! {
    /// Formats that figures are written in.
    pub enum Format {
        /// With its font inside.
        Svg = "svg",
        /// 288 dots per inch on screens, 600 in print.
        Png = "png",
        /// One page of the figure's size.
        Pdf = "pdf",
        /// The plotted numbers.
        Csv = "csv",
    }
}

/// Why a figure cannot be drawn.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("figure {figure}: cannot be drawn: {message}")]
pub struct DrawError {
    /// Its name.
    pub figure: String,
    pub message: String,
}

impl Figure {
    /// The bytes of a file in one format.
    ///
    /// # Errors
    /// The figure cannot be drawn.
    pub fn encode(&self, format: Format) -> Result<Vec<u8>, DrawError> {
        if format == Format::Csv {
            return Ok(plotted::csv(self).into_bytes());
        }
        let svg = Drawing::of(self)?.svg();
        match format {
            Format::Png => self.png(&self.parsed(&svg)?),
            Format::Pdf => self.pdf(&self.parsed(&svg)?),
            _ => Ok(svg.into_bytes()),
        }
    }

    /// The drawing, and the bytes of its files in the order of [`Format::ALL`].
    ///
    /// # Errors
    /// The figure cannot be drawn.
    pub fn encode_all(&self) -> Result<(Drawing, [Vec<u8>; 4]), DrawError> {
        let drawing = Drawing::of(self)?;
        let svg = drawing.svg();
        let tree = self.parsed(&svg)?;
        let files =
            [svg.into_bytes(), self.png(&tree)?, self.pdf(&tree)?, plotted::csv(self).into_bytes()];
        Ok((drawing, files))
    }

    fn parsed(&self, svg: &str) -> Result<resvg::usvg::Tree, DrawError> {
        raster::parsed(svg).map_err(|message| self.error(message))
    }

    fn png(&self, tree: &resvg::usvg::Tree) -> Result<Vec<u8>, DrawError> {
        raster::png(tree, self.print.dots_per_inch(), self.comment())
            .map_err(|message| self.error(message))
    }

    fn pdf(&self, tree: &resvg::usvg::Tree) -> Result<Vec<u8>, DrawError> {
        pdf::pdf(tree, &self.title, self.comment()).map_err(|error| self.error(error.to_string()))
    }

    pub(crate) fn error(&self, message: String) -> DrawError {
        DrawError { figure: self.stem.clone(), message }
    }
}
