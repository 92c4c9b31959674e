//! Tests of ingests and bootstraps in shards: merged shards give the same bytes as an undivided stage; unusable shards
//! are reported.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use trilink_tables::Table;

use crate::common::{Small, assert_same, succeed, temporary, text, trilink};

/// Creates a project with nine trials, one of which has an empty marker file.
fn project() -> Small {
    static MADE: OnceLock<Small> = OnceLock::new();
    let made = MADE.get_or_init(|| {
        let folder = Small(temporary());
        folder.write("pipeline.toml", crate::common::SMALL);
        folder.replace("pipeline.toml", "starts = 2\nbootstrap = 3", "starts = 1\nbootstrap = 0");
        folder.replace("pipeline.toml", "\"no-skid\", \"skid-roll\"", "\"no-skid\"");
        succeed(folder.path(), &["-q", "synth", "raw", "--omega", "4,5,6,7", "--seed", "1"]);
        folder.write("raw/kinematic-symmetric-5.00-r1.csv", "");
        folder
    });
    made.copy()
}

/// Returns the tables of an ingest of all trials without shards.
fn undivided() -> &'static BTreeMap<PathBuf, Vec<u8>> {
    static MADE: OnceLock<BTreeMap<PathBuf, Vec<u8>>> = OnceLock::new();
    MADE.get_or_init(|| {
        let folder = project();
        said(&folder, &["ingest"], 1);
        folder.results()
    })
}

/// Runs the program, asserts its exit status, and returns standard output followed by standard error.
fn said(folder: &Small, arguments: &[&str], status: i32) -> String {
    let output = trilink(folder.path(), arguments);
    let said = text(&output.stdout) + &text(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{arguments:?}: {said}");
    said
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let place = to.join(path.file_name().unwrap());
        match path.is_dir() {
            true => copy_folder(&path, &place),
            false => drop(fs::copy(&path, &place).unwrap()),
        }
    }
}

fn home(number: usize, of: usize) -> String {
    format!("shards/{number}-of-{of}")
}

/// Ingests one shard in the project itself, not in a copy of it.
fn make_shard(folder: &Small, number: usize, of: usize) {
    let part = format!("{number}/{of}");
    let output = trilink(folder.path(), &["-q", "ingest", "--shard", &part, "--into", "shards"]);
    assert!(output.status.code() < Some(2), "{}", text(&output.stderr));
}

/// Creates a project with `of` shards, each computed in a copy of the project under another name and with another
/// number of threads.
fn with_parts(of: usize) -> Small {
    let folder = project();
    for number in 1..=of {
        let (copy, part, home) = (project(), format!("{number}/{of}"), home(number, of));
        let threads = (1 + number % 3).to_string();
        let arguments = ["--threads", &threads, "ingest", "--shard", &part, "--into", "shards"];
        let output = trilink(copy.path(), &arguments);
        let (said, told) = (text(&output.stdout), text(&output.stderr));
        // A shard with a failed trial has the same exit status as an ingest with one.
        let failed = i32::from(!said.contains(" 0 failed"));
        assert_eq!(output.status.code(), Some(failed), "{told}");
        assert!(said.ends_with(&format!("; shard {part} in {home}\n")), "{said}");
        let steps = told.lines().filter(|line| line.starts_with("ingest "));
        assert!(steps.clone().all(|line| line.contains(&format!(", shard {part}"))), "{told}");
        assert_eq!(said.split(' ').next().unwrap(), steps.count().to_string(), "{said}");
        for nothing in ["derived", "reports"] {
            assert!(!copy.place(nothing).exists(), "{nothing}");
        }
        assert_eq!(fs::read_dir(copy.place("shards")).unwrap().count(), 1);
        copy_folder(&copy.place(&home), &folder.place(&home));
    }
    folder
}

#[test]
fn any_number_of_merged_shards_has_the_bytes_of_one_run() {
    for of in [1, 2, 7, 12] {
        let folder = with_parts(of);
        let status = said(&folder, &["merge", "shards", "--status"], 0);
        assert_eq!((status.lines().count(), status.matches(" 1 failed").count()), (of, 1));
        assert!(!folder.place("derived").exists());
        let merged = said(&folder, &["merge", "shards"], 1);
        assert!(merged.contains("9 trials: 8 ok, 0 flagged, 1 failed; tables in derived"));
        assert_same(&folder.results(), undivided(), &format!("{of} parts"));
        let ahead = succeed(folder.path(), &["run", "--dry-run", "--explain"]);
        assert!(!ahead.contains("trial "), "{ahead}");
        // Merge again into existing tables.
        said(&folder, &["merge", "shards"], 1);
        assert_same(&folder.results(), undivided(), &format!("{of} parts again"));
        if of == 7 {
            said(&folder, &["run"], 1);
            assert_same(&folder.results(), &project().scratch(), "every table and report");
        }
    }
}

#[test]
fn unusable_shards_are_reported_and_made_again_give_the_bytes_of_one_run() {
    let whole = with_parts(3);
    let name = home(2, 3);
    let place = |folder: &Small| folder.place(&name);
    let table = |folder: &Small| {
        let mut tables = fs::read_dir(place(folder).join("poses")).unwrap();
        tables.next().unwrap().unwrap().path()
    };
    let remove = |folder: &Small| fs::remove_dir_all(place(folder)).unwrap();
    let kill = |folder: &Small| fs::remove_file(place(folder).join("manifest.json")).unwrap();
    let rot = |folder: &Small| {
        let table = table(folder);
        let mut bytes = fs::read(&table).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(table, bytes).unwrap();
    };
    let lose = |folder: &Small| fs::remove_file(table(folder)).unwrap();
    let cut = |folder: &Small| {
        let manifest = folder.read(&format!("{name}/manifest.json"));
        folder.write(&format!("{name}/manifest.json"), &manifest[..manifest.len() / 2]);
    };
    let configure = |folder: &Small| {
        folder.replace("pipeline.toml", "[fit]", "[ingest]\nskip_cycles = 3\n[fit]");
        make_shard(folder, 2, 3);
        folder.replace("pipeline.toml", "[ingest]\nskip_cycles = 3\n[fit]", "[fit]");
    };
    let list_less = |folder: &Small| {
        let list = text(&folder.read("raw/trials.toml"));
        let last = list.rfind("[[trial]]").unwrap();
        folder.write("raw/trials.toml", &list[..last]);
        make_shard(folder, 2, 3);
        folder.write("raw/trials.toml", &list);
    };
    let of_program = |folder: &Small| {
        let manifest = text(&folder.read(&format!("{name}/manifest.json")));
        let at = manifest.find("\"source\":\"").unwrap() + 10;
        let other = format!("{}0000{}", &manifest[..at], &manifest[at + 4..]);
        folder.write(&format!("{name}/manifest.json"), other);
    };
    let of_format = |folder: &Small| {
        folder.write(&format!("{name}/manifest.json"), "{ \"format\": 7, \"new\": [] }");
    };
    let of_none = |folder: &Small| {
        folder.replace(&format!("{name}/manifest.json"), "\"2-of-3\"", "\"1-of-0\"");
    };
    let escape = |folder: &Small| {
        let manifest = format!("{name}/manifest.json");
        folder.replace(&manifest, "\"poses/", "\"../poses/");
    };
    let double = |folder: &Small| copy_folder(&place(folder), &folder.place("shards/again"));
    let divide = |folder: &Small| {
        make_shard(folder, 2, 4);
        remove(folder);
    };
    type Fault<'f> = (&'f dyn Fn(&Small), &'f str, bool);
    let faults: [Fault; 13] = [
        (&remove, "missing", true),
        (&kill, "unfinished: manifest.json, which is written last, is missing", true),
        (&rot, ".parquet has changed since it was written", false),
        (&lose, ".parquet no longer exists", false),
        (&cut, "manifest.json: damaged: EOF", false),
        (&of_format, "manifest.json: found format 7, needed 2", false),
        (&of_none, "manifest.json: damaged: found shard `1-of-0`, needed one such as", false),
        (&escape, "manifest.json: found file ../poses/", false),
        (&configure, "made with a different configuration or from different trials", false),
        (&list_less, "made with a different configuration or from different trials", false),
        (&of_program, "made by a different build of trilink (version ", false),
        (&double, "shard 2/3 overlaps another shard; remove one of them", false),
        (
            &divide,
            "shard 2/4 comes from a different division into shards than most of the other shards",
            false,
        ),
    ];
    for (fault, problem, may_be_left_out) in faults {
        let folder = whole.copy();
        fault(&folder);
        let status = said(&folder, &["merge", "shards", "--status"], 1);
        assert!(status.contains(problem), "{problem}: {status}");
        assert!(status.ends_with("--array=2\n"), "{problem}: {status}");
        let refused = said(&folder, &["merge", "shards"], 2);
        assert!(refused.contains(problem), "{problem}: {refused}");
        assert!(refused.contains(&format!("\n  {name}: ")), "{problem}: {refused}");
        assert!(refused.ends_with("\nmake them again with --array=2\n"), "{problem}: {refused}");
        assert!(!folder.place("derived").exists(), "{problem}");
        if may_be_left_out {
            let joined = said(&folder, &["merge", "shards", "--allow-missing"], 1);
            assert!(
                joined.contains("shards are missing; make them again with --array=2\n"),
                "{joined}"
            );
            let mut left = folder.results();
            let poses = |files: &BTreeMap<PathBuf, Vec<u8>>| {
                files.keys().filter(|name| name.starts_with("derived/poses")).count()
            };
            assert!((1..poses(undivided())).contains(&poses(&left)), "{problem}");
            left.retain(|name, _| name.iter().count() == 3);
            assert!(left.iter().all(|(name, bytes)| undivided()[name] == *bytes), "{problem}");
        } else {
            said(&folder, &["merge", "shards", "--allow-missing"], 2);
            assert!(!folder.place("derived").exists(), "{problem}");
        }
        for other in ["again", "2-of-4"] {
            let _ = fs::remove_dir_all(folder.place("shards").join(other));
        }
        make_shard(&folder, 2, 3);
        said(&folder, &["merge", "shards"], 1);
        assert_same(&folder.results(), undivided(), problem);
    }
}

#[test]
fn a_killed_shard_is_unfinished_and_one_process_at_a_time_uses_it() {
    let folder = project();
    let begin = || {
        let arguments = ["--threads", "1", "ingest", "--shard", "1/1", "--into", "shards"];
        let mut program = Command::new(env!("CARGO_BIN_EXE_trilink"));
        let program = program.args(arguments).current_dir(folder.path());
        program.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    };
    let mut run = begin();
    let part = folder.place("shards/1-of-1");
    while fs::read_dir(part.join("poses")).map_or(0, Iterator::count) < 2 {
        assert!(run.try_wait().unwrap().is_none(), "it ended before it was killed");
    }
    let held = said(&folder, &["ingest", "--shard", "1/1", "--into", "shards"], 2);
    assert!(
        held.contains("held by process")
            && held.contains("with --wait, the command waits until the lock is released"),
        "{held}"
    );
    run.kill().unwrap();
    run.wait().unwrap();
    let refused = said(&folder, &["merge", "shards"], 2);
    assert!(refused.contains("shards/1-of-1: unfinished"), "{refused}");
    // The incomplete shard is the only one.
    said(&folder, &["merge", "shards", "--allow-missing"], 2);
    assert!(!folder.place("derived").exists());
    make_shard(&folder, 1, 1);
    said(&folder, &["merge", "shards"], 1);
    assert_same(&folder.results(), undivided(), "after the kill");
}

#[test]
fn invalid_shards_and_tables_of_other_folders_are_rejected() {
    let folder = project();
    for (part, needed) in [
        ("0/8", "found `0/8`, needed a shard from 1/8 to 8/8"),
        ("9/8", "found `9/8`, needed a shard from 1/8 to 8/8"),
        ("3", "found `3`, needed a shard such as 3/8"),
        ("1/0", "found `1/0`, needed a shard such as 3/8"),
        ("-1/8", "found `-1/8`, needed a shard such as 3/8"),
        ("1/100001", "at most 100000 shards"),
    ] {
        let shard = format!("--shard={part}");
        let refused = said(&folder, &["ingest", &shard, "--into", "shards"], 2);
        assert!(refused.contains(needed), "{refused}");
    }
    said(&folder, &["ingest", "--shard", "1/8"], 2);
    assert!(!folder.place("shards").exists());
    let refused = said(&folder, &["merge", "raw"], 2);
    assert!(
        refused.contains("raw: contains no shards; `trilink ingest --shard 3/8 --into raw`"),
        "{refused}"
    );

    // Merging the shards of one folder does not remove the trials of another folder.
    copy_folder(&folder.place("raw"), &folder.place("other"));
    said(&folder, &["ingest"], 1);
    let before = folder.results();
    for number in [1, 2] {
        let part = format!("{number}/2");
        trilink(folder.path(), &["-q", "ingest", "other", "--shard", &part, "--into", "shards"]);
    }
    let refused = said(&folder, &["merge", "shards"], 2);
    assert!(
        refused.contains("derived: contains tables for trials in raw, but the shards cover only"),
        "{refused}"
    );
    assert_same(&folder.results(), &before, "another folder");
    fs::remove_dir_all(folder.place("derived")).unwrap();
    said(&folder, &["merge", "shards"], 1);
}

/// Creates a project with two ingested campaigns and a bootstrap of seven replicates.
fn ingested() -> Small {
    static MADE: OnceLock<Small> = OnceLock::new();
    let made = MADE.get_or_init(|| {
        let folder = Small::raw();
        folder.replace("pipeline.toml", "starts = 2\nbootstrap = 3", "starts = 1\nbootstrap = 7");
        succeed(folder.path(), &["-q", "ingest"]);
        folder
    });
    made.copy()
}

fn fit_part(folder: &Small, numbers: &str, threads: &str) -> String {
    let arguments = ["--threads", threads, "fit", "--replicates", numbers, "--into", "shards"];
    said(folder, &arguments, 0)
}

#[test]
fn merged_replicates_of_any_shards_have_the_bytes_of_one_bootstrap() {
    let one = ingested();
    succeed(one.path(), &["-q", "fit"]);
    let expected = one.results();
    let predictions = Table::read(&one.place("derived/predictions.parquet")).unwrap();
    let limits = predictions.values::<f64>("d_m_hi").unwrap();
    assert!(limits.iter().any(|limit| limit.is_finite()), "the replicates give intervals");
    let folder = ingested();
    // Three models with the commanded and with the measured gait; the symmetric measured gait allows no motion without
    // skid.
    for (numbers, threads, count) in [("0..1", "1", 5), ("1..5", "2", 20), ("5..7", "3", 10)] {
        let copy = ingested();
        let before = copy.results();
        let told = fit_part(&copy, numbers, threads);
        let expected = format!(
            "{count} replicates of all models; replicates {numbers} in shards/replicates-{}\n",
            numbers.replace("..", "-")
        );
        assert!(told.contains(&expected), "{told}");
        assert!(told.contains(&format!("skid-roll, replicates {numbers}")), "{told}");
        assert_same(&copy.results(), &before, "a part writes nothing of the project's");
        copy_folder(&copy.place("shards"), &folder.place("shards"));
    }
    let status = said(&folder, &["merge", "shards", "--status"], 0);
    assert_eq!(status.lines().count(), 3, "{status}");
    assert!(status.contains("shards/replicates-1-5: replicates 1..5\n"), "{status}");
    let merged = said(&folder, &["merge", "shards"], 0);
    assert!(merged.contains("kinematic-skewed: "), "{merged}");
    assert_same(&folder.results(), &expected, "merged");
    let ahead = succeed(folder.path(), &["run", "--dry-run", "--explain"]);
    assert!(!ahead.contains("fit kinematic") && !ahead.contains("trial "), "{ahead}");
}

#[test]
fn unusable_shards_of_replicates_are_reported() {
    let folder = ingested();
    for (numbers, needed) in [
        ("3..3", "found `3..3`, needed a range of replicates such as 0..500"),
        ("0-3", "found `0-3`, needed a range of replicates such as 0..500"),
        ("0..8", "replicates 0..8: found `fit.bootstrap` = 7, needed at least 8"),
    ] {
        let arguments = ["fit", "--replicates", numbers, "--into", "shards"];
        let refused = said(&folder, &arguments, 2);
        assert!(refused.contains(needed), "{refused}");
    }
    let raw = Small::raw();
    let refused = said(&raw, &["fit", "--replicates", "0..3", "--into", "shards"], 2);
    assert!(
        refused.contains("trials.parquet: does not exist; `trilink ingest` creates it"),
        "{refused}"
    );
    assert!(!raw.place("shards").exists() && !folder.place("shards").exists());

    fit_part(&folder, "2..4", "2");
    let before = folder.results();
    let status = said(&folder, &["merge", "shards", "--status"], 1);
    assert!(status.contains("shards/replicates-0-2: missing\n"), "{status}");
    assert!(status.ends_with("--replicates 0..2,4..7\n"), "{status}");
    // Fewer than seven replicates cannot be merged into a bootstrap of seven.
    for arguments in [&["merge", "shards"][..], &["merge", "shards", "--allow-missing"]] {
        let refused = said(&folder, arguments, 2);
        assert!(refused.contains("shards/replicates-4-7: missing\n"), "{refused}");
        assert!(refused.ends_with("make them again with --replicates 0..2,4..7\n"), "{refused}");
    }
    fit_part(&folder, "0..3", "2");
    let refused = said(&folder, &["merge", "shards"], 2);
    assert!(
        refused.contains("replicates 2..4 overlaps another shard; remove one of them"),
        "{refused}"
    );
    fs::remove_dir_all(folder.place("shards/replicates-0-3")).unwrap();
    fit_part(&folder, "0..2", "2");
    folder.replace("pipeline.toml", "bootstrap = 7", "bootstrap = 3");
    let refused = said(&folder, &["merge", "shards"], 2);
    let needed = "needed replicates within 0..3, the range given by `fit.bootstrap`";
    assert!(refused.contains(&format!("found replicates 2..4, {needed}")), "{refused}");
    folder.replace("pipeline.toml", "bootstrap = 3", "bootstrap = 4");
    let status = said(&folder, &["merge", "shards", "--status"], 0);
    assert_eq!(status.lines().count(), 2, "{status}");
    folder.replace("pipeline.toml", "starts = 1", "starts = 2");
    let refused = said(&folder, &["merge", "shards"], 2);
    assert_eq!(refused.matches("made with a different configuration or from").count(), 2);
    folder.replace("pipeline.toml", "starts = 2", "starts = 1");
    assert_same(&folder.results(), &before, "refused");
    folder.replace("raw/trials.toml", "id = \"kinematic-skewed-6.00-r1\"", "id = \"another\"");
    succeed(folder.path(), &["-q", "ingest"]);
    let refused = said(&folder, &["merge", "shards"], 2);
    assert_eq!(refused.matches("made with a different configuration or from").count(), 2);
}
