//! One run against another: noise is no news, a worn wheel is.

#![allow(clippy::unwrap_used)]

mod common;

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use common::{small_settings, succeed, text, trilink};
use serde_json::Value;
use tempfile::TempDir;
use trilink::compare::HistoryRow;
use trilink::store::{Columns as _, Table};

/// A laboratory's night: synthetic trials of one truth that were run.
fn night(arguments: &[&str]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("pipeline.toml"),
        toml::to_string(&small_settings()).unwrap(),
    )
    .unwrap();
    let synth = ["synth", "raw/demo", "--omega", "1,2,3,3.9,5", "--seed", "1", "--quiet"];
    let synth: Vec<&str> = synth.iter().chain(arguments).copied().collect();
    succeed(folder.path(), &synth);
    succeed(folder.path(), &["run", "--quiet"]);
    folder
}

/// The night that others are compared with, and its baseline; no test changes it.
fn baseline() -> &'static (TempDir, PathBuf) {
    static BASELINE: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    BASELINE.get_or_init(|| {
        let folder = night(&[]);
        let file = folder.path().join("baseline.json");
        succeed(folder.path(), &["compare", "--save", file.to_str().unwrap(), "--quiet"]);
        (folder, file)
    })
}

/// Compares a night with the baseline: exit status, what was printed, `compare.json`.
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
    assert!(said.contains("0 out of tolerance, 0 differ within it, 0 differ and"), "{said}");
    // A folder of tables is a baseline, too.
    let other = baseline().0.path().join("derived");
    let said = succeed(folder.path(), &["compare", other.to_str().unwrap()]);
    assert!(said.contains("0 out of tolerance, 0 differ within it"), "{said}");
    let baseline = baseline().1.to_str().unwrap();
    let said = succeed(folder.path(), &["compare", baseline, "--against", other.to_str().unwrap()]);
    assert!(said.contains("0 out of tolerance, 0 differ within it"), "{said}");
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
        assert!(said.contains(&format!("skid{wheel}_kg_s: ")), "{said}");
        let page = std::fs::read_to_string(folder.path().join("reports/compare.html")).unwrap();
        assert!(page.contains("Out of tolerance:") && page.contains("data:image/svg+xml;base64,"));
        assert!(page.contains("Model skid-roll of kinematic-symmetric"));
        let xml = std::fs::read_to_string(folder.path().join("reports/compare.xml")).unwrap();
        assert!(
            xml.contains("<testsuite name=\"fits\"") && xml.contains("<failure message=\"skid")
        );
    }
}

#[test]
fn a_tolerance_can_be_another_and_the_next_baseline_keeps_why_it_was_accepted() {
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
    assert!(text(&wrong.stderr).contains("table `trails`: needed one of `trials`"));
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
    assert!(said.contains("vanished: trials: kinematic-symmetric-5.00-r1"), "{said}");
    let none = trilink(folder.path(), &["compare", "nowhere.json"]);
    assert_eq!(none.status.code(), Some(2));
    assert!(text(&none.stderr).contains("is not there; `trilink compare --save FILE` makes one"));
    assert_eq!(trilink(folder.path(), &["compare"]).status.code(), Some(2));
}

#[test]
fn every_run_that_changed_something_is_in_the_history() {
    let folder = night(&[]);
    let rows = || {
        let table = Table::read(&folder.path().join("reports/history.parquet")).unwrap();
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
    assert_eq!(rows(), first, "the same run adds nothing");
    succeed(folder.path(), &["synth", "raw/demo", "--omega", "1,2,3", "--seed", "1", "--quiet"]);
    succeed(folder.path(), &["run", "--quiet"]);
    let second = rows();
    assert_eq!(second[..first.len()], first);
    assert!(second.iter().any(|row| row.run == 2));
    let page = std::fs::read_to_string(folder.path().join("reports/history.html")).unwrap();
    assert!(page.contains("2 runs, ") && page.contains("skid-roll: skid0_kg_s"));
}
