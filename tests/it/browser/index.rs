//! Tests of the report's index page: summary, navigation, table of trials.

use super::*;

/// JavaScript expression for the content of each campaign's summary, and for the distances (px) from the top of the
/// page to the bottom of its heading, coefficients and curve.
const ANSWERS: &str = r#"[...document.querySelectorAll(".answers article")].map(article => {
  const bottom = element => element ? element.getBoundingClientRect().bottom + scrollY : Infinity;
  const rows = [...article.querySelectorAll("tr")];
  return {
    name: article.querySelector("h3").textContent,
    model: bottom(article.querySelector("h3")),
    coefficients: rows.map(row => row.textContent),
    answered: Math.max(...rows.map(bottom)),
    curve: article.querySelectorAll(".panel g[data-points]").length,
    curveBottom: bottom(article.querySelector(".panel")),
  };
})"#;

#[test]
fn every_campaigns_model_and_coefficients_are_on_the_first_screen() {
    let Some(mut browser) = Browser::start() else { return };
    for reports in [demo(), own()] {
        for (width, height) in SIZES {
            browser.window(width, height);
            browser.open(&reports.join("index.html"));
            // In a narrow window the summary fits on two screens.
            let screens = if width < 500 { 2.0 } else { 1.0 };
            let end_px = screens * f64::from(height);
            let answers = browser.evaluate(ANSWERS);
            let answers = answers.as_array().unwrap();
            assert!(answers.len() >= 2, "{answers:?}");
            for answer in answers {
                let name = answer["name"].as_str().unwrap();
                assert!(name.contains("fits") || name.contains("does not fit"), "{name}");
                let coefficients = answer["coefficients"].as_array().unwrap();
                assert!(coefficients.len() >= 3, "{name}: {coefficients:?}");
                let bottoms = [&answer["model"], &answer["answered"]];
                for bottom_px in bottoms.map(|px| px.as_f64().expect("a place")) {
                    assert!(bottom_px <= end_px, "{name}: ends at {bottom_px} of {end_px} px");
                }
                assert_ne!(answer["curve"], 0, "{name} has no curve with measurements");
                if width > 500 {
                    assert!(answer["curveBottom"].as_f64().unwrap() <= end_px, "{answer}");
                }
            }
            let counted = browser.evaluate("document.querySelector(\"header\").innerText");
            let counted = counted.as_str().unwrap();
            for text in [" trials", " ok", " flagged", " failed"] {
                assert!(counted.contains(text), "{counted}");
            }
        }
    }
    assert_no_problems(&browser);
}

/// JavaScript expression for the names of the trials that the table shows.
const SHOWN: &str = r##"[...document.querySelectorAll("#trials-table tbody tr")]
  .filter(row => row.checkVisibility() && row.cells.length > 2)
  .map(row => row.cells[0].textContent)"##;

/// Returns whether each campaign's rows are sorted by d, ascending (1) or descending (-1), with missing values last.
fn is_sorted(browser: &mut Browser, direction: i32) -> bool {
    let sorted = browser.evaluate(&format!(
        r##"[...document.querySelectorAll("#trials-table tbody")].every(body => {{
          const values = [...body.rows].slice(1)
            .map(row => Number.parseFloat(row.cells[4].textContent.replace("\u2212", "-")));
          return values.every((value, i) => i === 0 || Number.isNaN(value)
            || {direction} * (value - values[i - 1]) >= 0);
        }})"##
    ));
    sorted == true
}

#[test]
fn the_table_of_trials_is_sorted_by_pointer_or_keyboard_and_filtered_by_words() {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(1400, 900);
    browser.open(&demo().join("index.html"));
    let all = browser.evaluate(SHOWN);
    assert!(all.as_array().unwrap().len() > 5, "{all}");
    let heading = browser.middle_of("#trials-table thead th:nth-child(5) button");
    browser.click(heading);
    assert!(is_sorted(&mut browser, 1) && !is_sorted(&mut browser, -1));
    // The button is focused.
    browser.key("Enter");
    assert!(is_sorted(&mut browser, -1) && !is_sorted(&mut browser, 1));
    let sorted = browser
        .evaluate("document.querySelector(\"#trials-table thead th:nth-child(5)\").ariaSort");
    assert_eq!(sorted, "descending");

    let filter = browser.middle_of("#trials-filter");
    browser.click(filter);
    browser.text("skewed 3.90-r1");
    assert_eq!(browser.evaluate(SHOWN), json!(["kinematic-skewed-3.90-r1"]));
    let said = "document.getElementById(\"trials-shown\").textContent";
    assert!(browser.evaluate(said).as_str().unwrap().starts_with("1 of "));
    browser.text(" no such trial");
    assert_eq!(browser.evaluate(SHOWN), json!([]));
    browser.evaluate("document.getElementById(\"trials-filter\").select()");
    browser.text(" ");
    let again = browser.evaluate(SHOWN);
    assert_eq!(again.as_array().unwrap().len(), all.as_array().unwrap().len());
    assert_no_problems(&browser);
}

#[test]
fn every_link_of_the_bar_is_seen_at_any_width() {
    let Some(mut browser) = Browser::start() else { return };
    for page in [demo().join("index.html"), demo().join("history.html"), own().join("index.html")] {
        for (width, height) in [(1400, 900), (800, 900), (390, 844)] {
            browser.window(width, height);
            browser.open(&page);
            let found = browser.evaluate(
                r#"(() => {
                  const list = document.querySelector("nav.bar > ul");
                  const within = list.getBoundingClientRect();
                  const links = [...list.querySelectorAll("a")];
                  const hidden = links.filter(link => {
                    const box = link.getBoundingClientRect();
                    return !link.checkVisibility() || box.right > innerWidth + 1
                      || box.bottom > within.bottom + 1 || box.top < within.top - 1;
                  });
                  return [links.map(link => link.textContent), hidden.map(link => link.textContent)];
                })()"#,
            );
            let [links, hidden]: [Vec<String>; 2] = serde_json::from_value(found).unwrap();
            assert!(links.len() >= 4, "{links:?}");
            assert_eq!(hidden, Vec::<String>::new(), "{} at {width} px", page.display());
        }
    }
}

#[test]
fn the_navigation_stays_in_reach_and_has_what_each_campaign_has() {
    let Some(mut browser) = Browser::start() else { return };
    for (width, height) in SIZES {
        browser.window(width, height);
        browser.open(&demo().join("index.html"));
        browser.evaluate("scrollTo(0, document.body.scrollHeight)");
        let summary = browser.place(
            r#"(() => {
              const box = document.querySelector("nav.bar summary").getBoundingClientRect();
              return [box.x + box.width / 2, box.y + box.height / 2];
            })()"#,
        );
        assert!(summary[1] > 0.0 && summary[1] < 60.0, "{summary:?}");
        browser.click(summary);
        let links = browser.evaluate(
            r#"[...document.querySelectorAll("nav.bar details ul ul a")]
              .filter(link => link.checkVisibility()).map(link => link.textContent)"#,
        );
        let links = links.as_array().unwrap();
        for text in ["Figures", "Fitted models", "Goodness of fit", "Model comparison"] {
            let found = links.iter().filter(|link| **link == text).count();
            assert!(found >= 3, "{width} px: {text} {found} times");
        }
        let models = browser.place(
            r#"(() => {
              const links = [...document.querySelectorAll("nav.bar details ul ul a")];
              const box = links.find(link => link.textContent === "Fitted models").getBoundingClientRect();
              return [box.x + 9, box.y + 9];
            })()"#,
        );
        browser.click(models);
        let seen = browser.evaluate(
            r##"(() => {
              const box = document.querySelector("#campaign-1-models").getBoundingClientRect();
              const bar = document.querySelector("nav.bar").getBoundingClientRect();
              return [box.top >= bar.bottom - 1 && box.top < 200, document.querySelector("nav.bar details").open];
            })()"##,
        );
        assert_eq!(seen, json!([true, false]), "{width} px");
        browser.click(summary);
        browser.key("Escape");
        assert_eq!(browser.evaluate("document.querySelector(\"nav.bar details\").open"), false);
    }
    assert_no_problems(&browser);
}
