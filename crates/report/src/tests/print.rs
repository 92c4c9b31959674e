//! Tests of figures and tables intended for print.

use std::io::Read;

use flate2::read::ZlibDecoder;
use trilink_robot::{Parameter, Quantity};

use super::*;

/// Returns the SVG, PNG and PDF files of a figure drawn with the given settings in `[report]`.
fn printed(width_mm: FigureWidth, font_pt: f64, stem: &str) -> [Vec<u8>; 3] {
    let folder = temporary();
    MadeUp::of_the_paper().write(&folder.path().join("derived"));
    let mut config = config(folder.path());
    config.campaign.retain(|name, _| name == SKEWED);
    (config.report.width_mm, config.report.font_pt) = (width_mm, font_pt);
    let input = ReportInput::new(&config, BTreeSet::new());
    let content = Content::read(&input, Reader::default()).expect("reads");
    let figure = content.figures.iter().find(|figure| figure.stem == stem).expect("a figure");
    let write = |name: &str, bytes: &[u8]| {
        trilink_tables::write_bytes(&input.paths.reports.join(name), bytes).map(drop)
    };
    draw(figure, &BTreeSet::new(), &write).expect("draws");
    let figures = input.paths.reports.join("figures");
    ["svg", "png", "pdf"]
        .map(|kind| std::fs::read(figures.join(format!("{stem}.{kind}"))).expect("a file"))
}

/// Returns the concatenated decompressed streams of a PDF.
fn unpacked(pdf: &[u8]) -> String {
    let mut text = String::new();
    for (at, _) in pdf.windows(7).enumerate().filter(|(_, of)| of == b"stream\n") {
        let mut stream = Vec::new();
        if ZlibDecoder::new(&pdf[at + 7..]).read_to_end(&mut stream).is_ok() {
            text.push_str(&String::from_utf8_lossy(&stream));
        }
    }
    text
}

fn number_after(text: &str, before: &str) -> f64 {
    let (_, rest) = text.split_once(before).unwrap_or_else(|| panic!("no {before}"));
    let end = rest.find(|c: char| !(c.is_ascii_digit() || c == '.')).expect("an end");
    rest[..end].parse().expect("a number")
}

/// Returns the width (mm) and the font size (pt) in an SVG figure.
fn size_of_svg(svg: &str) -> [f64; 2] {
    let width_px = number_after(svg, " width=\"");
    let drawn_px = number_after(svg, "viewBox=\"0 0 ");
    // Ten user units in a panel equal one pixel.
    let text_px = 0.1 * number_after(svg, "font-size=\"") * width_px / drawn_px;
    [width_px / 96.0 * 25.4, 0.75 * text_px]
}

#[test]
fn figures_have_the_configured_width_and_font_size() {
    for (stem, width_mm, font_pt) in
        [("fig16", 88.9, 8.0), ("fig09", 88.9, 8.0), ("kinematic-skewed-sigma", 180.0, 7.0)]
    {
        let [svg, png, pdf] = printed(FigureWidth::Mm(width_mm), font_pt, stem);
        let found = size_of_svg(std::str::from_utf8(&svg).expect("text"));
        assert!((found[0] - width_mm).abs() < 1e-3, "{stem}: {found:?}");
        assert!((found[1] - font_pt).abs() < 1e-3, "{stem}: {found:?}");

        let number = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().expect("four"));
        let physical = png.windows(4).position(|chunk| chunk == b"pHYs").expect("a resolution");
        let pixels = f64::from(number(16));
        let per_metre = f64::from(number(physical + 4));
        assert!((1e3 * pixels / per_metre - width_mm).abs() < 0.1, "{pixels} {per_metre}");
        assert_eq!((per_metre * 0.0254).round(), 350.0);

        let width_pt = number_after(&String::from_utf8_lossy(&pdf), "/MediaBox [0 0 ");
        assert!((width_pt / 72.0 * 25.4 - width_mm).abs() < 1e-2, "{stem}: {width_pt}");
        let content = unpacked(&pdf);
        assert!((0.75 * number_after(&content, "1 Tf\n") - font_pt).abs() < 1e-2, "{stem}");
    }
}

#[test]
fn automatic_widths_depend_on_the_font_size_only() {
    let [svg, png, pdf] = printed(FigureWidth::Auto, 9.0, "fig16");
    let found = size_of_svg(std::str::from_utf8(&svg).expect("text"));
    assert_eq!(found.map(|size| (10.0 * size).round()), [1217.0, 90.0]);
    assert_eq!(u32::from_be_bytes(png[16..20].try_into().expect("four")), 1677);
    assert_eq!(number_after(&String::from_utf8_lossy(&pdf), "/MediaBox [0 0 "), 345.0);
    // The font size changes, but the proportions of the figure do not.
    let [larger, ..] = printed(FigureWidth::Auto, 18.0, "fig16");
    let larger = size_of_svg(std::str::from_utf8(&larger).expect("text"));
    assert_eq!(larger.map(|size| (10.0 * size).round()), [2434.0, 180.0]);
}

/// Returns the sizes (pt) of all characters in a PDF.
fn text_sizes_pt(pdf: &[u8]) -> Vec<f64> {
    let content = unpacked(pdf);
    let matrices = content.lines().filter_map(|line| line.strip_suffix(" Tm"));
    let sizes = matrices.map(|matrix| {
        let numbers: Vec<f64> =
            matrix.split(' ').map(|number| number.parse().expect("a number")).collect();
        0.75 * numbers[0].hypot(numbers[1])
    });
    sizes.collect()
}

#[test]
fn every_figure_fits_a_column_with_legible_text_and_a_page() {
    let folder = temporary();
    MadeUp::of_the_paper().write(&folder.path().join("derived"));
    let config = config(folder.path());
    let figures = report(&config).expect("reports").figures;
    assert!(figures.len() > 30, "{figures:?}");
    for stem in figures {
        let pdf = std::fs::read(folder.path().join(format!("reports/figures/{stem}.pdf")));
        let pdf = pdf.expect("a PDF");
        let plain = String::from_utf8_lossy(&pdf);
        let width_pt = number_after(&plain, "/MediaBox [0 0 ");
        let height_pt = number_after(&plain, &format!("/MediaBox [0 0 {width_pt} "));
        assert!((width_pt - 249.4).abs() < 0.1, "{stem}: {width_pt}");
        assert!(height_pt / 72.0 * 25.4 <= 240.0, "{stem}: {height_pt}");
        let sizes = text_sizes_pt(&pdf);
        assert!(sizes.len() > 20, "{stem}");
        for size in sizes {
            assert!((7.0..=8.0).contains(&size), "{stem}: {size} pt");
        }
    }
}

#[test]
fn pdf_figures_embed_their_font_and_text_but_no_date() {
    let [svg, _, pdf] = printed(FigureWidth::Auto, 9.0, "fig16");
    let plain = String::from_utf8_lossy(&pdf);
    for part in ["/FontFile2", "/ToUnicode", "/Title", "+Roboto-Regular"] {
        assert!(plain.contains(part), "{part}");
    }
    for part in ["Date", "/Image", "/ID"] {
        assert!(!plain.contains(part), "{part}");
    }
    // Every character in the drawing has a glyph, which the PDF maps back to the character.
    let svg = String::from_utf8(svg).expect("text");
    let content = unpacked(&pdf);
    let parts = svg.split("<text ").skip(1).filter_map(|part| part.split(['>', '<']).nth(1));
    let texts = parts.collect::<String>().replace("&#x2f;", "/");
    let shown = texts.chars().count();
    assert!(shown > 200, "{texts}");
    assert_eq!(content.matches(" Tm\n").count(), shown, "{texts}");
    for character in texts.chars().collect::<BTreeSet<_>>() {
        let code = format!("> <{:04X}>", u32::from(character));
        assert!(content.contains(&code), "{character:?} {code}");
    }
}

#[test]
fn every_figure_fits_the_minimum_width() {
    let folder = temporary();
    MadeUp::of_the_paper().write(&folder.path().join("derived"));
    let mut config = config(folder.path());
    config.report.width_mm = FigureWidth::Mm(7.0 * config.report.font_pt);
    let figures = report(&config).expect("reports").figures;
    assert!(figures.iter().any(|figure| figure == "fig10"), "{figures:?}");
}

/// Compiles the tables in a LaTeX document, if LaTeX is installed.
fn compile(tables: &str) {
    let folder = temporary();
    let document =
        "\\documentclass{article}\n\\begin{document}\n\\input{coefficients}\n\\end{document}\n";
    std::fs::write(folder.path().join("coefficients.tex"), tables).expect("writes");
    std::fs::write(folder.path().join("paper.tex"), document).expect("writes");
    let mut latex = std::process::Command::new("pdflatex");
    latex.args(["-halt-on-error", "paper"]).current_dir(folder.path());
    if let Ok(output) = latex.output() {
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    }
}

#[test]
fn coefficients_of_every_campaign_form_a_latex_table() {
    const HOSTILE: &str = "50 % of $x_1$ & \\input{secret} #1~^{}\u{202e}\n";
    let folder = temporary();
    let mut tables = MadeUp::of_the_paper();
    let mut config = config(folder.path());
    let campaign = config.campaign.remove(SEMI_PASSIVE).expect("a campaign");
    config.campaign.insert(HOSTILE.to_owned(), campaign);
    tables.fits.iter_mut().filter(|fit| fit.campaign == SEMI_PASSIVE).for_each(|fit| {
        fit.campaign = HOSTILE.to_owned();
    });
    let fit = tables.fits.iter_mut().find(|fit| fit.model == Model::SKID_ROLL).expect("a fit");
    for parameter in Parameter::ALL {
        (fit.lower[parameter], fit.upper[parameter]) = (f64::NAN, f64::NAN);
    }
    fit.no_interval = Some(trilink_tables::NoIntervalReason::NotAskedFor.into());
    let of = |fit: &&trilink_tables::FitRow| fit.campaign == SKEWED && fit.model == Model::SKID;
    let skid = tables.fits.iter().find(of).expect("a fit").clone();
    tables.write(&folder.path().join("derived"));
    report(&config).expect("reports");
    let text = read(&folder.path().join("reports/coefficients.tex"));

    let found: Vec<&str> = text.split("\\begin{table}").skip(1).collect();
    let campaigns: BTreeSet<&str> = tables.fits.iter().map(|fit| fit.campaign.as_str()).collect();
    assert_eq!(found.len(), campaigns.len());
    for (table, campaign) in found.iter().zip(&campaigns) {
        let fits = tables.fits.iter().filter(|fit| fit.campaign == *campaign).count();
        let (cells, below) = table.split_once("\\end{tabular}").expect("an end");
        let rows = cells.lines().filter(|line| line.ends_with("\\\\"));
        let separators = |row: &str| row.replace("\\&", "").matches('&').count();
        assert!(rows.clone().count() > 6, "{table}");
        rows.clone().for_each(|row| assert_eq!(separators(row), fits, "{row}"));
        // Every letter has a note, and every cell without a value has a letter.
        let marks = cells.split("\\textsuperscript{").skip(1).filter_map(|of| of.split('}').next());
        for letter in marks.flat_map(|letters| letters.split(',')) {
            assert!(
                below.contains(&format!("\\textsuperscript{{{letter}}}\\,")),
                "{letter} {table}"
            );
        }
        assert_eq!(cells.matches("---").count(), cells.matches("---\\textsuperscript").count());
    }
    let plain = text.replace("\\{", "").replace("\\}", "");
    assert_eq!(plain.matches('{').count(), plain.matches('}').count());
    assert!(
        text.contains("50 \\% of \\$x\\_1\\$ \\& \\textbackslash{}input\\{secret\\} \\#1"),
        "{text}"
    );
    assert!(
        text.contains("No interval: Neither replicates nor profiles were requested."),
        "{text}"
    );
    let of = Quantity::Skid.parameter(0);
    let [value, up, down] = [
        skid.parameters[of],
        skid.upper[of] - skid.parameters[of],
        skid.parameters[of] - skid.lower[of],
    ];
    let cell = format!("${value:.1}^{{+{up:.1}}}_{{-{down:.1}}}$");
    assert!(text.contains(&cell), "{cell} {text}");
    compile(&text);
}
