//! What decides whether a stage's own source has changed: `build.rs` on this workspace.

#[allow(dead_code)]
#[path = "../../build.rs"]
mod build;

use std::fs;
use std::path::Path;

use build::Packages;

fn packages() -> Packages {
    Packages::new(&fs::read_to_string("Cargo.lock").unwrap())
}

#[test]
fn a_stage_is_its_crate_and_those_that_it_depends_on() {
    if !Path::new("crates").is_dir() {
        // A packed source has them from the registry.
        return;
    }
    let packages = packages();
    let has = |stage: &str, name: &str| {
        packages.closure(Path::new("."), stage).iter().any(|package| package == name)
    };
    for name in ["trilink-robot", "trilink-mocap", "trilink-tables", "polars", "nalgebra"] {
        assert!(has("trilink-ingest", name), "{name}");
    }
    // A change of the solver or of the report redoes no trial, nor does a crate that only tests use.
    for name in ["trilink-mechanics", "trilink-fit", "trilink-report", "trilink-synth", "clap"] {
        assert!(!has("trilink-ingest", name), "{name}");
    }
    assert!(has("trilink-fit", "trilink-mechanics"));
    for name in ["trilink-ingest", "trilink-report", "trilink-plot", "clap"] {
        assert!(!has("trilink-fit", name), "{name}");
    }
    assert!(has("trilink-report", "trilink-plot") && !has("trilink-report", "trilink-fit"));
}

#[test]
fn a_changed_source_changes_the_hash_of_the_stages_that_use_it_alone() {
    let home = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = home.path().join("crates").join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    };
    write("low/Cargo.toml", "[dependencies]\nwide = '1'\n[dev-dependencies]\ninsta = '1'\n");
    write("low/src/lib.rs", "pub fn one() {}\n");
    write("high/Cargo.toml", "[dependencies]\ntrilink-low = '1'\n");
    write("high/src/lib.rs", "pub fn two() {}\n");
    let lock = |wide: &str, insta: &str| {
        let package = |name: &str, rest: &str| format!("[[package]]\nname = '{name}'\n{rest}\n");
        package("trilink-low", "version = '0.1.0'\ndependencies = ['wide', 'insta']")
            + &package("trilink-high", "version = '0.1.0'\ndependencies = ['trilink-low']")
            + &package("wide", &format!("version = '{wide}'\nchecksum = '0f'"))
            + &package("insta", &format!("version = '{insta}'\nchecksum = '1f'"))
    };
    let hashes = |lock: &str| {
        let packages = Packages::new(lock);
        ["trilink-low", "trilink-high"].map(|name| packages.source_hash(home.path(), name).0)
    };
    let before = hashes(&lock("1.0.0", "1.0.0"));
    let differ = |now: [u128; 2]| [0, 1].map(|i| now[i] != before[i]);
    assert_eq!(differ(hashes(&lock("1.0.0", "2.0.0"))), [false, false]);
    assert_eq!(differ(hashes(&lock("1.0.1", "1.0.0"))), [true, true]);
    write("high/src/lib.rs", "pub fn three() {}\n");
    assert_eq!(differ(hashes(&lock("1.0.0", "1.0.0"))), [false, true]);
    write("high/src/lib.rs", "pub fn two() {}\r\n");
    write("low/src/tests.rs", "fn test() {}\n");
    assert_eq!(differ(hashes(&lock("1.0.0", "1.0.0"))), [false, false]);
    write("low/src/lib.rs", "pub fn other() {}\n");
    assert_eq!(differ(hashes(&lock("1.0.0", "1.0.0"))), [true, true]);
}
