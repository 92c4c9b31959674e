//! Figures that a command writes, in the format that the file's ending names.

use trilink_base::Named as _;
use trilink_plot::{DrawError, Figure, Format};

use super::ReportError;

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
    let format =
        Format::of_name(ending).filter(|format| *format != Format::Csv).ok_or_else(|| {
            let message = format!("found the ending `{ending}`, needed svg, png or pdf");
            DrawError { figure: figure.stem.clone(), message }
        })?;
    Ok(Figure { is_synthetic, ..figure.clone() }.encode(format)?)
}
