//! Strokes, markers and text at fractions of a pixel, the same on every plotters backend.

use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontTransform, IntoFont, RGBColor, ShapeStyle, TextStyle};
use plotters_backend::{DrawingBackend, DrawingErrorKind};

use super::font::{self, Typeface};
use super::style::{self, Shape};

/// How text gets onto a backend.
#[derive(Clone, Copy)]
pub enum Lettering {
    /// As text that the viewer sets in the figure's font.
    Text,
    /// As pixels; plotters' own would sit on whole pixels without side bearings.
    Pixels,
}

/// A backend whose pixels are `1 / scale` of ours.
pub struct Canvas<'b, B: DrawingBackend> {
    pub backend: &'b mut B,
    pub scale: f64,
    pub lettering: Lettering,
    pub font: Typeface,
}

/// Plotters writes SVG text at its size over this,
const SVG_SIZE_PER_EM: f64 = 1.24;
/// and puts the baseline so far below the anchor of text hung from its top.
const SVG_BASELINE_EM: f64 = 0.76;

pub type Drawn<B> = Result<(), DrawingErrorKind<<B as DrawingBackend>::ErrorType>>;

/// Where text stands.
#[derive(Clone, Copy)]
pub struct TextAt {
    pub x: f64,
    /// Of the baseline.
    pub y: f64,
    pub em: f64,
    pub colour: RGBColor,
    pub align: HPos,
}

impl<B: DrawingBackend> Canvas<'_, B> {
    fn at(&self, (x, y): (f64, f64)) -> (i32, i32) {
        ((x * self.scale).round() as i32, (y * self.scale).round() as i32)
    }

    fn length(&self, length: f64) -> u32 {
        (length * self.scale).round().max(1.0) as u32
    }

    fn stroke(&self, colour: RGBColor, width: f64) -> ShapeStyle {
        colour.stroke_width(self.length(width))
    }

    pub fn fill(&mut self, from: (f64, f64), to: (f64, f64), colour: RGBColor) -> Drawn<B> {
        let (from, to) = (self.at(from), self.at(to));
        self.backend.draw_rect(from, to, &colour.filled(), true)
    }

    pub fn line(&mut self, points: &[(f64, f64)], colour: RGBColor, width: f64) -> Drawn<B> {
        let mut path: Vec<_> = points.iter().map(|&point| self.at(point)).collect();
        path.dedup();
        let stroke = self.stroke(colour, width);
        let radius = stroke.stroke_width / 2;
        match (self.lettering, path.as_slice()) {
            (_, [] | [_]) => Ok(()),
            // Where a broad line turns sharply, plotters leaves holes in its pixels.
            (Lettering::Pixels, [_, .., last]) if path.len() > 2 && radius > 1 => {
                for pair in path.windows(2) {
                    self.backend.draw_path(pair.to_vec(), &stroke)?;
                }
                let (first, fill) = (path[0], colour.filled());
                let mut joints = path[1..path.len() - 1]
                    .iter()
                    .filter(|joint| *joint != &first && *joint != last);
                joints.try_for_each(|joint| self.backend.draw_circle(*joint, radius, &fill, true))
            }
            _ => self.backend.draw_path(path, &stroke),
        }
    }

    pub fn circle(&mut self, centre: (f64, f64), radius: f64, colour: RGBColor) -> Drawn<B> {
        let (centre, radius) = (self.at(centre), self.length(radius));
        self.backend.draw_circle(centre, radius, &colour.filled(), true)
    }

    /// A marker; an open one hides what is under it, so that lines do not strike it through.
    pub fn marker(
        &mut self,
        centre: (f64, f64),
        colour: RGBColor,
        shape: Shape,
        filled: bool,
    ) -> Drawn<B> {
        const WALL: f64 = 1.5;
        let mut disc = |half: f64, colour| match shape {
            Shape::Circle => self.circle(centre, half, colour),
            Shape::Square => {
                let half = half * 0.92;
                let (x, y) = centre;
                self.fill((x - half, y - half), (x + half, y + half), colour)
            }
        };
        disc(style::MARKER_RADIUS, colour)?;
        if filled { Ok(()) } else { disc(style::MARKER_RADIUS - WALL, style::PAPER) }
    }

    /// An error bar with its ends.
    pub fn error_bar(&mut self, x: f64, low: f64, high: f64, colour: RGBColor) -> Drawn<B> {
        /// Half the width of the ends.
        const END: f64 = 3.2;
        self.line(&[(x, low), (x, high)], colour, style::FRAME_WIDTH)?;
        for end in [low, high] {
            self.line(&[(x - END, end), (x + END, end)], colour, style::FRAME_WIDTH)?;
        }
        Ok(())
    }

    pub fn text(&mut self, text: &str, at: TextAt) -> Drawn<B> {
        match self.lettering {
            Lettering::Text => {
                let top = (at.x, at.y - SVG_BASELINE_EM * at.em);
                self.write(text, at, top, FontTransform::None)
            }
            Lettering::Pixels => self.letter(text, at, |(x, y)| (x, y)),
        }
    }

    /// Text that reads upwards; `at.x` is its baseline.
    pub fn text_upwards(&mut self, text: &str, at: TextAt) -> Drawn<B> {
        match self.lettering {
            Lettering::Text => {
                let top = (at.x - SVG_BASELINE_EM * at.em, at.y);
                self.write(text, at, top, FontTransform::Rotate270)
            }
            Lettering::Pixels => self.letter(text, at, |(x, y)| (y, -x)),
        }
    }

    fn write(&mut self, text: &str, at: TextAt, top: (f64, f64), turn: FontTransform) -> Drawn<B> {
        let size = at.em * self.scale * SVG_SIZE_PER_EM;
        let style = TextStyle::from((font::FAMILY, size).into_font().transform(turn))
            .color(&at.colour)
            .pos(Pos::new(at.align, VPos::Top));
        let top = self.at(top);
        self.backend.draw_text(text, &style, top)
    }

    fn letter(
        &mut self,
        text: &str,
        at: TextAt,
        turn: impl Fn((i32, i32)) -> (i32, i32),
    ) -> Drawn<B> {
        let em = at.em * self.scale;
        let before = match at.align {
            HPos::Left => 0.0,
            HPos::Center => 0.5,
            HPos::Right => 1.0,
        };
        let start = -before * em * self.font.width_em(text);
        let anchor = self.at((at.x, at.y));
        let backend = &mut *self.backend;
        self.font.draw(text, em, start, |pixel, coverage| {
            let (x, y) = turn(pixel);
            let colour = at.colour.mix(coverage).to_backend_color();
            backend.draw_pixel((anchor.0 + x, anchor.1 + y), colour)
        })
    }
}
