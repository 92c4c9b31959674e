//! Figures that a command writes, in the format that the file's ending names.

use super::drawing::{Drawing, Figure};
use super::{ReportError, pdf, raster};

/// The drawing of a figure in the format that a file with this ending has: `svg`, `png` or `pdf`.
///
/// # Errors
/// There is no such format, or nothing can be drawn.
pub(super) fn drawn(figure: &Figure, ending: &str) -> Result<Vec<u8>, ReportError> {
    let error = |message| ReportError::Draw { figure: figure.stem.clone(), message };
    let svg = Drawing::of(figure).map_err(error)?.svg();
    match ending {
        "svg" => Ok(svg.into_bytes()),
        "png" => raster::parsed(&svg)
            .and_then(|tree| raster::png(&tree, figure.print.dots_per_inch()))
            .map_err(error),
        "pdf" => {
            let tree = raster::parsed(&svg).map_err(error)?;
            pdf::pdf(&tree, &figure.title).map_err(|why| error(why.to_string()))
        }
        _ => Err(error(format!("found the ending `{ending}`, needed svg, png or pdf"))),
    }
}
