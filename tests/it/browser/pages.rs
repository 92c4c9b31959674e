//! Tests of requirements on every page: printing, contrast, keyboard, no network access.

use super::*;

#[test]
fn no_page_is_wider_than_its_window_fails_or_asks_a_network() {
    let Some(mut browser) = Browser::start() else { return };
    for reports in [demo(), own()] {
        for page in all_pages(reports) {
            for (width, height) in SIZES {
                browser.window(width, height);
                for is_dark in [false, true] {
                    browser.dark(is_dark);
                    browser.open(&page);
                    let wide = browser.evaluate("document.documentElement.scrollWidth");
                    let what = format!("{} at {width} px", page.display());
                    assert!(wide.as_u64() <= Some(width.into()), "{what}: {wide} px");
                }
            }
        }
    }
    assert_no_problems(&browser);
}

/// JavaScript expression for each table that is too wide for its container: its label, its tab index (0 if it can be
/// scrolled by keyboard), two properties of the shadow at its edges, and whether its headings and first cells stick.
const EDGES: &str = r#"[...document.querySelectorAll(".scroll")]
  .filter(scroll => scroll.scrollWidth > scroll.clientWidth + 1)
  .map(scroll => {
    const { backgroundAttachment, backgroundImage } = getComputedStyle(scroll);
    const fixed = [...scroll.querySelectorAll("thead th, tbody tr > :first-child")];
    return [scroll.ariaLabel, scroll.tabIndex, backgroundAttachment,
      (backgroundImage.match(/linear-gradient/g) || []).length,
      fixed.every(cell => getComputedStyle(cell).position === "sticky")];
  })"#;

#[test]
fn a_table_that_can_be_scrolled_has_a_shadow_at_its_edge() {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(390, 844);
    let mut wide = 0;
    for page in all_pages(demo()) {
        browser.open(&page);
        browser.evaluate("document.querySelectorAll(\"details\").forEach(of => of.open = true)");
        for table in browser.evaluate(EDGES).as_array().unwrap() {
            assert_eq!(table[1], 0, "{table}");
            assert_eq!(table[2], "local, local, scroll, scroll, scroll", "{table}");
            assert_eq!((&table[3], &table[4]), (&json!(4), &json!(true)), "{table}");
            wide += 1;
        }
        let outside = browser.evaluate(
            r#"[...document.querySelectorAll("table")].filter(table =>
              table.getBoundingClientRect().right > innerWidth + 1 && !table.closest(".scroll")).length"#,
        );
        assert_eq!(outside, 0, "{}", page.display());
    }
    assert!(wide > 3, "{wide} tables");
}

#[test]
fn every_page_says_that_its_trials_are_synthetic() {
    let Some(mut browser) = Browser::start() else { return };
    for (width, height) in SIZES {
        browser.window(width, height);
        for page in all_pages(demo()) {
            browser.open(&page);
            browser
                .evaluate("document.querySelectorAll(\"details\").forEach(of => of.open = true)");
            let said = browser.evaluate(
                r#"(() => {
                  const said = document.querySelector("aside");
                  return [document.title, said?.innerText, said?.getBoundingClientRect().bottom,
                    [...document.querySelectorAll(".sheet")].every(sheet =>
                      sheet.innerText.includes("Synthetic trials"))];
                })()"#,
            );
            let what = format!("{} {said}", page.display());
            assert!(said[0].as_str().unwrap().starts_with("Synthetic trials: "), "{what}");
            assert!(said[1].as_str().expect(&what).contains("synthetic"), "{what}");
            assert!(said[2].as_f64() < Some(200.0) && said[3] == true, "{what}");
        }
    }
}

#[test]
fn every_link_of_every_page_leads_somewhere() {
    let Some(mut browser) = Browser::start() else { return };
    for reports in [demo(), own()] {
        for page in all_pages(reports) {
            browser.open(&page);
            let links = browser.evaluate(
                r#"[...document.querySelectorAll("a[href]")].map(link =>
                  [link.href, decodeURIComponent(link.href), link.hash,
                   !link.hash || !!document.getElementById(decodeURIComponent(link.hash.slice(1)))])"#,
            );
            let links = links.as_array().unwrap();
            assert!(!links.is_empty(), "{}", page.display());
            for link in links {
                let place = link[1].as_str().unwrap().strip_prefix("file://").expect("a file");
                let path = place.split('#').next().unwrap();
                assert!(Path::new(path).exists(), "{}: no {link}", page.display());
                let is_here = Path::new(path) == page;
                assert!(!is_here || link[3] == true, "{}: no {link}", page.display());
            }
        }
    }
}

/// JavaScript expression for the visible content of a page: labels and numbers of paths of figures, texts of table
/// rows, and HTML of controls.
const CONTENT: &str = r#"(() => {
  const seen = selector => [...document.querySelectorAll(selector)]
    .filter(element => element.checkVisibility());
  return {
    drawn: seen(".sheet").map(sheet => [sheet.ariaLabel, sheet.querySelectorAll("path").length]),
    rows: seen("tr").map(row => row.innerText),
    controls: seen("button, input").map(control => control.outerHTML),
  };
})()"#;

#[test]
fn without_scripts_a_page_has_every_figure_table_and_description() {
    let Some(mut browser) = Browser::start() else { return };
    for page in all_pages(demo()) {
        let [with, without] = [true, false].map(|run| {
            browser.scripts(run);
            browser.open(&page);
            browser.evaluate(CONTENT)
        });
        let page = page.display();
        assert_eq!(without["drawn"], with["drawn"], "{page}");
        for sheet in without["drawn"].as_array().unwrap() {
            assert!(sheet[0].as_str().unwrap().len() > 20 && sheet[1] != 0, "{page}: {sheet}");
        }
        assert_eq!(without["rows"], with["rows"], "{page}");
        assert_eq!(without["controls"], json!([]), "{page}: of no use without scripts");
    }
}

#[test]
fn the_page_is_printed_on_few_sheets() {
    let Some(mut browser) = Browser::start() else { return };
    browser.open(&demo().join("index.html"));
    browser.call("Emulation.setEmulatedMedia", json!({ "media": "print" }));
    let shown = "[...document.querySelectorAll(\"nav, .filter\")].some(of => of.checkVisibility())";
    assert_eq!(browser.evaluate(shown), false, "what is of no use on paper");
    let pdf = browser.pdf();
    let sheets = String::from_utf8_lossy(&pdf).matches("/Type /Page\n").count();
    assert!((3..=24).contains(&sheets), "{sheets} sheets");

    // Printed share of the height of each sheet, in percent.
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("page.pdf"), pdf).unwrap();
    let drawn = std::process::Command::new("pdftoppm")
        .args(["-r", "20", "-gray", "page.pdf", "sheet"])
        .current_dir(folder.path())
        .status();
    if drawn.is_err() {
        eprintln!("skipped: how full the sheets are, because there is no pdftoppm (poppler-utils)");
        return;
    }
    let mut names: Vec<PathBuf> = files(folder.path()).into_keys().collect();
    names.retain(|name| name.extension().is_some_and(|extension| extension == "pgm"));
    let filled = |name: &PathBuf| {
        let pixels = std::fs::read(folder.path().join(name)).unwrap();
        let last = pixels.iter().rposition(|grey| *grey < 200).unwrap_or(0);
        100 * last / pixels.len()
    };
    let filled: Vec<usize> = names.iter().map(filled).collect();
    assert_eq!(filled.len(), sheets);
    // The last sheet may be partly empty.
    let half_empty = filled[..sheets - 1].iter().filter(|part| **part < 55).count();
    assert!(half_empty <= sheets / 8, "{half_empty} of {sheets} sheets are half empty: {filled:?}");
}

#[test]
fn axe_finds_no_violations() {
    assert_accessible(false);
}

#[test]
fn axe_finds_no_violations_on_dark_pages() {
    assert_accessible(true);
}

fn assert_accessible(is_dark: bool) {
    let Some(axe) = std::env::var_os("TRILINK_AXE") else {
        eprintln!("skipped: TRILINK_AXE names no axe.min.js (npm install axe-core)");
        return;
    };
    let Some(mut browser) = Browser::start() else { return };
    let axe = std::fs::read_to_string(axe).expect("axe.min.js");
    browser.dark(is_dark);
    for page in [demo(), own()].into_iter().flat_map(all_pages) {
        for (width, height) in SIZES {
            browser.window(width, height);
            browser.open(&page);
            browser.evaluate(&format!("{axe}\n;0"));
            let violations = browser.evaluate(
                r#"axe.run().then(result => result.violations.map(violation =>
                  [violation.id, violation.help, violation.nodes.map(node => node.html.slice(0, 200))]))"#,
            );
            let what = format!("{} at {width} px, dark: {is_dark}", page.display());
            assert_eq!(violations, json!([]), "{what}");
        }
    }
}

/// JavaScript expression for two pairs of contrast and colour: the text colour and the line colour in figures that
/// contrast least with the page background.
const CONTRAST: &str = r##"(() => {
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const luminance = colour => {
    canvas.fillStyle = colour;
    canvas.fillRect(0, 0, 1, 1);
    const [red, green, blue] = [...canvas.getImageData(0, 0, 1, 1).data]
      .map(part => part / 255)
      .map(part => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
  };
  const page = luminance(getComputedStyle(document.body).backgroundColor);
  const contrast = colour => {
    const [low, high] = [page, luminance(colour)].sort((a, b) => a - b);
    return (high + 0.05) / (low + 0.05);
  };
  const least = (selector, property) => [...document.querySelectorAll(selector)]
    .map(element => getComputedStyle(element)[property])
    .filter((colour, i, all) => all.indexOf(colour) === i)
    .map(colour => [contrast(colour), colour])
    .sort((a, b) => a[0] - b[0])[0];
  return [least(".sheet text", "fill"),
    least(".sheet g[data-name] path[stroke]:not([stroke='#ffffff'])", "stroke")];
})()"##;

#[test]
fn figures_can_be_read_on_dark_pages() {
    let Some(mut browser) = Browser::start() else { return };
    for page in all_pages(demo()) {
        browser.dark(true);
        browser.open(&page);
        let contrast = browser.evaluate(CONTRAST);
        for (nth, least) in [(0, 4.5), (1, 3.0)] {
            let found = &contrast[nth];
            let found_ratio = found[0].as_f64();
            assert!(found.is_null() || found_ratio >= Some(least), "{}: {found}", page.display());
        }
    }
}

#[test]
fn the_report_is_small_and_of_use_within_a_second() {
    let Some(mut browser) = Browser::start_alone() else { return };
    let page = demo().join("index.html");
    let bytes = std::fs::metadata(&page).unwrap().len();
    assert!(bytes < 1_200_000, "{bytes} bytes");
    // Take the minimum of five durations, because other programs also use the processor.
    let opened_ms = (0..5).map(|_| {
        browser.open(&page);
        let end = "performance.getEntriesByType(\"navigation\")[0].loadEventEnd";
        // The duration of an event is recorded only after the event.
        browser.evaluate("new Promise(done => requestAnimationFrame(() => setTimeout(done)))");
        browser.evaluate(end).as_f64().unwrap()
    });
    let least_ms = opened_ms.fold(f64::INFINITY, f64::min);
    assert!(least_ms > 0.0 && least_ms < 1000.0, "{least_ms} ms");
}
