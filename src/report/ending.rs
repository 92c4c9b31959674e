//! Figures that a command writes, in the format that the file's ending names.

use super::drawing::{Drawing, Figure};
use super::{ReportError, pdf, raster};

/// File that a command writes a figure to.
#[derive(Debug, Clone, Copy)]
pub struct FigureFile<'f> {
    /// Of its name: `svg`, `png` or `pdf`.
    pub ending: &'f str,
    /// What it shows was fitted to synthetic trials.
    pub is_synthetic: bool,
}

/// The drawing of a figure in the format that such a file has.
///
/// # Errors
/// There is no such format, or nothing can be drawn.
pub(super) fn drawn(figure: &Figure, file: FigureFile<'_>) -> Result<Vec<u8>, ReportError> {
    let FigureFile { ending, is_synthetic } = file;
    let figure = &Figure { is_synthetic, ..figure.clone() };
    let error = |message| ReportError::Draw { figure: figure.stem.clone(), message };
    let svg = Drawing::of(figure).map_err(error)?.svg();
    match ending {
        "svg" => Ok(svg.into_bytes()),
        "png" => raster::parsed(&svg)
            .and_then(|tree| raster::png(&tree, figure.print.dots_per_inch(), figure.comment()))
            .map_err(error),
        "pdf" => {
            let tree = raster::parsed(&svg).map_err(error)?;
            pdf::pdf(&tree, &figure.title, figure.comment()).map_err(|why| error(why.to_string()))
        }
        _ => Err(error(format!("found the ending `{ending}`, needed svg, png or pdf"))),
    }
}
