//! Tests that change every key of `pipeline.toml` in turn: a run after the change gives the same bytes as a run from
//! scratch, and a second run has nothing to do.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use toml::{Table, Value};
use trilink::build::{Finished, RerunOptions, run};
use trilink_tables::config::Config;

use crate::common::{SMALL, Small, assert_same, succeed};

/// Changed values of those keys for which an automatically chosen value would be invalid.
const OTHERS: [(&str, &str); 14] = [
    ("vicon.unit", "\"cm\""),
    ("vicon.ignore", "[\"V_*\"]"),
    ("ingest.poses", "\"links\""),
    ("ingest.smoothing", "\"kalman\""),
    ("ingest.smoothing_window", "9"),
    ("report.width_mm", "90"),
    ("fit.sigma", "\"raw\""),
    ("fit.gait_input", "\"commanded\""),
    ("fit.robot_parameters", "\"measured\""),
    ("campaign.kinematic-symmetric.robot", "\"semi-passive\""),
    ("campaign.kinematic-symmetric.gait", "\"skewed\""),
    ("campaign.kinematic-symmetric.models", "[\"skid\", \"no-skid\"]"),
    ("campaign.kinematic-symmetric.free.skid", "[\"skid1\", \"skid2\"]"),
    // Lists of numbers may contain integers, too.
    ("fit.seed", "2"),
];

/// Creates a folder with a few short trials and all results.
fn base() -> Small {
    let folder = Small(tempfile::tempdir().unwrap());
    let start = SMALL.find("[campaign.kinematic-skewed]").unwrap();
    let small = SMALL[..start].replace("\"skid-roll\"", "\"skid\"").replace("= 3\n", "= 2\n");
    folder.write(
        "pipeline.toml",
        small + "[campaign.kinematic-symmetric.free]\nskid = [\"skid0\"]\n",
    );
    succeed(folder.path(), &["-q", "synth", "raw", "--omega", "5,6", "--seed", "1"]);
    // The file contains all keys.
    let mut config = Config::load(&folder.place("pipeline.toml")).unwrap();
    let paths = &mut config.paths;
    let others = [&mut paths.derived, &mut paths.reports, &mut paths.history];
    for path in paths.raw.iter_mut().chain(others) {
        *path = path.strip_prefix(folder.path()).unwrap().to_owned();
    }
    folder.write("pipeline.toml", toml::to_string(&config).unwrap());
    rerun(&folder);
    folder
}

fn rerun(folder: &Small) -> Finished {
    let config = Config::load(&folder.place("pipeline.toml")).unwrap();
    run(&config, RerunOptions::default(), false, &()).unwrap()
}

/// Returns the dotted names of all keys that have a value, except those for paths.
fn keys(table: &Table, prefix: &str) -> Vec<String> {
    let key = |(name, value): (&String, &Value)| match value {
        Value::Table(inner) => keys(inner, &format!("{prefix}{name}.")),
        _ => vec![format!("{prefix}{name}")],
    };
    table.iter().flat_map(key).filter(|key| !key.starts_with("paths.")).collect()
}

fn changed(key: &str, value: &Value) -> Value {
    if let Some((_, text)) = OTHERS.iter().find(|(name, _)| *name == key) {
        return format!("value = {text}").parse::<Table>().unwrap()["value"].clone();
    }
    if key.starts_with("model.") {
        return of_model(value);
    }
    match value {
        Value::Boolean(value) => (!value).into(),
        Value::Integer(value) => (value + 1).into(),
        Value::Float(value) => (value * 1.1 + 0.1).into(),
        Value::Array(values) => {
            let mut values = values.clone();
            values[0] = changed(key, &values[0]);
            values.into()
        }
        other => panic!("{key}: no other value is known for {other}"),
    }
}

/// Returns a value other than `value` for a key of a model, so that the model's free parameters stay valid.
fn of_model(value: &Value) -> Value {
    match value {
        Value::Array(free) if free.len() > 1 => vec![free[1].clone()].into(),
        Value::Array(_) => vec!["stiffness"].into(),
        law => match law.as_str().unwrap() {
            "constrained" => "viscous",
            "viscous" | "coulomb" => "coulomb-viscous",
            "coulomb-viscous" => "stribeck-viscous",
            "none" => "viscous",
            "commanded" => "measured",
            _ => "commanded",
        }
        .into(),
    }
}

/// Returns the configuration file with another value for a key.
fn with_change(table: &Table, key: &str) -> String {
    let mut table = table.clone();
    let (parents, name) = key.rsplit_once('.').unwrap();
    let mut inner = &mut table;
    for parent in parents.split('.') {
        inner = inner[parent].as_table_mut().unwrap();
    }
    let other = changed(key, &inner[name]);
    assert_ne!(other, inner[name], "{key}");
    inner.insert(name.to_owned(), other);
    toml::to_string(&table).unwrap()
}

/// Removes the results in a folder and returns the results of a new run in the same folder, whose path appears in
/// messages.
fn scratch(folder: &Small) -> BTreeMap<PathBuf, Vec<u8>> {
    for made in ["derived", "reports"] {
        std::fs::remove_dir_all(folder.place(made)).unwrap();
    }
    rerun(folder);
    folder.results()
}

#[test]
fn every_key_changed_in_turn_gives_the_bytes_of_a_run_from_scratch() {
    let base = base();
    let before = base.results();
    let text = String::from_utf8(base.read("pipeline.toml")).unwrap();
    let table: Table = text.parse().unwrap();
    let keys = keys(&table, "");
    assert!(keys.len() > 120, "{}", keys.len());
    for (known, _) in OTHERS {
        assert!(keys.iter().any(|key| key == known), "there is no key {known}");
    }
    keys.par_iter().with_max_len(1).for_each(|key| {
        let folder = base.copy();
        folder.write("pipeline.toml", with_change(&table, key));
        let finished = rerun(&folder);
        assert!(!finished.was_up_to_date, "{key}: the page prints the configuration");
        let mut results = folder.results();
        assert!(rerun(&folder).was_up_to_date, "{key}");
        if ["compare.", "optimise."].iter().any(|of| key.starts_with(of)) {
            // No stage reads this key, but the page prints it.
            assert!(finished.stages.iter().all(|stage| stage.redone.is_empty()), "{key}");
            let page = Path::new("reports/index.html");
            results.insert(page.to_owned(), before[page].clone());
            assert_same(&results, &before, key);
        } else {
            assert_same(&results, &scratch(&folder), key);
        }
    });
    assert!(rerun(&base).was_up_to_date);
}
