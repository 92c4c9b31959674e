//! What plotters draws as SVG: small, and in groups that a page can tell apart.

use std::convert::Infallible;
use std::fmt::Write as _;

use plotters::element::{Drawable, PointCollection};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind,
    FontTransform,
};
use trilink_base::text::harmless;

type Drawn = Result<(), DrawingErrorKind<Infallible>>;

/// A drawing. What follows each other in one style is one path.
pub struct Svg<'s> {
    text: &'s mut String,
    size: (u32, u32),
    /// Attributes of the path that is open, and its last position.
    open: String,
    at: BackendCoord,
}

/// Markup among what plotters draws, such as the beginning of a group.
pub struct Markup(pub String);

/// Text as it may stand in markup, between quotes, too.
pub(crate) fn escaped(text: &str) -> String {
    let mut markup = String::with_capacity(text.len());
    for c in harmless(text).chars() {
        match c {
            '<' => markup.push_str("&lt;"),
            '>' => markup.push_str("&gt;"),
            '&' => markup.push_str("&amp;"),
            '"' => markup.push_str("&quot;"),
            '\'' => markup.push_str("&#x27;"),
            '/' => markup.push_str("&#x2f;"),
            c => markup.push(c),
        }
    }
    markup
}

fn colour(BackendColor { rgb: (red, green, blue), .. }: BackendColor) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

impl<'s> Svg<'s> {
    pub fn new(text: &'s mut String, size: (u32, u32)) -> Self {
        Self { text, size, open: String::new(), at: (0, 0) }
    }

    fn markup(&mut self, markup: &str) {
        if !self.open.is_empty() {
            self.text.push_str("\"/>\n");
            self.open.clear();
        }
        self.text.push_str(markup);
    }

    /// Adds a line to the path with these attributes.
    fn line(
        &mut self,
        points: impl IntoIterator<Item = BackendCoord>,
        attributes: String,
        end: &str,
    ) {
        if attributes != self.open {
            self.markup("<path ");
            self.text.push_str(&attributes);
            self.text.push_str(" d=\"");
            (self.open, self.at) = (attributes, (0, 0));
        }
        let mut command = "m";
        for (x, y) in points {
            let (across, down) = (x - self.at.0, y - self.at.1);
            let gap = if command.is_empty() && across >= 0 { " " } else { command };
            let comma = if down >= 0 { " " } else { "" };
            write!(self.text, "{gap}{across}{comma}{down}").ok();
            (self.at, command) = ((x, y), "");
        }
        self.text.push_str(end);
    }
}

impl DrawingBackend for Svg<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        self.size
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, _at: BackendCoord, _colour: BackendColor) -> Drawn {
        Ok(())
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Drawn {
        self.draw_path([from, to], style)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn {
        if style.color().alpha > 0.0 {
            let (stroke, width) = (colour(style.color()), style.stroke_width());
            self.line(path, format!("stroke=\"{stroke}\" stroke-width=\"{width}\""), "");
        }
        Ok(())
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        (left, top): BackendCoord,
        (right, bottom): BackendCoord,
        style: &S,
        _fill: bool,
    ) -> Drawn {
        let (width, height) = (right - left, bottom - top);
        let sides = format!("h{width}v{height}h{}z", -width);
        self.line([(left, top)], format!("fill=\"{}\"", colour(style.color())), &sides);
        Ok(())
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Drawn {
        let corners: Vec<BackendCoord> = corners.into_iter().collect();
        let Some(first) = corners.first().copied() else { return Ok(()) };
        let (fill, opacity) = (colour(style.color()), style.color().alpha);
        self.line(corners, format!("fill=\"{fill}\" fill-opacity=\"{opacity}\""), "z");
        // Where a path goes on that was closed.
        self.at = first;
        Ok(())
    }

    /// As the round end of a line without length.
    fn draw_circle<S: BackendStyle>(
        &mut self,
        centre: BackendCoord,
        radius: u32,
        style: &S,
        _fill: bool,
    ) -> Drawn {
        let (stroke, width) = (colour(style.color()), 2 * radius);
        let round = "stroke-linecap=\"round\"";
        self.line([centre], format!("stroke=\"{stroke}\" stroke-width=\"{width}\" {round}"), "h0");
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        (x, y): BackendCoord,
    ) -> Drawn {
        let anchor = match style.anchor().h_pos {
            HPos::Left => "",
            HPos::Right => " text-anchor=\"end\"",
            HPos::Center => " text-anchor=\"middle\"",
        };
        let below = match style.anchor().v_pos {
            VPos::Top => ".76em",
            VPos::Center => ".5ex",
            VPos::Bottom => "-.5ex",
        };
        let turned = match style.transform() {
            FontTransform::Rotate270 => format!(" transform=\"rotate(270 {x} {y})\""),
            _ => String::new(),
        };
        let (fill, text) = (colour(style.color()), escaped(text));
        let place = format!("x=\"{x}\" y=\"{y}\" dy=\"{below}\"");
        self.markup(&format!("<text {place}{anchor}{turned} fill=\"{fill}\">{text}</text>\n"));
        Ok(())
    }
}

impl<'m, C: 'm> PointCollection<'m, C> for &'m Markup {
    type Point = C;
    type IntoIter = std::iter::Empty<C>;

    fn point_iter(self) -> Self::IntoIter {
        std::iter::empty()
    }
}

impl Drawable<Svg<'_>> for Markup {
    fn draw<I: Iterator<Item = BackendCoord>>(
        &self,
        _points: I,
        svg: &mut Svg<'_>,
        _size: (u32, u32),
    ) -> Drawn {
        svg.markup(&self.0);
        Ok(())
    }
}
