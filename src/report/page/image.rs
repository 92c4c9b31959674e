//! Drawings inside of pages.

use minijinja::context;
use minijinja::value::Value;

use crate::report::ReportError;
use crate::report::drawing::{Drawing, Figure, style};
use crate::report::{figures, plotted};

/// Draws a figure for a page.
///
/// # Errors
/// It cannot be drawn.
pub fn image(figure: &Figure) -> Result<Value, ReportError> {
    let error = |message| ReportError::Draw { figure: figure.stem.clone(), message };
    Ok(image_of_drawing(figure, &Drawing::of(figure).map_err(error)?))
}

/// A figure that was drawn, for a page.
pub fn image_of_drawing(figure: &Figure, drawing: &Drawing) -> Value {
    let [legend, panels] = drawing.parts();
    let Drawing { columns, width, .. } = *drawing;
    context! {
        stem => &figure.stem,
        number => figures::number(&figure.stem),
        title => &figure.title,
        caption => &figure.caption,
        alternative => plotted::text_alternative(figure),
        synthetic => figure.is_synthetic,
        legend,
        panels,
        columns,
        width => width.round() as u32,
        wide => width > style::WIDTH,
    }
}
