//! Tests of comparisons between runs: noise is within tolerance, a worn wheel is not.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde_json::Value;
use tempfile::TempDir;
use trilink::compare::HistoryRow;
use trilink_tables::config::GaitInput;
use trilink_tables::{Columns as _, Table};

use crate::common::{Small, small_settings, succeed, temporary, text, trilink};

/// Synthesises trials with additional `arguments`, runs all stages on them, and returns the folder.
fn night(arguments: &[&str]) -> TempDir {
    let folder = recorded(arguments);
    succeed(folder.path(), &["run", "--quiet"]);
    folder
}

/// Synthesises trials with additional `arguments` in a folder with a configuration.
pub fn recorded(arguments: &[&str]) -> TempDir {
    let folder = temporary();
    let mut config = small_settings();
    // Because the servos lag, models driven by the commanded gait are inadequate.
    config.fit.gait_input = GaitInput::Measured;
    let text = toml::to_string(&config).unwrap();
    std::fs::write(folder.path().join("pipeline.toml"), text).unwrap();
    let synth = ["synth", "raw/demo", "--omega", "1,2,3,3.9,5", "--seed", "1", "--quiet"];
    let synth: Vec<&str> = synth.iter().chain(arguments).copied().collect();
    succeed(folder.path(), &synth);
    folder
}

/// Returns the reference run and its baseline, which no test changes.
pub fn baseline() -> &'static (TempDir, PathBuf) {
    static BASELINE: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    BASELINE.get_or_init(|| {
        let folder = night(&[]);
        let file = folder.path().join("baseline.json");
        succeed(folder.path(), &["compare", "--save", file.to_str().unwrap(), "--quiet"]);
        (folder, file)
    })
}

/// Compares a run with the baseline that the tests share; `more` are additional arguments. Returns the exit status, the
/// output and `compare.json` (null if missing).
fn compared(folder: &Path, more: &[&str]) -> (Option<i32>, String, Value) {
    let arguments = ["compare", baseline().1.to_str().unwrap()];
    let arguments: Vec<&str> = arguments.iter().chain(more).copied().collect();
    let output = trilink(folder, &arguments);
    let json = std::fs::read_to_string(folder.join("reports/compare.json"));
    let json = json.map_or(Value::Null, |json| serde_json::from_str(&json).unwrap());
    (output.status.code(), text(&output.stdout) + &text(&output.stderr), json)
}

fn out_of_tolerance(json: &Value) -> Vec<String> {
    let all = json["differences"].as_array().unwrap().iter();
    let out = all.filter(|difference| difference["verdict"] == "out");
    out.map(|d| format!("{} {} {}", d["table"], d["of"], d["column"]).replace('"', "")).collect()
}

#[test]
fn the_same_trials_do_not_differ() {
    let folder = night(&[]);
    let (status, said, json) = compared(folder.path(), &[]);
    assert_eq!(status, Some(0), "{said}");
    assert_eq!(json["differences"].as_array().unwrap().len(), 0, "{said}");
    assert!(json["cells"].as_u64().unwrap() > 300, "{said}");
    assert!(said.contains("0 out of tolerance, 0 differ within tolerance, 0 differ and"), "{said}");
    // A folder of tables can also be the baseline.
    let other = baseline().0.path().join("derived");
    let said = succeed(folder.path(), &["compare", other.to_str().unwrap()]);
    assert!(said.contains("0 out of tolerance, 0 differ within tolerance"), "{said}");
    let baseline = baseline().1.to_str().unwrap();
    let said = succeed(folder.path(), &["compare", baseline, "--against", other.to_str().unwrap()]);
    assert!(said.contains("0 out of tolerance, 0 differ within tolerance"), "{said}");
    let nowhere = trilink(folder.path(), &["compare", baseline, "--against", "nowhere"]);
    assert_eq!(nowhere.status.code(), Some(2));
}

#[test]
fn other_noise_is_within_tolerance() {
    for seed in ["2", "3", "4"] {
        let folder = night(&["--noise-seed", seed]);
        let (status, said, json) = compared(folder.path(), &[]);
        assert_eq!(status, Some(0), "{said}");
        let within = json["differences"].as_array().unwrap().iter();
        assert!(within.filter(|difference| difference["verdict"] == "within").count() > 100);
    }
}

#[test]
fn a_skid_coefficient_that_changed_by_five_per_cent_is_found_and_named() {
    for (wheel, factors) in [(0, "1.05,1,1"), (1, "1,0.95,1"), (2, "1,1,1.05")] {
        let noise = format!("{}", 5 + wheel);
        let folder = night(&["--noise-seed", &noise, "--skid-factors", factors]);
        let (status, said, json) = compared(folder.path(), &[]);
        assert_eq!(status, Some(1), "{said}");
        let out = out_of_tolerance(&json);
        let named = format!("fits kinematic-symmetric skid-roll skid{wheel}_kg_s");
        assert!(out.contains(&named), "{out:?}");
        let others = [0, 1, 2].into_iter().filter(|other| *other != wheel);
        for other in others {
            let innocent = format!("fits kinematic-symmetric skid-roll skid{other}_kg_s");
            assert!(!out.contains(&innocent), "{out:?}");
        }
        let link = ["middle", "front", "rear"][wheel];
        let change = ["+5.", "\u{2212}5.", "+5."][wheel];
        let named = format!("skid of the {link} wheel (wheel {wheel}) {change}");
        assert!(said.starts_with(&named), "{said}");
        let page = std::fs::read_to_string(folder.path().join("reports/compare.html")).unwrap();
        assert!(page.contains("values out of tolerance") && page.contains("<svg class=\"panel\""));
        assert!(page.contains("Model skid-roll of kinematic-symmetric"));
        let xml = std::fs::read_to_string(folder.path().join("reports/compare.xml")).unwrap();
        assert!(
            xml.contains("<testsuite name=\"fits\"") && xml.contains("<failure message=\"skid")
        );
    }
}

#[test]
fn tolerances_can_be_overridden_and_a_new_baseline_records_the_reason() {
    let folder = night(&["--noise-seed", "9", "--skid-factors", "1.05,1,1"]);
    let own = folder.path().join("own.json");
    std::fs::copy(&baseline().1, &own).unwrap();
    let own = own.to_str().unwrap();
    let anything = ["trials", "campaigns", "fits", "predictions"]
        .map(|table| format!("{table}.\"*\" = {{ relative = 1e9, absolute = 1e9 }}"));
    let loose = "trials.d_m = {}\ncampaigns.d_m = {}";
    let fewer = trilink(folder.path(), &["compare", own, "--tolerance", loose]);
    assert_eq!(fewer.status.code(), Some(1));
    assert!(!text(&fewer.stdout).contains("trials  kinematic-symmetric-3.90-r1  d_m"));
    let wrong = trilink(folder.path(), &["compare", own, "--tolerance", "trails.d_m = {}"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(text(&wrong.stderr).contains("found table `trails`, needed one of `trials`"));
    let wrong = trilink(folder.path(), &["compare", own, "--tolerance", &anything[0][..20]]);
    assert_eq!(wrong.status.code(), Some(2));

    succeed(folder.path(), &["compare", own, "--accept", "new tyres on the middle link"]);
    let accepted = succeed(folder.path(), &["compare", own]);
    assert!(accepted.contains(" 0 out of tolerance"), "{accepted}");
    let page = std::fs::read_to_string(folder.path().join("reports/compare.html")).unwrap();
    assert!(page.contains("new tyres on the middle link"));
    let history = std::fs::read_to_string(folder.path().join("reports/history.html")).unwrap();
    assert!(history.contains("new tyres on the middle link"));
    let folder_baseline = baseline().0.path().join("derived");
    let refused =
        trilink(folder.path(), &["compare", folder_baseline.to_str().unwrap(), "--accept", "x"]);
    assert_eq!(refused.status.code(), Some(2));
}

#[test]
fn trials_that_vanish_are_named_and_missing_baselines_are_errors() {
    let folder = night(&[]);
    let list = folder.path().join("raw/demo/trials.toml");
    let text_of = std::fs::read_to_string(&list).unwrap();
    let fewer: Vec<&str> =
        text_of.split("[[trial]]").filter(|trial| !trial.contains("5.00-r1")).collect();
    std::fs::write(&list, format!("ignore = [\"*\"]\n{}", fewer.join("[[trial]]"))).unwrap();
    succeed(folder.path(), &["run", "--quiet"]);
    let (status, said, _) = compared(folder.path(), &[]);
    assert_eq!(status, Some(1));
    assert!(said.contains("vanished from trials: kinematic-symmetric-5.00-r1"), "{said}");
    let page = folder.path().join("reports/compare.html");
    succeed(folder.path(), &["run", "--quiet"]);
    assert!(page.is_file(), "unchanged results stay compared");
    std::fs::write(&list, text_of).unwrap();
    succeed(folder.path(), &["run", "--quiet"]);
    assert!(!page.exists(), "this page compares results that no longer exist");
    let none = trilink(folder.path(), &["compare", "nowhere.json"]);
    assert_eq!(none.status.code(), Some(2));
    assert!(
        text(&none.stderr).contains("does not exist; `trilink compare --accept WHY` creates it")
    );
    assert_eq!(trilink(folder.path(), &["compare"]).status.code(), Some(2));
}

#[test]
fn every_run_that_changed_something_is_in_the_history() {
    let folder = night(&[]);
    let rows = || {
        let table = Table::read(&folder.path().join("history.parquet")).unwrap();
        HistoryRow::from_table(&table).unwrap()
    };
    let first = rows();
    assert!(first.iter().all(|row| row.run == 1));
    let value = |rows: &[HistoryRow], run: i64, quantity: &str, model: &str| {
        let found = rows
            .iter()
            .find(|row| row.run == run && row.quantity == quantity && row.model == model);
        found.unwrap().value
    };
    assert!((value(&first, 1, "mean d_m", "") - 0.46).abs() < 0.03);
    assert!(value(&first, 1, "j", "skid-roll") < value(&first, 1, "j", "no-skid"));
    succeed(folder.path(), &["run", "--quiet"]);
    // NaN is not equal to itself.
    let text_of = |rows: &[HistoryRow]| format!("{rows:?}");
    assert_eq!(text_of(&rows()), text_of(&first), "the same run adds nothing");
    std::fs::remove_dir_all(folder.path().join("raw/demo")).unwrap();
    succeed(folder.path(), &["synth", "raw/demo", "--omega", "1,2,3", "--seed", "1", "--quiet"]);
    succeed(folder.path(), &["run", "--quiet"]);
    let second = rows();
    assert_eq!(text_of(&second[..first.len()]), text_of(&first));
    assert!(second.iter().any(|row| row.run == 2));
    let page = std::fs::read_to_string(folder.path().join("reports/history.html")).unwrap();
    assert!(page.contains("2 runs, ") && page.contains("skid-roll: skid of the middle wheel"));
    assert!(page.contains("2 trials removed: kinematic-symmetric-3.90-r1, "), "{page}");
    assert!(second.iter().all(|row| row.program.len() == 64 && row.configuration.len() == 64));
    let of = |quantity: &str| {
        second.iter().find(|row| row.run == 2 && row.quantity == quantity).unwrap()
    };
    let mean = of("mean d_m");
    assert!(mean.lower < mean.value && mean.value < mean.upper);
    assert!(mean.value_se > 0.0 && of("skid0_kg_s").value_se > 0.0);
    // Conditions compare timestamps by their text.
    let look = |condition: &str| {
        let arguments = ["inspect", "history.parquet", "--csv", "--columns", "time,run"];
        let more = ["--head", "1", "--sort", "time", "--where", condition];
        succeed(folder.path(), &[&arguments[..], &more].concat())
    };
    let time = &*first[0].time;
    assert!(time.len() == 20 && time.ends_with('Z'), "{time}");
    assert_eq!(look("time > '2026'"), format!("time,run\n{time},1\n"));
    assert_eq!(look("time < '2026'"), "time,run\n");
}

#[test]
fn the_first_screen_says_what_changed_since_the_baseline_that_was_accepted() {
    let folder = Small::done();
    let first_screen = || {
        let page = text(&folder.read("reports/index.html"));
        let (_, from) = page.split_once("<main>").unwrap();
        let (changes, _) = from.split_once("<div class=\"answers\">").unwrap();
        changes.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let before = first_screen();
    assert!(before.contains("No baseline has been accepted yet"), "{before}");
    assert_eq!(trilink(folder.path(), &["compare"]).status.code(), Some(2));
    // The first baseline needs no earlier baseline.
    succeed(folder.path(), &["compare", "--accept", "the robot <as it is>"]);
    let ahead = succeed(folder.path(), &["run", "--dry-run", "--explain"]);
    assert!(ahead.contains("baseline.json"), "{ahead}");
    folder.run();
    let accepted = first_screen();
    let rows = history(&folder);
    let date = &rows.last().unwrap().time[..10];
    for said in [
        &format!("accepted on {date} (“the robot &lt;as it is&gt;”)"),
        "nothing out of tolerance",
        " 0 changed within tolerance",
    ] {
        assert!(accepted.contains(said), "{said}: {accepted}");
    }
    assert!(folder.run().contains("page: ") && first_screen() == accepted);
    let page = Path::new("reports/index.html");
    assert!(folder.results()[page] == folder.scratch()[page], "from scratch it is another page");

    // Other trials: more noise than tolerated, one added, one removed.
    let synth = ["synth", "raw", "--omega", "5,6,7", "--seed", "1", "--skid-factors", "1.5,1,1"];
    std::fs::remove_dir_all(folder.place("raw")).unwrap();
    succeed(folder.path(), &synth);
    let list = text(&folder.read("raw/trials.toml"));
    let (gone, came) = ("id = \"kinematic-skewed-5.00-r1\"", "id = \"kinematic-skewed-again\"");
    folder.write("raw/trials.toml", list.replace(gone, came));
    assert!(trilink(folder.path(), &["run"]).status.code() < Some(2));
    let changed = first_screen();
    let compared = trilink(folder.path(), &["compare", "--json"]);
    assert_eq!(compared.status.code(), Some(1));
    let json: Value = serde_json::from_slice(&compared.stdout).unwrap();
    let out: Vec<&Value> = json["differences"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|difference| difference["verdict"] == "out" && difference["table"] != "scorecard")
        .collect();
    assert!(out.len() > 3, "{json}");
    assert!(changed.contains(&format!("{} out of tolerance", out.len())), "{changed}");
    let causes = json["causes"].as_array().unwrap();
    assert!(causes.len() > 3, "{json}");
    for (nth, cause) in causes.iter().enumerate() {
        let sentence = escaped(cause["sentence"].as_str().unwrap());
        assert_eq!(changed.contains(&sentence), nth < 3, "{sentence}: {changed}");
    }
    assert!(changed.contains("more are listed by "), "{changed}");
    assert!(changed.contains("New: trials: kinematic-s"), "{changed}");

    folder.write("baseline.json", "{}");
    trilink(folder.path(), &["run"]);
    let broken = first_screen();
    assert!(broken.contains("baseline.json is not a baseline: missing field"), "{broken}");
}

/// Returns a text as it stands in a page.
pub fn escaped(text: &str) -> String {
    let characters = [('&', "&amp;"), ('<', "&lt;"), ('>', "&gt;"), ('"', "&quot;")];
    let more = [('\'', "&#x27;"), ('/', "&#x2f;")];
    let all = characters.iter().chain(&more);
    all.fold(text.to_owned(), |text, (character, entity)| text.replace(*character, entity))
}

/// Compares a folder with its own baseline; returns the exit status, and standard output followed by standard error.
fn own(folder: &Small, more: &[&str]) -> (Option<i32>, String) {
    let arguments: Vec<&str> = ["compare", "baseline.json"].iter().chain(more).copied().collect();
    let output = trilink(folder.path(), &arguments);
    (output.status.code(), text(&output.stdout) + &text(&output.stderr))
}

/// Creates a project with a completed run and its baseline.
fn with_baseline() -> Small {
    let folder = Small::done();
    succeed(folder.path(), &["compare", "--save", "baseline.json", "--quiet"]);
    folder
}

fn history(folder: &Small) -> Vec<HistoryRow> {
    HistoryRow::from_table(&Table::read(&folder.place("history.parquet")).unwrap()).unwrap()
}

#[test]
fn untrustworthy_tables_are_not_compared() {
    let folder = with_baseline();
    let refused = |arguments: &[&str], said: &str| {
        let (status, found) = own(&folder, arguments);
        assert_eq!(status, Some(2), "{said}: {found}");
        assert!(found.contains(said), "{said}: {found}");
        assert!(!found.contains("out of tolerance"), "{said}: {found}");
        assert!(!folder.place("reports/compare.json").exists(), "{said}");
        let saved = trilink(folder.path(), &["compare", "--save", "other.json"]);
        assert!(!arguments.is_empty() || saved.status.code() == Some(2), "{said}");
    };
    let well = || {
        succeed(folder.path(), &["run", "--quiet"]);
        assert_eq!(own(&folder, &["--max-age", "1h"]).0, Some(0));
        std::fs::remove_file(folder.place("reports/compare.json")).unwrap();
    };
    well();

    succeed(folder.path(), &["fit", "--quiet"]);
    refused(&[], "is older than the tables");
    well();
    let trials = folder.read("derived/trials.parquet");
    folder.write("derived/trials.parquet", &trials[..trials.len() - 1]);
    refused(&[], "trials.parquet has changed since it was written");
    well();
    std::fs::remove_file(folder.place("reports/run.json")).unwrap();
    refused(&[], "run.json: does not exist");
    well();

    // The history lists failed and killed runs.
    let list = folder.read("raw/trials.toml");
    std::fs::remove_file(folder.place("raw/trials.toml")).unwrap();
    assert_eq!(trilink(folder.path(), &["run", "--quiet"]).status.code(), Some(2));
    refused(&[], ": failed: raw: this trial folder has no trials.toml; ");
    folder.write("raw/trials.toml", list);
    well();
    folder.replace("reports/run.json", "\"status\": \"ok\"", "\"status\": \"running\"");
    refused(&[], "was killed before it ended; `trilink run` completes and updates the results");
    well();
    let rows = history(&folder);
    let failures: Vec<_> = rows.iter().filter(|row| row.quantity.is_empty()).collect();
    let status: Vec<_> = failures.iter().map(|row| row.status.unwrap().name()).collect();
    assert_eq!(status, ["failed", "interrupted"]);
    assert!(failures[0].note.contains("trials.toml") && failures[1].note == "killed");
    assert_eq!(rows.iter().filter(|row| row.quantity == "mean d_m").count(), 2, "one run");
    let page = text(&folder.read("reports/history.html"));
    assert!(page.contains("status failed\">interrupted<") && page.contains("killed"));

    // Runs that find everything up to date renew the age of the tables.
    let record =
        std::fs::File::options().append(true).open(folder.place("derived/up-to-date.json"));
    let hours = std::time::Duration::from_secs(30 * 3600);
    record.unwrap().set_modified(std::time::SystemTime::now() - hours).unwrap();
    refused(
        &["--max-age", "20h"],
        "the tables were last confirmed to be up to date 30.0 h ago; --max-age allows 20 h",
    );
    assert_eq!(own(&folder, &["--max-age", "2d"]).0, Some(0));
    std::fs::remove_file(folder.place("reports/compare.json")).unwrap();
    assert!(folder.run().contains("trials: "));
    well();
    assert_eq!(own(&folder, &["--max-age", "20"]).0, Some(2));
}

#[test]
fn a_comparison_and_a_run_exclude_each_other() {
    let folder = with_baseline();
    let lock = std::fs::File::open(folder.place("derived/.lock")).unwrap();
    lock.lock().unwrap();
    let files = || (folder.read("baseline.json"), folder.read("history.parquet"));
    let before = files();
    for more in [&[][..], &["--accept", "why"], &["--save", "other.json"]] {
        let (status, said) = own(&folder, more);
        assert_eq!(status, Some(2), "{said}");
        assert!(said.contains("derived/.lock: held by ") && said.contains("--wait"), "{said}");
    }
    assert!(!folder.place("other.json").exists() && files() == before);
    // Another folder of tables is locked, too.
    let elsewhere = with_baseline();
    let derived = folder.place("derived");
    let against = ["compare", "baseline.json", "--against", derived.to_str().unwrap()];
    assert_eq!(trilink(elsewhere.path(), &against).status.code(), Some(2));
    drop(lock);
    assert_eq!(trilink(elsewhere.path(), &against).status.code(), Some(0));
}

#[test]
fn reasons_that_are_given_at_the_same_time_are_all_kept() {
    let folder = with_baseline();
    folder.write(".writing-killed", "half a baseline");
    let reasons: Vec<String> = (0..8).map(|i| format!("reason {i}")).collect();
    std::thread::scope(|scope| {
        for reason in &reasons {
            let folder = &folder;
            scope
                .spawn(move || assert_eq!(own(folder, &["--accept", reason, "--wait"]).0, Some(0)));
        }
    });
    let baseline: Value = serde_json::from_slice(&folder.read("baseline.json")).unwrap();
    let reasons_of = |rows: Vec<HistoryRow>| {
        let rows = rows.into_iter().filter(|row| row.quantity == "accepted");
        let mut reasons: Vec<String> = rows.map(|row| row.note).collect();
        reasons.sort();
        reasons
    };
    assert_eq!(baseline["accepted"].as_array().unwrap().len(), 8);
    assert_eq!(reasons_of(history(&folder)), reasons);
    assert!(!folder.place(".writing-killed").exists());

    // If a comparison is killed between writing the file and the history, the next one completes the history.
    let rows = history(&folder);
    let fewer = &rows[..rows.len() - 1];
    let provenance = trilink_tables::Provenance { input: "runs".to_owned() };
    let path = folder.place("history.parquet");
    HistoryRow::to_table(fewer).write(&path, &provenance).unwrap();
    assert_eq!(own(&folder, &[]).0, Some(0));
    assert_eq!(reasons_of(history(&folder)), reasons);
    assert_eq!(own(&folder, &["--accept", ""]).0, Some(2));
}

#[test]
fn the_history_is_drawn_again_and_a_damaged_one_is_moved_aside() {
    let folder = with_baseline();
    let page = folder.read("reports/history.html");
    for command in [&["run"][..], &["compare", "baseline.json"]] {
        std::fs::remove_file(folder.place("reports/history.html")).unwrap();
        succeed(folder.path(), command);
        assert_eq!(folder.read("reports/history.html"), page);
        let old = std::time::SystemTime::now() - std::time::Duration::from_secs(1000);
        let html = folder.place("reports/history.html");
        std::fs::write(&html, "older than the history").unwrap();
        std::fs::File::options().append(true).open(html).unwrap().set_modified(old).unwrap();
        succeed(folder.path(), command);
        assert_eq!(folder.read("reports/history.html"), page);
    }
    succeed(folder.path(), &["run", "--dry-run"]);
    for (i, command) in [&["run"][..], &["compare", "baseline.json"]].into_iter().enumerate() {
        let mut damaged = folder.read("history.parquet");
        let last = damaged.len() - 5;
        damaged[last] ^= 0xff;
        folder.write("history.parquet", &damaged);
        std::fs::remove_file(folder.place("reports/history.html")).unwrap();
        let said = trilink(folder.path(), command);
        assert_eq!(said.status.code(), Some(1), "{command:?}: {}", text(&said.stderr));
        let aside = format!("history.damaged-{}.parquet", i + 1);
        assert!(text(&said.stderr).contains(&aside), "{}", text(&said.stderr));
        assert_eq!(folder.read(&aside), damaged);
        assert!(history(&folder).iter().all(|row| row.run == 1));
        succeed(folder.path(), command);
    }
}

#[test]
fn a_history_of_an_earlier_version_is_moved_out_of_the_reports() {
    let folder = with_baseline();
    let before = folder.read("history.parquet");
    let [old, new] = ["reports/history.parquet", "history.parquet"].map(|name| folder.place(name));
    std::fs::rename(&new, &old).unwrap();
    succeed(folder.path(), &["run"]);
    assert!(!old.exists() && folder.read("history.parquet") == before);
    // Neither of two histories is touched.
    std::fs::copy(&new, &old).unwrap();
    let output = trilink(folder.path(), &["run", "--force"]);
    assert_eq!(output.status.code(), Some(1));
    let said = text(&output.stderr);
    assert!(said.contains("reports/history.parquet: an earlier history, not continued"), "{said}");
    assert!(old.exists());
    std::fs::remove_file(&old).unwrap();
    // The configuration may name another place.
    let config = folder.read("pipeline.toml");
    let config = String::from_utf8(config).unwrap();
    let config = config.replacen("[paths]\n", "[paths]\nhistory = 'kept/runs.parquet'\n", 1);
    folder.write("pipeline.toml", config.as_bytes());
    succeed(folder.path(), &["run"]);
    assert!(folder.place("kept/runs.parquet").exists());
}
