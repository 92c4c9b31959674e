//! Tests of fits to several campaigns of one robot: made, retained and recomputed by commands.

use crate::common::{Small, assert_same, succeed, text, trilink};

/// Creates a project with two campaigns of one robot that share a model.
fn project() -> Small {
    let folder = Small::raw();
    folder.replace("pipeline.toml", "models = [\"skid\"]", "models = [\"skid-roll\"]");
    folder
}

const ASK: &str = "[fit.shared]\nrobot = \"kinematic\"\n";
const BEFORE: &str = "[campaign.kinematic-symmetric]";

fn ask(folder: &Small) {
    folder.replace("pipeline.toml", BEFORE, &format!("{ASK}{BEFORE}"));
}

#[test]
fn shared_fits_are_made_retained_and_recomputed() {
    let folder = project();
    folder.run();
    let before = folder.results();
    ask(&folder);
    let ahead = succeed(folder.path(), &["run", "--dry-run", "--explain"]);
    assert!(ahead.contains("shared fit kinematic skid-roll: new\n"), "{ahead}");
    assert!(!ahead.lines().any(|line| line.starts_with("fit ")), "{ahead}");
    let said = folder.run();
    let line = said.lines().find(|line| line.starts_with("kinematic skid-roll: "));
    assert!(
        line.is_some_and(|line| line.contains("is not known") && line.contains("blocks")),
        "{said}"
    );
    assert_same(&folder.results(), &folder.scratch(), "asked for");
    assert!(
        text(&folder.read("reports/index.html"))
            .contains("Joint fits: one friction law for all campaigns of a robot?")
    );
    assert_eq!(succeed(folder.path(), &["run", "--dry-run", "--explain"]), "");
    folder.replace("pipeline.toml", "weights = { d = 10.0", "weights = { d = 9.0");
    let ahead = succeed(folder.path(), &["run", "--dry-run", "--explain"]);
    let why =
        "kinematic-symmetric skid-roll.campaign.kinematic-symmetric.weights.d changed: 10.0 to 9.0";
    assert!(ahead.contains("shared fit kinematic skid-roll: "), "{ahead}");
    assert!(ahead.contains(why), "{ahead}");
    folder.run();
    assert_same(&folder.results(), &folder.scratch(), "redone");
    folder.replace("pipeline.toml", "weights = { d = 9.0", "weights = { d = 10.0");
    folder.replace("pipeline.toml", ASK, "");
    folder.run();
    assert_same(&folder.results(), &before, "not asked for any more");
}

#[test]
fn merged_shards_of_replicates_have_the_bytes_of_one_fit_with_shared_fits() {
    let folder = project();
    ask(&folder);
    succeed(folder.path(), &["-q", "ingest"]);
    let one = folder.copy();
    succeed(one.path(), &["-q", "--threads", "1", "fit"]);
    for numbers in ["0..2", "2..3"] {
        succeed(folder.path(), &["fit", "--replicates", numbers, "--into", "shards"]);
    }
    succeed(folder.path(), &["merge", "shards"]);
    assert_same(&folder.results(), &one.results(), "merged");
}

#[test]
fn a_robot_without_common_models_is_an_error() {
    for (robot, needed) in [
        ("\"kinematik\"", "did you mean `kinematic`?"),
        ("[]", "at least one robot"),
        ("[\"kinematic\", \"kinematic\"]", "each robot once"),
        ("\"semi-passive\"", "a robot with at least two campaigns"),
        ("\"kinematic\"", "a robot whose campaigns all list the same model with a free"),
        ("3", "the name of a robot or a list of names"),
    ] {
        // The robot's campaigns have no common model.
        let folder = Small::raw();
        ask(&folder);
        folder.replace("pipeline.toml", "robot = \"kinematic\"", &format!("robot = {robot}"));
        let output = trilink(folder.path(), &["run", "--dry-run"]);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(needed), "{said}");
        assert!(robot == "3" || said.contains("`fit.shared.robot`"), "{said}");
    }
}
