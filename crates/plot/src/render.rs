//! Rendering of a figure as SVG with an embedded font.

use std::sync::LazyLock;

use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use plotters::prelude::IntoDrawingArea;

use super::draw;
use super::figure::{Figure, SYNTHETIC};
use super::grid::{Grid, MARGIN};
use super::style::{self, units};
use crate::DrawError;
use crate::svg::Svg;

/// Start tag of the SVG group that contains the legend and the panels.
const BODY: &str = "<g fill=\"none\" font-family=\"Roboto, sans-serif\" font-size=\"120\">\n";
const END: &str = "</g>\n</svg>\n";
/// Presentation attributes for an SVG fragment of a panel or a legend that is used outside its figure.
const PRESENTATION: &str =
    "overflow=\"visible\" fill=\"none\" font-family=\"Roboto, sans-serif\" font-size=\"120\"";

/// Height of the line with the notice [`SYNTHETIC`], px.
pub(crate) const SYNTHETIC_ROW: f64 = 18.0;

/// Rendered figure: its legend and panels as SVG.
pub struct Drawing {
    pub columns: usize,
    /// Width of the drawing, px.
    pub width: f64,
    /// Height without the notice about synthetic trials, px.
    height: f64,
    scale: f64,
    is_synthetic: bool,
    /// Legend and panels as SVG, in this order.
    parts: [String; 2],
}

impl Drawing {
    /// Draws a figure for print.
    ///
    /// # Errors
    /// Returns an error if plotters fails.
    pub fn new(figure: &Figure) -> Result<Self, DrawError> {
        Self::of_grid(figure, Grid::new(figure, Some(figure.print)), figure.print.scale())
    }

    /// Draws a figure for a page on the screen, where it is as wide as its panels require.
    ///
    /// # Errors
    /// Returns an error if plotters fails.
    pub fn on_screen(figure: &Figure) -> Result<Self, DrawError> {
        Self::of_grid(figure, Grid::new(figure, None), 1.0)
    }

    fn of_grid(figure: &Figure, grid: Grid<'_>, scale: f64) -> Result<Self, DrawError> {
        let Grid { columns, width, height, .. } = grid;
        let mut parts = [String::new(), String::new()];
        let [legend, panels] = parts.each_mut().map(|part| {
            Svg::new(part, (units(width) as u32, units(height) as u32)).into_drawing_area()
        });
        draw::draw(grid, [&legend, &panels]).map_err(|error| figure.error(error.to_string()))?;
        drop((legend, panels));
        // Names may contain characters that XML does not allow; drop these.
        let is_allowed = |c| matches!(c, '\t' | '\n' | ' '..='\u{fffd}' | '\u{10000}'..);
        for part in parts.iter_mut().filter(|part| !part.chars().all(is_allowed)) {
            *part = part.replace(|c| !is_allowed(c), "\u{fffd}");
        }
        Ok(Self { columns, width, height, scale, is_synthetic: figure.is_synthetic, parts })
    }

    /// Returns the SVG of the notice about synthetic trials below the panels; empty for recorded trials.
    fn notice(&self) -> String {
        if !self.is_synthetic {
            return String::new();
        }
        let baseline = self.height + SYNTHETIC_ROW - 6.0;
        let colour = style::MARK;
        format!(
            "<text x=\"{MARGIN}\" y=\"{baseline}\" fill=\"{colour}\" font-size=\"12\">{SYNTHETIC}</text>\n"
        )
    }

    /// Returns the content of the figure's SVG file, with an embedded font.
    pub fn svg(&self) -> String {
        static FONT: LazyLock<String> = LazyLock::new(|| BASE64.encode(style::ROBOTO));
        let Self { width, height, scale, is_synthetic, parts: [legend, panels], .. } = self;
        let height = if *is_synthetic { height + SYNTHETIC_ROW } else { *height };
        let [across, down] = [*width, height].map(|px| rounded(scale * px));
        let width = rounded(*width);
        let font = &*FONT;
        let notice = self.notice();
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{across}\" height=\"{down}\" \
             viewBox=\"0 0 {width} {height}\">\n\
             <style>@font-face{{font-family:Roboto;src:url(data:font/ttf;base64,{font}) format(\"truetype\")}}</style>\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n{BODY}{notice}{legend}{panels}{END}"
        )
    }

    /// Returns the legend and the panels as SVG for report pages; their look does not depend on the styles of
    /// the page.
    pub fn parts(&self) -> [String; 2] {
        let presentation = format!(" {PRESENTATION} viewBox=\"");
        self.parts.each_ref().map(|part| part.replace(" viewBox=\"", &presentation))
    }
}

/// Rounds a length to thousandths of a pixel.
fn rounded(px: f64) -> f64 {
    (1e3 * px).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster;
    use crate::{Layer, Layout, Look, Panel, Range, Scale};

    const LOOKS: [Look; 11] = [
        Look::Line { colour: style::INK, dash: style::DASHES, width_px: style::THIN },
        Look::Line { colour: style::INK, dash: style::SOLID, width_px: style::LINE_WIDTH },
        Look::Marker { colour: style::INK, shape: style::Shape::Square, filled: false },
        Look::Dots { colour: style::INK, joined: true },
        Look::Dots { colour: style::INK, joined: false },
        Look::Rings,
        Look::Guides,
        Look::Spans(style::INK),
        Look::Cells(style::INK),
        Look::Links,
        Look::Arrow,
    ];
    const SCALES: [Scale; 4] = [Scale::Linear, Scale::FromZero, Scale::Equal, Scale::Decades];

    fn drawn(points: &[(f64, f64, f64)], look: Look, scale: Scale) -> String {
        let band = points.iter().map(|(_, y, error)| [y - error, y + error]).collect();
        let layer = Layer { band, ..Layer::with_errors("a", points.iter().copied(), look) };
        let layers = vec![layer];
        let panel = Panel { x_scale: scale, y_scale: scale, ..Panel::new("", "x", "y", layers) };
        let figure = Figure::new("any", Default::default(), &[], Layout::Grid, vec![panel]);
        Drawing::new(&figure).expect("is drawn").svg()
    }

    #[test]
    fn extreme_numbers_are_drawn_in_little_time_and_space() {
        let hostile = [
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::MAX,
            f64::MIN,
            1e150,
            1e99,
            f64::MIN_POSITIVE,
            5e-324,
            0.0,
            -1.0,
            1e9,
        ];
        let empty = drawn(&[], Look::Rings, Scale::Linear).len();
        for look in LOOKS {
            for scale in SCALES {
                for (nth, value) in hostile.into_iter().enumerate() {
                    let other = hostile[(nth + 5) % hostile.len()];
                    let points = [(1.0, 2.0, 0.1), (value, 3.0, other), (other, value, value)];
                    for points in [&points[..], &points[1..], &points[2..]] {
                        let size = drawn(points, look, scale).len();
                        assert!(
                            size < empty + 40_000,
                            "{look:?} {scale:?} {points:?}: {size} bytes"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn very_many_points_are_thinned() {
        let point = |i: i32| (f64::from(i), (0.7 * f64::from(i).powi(2)).sin(), 0.1);
        let points: Vec<(f64, f64, f64)> = (0..200_000).map(point).collect();
        let empty = drawn(&[], Look::Rings, Scale::Linear).len();
        for look in LOOKS {
            let size = drawn(&points, look, Scale::Linear).len();
            let most = match look {
                Look::Guides | Look::Spans(_) | Look::Cells(_) => 40,
                _ => 4,
            };
            assert!(size < empty + most * 1_000_000, "{look:?}: {size} bytes");
        }
    }

    #[test]
    fn a_band_is_behind_its_line_has_the_same_gaps_and_ends_at_the_panel() {
        let nan = f64::NAN;
        let look = LOOKS[1];
        let xs = [0.0, 1.0, 2.0, nan, 4.0, 5.0];
        let line = Layer::new("a", xs.map(|x| (x, 1.0)), look);
        let band = vec![[0.9, 1.1], [0.5, 9.0], [0.9, 1.1], [nan; 2], [0.8, 1.2], [0.8, 1.2]];
        let drawn = |band: Vec<[f64; 2]>| {
            let layers = vec![Layer { band, ..line.clone() }];
            let shown = Some(Range { low: 0.0, high: 2.0 });
            let panel = Panel { shown, ..Panel::new("", "x", "y", layers) };
            let figure = Figure::new("any", Default::default(), &[], Layout::Grid, vec![panel]);
            Drawing::new(&figure).expect("is drawn").svg()
        };
        let svg = drawn(band);
        let (areas, curve) = svg.split_once("<g data-name=\"a\" data-band=").expect("the curve");
        let (_, areas) = areas.rsplit_once("<g data-name=\"a\">").expect("the band");
        assert!(areas.contains("fill-opacity=\"0.2\""));
        // One path contains two areas, around three points and around two, each drawn forwards along one side
        // and back along the other.
        let path = areas.split("d=\"").nth(1).and_then(|rest| rest.split('"').next());
        let numbers: Vec<Vec<i32>> = path
            .expect("a path")
            .split_terminator('z')
            .map(|area| {
                let spaced = area.replace('m', " ").replace('-', " -");
                spaced.split_whitespace().map(|n| n.parse().expect("a number")).collect()
            })
            .collect();
        assert_eq!([numbers[0].len(), numbers[1].len()], [2 * 6, 2 * 4]);
        assert_eq!(numbers.len(), 2);
        // The second area begins relative to the start of the first, and its lower side is horizontal.
        assert!(numbers[1][0] > 0 && numbers[1][3] == 0, "{numbers:?}");
        assert!(curve.starts_with("\"0 1 0.9 1.1\n1 1 0.5 9\n2 1 0.9 1.1\n4 1 0.8 1.2\n5 1 "));
        assert!(!drawn(Vec::new()).contains("data-band"));
    }

    #[test]
    fn the_legend_and_the_panels_are_parts_of_the_file_and_every_group_is_closed() {
        let layers = ["a", "b"].map(|name| Layer::new(name, [(0.0, 1.0), (1.0, 2.0)], LOOKS[0]));
        let panel = Panel::new("", "x", "y", layers.into());
        let panels = vec![panel.clone(), panel];
        let figure = Figure::new("any", Default::default(), &[], Layout::Stack, panels);
        let drawing = Drawing::new(&figure).expect("is drawn");
        assert!(drawing.parts.iter().all(|part| drawing.svg().contains(part)));
        for part in drawing.parts() {
            let count = |tag: &str| part.matches(tag).count();
            assert!(count("<g ") > 0 || count("<svg ") > 0);
            assert_eq!([count("<g "), count("<svg ")], [count("</g>"), count("</svg>")]);
        }
    }

    #[test]
    fn the_label_of_an_axis_is_dropped_for_long_tick_labels() {
        for (apart, has_label) in [(1e-3, true), (1e-8, false)] {
            let layer = Layer::new("a", [(0.0, 0.00983), (1.0, 0.00983 + apart)], LOOKS[0]);
            let panel = Panel::new("", "x", "mean of J", vec![layer]);
            let figure = Figure::new("any", Default::default(), &[], Layout::Grid, vec![panel]);
            let svg = Drawing::new(&figure).expect("is drawn").svg();
            assert_eq!(svg.contains(">mean of J<"), has_label, "{apart}");
            // The attribute for the report page's script still has the label.
            assert!(svg.contains("0 mean of J\""), "{apart}");
        }
    }

    #[test]
    fn names_with_characters_that_xml_forbids_are_drawn() {
        let layers = vec![Layer::new("\u{1b}[31m\u{0}", [(1.0, 2.0)], LOOKS[0])];
        let panel = Panel::new("a\u{1}\u{ffff}b<&", "\r\n\t", "", layers);
        let figure = Figure::new("any", Default::default(), &[], Layout::Grid, vec![panel]);
        let svg = Drawing::new(&figure).expect("is drawn").svg();
        assert!(svg.contains("a\\u{1}\u{fffd}b&lt;&amp;"));
        raster::parsed(&svg).expect("is well formed");
    }
}
