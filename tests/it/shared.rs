//! Tests of shared fits, each to several campaigns: when commands compute them, retain them and recompute them.

use trilink_robot::Quantity;
use trilink_tables::{Columns as _, SharedFitRow, Table};

use crate::common::{Small, assert_same, succeed, temporary, text, trilink};

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
            .contains("Shared fits: one set of coefficients for several campaigns?")
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

#[test]
fn robots_with_a_common_wheel_are_fitted_together_from_synth_to_report() {
    let folder = temporary();
    let config = folder.path().join("pipeline.toml");
    let named = |robot: &str| robot.replacen("wheel_m =", "wheel = \"front wheel\"\nwheel_m =", 1);
    let robots = [
        include_str!("../../docs/robots/twistcar.toml"),
        include_str!("../../docs/robots/roller-racer.toml"),
    ];
    let robots = robots.map(named).concat().replace("[\"skid\", \"skid-roll\"]", "[\"skid-roll\"]");
    let fit = "[fit]\nstarts = 1\nbootstrap = 0\nprofiles = false\n[fit.shared]\nrobot = [\"twistcar\", \"racer\"]\n";
    std::fs::write(&config, robots + fit).unwrap();
    succeed(folder.path(), &["synth", "raw/practice", "--omega", "3,3.5,4,4.5,5"]);
    let said = succeed(folder.path(), &["run", "raw/practice"]);
    let wheel = "twistcar front = racer handlebar";
    let line = said.lines().find(|line| line.starts_with("twistcar and racer skid-roll: "));
    assert!(line.is_some_and(|line| line.contains(&format!("skid0_kg_s ({wheel})"))), "{said}");
    let table = Table::read(&folder.path().join("derived/shared_fits.parquet")).unwrap();
    let rows = SharedFitRow::from_table(&table).unwrap();
    let [row] = &rows[..] else { panic!("{rows:?}") };
    assert_eq!(row.wheels, [wheel, "twistcar rear", "racer seat"]);
    for (parameter, planted) in Quantity::Skid.of_each().into_iter().zip([50.0, 100.0, 100.0]) {
        let found = row.fit.parameters[parameter];
        assert!((found / planted - 1.0_f64).abs() < 0.1, "{parameter} = {found}, not {planted}");
    }
    let page = std::fs::read_to_string(folder.path().join("reports/index.html")).unwrap();
    for expected in [
        "<h3>Robots twistcar and racer: racer, twistcar</h3>",
        "Wheels: twistcar front = racer handlebar; twistcar rear; racer seat.",
        "Skid, racer seat",
    ] {
        assert!(page.contains(expected), "{expected}");
    }
    // Only the report, which shows the configuration, contains the names.
    let text = std::fs::read_to_string(&config).unwrap();
    std::fs::write(&config, text.replace("front wheel", "roller")).unwrap();
    let dry_run = ["run", "raw/practice", "--dry-run", "--explain"];
    let ahead = succeed(folder.path(), &dry_run);
    assert!(["trial ", "fit ", "shared fit "].iter().all(|kind| !ahead.contains(kind)), "{ahead}");
    let text = std::fs::read_to_string(&config).unwrap();
    std::fs::write(&config, text.replacen("roller", "other", 1)).unwrap();
    let refused = trilink(folder.path(), &dry_run);
    assert_eq!(refused.status.code(), Some(2), "{refused:?}");
}
