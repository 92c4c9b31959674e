//! The PDF of a figure: what its SVG has as paths and text, in the same font.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};
use std::sync::LazyLock;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use pdf_writer::types::{
    CidFontType, FontFlags, LineCapStyle, LineJoinStyle, SystemInfo, UnicodeCmap,
};
use pdf_writer::writers::ExtGraphicsState;
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, Str, TextStr};
use resvg::tiny_skia::PathSegment;
use resvg::usvg::{Color, Group, LineCap, LineJoin, Node, Paint, Path, Text, Transform, Tree};

use super::figure::PT_PER_PX;
use super::style::{EM, ROBOTO, text_width};

/// Units of the font per em, and what a PDF has instead.
const FONT_UNITS: f32 = 2048.0;
const PDF_UNITS: f64 = 1000.0;
/// Of Roboto, in PDF units.
const ASCENT: f32 = 928.0;
const DESCENT: f32 = -244.0;
const CAP_HEIGHT: f32 = 711.0;
const BOX: Rect = Rect { x1: -737.0, y1: -271.0, x2: 1148.0, y2: 1056.0 };
const STEM: f32 = 88.0;

/// Of an opaque area.
const PERCENT: u8 = 100;

const FONT: Name<'static> = Name(b"F");
const FONT_NAME: Name<'static> = Name(b"TRLINK+Roboto-Regular");

/// The PDF of a figure's SVG: a page of its size, without a date.
///
/// # Errors
/// It cannot be packed.
pub(crate) fn pdf(svg: &Tree, title: &str, subject: Option<&str>) -> io::Result<Vec<u8>> {
    static FONT_FILE: LazyLock<io::Result<Vec<u8>>> =
        LazyLock::new(|| packed(ROBOTO, Compression::default()));
    let font_file = FONT_FILE.as_ref().map_err(|error| io::Error::from(error.kind()))?;
    let [width, height] = [svg.size().width(), svg.size().height()].map(|px| PT_PER_PX * px);
    let mut drawn =
        Page { content: Content::new(), glyphs: BTreeMap::new(), opacities: BTreeSet::new() };
    drawn.content.transform([PT_PER_PX, 0.0, 0.0, -PT_PER_PX, 0.0, height]);
    drawn.group(svg.root());
    let Page { content, glyphs, opacities } = drawn;

    let ids: [Ref; 10] = std::array::from_fn(|nth| Ref::new(1 + nth as i32));
    let [catalog, pages, page, contents, font, cid_font, descriptor, file, to_unicode, info] = ids;
    let mut pdf = Pdf::new();
    pdf.catalog(catalog).pages(pages);
    let mut about = pdf.document_info(info);
    about.title(TextStr(title));
    if let Some(subject) = subject {
        about.subject(TextStr(subject));
    }
    about.finish();
    pdf.pages(pages).kids([page]).count(1);
    let mut of_page = pdf.page(page);
    of_page.media_box(Rect::new(0.0, 0.0, width, height)).parent(pages).contents(contents);
    let mut resources = of_page.resources();
    resources.fonts().pair(FONT, font);
    let mut states = resources.ext_g_states();
    for part in opacities {
        let name = opacity_name(part);
        let mut state = states.insert(Name(name.as_bytes())).start::<ExtGraphicsState>();
        state.non_stroking_alpha(f32::from(part) / f32::from(PERCENT));
    }
    states.finish();
    resources.finish();
    of_page.finish();
    pdf.stream(contents, &packed(content.finish().as_slice(), Compression::default())?)
        .filter(Filter::FlateDecode);

    pdf.type0_font(font)
        .base_font(FONT_NAME)
        .encoding_predefined(Name(b"Identity-H"))
        .descendant_font(cid_font)
        .to_unicode(to_unicode);
    let adobe = |ordering| SystemInfo { registry: Str(b"Adobe"), ordering, supplement: 0 };
    let mut of_glyphs = pdf.cid_font(cid_font);
    of_glyphs
        .subtype(CidFontType::Type2)
        .base_font(FONT_NAME)
        .system_info(adobe(Str(b"Identity")))
        .font_descriptor(descriptor)
        .cid_to_gid_map_predefined(Name(b"Identity"));
    let mut widths = of_glyphs.widths();
    let mut cmap = UnicodeCmap::new(Name(b"Unicode"), adobe(Str(b"UCS")));
    for (glyph, text) in &glyphs {
        widths.consecutive(*glyph, [(text_width(text) / EM * PDF_UNITS) as f32]);
        cmap.pair_with_multiple(*glyph, text.chars());
    }
    widths.finish();
    of_glyphs.finish();
    pdf.font_descriptor(descriptor)
        .name(FONT_NAME)
        .flags(FontFlags::NON_SYMBOLIC)
        .bbox(BOX)
        .italic_angle(0.0)
        .ascent(ASCENT)
        .descent(DESCENT)
        .cap_height(CAP_HEIGHT)
        .stem_v(STEM)
        .font_file2(file);
    pdf.stream(file, font_file)
        .filter(Filter::FlateDecode)
        .pair(Name(b"Length1"), ROBOTO.len() as i32);
    pdf.stream(to_unicode, &packed(cmap.finish().as_slice(), Compression::default())?)
        .filter(Filter::FlateDecode);
    Ok(pdf.finish())
}

/// Of a graphics state with an opacity.
fn opacity_name(percent: u8) -> String {
    format!("O{percent}")
}

/// As the parts of a PDF and the pixels of a PNG are packed.
pub(crate) fn packed(bytes: &[u8], effort: Compression) -> io::Result<Vec<u8>> {
    let mut packed = ZlibEncoder::new(Vec::new(), effort);
    packed.write_all(bytes)?;
    packed.finish()
}

/// Thousandths of a pixel are more than can be seen.
fn rounded(px: f32) -> f32 {
    (1000.0 * px).round() / 1000.0
}

/// What is drawn on a page, in px, and the text that each glyph stands for.
struct Page {
    content: Content,
    glyphs: BTreeMap<u16, String>,
    /// Of areas that let shine through what is behind them, per cent.
    opacities: BTreeSet<u8>,
}

impl Page {
    fn group(&mut self, group: &Group) {
        for node in group.children() {
            match node {
                Node::Group(group) => self.group(group),
                Node::Path(path) => self.path(path),
                Node::Text(text) => self.text(text),
                Node::Image(_) => {}
            }
        }
    }

    fn path(&mut self, path: &Path) {
        let transform = path.abs_transform();
        let Some(data) = path.data().clone().transform(transform) else { return };
        let fill = path.fill().and_then(|fill| Some((fill.opacity(), colour(fill.paint())?)));
        let part =
            fill.map_or(PERCENT, |(opacity, _)| (opacity.get() * f32::from(PERCENT)).round() as u8);
        if part < PERCENT {
            self.opacities.insert(part);
            self.content.save_state().set_parameters(Name(opacity_name(part).as_bytes()));
        }
        if let Some((_, [red, green, blue])) = fill {
            self.content.set_fill_rgb(red, green, blue);
        }
        let stroke = path.stroke().and_then(|stroke| Some((stroke, colour(stroke.paint())?)));
        if let Some((stroke, [red, green, blue])) = stroke {
            let (scale, _) = transform.get_scale();
            self.content
                .set_stroke_rgb(red, green, blue)
                .set_line_width(rounded(stroke.width().get() * scale))
                .set_line_cap(match stroke.linecap() {
                    LineCap::Butt => LineCapStyle::ButtCap,
                    LineCap::Round => LineCapStyle::RoundCap,
                    LineCap::Square => LineCapStyle::ProjectingSquareCap,
                })
                .set_line_join(match stroke.linejoin() {
                    LineJoin::Round => LineJoinStyle::RoundJoin,
                    LineJoin::Bevel => LineJoinStyle::BevelJoin,
                    LineJoin::Miter | LineJoin::MiterClip => LineJoinStyle::MiterJoin,
                });
        }
        for segment in data.segments() {
            match segment {
                PathSegment::MoveTo(to) => self.content.move_to(rounded(to.x), rounded(to.y)),
                PathSegment::LineTo(to) => self.content.line_to(rounded(to.x), rounded(to.y)),
                PathSegment::QuadTo(by, to) => self.content.cubic_to_final(by.x, by.y, to.x, to.y),
                PathSegment::CubicTo(from, by, to) => {
                    self.content.cubic_to(from.x, from.y, by.x, by.y, to.x, to.y)
                }
                PathSegment::Close => self.content.close_path(),
            };
        }
        match (fill.is_some(), stroke.is_some()) {
            (true, true) => self.content.fill_nonzero_and_stroke(),
            (true, false) => self.content.fill_nonzero(),
            (false, true) => self.content.stroke(),
            (false, false) => self.content.end_path(),
        };
        if part < PERCENT {
            self.content.restore_state();
        }
    }

    /// Each glyph where the SVG has it.
    fn text(&mut self, text: &Text) {
        for span in text.layouted() {
            let colour = span.fill.as_ref().and_then(|fill| colour(fill.paint()));
            let Some([red, green, blue]) = colour else { continue };
            self.content.set_fill_rgb(red, green, blue).begin_text().set_font(FONT, 1.0);
            for glyph in &span.positioned_glyphs {
                let at = glyph.outline_transform().pre_scale(FONT_UNITS, FONT_UNITS);
                let Transform { sx, ky, kx, sy, tx, ty } = text.abs_transform().pre_concat(at);
                let matrix = [sx, ky, kx, sy, tx, ty].map(rounded);
                // A TrueType font has at most 65,536 glyphs.
                let id = glyph.id.0 as u16;
                self.content.set_text_matrix(matrix).show(Str(&id.to_be_bytes()));
                self.glyphs.entry(id).or_insert_with(|| glyph.text.clone());
            }
            self.content.end_text();
        }
    }
}

/// Red, green and blue; figures have no other paint.
fn colour(paint: &Paint) -> Option<[f32; 3]> {
    let Paint::Color(Color { red, green, blue }) = paint else { return None };
    Some([*red, *green, *blue].map(|part| f32::from(part) / 255.0))
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use flate2::read::ZlibDecoder;

    use super::*;
    use crate::raster;

    #[test]
    fn what_shines_through_in_an_svg_does_in_its_pdf() {
        let svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"20\" height=\"20\">\
                   <path d=\"M1 1H9V9z\" fill=\"#0072b2\" fill-opacity=\"0.2\"/>\
                   <path d=\"M1 1H9V9z\" fill=\"#0072b2\"/></svg>";
        let pdf = pdf(&raster::parsed(svg).expect("an SVG"), "", None).expect("draws");
        let plain = String::from_utf8_lossy(&pdf);
        assert!(plain.contains("/O20") && plain.contains("/ca 0.2"), "{plain}");
        let mut content = String::new();
        for (at, _) in pdf.windows(7).enumerate().filter(|(_, of)| of == b"stream\n") {
            // The font's bytes are no text.
            let _ = ZlibDecoder::new(&pdf[at + 7..]).read_to_string(&mut content);
        }
        assert_eq!(content.matches("/O20 gs\n").count(), 1, "{content}");
        assert_eq!((content.matches("q\n").count(), content.matches("Q\n").count()), (1, 1));
    }
}
