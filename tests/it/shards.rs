//! An ingest and a bootstrap in parts: joined they are the bytes of undivided ones, and what cannot
//! be joined is named.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use trilink_tables::Table;

use crate::common::{Small, assert_same, succeed, temporary, text, trilink};

/// Nine trials; of one the marker file is empty.
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

/// The tables that an undivided ingest of the project leaves.
fn undivided() -> &'static BTreeMap<PathBuf, Vec<u8>> {
    static MADE: OnceLock<BTreeMap<PathBuf, Vec<u8>>> = OnceLock::new();
    MADE.get_or_init(|| {
        let folder = project();
        said(&folder, &["ingest"], 1);
        folder.results()
    })
}

/// Runs the program, which must end with a status; gives what it wrote to either output.
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

/// Ingests a part in the project itself.
fn make_part(folder: &Small, number: usize, of: usize) {
    let part = format!("{number}/{of}");
    let output = trilink(folder.path(), &["-q", "ingest", "--shard", &part, "--into", "shards"]);
    assert!(output.status.code() < Some(2), "{}", text(&output.stderr));
}

/// The project with parts that were each made in a copy that has another name, with another
/// number of threads.
fn with_parts(of: usize) -> Small {
    let folder = project();
    for number in 1..=of {
        let (copy, part, home) = (project(), format!("{number}/{of}"), home(number, of));
        let threads = (1 + number % 3).to_string();
        let arguments = ["--threads", &threads, "ingest", "--shard", &part, "--into", "shards"];
        let output = trilink(copy.path(), &arguments);
        let (said, told) = (text(&output.stdout), text(&output.stderr));
        // A part with a failed trial ends as an ingest with one does.
        let failed = i32::from(!said.contains(" 0 failed"));
        assert_eq!(output.status.code(), Some(failed), "{told}");
        assert!(said.ends_with(&format!("; part {part} in {home}\n")), "{said}");
        let steps = told.lines().filter(|line| line.starts_with("ingest "));
        assert!(steps.clone().all(|line| line.contains(&format!(", part {part}"))), "{told}");
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
fn parts_of_any_number_joined_are_the_bytes_of_one_run() {
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
        // Again, where everything is there.
        said(&folder, &["merge", "shards"], 1);
        assert_same(&folder.results(), undivided(), &format!("{of} parts again"));
        if of == 7 {
            said(&folder, &["run"], 1);
            assert_same(&folder.results(), &project().scratch(), "every table and report");
        }
    }
}

#[test]
fn parts_that_cannot_be_joined_are_named_and_redone_give_the_bytes_of_one_run() {
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
        make_part(folder, 2, 3);
        folder.replace("pipeline.toml", "[ingest]\nskip_cycles = 3\n[fit]", "[fit]");
    };
    let list_less = |folder: &Small| {
        let list = text(&folder.read("raw/trials.toml"));
        let last = list.rfind("[[trial]]").unwrap();
        folder.write("raw/trials.toml", &list[..last]);
        make_part(folder, 2, 3);
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
        make_part(folder, 2, 4);
        remove(folder);
    };
    type Fault<'f> = (&'f dyn Fn(&Small), &'f str, bool);
    let faults: [Fault; 13] = [
        (&remove, "missing", true),
        (&kill, "unfinished: no manifest.json", true),
        (&rot, ".parquet is not as it was written", false),
        (&lose, ".parquet is gone", false),
        (&cut, "manifest.json: damaged: EOF", false),
        (&of_format, "manifest.json: found format 7, needed 2", false),
        (&of_none, "manifest.json: damaged: found part `1-of-0`, needed one such as", false),
        (&escape, "manifest.json: found file ../poses/", false),
        (&configure, "made with another configuration, or of other trials", false),
        (&list_less, "made with another configuration, or of other trials", false),
        (&of_program, "made by another program (version ", false),
        (&double, "part 2/3 is there twice: remove one", false),
        (&divide, "part 2/4 of another division than most parts", false),
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
        assert!(refused.ends_with("\nto do again: --array=2\n"), "{problem}: {refused}");
        assert!(!folder.place("derived").exists(), "{problem}");
        if may_be_left_out {
            let joined = said(&folder, &["merge", "shards", "--allow-missing"], 1);
            assert!(joined.contains("parts are missing, to do again: --array=2\n"), "{joined}");
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
        make_part(&folder, 2, 3);
        said(&folder, &["merge", "shards"], 1);
        assert_same(&folder.results(), undivided(), problem);
    }
}

#[test]
fn a_part_that_is_killed_is_unfinished_and_one_at_a_time_works_on_it() {
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
    assert!(held.contains("held by process") && held.contains("--wait waits for it"), "{held}");
    run.kill().unwrap();
    run.wait().unwrap();
    let refused = said(&folder, &["merge", "shards"], 2);
    assert!(refused.contains("shards/1-of-1: unfinished"), "{refused}");
    // Nothing else is there to join.
    said(&folder, &["merge", "shards", "--allow-missing"], 2);
    assert!(!folder.place("derived").exists());
    make_part(&folder, 1, 1);
    said(&folder, &["merge", "shards"], 1);
    assert_same(&folder.results(), undivided(), "after the kill");
}

#[test]
fn there_are_no_parts_beside_the_division_and_no_tables_of_other_folders() {
    let folder = project();
    for (part, needed) in [
        ("0/8", "found `0/8`, needed a part from 1/8 to 8/8"),
        ("9/8", "found `9/8`, needed a part from 1/8 to 8/8"),
        ("3", "found `3`, needed a part such as 3/8"),
        ("1/0", "found `1/0`, needed a part such as 3/8"),
        ("-1/8", "found `-1/8`, needed a part such as 3/8"),
        ("1/100001", "of 100000 at most"),
    ] {
        let shard = format!("--shard={part}");
        let refused = said(&folder, &["ingest", &shard, "--into", "shards"], 2);
        assert!(refused.contains(needed), "{refused}");
    }
    said(&folder, &["ingest", "--shard", "1/8"], 2);
    assert!(!folder.place("shards").exists());
    let refused = said(&folder, &["merge", "raw"], 2);
    assert!(refused.contains("raw: found no parts, needed those that"), "{refused}");

    // The trials of one folder, in parts, do not remove those of another one.
    copy_folder(&folder.place("raw"), &folder.place("other"));
    said(&folder, &["ingest"], 1);
    let before = folder.results();
    for number in [1, 2] {
        let part = format!("{number}/2");
        trilink(folder.path(), &["-q", "ingest", "other", "--shard", &part, "--into", "shards"]);
    }
    let refused = said(&folder, &["merge", "shards"], 2);
    assert!(refused.contains("derived: found tables of trials of raw, needed only"), "{refused}");
    assert_same(&folder.results(), &before, "another folder");
    fs::remove_dir_all(folder.place("derived")).unwrap();
    said(&folder, &["merge", "shards"], 1);
}

/// Two campaigns with seven replicates, ingested.
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
fn replicates_of_any_parts_joined_are_the_bytes_of_one_bootstrap() {
    let one = ingested();
    succeed(one.path(), &["-q", "fit"]);
    let expected = one.results();
    let predictions = Table::read(&one.place("derived/predictions.parquet")).unwrap();
    let limits = predictions.values::<f64>("d_m_hi").unwrap();
    assert!(limits.iter().any(|limit| limit.is_finite()), "the replicates give intervals");
    let folder = ingested();
    // Three models, driven either way; the symmetric measured gaits have no motion without skid.
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
fn replicates_that_cannot_be_joined_are_named() {
    let folder = ingested();
    for (numbers, needed) in [
        ("3..3", "found `3..3`, needed replicates such as 0..500"),
        ("0-3", "found `0-3`, needed replicates such as 0..500"),
        ("0..8", "replicates 0..8: found `fit.bootstrap` = 7, needed 8 at least"),
    ] {
        let arguments = ["fit", "--replicates", numbers, "--into", "shards"];
        let refused = said(&folder, &arguments, 2);
        assert!(refused.contains(needed), "{refused}");
    }
    let raw = Small::raw();
    let refused = said(&raw, &["fit", "--replicates", "0..3", "--into", "shards"], 2);
    assert!(refused.contains("trials.parquet: not there; `trilink ingest` makes it"), "{refused}");
    assert!(!raw.place("shards").exists() && !folder.place("shards").exists());

    fit_part(&folder, "2..4", "2");
    let before = folder.results();
    let status = said(&folder, &["merge", "shards", "--status"], 1);
    assert!(status.contains("shards/replicates-0-2: missing\n"), "{status}");
    assert!(status.ends_with("--replicates 0..2,4..7\n"), "{status}");
    // Fewer replicates are no bootstrap of seven.
    for arguments in [&["merge", "shards"][..], &["merge", "shards", "--allow-missing"]] {
        let refused = said(&folder, arguments, 2);
        assert!(refused.contains("shards/replicates-4-7: missing\n"), "{refused}");
        assert!(refused.ends_with("to do again: --replicates 0..2,4..7\n"), "{refused}");
    }
    fit_part(&folder, "0..3", "2");
    let refused = said(&folder, &["merge", "shards"], 2);
    assert!(refused.contains("replicates 2..4 is there twice: remove one"), "{refused}");
    fs::remove_dir_all(folder.place("shards/replicates-0-3")).unwrap();
    fit_part(&folder, "0..2", "2");
    folder.replace("pipeline.toml", "bootstrap = 7", "bootstrap = 3");
    let refused = said(&folder, &["merge", "shards"], 2);
    assert!(refused.contains("replicates 2..4, needed those of 0 to 3"), "{refused}");
    folder.replace("pipeline.toml", "bootstrap = 3", "bootstrap = 4");
    let status = said(&folder, &["merge", "shards", "--status"], 0);
    assert_eq!(status.lines().count(), 2, "{status}");
    folder.replace("pipeline.toml", "starts = 1", "starts = 2");
    let refused = said(&folder, &["merge", "shards"], 2);
    assert_eq!(refused.matches("made with another configuration, or of other").count(), 2);
    folder.replace("pipeline.toml", "starts = 2", "starts = 1");
    assert_same(&folder.results(), &before, "refused");
    folder.replace("raw/trials.toml", "id = \"kinematic-skewed-6.00-r1\"", "id = \"another\"");
    succeed(folder.path(), &["-q", "ingest"]);
    let refused = said(&folder, &["merge", "shards"], 2);
    assert_eq!(refused.matches("made with another configuration, or of other").count(), 2);
}
