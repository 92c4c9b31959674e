//! Plotters backend that writes compact SVG, with markup for groups.

use std::convert::Infallible;
use std::fmt::Write as _;

use plotters::element::{Drawable, PointCollection};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind,
    FontTransform,
};
use trilink_base::text::escape_controls;

type Drawn = Result<(), DrawingErrorKind<Infallible>>;

/// SVG backend. Consecutive shapes with the same style become one path.
pub struct Svg<'s> {
    text: &'s mut String,
    size: (u32, u32),
    /// Attributes of the path that is being written; empty if there is none.
    open: String,
    /// Last position of the path that is being written.
    at: BackendCoord,
}

/// Markup to insert between the shapes that plotters draws, such as the start tag of a group.
pub struct Markup(pub String);

/// Escapes text for use in markup, including attribute values.
pub(crate) fn escaped(text: &str) -> String {
    let mut markup = String::with_capacity(text.len());
    for c in escape_controls(text).chars() {
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

    /// Appends a polyline to the current path, or to a new path if the attributes differ; `end` is written
    /// after its points.
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
            self.open = attributes;
            self.at = (0, 0);
        }
        let mut command = "m";
        for (x, y) in points {
            let across = x - self.at.0;
            let down = y - self.at.1;
            let gap = if command.is_empty() && across >= 0 { " " } else { command };
            let separator = if down >= 0 { " " } else { "" };
            write!(self.text, "{gap}{across}{separator}{down}").ok();
            self.at = (x, y);
            command = "";
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
            let stroke = colour(style.color());
            let width = style.stroke_width();
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
        let width = right - left;
        let height = bottom - top;
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
        let fill = colour(style.color());
        let opacity = style.color().alpha;
        self.line(corners, format!("fill=\"{fill}\" fill-opacity=\"{opacity}\""), "z");
        // Closing a path moves the position back to its first point.
        self.at = first;
        Ok(())
    }

    /// Draws a disc, as the round cap of a line of zero length.
    fn draw_circle<S: BackendStyle>(
        &mut self,
        centre: BackendCoord,
        radius: u32,
        style: &S,
        _fill: bool,
    ) -> Drawn {
        let stroke = colour(style.color());
        let width = 2 * radius;
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
        let rotation = match style.transform() {
            FontTransform::Rotate270 => format!(" transform=\"rotate(270 {x} {y})\""),
            _ => String::new(),
        };
        let fill = colour(style.color());
        let text = escaped(text);
        let position = format!("x=\"{x}\" y=\"{y}\" dy=\"{below}\"");
        self.markup(&format!("<text {position}{anchor}{rotation} fill=\"{fill}\">{text}</text>\n"));
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
