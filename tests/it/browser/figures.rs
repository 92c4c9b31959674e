//! Tests of the figures on pages: tooltips by pointer and keyboard, and legends.

use super::*;

/// JavaScript expression for the first panel with measured points and a model's curve.
const PANEL: &str = r#"const panel = [...document.querySelectorAll("figure .panel")].find(panel =>
  panel.querySelector('g[data-name="measured"][data-points]')
  && panel.querySelector('g[data-name="skid-roll"][data-band]') && panel.dataset.x);"#;

/// JavaScript expression for the position of the first measured point of [`PANEL`] in the window.
const POINT: &str = r#"panel.scrollIntoView({ block: "center", behavior: "instant" });
  const dots = [...panel.querySelectorAll('g[data-name="measured"] path')].pop();
  const [, x, y] = /m(-?\d+) ?(-?\d+)/.exec(dots.getAttribute("d"));
  const at = new DOMPoint(x, y).matrixTransform(panel.getScreenCTM());
  return [at.x + 1, at.y + 1];"#;

const TOLD: &str = r#"(() => {
  const tip = document.querySelector(".tip");
  return tip.hidden ? "" : tip.textContent;
})()"#;

fn within(panel: &str) -> String {
    format!("(() => {{ {PANEL} {panel} }})()")
}

#[track_caller]
fn told(browser: &mut Browser) -> String {
    browser.evaluate(TOLD).as_str().unwrap().to_owned()
}

#[track_caller]
fn assert_says_trial_omega_and_value(told: &str) {
    assert!(["measured, ", "flagged, "].iter().any(|kind| told.starts_with(kind)), "{told:?}");
    for part in ["-r1", "rad/s) ", "(mm", " (95 %: "] {
        assert!(told.contains(part), "no {part:?} in {told:?}");
    }
}

#[test]
fn the_tooltip_of_the_nearest_point_works_by_pointer_and_keyboard_and_opens_its_trial() {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(1400, 900);
    browser.open(&demo().join("index.html"));
    let point = browser.place(&within(POINT));
    browser.point(point);
    let pointed = told(&mut browser);
    assert_says_trial_omega_and_value(&pointed);
    browser.point([2.0, 2.0]);
    assert_eq!(told(&mut browser), "");

    browser.evaluate(&within("panel.focus();"));
    browser.key("ArrowRight");
    // Flagged trials, if there are any, are drawn first, beneath the others.
    if told(&mut browser).starts_with("flagged") {
        browser.key("ArrowDown");
    }
    let first = told(&mut browser);
    assert_says_trial_omega_and_value(&first);
    browser.key("ArrowRight");
    let second = told(&mut browser);
    assert_says_trial_omega_and_value(&second);
    assert_ne!(first, second);
    browser.key("ArrowLeft");
    assert_eq!(told(&mut browser), first);

    browser.key("Enter");
    browser.wait_for("Page.loadEventFired");
    let heading = browser.evaluate("document.querySelector(\"h1\").textContent");
    assert!(first.contains(heading.as_str().unwrap()), "{heading} {first}");
    browser.open(&demo().join("index.html"));
    let point = browser.place(&within(POINT));
    browser.click(point);
    assert_eq!(told(&mut browser), format!("{pointed} Open its page"));
    // The tooltip stays, so that its link can be clicked.
    let link = browser.middle_of(".tip a");
    browser.click(link);
    browser.wait_for("Page.loadEventFired");
    let heading = browser.evaluate("document.querySelector(\"h1\").textContent");
    assert!(pointed.contains(heading.as_str().unwrap()), "{heading} {pointed}");
    assert_no_problems(&browser);
}

#[test]
fn the_tooltip_of_the_nearest_curve_has_its_interval_by_pointer_and_keyboard() {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(1400, 900);
    browser.open(&demo().join("index.html"));
    // The measured points, which would be nearer, are switched off.
    let curve = browser.place(&within(
        r#"panel.closest(".sheet").querySelector('.key[data-name="measured"]')
          .dispatchEvent(new MouseEvent("click"));
        panel.scrollIntoView({ block: "center", behavior: "instant" });
        const path = panel.querySelector('g[data-name="skid-roll"][data-band] path');
        const middle = path.getPointAtLength(path.getTotalLength() / 2);
        const at = new DOMPoint(middle.x, middle.y).matrixTransform(panel.getScreenCTM());
        return [at.x, at.y];"#,
    ));
    browser.point(curve);
    let pointed = told(&mut browser);
    browser.evaluate(&within("panel.focus();"));
    for key in ["ArrowRight", "ArrowDown", "ArrowUp", "ArrowRight"] {
        browser.key(key);
    }
    let mut by_keys = told(&mut browser);
    for _ in 0..3 {
        if by_keys.starts_with("skid-roll") {
            break;
        }
        browser.key("ArrowDown");
        by_keys = told(&mut browser);
    }
    for told in [pointed, by_keys] {
        let interval = told.split_once("(95 %: ").expect(&told).1;
        let limits: Vec<f64> = interval
            .trim_end_matches(')')
            .split(" to ")
            .map(|limit| limit.parse().expect("a number"))
            .collect();
        let value = told.split("(mm) ").nth(1).or(told.split("(mm/s) ").nth(1)).expect(&told);
        let value: f64 = value.split(' ').next().unwrap().parse().expect("a number");
        assert!(told.starts_with("skid-roll: "), "{told}");
        assert!((limits[0]..=limits[1]).contains(&value), "{told}");
    }
    assert_no_problems(&browser);
}

#[test]
fn a_tap_shows_a_value_and_its_link_and_a_second_one_opens_its_trial() {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(390, 844);
    browser.open(&demo().join("index.html"));
    let point = browser.place(&within(POINT));
    browser.tap(point);
    let tapped = told(&mut browser);
    assert_says_trial_omega_and_value(&tapped);
    assert!(tapped.ends_with(" Open its page"), "{tapped}");
    // The tooltip stays until another position is tapped.
    browser.evaluate("new Promise(done => setTimeout(done, 300))");
    assert_eq!(told(&mut browser), tapped);
    let caption = browser.middle_of("figcaption");
    browser.tap(caption);
    assert_eq!(told(&mut browser), "");

    let point = browser.place(&within(POINT));
    browser.tap(point);
    assert_eq!(told(&mut browser), tapped);
    browser.tap(point);
    browser.wait_for("Page.loadEventFired");
    let heading = browser.evaluate("document.querySelector(\"h1\").textContent");
    assert!(tapped.contains(heading.as_str().unwrap()), "{heading} {tapped}");
    assert_no_problems(&browser);
}

/// JavaScript expression for the lines in figures, which have a stroke and no fill of their own: their number, the
/// number that are drawn without a stroke, the fills, and the number of different strokes.
const COLOURS: &str = r#"(() => {
  const drawn = [...document.querySelectorAll(".sheet path, .sheet text, .replay figure > svg path")];
  const lines = drawn.filter(of => of.hasAttribute("stroke") && !of.hasAttribute("fill"));
  const of = style => [...new Set(lines.map(line => getComputedStyle(line)[style]))];
  const lost = lines.filter(line => getComputedStyle(line).stroke === "none");
  return [lines.length, lost.length, of("fill"), of("stroke").length];
})()"#;

#[test]
fn a_page_without_its_styles_has_coloured_charts() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let trial = files(demo()).into_keys().find(|path| path.starts_with("trials")).unwrap();
    for name in [Path::new("index.html"), &trial] {
        let page = crate::common::text(&std::fs::read(demo().join(name)).unwrap()).to_owned();
        let policy = "<head>\n<meta http-equiv=\"Content-Security-Policy\" \
                      content=\"style-src 'self'; script-src 'self'\">";
        let strict = folder.path().join("strict.html");
        std::fs::write(&strict, page.replacen("<head>", policy, 1)).unwrap();
        for is_dark in [false, true] {
            browser.dark(is_dark);
            browser.open(&strict);
            let found = browser.evaluate(COLOURS);
            let what = format!("{} {found}", name.display());
            assert!(found[0].as_u64() > Some(20) && found[1] == 0, "{what}");
            assert_eq!(found[2], json!(["none"]), "{what}");
            assert!(found[3].as_u64() > Some(2), "{what}");
            // Dark lines need a light background.
            let scheme = browser.evaluate("getComputedStyle(document.documentElement).colorScheme");
            assert_eq!(scheme, "normal", "{what}");
        }
    }
}

#[test]
fn a_legend_switches_its_series_off_and_on_by_pointer_and_keyboard() {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(1400, 900);
    browser.open(&demo().join("index.html"));
    let key = within(
        r#"const key = panel.closest(".sheet").querySelector('.key[data-name="measured"]');
        key.scrollIntoView({ block: "center", behavior: "instant" });
        const box = key.getBoundingClientRect();
        return [box.x + box.width / 2, box.y + box.height / 2];"#,
    );
    let shown = within(
        r#"const group = panel.querySelector('g[data-name="measured"]');
        const key = panel.closest(".sheet").querySelector('.key[data-name="measured"]');
        return [getComputedStyle(group).display !== "none", key.ariaPressed === "true"];"#,
    );
    let both = |is_on: bool| json!([is_on, is_on]);
    assert_eq!(browser.evaluate(&shown), both(true));
    let place = browser.place(&key);
    browser.click(place);
    assert_eq!(browser.evaluate(&shown), both(false));
    // Hidden series have no tooltip.
    let point = browser.place(&within(POINT));
    browser.point(point);
    assert!(!told(&mut browser).contains("measured"));
    browser.evaluate(&within(
        r#"panel.closest(".sheet").querySelector('.key[data-name="measured"]').focus();"#,
    ));
    for (key, is_on) in [("Enter", true), (" ", false), ("Enter", true)] {
        browser.key(key);
        assert_eq!(browser.evaluate(&shown), both(is_on), "{key:?}");
    }
    assert_no_problems(&browser);
}

#[test]
fn every_figure_is_drawn_and_described() {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(1400, 900);
    for reports in [demo(), own()] {
        browser.open(&reports.join("index.html"));
        browser.evaluate("document.querySelectorAll(\"details\").forEach(of => of.open = true)");
        let sheets = browser.evaluate(
            r#"[...document.querySelectorAll(".sheet")].map(sheet => [
              sheet.ariaLabel,
              [...sheet.querySelectorAll(".panel path")].filter(path =>
                path.getBBox().width > 0 && path.getBoundingClientRect().width > 0).length,
              getComputedStyle(sheet.querySelector(".panel text")).fontFamily,
            ])"#,
        );
        let sheets = sheets.as_array().unwrap();
        assert!(sheets.len() > 10, "{} figures", sheets.len());
        for sheet in sheets {
            assert!(sheet[0].as_str().unwrap().len() > 20, "{sheet}");
            assert!(sheet[1].as_u64() > Some(2), "{sheet}");
            assert_eq!(sheet[2], "Roboto, sans-serif", "{sheet}");
        }
    }
}

/// JavaScript expression for the numbers at the axes of [`PANEL`], for whether it is magnified, and for the largest
/// value of either axis.
const AXES: &str = r#"
  const numbers = [...panel.querySelectorAll("text")].filter(of => of.checkVisibility())
    .map(of => of.textContent).filter(text => /^[\d.]+$/.test(text)).map(Number);
  const ends = [panel.dataset.x, panel.dataset.y].map(of => of.split(" "))
    .map(([, , , high, logarithmic]) => +logarithmic ? 10 ** high : +high);
  return [numbers, !!panel.querySelector(".zoom"), Math.max(...ends)];"#;

#[test]
fn a_dragged_rectangle_magnifies_a_panel_and_a_double_click_shows_all_of_it() {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(1400, 900);
    browser.open(&demo().join("index.html"));
    let corner = |across: f64, up: f64| {
        within(&format!(
            r#"panel.scrollIntoView({{ block: "center", behavior: "instant" }});
            const [[x0, x1], [y0, y1]] = [panel.dataset.x, panel.dataset.y].map(of => of.split(" ").map(Number));
            const at = new DOMPoint(x0 + {across} * (x1 - x0), y0 + {up} * (y1 - y0))
              .matrixTransform(panel.getScreenCTM());
            return [at.x, at.y];"#
        ))
    };
    let whole = browser.evaluate(&within(AXES));
    let [from, to] =
        [(0.4, 0.9), (0.8, 0.5)].map(|(across, up)| browser.place(&corner(across, up)));
    browser.drag(from, to);
    let part = browser.evaluate(&within(AXES));
    let numbers =
        |of: &serde_json::Value| -> Vec<f64> { serde_json::from_value(of[0].clone()).unwrap() };
    assert!(whole[1] == false && part[1] == true, "{whole} {part}");
    let (all, some) = (numbers(&whole), numbers(&part));
    let most = part[2].as_f64().unwrap();
    assert!(all != some && some.len() >= 4 && some.iter().all(|of| *of <= most), "{whole} {part}");
    // A point in the middle of the panel is still found where it is drawn.
    browser.double_click(to);
    assert_eq!(browser.evaluate(&within(AXES)), whole);
    browser.evaluate(&within("panel.focus();"));
    browser.key("+");
    assert_eq!(browser.evaluate(&within(AXES))[1], true);
    browser.key("0");
    assert_eq!(browser.evaluate(&within(AXES)), whole);
    assert_no_problems(&browser);
}

/// JavaScript expression for the smallest text (px) of the visible figures.
const SMALLEST: &str = r#"Math.min(...[...document.querySelectorAll(".sheet text")]
  .filter(of => of.textContent && of.checkVisibility())
  .map(of => {
    const { a, b } = of.getScreenCTM();
    return parseFloat(getComputedStyle(of).fontSize) * Math.hypot(a, b);
  }))"#;

#[test]
fn the_text_of_figures_can_be_read_in_every_window() {
    let Some(mut browser) = Browser::start() else { return };
    for (width, least_px) in [(1400, 11.0), (820, 9.0), (390, 9.0)] {
        browser.window(width, 900);
        browser.open(&demo().join("index.html"));
        browser.evaluate("document.querySelectorAll(\"details\").forEach(of => of.open = true)");
        let px = browser.evaluate(SMALLEST).as_f64().unwrap();
        assert!(px >= least_px - 0.01, "{px} px at {width} px");
    }
}
