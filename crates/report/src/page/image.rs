//! Figures embedded in HTML pages.

use minijinja::context;
use minijinja::value::Value;
use trilink_plot::{DrawError, Drawing, Figure, WIDTH};

use crate::figures;

/// Draws a figure and returns the template values with which a page embeds it.
///
/// # Errors
/// Returns an error if the figure cannot be drawn.
pub fn image(figure: &Figure) -> Result<Value, DrawError> {
    let drawing = Drawing::on_screen(figure)?;
    let [legend, panels] = drawing.parts();
    let Drawing { columns, width, .. } = drawing;
    Ok(context! {
        stem => &figure.stem,
        id => figures::id(&figure.stem),
        number => figures::number(&figure.stem),
        title => &figure.title,
        caption => &figure.caption,
        alternative => trilink_plot::text_alternative(figure),
        synthetic => figure.is_synthetic,
        legend,
        panels,
        columns,
        width => width.round() as u32,
        wide => width > WIDTH,
    })
}
