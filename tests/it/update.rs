//! Tests of incremental runs: exactly what has changed is recomputed, with the same bytes as in a run from scratch.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use crate::common::{Small, assert_same, files, succeed, text, trilink, was_up_to_date};
use serde_json::Value;

const SYMMETRIC: &str = "kinematic-symmetric-5.00-r1";
const SYMMETRIC_FILE: &str = "raw/kinematic-symmetric-5.00-r1.csv";
const SKEWED_FITS: [&str; 1] = ["kinematic-skewed skid"];
const SYMMETRIC_FITS: [&str; 2] = ["kinematic-symmetric no-skid", "kinematic-symmetric skid-roll"];
const COAST: &str = "kinematic-coast-down-r1";
/// Number of trials in the project.
const TRIALS: usize = 5;
const FITS: usize = 3;

/// Returns the names of the targets that the last run recomputed, one list per stage.
fn redone(folder: &Small) -> [Vec<String>; 3] {
    let record: Value = serde_json::from_slice(&folder.read("reports/run.json")).unwrap();
    std::array::from_fn(|stage| {
        let names = record["stages"][stage]["redone"].as_array().unwrap();
        names.iter().map(|name| name.as_str().unwrap().to_owned()).collect()
    })
}

/// Returns the modification times and inode numbers of all files and folders, which change when they are written.
fn stamps(folder: &Path) -> BTreeMap<PathBuf, (SystemTime, u64)> {
    #[cfg(unix)]
    use std::os::unix::fs::MetadataExt as _;
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(path) = open.pop() {
        let metadata = fs::metadata(&path).unwrap();
        if metadata.is_dir() {
            open.extend(fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
        }
        #[cfg(unix)]
        let number = metadata.ino();
        #[cfg(not(unix))]
        let number = 0;
        // The modification time of the record is the time of the last check.
        if !path.ends_with("up-to-date.json") {
            found.insert(path, (metadata.modified().unwrap(), number));
        }
    }
    found
}

fn lines(text: &str) -> Vec<&str> {
    text.lines().collect()
}

/// Changes the last digit of a number in a marker file.
fn change_marker_file(folder: &Small, name: &str) {
    let content = text(&folder.read(name));
    let row = content.lines().nth(40).unwrap();
    let (rest, last) = row.rsplit_once('.').unwrap();
    let digit = if last.trim_end().ends_with('1') { '2' } else { '1' };
    let changed = format!("{rest}.{}{digit}", &last.trim_end()[..last.trim_end().len() - 1]);
    folder.write(name, content.replacen(row, &changed, 1));
}

#[test]
fn an_unchanged_run_writes_nothing_and_prints_the_same() {
    let folder = Small::raw();
    folder.run();
    let before = stamps(folder.path());
    let output = trilink(folder.path(), &["run"]);
    assert_eq!(output.status.code(), Some(0));
    let said = text(&output.stdout);
    assert!(was_up_to_date(&output) && output.stderr.is_empty(), "{said}");
    for part in [" trials: ", "kinematic-symmetric: ", "page: reports"] {
        assert!(said.contains(part), "{said}");
    }
    assert!(was_up_to_date(&trilink(folder.path(), &["run", "--verify"])));
    assert_eq!(succeed(folder.path(), &["run", "--dry-run", "--explain"]), "");
    assert!(stamps(folder.path()) == before, "something was written");
}

#[test]
fn a_changed_marker_file_redoes_its_trial_its_campaign_s_fits_and_their_figures() {
    let folder = Small::done();
    let before = folder.results();
    change_marker_file(&folder, SYMMETRIC_FILE);
    let ahead = succeed(folder.path(), &["run", "--dry-run", "--explain"]);
    assert_eq!(lines(&ahead)[0], format!("trial {SYMMETRIC}: the marker file changed"));
    let fits: Vec<&str> = lines(&ahead).into_iter().filter(|line| line.contains(" fit ")).collect();
    assert_eq!(
        fits,
        SYMMETRIC_FITS.map(|fit| format!("perhaps fit {fit}: if trial {SYMMETRIC} changes"))
    );
    // No figure of the other campaign is among them.
    assert!(ahead.contains("perhaps 12 figures, if the displayed data change\n"), "{ahead}");
    let page = format!("trials/{SYMMETRIC}.html");
    assert!(ahead.contains(&format!("perhaps page {page}: if its trial changes\n")), "{ahead}");
    assert!(!ahead.contains("skewed"), "{ahead}");
    assert_same(&folder.results(), &before, "--dry-run");
    let output = trilink(folder.path(), &["run", "--explain"]);
    let why = text(&output.stderr);
    for fit in SYMMETRIC_FITS {
        assert!(why.contains(&format!("fit {fit}: trial {SYMMETRIC} changed\n")), "{why}");
    }
    let [trials, fits, figures] = redone(&folder);
    assert_eq!(trials, [SYMMETRIC]);
    assert_eq!(fits, SYMMETRIC_FITS);
    assert!(figures.contains(&"fig17".to_owned()), "{figures:?}");
    // Trial pages also show the predictions of the campaign's models.
    let mut pages = figures.iter().filter(|name| name.starts_with("trials/"));
    assert!(
        figures.contains(&page) && pages.all(|page| page.starts_with("trials/kinematic-symmetric"))
    );
    // These figures show only the other campaign.
    for other in ["fig10", "fig16", "kinematic-skewed-starts", "kinematic-skewed-replicates"] {
        assert!(!figures.contains(&other.to_owned()), "{figures:?}");
    }
    assert_same(&folder.results(), &folder.scratch(), "a changed marker file");
}

#[test]
fn a_changed_key_makes_the_targets_that_read_it_stale() {
    let everything = [&SKEWED_FITS[..], &SYMMETRIC_FITS].concat();
    let with_search = ["kinematic-skewed skid", "kinematic-symmetric skid-roll"];
    let skewed = "models = [\"skid\"]\nweights = { d = 10.0";
    let bounds = "[fit]\nskid_bounds_kg_s = [2.0, 900.0]";
    let free = "alpha = 0.0 }\n[campaign.kinematic-symmetric.free]\nskid-roll = [\"skid1\"]\n";
    let window = format!("id = \"{SYMMETRIC}\"\nsmoothing_window = 9");
    let gap = "[ingest]\nmax_gap_s = 0.05\n[fit]";
    let models = "models = [\"no-skid\", \"skid\", \"skid-roll\"]";
    let free_by_default = "[model.skid-roll]\nfree = [\"skid1\"]\n[fit]";
    let input = "[model.no-skid]\ninput = \"measured\"\n[fit]";
    let unused = "[model.other]\nskid = \"viscous\"\nroll = \"none\"\nfree = []\n[fit]";
    let cases: [(&str, &str, &str, usize, &[&str]); 12] = [
        ("pipeline.toml", "starts = 2", "starts = 3", 0, &with_search),
        ("pipeline.toml", "bootstrap = 3", "bootstrap = 4", 0, &everything),
        ("pipeline.toml", skewed, &skewed.replace("10.0", "9.0"), 0, &SKEWED_FITS),
        ("pipeline.toml", "[fit]", bounds, 0, &with_search),
        ("pipeline.toml", "alpha = 0.0 }\n", free, 0, &SYMMETRIC_FITS[1..]),
        (
            "pipeline.toml",
            "models = [\"no-skid\", \"skid-roll\"]",
            models,
            0,
            &["kinematic-symmetric skid"],
        ),
        ("pipeline.toml", "[fit]", "[fit]\nroll_bounds_kg_s = [0.02, 5.0]", 0, &[]),
        ("pipeline.toml", "[fit]", free_by_default, 0, &SYMMETRIC_FITS[1..]),
        ("pipeline.toml", "[fit]", input, 0, &SYMMETRIC_FITS[..1]),
        ("pipeline.toml", "[fit]", unused, 0, &[]),
        ("pipeline.toml", "[fit]", gap, TRIALS, &[]),
        ("raw/trials.toml", &format!("id = \"{SYMMETRIC}\""), &window, 1, &[]),
    ];
    for (file, old, new, trials, fits) in cases {
        let folder = Small::done();
        folder.replace(file, old, new);
        folder.run();
        let [found_trials, found_fits, _] = redone(&folder);
        assert_eq!(found_trials.len(), trials, "{new}");
        // A trial may have the same results although it was ingested with other settings.
        if trials == 0 {
            assert_eq!(found_fits, fits, "{new}");
        }
        assert_same(&folder.results(), &folder.scratch(), new);
    }
}

#[test]
fn removed_added_or_moved_trials_give_the_results_of_a_run_from_scratch() {
    let entry = |folder: &Small, id: &str| {
        let list = text(&folder.read("raw/trials.toml"));
        let entries: Vec<&str> = list.split("[[trial]]").collect();
        let place = entries.iter().position(|entry| entry.contains(id)).unwrap();
        format!("[[trial]]{}", entries[place])
    };
    let removed = Small::done();
    removed.write("derived/poses/mine.parquet", "not of this program");
    let gone = entry(&removed, SYMMETRIC);
    removed.replace("raw/trials.toml", &gone, "");
    let ahead = succeed(removed.path(), &["run", "--dry-run"]);
    assert_eq!(lines(&ahead)[0], format!("remove trial {SYMMETRIC}"));
    removed.run();
    let [trials, fits, _] = redone(&removed);
    assert_eq!((trials.len(), &fits[..]), (0, &SYMMETRIC_FITS.map(str::to_owned)[..]));
    for kind in ["poses", "wheels", "cycles"] {
        assert!(!removed.place(&format!("derived/{kind}/{SYMMETRIC}.parquet")).exists());
    }
    assert_eq!(removed.read("derived/poses/mine.parquet"), b"not of this program");
    fs::remove_file(removed.place("derived/poses/mine.parquet")).unwrap();
    assert_same(&removed.results(), &removed.scratch(), "removed");

    // Undo the change.
    let list = text(&removed.read("raw/trials.toml"));
    removed.write("raw/trials.toml", list + "\n" + &gone);
    removed.run();
    assert_eq!(redone(&removed)[0], [SYMMETRIC]);
    assert_same(&removed.results(), &removed.scratch(), "added");

    let moved = Small::done();
    let first = entry(&moved, SYMMETRIC);
    moved.replace("raw/trials.toml", &first, "");
    let list = text(&moved.read("raw/trials.toml"));
    moved.write("raw/trials.toml", list + "\n" + &first);
    moved.run();
    assert_eq!(redone(&moved).map(|names| names.len())[..2], [0, 0]);
    assert_same(&moved.results(), &moved.scratch(), "moved");
}

#[test]
fn removing_a_campaign_removes_its_fits_and_figures() {
    let folder = Small::done();
    let config = text(&folder.read("pipeline.toml"));
    let end = config.find("[campaign.kinematic-skewed]").unwrap();
    folder.write("pipeline.toml", &config[..end]);
    let list = text(&folder.read("raw/trials.toml"));
    let kept = list.split("[[trial]]").filter(|entry| !entry.contains("skewed"));
    folder.write("raw/trials.toml", kept.collect::<Vec<_>>().join("[[trial]]"));
    folder.run();
    assert_eq!(redone(&folder).map(|names| names.len())[..2], [0, 0]);
    assert!(!folder.place("reports/figures/fig16.svg").exists());
    assert!(!folder.place("reports/figures/kinematic-skewed-starts.csv").exists());
    assert_same(&folder.results(), &folder.scratch(), "without a campaign");
}

#[test]
fn a_file_with_another_time_and_the_same_bytes_redoes_nothing_and_is_read_once() {
    let folder = Small::done();
    folder.run();
    let marker_file = File::options().write(true).open(folder.place(SYMMETRIC_FILE)).unwrap();
    let age = std::time::Duration::from_secs(60);
    marker_file.set_modified(SystemTime::now() - age).unwrap();
    let record = folder.read("derived/up-to-date.json");
    let before = folder.results();
    let run_json = folder.read("reports/run.json");
    let output = trilink(folder.path(), &["run"]);
    assert!(was_up_to_date(&output) && output.stderr.is_empty());
    assert_same(&folder.results(), &before, "another time");
    assert_eq!(folder.read("reports/run.json"), run_json);
    assert_ne!(folder.read("derived/up-to-date.json"), record);
    let before = stamps(folder.path());
    folder.run();
    assert!(stamps(folder.path()) == before);
}

#[test]
fn changes_with_the_same_size_and_time_are_found_by_verify() {
    let folder = Small::done();
    folder.run();
    let table = "derived/poses/kinematic-skewed-5.00-r1.parquet";
    for name in [SYMMETRIC_FILE, table, "reports/figures/fig17.png"] {
        let place = folder.place(name);
        let time = fs::metadata(&place).unwrap().modified().unwrap();
        let mut bytes = folder.read(name);
        let middle = bytes.len() / 2;
        bytes[middle] = if bytes[middle] == b'1' { b'2' } else { b'1' };
        folder.write(name, bytes);
        File::options().write(true).open(&place).unwrap().set_modified(time).unwrap();
    }
    let unseen = trilink(folder.path(), &["run", "--dry-run"]);
    assert_eq!(text(&unseen.stdout), "");
    let seen = succeed(folder.path(), &["run", "--dry-run", "--explain", "--verify"]);
    assert!(seen.contains("skewed-5.00-r1.parquet has changed since it was written"), "{seen}");
    assert!(seen.contains("the marker file changed"), "{seen}");
    trilink(folder.path(), &["run", "--verify"]);
    assert_same(&folder.results(), &folder.scratch(), "verified");
}

#[test]
fn a_changed_source_of_a_stage_redoes_that_stage_alone() {
    let stages = [("ingest", TRIALS, 0), ("fit", 0, FITS), ("report", 0, 0)];
    for (stage, trials, fits) in stages {
        let folder = Small::done();
        let before = folder.results();
        let mut record: Value =
            serde_json::from_slice(&folder.read("derived/up-to-date.json")).unwrap();
        record[stage]["source"] = "0".into();
        let number = record[stage]["targets"].as_array().unwrap().len();
        folder.write("derived/up-to-date.json", serde_json::to_vec(&record).unwrap());
        let ahead = succeed(folder.path(), &["run", "--dry-run"]);
        let certain = |line: &&str| !line.starts_with("perhaps ");
        assert_eq!(lines(&ahead).into_iter().filter(certain).count(), number, "{ahead}");
        let output = trilink(folder.path(), &["run", "--explain"]);
        let why = text(&output.stderr);
        let said =
            why.matches(&format!(": the program code of stage {stage} has changed\n")).count();
        assert_eq!(said, number, "{stage}: {why}");
        let redone = redone(&folder);
        assert_eq!((redone[0].len(), redone[1].len()), (trials, fits), "{stage}");
        assert_same(&folder.results(), &before, stage);
    }
}

#[test]
fn force_redoes_all_and_stages_alone_are_up_to_date_for_a_run() {
    let folder = Small::done();
    let before = folder.results();
    succeed(folder.path(), &["run", "--force"]);
    assert_eq!(redone(&folder).map(|names| names.len())[..2], [TRIALS, FITS]);
    assert_same(&folder.results(), &before, "--force");

    let folder = Small::raw();
    for stage in ["ingest", "fit", "report"] {
        succeed(folder.path(), &[stage]);
    }
    folder.run();
    assert_eq!(redone(&folder), [const { Vec::<String>::new() }; 3]);
    assert_same(&folder.results(), &before, "stages alone");
    assert_eq!(succeed(folder.path(), &["run", "--dry-run"]), "");
}

#[test]
fn a_trial_that_failed_is_not_tried_again_until_something_changes() {
    let folder = Small::done();
    let whole = folder.read(SYMMETRIC_FILE);
    folder.write(SYMMETRIC_FILE, "");
    assert_eq!(trilink(folder.path(), &["run"]).status.code(), Some(1));
    assert!(!folder.place(&format!("derived/poses/{SYMMETRIC}.parquet")).exists());
    assert_same(&folder.results(), &folder.scratch(), "failed");
    let again = trilink(folder.path(), &["run"]);
    assert_eq!(again.status.code(), Some(1));
    let said = text(&again.stderr);
    assert!(said.contains(SYMMETRIC) && was_up_to_date(&again), "{said}");
    folder.write(SYMMETRIC_FILE, whole);
    folder.run();
    assert_same(&folder.results(), &Small::done().results(), "whole again");
}

/// Campaign and model of the fits that the coast-down contradicts, because the models lack rolling resistance.
const CONTRADICTED: [&str; 2] = ["kinematic-skewed skid", "kinematic-symmetric no-skid"];

#[test]
fn contradictions_by_a_coast_down_are_reported_as_long_as_it_exists() {
    let folder = Small::done();
    let (file, before) = (format!("raw/{COAST}.csv"), folder.results());
    let whole = folder.read(&file);
    folder.write(&file, "");
    let ahead = succeed(folder.path(), &["run", "--dry-run", "--explain"]);
    for fit in CONTRADICTED {
        let perhaps = format!("perhaps fit {fit}: if robot_parameters.parquet changes\n");
        assert!(ahead.contains(&perhaps), "{ahead}");
    }
    assert_eq!(trilink(folder.path(), &["run"]).status.code(), Some(1));
    assert_eq!(redone(&folder)[1], CONTRADICTED);
    assert_same(&folder.results(), &folder.scratch(), "without it");
    folder.write(&file, whole);
    folder.run();
    assert_same(&folder.results(), &before, "with it");
}

#[test]
fn fits_state_the_number_of_trials_without_metrics() {
    let folder = Small::done();
    let gone = "[[trial]]\nid = \"gone\"\nfile = \"gone.csv\"\nkind = \"gait\"\n\
                campaign = \"kinematic-skewed\"\nomega_rad_s = 4.0\n";
    let list = text(&folder.read("raw/trials.toml"));
    folder.write("raw/trials.toml", format!("{list}\n{gone}"));
    assert_eq!(trilink(folder.path(), &["run"]).status.code(), Some(1));
    assert_eq!(redone(&folder)[1], ["kinematic-skewed skid"]);
    assert_same(&folder.results(), &folder.scratch(), "one more, which is not there");
    folder.write("raw/trials.toml", list);
    folder.run();
    assert_same(&folder.results(), &Small::done().results(), "without it");
}

#[test]
fn measured_robot_parameters_make_fits_depend_on_the_robot_s_other_trials() {
    let folder = Small::done();
    folder.replace("pipeline.toml", "[fit]", "[fit]\nrobot_parameters = \"measured\"");
    folder.run();
    change_marker_file(&folder, &format!("raw/{COAST}.csv"));
    let ahead = succeed(folder.path(), &["run", "--dry-run", "--explain"]);
    assert!(ahead.contains("perhaps fit kinematic-skewed skid: if robot_parameters"), "{ahead}");
    folder.run();
    assert_eq!(redone(&folder)[0], [COAST]);
    assert_same(&folder.results(), &folder.scratch(), "a coast-down");
}

#[test]
fn two_runs_on_a_folder_exclude_each_other() {
    let folder = Small::raw();
    fs::create_dir_all(folder.place("derived")).unwrap();
    folder.write(
        "derived/.lock",
        r#"{"process":4711,"host":"the-other","started_unix_s":1000000000}"#,
    );
    let lock = File::options().write(true).open(folder.place("derived/.lock")).unwrap();
    lock.lock().unwrap();
    for command in ["run", "demo", "ingest", "fit", "report"] {
        if ["fit", "report"].contains(&command) {
            folder.write("derived/trials.parquet", "");
        }
        // The folder of the demo is the configured trial folder, which exists.
        let output = trilink(folder.path(), &[command]);
        assert_eq!(output.status.code(), Some(2), "{command}");
        let said = text(&output.stderr);
        assert!(said.contains("held by process 4711 on the-other, for "), "{command}: {said}");
        assert!(said.contains("--wait"), "{command}: {said}");
    }
    fs::remove_file(folder.place("derived/trials.parquet")).unwrap();
    // Commands that only read are not blocked.
    succeed(folder.path(), &["check"]);
    succeed(folder.path(), &["run", "--dry-run"]);
    let waiting = std::thread::scope(|scope| {
        let waiting = scope.spawn(|| trilink(folder.path(), &["run", "--wait"]));
        std::thread::sleep(std::time::Duration::from_millis(500));
        assert!(!waiting.is_finished());
        assert!(!folder.place("reports").join("index.html").exists());
        lock.unlock().unwrap();
        waiting.join().unwrap()
    });
    assert_eq!(waiting.status.code(), Some(0));
    assert!(text(&waiting.stderr).contains("process 4711"), "{}", text(&waiting.stderr));
    assert_same(&folder.results(), &Small::done().results(), "after waiting");
}

#[test]
fn pages_beyond_the_limit_are_made_when_asked_for_and_then_kept_up_to_date() {
    let folder = Small::done();
    let before = folder.results();
    folder.replace("pipeline.toml", "[fit]", "[report]\ntrial_pages = 1\n[fit]");
    let pages = |folder: &Small| -> Vec<String> {
        let results = folder.results().into_keys().map(|path| path.display().to_string());
        let pages =
            results.filter_map(|path| Some(path.strip_prefix("reports/trials/")?.to_owned()));
        pages.collect()
    };
    let said = succeed(folder.path(), &["run", "--dry-run", "--explain"]);
    assert!(
        said.contains(&format!("remove page trials/{SYMMETRIC}.html: no longer listed\n")),
        "{said}"
    );
    folder.run();
    let [first] = &pages(&folder)[..] else { panic!("{:?}", pages(&folder)) };
    assert_ne!(*first, format!("{SYMMETRIC}.html"));

    let meant = trilink(folder.path(), &["report", "--trial", &SYMMETRIC.replace("-r", "-x")]);
    assert_eq!(meant.status.code(), Some(2));
    let message = text(&meant.stderr);
    assert!(
        message.contains("trials.parquet contains no trial") && message.contains("did you mean"),
        "{message}"
    );

    succeed(folder.path(), &["report", "--trial", SYMMETRIC]);
    let page = PathBuf::from(format!("reports/trials/{SYMMETRIC}.html"));
    // Ignore links to pages that do not exist.
    let content = |results: &BTreeMap<PathBuf, Vec<u8>>| {
        let page = text(&results[&page]);
        page.lines().filter(|line| !line.contains("All trials")).collect::<Vec<_>>().join("\n")
    };
    assert_eq!(content(&folder.results()), content(&before));
    succeed(folder.path(), &["run"]);
    change_marker_file(&folder, SYMMETRIC_FILE);
    folder.run();
    assert!(redone(&folder)[2].contains(&format!("trials/{SYMMETRIC}.html")));
    assert_eq!(pages(&folder).len(), 2);
}

#[test]
fn many_targets_with_the_same_reason_are_counted() {
    let folder = Small::done();
    folder.replace("pipeline.toml", "[fit]", "[ingest]\nmax_gap_s = 0.2\n[fit]");
    let ahead = succeed(folder.path(), &["run", "--dry-run", "--explain"]);
    let expected = " trials, because ingest.max_gap_s changed: 0.1 to 0.2\n";
    assert!(ahead.contains(expected), "{ahead}");
    let plain = succeed(folder.path(), &["run", "--dry-run"]);
    assert!(ahead.lines().count() < 15 && plain.lines().count() > 25, "{ahead}");
    let status = succeed(folder.path(), &["status"]);
    assert!(status.contains(&format!("to do          {}", ahead.lines().next().unwrap())));
}

#[test]
fn clean_removes_what_a_run_makes_again_and_nothing_else() {
    let folder = Small::done();
    succeed(folder.path(), &["compare", "--accept", "first"]);
    folder.run();
    let before = folder.results();
    let status = succeed(folder.path(), &["status"]);
    for part in [
        "configuration  pipeline.toml",
        ": ok",
        "nothing: everything is up to date",
        "baseline.json",
    ] {
        assert!(status.contains(part), "{part}: {status}");
    }
    folder.write("derived/notes.txt", "mine");
    folder.write("reports/fits.json", "edited");
    let all = files(folder.path());
    let counted = succeed(folder.path(), &["clean", "--dry-run"]);
    assert!(files(folder.path()) == all, "--dry-run removes nothing");
    let output = trilink(folder.path(), &["clean"]);
    let said = text(&output.stdout);
    assert_eq!(said.replacen("removed", "would remove", 1), counted);
    assert!(text(&output.stderr).contains("has changed since trilink wrote it: reports/fits.json"));
    let left = files(folder.path());
    let unmade = all.into_iter().filter(|(name, _)| {
        let is_result = name.starts_with("derived") || name.starts_with("reports");
        !is_result || name.ends_with("notes.txt") || name.ends_with("fits.json")
    });
    assert!(left == unmade.collect(), "{:?}", left.keys());
    assert!(
        left.contains_key(Path::new("history.parquet"))
            && left.contains_key(Path::new("baseline.json"))
    );
    assert!(succeed(folder.path(), &["status"]).contains("last run       none"));
    std::fs::remove_file(folder.place("derived/notes.txt")).unwrap();
    folder.run();
    let mut expected = before;
    expected.retain(|name, _| !name.to_string_lossy().contains("compare."));
    assert_same(&folder.results(), &expected, "made again");
}
