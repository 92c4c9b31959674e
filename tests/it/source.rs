//! Tests of the source hashes of the stages: `build.rs` applied to this workspace.

#[allow(dead_code)]
#[path = "../../build.rs"]
mod build;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use build::Packages;

fn packages() -> Packages {
    Packages::new(&fs::read_to_string("Cargo.lock").unwrap())
}

#[test]
fn a_stage_is_its_crate_and_those_that_it_depends_on() {
    if !Path::new("crates").is_dir() {
        // In a packaged crate, the workspace crates come from the registry.
        return;
    }
    let packages = packages();
    let has = |stage: &str, name: &str| {
        packages.closure(Path::new("."), stage).iter().any(|package| package == name)
    };
    for name in ["trilink-robot", "trilink-mocap", "trilink-tables", "polars", "nalgebra"] {
        assert!(has("trilink-ingest", name), "{name}");
    }
    // A change to the solver, to the report, or to a crate that only tests use makes no trial stale.
    for name in ["trilink-mechanics", "trilink-fit", "trilink-report", "trilink-synth", "clap"] {
        assert!(!has("trilink-ingest", name), "{name}");
    }
    assert!(has("trilink-fit", "trilink-mechanics"));
    for name in ["trilink-ingest", "trilink-mocap", "trilink-report", "trilink-plot", "clap"] {
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
    let workspace = |features: &str| {
        write(
            "../Cargo.toml",
            &format!(
                "[workspace.dependencies]\nwide = {{ version = '1', features = [{features}] }}\n"
            ),
        );
    };
    workspace("");
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
    workspace("'std'");
    assert_eq!(differ(hashes(&lock("1.0.0", "1.0.0"))), [true, true]);
    workspace("");
    write("high/assets/font.ttf", "a font");
    assert_eq!(differ(hashes(&lock("1.0.0", "1.0.0"))), [false, true]);
    fs::remove_dir_all(home.path().join("crates/high/assets")).unwrap();
    write("high/Cargo.toml", "[dependencies.trilink-low]\nversion = '1'\nfeatures = ['more']\n");
    assert_eq!(differ(hashes(&lock("1.0.0", "1.0.0"))), [false, true]);
    let described = "[package]\ndescription = 'High'\n[dependencies]\ntrilink-low = '1'\n";
    write("high/Cargo.toml", described);
    write("high/src/lib.rs", "pub fn three() {}\n");
    assert_eq!(differ(hashes(&lock("1.0.0", "1.0.0"))), [false, true]);
    write("high/src/lib.rs", "pub fn two() {}\r\n");
    write("low/src/tests.rs", "fn test() {}\n");
    assert_eq!(differ(hashes(&lock("1.0.0", "1.0.0"))), [false, false]);
    write("low/src/lib.rs", "pub fn other() {}\n");
    assert_eq!(differ(hashes(&lock("1.0.0", "1.0.0"))), [true, true]);
}

#[test]
fn every_crate_depends_on_those_of_the_architecture_s_table_alone() {
    if !Path::new("crates").is_dir() {
        return;
    }
    let document = fs::read_to_string("docs/architecture.md").unwrap();
    let rows = document.lines().filter_map(|line| line.strip_prefix("| `")?.split_once('`'));
    let listed = |text: &str| -> BTreeSet<String> {
        text.split('`').skip(1).step_by(2).map(|name| format!("trilink-{name}")).collect()
    };
    let table: BTreeMap<String, BTreeSet<String>> = rows
        .map_while(|(name, rest)| Some((name.to_owned(), listed(rest.rsplit('|').nth(1)?))))
        .take_while(|(name, _)| name != "trilink")
        .collect();
    let mut found = BTreeMap::new();
    for folder in fs::read_dir("crates").unwrap() {
        let folder = folder.unwrap();
        let manifest = fs::read_to_string(folder.path().join("Cargo.toml")).unwrap();
        let manifest: toml::Table = manifest.parse().unwrap();
        let dependencies = manifest.get("dependencies").and_then(|table| table.as_table());
        let names = dependencies.into_iter().flatten().map(|(name, _)| name.clone());
        let own = names.filter(|name| name.starts_with("trilink-")).collect::<BTreeSet<_>>();
        found.insert(folder.file_name().into_string().unwrap(), own);
    }
    assert_eq!(table, found);
}
