//! Lines and markers, the same in panels and legends.

use plotters::chart::ChartContext;
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::{CoordTranslate, Shift};
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::element::{Circle, EmptyElement, Rectangle};
use plotters::prelude::SVGBackend;
use plotters::style::{Color, RGBColor};

use super::axis::Axis;
use super::style::{MARKER_RADIUS, PAPER, Shape, units};

/// A part of the drawing, with coordinates in the backend's units from its upper left corner.
pub type Area<'b> = DrawingArea<SVGBackend<'b>, Shift>;
/// A panel of the drawing, with the coordinates of its axes.
pub type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Axis, Axis>>;
pub type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// Width of an error bar's ends, px.
pub const ERROR_BAR_ENDS: f64 = 6.4;

/// Draws a marker; an open one hides what is under it, so that lines do not strike it through.
pub fn draw_marker<'b, T: CoordTranslate>(
    area: &DrawingArea<SVGBackend<'b>, T>,
    at: T::From,
    (colour, shape, filled): (RGBColor, Shape, bool),
) -> Drawn
where
    T::From: Copy,
{
    const WALL: f64 = 1.5;
    let core_colour = if filled { colour } else { PAPER };
    for (radius, colour) in [(MARKER_RADIUS, colour), (MARKER_RADIUS - WALL, core_colour)] {
        let (half, fill) = (units(0.92 * radius), colour.filled());
        match shape {
            Shape::Circle => area.draw(&Circle::new(at, units(radius), fill))?,
            Shape::Square => area.draw(
                &(EmptyElement::at(at) + Rectangle::new([(-half, -half), (half, half)], fill)),
            )?,
        }
    }
    Ok(())
}
