//! Drawings inside of pages.

use minijinja::context;
use minijinja::value::Value;

use crate::report::ReportError;
use crate::report::drawing::{self, Figure};
use crate::report::{figures, plotted};

/// Draws a figure for a page.
///
/// # Errors
/// It cannot be drawn.
pub fn image(figure: &Figure) -> Result<Value, ReportError> {
    let error = |message| ReportError::Draw { figure: figure.stem.clone(), message };
    Ok(image_of_svg(figure, &drawing::svg(figure).map_err(error)?))
}

/// A figure that was drawn, for a page.
pub fn image_of_svg(figure: &Figure, svg: &str) -> Value {
    let (columns, width) = drawing::size(figure);
    let [legend, panels] = drawing::parts(svg);
    context! {
        stem => &figure.stem,
        number => figures::number(&figure.stem),
        title => &figure.title,
        caption => &figure.caption,
        alternative => plotted::text_alternative(figure),
        legend,
        panels,
        columns,
        width => width.round() as u32,
        wide => width > drawing::style::WIDTH,
    }
}
