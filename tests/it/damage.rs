//! Tests of damage to results and to the folders of a run: a run repairs what it can, reports what it cannot repair,
//! and changes nothing else. Damage to marker files and settings is tested in `bad_input.rs`.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use trilink_tables::Table;

use crate::common::{Small, assert_same, text, trilink, was_up_to_date};

const TRIAL: &str = "kinematic-symmetric-5.00-r1";
const RECORD: &str = "derived/up-to-date.json";

/// Kind of damage to a file.
#[derive(Debug, Clone, Copy)]
enum Damage {
    Gone,
    Empty,
    Garbage,
    Half,
    /// Changes one byte in the middle of the file.
    Flipped,
    /// Replaces the file by a copy of another file, given by its path in the project.
    Other(&'static str),
    /// Replaces the file by a folder.
    Folder,
}

impl Damage {
    fn strike(self, folder: &Small, name: &str) {
        let place = folder.place(name);
        match self {
            Self::Gone if place.is_dir() => fs::remove_dir_all(place).unwrap(),
            Self::Gone => fs::remove_file(place).unwrap(),
            Self::Empty => folder.write(name, ""),
            Self::Garbage => folder.write(name, b"PAR1 \xff\xfe{garbage"),
            Self::Half => {
                let bytes = folder.read(name);
                folder.write(name, &bytes[..bytes.len() / 2]);
            }
            Self::Flipped => {
                let mut bytes = folder.read(name);
                let middle = bytes.len() / 2;
                bytes[middle] ^= 0x20;
                folder.write(name, bytes);
            }
            Self::Other(other) => folder.write(name, folder.read(other)),
            Self::Folder => {
                if place.exists() {
                    fs::remove_file(&place).unwrap();
                }
                fs::create_dir(place).unwrap();
            }
        }
    }
}

fn assert_says(output: &Output, status: i32, named: &[&str], what: &str) {
    let said = text(&output.stderr);
    assert!(!said.contains("panicked"), "{what}: {said}");
    assert_eq!(output.status.code(), Some(status), "{what}: {said}");
    for name in named {
        assert!(said.contains(name), "{what}: {said:?} does not name {name:?}");
    }
}

fn assert_nothing_half_written(folder: &Path) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        assert!(!path.to_string_lossy().contains(".writing-"), "{} was left", path.display());
        if path.is_dir() {
            assert_nothing_half_written(&path);
        }
    }
}

#[test]
fn damaged_results_are_made_again() {
    use Damage::{Empty, Flipped, Garbage, Gone, Half, Other};
    let poses = format!("derived/poses/{TRIAL}.parquet");
    let wheels = format!("derived/wheels/{TRIAL}.parquet");
    let cycles = format!("derived/cycles/{TRIAL}.parquet");
    let cases: [(&str, Damage, &str); 34] = [
        ("derived/trials.parquet", Gone, "trials.parquet no longer exists"),
        ("derived/trials.parquet", Empty, "trials.parquet has changed since it was written"),
        ("derived/trials.parquet", Flipped, "trials.parquet has changed since it was written"),
        (
            "derived/trials.parquet",
            Other("derived/fits.parquet"),
            "trials.parquet has changed since it was written",
        ),
        ("derived/checks.parquet", Half, "checks.parquet has changed since it was written"),
        (
            "derived/robot_parameters.parquet",
            Garbage,
            "robot_parameters.parquet has changed since it was written",
        ),
        (&poses, Gone, "poses/kinematic-symmetric-5.00-r1.parquet no longer exists"),
        (
            &wheels,
            Garbage,
            "wheels/kinematic-symmetric-5.00-r1.parquet has changed since it was written",
        ),
        (
            &cycles,
            Empty,
            "cycles/kinematic-symmetric-5.00-r1.parquet has changed since it was written",
        ),
        (
            &cycles,
            Flipped,
            "cycles/kinematic-symmetric-5.00-r1.parquet has changed since it was written",
        ),
        ("derived/poses", Gone, "poses/kinematic-symmetric-5.00-r1.parquet no longer exists"),
        ("derived/fits.parquet", Gone, "fits.parquet no longer exists"),
        ("derived/starts.parquet", Half, "starts.parquet has changed since it was written"),
        ("derived/profiles.parquet", Garbage, "profiles.parquet has changed since it was written"),
        ("derived/bootstrap.parquet", Empty, "bootstrap.parquet has changed since it was written"),
        (
            "derived/comparison.parquet",
            Other("derived/fits.parquet"),
            "comparison.parquet has changed since it was written",
        ),
        (
            "derived/predictions.parquet",
            Flipped,
            "predictions.parquet has changed since it was written",
        ),
        ("reports/figures/fig17.svg", Gone, "figures/fig17.svg no longer exists"),
        (
            "reports/figures/fig17.svg",
            Flipped,
            "figures/fig17.svg has changed since it was written",
        ),
        (
            "reports/figures/fig17.png",
            Garbage,
            "figures/fig17.png has changed since it was written",
        ),
        ("reports/figures/fig17.csv", Empty, "figures/fig17.csv has changed since it was written"),
        ("reports/index.html", Gone, "index.html no longer exists"),
        ("reports/index.html", Half, "index.html has changed since it was written"),
        ("reports/fits.json", Garbage, "fits.json has changed since it was written"),
        ("reports/run.json", Gone, ""),
        ("reports", Gone, "figures/fig17.svg no longer exists"),
        ("derived", Gone, "new"),
        (RECORD, Gone, "new"),
        (RECORD, Empty, "up-to-date.json: not a record written by trilink"),
        (RECORD, Garbage, "up-to-date.json: not a record written by trilink"),
        (RECORD, Half, "up-to-date.json: not a record written by trilink"),
        (RECORD, Other("reports/fits.json"), "up-to-date.json: not a record written by trilink"),
        ("derived/.lock", Garbage, ""),
        ("derived/.lock", Gone, ""),
    ];
    let expected = Small::done().results();
    for (name, damage, why) in cases {
        let folder = Small::done();
        folder.run();
        damage.strike(&folder, name);
        let what = format!("{name} {damage:?}");
        let output = trilink(folder.path(), &["run", "--explain"]);
        assert_says(&output, 0, &[why], &what);
        assert_same(&folder.results(), &expected, &what);
        assert!(folder.place("reports/run.json").is_file(), "{what}");
        let again = trilink(folder.path(), &["run"]);
        assert!(was_up_to_date(&again) && again.stderr.is_empty(), "{what}");
    }
}

/// Function that changes `up-to-date.json`, the record of what each result was made from.
type Change = fn(&mut Value);

#[test]
fn a_false_record_is_not_trusted() {
    let expected = Small::done().results();
    let cases: [(&str, Change); 6] = [
        ("a later format", |record| record["format"] = 99.into()),
        ("an unknown key", |record| record["extra"] = 1.into()),
        ("no stages", |record| *record = serde_json::json!({ "format": 2 })),
        ("another hash", |record| {
            let made = record["ingest"]["targets"].as_array_mut().unwrap();
            let of_trial = |made: &&mut Value| made["target"]["name"] == TRIAL;
            made.iter_mut().find(of_trial).unwrap()["parts"]["the marker file"] = "0".into();
        }),
        ("a trial that there is not", |record| {
            let made = record["ingest"]["targets"].as_array_mut().unwrap();
            let mut nobody = made[0].clone();
            nobody["target"]["name"] = "nobody".into();
            made.push(nobody);
        }),
        ("a fit that there is not", |record| {
            let made = record["fit"]["targets"].as_array_mut().unwrap();
            let mut nobody = made[0].clone();
            nobody["target"]["name"] = "no campaign skid".into();
            made.push(nobody);
        }),
    ];
    for (what, change) in cases {
        let folder = Small::done();
        let mut record: Value = serde_json::from_slice(&folder.read(RECORD)).unwrap();
        change(&mut record);
        folder.write(RECORD, serde_json::to_vec(&record).unwrap());
        assert_says(&trilink(folder.path(), &["run"]), 0, &[], what);
        assert_same(&folder.results(), &expected, what);
    }
}

#[test]
fn unwritable_paths_are_reported_before_any_work() {
    let folder_there = ["found a folder, needed a path for a regular file"];
    let file_there = ["found a file, needed a folder"];
    let in_place_of_files = [
        "derived/trials.parquet",
        "derived/checks.parquet",
        "derived/predictions.parquet",
        "derived/.lock",
        RECORD,
        "reports/index.html",
        "reports/fits.json",
        "reports/run.json",
    ];
    for name in in_place_of_files {
        let folder = Small::done();
        Damage::Folder.strike(&folder, name);
        let before = folder.results();
        let output = trilink(folder.path(), &["run", "--force"]);
        assert_says(&output, 2, &[name, folder_there[0]], name);
        assert!(!text(&output.stderr).contains("ingest 1/"), "{name}");
        assert_same(&folder.results(), &before, name);
    }
    for name in ["derived", "reports", "derived/poses", "derived/cycles", "reports/figures"] {
        let folder = Small::done();
        fs::remove_dir_all(folder.place(name)).unwrap();
        folder.write(name, "precious");
        let before = folder.results();
        let output = trilink(folder.path(), &["run"]);
        assert_says(&output, 2, &[name, file_there[0]], name);
        assert!(!text(&output.stderr).contains("ingest 1/"), "{name}");
        assert_eq!(folder.read(name), b"precious");
        assert_same(&folder.results(), &before, name);
    }
}

#[test]
fn a_folder_in_place_of_a_table_or_figure_is_reported_and_repaired_once_removed() {
    for name in ["derived/poses/kinematic-symmetric-5.00-r1.parquet", "reports/figures/fig17.svg"] {
        let folder = Small::done();
        Damage::Folder.strike(&folder, name);
        let output = trilink(folder.path(), &["run"]);
        assert_says(&output, 2, &[name, "cannot be written"], name);
        assert_nothing_half_written(folder.path());
        fs::remove_dir(folder.place(name)).unwrap();
        folder.run();
        assert_same(&folder.results(), &Small::done().results(), name);
    }
}

#[test]
fn stages_without_the_tables_before_them_say_which_command_makes_them() {
    for command in ["fit", "report"] {
        let folder = Small::raw();
        let output = trilink(folder.path(), &[command]);
        let named = ["trials.parquet", "does not exist", "`trilink ingest` creates it"];
        assert_says(&output, 2, &named, command);
    }
}

#[test]
fn trials_and_truth_that_cannot_be_read_are_named() {
    let cases: [(&str, Damage, i32, &[&str]); 6] = [
        ("raw/trials.toml", Damage::Gone, 2, &["this trial folder has no trials.toml"]),
        ("raw/trials.toml", Damage::Folder, 2, &["trials.toml: cannot be read"]),
        ("raw/trials.toml", Damage::Garbage, 2, &["trials.toml: cannot be read"]),
        ("raw/trials.toml", Damage::Empty, 2, &["trials.toml", "at least one [[trial]]"]),
        ("raw/truth.json", Damage::Half, 0, &["truth.json is ignored"]),
        ("raw/truth.json", Damage::Gone, 0, &[]),
    ];
    for (name, damage, status, named) in cases {
        let folder = Small::done();
        let before = folder.results();
        damage.strike(&folder, name);
        let what = format!("{name} {damage:?}");
        let output = trilink(folder.path(), &["run"]);
        assert_says(&output, status, named, &what);
        let expected = if status == 2 { before } else { folder.scratch() };
        assert_same(&folder.results(), &expected, &what);
    }
}

#[test]
fn unfinished_files_are_removed_even_if_everything_is_up_to_date() {
    let folder = Small::done();
    folder.run();
    let table = folder.read(&format!("derived/poses/{TRIAL}.parquet"));
    let left: [(&str, &[u8]); 4] = [
        ("derived/.writing-a1B2c3", b"half a"),
        ("derived/wheels/.writing-x", b""),
        ("reports/figures/.writing-y", b"<svg"),
        ("derived/poses/nobody.parquet", &table),
    ];
    for (name, bytes) in left {
        folder.write(name, bytes);
        let ahead = crate::common::succeed(folder.path(), &["run", "--dry-run"]);
        assert!(!ahead.is_empty(), "{name}");
        assert_says(&trilink(folder.path(), &["run"]), 0, &[], name);
        assert!(!folder.place(name).exists(), "{name}");
        assert_same(&folder.results(), &Small::done().results(), name);
    }
}

/// Runs the program with a file-size limit of `kib` KiB, which emulates a full disk: writing succeeds for a while and
/// then fails.
#[cfg(unix)]
fn with_little_room(folder: &Small, kib: u32) -> Output {
    let script = format!("trap '' XFSZ; ulimit -f {}; exec \"$0\" run --force", 2 * kib);
    Command::new("sh")
        .args(["-c", &script, env!("CARGO_BIN_EXE_trilink")])
        .current_dir(folder.path())
        .output()
        .unwrap()
}

#[cfg(unix)]
#[test]
fn a_full_disk_ends_the_run_with_earlier_results_in_place_and_whole() {
    for kib in [1, 16, 40, 90] {
        let folder = Small::done();
        let before = folder.results();
        let output = with_little_room(&folder, kib);
        assert_says(&output, 2, &["cannot be written"], &format!("{kib} KiB"));
        assert_nothing_half_written(folder.path());
        assert_same(&folder.results(), &before, "a full disk");
        folder.run();
        assert_same(&folder.results(), &before, "room again");
    }
}

#[cfg(unix)]
#[test]
fn folders_and_files_without_permission_are_named() {
    use std::os::unix::fs::PermissionsExt as _;
    let set = |folder: &Small, name: &str, mode: u32| {
        fs::set_permissions(folder.place(name), fs::Permissions::from_mode(mode)).unwrap();
    };
    let folder = Small::done();
    folder.run();
    for name in ["derived", "reports", "reports/figures"] {
        set(&folder, name, 0o555);
    }
    if fs::write(folder.place("derived/probe"), "").is_ok() {
        // A user with all permissions is not affected.
        for name in ["derived", "reports", "reports/figures"] {
            set(&folder, name, 0o755);
        }
        return;
    }
    let before = folder.results();
    // Everything is up to date, so nothing has to be written.
    assert_says(&trilink(folder.path(), &["run"]), 0, &[], "up to date");
    let output = trilink(folder.path(), &["run", "--force"]);
    assert_says(&output, 2, &["derived", "cannot be written"], "a read-only folder");
    assert_same(&folder.results(), &before, "a read-only folder");
    set(&folder, "derived", 0o755);
    let output = trilink(folder.path(), &["run", "--force"]);
    assert_says(&output, 2, &["reports", "cannot be written"], "a read-only folder");
    assert_same(&folder.results(), &before, "a read-only folder");
    for name in ["reports", "reports/figures"] {
        set(&folder, name, 0o755);
    }
    let file = format!("raw/{TRIAL}.csv");
    set(&folder, &file, 0o000);
    folder.write("derived/up-to-date.json", "");
    let output = trilink(folder.path(), &["run"]);
    assert_says(&output, 1, &[TRIAL, "cannot be read"], "an unreadable file");
    set(&folder, &file, 0o644);
    folder.run();
    assert_same(&folder.results(), &before, "readable again");
}

#[test]
fn a_table_that_another_program_wrote_is_read_or_named_but_never_taken_for_the_last_one() {
    let folder = Small::done();
    let before = folder.results();
    // Write the table with another provenance, as a script may do.
    let table = Table::read(&folder.place("derived/fits.parquet")).unwrap();
    let provenance = trilink_tables::Provenance { input: "a script".to_owned() };
    table.write(&folder.place("derived/fits.parquet"), &provenance).unwrap();
    let output = trilink(folder.path(), &["run", "--explain"]);
    assert_says(&output, 0, &["fits.parquet has changed since it was written"], "a script's table");
    assert_same(&folder.results(), &before, "a script's table");
}

#[test]
fn a_table_of_which_a_bit_was_changed_is_refused_wherever_it_is_read() {
    let folder = Small::done();
    let simulate = "simulate kinematic-symmetric --model skid --omega 5 --fitted --csv";
    let cases = [
        ("derived/fits.parquet", "inspect fits"),
        ("derived/fits.parquet", "inspect fits --schema"),
        ("derived/fits.parquet", "report"),
        ("derived/fits.parquet", simulate),
        ("derived/trials.parquet", "fit"),
    ];
    for (name, command) in cases {
        let whole = folder.read(name);
        // Damage rows, the header of a page, the description of the columns, and the metadata.
        for place in [4, 5, 700, whole.len() / 2, whole.len() - 100, whole.len() - 6] {
            let mut damaged = whole.clone();
            damaged[place] ^= 1;
            folder.write(name, damaged);
            let line: Vec<&str> = command.split(' ').collect();
            let output = trilink(folder.path(), &line);
            let file = Path::new(name).file_name().and_then(|file| file.to_str()).unwrap();
            assert_says(&output, 2, &[file, "damaged"], &format!("{command}, {place}"));
        }
        folder.write(name, whole);
    }
}
