//! What every page keeps to.

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

/// What is drawn, listed and described, and what waits for a script to be of use.
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
    let pdf = browser.pdf();
    let sheets = String::from_utf8_lossy(&pdf).matches("/Type /Page\n").count();
    assert!((3..=20).contains(&sheets), "{sheets} sheets");
}
