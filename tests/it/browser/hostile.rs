//! Tests with names and messages that would act as markup or code on a page if they were not shown as text.

use trilink::compare::HistoryRow;
use trilink_robot::metrics::Metric;
use trilink_tables::TrialStatus;
use trilink_tables::{
    CheckRow, FitNotes, FitRow, Misfit, MisfitRun, NoInterval, NoIntervalReason, Provenance,
    Severity, Side, Table, TrialRow,
};

use super::*;
use crate::common::Small;

/// Returns hostile names, 64 of each kind: markup, quotes, control characters and writing-direction marks.
fn names() -> Vec<String> {
    const MARKUP: [&str; 8] = [
        "<img src=x onerror=alert(1)>",
        "</script><script>alert(1)</script>",
        "<svg onload=alert(1)>",
        "<b class=made>",
        "&lt;b class=made&gt;",
        "</title></style></textarea><i class=made>",
        "]]>--><iframe src=javascript:alert(1)>",
        "{{ 7 * 7 }}{% raw %}${alert(1)}",
    ];
    const QUOTES: [&str; 8] = [
        "\" onpointermove=\"alert(1)",
        "' onfocus='alert(1)' autofocus='",
        "`${alert(1)}`",
        "\"><b class=made>",
        "'><b class=made>",
        "\\\"+alert(1)+\\\"",
        "javascript:alert(1)//\"",
        "#\"' id=\"made",
    ];
    let numbered = |texts: [&'static str; 8]| {
        (0..64).map(move |nth| format!("{}{nth}", texts[nth % texts.len()]))
    };
    let control = (0..=0x1f).chain(0x7f..=0x9a).chain(0x202a..=0x202d);
    let control = control.filter_map(char::from_u32).map(|c| format!("one{c}two{c}"));
    let names: Vec<String> = numbered(MARKUP).chain(numbered(QUOTES)).chain(control).collect();
    assert_eq!(names.len(), 3 * 64);
    names
}

fn change<R: trilink_tables::Columns>(
    project: &Small,
    name: &str,
    change: impl FnOnce(&mut Vec<R>),
) {
    let path = project.place(&format!("{name}.parquet"));
    let mut rows = R::from_table(&Table::read(&path).unwrap()).unwrap();
    change(&mut rows);
    R::to_table(&rows).write(&path, &Provenance { input: "hostile".to_owned() }).unwrap();
}

/// JavaScript expression for what hostile names have injected into a page: elements, links that run scripts, and the
/// number of characters that affect a terminal or the writing direction.
const MADE: &str = r#"[
  [...document.querySelectorAll(".made, #made, img, iframe, script[src], [onerror], [onload], [onfocus], [onpointermove], [autofocus]")]
    .map(element => element.outerHTML.slice(0, 200)),
  [...document.querySelectorAll('a[href^="javascript:"]')].map(link => link.outerHTML),
  (document.body.textContent.match(/[\u0000-\u0008\u000b-\u001f\u007f-\u009f\u202a-\u202e]/g) || []).length,
]"#;

#[test]
fn hostile_names_are_shown_as_text_and_never_executed() {
    let Some(mut browser) = Browser::start() else { return };
    let (project, names) = (Small::done(), names());
    change::<TrialRow>(&project, "derived/trials", |rows| {
        let like = rows[0].clone();
        rows.extend(names.iter().enumerate().map(|(nth, name)| TrialRow {
            trial: name.clone(),
            // Drawing the figures of so many campaigns would dominate the duration of this test.
            campaign: names[nth / 16 * 16].clone(),
            status: TrialStatus::Flagged,
            message: name.clone(),
            ..like.clone()
        }));
    });
    change::<CheckRow>(&project, "derived/checks", |rows| {
        rows.extend(names.iter().map(|name| CheckRow {
            trial: name.clone(),
            check: name.clone(),
            severity: Severity::Warning,
            value: 1.0,
            limit: 0.0,
            message: name.clone(),
        }));
    });
    change::<FitRow>(&project, "derived/fits", |rows| {
        let like = rows[0].clone();
        rows.extend(names.iter().step_by(16).map(|name| FitRow {
            campaign: name.clone(),
            misfit: Misfit::off(vec![MisfitRun {
                side: Side::Above,
                metric: Metric::D,
                campaign: name.clone(),
                least: 0.1,
                most: 0.2,
                largest: -0.2,
                from_rad_s: 1.0,
                to_rad_s: 2.0,
            }]),
            notes: FitNotes { raw_skid_trials: vec![name.clone()], ..FitNotes::default() },
            no_interval: Some(NoInterval {
                reason: NoIntervalReason::UnknownNoise,
                of: vec![name.clone()],
            }),
            ..like.clone()
        }));
    });
    succeed(project.path(), &["report", "--quiet"]);
    browser.window(1400, 900);
    browser.open(&project.place("reports/index.html"));
    assert_eq!(browser.evaluate(MADE), json!([[], [], 0]));
    let shown = browser.evaluate(
        r##"[...document.querySelectorAll("table.trials tbody tr")].map(row => row.cells[0].textContent)"##,
    );
    let shown = shown.as_array().unwrap();
    for name in names.iter().filter(|name| !name.contains(char::is_control)) {
        let is_turned = name.contains(['\u{202a}', '\u{202b}', '\u{202c}', '\u{202d}']);
        assert!(is_turned || shown.contains(&name.as_str().into()), "{name} is not in the table");
    }
    use_everything(&mut browser);
    let pages = browser.evaluate(
        r##"[...document.querySelectorAll("table.trials a[href^='trials/']")]
          .map(link => decodeURIComponent(new URL(link.href).pathname))"##,
    );
    let pages = pages.as_array().unwrap();
    assert!(pages.len() > 64, "{} pages of trials", pages.len());
    for page in pages.iter().step_by(7) {
        browser.open(Path::new(page.as_str().unwrap()));
        assert_eq!(browser.evaluate(MADE), json!([[], [], 0]), "{page}");
    }
    assert_no_problems(&browser);
}

/// Operates every figure by pointer and keyboard, every legend, and everything that unfolds.
#[track_caller]
fn use_everything(browser: &mut Browser) {
    browser.evaluate(
        r#"(async () => {
          document.querySelectorAll("details").forEach(details => { details.open = true; });
          for (const panel of document.querySelectorAll(".panel[tabindex]")) {
            panel.focus();
            for (const key of ["ArrowRight", "ArrowDown", "ArrowLeft"])
              panel.dispatchEvent(new KeyboardEvent("keydown", { key }));
          }
          document.querySelectorAll(".key").forEach(key => key.dispatchEvent(new MouseEvent("click")));
          await new Promise(done => setTimeout(done, 200));
        })()"#,
    );
    assert_eq!(browser.evaluate(MADE), json!([[], [], 0]));
}

#[test]
fn hostile_names_are_text_on_the_pages_of_history_comparison_scorecard_and_motion() {
    let Some(mut browser) = Browser::start() else { return };
    let (project, names) = (Small::done(), names());
    change::<HistoryRow>(&project, "history", |rows| {
        let like = rows[0].clone();
        rows.extend(names.iter().enumerate().map(|(nth, name)| HistoryRow {
            campaign: if nth % 8 == 0 { name.clone() } else { String::new() },
            model: name.clone(),
            quantity: name.clone(),
            note: if nth % 2 == 0 { name.clone() } else { String::new() },
            ..like.clone()
        }));
    });
    project.run();
    for (folder, d_m) in [("old", 0.1), ("new", 0.2)] {
        for (path, bytes) in files(&project.place("derived")) {
            project.write(&format!("{folder}/{}", path.display()), bytes);
        }
        change::<TrialRow>(&project, &format!("{folder}/trials"), |rows| {
            let like = rows[0].clone();
            rows.extend(names.iter().enumerate().map(|(nth, name)| TrialRow {
                trial: name.clone(),
                campaign: names[nth / 16 * 16].clone(),
                metrics: trilink_robot::metrics::GaitMetrics { d_m, ..like.metrics },
                ..like.clone()
            }));
        });
    }
    let compared = trilink(project.path(), &["-q", "compare", "old", "--against", "new"]);
    assert_eq!(compared.status.code(), Some(1));
    let settings = crate::common::text(&project.read("pipeline.toml")).replace(
        "[campaign.kinematic-skewed]",
        "[campaign.'<img src=x onerror=alert(1)>\" id=\"made']",
    );
    project.write("motion.toml", settings);
    let motion = ["<img src=x onerror=alert(1)>\" id=\"made", "--model", "skid", "--omega", "5"];
    let to = ["--config", "motion.toml", "--page", "reports/motion.html"];
    succeed(project.path(), &[&["simulate"][..], &motion, &to].concat());

    browser.window(1400, 900);
    for (page, least) in [("history", 64), ("compare", 64), ("scorecard", 0), ("motion", 1)] {
        browser.open(&project.place(&format!("reports/{page}.html")));
        assert_eq!(browser.evaluate(MADE), json!([[], [], 0]), "{page}");
        use_everything(&mut browser);
        let shown =
            browser.evaluate("document.body.textContent.match(/alert\\(1\\)/g)?.length ?? 0");
        assert!(shown.as_u64() >= Some(least), "{page} has {shown} of the names");
    }
    assert_no_problems(&browser);
}
