//! Tests of the replay on a trial page: single steps, playback, and seeking by pointer and keyboard.

use super::*;

const FRAME: &str = "+document.querySelector(\".replay input\").value";
const LAST: &str = "+document.querySelector(\".replay input\").max";
const ROBOT: &str = "document.querySelector(\".robot.live g\").getAttribute(\"transform\")";
const TIME: &str = "parseFloat(document.querySelector(\".replay .now dd\").textContent)";
const VIEW: &str =
    "document.querySelector(\".replay svg\").getAttribute(\"viewBox\").split(\" \").map(Number)";

fn opened(width: u32) -> Option<Browser> {
    let mut browser = Browser::start()?;
    browser.window(width, 900);
    browser.open(&demo().join("trials/kinematic-skewed-3.90-r1.html"));
    Some(browser)
}

fn number(browser: &mut Browser, expression: &str) -> f64 {
    browser.evaluate(expression).as_f64().unwrap_or_else(|| panic!("{expression} is no number"))
}

fn press(browser: &mut Browser, action: &str) {
    let at = browser.middle_of(&format!(".replay [data-do={action}]"));
    browser.click(at);
}

fn wait(browser: &mut Browser, ms: u32) {
    browser.evaluate(&format!("new Promise(done => setTimeout(() => done(1), {ms}))"));
}

#[test]
fn a_replay_is_stepped_by_buttons_and_keys_and_moved_by_its_slider() {
    let Some(mut browser) = opened(1400) else { return };
    let start = browser.evaluate(ROBOT);
    press(&mut browser, "on");
    assert_eq!(browser.evaluate(FRAME), 1);
    assert_ne!(browser.evaluate(ROBOT), start);
    press(&mut browser, "back");
    assert_eq!((browser.evaluate(FRAME), browser.evaluate(ROBOT)), (json!(0), start));
    browser.evaluate("document.querySelector(\".replay\").focus()");
    let last = browser.evaluate(LAST);
    assert!(last.as_f64() > Some(100.0) && last.as_f64() < Some(300.0), "{last}");
    for (key, frame) in [
        ("ArrowRight", json!(1)),
        ("End", last.clone()),
        ("ArrowLeft", json!(last.as_f64().unwrap() - 1.0)),
        ("Home", json!(0)),
    ] {
        browser.key(key);
        assert_eq!(browser.evaluate(FRAME).as_f64(), frame.as_f64(), "{key}");
    }
    // Use the slider's keys, and set the slider as a pointer does.
    browser.evaluate("document.querySelector(\".replay input\").focus()");
    browser.key("ArrowRight");
    assert_eq!(browser.evaluate(FRAME), 1);
    browser.evaluate(
        "{ const slider = document.querySelector(\".replay input\"); slider.value = 50; \
         slider.dispatchEvent(new Event(\"input\")); }",
    );
    assert!(number(&mut browser, TIME) > 1.0);
    let says = browser.evaluate("document.querySelector(\".replay input\").ariaValueText");
    assert!(says.as_str().unwrap().contains("cycle ") && says.as_str().unwrap().contains("phase "));
    let now = browser.evaluate("document.querySelector(\".replay .now\").innerText");
    for text in ["Skid velocity", "mm/s", "Deviation of ", "Markers missing"] {
        assert!(now.as_str().unwrap().contains(text), "{now}");
    }
    assert_no_problems(&browser);
}

#[test]
fn a_replay_plays_at_its_speed_pauses_and_does_not_begin_by_itself() {
    let Some(mut browser) = opened(400) else { return };
    wait(&mut browser, 300);
    assert_eq!(browser.evaluate(FRAME), 0);
    press(&mut browser, "play");
    wait(&mut browser, 700);
    let label = "document.querySelector(\".replay [data-do=play]\").ariaLabel";
    assert_eq!(browser.evaluate(label), "Pause");
    press(&mut browser, "play");
    let (played, time_s) = (number(&mut browser, FRAME), number(&mut browser, TIME));
    assert!(played > 1.0 && (0.3..60.0).contains(&time_s), "frame {played} at {time_s} s");
    wait(&mut browser, 300);
    assert_eq!(browser.evaluate(FRAME).as_f64(), Some(played));
    assert_eq!(browser.evaluate(label), "Play");
    // Play to the end, and then again from the start.
    browser.evaluate(
        "{ const speed = document.querySelector(\".replay select\"); speed.value = 4; \
         document.querySelector(\".replay\").focus(); }",
    );
    browser.key("End");
    browser.key(" ");
    wait(&mut browser, 500);
    let again = number(&mut browser, TIME);
    browser.key(" ");
    assert!(again > 0.3 && number(&mut browser, FRAME) < number(&mut browser, LAST), "{again}");
    assert_no_problems(&browser);
}

#[test]
fn a_cursor_runs_through_the_charts_and_a_click_in_one_is_followed() {
    let Some(mut browser) = opened(1400) else { return };
    assert!(number(&mut browser, "document.querySelectorAll(\".panel .cursor\").length") >= 8.0);
    // The last chart shows the whole recording.
    let chart = "[...document.querySelectorAll(\".panel\")].findLast(panel => panel.querySelector(\".cursor\"))";
    let at = browser.place(&format!(
        "(() => {{ const panel = {chart}; panel.scrollIntoView({{ block: \"center\", behavior: \"instant\" }}); \
         const box = panel.getBoundingClientRect(); return [box.x + 0.6 * box.width, box.y + 0.5 * box.height]; }})()"
    ));
    browser.click(at);
    assert!(number(&mut browser, FRAME) > 50.0);
    let cursor = number(
        &mut browser,
        &format!("{chart}.querySelector(\".cursor\").getBoundingClientRect().x"),
    );
    // The tolerance is the number of frames per pixel.
    assert!((cursor - at[0]).abs() < 4.0, "{cursor} and {}", at[0]);
    let before = cursor;
    browser.evaluate("document.querySelector(\".replay\").focus()");
    browser.key("End");
    let after = number(
        &mut browser,
        &format!("{chart}.querySelector(\".cursor\").getBoundingClientRect().x"),
    );
    assert!(after > before + 20.0, "{before} and {after}");
    assert_no_problems(&browser);
}

#[test]
fn a_replay_is_zoomed_and_moved_and_seen_as_a_whole_again() {
    let Some(mut browser) = opened(1400) else { return };
    press(&mut browser, "whole");
    let wide = |browser: &mut Browser| browser.evaluate(VIEW)[2].as_f64().unwrap();
    let whole = wide(&mut browser);
    press(&mut browser, "closer");
    let near = wide(&mut browser);
    assert!(near < 0.8 * whole);
    press(&mut browser, "farther");
    assert_eq!(wide(&mut browser), whole);
    let [x, y] = browser.middle_of(".replay svg");
    let wheel = json!({ "type": "mouseWheel", "x": x, "y": y, "deltaX": 0, "deltaY": -400 });
    browser.call("Input.dispatchMouseEvent", wheel);
    wait(&mut browser, 200);
    assert!(wide(&mut browser) < 0.8 * whole);
    let before = browser.evaluate(VIEW);
    for (kind, x) in [("mousePressed", x), ("mouseMoved", x + 60.0), ("mouseReleased", x + 60.0)] {
        let event = json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1 });
        browser.call("Input.dispatchMouseEvent", event);
    }
    let after = browser.evaluate(VIEW);
    assert!(after[0].as_f64() < before[0].as_f64(), "{before} and {after}");
    assert_eq!(after[2], before[2]);
    press(&mut browser, "whole");
    assert_eq!(wide(&mut browser), whole);
    assert_no_problems(&browser);
}

#[test]
fn with_reduced_motion_a_replay_is_stepped_and_does_not_play() {
    let Some(mut browser) = Browser::start() else { return };
    let features = json!([{ "name": "prefers-reduced-motion", "value": "reduce" }]);
    browser.call("Emulation.setEmulatedMedia", json!({ "features": features }));
    browser.open(&demo().join("trials/kinematic-skewed-3.90-r1.html"));
    assert_eq!(
        browser.evaluate("document.querySelector(\".replay [data-do=play]\").disabled"),
        true
    );
    browser.evaluate("document.querySelector(\".replay\").focus()");
    browser.key(" ");
    wait(&mut browser, 400);
    assert_eq!(browser.evaluate(FRAME), 0);
    browser.key("ArrowRight");
    assert_eq!(browser.evaluate(FRAME), 1);
    assert_no_problems(&browser);
}

#[test]
fn without_scripts_a_replay_is_a_drawing_of_the_robot_along_its_trail() {
    let Some(mut browser) = Browser::start() else { return };
    browser.scripts(false);
    browser.open(&demo().join("trials/kinematic-skewed-3.90-r1.html"));
    let seen = browser.evaluate(
        "[...document.querySelectorAll(\".replay .robot use, .replay .trail\")] \
         .filter(element => element.checkVisibility() && element.getBoundingClientRect().width > 5).length",
    );
    assert!(seen.as_u64() >= Some(5), "{seen}");
    // A line width of two drawing units (0.1 mm) would be invisible.
    for marker in ["missing", "corrected"] {
        let style = format!("getComputedStyle(document.querySelector(\"#replay-{marker}\"))");
        assert_eq!(browser.evaluate(&format!("{style}.vectorEffect")), "non-scaling-stroke");
    }
    let controls =
        browser.evaluate("document.querySelector(\".replay .controls\").checkVisibility()");
    assert_eq!(controls, false);
    let said = browser.evaluate("document.querySelector(\".replay svg\").ariaLabel");
    assert!(said.as_str().unwrap().contains("the robot from above"), "{said}");
}

#[test]
fn the_page_of_a_simulated_motion_is_played_and_has_charts() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["simulate", "kinematic-skewed", "--model", "skid-roll", "--omega", "3.9"];
    succeed(folder.path(), &[&arguments[..], &["--page", "motion.html"]].concat());
    for (width, height) in SIZES {
        browser.window(width, height);
        browser.open(&folder.path().join("motion.html"));
        let wide = browser.evaluate("document.documentElement.scrollWidth");
        assert!(wide.as_u64() <= Some(width.into()), "{wide} px at {width}");
        browser.evaluate("document.querySelector(\".replay\").focus()");
        browser.key("End");
        assert_eq!(browser.evaluate(FRAME), browser.evaluate(LAST));
        assert_eq!(
            number(&mut browser, "document.querySelectorAll(\".panel .cursor\").length"),
            6.0
        );
        let now = browser.evaluate("document.querySelector(\".replay .now\").innerText");
        for text in ["Skid friction", "Roll friction", "Torque", "Work of the actuators"] {
            assert!(now.as_str().unwrap().contains(text), "{now}");
        }
    }
    assert_no_problems(&browser);
}
