//! Figures written by single commands, in the format given by the file extension.

use trilink_base::Named as _;
use trilink_plot::{DrawError, Figure, Format, Print};

use super::ReportError;

/// Format, labelling and printed size of the file to which a command writes a figure.
#[derive(Debug, Clone, Copy)]
pub struct FigureFile<'f> {
    /// File extension: `svg`, `png` or `pdf`.
    pub ending: &'f str,
    /// Whether the figure shows results of synthetic trials.
    pub is_synthetic: bool,
    pub print: Print,
}

/// Draws a figure in the format that `file` specifies.
///
/// # Errors
/// Returns an error if the file's extension is not `svg`, `png` or `pdf`, or if the figure cannot be drawn.
pub(super) fn drawn(figure: &Figure, file: FigureFile<'_>) -> Result<Vec<u8>, ReportError> {
    let FigureFile { ending, is_synthetic, print } = file;
    let format =
        Format::of_name(ending).filter(|format| *format != Format::Csv).ok_or_else(|| {
            let message = format!("found the file extension `{ending}`, needed svg, png or pdf");
            DrawError { figure: figure.stem.clone(), message }
        })?;
    Ok(Figure { is_synthetic, print, ..figure.clone() }.encode(format)?)
}
