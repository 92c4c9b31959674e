//! The page in a browser. Without one the test says so and passes; with
//! `TRILINK_BROWSER` it is the one that the variable names.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use super::{made_up, read, reported_in_short, temporary};

const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];

fn browser() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("TRILINK_BROWSER") {
        return Some(named.into());
    }
    let path = std::env::var_os("PATH")?;
    let mut places = std::env::split_paths(&path).flat_map(|folder| NAMES.map(|n| folder.join(n)));
    places.find(|place| place.is_file())
}

/// What the page's reader saw in a window of that size.
fn seen(browser: &Path, page: &Path, profile: &Path, size: &str) -> Value {
    let output = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"])
        .args(["--enable-logging=stderr", "--virtual-time-budget=20000"])
        .arg(format!("--window-size={size}"))
        .arg(format!("--user-data-dir={}", profile.display()))
        .arg(format!("file://{}", page.display()))
        .output()
        .expect("the browser runs");
    let said = String::from_utf8_lossy(&output.stderr);
    let errors: Vec<&str> = said.lines().filter(|line| line.contains(":CONSOLE")).collect();
    assert!(errors.is_empty(), "the console says: {errors:?}");
    let dom = String::from_utf8_lossy(&output.stdout);
    let start = dom.find("<pre id=\"seen\">").unwrap_or_else(|| panic!("no page: {said}"));
    let json = &dom[start + "<pre id=\"seen\">".len()..];
    let json = &json[..json.find("</pre>").expect("an end")];
    let json = json.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    serde_json::from_str(&json).expect("JSON")
}

#[test]
fn the_page_works_in_a_browser_without_a_network() {
    let Some(browser) = browser() else {
        eprintln!("skipped: no browser among {NAMES:?}; TRILINK_BROWSER can name one");
        return;
    };
    let folder = temporary();
    let raw = folder.path().join("raw");
    std::fs::create_dir_all(&raw).expect("a folder");
    std::fs::write(raw.join("truth.json"), made_up::truth()).expect("writes");
    let hostile = "<img src=x onerror=alert(1)>";
    let mut tables = made_up::with_trouble(made_up::Tables::of_the_paper(), hostile);
    tables.trials[0].trial = hostile.to_owned();
    let reported = reported_in_short(&tables, folder.path());
    let script = include_str!("browser.js");
    let page = folder.path().join("reports/under-test.html");
    let html = read(&reported.page);
    let html = html.replacen("<head>", &format!("<head><script>{script}</script>"), 1);
    std::fs::write(&page, html).expect("writes");

    for (size, screens_px) in [("1400,900", 900.0), ("400,800", 1600.0)] {
        let seen = seen(&browser, &page, &folder.path().join("profile"), size);
        assert_eq!(seen["problems"], serde_json::json!([]), "{size}");
        assert_eq!(seen["requests"], serde_json::json!([]), "{size}");
        assert_eq!(seen["lost"], serde_json::json!([]), "{size}");
        assert_eq!(seen["overflow"], 0, "{size}: the page is wider than its window");
        for what in ["focused", "rising", "falling"] {
            assert_eq!(seen[what], true, "{size}: {what}");
        }
        assert_eq!(seen["before"], false, "sorting has something to do");
        let sheets = seen["sheets"].as_u64().expect("a number");
        assert!(sheets > 20, "{sheets} figures");
        assert_eq!((&seen["drawn"], &seen["described"]), (&seen["sheets"], &seen["sheets"]));
        // Every campaign's coefficients are seen without scrolling, in a narrow window on two
        // screens.
        assert!(seen["coefficients"].as_u64().expect("a number") >= 6, "{}", seen["coefficients"]);
        let answered = seen["answered"].as_f64().expect("a number");
        assert!(answered < screens_px, "{size}: the last coefficient stands at {answered} px");
        for text in [&seen["told"], &seen["pointed"]["text"]] {
            let text = text.as_str().expect("a text");
            assert!(
                text.starts_with("measured, ") && text.contains("Displacement d (mm) "),
                "{text}"
            );
        }
        assert_eq!(seen["pointed"]["opens"], true);
        assert_eq!((&seen["left"], &seen["legend"]), (&true.into(), &true.into()));
        assert_eq!(seen["family"], "Roboto, sans-serif");
        assert_eq!(seen["all"], tables.trials.len());
        assert_eq!(seen["cleared"], seen["all"]);
        assert_eq!(seen["filtered"], serde_json::json!(["kinematic-skewed-3.90-r1"]));
        assert_eq!(seen["nothing"], serde_json::json!([]));
        assert_eq!(seen["hostile"], serde_json::json!([hostile]));
    }
}
