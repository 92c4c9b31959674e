//! Names and messages that would act on a page if they were not shown as text.

use trilink::store::TrialStatus;
use trilink::store::{CheckRow, FitRow, Provenance, Severity, Table, TrialRow};

use super::common::Small;
use super::*;

/// 64 of each kind: markup, quotes, control characters and marks that turn the writing.
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

fn change<R: trilink::store::Columns>(
    project: &Small,
    name: &str,
    change: impl FnOnce(&mut Vec<R>),
) {
    let path = project.place(&format!("derived/{name}.parquet"));
    let mut rows = R::from_table(&Table::read(&path).unwrap()).unwrap();
    change(&mut rows);
    R::to_table(&rows).write(&path, &Provenance { input: "hostile".to_owned() }).unwrap();
}

/// Elements that only a name can have made, and characters that act on a terminal or the writing.
const MADE: &str = r#"[
  [...document.querySelectorAll(".made, #made, img, iframe, script[src], [onerror], [onload], [onfocus], [onpointermove], [autofocus]")]
    .map(element => element.outerHTML.slice(0, 200)),
  [...document.querySelectorAll('a[href^="javascript:"]')].map(link => link.outerHTML),
  (document.body.textContent.match(/[\u0000-\u0008\u000b-\u001f\u007f-\u009f\u202a-\u202e]/g) || []).length,
]"#;

#[test]
fn hostile_names_are_text_everywhere_and_nothing_of_them_is_run() {
    let Some(mut browser) = Browser::start() else { return };
    let (project, names) = (Small::done(), names());
    change::<TrialRow>(&project, "trials", |rows| {
        let like = rows[0].clone();
        rows.extend(names.iter().enumerate().map(|(nth, name)| TrialRow {
            trial: name.clone(),
            // Figures of so many campaigns would be all that this test does.
            campaign: names[nth / 16 * 16].clone(),
            status: TrialStatus::Flagged,
            message: name.clone(),
            ..like.clone()
        }));
    });
    change::<CheckRow>(&project, "checks", |rows| {
        rows.extend(names.iter().map(|name| CheckRow {
            trial: name.clone(),
            check: name.clone(),
            severity: Severity::Warning,
            value: 1.0,
            limit: 0.0,
            message: name.clone(),
        }));
    });
    change::<FitRow>(&project, "fits", |rows| {
        let like = rows[0].clone();
        rows.extend(names.iter().step_by(16).map(|name| FitRow {
            campaign: name.clone(),
            misfit: name.clone(),
            notes: name.clone(),
            no_interval: name.clone(),
            ..like.clone()
        }));
    });
    succeed(project.path(), &["report", "--quiet"]);
    browser.window(1400, 900);
    browser.open(&project.place("reports/index.html"));
    assert_eq!(browser.evaluate(MADE), json!([[], [], 0]));
    let shown = browser.evaluate(
        r##"[...document.querySelectorAll("#trials-table tbody tr")].map(row => row.cells[0].textContent)"##,
    );
    let shown = shown.as_array().unwrap();
    for name in names.iter().filter(|name| !name.contains(char::is_control)) {
        let is_turned = name.contains(['\u{202a}', '\u{202b}', '\u{202c}', '\u{202d}']);
        assert!(is_turned || shown.contains(&name.as_str().into()), "{name} is not in the table");
    }
    // Every figure under the pointer and by the keyboard, every legend, what unfolds.
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
    let pages = browser.evaluate(
        r##"[...document.querySelectorAll("#trials-table a[href^='trials/']")]
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
