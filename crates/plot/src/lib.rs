//! Rendering of figures as SVG, PNG, PDF and CSV, with identical bytes on every machine.
//!
//! A [`Figure`] is a grid of [`Panel`]s. The [`Layer`]s of a panel are its lines, bands and markers, and the
//! [`Look`] of a layer determines how it is drawn. The crate does not interpret the data; a figure may carry
//! the names of the trials and campaigns that it shows, and a notice that they are synthetic.
//!
//! - Data: `figure` and `style`.
//! - Layout: `axis` ([`Scale`], ticks), `grid`, `legend`, `dodge` (repeats beside each other).
//! - Drawing: `draw`, `frame` and `polyline`, with plotters and its backend `svg`; `render` returns a [`Drawing`].
//! - Files: `encode` ([`Format`]), `raster` (PNG), `pdf`, and `plotted` (data as CSV, and a text
//!   alternative).
//!
//! ```
//! use trilink_plot::{Figure, Format, LINE_WIDTH, Layer, Layout, Look, Panel, RGBColor};
//!
//! let look = Look::Line { colour: RGBColor(0, 114, 178), dash: None, width_px: LINE_WIDTH };
//! let line = Layer::new("d", [(1.0, 0.31), (2.0, 0.42)], look);
//! let panel = Panel::new("", "Actuation frequency ω (rad/s)", "d (m)", vec![line]);
//! let figure = Figure::new("distance", Default::default(), &[], Layout::Grid, vec![panel]);
//! assert!(figure.encode(Format::Svg).unwrap().starts_with(b"<svg"));
//! assert_eq!(figure.encode(Format::Csv).unwrap().split(|b| *b == b'\n').count(), 4);
//! ```
//!
//! The example `figure` draws two panels with curves and error bars in every format.

mod axis;
mod dodge;
mod draw;
mod encode;
mod figure;
mod frame;
mod grid;
mod legend;
mod pdf;
mod plotted;
mod polyline;
mod raster;
mod render;
mod style;
mod svg;

pub use axis::{Range, Scale};
pub use encode::{DrawError, Format};
pub use figure::{Figure, Layer, Layout, Panel, Point, Print};
pub use plotted::{number, text_alternative};
pub use plotters::style::RGBColor;
pub use polyline::envelope;
pub use render::Drawing;
pub use style::{DASHES, Dash, INK, LINE_WIDTH, Look, ROBOTO, SOLID, Shape, THICK, THIN, WIDTH};
