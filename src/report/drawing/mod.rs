//! Figures: a grid of panels, drawn once as SVG, of which PNG and PDF are made.

mod axis;
mod draw;
mod figure;
mod frame;
mod grid;
mod legend;
mod render;
pub mod style;

pub use axis::{Range, Scale};
pub use figure::{Figure, Layer, Layout, PT_PER_PX, PX_PER_INCH, Panel, Point, Print};
pub use render::Drawing;
pub use style::Look;
