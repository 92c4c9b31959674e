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
const SHOWN: &str = r##"[...document.querySelectorAll("table.trials tbody tr")]
  .filter(row => row.checkVisibility() && row.cells.length > 2)
  .map(row => row.cells[0].textContent)"##;

/// Returns whether each campaign's rows are sorted by d, ascending (1) or descending (-1), with missing values last.
fn is_sorted(browser: &mut Browser, direction: i32) -> bool {
    let sorted = browser.evaluate(&format!(
        r##"[...document.querySelectorAll("table.trials tbody")].every(body => {{
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
    let heading = browser.middle_of("table.trials thead th:nth-child(5) button");
    browser.click(heading);
    assert!(is_sorted(&mut browser, 1) && !is_sorted(&mut browser, -1));
    // The button is focused.
    browser.key("Enter");
    assert!(is_sorted(&mut browser, -1) && !is_sorted(&mut browser, 1));
    let sorted =
        browser.evaluate("document.querySelector(\"table.trials thead th:nth-child(5)\").ariaSort");
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

/// JavaScript expression for the height (px) of the page and the number of its tab stops.
const SIZE: &str = r#"[document.documentElement.scrollHeight,
  [...document.querySelectorAll("a[href], button, input, select, summary, [tabindex='0']")]
    .filter(of => of.checkVisibility()).length]"#;

#[test]
fn the_index_is_short_until_it_is_unfolded() {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(1400, 900);
    for reports in [demo(), own()] {
        browser.open(&reports.join("index.html"));
        let [height_px, stops]: [u64; 2] = serde_json::from_value(browser.evaluate(SIZE)).unwrap();
        assert!((3000..15_000).contains(&height_px), "{height_px} px");
        assert!((50..400).contains(&stops), "{stops} tab stops");
        let sentences = browser.evaluate(
            r#"[...document.querySelectorAll("section[aria-labelledby^='campaign'] > details > summary")]
              .map(summary => summary.textContent)"#,
        );
        let sentences = sentences.to_string();
        assert!(sentences.contains(" starts agree"), "{sentences}");
        browser.evaluate("document.querySelectorAll(\"details\").forEach(of => of.open = true)");
        let [unfolded_px, _]: [u64; 2] = serde_json::from_value(browser.evaluate(SIZE)).unwrap();
        assert!(unfolded_px > height_px + 5000, "{unfolded_px} px");
    }
}

#[test]
fn an_address_unfolds_what_it_names() {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(1400, 900);
    browser.open(&demo().join("index.html"));
    let is_seen = |id: &str| {
        format!(
            "(() => {{ const of = document.getElementById(\"{id}\"); \
             const {{ top }} = of.getBoundingClientRect(); \
             return of.checkVisibility() && of.closest(\"details\")?.open !== false \
               && top > -1 && top < innerHeight; }})()"
        )
    };
    for id in ["fig-17", "fig-9", "campaign-2-fit", "fig-kinematic-skewed-sigma"] {
        browser.evaluate(&format!("location.hash = \"{id}\""));
        browser.evaluate("new Promise(done => setTimeout(done, 100))");
        assert_eq!(browser.evaluate(&is_seen(id)), true, "{id}");
    }
    assert_no_problems(&browser);
}

#[test]
fn every_table_is_sorted_and_copied_as_csv_and_latex() {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(1400, 900);
    browser.open(&demo().join("index.html"));
    browser.evaluate(
        "document.addEventListener(\"copy\", event => { \
           setTimeout(() => { window.copied = event.clipboardData.getData(\"text/plain\"); }); \
           window.copied = event; })",
    );
    let values = "[...document.querySelector(\"#campaign-1-models ~ .scroll table\").tBodies[0].rows]\
                  .map(row => Number.parseFloat(row.cells[1].textContent))";
    let heading = browser.middle_of("#campaign-1-models ~ .scroll thead th:nth-child(2) button");
    browser.click(heading);
    let sorted: Vec<f64> = serde_json::from_value(browser.evaluate(values)).unwrap();
    assert!(sorted.len() >= 3 && sorted.is_sorted(), "{sorted:?}");
    browser.click(heading);
    let sorted: Vec<f64> = serde_json::from_value(browser.evaluate(values)).unwrap();
    assert!(sorted.iter().rev().is_sorted(), "{sorted:?}");

    let copy = |browser: &mut Browser, nth: usize| {
        let tools = format!("#trials ~ .tools button:nth-child({nth})");
        browser.evaluate(
            "document.execCommand = (kind => { \
               const data = new DataTransfer(); \
               document.dispatchEvent(new ClipboardEvent(kind, { clipboardData: data })); \
               window.copied = data.getData(\"text/plain\"); })",
        );
        let place = browser.middle_of(&tools);
        browser.click(place);
        browser.evaluate("window.copied").as_str().expect("a text").to_owned()
    };
    let csv = copy(&mut browser, 1);
    let (head, rows) = csv.split_once('\n').unwrap();
    assert!(head.starts_with("Trial,Status,ω set rad/s,ω rad/s,"), "{head}");
    assert!(head.contains(",d mm,\"d mm, standard error\","), "{head}");
    let columns = head.matches(',').count() - head.matches(", standard").count();
    let row = rows.lines().find(|row| row.starts_with("kinematic-skewed-3.90-r1,")).expect("a row");
    assert_eq!(row.matches(',').count(), columns, "{row}");
    let [d_mm, error_mm]: [f64; 2] = {
        let place = head.split(",d mm,").next().unwrap().matches(',').count() + 1
            - head.split(",d mm,").next().unwrap().matches(", standard").count();
        let cells: Vec<&str> = row.split(',').collect();
        [place, place + 1].map(|i| cells[i].parse().expect(row))
    };
    assert!(d_mm > 10.0 && error_mm > 0.0 && error_mm < d_mm, "{row}");
    let latex = copy(&mut browser, 2);
    assert!(latex.starts_with("\\begin{tabular}{llrrrrrrrrrrr}\n\\toprule\nTrial & "), "{latex}");
    assert!(latex.ends_with("\\bottomrule\n\\end{tabular}\n"), "{latex}");
    assert!(latex.contains(" & $\\omega$ set rad/s & ") && latex.is_ascii(), "{latex}");
    assert_no_problems(&browser);
}

#[test]
fn a_value_and_its_standard_error_end_at_the_same_digit() {
    let Some(mut browser) = Browser::start() else { return };
    for page in all_pages(demo()) {
        browser.open(&page);
        let pairs = browser.evaluate(
            r#"[...document.querySelectorAll("td, th, p")].flatMap(of =>
              [...of.textContent.matchAll(/(?<![\d.])(\d+(?:\.\d+)?) ± (\d+(?:\.\d+)?)/g)]
                .map(([, value, error]) => [value, error]))"#,
        );
        let pairs: Vec<[String; 2]> = serde_json::from_value(pairs).unwrap();
        for [value, error] in &pairs {
            let decimals = |text: &str| text.split_once('.').map_or(0, |(_, end)| end.len());
            assert_eq!(decimals(value), decimals(error), "{value} ± {error}");
            let digits = error.replace('.', "");
            let digits = digits.trim_start_matches('0');
            let is_capped = value.replace('.', "").trim_start_matches('0').len() == 5;
            assert!(
                digits.len() == 2 || !error.contains('.') || is_capped && digits.len() == 1,
                "{value} ± {error}"
            );
        }
        let words = browser.evaluate("document.body.textContent");
        assert!(!words.as_str().unwrap().contains("wheel 0:"), "{}", page.display());
    }
}

/// JavaScript expression for the rows and points that are lit.
const LIT: &str = r#"[[...document.querySelectorAll("tr.lit")].map(row => row.cells[0].textContent),
  document.querySelectorAll("circle.lit").length]"#;

#[test]
fn a_selected_trial_is_lit_everywhere_and_stays_in_the_address() {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(1400, 900);
    browser.open(&demo().join("index.html"));
    let row = browser.place(
        r#"(() => {
          const row = [...document.querySelectorAll("table.trials tr")]
            .find(row => row.cells[0].textContent === "kinematic-skewed-3.90-r1");
          row.scrollIntoView({ block: "center", behavior: "instant" });
          const box = row.cells[5].getBoundingClientRect();
          return [box.x + box.width / 2, box.y + box.height / 2];
        })()"#,
    );
    browser.click(row);
    browser.point([2.0, 2.0]);
    let lit = browser.evaluate(LIT);
    assert!(lit[0].as_array().unwrap().iter().all(|name| name == "kinematic-skewed-3.90-r1"));
    assert!(lit[0].as_array().unwrap().len() > 1 && lit[1].as_u64() > Some(4), "{lit}");
    // By keyboard, a space on the link of a row selects its trial, or nothing if the trial is selected.
    browser.evaluate(r#"document.querySelector("tr.lit a").focus({ preventScroll: true })"#);
    for hash in ["", "#trial=kinematic-skewed-3.90-r1"] {
        browser.key(" ");
        assert_eq!(browser.evaluate("location.hash"), hash);
    }
    let filter = browser.middle_of("#trials-filter");
    browser.click(filter);
    browser.text("3.9 W0");
    let address = browser.evaluate("location.href");
    let address = address.as_str().unwrap();
    assert!(address.ends_with("#trial=kinematic-skewed-3.90-r1&filter=3.9+W0"), "{address}");
    let shown = browser.evaluate(SHOWN);
    browser.evaluate("location.reload()");
    browser.wait_for("Page.loadEventFired");
    assert_eq!(browser.evaluate(LIT), lit);
    assert_eq!(browser.evaluate(SHOWN), shown);
    assert_no_problems(&browser);
}
