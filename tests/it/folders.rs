//! Tests of several trial folders: the results are the same whether they are processed one after the other or together,
//! results are removed only on request, and trials with the same id are distinguished.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use trilink_tables::{CheckRow, Columns as _, Table, TrialRow};

use crate::common::{Small, assert_same, succeed, text, trilink};

const SKEWED: &str = "kinematic-skewed-5.00-r1";
const OTHER_SKEWED: &str = "kinematic-skewed-6.00-r1";
const SYMMETRIC: &str = "kinematic-symmetric-5.00-r1";

/// Creates two trial folders: the first with the symmetric campaign, the second with the skewed campaign and the
/// coast-down. If `shared` is true, both contain a trial of the skewed campaign with the same id.
fn nights(shared: bool) -> Small {
    let folder = Small::raw();
    let whole = text(&folder.read("raw/trials.toml"));
    let mut entries = whole.split("[[trial]]");
    let head = entries.next().unwrap().to_owned();
    let is_first = |entry: &&str| entry.contains("kinematic-symmetric");
    let (mut first, mut second): (Vec<&str>, Vec<&str>) = entries.partition(is_first);
    if shared {
        first.extend(second.iter().filter(|entry| entry.contains(SKEWED)));
        second.retain(|entry| !entry.contains(OTHER_SKEWED));
    }
    for (night, entries) in [("raw/first", &first), ("raw/second", &second)] {
        let list: Vec<String> = entries.iter().map(|entry| format!("[[trial]]{entry}")).collect();
        folder.write(&format!("{night}/trials.toml"), head.clone() + &list.concat());
        for entry in fs::read_dir(folder.place("raw")).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap();
            if list.concat().contains(name) || name == "truth.json" {
                fs::copy(&path, folder.place(&format!("{night}/{name}"))).unwrap();
            }
        }
    }
    if shared {
        // The same recording twice would be a mistake, so the first folder has another one.
        let other = folder.read(&format!("raw/{OTHER_SKEWED}.csv"));
        folder.write(&format!("raw/first/{SKEWED}.csv"), other);
        let list = text(&folder.read("raw/first/trials.toml"));
        let at = list.rfind("omega_rad_s = 5").unwrap();
        let list = format!("{}omega_rad_s = 6{}", &list[..at], &list[at + 15..]);
        folder.write("raw/first/trials.toml", list);
    }
    for entry in fs::read_dir(folder.place("raw")).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() {
            fs::remove_file(path).unwrap();
        }
    }
    folder.replace("pipeline.toml", "starts = 2\nbootstrap = 3", "starts = 1\nbootstrap = 0");
    folder.replace("pipeline.toml", "raw = \"raw\"", "raw = [\"raw/first\", \"raw/second\"]");
    folder
}

fn results(folder: &Small, commands: &[&[&str]]) -> BTreeMap<PathBuf, Vec<u8>> {
    for command in commands {
        succeed(folder.path(), command);
    }
    folder.results()
}

fn rows(folder: &Small) -> Vec<TrialRow> {
    let table = Table::read(&folder.place("derived/trials.parquet")).unwrap();
    TrialRow::from_table(&table).unwrap()
}

fn said(folder: &Path, arguments: &[&str], status: i32) -> String {
    let output = trilink(folder, arguments);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{arguments:?}: {said}");
    said
}

#[test]
fn folders_run_together_or_one_after_the_other_leave_the_same_bytes() {
    let configured = results(&nights(false), &[&["run"]]);
    for commands in [
        &[&["run", "raw/second/"][..], &["run", "./raw/first"]][..],
        &[&["run", "raw/second", "raw/first", "raw/*"]],
        &[&["ingest", "raw/second"], &["ingest", "raw/first"], &["fit"], &["report"]],
    ] {
        assert_same(&results(&nights(false), commands), &configured, &format!("{commands:?}"));
    }
    let folder = nights(false);
    folder.replace("pipeline.toml", "[\"raw/first\", \"raw/second\"]", "\"raw/*\"");
    assert_same(&results(&folder, &[&["run"]]), &configured, "a pattern");
    let checked = succeed(folder.path(), &["check"]);
    assert!(checked.ends_with("5 trials, of which 0 cannot be ingested\n"), "{checked}");
    let checked = succeed(folder.path(), &["check", "raw/first"]);
    assert!(checked.ends_with("2 trials, of which 0 cannot be ingested\n"), "{checked}");
    // Run one folder; the results of the others are retained.
    assert_eq!(said(folder.path(), &["run", "raw/first"], 0), "everything was up to date\n");
}

#[test]
fn a_trial_is_retained_until_it_leaves_its_list_or_other_folders_are_removed() {
    let folder = nights(false);
    results(&folder, &[&["run"]]);
    let list = text(&folder.read("raw/second/trials.toml"));
    let entry = list.split("[[trial]]").find(|entry| entry.contains(SKEWED)).unwrap().to_owned();
    folder.replace("raw/second/trials.toml", &format!("[[trial]]{entry}"), "");
    let removed = said(folder.path(), &["run", "raw/first"], 0);
    assert!(removed.contains(&format!("no longer in the list of trials: {SKEWED}\n")), "{removed}");
    assert_eq!(rows(&folder).len(), 4);

    // Without a record, the names of the folders are read from the tables.
    fs::remove_file(folder.place("derived/up-to-date.json")).unwrap();
    succeed(folder.path(), &["run", "raw/first"]);
    assert_eq!(rows(&folder).len(), 4);
    let expected = nights(false);
    expected.replace("raw/second/trials.toml", &format!("[[trial]]{entry}"), "");
    assert_same(&folder.results(), &results(&expected, &[&["run"]]), "without a record");

    // A missing folder may be on a disk that is not mounted.
    fs::rename(folder.place("raw/second"), folder.place("elsewhere")).unwrap();
    let before = folder.results();
    let gone = said(folder.path(), &["run", "raw/first"], 2);
    let expected = "raw/second: this trial folder has no trials.toml, but derived still contains tables of its trials";
    assert!(gone.contains(expected) && gone.contains("--only"), "{gone}");
    assert_same(&folder.results(), &before, "a folder that is gone");
    let ahead = succeed(folder.path(), &["run", "raw/first", "--only", "--dry-run"]);
    assert!(ahead.contains(&format!("remove trial {OTHER_SKEWED}\n")), "{ahead}");
    let removed = said(folder.path(), &["run", "raw/first", "--only"], 0);
    assert!(
        removed.contains("list of trials: kinematic-coast-down-r1, kinematic-skewed-6.00-r1\n")
    );
    let first = nights(false);
    succeed(first.path(), &["run", "raw/first"]);
    assert_same(&folder.results(), &first.results(), "--only");
}

#[test]
fn an_ignored_recording_is_left_out_although_its_entry_stays() {
    let folder = nights(false);
    folder.write(&format!("raw/second/{SKEWED}.csv"), "beyond help");
    let failed = said(folder.path(), &["run"], 1);
    assert!(failed.contains(&format!("failed: {SKEWED}")), "{failed}");
    let ignore = format!("ignore = [\"*\", \"{SKEWED}.csv\"]");
    folder.replace("raw/second/trials.toml", "ignore = [\"*\"]", &ignore);
    let line =
        format!("trials left out because `ignore` in trials.toml matches their files: {SKEWED}\n");
    let run = said(folder.path(), &["run"], 0);
    assert_eq!(run.matches(&line).count(), 1, "{run}");
    assert!(rows(&folder).iter().all(|row| row.trial != SKEWED));
    assert!(said(folder.path(), &["check"], 0).contains(&line));
    let checked = succeed(folder.path(), &["config", "check"]);
    assert!(
        checked.contains(&line)
            && checked.contains("\n4 trials in ")
            && checked.ends_with(", all readable\n")
    );
    // Ignoring a trial has the same effect as removing its entry from the list.
    let other = nights(false);
    let list = text(&other.read("raw/second/trials.toml"));
    let entry = list.split("[[trial]]").find(|entry| entry.contains(SKEWED)).unwrap();
    other.replace("raw/second/trials.toml", &format!("[[trial]]{entry}"), "");
    assert_same(&folder.results(), &results(&other, &[&["run"]]), "without the entry");
    // The explanation of the check mentions this advice.
    let advice = succeed(folder.path(), &["explain", "E001"]).replace("\n   ", "");
    assert!(
        advice.contains("`ignore` in `trials.toml`") && advice.contains("`[[trial]]`"),
        "{advice}"
    );
}

#[test]
fn trials_of_one_id_are_kept_apart_by_their_folders_names_in_every_table_and_page() {
    let names = ["first", "second"].map(|front| format!("{front}_{SKEWED}"));
    let together = nights(true);
    let told = said(together.path(), &["run"], 0);
    let expected = format!(
        "several folders contain a trial `{SKEWED}`: the names of these 2 trials are prefixed with the names of their \
         folders, such as `{}` in raw/first\n",
        names[0]
    );
    assert!(told.contains(&expected), "{told}");
    for row in rows(&together) {
        let front = row.folder.strip_prefix("raw/").unwrap();
        match row.id == SKEWED {
            true => assert_eq!(row.trial, format!("{front}_{SKEWED}")),
            false => assert_eq!(row.trial, row.id),
        }
        assert_eq!(row.id.contains("symmetric"), front == "first" && row.id != SKEWED);
    }
    let page = text(&together.read("reports/index.html"));
    for name in &names {
        for kind in ["poses", "wheels", "cycles"] {
            let table = Table::read(&together.place(&format!("derived/{kind}/{name}.parquet")));
            assert_eq!(&table.unwrap().values::<String>("trial").unwrap()[0], name);
        }
        let own = text(&together.read(&format!("reports/trials/{name}.html")));
        assert!(own.contains(name) && page.contains(&format!("trials/{name}.html")), "{name}");
    }
    assert!(page.contains("raw&#x2f;first</code>, <code>..&#x2f;raw&#x2f;second"), "both folders");
    assert!(!together.place(&format!("derived/poses/{SKEWED}.parquet")).exists());

    // In any order of the runs, trials have the same names as in a run of all folders together.
    let expected = together.results();
    let apart = nights(true);
    results(&apart, &[&["run", "raw/second"], &["run", "raw/first"]]);
    assert_same(&apart.results(), &expected, "one after the other");
    assert_eq!(said(apart.path(), &["run", "raw/second"], 0), "everything was up to date\n");
    let twice = nights(true);
    for name in ["trials.toml", "truth.json"]
        .map(str::to_owned)
        .into_iter()
        .chain([format!("{SKEWED}.csv")])
    {
        fs::create_dir_all(twice.place("raw/again/first")).unwrap();
        fs::copy(
            twice.place(&format!("raw/first/{name}")),
            twice.place(&format!("raw/again/first/{name}")),
        )
        .unwrap();
    }
    let failed = said(twice.path(), &["run", "raw/first", "raw/again/first"], 1);
    for [front, other] in [["raw-first", "again-first"], ["again-first", "raw-first"]] {
        let reason =
            format!("failed: {front}_{SKEWED}: trial `{other}_{SKEWED}` has the same marker file");
        assert!(failed.contains(&reason), "{failed}");
    }
    let calibrated = trilink(together.path(), &["ingest", "--calibrate", SKEWED]);
    let expected = format!(
        "raw/first, raw/second: trial `{SKEWED}` is not in the trials.toml of any of these folders"
    );
    assert!(text(&calibrated.stderr).contains(&expected), "{}", text(&calibrated.stderr));
    let unlisted = format!("raw/first/{SYMMETRIC}-again.csv");
    together.write(&unlisted, together.read(&format!("raw/first/{SYMMETRIC}.csv")));
    together.replace("raw/first/trials.toml", "ignore = [\"*\"]", "");
    said(together.path(), &["run"], 1);
    let checks = Table::read(&together.place("derived/checks.parquet")).unwrap();
    let checks = CheckRow::from_table(&checks).unwrap();
    assert!(checks.iter().any(|check| check.trial == "folder raw/first"));
}

#[test]
fn a_project_elsewhere_is_up_to_date_also_where_trials_failed() {
    let folder = nights(false);
    folder.write(&format!("raw/second/{SKEWED}.csv"), "");
    said(folder.path(), &["run"], 1);
    let before = folder.results();
    let copy = folder.copy();
    let from_here = copy.place("pipeline.toml");
    let here = tempfile::tempdir().unwrap();
    let told = said(here.path(), &["-c", from_here.to_str().unwrap(), "run"], 1);
    assert!(told.contains("everything was up to date"), "{told}");
    assert!(told.contains(&format!("{SKEWED}: raw/second/{SKEWED}.csv: ")), "{told}");
    said(here.path(), &["-c", from_here.to_str().unwrap(), "run", "--force"], 1);
    assert_same(&copy.results(), &before, "elsewhere");
}
