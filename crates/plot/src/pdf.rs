//! Conversion of a figure's SVG to PDF, keeping paths as paths and text as text in the same font.

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

/// Units per em in the font file.
const FONT_UNITS: f32 = 2048.0;
/// Units per em in a PDF.
const PDF_UNITS: f64 = 1000.0;
/// Ascent of Roboto, in PDF units.
const ASCENT: f32 = 928.0;
/// Descent of Roboto, in PDF units.
const DESCENT: f32 = -244.0;
/// Height of Roboto's capital letters, in PDF units.
const CAP_HEIGHT: f32 = 711.0;
/// Bounding box of all glyphs of Roboto, in PDF units.
const BOX: Rect = Rect { x1: -737.0, y1: -271.0, x2: 1148.0, y2: 1056.0 };
/// Width of Roboto's vertical stems, in PDF units.
const STEM: f32 = 88.0;

/// Opacity of a fully opaque area, per cent.
const OPAQUE: u8 = 100;

const FONT: Name<'static> = Name(b"F");
const FONT_NAME: Name<'static> = Name(b"TRLINK+Roboto-Regular");

/// Converts a figure's SVG to a PDF with a single page of the figure's size. The PDF contains no date, so
/// that it is reproducible.
///
/// # Errors
/// Returns an error if the content cannot be compressed.
pub(crate) fn pdf(svg: &Tree, title: &str, subject: Option<&str>) -> io::Result<Vec<u8>> {
    static FONT_FILE: LazyLock<io::Result<Vec<u8>>> =
        LazyLock::new(|| compress(ROBOTO, Compression::default()));
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
    for opacity in opacities {
        let name = opacity_name(opacity);
        let mut state = states.insert(Name(name.as_bytes())).start::<ExtGraphicsState>();
        state.non_stroking_alpha(f32::from(opacity) / f32::from(OPAQUE));
    }
    states.finish();
    resources.finish();
    of_page.finish();
    pdf.stream(contents, &compress(content.finish().as_slice(), Compression::default())?)
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
    pdf.stream(to_unicode, &compress(cmap.finish().as_slice(), Compression::default())?)
        .filter(Filter::FlateDecode);
    Ok(pdf.finish())
}

/// Returns the name of the PDF graphics state for an opacity in per cent.
fn opacity_name(percent: u8) -> String {
    format!("O{percent}")
}

/// Compresses bytes with zlib, for the streams of a PDF and the pixels of a PNG.
pub(crate) fn compress(bytes: &[u8], effort: Compression) -> io::Result<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), effort);
    encoder.write_all(bytes)?;
    encoder.finish()
}

/// Rounds a length to thousandths of a pixel.
fn rounded(px: f32) -> f32 {
    (1000.0 * px).round() / 1000.0
}

/// Content of a PDF page, with lengths in px.
struct Page {
    content: Content,
    /// Text that each used glyph represents, by glyph index.
    glyphs: BTreeMap<u16, String>,
    /// Opacities that occur in translucent areas, per cent.
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
        let opacity =
            fill.map_or(OPAQUE, |(opacity, _)| (opacity.get() * f32::from(OPAQUE)).round() as u8);
        if opacity < OPAQUE {
            self.opacities.insert(opacity);
            self.content.save_state().set_parameters(Name(opacity_name(opacity).as_bytes()));
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
        if opacity < OPAQUE {
            self.content.restore_state();
        }
    }

    /// Writes text, with each glyph at its position in the SVG.
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

/// Returns the red, green and blue components of a plain colour; `None` for any other paint, which figures do
/// not contain.
fn colour(paint: &Paint) -> Option<[f32; 3]> {
    let Paint::Color(Color { red, green, blue }) = paint else { return None };
    Some([*red, *green, *blue].map(|component| f32::from(component) / 255.0))
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use flate2::read::ZlibDecoder;

    use super::*;
    use crate::raster;

    #[test]
    fn translucent_areas_of_an_svg_are_translucent_in_its_pdf() {
        let svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"20\" height=\"20\">\
                   <path d=\"M1 1H9V9z\" fill=\"#0072b2\" fill-opacity=\"0.2\"/>\
                   <path d=\"M1 1H9V9z\" fill=\"#0072b2\"/></svg>";
        let pdf = pdf(&raster::parsed(svg).expect("an SVG"), "", None).expect("draws");
        let plain = String::from_utf8_lossy(&pdf);
        assert!(plain.contains("/O20") && plain.contains("/ca 0.2"), "{plain}");
        let mut content = String::new();
        for (at, _) in pdf.windows(7).enumerate().filter(|(_, of)| of == b"stream\n") {
            // The stream of the font is not text and is skipped.
            let _ = ZlibDecoder::new(&pdf[at + 7..]).read_to_string(&mut content);
        }
        assert_eq!(content.matches("/O20 gs\n").count(), 1, "{content}");
        assert_eq!((content.matches("q\n").count(), content.matches("Q\n").count()), (1, 1));
    }
}
