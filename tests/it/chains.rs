//! Tests of robots that are chains: `simulate`, synthetic trials and their tables, and the notices of the other commands.

use std::path::Path;

use serde_json::Value;
use trilink_robot::Model;
use trilink_statistics::Estimate;
use trilink_tables::trial::TrialKind;
use trilink_tables::{
    Columns as _, FitRow, PredictionRow, PredictionSource, Table, TrialRow, TrialStatus,
};

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
            // The list ends with the last link that has a wheel.
            let wheels = answer["sigma"].as_array().expect("a list");
            assert!((links - 1..=links).contains(&wheels.len()), "{answer}");
            assert!(wheels.last().is_some_and(Value::is_number), "{answer}");
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
    let names: Vec<&str> = lines.next().expect("a heading").split(',').collect();
    let row: Vec<&str> = lines.next().expect("a row").split(',').collect();
    let value = |name: &str| names.iter().position(|one| *one == name).map(|i| row[i]);
    for name in ["d_m", "sigma0", "sigma2", "alpha3_rad", "work_j", "floquet"] {
        assert!(value(name).is_some_and(|text| text.parse::<f64>().is_ok()), "{name}: {table}");
    }
    // The fin has no wheel.
    assert_eq!(value("sigma3"), None);
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
fn a_page_animates_a_chain_from_rest_with_the_values_of_its_trajectory() {
    let folder = folder_of("passive-snake.toml");
    let stiff = ["--set", "joint2.stiffness_nm_rad=0.4"];
    let simulate = ["simulate", "passive", "--model", "skid-roll", "--omega", "4"];
    let simulate = [&simulate[..], &stiff].concat();
    succeed(folder.path(), &[&simulate[..], &["--page", "motion.html"]].concat());
    let page = std::fs::read_to_string(folder.path().join("motion.html")).expect("a page");
    for text in [
        "<th scope=\"row\">σ₂, wheel 2 (tail)</th>",
        "<th scope=\"row\">α₃</th>",
        "<th scope=\"row\">joint2.stiffness_nm_rad</th><td class=\"n\">0.4</td>",
    ] {
        assert!(page.contains(text), "{text}");
    }
    assert!(!page.contains("wheel 3"));
    let replay = super::simulate::replay_of(&page);
    assert_eq!(replay["names"], serde_json::json!(["body", "head", "tail", "fin"]));
    let settled = replay["time"].as_array().map_or(0, Vec::len);
    let rest = ["--from-rest", "--samples", "296", "--trajectory", "rest.parquet"];
    succeed(folder.path(), &[&simulate[..], &rest].concat());
    let table = Table::read(&folder.path().join("rest.parquet")).expect("a table");
    let quantity = |name: &str| {
        let all = replay["quantities"].as_array().expect("quantities");
        all.iter().find(|of| of["name"] == name).unwrap_or_else(|| panic!("{name}")).clone()
    };
    let torque = quantity("Torque of joints 1 to 3");
    assert_eq!(torque["values"].as_array().map(Vec::len), Some(3));
    let [skid, across] = ["Skid velocity", "Skid friction"].map(quantity);
    assert!(skid["values"][3].as_array().expect("frames").iter().all(Value::is_null));
    for (shown, column) in [
        (&replay["motions"][0]["phi"][2], "phi3_rad"),
        (&skid["values"][0], "skid0_m_s"),
        (&across["values"][2], "lateral2_n"),
        (&torque["values"][1], "torque2_nm"),
        (&quantity("Power of the actuators")["values"][0], "power_w"),
    ] {
        let known = table.values::<f64>(column).expect("numbers");
        // The page has 74 frames per cycle.
        let known: Vec<f64> = known.into_iter().step_by(4).collect();
        let shown = super::simulate::sums(shown);
        assert!(known.len() < shown.len() && shown.len() == settled, "{column}");
        for (shown, known) in shown.iter().zip(&known) {
            assert!((shown - known).abs() < 0.50001e-4, "{column}: {shown} {known}");
        }
    }
}

#[test]
fn mistakes_in_commands_about_chains_are_named() {
    let folder = folder_of("twistcar.toml");
    let refused = |arguments: &[&str], expected: &str| {
        let output = trilink(folder.path(), arguments);
        let error = text(&output.stderr);
        assert!(error.contains(expected) && !error.contains("panicked"), "{arguments:?}: {error}");
    };
    let simulate = ["simulate", "twistcar", "--model", "skid-roll", "--omega", "4"];
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
    let raw = folder.path().join("raw/demo");
    std::fs::create_dir_all(&raw).expect("a folder");
    let list = "[[trial]]\nid = \"a\"\nkind = \"gait\"\nfile = \"a.csv\"\ncampaign = \"twistcar\"\nomega_rad_s = 1.0\n";
    std::fs::write(raw.join("trials.toml"), list).expect("a file");
    let check = text(&trilink(folder.path(), &["config", "check"]).stdout);
    let campaign = "campaign twistcar: robot twistcar (a chain of 2 links), gait twist, 1 trials; models skid, \
                    skid-roll";
    assert!(check.contains(campaign), "{check}");
}

/// Returns the row and the true values of each gait trial in `raw/practice` of a folder, which are ingested.
fn ingested(folder: &Path) -> Vec<(TrialRow, Value)> {
    succeed(folder, &["ingest", "raw/practice"]);
    let table = Table::read(&folder.join("derived/trials.parquet")).expect("a table");
    let truth = std::fs::read(folder.join("raw/practice/truth.json")).expect("a file");
    let truth: Value = serde_json::from_slice(&truth).expect("JSON");
    let rows = TrialRow::from_table(&table).expect("trials").into_iter();
    let rows = rows.filter(|row| row.kind == TrialKind::Gait);
    rows.map(|row| (row.clone(), truth["trials"][&row.id].clone())).collect()
}

#[test]
fn synthetic_trials_of_the_gallery_have_their_true_metrics() {
    let (mut squares, mut count) = (0.0, 0.0);
    for entry in std::fs::read_dir(gallery()).expect("the gallery is there") {
        let robot = entry.expect("an entry").file_name().into_string().expect("a name");
        let folder = folder_of(&robot);
        succeed(folder.path(), &["synth", "raw/practice", "--omega", "3,5", "--seed", "2"]);
        let trials = ingested(folder.path());
        assert_eq!(trials.len(), 2, "{robot}");
        for (row, truth) in trials {
            assert_eq!(row.status, TrialStatus::Ok, "{robot}: {}", row.message);
            let (means, errors) = (&row.metrics, &row.metrics_se);
            let mut found = vec![
                ("d_m".to_owned(), truth["d_m"].as_f64(), Estimate::new(means.d_m, errors.d_m)),
                ("v_m_s".to_owned(), truth["v_m_s"].as_f64(), {
                    Estimate::new(means.v_m_s, errors.v_m_s)
                }),
            ];
            let sigma = truth["sigma"].as_array().expect("a list");
            for (link, truth) in sigma.iter().enumerate() {
                found.push((format!("sigma{link}"), truth.as_f64(), row.all_debiased()[link]));
            }
            for joint in 0.. {
                let name = format!("alpha{}_rad", joint + 1);
                let Some(truth) = truth[&name].as_f64() else { break };
                let alpha = Estimate::new(means.alpha_rad[joint], errors.alpha_rad[joint]);
                found.push((name, Some(truth), alpha));
            }
            assert!(found.len() >= 5, "{robot}: {truth}");
            for (name, truth, Estimate { value, se }) in found {
                let Some(truth) = truth else {
                    assert!(value.is_nan(), "{robot}: {name}");
                    continue;
                };
                let deviation = (value - truth) / se;
                assert!(
                    deviation.abs() < 4.0,
                    "{robot}, {}: {name} = {value} +- {se}, not {truth}",
                    row.trial
                );
                squares += deviation * deviation;
                count += 1.0;
            }
        }
    }
    let rms = f64::sqrt(squares / count);
    assert!((0.7..1.3).contains(&rms), "{rms}");
}

#[test]
fn a_chain_without_driven_joints_has_phases_relative_to_joint_1() {
    let folder = folder_of("elastic-snake.toml");
    succeed(folder.path(), &["synth", "raw/practice", "--omega", "3"]);
    let trials = ingested(folder.path());
    let [(row, _)] = trials.as_slice() else { panic!("one trial") };
    assert!((row.omega_rad_s / 3.0 - 1.0).abs() < 1e-4, "{}", row.omega_rad_s);
    let [first, second] = row.gait.map(|joint| joint.phase_rad.to_degrees());
    // The drive of joint 2 lags by 90 degrees.
    assert!(first.abs() < 0.1 && (-120.0..-60.0).contains(&second), "{first} {second}");
    let checks = Table::read(&folder.path().join("derived/checks.parquet")).expect("a table");
    let names = checks.frame.column("check").expect("a column").str().expect("texts").clone();
    let names: Vec<&str> = names.iter().flatten().collect();
    assert!(names.contains(&"W005 frequency") && !names.contains(&"W009 gait"), "{names:?}");

    let list = folder.path().join("raw/practice/trials.toml");
    let text = std::fs::read_to_string(&list).expect("a list");
    std::fs::write(&list, text.replace("omega_rad_s = 3.0", "omega_rad_s = 0.4775")).unwrap();
    let error = trilink(folder.path(), &["ingest", "raw/practice"]);
    let table = Table::read(&folder.path().join("derived/trials.parquet")).expect("a table");
    let rows = TrialRow::from_table(&table).expect("trials");
    let expected = "is omega_rad_s in Hz? set omega_rad_s = 3.0";
    assert!(rows[0].message.contains(expected), "{} {error:?}", rows[0].message);
}

#[test]
fn a_link_without_markers_follows_from_its_neighbours() {
    let folder = folder_of("driven-snake.toml");
    let path = folder.path().join("pipeline.toml");
    let text = std::fs::read_to_string(&path).expect("a configuration");
    for bare in ["link 3", "link 4"] {
        let lines = text.lines().filter(|line| !line.starts_with(&format!("\"{bare}\" = ")));
        std::fs::write(&path, lines.collect::<Vec<_>>().join("\n")).unwrap();
        succeed(folder.path(), &["synth", "raw/practice", "--omega", "4"]);
        let trials = ingested(folder.path());
        let [(row, truth)] = trials.as_slice() else { panic!("one trial") };
        assert_eq!(row.status, TrialStatus::Ok, "{bare}: {}", row.message);
        let d_m = truth["d_m"].as_f64().expect("a number");
        let off = (row.metrics.d_m - d_m).abs();
        assert!(off < 4.0 * row.metrics_se.d_m, "{bare}: {} {d_m}", row.metrics.d_m);
        let survey = succeed(folder.path(), &["check", "raw/practice/snake-4.00-r1.csv"]);
        assert!(survey.contains("can be ingested"), "{survey}");
    }
}

#[test]
fn servos_days_and_label_errors_of_chains_are_in_the_truth() {
    let folder = folder_of("passive-snake.toml");
    let options = ["--servo-lag", "0.02", "--servo-compliance", "0.05", "--days", "2"];
    let others =
        ["--misplaced", "0.02", "--repeats", "2", "--law", "skid", "--skid-factors", "2,1,1"];
    let synth = ["synth", "raw/practice", "--omega", "4"];
    succeed(folder.path(), &[&synth[..], &options, &others].concat());
    let truth = std::fs::read(folder.path().join("raw/practice/truth.json")).expect("a file");
    let truth: Value = serde_json::from_slice(&truth).expect("JSON");
    let planted = &truth["campaigns"]["passive"];
    assert_eq!(planted["law"]["model"], "skid");
    let skid = planted["skid_kg_s"].as_array().expect("a list");
    // The body has 150 kg/s, the head and the tail 100 kg/s; the fin has no wheel.
    let is_near = |link: usize, kg_s: f64| (skid[link].as_f64().unwrap() / kg_s - 1.0).abs() < 0.11;
    assert!(is_near(0, 300.0) && is_near(1, 100.0) && is_near(2, 100.0) && skid[3].is_null());
    assert_eq!(planted["stiffness_nm_rad"], serde_json::json!([null, 0.137, 0.137]));
    let trial = &truth["trials"]["passive-4.00-r2"];
    assert_eq!(trial["day"], 2);
    assert!(trial["misplaced"].as_array().is_some_and(|errors| errors.len() > 10), "{trial}");
    let driven = &trial["gait"][0];
    let lag_rad = -driven["phase_rad"].as_f64().expect("a phase");
    assert!((0.06..0.12).contains(&lag_rad) && trial["gait"][1].is_null(), "{trial}");
    for (row, _) in ingested(folder.path()) {
        assert!(row.status.has_metrics(), "{}", row.message);
    }
}

#[test]
fn friction_that_varies_between_cycles_scatters_the_cycles() {
    let folder = folder_of("twistcar.toml");
    let scatter = |variation: &str| {
        let line = ["synth", "raw/practice", "--omega", "4", "--friction-variation", variation];
        succeed(folder.path(), &line);
        trilink(folder.path(), &["ingest", "raw/practice"]);
        let table = Table::read(&folder.path().join("derived/trials.parquet")).expect("a table");
        TrialRow::from_table(&table).expect("trials")[0].metrics_se.d_m
    };
    let [steady, varied] = ["0", "0.1"].map(scatter);
    assert!(varied > 5.0 * steady, "{steady} {varied}");
}

#[test]
fn motions_of_chains_with_dry_friction_have_their_sharp_limit() {
    let folder = folder_of("twistcar.toml");
    let path = folder.path().join("pipeline.toml");
    let settings = std::fs::read_to_string(&path).expect("a configuration");
    let dry = settings.replace("skid_kg_s", "skid_dry_n = 2.0\nskid_kg_s");
    std::fs::write(&path, dry).unwrap();
    let line = ["simulate", "twistcar", "--model", "coulomb", "--omega", "4", "--json"];
    let of = |settings: &[&str]| -> Value {
        let json = succeed(folder.path(), &[&line[..], settings].concat());
        serde_json::from_str::<Vec<Value>>(&json).unwrap().remove(0)
    };
    let transitions = ["front.transition_m_s=0.0005", "rear.transition_m_s=0.0005"];
    let [wide, narrow] = [of(&[]), of(&["--set", transitions[0], transitions[1]])];
    let d_m = |answer: &Value| answer["d_m"].as_f64().unwrap();
    let limit_m = wide["sharp_limit"]["metrics"]["d_m"].as_f64().unwrap();
    let [before, after] = [d_m(&wide), d_m(&narrow)].map(|d_m| (d_m - limit_m).abs());
    assert!(before > 0.0 && after < 0.3 * before, "{before} {after}");
    let [line @ .., _] = line;
    let table = succeed(folder.path(), &line);
    assert!(table.contains("as transition_m_s goes to zero"), "{table}");
    let csv = succeed(folder.path(), &[&line[..], &["--csv"]].concat());
    assert!(csv.lines().next().unwrap().contains("sharp_limit_sigma1_uncertainty"), "{csv}");
    assert!(of(&[])["sharp_limit"]["uncertainty"]["d_m"].as_f64().unwrap() < before);
}

#[test]
fn mistakes_in_trials_of_chains_are_named() {
    let folder = folder_of("twistcar.toml");
    let path = folder.path().join("pipeline.toml");
    let text = std::fs::read_to_string(&path).expect("a configuration");
    succeed(folder.path(), &["synth", "raw/practice", "--omega", "4"]);
    let ingest = |configuration: &str, list: &str| {
        std::fs::write(&path, configuration).unwrap();
        std::fs::write(folder.path().join("raw/practice/trials.toml"), list).unwrap();
        trilink(folder.path(), &["ingest", "raw/practice"]);
        let table = Table::read(&folder.path().join("derived/trials.parquet")).expect("a table");
        TrialRow::from_table(&table).expect("trials")
    };
    let list = "[[trial]]\nid = \"a\"\nfile = \"twistcar-4.00-r1.csv\"\n";
    let gait = format!("{list}kind = \"gait\"\ncampaign = \"twistcar\"\nomega_rad_s = 4.0\n");
    let bare = text.split("[layout").next().expect("a text").to_owned();
    let release = format!("{list}kind = \"joint-release\"\nrobot = \"twistcar\"\n");
    let coast = release.replace("joint-release", "coast-down");
    let steered = text.replacen("wheel_m = 0.0", "wheel_m = 0.0\nsteer_deg = 5.0", 1);
    let unknown = gait.replace("campaign = \"twistcar\"", "campaign = \"twistcat\"");
    let other = text.replace("R1 = ", "X1 = ");
    for (configuration, list, expected) in [
        (
            &bare,
            &gait,
            "key `campaign`: found `twistcar`, whose robot is `twistcar`, needed a robot whose marker layout is \
             configured: the positions of the markers of robot `twistcar` in [layout.twistcar.front], [layout.twistcar.rear]",
        ),
        (
            &text,
            &release,
            "key `robot`: found `twistcar`, needed a robot with a joint that is not driven",
        ),
        (&steered, &coast, "key `robot`: found `twistcar`, needed a robot without steered wheels"),
        (&text, &unknown, "did you mean `twistcar`?"),
        (&other, &gait, "no marker `X1`, which layout.twistcar.rear of pipeline.toml requires"),
    ] {
        let rows = ingest(configuration, list);
        assert_eq!(rows[0].status, TrialStatus::Failed);
        assert!(rows[0].message.contains(expected), "{}", rows[0].message);
    }
    std::fs::write(&path, bare).unwrap();
    let error = self::text(&trilink(folder.path(), &["synth", "raw/other"]).stderr);
    let expected = "campaign twistcar: needed a robot whose marker layout is configured";
    assert!(error.contains(expected), "{error}");
}

#[test]
fn the_calibrated_layout_of_a_chain_can_be_pasted_into_the_configuration() {
    let folder = folder_of("driven-snake.toml");
    let path = folder.path().join("pipeline.toml");
    succeed(folder.path(), &["synth", "raw/practice", "--omega", "4"]);
    let calibrate = ["ingest", "raw/practice", "--calibrate", "snake-4.00-r1"];
    let layout = succeed(folder.path(), &calibrate);
    assert!(layout.contains("# front_joint_m = 0.06"), "{layout}");
    let text = std::fs::read_to_string(&path).expect("a configuration");
    let (robot, _) = text.split_once("[layout.snake]").expect("a layout");
    std::fs::write(&path, format!("{robot}{layout}")).unwrap();
    for (row, truth) in ingested(folder.path()) {
        assert_eq!(row.status, TrialStatus::Ok, "{}", row.message);
        let d_m = truth["d_m"].as_f64().expect("a number");
        assert!((row.metrics.d_m / d_m - 1.0).abs() < 1e-3, "{} {d_m}", row.metrics.d_m);
    }
}

/// The limits of a coefficient are those of 95 %; farther from the planted value than three times their distance from
/// the fitted one, a limit would be wrong.
#[test]
fn synthetic_trials_of_the_gallery_yield_the_planted_coefficients() {
    let mut limits = 0;
    for entry in std::fs::read_dir(gallery()).expect("the gallery is there") {
        let robot = entry.expect("an entry").file_name().into_string().expect("a name");
        let folder = folder_of(&robot);
        let file = folder.path().join("pipeline.toml");
        let text = std::fs::read_to_string(&file).expect("a file");
        let settings = "[fit]\nbootstrap = 40\nprofiles = false\nstarts = 2\n";
        std::fs::write(&file, format!("{text}\n{settings}")).expect("a file");
        let omegas = ["--omega", "2,3,4,5,6"];
        succeed(folder.path(), &[&["synth", "raw/practice", "--seed", "3"][..], &omegas].concat());
        succeed(folder.path(), &["ingest", "raw/practice"]);
        trilink(folder.path(), &["fit"]);
        let truth = std::fs::read(folder.path().join("raw/practice/truth.json")).expect("a file");
        let truth: Value = serde_json::from_slice(&truth).expect("JSON");
        let (_, planted) =
            truth["campaigns"].as_object().expect("a map").iter().next().expect("one");
        let table = Table::read(&folder.path().join("derived/fits.parquet")).expect("a table");
        let fits = FitRow::from_table(&table).expect("fits");
        let fit = fits.iter().find(|fit| fit.model == Model::SKID_ROLL).expect("a fit");
        assert!(fit.status.is_ok() && !fit.free.is_empty(), "{robot}: {}", fit.failure);
        for parameter in &fit.free {
            let wheel = parameter.number().expect("of a wheel");
            let planted = planted["skid_kg_s"][wheel].as_f64().expect("a number");
            let found = fit.parameters[*parameter];
            let [low, high] = [fit.lower[*parameter], fit.upper[*parameter]];
            if low.is_finite() && high.is_finite() {
                let off =
                    (planted - found) / if planted > found { high - found } else { found - low };
                assert!(
                    off.abs() < 3.0,
                    "{robot}: {parameter} = {found}, not {planted}: {low} {high}"
                );
                limits += 1;
            }
        }
        if robot == "twistcar.toml" {
            let design = ["design", "twistcar", "--model", "skid-roll", "--add", "2", "--json"];
            let advice: Value =
                serde_json::from_str(&succeed(folder.path(), &design)).expect("JSON");
            let amplitude_rad = advice["trials"][0]["phi1_amplitude_rad"].as_f64();
            assert!((amplitude_rad.expect("a number") - 30_f64.to_radians()).abs() < 1e-9);
        }
        let simulate = ["simulate", &fit.campaign, "--model", "skid-roll", "--fitted", "--json"];
        let answer = succeed(folder.path(), &[&simulate[..], &["--omega", "4"]].concat());
        let answer: Value = serde_json::from_str(&answer).expect("JSON");
        let name = fit.free[0].name();
        let shown = answer[0]["coefficients"][name].as_f64().expect("a number");
        assert!((shown / fit.parameters[fit.free[0]] - 1.0).abs() < 1e-12, "{robot}: {name}");
    }
    assert!(limits >= 10, "{limits}");
}

#[test]
fn the_links_and_joints_of_a_chain_are_exported() {
    let folder = folder_of("passive-snake.toml");
    succeed(folder.path(), &["synth", "raw/practice", "--omega", "3"]);
    let paths = std::fs::read_to_string(folder.path().join("pipeline.toml")).expect("a file");
    let paths = format!("{paths}\n[paths]\nraw = \"raw/practice\"\n");
    std::fs::write(folder.path().join("pipeline.toml"), paths).expect("a file");
    let trials = ingested(folder.path());
    let export = |format: &str| {
        succeed(folder.path(), &["export", &trials[0].0.trial, "--format", format, "-o", "-"])
    };
    let table = export("csv");
    let [header, first, ..] = table.lines().collect::<Vec<_>>()[..] else { panic!("{table}") };
    assert!(header.contains("link3_theta_rad") && !header.contains("link4"), "{header}");
    let cells = header.split(',').zip(first.split(','));
    let cells: Vec<(&str, &str)> = cells.collect();
    let of = |name: &str| {
        let (_, cell) = cells.iter().find(|(column, _)| *column == name).expect(name);
        cell.parse::<f64>().expect("a number")
    };
    // Link 2 follows link 0; their origins are 0.1 m from the joint between them.
    let apart_m = (of("link2_x_m") - of("link0_x_m")).hypot(of("link2_y_m") - of("link0_y_m"));
    assert!((0.1..0.2001).contains(&apart_m), "{apart_m}");
    assert!(export("trc").contains("joint3"));
}

/// Returns a number of the first row of a command that prints rows as JSON.
fn first_number(rows: &str, name: &str) -> f64 {
    let rows: Vec<Value> = serde_json::from_str(rows).expect("rows");
    rows[0][name].as_f64().unwrap_or_else(|| panic!("{name}: {}", rows[0]))
}

#[test]
fn no_gait_that_a_scan_simulates_is_faster_than_the_optimum_of_a_chain() {
    let folder = folder_of("passive-snake.toml");
    let optimise = ["optimise", "passive", "--model", "skid-roll", "--maximise", "v"];
    let rows = succeed(folder.path(), &[&optimise[..], &["--json"]].concat());
    let of = |name: &str| first_number(&rows, name);
    let best = [of("omega_rad_s"), of("phi1_amplitude_rad"), of("phi1_offset_rad")];
    let rows_of: Vec<Value> = serde_json::from_str(&rows).expect("rows");
    assert_eq!(rows_of[0]["at_bound"], "", "{}", rows_of[0]);
    let speed = |[omega_rad_s, amplitude_rad, offset_rad]: [f64; 3]| {
        let omega = omega_rad_s.to_string();
        let amplitude = format!("joint1.amplitude_deg={}", amplitude_rad.to_degrees());
        let offset = format!("joint1.offset_deg={}", offset_rad.to_degrees());
        let simulate = ["simulate", "passive", "--model", "skid-roll", "--omega", &omega];
        let set = ["--set", &amplitude, &offset, "--json"];
        first_number(&succeed(folder.path(), &[&simulate[..], &set].concat()), "v_m_s")
    };
    let value = of("value");
    assert!((speed(best) / value - 1.0).abs() < 1e-8, "{} {value}", speed(best));
    // The optimum is stationary: a change in one command lowers the speed to second order.
    for i in 0..3 {
        let loss = |part: f64| {
            let mut moved = best;
            moved[i] += part * [1.0, 0.2, 0.2][i];
            1.0 - speed(moved) / value
        };
        for side in [-1.0, 1.0] {
            let (near, far) = (loss(0.05 * side), loss(0.1 * side));
            assert!(near > 0.0 && (3.0..5.0).contains(&(far / near)), "{i} {side}: {near} {far}");
        }
    }
    for place in 0..64 {
        let at = |low: f64, high: f64, index: usize| low + (high - low) * index as f64 / 3.0;
        let gait =
            [at(1.0, 10.0, place / 16), at(0.2, 1.0, place / 4 % 4), at(-0.3, 0.3, place % 4)];
        assert!(speed(gait) <= value, "{gait:?}");
    }
}

#[test]
fn torques_and_rotors_of_chains_are_optimised_within_their_limits() {
    let folder = folder_of("rotor-car.toml");
    let toml = std::fs::read_to_string(folder.path().join("pipeline.toml")).expect("a text");
    let toml = toml
        .replace("{ kind = \"spring\", ", "{ kind = \"torque\", ")
        .replace("[gait.spin]\n", "[gait.spin]\njoint1 = { torque_nm = 0.01, phase_deg = 40.0 }\n");
    std::fs::write(folder.path().join("pipeline.toml"), toml).expect("a file");
    let optimise = ["optimise", "rotor-car", "--model", "skid-roll", "--maximise", "d"];
    let refused = trilink(folder.path(), &optimise);
    let message = "optimise.torque_nm: found nothing, needed the largest torque of an actuator, because `torque1` is free";
    assert!(text(&refused.stderr).contains(message), "{}", text(&refused.stderr));
    let unknown = trilink(folder.path(), &[&optimise[..], &["--free", "torqes"]].concat());
    for name in ["`torques`, ", "`means`, ", "did you mean `torques`?"] {
        assert!(text(&unknown.stderr).contains(name), "{}", text(&unknown.stderr));
    }
    let limits =
        ["--torque-nm", "0.05", "--rotor-amplitude-deg", "200..400", "--rate-deg-s", "4000"];
    let free = ["--free", "torque1", "mean1", "rotor.front.amplitude", "--omega", "6"];
    let line = [&optimise[..], &limits, &free, &["--starts", "2"]].concat();
    let rows = succeed(folder.path(), &[&line[..], &["--json"]].concat());
    let of = |name: &str| first_number(&rows, name);
    assert!(of("torque1_amplitude_nm").abs() + of("torque1_mean_nm").abs() <= 0.05 * (1.0 + 1e-3));
    let amplitude_deg = of("rotor0_amplitude_rad").to_degrees();
    assert!((200.0 - 1e-6..=400.0 + 1e-6).contains(&amplitude_deg), "{rows}");
    assert!(rows.contains("amplitudes of rotors 200 to 400 degrees"), "{rows}");
    // The printed gait gives the motion of the optimum.
    let entry = succeed(folder.path(), &[&line[..], &["--gait-toml"]].concat());
    let path = folder.path().join("pipeline.toml");
    let toml = std::fs::read_to_string(&path).expect("a text");
    let toml = toml.replace("gait = \"spin\"", "gait = \"rotor-car-best-d\"");
    std::fs::write(&path, format!("{toml}\n{entry}")).expect("a file");
    let omega = of("omega_rad_s").to_string();
    let simulate = ["simulate", "rotor-car", "--model", "skid-roll", "--omega", &omega, "--json"];
    let d_m = first_number(&succeed(folder.path(), &simulate), "d_m");
    assert!((d_m / of("value") - 1.0).abs() < 1e-8, "{d_m} {rows}");
}

#[test]
fn a_printed_gait_keeps_a_torque_of_zero() {
    let folder = folder_of("rotor-car.toml");
    let path = folder.path().join("pipeline.toml");
    let toml = std::fs::read_to_string(&path).expect("a text");
    let torque = "joint1 = { torque_nm = 0.0 }";
    let toml = toml
        .replace("{ kind = \"spring\", ", "{ kind = \"torque\", ")
        .replace("[gait.spin]\n", &format!("[gait.spin]\n{torque}\n"));
    std::fs::write(&path, &toml).expect("a file");
    let optimise = ["optimise", "rotor-car", "--model", "skid-roll", "--maximise", "d"];
    let limits = ["--rotor-amplitude-deg", "5..500", "--rate-deg-s", "4000"];
    let free = ["--free", "rotor.front.amplitude", "--omega", "6", "--starts", "2"];
    let line = [&optimise[..], &limits, &free].concat();
    let d_m = first_number(&succeed(folder.path(), &[&line[..], &["--json"]].concat()), "d_m");
    let entry = succeed(folder.path(), &[&line[..], &["--gait-toml"]].concat());
    assert!(entry.ends_with(&format!("{torque}\n")), "{entry}");
    let toml = toml.replace("gait = \"spin\"", "gait = \"rotor-car-best-d\"");
    std::fs::write(&path, format!("{toml}\n{entry}")).expect("a file");
    let simulate = ["simulate", "rotor-car", "--model", "skid-roll", "--omega", "6", "--json"];
    let read_m = first_number(&succeed(folder.path(), &simulate), "d_m");
    assert!((read_m / d_m - 1.0).abs() < 1e-8, "{read_m} {d_m}");
}

/// The Twistcar with standard deviations; both masses were weighed on one scale.
fn folder_of_uncertain_twistcar() -> tempfile::TempDir {
    let folder = folder_of("twistcar.toml");
    let path = folder.path().join("pipeline.toml");
    let toml = std::fs::read_to_string(&path).expect("a text");
    let mass = |kg: f64| format!("mass_kg = {{ value = {kg}, sd = 0.01, same = \"scale\" }}");
    let toml = toml
        .replace("mass_kg = 0.3", &mass(0.3))
        .replace("mass_kg = 1.0", &mass(1.0))
        .replace("com_m = 0.1 ", "standard_deviation = { inertia_kg_m2 = \"5 %\" }\ncom_m = 0.1 ");
    let fit = "[fit]\nbootstrap = 40\nprofiles = false\nstarts = 2\ngait_input = \"commanded\"\n";
    std::fs::write(&path, format!("{toml}\n{fit}")).expect("a file");
    folder
}

#[test]
fn errors_of_a_chain_s_numbers_are_propagated_to_its_motion() {
    let folder = folder_of_uncertain_twistcar();
    let simulate = ["simulate", "twistcar", "--model", "skid-roll", "--omega", "4", "--json"];
    let options = ["--sensitivities", "--monte-carlo", "2000"];
    let rows = succeed(folder.path(), &[&simulate[..], &options].concat());
    let rows: Vec<Value> = serde_json::from_str(&rows).expect("rows");
    let number = |row: &Value, name: &str| row[name].as_f64().expect("a number");
    let of = |parameter: &str| {
        let is_of = |row: &&Value| row["parameter"] == parameter && row["metric"] == "d_m";
        rows.iter().find(is_of).expect(parameter)
    };
    let derivative = |parameter: &str| number(of(parameter), "derivative");
    // The masses share an error, which is that of neither alone.
    let by_scale = 0.01 * (derivative("front.mass_kg") + derivative("rear.mass_kg"));
    let by_inertia = 0.05 * 8e-3 * derivative("rear.inertia_kg_m2");
    let deviation = number(of("front.mass_kg"), "metric_deviation");
    assert!((deviation / by_scale.hypot(by_inertia) - 1.0).abs() < 1e-9, "{deviation}");
    assert_eq!(of("rear.inertia_kg_m2")["known_from"], "configured");
    assert!(of("front.inertia_kg_m2")["known_from"].is_null());
    let drawn = number(of("front.mass_kg"), "draws_deviation");
    assert!((drawn / deviation - 1.0).abs() < 0.1, "{drawn} {deviation}");
    let printed = succeed(folder.path(), &[&simulate[..6], &options[..1]].concat());
    assert!(printed.contains("shares of each metric's variance"), "{printed}");
}

#[test]
fn the_true_numbers_of_a_chain_are_off_by_their_standard_deviations() {
    let folder = folder_of_uncertain_twistcar();
    let home = folder.path();
    let synth = ["synth", "raw/practice", "--omega", "2,3,4,5,6"];
    succeed(home, &synth);
    let truth = || -> Value {
        let text = std::fs::read_to_string(home.join("raw/practice/truth.json")).expect("a text");
        serde_json::from_str(&text).expect("JSON")
    };
    assert!(truth()["off_configured"].is_null());
    succeed(home, &[&synth[..], &["--declared-errors"]].concat());
    let off = truth()["off_configured"]["twistcar"].clone();
    let error = |name: &str, value: f64, sd: f64| (off[name].as_f64().expect(name) - value) / sd;
    let [front, rear] = [("front", 0.3), ("rear", 1.0)]
        .map(|(link, kg)| error(&format!("{link}.mass_kg"), kg, 0.01));
    let inertia = error("rear.inertia_kg_m2", 8e-3, 4e-4);
    println!("errors in standard deviations: {front}, {rear}, {inertia}");
    assert!((front - rear).abs() < 1e-9, "one scale");
    assert!([front, inertia].iter().all(|error| (1e-3..3.0).contains(&error.abs())));
    assert!((front - inertia).abs() > 1e-3, "a pendulum is no scale");
    assert_eq!(off.as_object().map(serde_json::Map::len), Some(3), "{off}");
    succeed(home, &["ingest", "raw/practice"]);
    trilink(home, &["fit"]);
    let fits = Table::read(&home.join("derived/fits.parquet")).expect("a table");
    let fits = fits
        .values::<String>("model")
        .expect("models")
        .into_iter()
        .zip(fits.values::<bool>("adequate").expect("verdicts"));
    assert_eq!(
        fits.collect::<Vec<_>>(),
        [("skid".to_owned(), false), ("skid-roll".to_owned(), true)]
    );
}

#[test]
fn the_intervals_of_a_fitted_chain_are_those_of_the_predictions() {
    let folder = folder_of_uncertain_twistcar();
    let home = folder.path();
    succeed(home, &["synth", "raw/practice", "--seed", "3", "--omega", "2,3,4,5,6"]);
    succeed(home, &["ingest", "raw/practice"]);
    trilink(home, &["fit"]);
    let table = Table::read(&home.join("derived/predictions.parquet")).expect("a table");
    let mut rows = PredictionRow::from_table(&table).expect("rows");
    rows.retain(|row| row.model == Model::SKID_ROLL && row.source == PredictionSource::Trial);
    let omegas: Vec<String> = rows.iter().map(|row| row.omega_rad_s.to_string()).collect();
    let omegas = omegas.join(",");
    let line = ["simulate", "twistcar", "--model", "skid-roll", "--fitted", "--omega", &omegas];
    let answers = succeed(home, &[&line[..], &["--bands", "--json"]].concat());
    let answers: Vec<Value> = serde_json::from_str(&answers).expect("answers");
    let mut compared = 0;
    for (row, answer) in rows.iter().zip(&answers) {
        assert!(answer["no_interval"].is_null(), "{answer}");
        for (found, known) in
            [(answer, &row.metrics), (&answer["lower"], &row.lower), (&answer["upper"], &row.upper)]
        {
            for (found, known) in [
                (&found["d_m"], known.d_m),
                (&found["v_m_s"], known.v_m_s),
                (&found["sigma"][1], known.sigma[1]),
            ] {
                let found = found.as_f64().expect("a number");
                assert!((found / known - 1.0).abs() < 1e-6, "{found} {known}: {answer}");
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 45);
    let csv = succeed(home, &[&line[..], &["--bands", "--csv"]].concat());
    assert!(csv.starts_with("model,omega_rad_s,d_m,d_m_lo,d_m_hi,v_m_s,"), "{csv}");
    let printed = succeed(home, &[&line[..], &["--bands"]].concat());
    assert!(printed.contains("95 % from"), "{printed}");
    // A coefficient that is set has no uncertainty.
    let set = ["--bands", "--json", "--set", "front.skid_kg_s=90"];
    let other: Value =
        serde_json::from_str(&succeed(home, &[&line[..], &set].concat())).expect("answers");
    let why = other[0]["no_interval"].as_str().expect("a reason");
    assert!(why.contains("was set") && other[0]["lower"]["d_m"].is_null(), "{why}");
    // The budget contains the fitted coefficients and the configured errors.
    let rows = succeed(home, &[&line[..6], &["4", "--sensitivities", "--json"]].concat());
    let rows: Vec<Value> = serde_json::from_str(&rows).expect("rows");
    for (parameter, source) in [
        ("front.skid_kg_s", "fitted"),
        ("rear.skid_kg_s", "fitted"),
        ("front.mass_kg", "configured"),
        ("rear.inertia_kg_m2", "configured"),
    ] {
        let row = rows.iter().find(|row| row["parameter"] == parameter).expect(parameter);
        assert_eq!(row["known_from"], source, "{row}");
    }
    let shares = rows.iter().filter(|row| row["metric"] == "d_m");
    let shares = shares.filter_map(|row| row["variance_part"].as_f64());
    assert!((shares.sum::<f64>() - 1.0).abs() < 1e-9);
}
