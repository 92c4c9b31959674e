//! Tests of several trial folders: the results are the same whether they are processed one after the other or together,
//! results are removed only on request, and the name of a trial depends on no other folder.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use trilink_tables::{CheckRow, Columns as _, Table, TrialRow, TrialStatus};

use crate::common::{Small, assert_same, succeed, text, trilink, was_up_to_date};

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
    assert!(checked.ends_with(", 0 failed\n") && checked.contains("5 trials: "), "{checked}");
    let checked = succeed(folder.path(), &["check", "raw/first"]);
    assert!(checked.ends_with(", 0 failed\n") && checked.contains("2 trials: "), "{checked}");
    // Run one folder; the results of the others are retained.
    assert!(was_up_to_date(&trilink(folder.path(), &["run", "raw/first"])));
}

#[test]
fn a_trial_is_retained_until_it_leaves_its_list_or_other_folders_are_removed() {
    let folder = nights(false);
    results(&folder, &[&["run"]]);
    let list = text(&folder.read("raw/second/trials.toml"));
    let entry = list.split("[[trial]]").find(|entry| entry.contains(SKEWED)).unwrap().to_owned();
    folder.replace("raw/second/trials.toml", &format!("[[trial]]{entry}"), "");
    let removed = said(folder.path(), &["run", "raw/first"], 0);
    let expected = format!("no longer in the list of trials: second_{SKEWED}\n");
    assert!(removed.contains(&expected), "{removed}");
    assert_eq!(rows(&folder).len(), 4);

    // Without a record, the names of the folders are read from the tables.
    fs::remove_file(folder.place("derived/up-to-date.json")).unwrap();
    succeed(folder.path(), &["run", "raw/first"]);
    assert_eq!(rows(&folder).len(), 4);
    let expected_nights = nights(false);
    expected_nights.replace("raw/second/trials.toml", &format!("[[trial]]{entry}"), "");
    let expected_bytes = results(&expected_nights, &[&["run"]]);
    assert_same(&folder.results(), &expected_bytes, "without a record");

    // A missing folder may be on a disk that is not mounted.
    fs::rename(folder.place("raw/second"), folder.place("elsewhere")).unwrap();
    let expected = "folder raw/second: this folder is gone, and its 2 trials are no longer in the tables: restore it, \
                    or remove it from the configuration and run once with --only\n";
    for command in [&["run", "raw/first"][..], &["run"]] {
        let gone = said(folder.path(), command, 1);
        assert!(gone.contains(expected), "{gone}");
        assert_eq!(rows(&folder).len(), 2);
    }
    let page = text(&folder.read("reports/index.html"));
    assert!(page.contains("E007 folder-gone"));
    fs::rename(folder.place("elsewhere"), folder.place("raw/second")).unwrap();
    assert!(!said(folder.path(), &["run", "raw/first"], 0).contains("gone"));
    assert_same(&folder.results(), &expected_bytes, "a folder that returned");
    fs::rename(folder.place("raw"), folder.place("moved")).unwrap();
    let before = folder.results();
    let gone = said(folder.path(), &["run"], 2);
    assert!(
        gone.contains("raw/first: this trial folder, with its trials.toml, does not exist"),
        "{gone}"
    );
    assert_same(&folder.results(), &before, "all folders are gone");
    fs::rename(folder.place("moved"), folder.place("raw")).unwrap();

    fs::rename(folder.place("raw/second"), folder.place("elsewhere")).unwrap();
    let ahead = succeed(folder.path(), &["run", "raw/first", "--only", "--dry-run"]);
    assert!(ahead.contains(&format!("remove trial second_{OTHER_SKEWED}\n")), "{ahead}");
    let removed = said(folder.path(), &["run", "raw/first", "--only"], 0);
    let expected =
        "list of trials: second_kinematic-coast-down-r1, second_kinematic-skewed-6.00-r1\n";
    assert!(removed.contains(expected), "{removed}");
    let first = nights(false);
    succeed(first.path(), &["run", "raw/first"]);
    assert_same(&folder.results(), &first.results(), "--only");
}

#[test]
fn an_ignored_recording_is_left_out_although_its_entry_stays() {
    let folder = nights(false);
    folder.write(&format!("raw/second/{SKEWED}.csv"), "beyond help");
    let failed = said(folder.path(), &["run"], 1);
    assert!(failed.contains(&format!("failed: second_{SKEWED}")), "{failed}");
    let ignore = format!("ignore = [\"*\", \"{SKEWED}.csv\"]");
    folder.replace("raw/second/trials.toml", "ignore = [\"*\"]", &ignore);
    let line =
        format!("trials left out because `ignore` in trials.toml matches their files: {SKEWED}\n");
    let run = said(folder.path(), &["run"], 0);
    assert_eq!(run.matches(&line).count(), 1, "{run}");
    let ignored = rows(&folder).into_iter().find(|row| row.id == SKEWED).unwrap();
    assert_eq!(
        (ignored.status, &*ignored.trial),
        (TrialStatus::Ignored, &*format!("second_{SKEWED}"))
    );
    assert!(
        ignored.metrics.d_m.is_nan()
            && ignored.message.starts_with("`ignore` in trials.toml matches")
    );
    assert!(said(folder.path(), &["check"], 0).contains(&line));
    let ingested = trilink(folder.path(), &["ingest"]);
    let counts = text(&ingested.stdout);
    assert!(counts.contains("0 failed, 1 ignored;"), "{counts}");
    let checked = succeed(folder.path(), &["config", "check"]);
    assert!(
        checked.contains(&line)
            && checked.contains("\n4 trials in ")
            && checked.ends_with(", all readable\n")
    );
    // The other results are those without the entry.
    let other = nights(false);
    let list = text(&other.read("raw/second/trials.toml"));
    let entry = list.split("[[trial]]").find(|entry| entry.contains(SKEWED)).unwrap();
    other.replace("raw/second/trials.toml", &format!("[[trial]]{entry}"), "");
    said(other.path(), &["run"], 0);
    let without = rows(&other);
    let used: Vec<_> = rows(&folder).into_iter().filter(|row| row.id != SKEWED).collect();
    assert_eq!(format!("{used:?}"), format!("{without:?}"));
    let predictions = |folder: &Small| {
        let table = Table::read(&folder.place("derived/predictions.parquet")).unwrap();
        table.values::<f64>("d_m").unwrap()
    };
    assert_eq!(predictions(&folder), predictions(&other), "models are fitted to the other trials");
    // The explanation of the check mentions this advice.
    let advice = succeed(folder.path(), &["explain", "E001"]).replace("\n   ", "");
    assert!(
        advice.contains("`ignore` in `trials.toml`") && advice.contains("`[[trial]]`"),
        "{advice}"
    );
}

#[test]
fn names_of_trials_begin_with_their_folders_in_every_table_and_page() {
    let names = ["first", "second"].map(|front| format!("{front}_{SKEWED}"));
    let together = nights(true);
    said(together.path(), &["run"], 0);
    for row in rows(&together) {
        let front = row.folder.strip_prefix("raw/").unwrap();
        assert_eq!(row.trial, format!("{front}_{}", row.id));
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
    assert!(was_up_to_date(&trilink(apart.path(), &["run", "raw/second"])));
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
    let output = trilink(here.path(), &["-c", from_here.to_str().unwrap(), "run"]);
    assert!(output.status.code() == Some(1) && was_up_to_date(&output));
    let told = text(&output.stderr);
    assert!(told.contains(&format!("second_{SKEWED}: raw/second/{SKEWED}.csv: ")), "{told}");
    said(here.path(), &["-c", from_here.to_str().unwrap(), "run", "--force"], 1);
    assert_same(&copy.results(), &before, "elsewhere");
}

/// Creates the folder of a night with two trials of the skewed campaign, whose ids and entries are the same every
/// night.
fn add_night(folder: &Small, source: &Small, night: usize) {
    let list = text(&source.read("raw/trials.toml"));
    let entries = list.split("[[trial]]").filter(|entry| entry.contains("kinematic-skewed"));
    let entries: Vec<String> = entries.map(|entry| format!("[[trial]]{entry}")).collect();
    let home = format!("raw/2024-05-{night:02}");
    folder.write(&format!("{home}/trials.toml"), entries.concat());
    for id in [SKEWED, OTHER_SKEWED] {
        // Empty lines at the end make the recordings of the nights distinct.
        let recording = text(&source.read(&format!("raw/{id}.csv"))) + &"\n".repeat(night);
        folder.write(&format!("{home}/{id}.csv"), recording);
    }
}

fn move_folder(folder: &Small, from: &str, to: &str) {
    fs::rename(folder.place(from), folder.place(to)).unwrap();
}

#[test]
fn ids_stay_and_a_line_tells_what_happened_when_folders_are_added_copied_moved_or_renamed() {
    let source = Small::raw();
    let folder = Small::raw();
    fs::remove_dir_all(folder.place("raw")).unwrap();
    folder.replace("pipeline.toml", "starts = 2\nbootstrap = 3", "starts = 1\nbootstrap = 0");
    folder.replace("pipeline.toml", "raw = \"raw\"", "raw = \"raw/*\"");
    add_night(&folder, &source, 1);
    said(folder.path(), &["run"], 0);
    let first: Vec<String> = rows(&folder).into_iter().map(|row| row.trial).collect();
    assert_eq!(first, [SKEWED, OTHER_SKEWED].map(|id| format!("2024-05-01_{id}")));
    succeed(folder.path(), &["compare", "--accept", "first night"]);
    for night in 2..=10 {
        add_night(&folder, &source, night);
    }
    said(folder.path(), &["run"], 0);
    let names: Vec<String> = rows(&folder).into_iter().map(|row| row.trial).collect();
    assert_eq!((names.len(), &names[..2]), (20, &first[..]));
    let page = |folder: &Small| text(&folder.read("reports/compare.json"));
    let compared = trilink(folder.path(), &["compare"]);
    assert!(page(&folder).contains("\"vanished\": []"), "{}", text(&compared.stdout));
    succeed(folder.path(), &["compare", "--accept", "ten nights"]);

    // Of a copied folder, only the copies fail.
    fs::create_dir(folder.place("raw/2024-05-03-copy")).unwrap();
    for name in ["trials.toml".to_owned(), format!("{SKEWED}.csv"), format!("{OTHER_SKEWED}.csv")] {
        let copy = folder.read(&format!("raw/2024-05-03/{name}"));
        folder.write(&format!("raw/2024-05-03-copy/{name}"), copy);
    }
    let copied = said(folder.path(), &["run"], 1);
    let reason =
        "copy of the trial with this id in folder raw/2024-05-03: remove one of the two folders";
    assert!(copied.contains(reason), "{copied}");
    for row in rows(&folder) {
        assert_eq!(
            row.status == TrialStatus::Failed,
            row.folder == "raw/2024-05-03-copy",
            "{row:?}"
        );
    }
    succeed(folder.path(), &["compare"]);
    fs::remove_dir_all(folder.place("raw/2024-05-03-copy")).unwrap();
    said(folder.path(), &["run", "--only"], 0);

    // A folder that is gone is reported until it returns.
    move_folder(&folder, "raw/2024-05-04", "elsewhere");
    for _ in 0..2 {
        let gone = said(folder.path(), &["run"], 1);
        let line = "folder raw/2024-05-04: this folder is gone, and its 2 trials are no longer in the tables";
        assert_eq!(gone.matches(line).count(), 1, "{gone}");
    }
    move_folder(&folder, "elsewhere", "raw/2024-05-04");
    said(folder.path(), &["run"], 0);
    succeed(folder.path(), &["compare"]);

    // The baseline stays valid for a renamed folder.
    move_folder(&folder, "raw/2024-05-05", "raw/2024-05-05-repeated");
    let renamed = said(folder.path(), &["run"], 0);
    let line = "folder raw/2024-05-05 is now called raw/2024-05-05-repeated: it has the same 2 marker files\n";
    assert!(renamed.contains(line), "{renamed}");
    let compared = said(folder.path(), &["compare"], 0);
    let line = "folder raw/2024-05-05 of the baseline is now called raw/2024-05-05-repeated\n";
    assert!(compared.contains(line), "{compared}");

    // From a pattern to the only folder, names change, but the baseline stays valid.
    let single = Small::raw();
    fs::remove_dir_all(single.place("raw")).unwrap();
    single.replace("pipeline.toml", "starts = 2\nbootstrap = 3", "starts = 1\nbootstrap = 0");
    single.replace("pipeline.toml", "raw = \"raw\"", "raw = \"raw/2024-05-01\"");
    add_night(&single, &source, 1);
    said(single.path(), &["run"], 0);
    assert_eq!(rows(&single)[0].trial, SKEWED);
    succeed(single.path(), &["compare", "--accept", "one folder"]);
    single.replace(
        "pipeline.toml",
        "raw = \"raw/2024-05-01\"",
        "raw = [\"raw/2024-05-01\", \"raw/2024-05-02\"]",
    );
    add_night(&single, &source, 2);
    said(single.path(), &["run"], 0);
    let compared = trilink(single.path(), &["compare"]);
    assert!(page(&single).contains("\"vanished\": []"), "{}", text(&compared.stdout));
}

/// Replaces a marker's label in the header of all marker files of a folder.
fn relabel(folder: &Small, home: &str, label: &str, other: &str) {
    for entry in fs::read_dir(folder.place(home)).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "csv") {
            let name = path.file_name().unwrap().to_str().unwrap();
            let found = text(&folder.read(&format!("{home}/{name}")));
            assert!(found.contains(label), "{name}");
            folder.write(&format!("{home}/{name}"), found.replacen(label, other, 1));
        }
    }
}

#[test]
fn a_days_renamed_or_missing_markers_are_one_line_and_aliases_replace_labels_by_folder() {
    let folder = nights(false);
    said(folder.path(), &["run"], 0);
    let measured = rows(&folder);
    relabel(&folder, "raw/first", "F1", "Front-left");
    let failed = said(folder.path(), &["run"], 1);
    let line = "failed: raw/first: all 2 trials: the file has no marker `F1`, which markers.link1 of pipeline.toml \
                requires; `Front-left` is not in the layout: if it is this marker, rename it or add `aliases = { \
                Front-left = \"F1\" }` to trials.toml; ";
    assert_eq!(failed.matches(line).count(), 1, "{failed}");
    assert_eq!(
        failed.matches("`Front-left` is not in the layout").count(),
        2,
        "also E004: {failed}"
    );
    let page = text(&folder.read("reports/index.html"));
    assert!(page.contains("<strong>raw&#x2f;first: all 2 trials</strong>: the file has no marker"));

    let list = text(&folder.read("raw/first/trials.toml"));
    folder.write("raw/first/trials.toml", format!("aliases = {{ Front-left = \"F1\" }}\n{list}"));
    said(folder.path(), &["run"], 0);
    assert_eq!(format!("{:?}", rows(&folder)), format!("{measured:?}"), "with aliases");
    said(folder.path(), &["check"], 0);

    // The middle link has four markers, of which three suffice.
    relabel(&folder, "raw/second", "M4", "Lost");
    let flagged = said(folder.path(), &["run"], 1);
    let line = "flagged: raw/second: all 3 trials: the file has no marker `M4` of link 0; `Lost` is not in the layout";
    assert!(flagged.contains(line), "{flagged}");
    for (row, before) in rows(&folder).iter().zip(&measured) {
        let is_flagged = row.status == TrialStatus::Flagged;
        assert_eq!(is_flagged, row.folder == "raw/second" || before.status == TrialStatus::Flagged);
        let error = (row.metrics.d_m / before.metrics.d_m - 1.0).abs();
        assert!(row.metrics.d_m.is_nan() || error < 0.005, "{row:?}");
    }
    let checks = Table::read(&folder.place("derived/checks.parquet")).unwrap();
    let checks = CheckRow::from_table(&checks).unwrap();
    assert_eq!(checks.iter().filter(|check| check.check == "W030 missing-markers").count(), 3);
}
