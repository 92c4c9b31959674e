//! What decides whether a stage's own source has changed: `build.rs` on the program itself and on
//! a made-up crate.

#![allow(clippy::unwrap_used)]

#[allow(dead_code)]
#[path = "../build.rs"]
mod build;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::process::Command;

use build::{closure, source_hash};

#[test]
fn a_stage_s_source_is_its_room_and_the_rooms_that_it_uses() {
    let rooms = |stage: &str| -> Vec<String> {
        closure(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), stage).into_keys().collect()
    };
    let has = |stage: &str, room: &str| rooms(stage).iter().any(|name| name == room);
    for room in ["ingest", "config", "robot", "store", "trial", "vicon"] {
        assert!(has("ingest", room), "{room}");
    }
    // A changed line of the search or of the motion redoes fits and no trial.
    for room in ["motion", "fit", "report", "build", "cli", "synth"] {
        assert!(!has("ingest", room), "{:?}", rooms("ingest"));
    }
    for room in ["fit", "motion", "robot", "store"] {
        assert!(has("fit", room), "{room}");
    }
    for room in ["ingest", "report", "build", "cli"] {
        assert!(!has("fit", room), "{:?}", rooms("fit"));
    }
    assert!(has("compare", "report"), "{:?}", rooms("compare"));
    for room in ["build", "cli", "fit", "ingest"] {
        assert!(!has("compare", room), "{:?}", rooms("compare"));
    }
    for room in ["build", "cli", "compare"] {
        assert!(!has("report", room), "{:?}", rooms("report"));
    }
}

#[test]
fn only_lines_that_are_compiled_into_a_stage_change_its_hash() {
    let home = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = home.path().join("src").join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    };
    write("fit/mod.rs", "mod search;\nuse crate::motion::Solver;\n");
    write("fit/search.rs", "fn search() -> f64 {\n    super::super::stats::mean()\n}\n");
    write("motion.rs", "pub struct Solver(crate::{robot::Robot});\n");
    write(
        "robot/mod.rs",
        "pub struct Robot(&'static str);\nconst A: &str = include_str!(\"a.txt\");\n",
    );
    write("robot/a.txt", "one");
    write("stats.rs", "pub fn mean() -> f64 {\n    1.0\n}\n");
    write("vicon.rs", "pub fn read() {}\n");
    let hash = || source_hash(home.path(), "fit");
    let first = hash();
    assert_eq!(first.len(), 32);
    let same = |name: &str, text: &str| {
        write(name, text);
        assert_eq!(hash(), first, "{name}: {text}");
    };
    same("vicon.rs", "pub fn read() { /* another room */ }\n");
    same(
        "motion.rs",
        "// A comment, and other ends of lines.\r\npub struct Solver(crate::{robot::Robot});\r\n",
    );
    let tested =
        "#[cfg(test)]\nmod tests {\n    use crate::vicon;\n}\n#[cfg(test)]\nmod made_up;\n";
    same("fit/mod.rs", &format!("mod search;\nuse crate::motion::Solver;\n{tested}"));
    same("fit/made_up.rs", "fn only_for_tests() {}\n");
    let other = |name: &str, text: &str| {
        let path = home.path().join("src").join(name);
        let before = fs::read_to_string(&path).unwrap();
        write(name, text);
        assert_ne!(hash(), first, "{name}: {text}");
        write(name, &before);
        assert_eq!(hash(), first, "{name}");
    };
    other("fit/search.rs", "fn search() -> f64 {\n    2.0 * super::super::stats::mean()\n}\n");
    other("motion.rs", "pub struct Solver(crate::{robot::Robot}, u8);\n");
    other("robot/a.txt", "two");
    other("stats.rs", "pub fn mean() -> f64 {\n    2.0\n}\n");
    fs::write(home.path().join("Cargo.lock"), "version = 4\n").unwrap();
    assert_ne!(hash(), first);
}

/// What sources and tests name by a path is in the crate that `cargo package` makes.
#[test]
fn what_sources_and_tests_read_is_packed() {
    let home = Path::new(env!("CARGO_MANIFEST_DIR"));
    if home.join("Cargo.toml.orig").exists() {
        // This is that crate.
        return;
    }
    let list = ["package", "--list", "--allow-dirty", "--offline", "--quiet"];
    let list = Command::new(env!("CARGO")).args(list).current_dir(home).output().unwrap();
    let list = String::from_utf8(list.stdout).unwrap();
    let packed: BTreeSet<&Path> = list.lines().map(Path::new).collect();
    let of = |file: &&&Path| file.extension().is_some_and(|extension| extension == "rs");
    let mut count = 0;
    for file in packed.iter().filter(of) {
        let text = fs::read_to_string(home.join(file)).unwrap();
        let literals = text.lines().flat_map(|line| line.split('"').skip(1).step_by(2));
        for named in literals.filter(|named| !named.is_empty() && !named.starts_with('/')) {
            for folder in [Path::new(""), file.parent().unwrap()] {
                let path = plain(&folder.join(named));
                let is_made = ["derived", "raw", "reports", "target"].iter();
                let is_made = is_made.map(Path::new).any(|made| path.starts_with(made));
                if home.join(&path).is_file() && !is_made {
                    count += 1;
                    assert!(packed.contains(&*path), "{} of {}", path.display(), file.display());
                }
            }
        }
    }
    assert!(count > 50, "{count}");
}

/// A path without `..`, as far as it stays below where it begins.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir if plain.pop() => {}
            other => plain.push(other),
        }
    }
    plain
}
