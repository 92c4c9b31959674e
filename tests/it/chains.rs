//! Tests of robots that are chains: `simulate`, and the notices of the other commands.

use std::path::Path;

use serde_json::Value;
use trilink_tables::Table;

use crate::common::{succeed, text, trilink};

fn gallery() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/robots")
}

/// Returns a folder with a robot of the gallery as its configuration.
fn folder_of(robot: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let from = gallery().join(robot);
    std::fs::copy(from, folder.path().join("pipeline.toml")).expect("the robot is there");
    folder
}

#[test]
fn every_robot_of_the_gallery_moves_steadily_and_is_short() {
    let mut robots = 0;
    for entry in std::fs::read_dir(gallery()).expect("the gallery is there") {
        let path = entry.expect("an entry").path();
        let file = std::fs::read_to_string(&path).expect("a text");
        assert!(file.lines().count() < 60, "{}", path.display());
        // Each file begins with the command that simulates it.
        let command = file.lines().find_map(|line| line.strip_prefix("#     trilink "));
        let mut arguments: Vec<&str> = command.expect("a command").split_whitespace().collect();
        arguments.push("--json");
        let answers: Vec<Value> =
            serde_json::from_str(&succeed(&gallery(), &arguments)).expect("an array");
        assert!(answers.len() >= 2, "{arguments:?}");
        for answer in answers {
            let number = |name: &str| answer[name].as_f64().unwrap_or(f64::NAN);
            let is_stable = ["stable", "symmetry-broken"].iter().any(|of| answer["status"] == *of);
            let is_right = is_stable && number("d_m") > 1e-3 && number("work_j") > 0.0;
            assert!(is_right && number("floquet") < 1.0, "{}: {answer}", path.display());
            let links = answer["links"].as_array().expect("a list").len();
            assert_eq!(answer["sigma"].as_array().map(Vec::len), Some(links));
            assert!(number(&format!("alpha{}_rad", links - 1)) > 0.0, "{answer}");
        }
        robots += 1;
    }
    assert_eq!(robots, 6);
}

#[test]
fn a_chain_of_the_three_links_moves_as_the_robot_that_it_describes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let own = include_str!("../../pipeline.toml");
    let side =
        "mass_kg = 0.34, inertia_kg_m2 = 5.9e-4, wheel_m = 0, skid_kg_s = 200, roll_kg_s = 0.3";
    let chain = format!(
        "[robot.chain]\n\
         joints = [{{ kind = \"spring\", stiffness_nm_rad = 0.137, damping_nm_s_rad = 0.006 }}, {{ kind = \"driven\" }}]\n\
         links = [\n\
         {{ rear_joint_m = 0.112, com_m = -0.054, {side} }},\n\
         {{ front_joint_m = 0.144, rear_joint_m = 0.144, mass_kg = 1.04, inertia_kg_m2 = 86e-4, wheel_m = 0, \
            skid_kg_s = 400, roll_kg_s = 0.6 }},\n\
         {{ front_joint_m = 0.112, com_m = 0.054, {side} }},\n]\n\
         [campaign.chain]\nrobot = \"chain\"\ngait = \"passive-symmetric\"\n"
    );
    std::fs::write(folder.path().join("pipeline.toml"), format!("{own}{chain}")).unwrap();
    let solve = |campaign: &str| -> Vec<Value> {
        let arguments = ["simulate", campaign, "--model", "skid-roll", "--omega", "2,4", "--json"];
        serde_json::from_str(&succeed(folder.path(), &arguments)).expect("an array")
    };
    for (own, chain) in solve("semi-passive-symmetric").iter().zip(&solve("chain")) {
        assert_eq!(chain["links"], Value::from(vec!["middle", "front", "rear"]));
        for name in ["d_m", "v_m_s", "alpha1_rad", "floquet", "work_j", "cost_of_transport"] {
            let [own, chain] = [own, chain].map(|of| of[name].as_f64().expect(name));
            assert!((own - chain).abs() <= 1e-6 * own.abs(), "{name}: {own} {chain}");
        }
        for i in 0..3 {
            let [own, chain] = [own, chain].map(|of| of["sigma"][i].as_f64().expect("a number"));
            assert!((own - chain).abs() <= 1e-6 * own, "sigma{i}: {own} {chain}");
        }
        for name in ["status", "from_rest", "cycles_to_settle"] {
            assert_eq!(own[name], chain[name], "{name}");
        }
    }
}

#[test]
fn columns_are_numbered_from_the_reference_link() {
    let folder = folder_of("passive-snake.toml");
    let arguments = ["simulate", "passive", "--model", "skid-roll", "--omega", "4"];
    let csv = trilink(folder.path(), &[&arguments[..], &["--csv"]].concat());
    let table = text(&csv.stdout);
    let mut lines = table.lines();
    assert_eq!(
        lines.next(),
        Some(
            "model,omega_rad_s,status,d_m,v_m_s,dtheta_rad,sigma0,sigma1,sigma2,sigma3,alpha2_rad,alpha3_rad,floquet,\
             work_j,work_j_m,cost_of_transport,from_rest,cycles_to_settle,reason"
        )
    );
    // The fin has no wheel.
    let row: Vec<&str> = lines.next().expect("a row").split(',').collect();
    assert!(row[8].parse::<f64>().is_ok() && row[9].is_empty(), "{row:?}");
    let legend = "links: 0 = body, 1 = head, 2 = tail, 3 = fin (no wheel)";
    assert!(text(&csv.stderr).contains(legend), "{}", text(&csv.stderr));
    let printed = succeed(folder.path(), &arguments);
    assert!(printed.contains(legend) && printed.contains("stable"), "{printed}");
    let rested = succeed(folder.path(), &[&arguments[..], &["--from-rest"]].concat());
    assert!(rested.contains("reached from rest"), "{rested}");

    let cycle = ["--trajectory", "cycle.parquet", "--samples", "60"];
    succeed(folder.path(), &[&arguments[..], &cycle].concat());
    let table = Table::read(&folder.path().join("cycle.parquet")).expect("a table");
    assert_eq!(table.len(), 61);
    let column = |name: &str| {
        let column = table.frame.column(name).expect(name).f64().expect("numbers");
        column.iter().map(|value| value.unwrap_or(f64::NAN)).collect::<Vec<f64>>()
    };
    assert!(column("skid3_m_s").iter().all(|value| value.is_nan()));
    let is_periodic = |name: &str| (column(name)[0] - column(name)[60]).abs() < 1e-6;
    assert!(is_periodic("skid1_m_s") && is_periodic("phi3_rad") && is_periodic("torque1_nm"));
    let driven = column("phi1_rad");
    assert!((driven[0] - 30_f64.to_radians()).abs() < 1e-12, "{}", driven[0]);
}

#[test]
fn sensitivities_to_the_numbers_of_a_chain_are_differences_of_its_motions() {
    let folder = folder_of("passive-snake.toml");
    let simulate = |options: &[&str]| -> Vec<Value> {
        let common = ["simulate", "passive", "--model", "skid-roll", "--omega", "4", "--json"];
        let output = succeed(folder.path(), &[&common[..], options].concat());
        serde_json::from_str(&output).expect("an array")
    };
    let rows = simulate(&["--sensitivities"]);
    for name in ["joint2.stiffness_nm_rad", "joint1.amplitude_deg"] {
        let of = |row: &&Value| row["parameter"] == name && row["metric"] == "d_m";
        let row = rows.iter().find(of).expect("a row");
        let number = |key: &str| row[key].as_f64().expect("a number");
        let value = number("parameter_value");
        let step = 1e-3 * value;
        let [low, high] = [value - step, value + step].map(|value| {
            simulate(&["--set", &format!("{name}={value}")])[0]["d_m"].as_f64().expect("a number")
        });
        let known = (high - low) / (2.0 * step);
        assert!((number("derivative") / known - 1.0).abs() < 1e-4, "{row}, {known}");
    }
}

#[test]
fn the_transient_of_a_chain_comes_before_its_steady_cycle() {
    let folder = folder_of("twistcar.toml");
    let simulate = ["simulate", "twistcar", "--model", "skid-roll", "--omega", "4"];
    let options = ["--samples", "16", "--from-rest", "--trajectory", "rest.parquet"];
    succeed(folder.path(), &[&simulate[..], &options].concat());
    let table = Table::read(&folder.path().join("rest.parquet")).expect("a table");
    let answer = succeed(folder.path(), &[&simulate[..], &["--json"]].concat());
    let answers: Vec<Value> = serde_json::from_str(&answer).expect("an array");
    let cycles = answers[0]["cycles_to_settle"].as_u64().expect("a number") as usize;
    assert_eq!(table.len(), 16 * (cycles + 1) + 1);
}

#[test]
fn options_and_commands_that_do_not_support_chains_say_so() {
    let folder = folder_of("twistcar.toml");
    let refused = |arguments: &[&str], expected: &str| {
        let output = trilink(folder.path(), arguments);
        let error = text(&output.stderr);
        assert!(error.contains(expected) && !error.contains("panicked"), "{arguments:?}: {error}");
        output.status.code()
    };
    let simulate = ["simulate", "twistcar", "--model", "skid-roll", "--omega", "4"];
    for (options, named) in [
        (&["--fitted", "--bands"][..], "--fitted"),
        (&["--page", "motion.html"], "--page"),
        (&["--sensitivities", "--monte-carlo"], "--monte-carlo"),
    ] {
        let message = format!(
            "{named}: is not available for robots that are chains, such as that of campaign twistcar"
        );
        let status = refused(&[&simulate[..], options].concat(), &message);
        assert_eq!(status, Some(2), "{options:?}");
    }
    for (setting, expected) in [
        ("rear.mas_kg=1", "the robot has no number `rear.mas_kg`; did you mean `rear.mass_kg`?"),
        ("rear.mass_kg=-1", "`mass_kg` of link `rear` must be a positive number, not -1"),
        ("rear.mass_kg=heavy", "found `heavy`, needed a number"),
    ] {
        refused(&[&simulate[..], &["--set", setting]].concat(), expected);
    }
    refused(
        &["simulate", "twistcar", "--model", "skid-rol", "--omega", "4"],
        "did you mean `skid-roll`?",
    );
    refused(
        &["simulate", "twistcar", "--model", "coulomb", "--omega", "4"],
        "key `robot.twistcar.links.front.skid_dry_n`: found nothing, needed skid_dry_n, which model `coulomb`",
    );
    let notice = "campaign twistcar: its robot is a chain; only `trilink simulate`, `synth` and `ingest` support chains";
    for arguments in [
        &["branches", "twistcar", "--over", "omega_rad_s=2..4"][..],
        &["optimise", "twistcar", "--model", "skid-roll", "--maximise", "v"],
        &["design", "twistcar", "--model", "skid-roll"],
        &["run"],
        &["fit"],
        &["synth", "raw2"],
    ] {
        refused(arguments, notice);
    }
    let raw = folder.path().join("raw/demo");
    std::fs::create_dir_all(&raw).expect("a folder");
    let list = "[[trial]]\nid = \"a\"\nkind = \"gait\"\nfile = \"a.csv\"\ncampaign = \"twistcar\"\nomega_rad_s = 1.0\n";
    std::fs::write(raw.join("trials.toml"), list).expect("a file");
    let check = text(&trilink(folder.path(), &["config", "check"]).stdout);
    let campaign = "campaign twistcar: robot twistcar, a chain of 2 links, gait twist, 1 trials; for `trilink \
                    simulate`, `synth` and `ingest`";
    assert!(check.contains(campaign), "{check}");
}
