//! Tests of `trilink simulate` on the command line.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;
use tempfile::TempDir;
use trilink_robot::Model;
use trilink_tables::config::{Config, RobotConfig};
use trilink_tables::{Columns as _, Table, rows};

use crate::common::{succeed, text, trilink};

rows! {
    /// Row of the table that `simulate --trajectory` writes for a robot of three links. Forces and torques are
    /// missing where the constraint forces are unbounded.
    pub struct TrajectoryRow {
        pub model: Model,
        pub omega_rad_s: f64,
        /// Whether the motion lies outside the range of the fitted trials; missing if the coefficients do not come from
        /// a fit or the range is unknown.
        pub extrapolated: Option<bool>,
        /// Time since the start of the motion, which is at phase 0 of the gait, s.
        pub time_s: f64,
        /// x coordinate of the centre of link 0, m.
        pub x_m: f64,
        pub y_m: f64,
        /// Heading of link 0, rad.
        pub theta_rad: f64,
        /// Joint angles phi1 and phi2, rad.
        pub phi_rad: [f64; 2] as "phi{}_rad",
        /// Velocity of the centre of link 0 along the world x axis, m/s.
        pub x_rate_m_s: f64,
        pub y_rate_m_s: f64,
        pub theta_rate_rad_s: f64,
        pub phi_rate_rad_s: [f64; 2] as "phi{}_rate_rad_s",
        /// Roll velocities of wheels 0, 1, 2, m/s.
        pub roll_m_s: [f64; 3] as "roll{}_m_s",
        /// Skid velocities of wheels 0, 1, 2, m/s.
        pub skid_m_s: [f64; 3] as "skid{}_m_s",
        /// Lateral contact forces on wheels 0, 1, 2, N: constraint forces where the wheels cannot skid, otherwise friction.
        pub lateral_n: [f64; 3] as "lateral{}_n",
        /// Rolling friction forces on wheels 0, 1, 2, N.
        pub roll_n: [f64; 3] as "roll{}_n",
        /// Joint torques, N m.
        pub torque_nm: [f64; 2] as "torque{}_nm",
        /// Power of the actuators, and power dissipated, W.
        pub power_w: f64,
        pub loss_w: f64,
    }
}

fn empty_folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn near(found: f64, known: f64, relative: f64) -> bool {
    (found - known).abs() <= relative * known.abs()
}

/// Returns the solutions that `simulate --json` prints.
fn simulate(campaign: &str, model: &str, omega: &str, settings: &[&str]) -> Vec<Value> {
    let folder = empty_folder();
    let mut arguments = vec!["simulate", campaign, "--model", model, "--omega", omega, "--json"];
    if !settings.is_empty() {
        arguments.push("--set");
        arguments.extend(settings);
    }
    let stdout = succeed(folder.path(), &arguments);
    serde_json::from_str(&stdout).expect("an array")
}

/// Splits a CSV line into fields; quoted fields may contain commas.
fn fields(line: &str) -> Vec<String> {
    let (mut fields, mut quoted) = (vec![String::new()], false);
    for character in line.chars() {
        match character {
            '"' => quoted = !quoted,
            ',' if !quoted => fields.push(String::new()),
            other => fields.last_mut().expect("a field").push(other),
        }
    }
    fields
}

#[test]
fn simulate_meets_every_skid_roll_row_of_the_reference() {
    let reference = include_str!("../fixtures/periodic.csv");
    let rows: Vec<Vec<String>> =
        reference.lines().map(fields).filter(|row| row[1] == "skid-roll").collect();
    assert_eq!(rows.len(), 8);
    for row in rows {
        let settings: Vec<&str> = row[2].split_whitespace().collect();
        let answers = simulate(&row[0], &row[1], &row[3], &settings);
        let [answer] = &answers[..] else { panic!("{} answers", answers.len()) };
        let known = |i: usize| row[i].parse::<f64>().expect("a number");
        // A commanded joint swings with its amplitude of 30 degrees.
        let alpha1_deg = if row[9].is_empty() { 30.0 } else { known(9) };
        for (name, found, known) in [
            ("omega_rad_s", &answer["omega_rad_s"], known(3)),
            ("d_m", &answer["d_m"], known(4)),
            ("v_m_s", &answer["v_m_s"], known(5)),
            ("sigma0", &answer["sigma"][0], known(6)),
            ("sigma1", &answer["sigma"][1], known(7)),
            ("sigma2", &answer["sigma"][2], known(8)),
            ("alpha1_rad", &answer["alpha1_rad"], alpha1_deg.to_radians()),
        ] {
            let found = found.as_f64().expect("a number");
            assert!(near(found, known, 1e-6), "{row:?}: {name}: {found}");
        }
        let dtheta = answer["dtheta_rad"].as_f64().expect("a number");
        assert!((dtheta - known(10)).abs() < 1e-8, "{row:?}: dtheta {dtheta}");
        assert_eq!(answer["status"], "stable");
        assert!(answer["floquet"].as_f64().is_some_and(|modulus| modulus < 1.0));
        let skid = settings[0].strip_prefix("skid_kg_s=").expect("the first setting");
        let skid: Vec<f64> = skid.split(',').map(|c| c.parse().expect("a number")).collect();
        assert_eq!(answer["parameters"]["skid_kg_s"], Value::from(skid));
    }
}

#[test]
fn simulate_answers_with_the_documented_keys_in_order_of_frequency() {
    let answers = simulate("semi-passive-symmetric", "skid-roll", "3.9,0.5..6/3", &[]);
    let omegas: Vec<Option<f64>> =
        answers.iter().map(|answer| answer["omega_rad_s"].as_f64()).collect();
    assert_eq!(omegas, [3.9, 0.5, 3.25, 6.0].map(Some));
    let expected = BTreeSet::from(
        [
            "model",
            "omega_rad_s",
            "d_m",
            "v_m_s",
            "sigma",
            "alpha1_rad",
            "dtheta_rad",
            "work_j",
            "work_j_m",
            "cost_of_transport",
            "status",
            "floquet",
            "from_rest",
            "cycles_to_settle",
            "parameters",
            "gait",
        ]
        .map(str::to_owned),
    );
    for answer in &answers {
        let answer = answer.as_object().expect("an object");
        assert_eq!(answer.keys().cloned().collect::<BTreeSet<_>>(), expected);
        // The links weigh 1.04, 0.34 and 0.34 kg.
        let [cost, work_j, d_m] =
            ["cost_of_transport", "work_j", "d_m"].map(|name| answer[name].as_f64().unwrap());
        assert!((cost * d_m * 1.72 * 9.80665 / work_j - 1.0).abs() < 1e-12, "{cost}");
        assert_eq!(answer["sigma"].as_array().map(Vec::len), Some(3));
    }
}

#[test]
fn without_skid_the_displacement_does_not_depend_on_frequency() {
    for (campaign, known) in [("kinematic-symmetric", 0.663466), ("kinematic-skewed", 0.122405)] {
        let answers = simulate(campaign, "no-skid", "0.5,2,6", &[]);
        assert_eq!(answers.len(), 3);
        for answer in answers {
            let d_m = answer["d_m"].as_f64().expect("a number");
            // The reference values have six digits.
            assert!((d_m - known).abs() < 0.5e-6 + 1e-6 * known, "{campaign}: {d_m}");
            assert_eq!(answer["sigma"], serde_json::json!([0.0, 0.0, 0.0]));
        }
    }
}

#[test]
fn a_motion_that_has_lost_its_symmetry_says_so_and_where_it_goes_from_rest() {
    let settings = ["stiffness_nm_rad=0.188", "damping_nm_s_rad=0.0005"];
    let answers = simulate("semi-passive-symmetric", "skid-roll", "11.5", &settings);
    let [answer] = &answers[..] else { panic!("{} answers", answers.len()) };
    assert_eq!(answer["status"], "symmetry-broken");
    assert_eq!(answer["from_rest"], "reached");
    let number = |key: &str| answer[key].as_f64().expect("a number");
    assert!(near(number("d_m"), 17.32122e-3, 1e-6), "{answer}");
    assert!(near(number("dtheta_rad").abs(), 0.00206734, 2e-6), "{answer}");
    assert!(number("floquet") < 1.0 && (10.0..30.0).contains(&number("cycles_to_settle")));
    let arguments =
        ["simulate", "semi-passive-symmetric", "--model", "skid-roll", "--omega", "11.5"];
    let arguments = [&arguments[..], &["--set", settings[0], settings[1]]].concat();
    let table = succeed(empty_folder().path(), &arguments);
    let says = "symmetry-broken: one of two mirror-image motions, reached from rest after";
    assert!(table.contains(says), "{table}");
}

#[test]
fn a_singular_gait_has_no_numbers_but_a_reason() {
    let folder = empty_folder();
    let mut config = Config::default();
    let gait = config.gait.get_mut("symmetric").expect("the paper's gait");
    gait.joint1.as_mut().expect("an actuated joint").amplitude_deg = Some(31.0);
    let text_of = toml::to_string(&config).expect("the configuration can be written");
    std::fs::write(folder.path().join("pipeline.toml"), text_of).expect("the file is writable");
    let simulate = ["simulate", "kinematic-symmetric", "--model", "no-skid", "--omega", "2"];
    let output = trilink(folder.path(), &[&simulate[..], &["--json"]].concat());
    assert_eq!(output.status.code(), Some(1));
    let answers: Value = serde_json::from_str(&text(&output.stdout)).expect("JSON");
    let answer = &answers[0];
    assert_eq!(answer["status"], "singular");
    assert!(answer["reason"].as_str().is_some_and(|reason| reason.contains("det W_b")));
    for key in ["d_m", "v_m_s", "alpha1_rad", "dtheta_rad", "floquet"] {
        assert_eq!(answer[key], Value::Null, "{key}");
    }
    assert_eq!(answer["sigma"], serde_json::json!([null, null, null]));

    let output = trilink(folder.path(), &[&simulate[..], &["--page", "motion.html"]].concat());
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stdout).contains("singular: "));
    assert!(text(&output.stderr).contains("motion.html: not written: "));
    assert!(!folder.path().join("motion.html").exists());

    let rest = ["--from-rest", "--trajectory", "rest.csv"];
    let output = trilink(folder.path(), &[&simulate[..], &rest].concat());
    let expected = "rest.csv: 0 samples; the file has no rows for 1 of 1 frequencies, at which no motion from rest was \
                    found (at 2 rad/s: no skid-free motion exists: the gait passes through a singular shape";
    assert!(text(&output.stderr).contains(expected), "{}", text(&output.stderr));
}

#[test]
fn several_models_are_solved_for_at_once_and_csv_has_what_json_has() {
    let folder = empty_folder();
    let several = ["simulate", "kinematic-symmetric", "--omega", "2,4", "--model", "skid,coulomb"];
    let several = [&several[..], &["--model", "no-skid", "--model", "skid"]].concat();
    let json = succeed(folder.path(), &[&several[..], &["--json"]].concat());
    let answers: Vec<Value> = serde_json::from_str(&json).expect("an array");
    let models: Vec<&str> = answers.iter().filter_map(|answer| answer["model"].as_str()).collect();
    assert_eq!(models, ["skid", "skid", "coulomb", "coulomb", "no-skid", "no-skid"]);
    let alone = simulate("kinematic-symmetric", "coulomb", "2,4", &[]);
    assert_eq!(answers[2..4], alone);

    let csv = succeed(folder.path(), &[&several[..], &["--csv"]].concat());
    let lines: Vec<Vec<String>> = csv.lines().map(fields).collect();
    assert_eq!(lines.len(), 7);
    let column = |name: &str| lines[0].iter().position(|known| known == name).expect(name);
    for (line, answer) in lines[1..].iter().zip(&answers) {
        let text = |name: &str| line[column(name)].as_str();
        assert_eq!(Value::from(text("model")), answer["model"]);
        assert_eq!(Value::from(text("status")), answer["status"]);
        let limit = &answer["sharp_limit"]["metrics"];
        for (name, known) in [
            ("omega_rad_s", &answer["omega_rad_s"]),
            ("d_m", &answer["d_m"]),
            ("sigma1", &answer["sigma"][1]),
            ("work_j_m", &answer["work_j_m"]),
            ("cost_of_transport", &answer["cost_of_transport"]),
            ("floquet", &answer["floquet"]),
            ("sharp_limit_d_m", &limit["d_m"]),
        ] {
            assert_eq!(text(name).parse::<f64>().ok(), known.as_f64(), "{name}: {answer}");
        }
    }
    let table = succeed(folder.path(), &several);
    assert!(table.lines().nth(3).is_some_and(|line| line.starts_with("coulomb ")), "{table}");

    let page = trilink(folder.path(), &[&several[..], &["--page", "p.html"]].concat());
    assert!(text(&page.stderr).contains("--page: found 3 models, needed one"));
}

#[test]
fn the_numbers_of_a_gait_can_be_set_of_commanded_joints() {
    let folder = empty_folder();
    let own = "[gait.ours]\njoint1 = { offset_deg = 10.0, amplitude_deg = 25.0 }\n\
               joint2 = { amplitude_deg = 30.0, phase_deg = -80.0 }\n\
               [campaign.ours]\nrobot = \"kinematic\"\ngait = \"ours\"\nmodels = [\"skid\"]\n\
               weights = { d = 10.0, v = 1.0, sigma = 1.0, alpha = 0.0 }\n";
    std::fs::write(folder.path().join("pipeline.toml"), own).unwrap();
    let motion = ["simulate", "ours", "--model", "skid", "--omega", "3", "--json"];
    let known: Value = serde_json::from_str(&succeed(folder.path(), &motion)).unwrap();
    let settings = ["offset1_deg=10", "amplitude1_deg=25", "phase2_deg=-80"];
    let found = simulate("kinematic-symmetric", "skid", "3", &settings);
    assert_eq!(known[0]["d_m"], found[0]["d_m"]);
    assert_eq!(known[0]["gait"], found[0]["gait"]);
    let of_file = simulate("kinematic-symmetric", "skid", "3", &[]);
    assert_ne!(of_file[0]["d_m"], found[0]["d_m"]);

    for (campaign, setting, named) in [
        ("kinematic-symmetric", "amplitud1_deg=20", "did you mean `amplitude1_deg`?"),
        ("kinematic-symmetric", "skid_kgs=20", "did you mean `skid_kg_s`?"),
        ("kinematic-symmetric", "phase2_deg=x", "found `x`, needed a number (in degrees)"),
        ("kinematic-symmetric", "amplitude2_deg=200", "joint2.amplitude_deg`: found 200.0"),
        ("kinematic-symmetric", "offset3_deg=2", "or one of the keys of the gait, `offset1_deg`"),
        ("semi-passive-symmetric", "offset1_deg=2", "joint 1, which is passive"),
    ] {
        let motion = ["simulate", campaign, "--model", "skid", "--omega", "3", "--set", setting];
        let output = trilink(empty_folder().path(), &motion);
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains(named), "{setting}: {stderr}");
    }
}

#[test]
fn a_second_harmonic_is_one_in_the_file_and_in_settings_and_counts() {
    let folder = empty_folder();
    let own = |second: &str| {
        format!(
            "[gait.ours]\njoint1 = {{ amplitude_deg = 30.0{second} }}\n\
             joint2 = {{ amplitude_deg = 30.0, phase_deg = -90.0 }}\n\
             [campaign.ours]\nrobot = \"kinematic\"\ngait = \"ours\"\nmodels = [\"skid\"]\n\
             weights = {{ d = 10.0, v = 1.0, sigma = 1.0, alpha = 0.0 }}\n"
        )
    };
    let write = |text: String| std::fs::write(folder.path().join("pipeline.toml"), text).unwrap();
    write(own(", amplitude2_deg = 8.0, phase2_deg = 100.0"));
    let motion = ["simulate", "ours", "--model", "skid", "--omega", "3", "--json"];
    let known: Value = serde_json::from_str(&succeed(folder.path(), &motion)).unwrap();
    let settings = ["second_amplitude1_deg=8", "second_phase1_deg=100"];
    let found = simulate("kinematic-symmetric", "skid", "3", &settings);
    assert_eq!(known[0]["d_m"], found[0]["d_m"]);
    assert_ne!(simulate("kinematic-symmetric", "skid", "3", &[])[0]["d_m"], found[0]["d_m"]);
    let all = succeed(folder.path(), &[&motion[..6], &["--sensitivities"]].concat());
    assert!(all.contains("second_amplitude1_deg") && !all.contains("second_phase2"), "{all}");

    write(own(", phase2_deg = 100.0"));
    let output = trilink(folder.path(), &motion);
    let stderr = text(&output.stderr);
    assert!(stderr.contains("gait.ours.joint1.phase2_deg"), "{stderr}");
    assert!(stderr.contains("needed amplitude2_deg as well"), "{stderr}");
}

#[test]
fn a_robot_with_standard_deviations_can_be_set_too() {
    let folder = empty_folder();
    let mut config = Config::default();
    let robot = config
        .robot
        .get_mut("kinematic")
        .and_then(RobotConfig::three_links_mut)
        .expect("the paper's robot");
    robot.set_deviation(trilink_robot::Quantity::H, [0.001]);
    let text_of = toml::to_string(&config).expect("the configuration can be written");
    std::fs::write(folder.path().join("pipeline.toml"), text_of).expect("the file is writable");
    let motion = ["simulate", "kinematic-symmetric", "--model", "skid", "--omega", "3", "--json"];
    let set = ["--set", "h_m=0.15", "skid1_kg_s=40"];
    let found: Value =
        serde_json::from_str(&succeed(folder.path(), &[&motion[..], &set].concat())).unwrap();
    assert_eq!(found[0]["parameters"]["h_m"], 0.15);
    assert_eq!(found[0]["parameters"]["standard_deviation"]["h_m"], 0.001);
    let known = simulate("kinematic-symmetric", "skid", "3", &set[1..]);
    assert_eq!(found[0]["d_m"], known[0]["d_m"]);
}

#[test]
fn a_trajectory_is_written_as_its_file_s_ending_says() {
    let folder = empty_folder();
    let motion = ["simulate", "kinematic-skewed", "--model", "skid,no-skid", "--omega", "3"];
    let motion = [&motion[..], &["--samples", "8", "--trajectory"]].concat();
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    for name in ["t.parquet", "t.csv", "t.json"] {
        succeed(folder.path(), &[&motion[..], &[name]].concat());
    }
    let table = Table::read(&folder.path().join("t.parquet")).expect("a table");
    let rows = TrajectoryRow::from_table(&table).expect("with the documented columns");
    let of_json: Vec<Value> = serde_json::from_str(&read("t.json")).expect("an array");
    let csv = read("t.csv");
    let lines: Vec<Vec<String>> = csv.lines().map(fields).collect();
    assert_eq!((rows.len(), of_json.len(), lines.len()), (18, 18, 19));
    let x = lines[0].iter().position(|name| name == "x_m").expect("a column");
    for ((row, json), line) in rows.iter().zip(&of_json).zip(&lines[1..]) {
        assert_eq!((json["x_m"].as_f64(), line[x].parse().ok()), (Some(row.x_m), Some(row.x_m)));
        assert_eq!(
            (json["model"].as_str(), line[0].as_str()),
            (Some(row.model.name()), row.model.name())
        );
    }
    let output = trilink(folder.path(), &[&motion[..], &["t.xlsx"]].concat());
    assert_eq!(output.status.code(), Some(2));
    let named = "--trajectory: found `t.xlsx`, needed a file name that ends in .parquet, .csv or \
                 .json";
    assert!(text(&output.stderr).contains(named), "{}", text(&output.stderr));
}

#[test]
fn a_frequency_list_ends_where_its_option_does() {
    let folder = empty_folder();
    let answers = succeed(
        folder.path(),
        &["simulate", "--model", "no-skid", "--omega", "1", "--omega", "2", "kinematic-skewed"],
    );
    assert_eq!(answers.lines().count(), 3, "{answers}");
}

#[test]
fn a_reader_may_close_the_pipe_before_the_end_of_the_results() {
    let folder = empty_folder();
    let mut child = Command::new(env!("CARGO_BIN_EXE_trilink"))
        .args(["simulate", "kinematic-skewed", "--model", "no-skid", "--omega", "0.5..6/2000"])
        .current_dir(folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("the program ends");
    assert_eq!(
        text(&output.stderr),
        "no pipeline.toml in the current folder: the paper's robots, gaits, campaigns and markers are assumed\n"
    );
    assert_eq!(output.status.code(), Some(0));
}

#[test]
fn a_model_of_one_s_own_moves_by_its_laws() {
    let folder = empty_folder();
    let own = "[model.ours]\nskid = \"viscous\"\nroll = \"none\"\nfree = [\"skid1\"]\n";
    std::fs::write(folder.path().join("pipeline.toml"), own).unwrap();
    let answer = |model: &str| {
        let motion = ["simulate", "kinematic-skewed", "--omega", "3.9", "--json", "--model", model];
        let output = trilink(folder.path(), &motion);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        text(&output.stdout).replace(&format!("\"model\": \"{model}\""), "\"model\": \"\"")
    };
    assert_eq!(answer("ours"), answer("skid"));
    assert_ne!(answer("ours"), answer("skid-roll"));
}

#[test]
fn dry_friction_is_in_newtons_or_a_fraction_of_the_load() {
    let d_m = |settings: &[&str]| {
        let answers = simulate("kinematic-symmetric", "coulomb", "3.9", settings);
        answers[0]["d_m"].as_f64().unwrap()
    };
    let limit = &simulate("kinematic-symmetric", "coulomb", "3.9", &[])[0]["sharp_limit"];
    let limit = &["metrics", "uncertainty"].map(|of| limit[of]["d_m"].as_f64().unwrap());
    assert!((0.4518 - limit[0]).abs() < limit[1] && limit[1] < 1e-3, "{limit:?}");
    // Values computed by an independent program for these coefficients.
    let known = d_m(&[]);
    assert!(near(known, 0.4477698751, 1e-6), "{known}");
    assert_eq!(d_m(&["skid_dry_n=1.8,0.9,0.9", "transition_m_s=0.005"]), known);
    assert_eq!(d_m(&["load_n=7.2,3.6,3.6", "skid_dry_n=0.25,0.25,0.25"]), known);
    let other = d_m(&["skid_dry0=2.4", "skid_dry2_n=0.7"]);
    assert_eq!(d_m(&["skid_dry_n=2.4,0.9,0.7"]), other);
    assert!((other / known - 1.0).abs() > 1e-3, "{other}");
}

#[test]
fn parameters_that_a_law_needs_and_a_robot_lacks_are_reported() {
    let folder = empty_folder();
    let own = "[model.ours]\nskid = \"stribeck\"\nroll = \"none\"\n";
    std::fs::write(folder.path().join("pipeline.toml"), own).unwrap();
    let motion = ["simulate", "kinematic-skewed", "--model", "ours", "--omega", "1"];
    let output = trilink(folder.path(), &motion);
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    for named in
        ["`robot.kinematic.skid_static_n`", "`ours` (skid = \"stribeck\", roll = \"none\")"]
    {
        assert!(stderr.contains(named), "{stderr}");
    }
}

#[test]
fn unknown_names_are_answered_with_the_most_similar_known_one() {
    let folder = empty_folder();
    for (campaign, model, near) in [
        ("kinematic-symetric", "no-skid", "did you mean `kinematic-symmetric`?"),
        ("kinematic-symmetric", "skid-rol", "did you mean `skid-roll`?"),
    ] {
        let output =
            trilink(folder.path(), &["simulate", campaign, "--model", model, "--omega", "1"]);
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains(near), "{stderr}");
        assert!(output.stdout.is_empty());
    }
}

/// Returns the rows that `simulate --trajectory` writes, and standard error.
fn trajectory(folder: &Path, arguments: &[&str]) -> (Vec<TrajectoryRow>, String) {
    let output =
        trilink(folder, &[&["simulate"], arguments, &["--trajectory", "t.parquet"]].concat());
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    let table = Table::read(&folder.join("t.parquet")).expect("a table");
    (TrajectoryRow::from_table(&table).expect("with the documented columns"), stderr)
}

/// Returns the time integral of a quantity over the rows by the trapezoidal rule, which is exact to many digits for a
/// whole period.
fn integral(rows: &[TrajectoryRow], of: impl Fn(&TrajectoryRow) -> f64) -> f64 {
    rows.windows(2)
        .map(|pair| 0.5 * (of(&pair[0]) + of(&pair[1])) * (pair[1].time_s - pair[0].time_s))
        .sum()
}

#[test]
fn a_trajectory_is_one_steady_cycle_whose_numbers_agree_with_the_answer() {
    let folder = empty_folder();
    for (campaign, model) in [
        ("kinematic-skewed", "skid-roll"),
        ("kinematic-skewed", "no-skid"),
        ("semi-passive-symmetric", "skid-roll"),
        ("semi-passive-symmetric", "no-skid-roll"),
    ] {
        let arguments = [campaign, "--model", model, "--omega", "3.9"];
        let answers = simulate(campaign, model, "3.9", &[]);
        let number = |key: &str| answers[0][key].as_f64().expect("a number");
        let (rows, stderr) = trajectory(folder.path(), &arguments);
        assert!(stderr.contains("t.parquet: 241 samples"), "{stderr}");
        assert_eq!(rows.len(), 241);
        let (first, last) = (&rows[0], &rows[240]);
        assert_eq!((first.time_s, first.x_m, first.y_m, first.theta_rad), (0.0, 0.0, 0.0, 0.0));
        assert!(near(last.time_s, std::f64::consts::TAU / 3.9, 1e-12));
        assert!(near(last.x_m.hypot(last.y_m), number("d_m"), 1e-8), "{campaign} {model}");
        assert!((last.theta_rad - number("dtheta_rad")).abs() < 1e-8);
        // Periodic quantities return to their initial values.
        for of in [
            |row: &TrajectoryRow| row.phi_rad[0],
            |row: &TrajectoryRow| row.phi_rad[1],
            |row: &TrajectoryRow| row.roll_m_s[0],
            |row: &TrajectoryRow| row.skid_m_s[1],
            |row: &TrajectoryRow| row.lateral_n[2],
            |row: &TrajectoryRow| row.torque_nm[1],
        ] {
            let size = rows.iter().map(|row| of(row).abs()).fold(1e-6, f64::max);
            assert!((of(first) - of(last)).abs() <= 1e-6 * size, "{campaign} {model}");
        }
        // Velocities are derivatives of the coordinates, and the integral of the power equals the work that the solver reports.
        let moved = integral(&rows, |row| row.x_rate_m_s);
        assert!((moved - last.x_m).abs() < 1e-4 * number("d_m"), "{moved} {}", last.x_m);
        let (work, loss) = (integral(&rows, |row| row.power_w), integral(&rows, |row| row.loss_w));
        let scale = number("work_j").abs().max(1e-3);
        assert!((work - number("work_j")).abs() < 1e-6 * scale, "{campaign} {model}: {work}");
        assert!((loss - work).abs() < 1e-6 * scale, "{campaign} {model}: {loss} {work}");
        // Friction opposes the motion; constraints keep the wheels from skidding.
        for row in &rows {
            assert!(row.roll_n[0] * row.roll_m_s[0] <= 0.0);
            assert!(model != "skid-roll" || row.lateral_n[0] * row.skid_m_s[0] <= 0.0);
            assert!(model == "skid-roll" || row.skid_m_s[0].abs() < 1e-12);
        }
    }
}

#[test]
fn several_frequencies_are_one_table() {
    let folder = empty_folder();
    let arguments = ["kinematic-skewed", "--model", "skid", "--omega", "1,2", "--samples", "16"];
    let (rows, _) = trajectory(folder.path(), &arguments);
    let of = |omega: f64| rows.iter().filter(|row| row.omega_rad_s == omega).count();
    assert_eq!((rows.len(), of(1.0), of(2.0)), (34, 17, 17));
}

#[test]
fn from_rest_the_answer_has_the_settling_cycles_and_the_trajectory_the_transient() {
    let folder = empty_folder();
    let rest = ["semi-passive-symmetric", "--model", "skid-roll", "--omega", "6", "--from-rest"];
    let answers = succeed(folder.path(), &[&["simulate"], &rest[..], &["--json"]].concat());
    let answers: Value = serde_json::from_str(&answers).expect("JSON");
    let cycles = answers[0]["cycles_to_settle"].as_u64().expect("a count") as usize;
    assert!((2..=10).contains(&cycles) && answers[0]["from_rest"] == "reached");
    let steady = simulate("semi-passive-symmetric", "skid-roll", "6", &[]);
    assert_eq!(steady[0]["from_rest"], "reached");
    let [d_m, steady_m] = [&answers[0], &steady[0]].map(|answer| answer["d_m"].as_f64().unwrap());
    assert!(near(d_m, steady_m, 1e-9));

    let (rows, _) = trajectory(folder.path(), &rest);
    assert_eq!(rows.len(), 240 * (cycles + 1) + 1);
    // Everything is at rest except the commanded joint, which starts with its command.
    assert_eq!(
        (rows[0].roll_m_s[0], rows[0].phi_rad[0], rows[0].phi_rate_rad_s[0]),
        (0.0, 0.0, 0.0)
    );
    let of_cycle = |cycle: usize| {
        let (from, to) = (&rows[240 * cycle], &rows[240 * (cycle + 1)]);
        (to.x_m - from.x_m).hypot(to.y_m - from.y_m)
    };
    assert!(!near(of_cycle(0), d_m, 0.1) && near(of_cycle(cycles), d_m, 0.02));

    let text = succeed(folder.path(), &[&["simulate"], &rest[..]].concat());
    assert!(text.contains(&format!("stable, reached from rest after {cycles} cycles")), "{text}");
}

#[test]
fn a_motion_that_the_robot_does_not_reach_is_said_to_be_one() {
    let folder = empty_folder();
    let lightly = ["semi-passive-symmetric", "--model", "no-skid", "--omega", "0.2"];
    let damping = ["--set", "stiffness_nm_rad=0.188", "--set", "damping_nm_s_rad=0.001"];
    let arguments = [&["simulate"], &lightly[..], &damping[..]].concat();
    let table = succeed(folder.path(), &arguments);
    assert!(table.contains("stable, but starting from rest, the robot does not settle"), "{table}");
    let output = trilink(folder.path(), &[&arguments[..], &["--from-rest", "--json"]].concat());
    assert_eq!(output.status.code(), Some(1));
    let answers: Value = serde_json::from_str(&text(&output.stdout)).expect("JSON");
    assert_eq!(answers[0]["status"], "diverged");
    assert_eq!(answers[0]["d_m"], Value::Null);
    let reason = answers[0]["reason"].as_str().expect("a reason");
    assert!(reason.contains("has not settled after 500 cycles"), "{reason}");
}

#[test]
fn unbounded_constraint_forces_are_left_empty_with_a_message() {
    let folder = empty_folder();
    let (rows, stderr) =
        trajectory(folder.path(), &["kinematic-symmetric", "--model", "no-skid", "--omega", "4"]);
    assert!(stderr.contains("det W_b = 0"), "{stderr}");
    // The gait passes phi1 = phi2 twice per cycle, at sampled times.
    let missing: Vec<usize> = (0..rows.len()).filter(|&i| rows[i].lateral_n[0].is_nan()).collect();
    assert_eq!(missing, [30, 150]);
    assert!(rows.iter().all(|row| row.power_w.is_finite() && row.x_rate_m_s.is_finite()));
}

#[test]
fn a_trajectory_that_cannot_be_written_is_an_error_and_leaves_nothing() {
    let folder = empty_folder();
    std::fs::create_dir(folder.path().join("taken.parquet")).expect("a folder");
    let arguments = ["simulate", "kinematic-skewed", "--model", "skid", "--omega", "1"];
    let output =
        trilink(folder.path(), &[&arguments[..], &["--trajectory", "taken.parquet"]].concat());
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("taken.parquet: cannot be written"), "{stderr}");
    assert_eq!(
        std::fs::read_dir(folder.path().join("taken.parquet")).expect("still there").count(),
        0
    );
    for samples in ["0", "7", "x"] {
        let output = trilink(folder.path(), &[&arguments[..], &["--samples", samples]].concat());
        assert_eq!(output.status.code(), Some(2));
    }
}

/// Returns the data of the replay script in a page written by `simulate --page`.
pub(crate) fn replay_of(page: &str) -> Value {
    let start = "<script type=\"application/json\">";
    let from = page.find(start).expect("a replay") + start.len();
    serde_json::from_str(&page[from..][..page[from..].find("</script>").unwrap()]).expect("JSON")
}

/// Returns the running sums of integers, converted from units of 1e-4 to SI units.
pub(crate) fn sums(differences: &Value) -> Vec<f64> {
    let mut sum = 0;
    let mut add = |step: &Value| {
        sum += step.as_i64().expect("a whole number");
        1e-4 * sum as f64
    };
    differences.as_array().expect("an array").iter().map(&mut add).collect()
}

#[test]
fn a_page_animates_the_transient_with_its_forces_and_needs_no_other_file() {
    let folder = empty_folder();
    let motion = ["kinematic-skewed", "--model", "skid-roll", "--omega", "3.9"];
    let arguments = [&["simulate"], &motion[..], &["--json", "--page", "motion.html"]].concat();
    let answers: Value = serde_json::from_str(&succeed(folder.path(), &arguments)).unwrap();
    let page = std::fs::read_to_string(folder.path().join("motion.html")).unwrap();
    for outside in ["http:", "https:", "<script src", "<link"] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert!(page.contains("role=\"img\" aria-label=\"Motion of kinematic-skewed, skid-roll, 3.9"));
    let replay = replay_of(&page);
    let time_s = sums(&replay["time"]);
    let settled = answers[0]["cycles_to_settle"].as_u64().expect("it settles") as usize;
    let frames = 299 / (settled + 2);
    assert_eq!(time_s.len(), frames * (settled + 2) + 1);
    assert!(page.contains(&format!("shows {} cycles of {frames} frames each.", settled + 2)));

    let stride = 240_usize.div_ceil(frames);
    let samples = (frames * stride).to_string();
    let rest = [&motion[..], &["--from-rest", "--samples", samples.as_str()]].concat();
    let (rows, _) = trajectory(folder.path(), &rest);
    assert_eq!(rows.len(), (settled + 1) * frames * stride + 1);
    let of = |name: &str| {
        let quantities = replay["quantities"].as_array().unwrap();
        let found = quantities.iter().find(|quantity| quantity["name"] == name);
        found.unwrap_or_else(|| panic!("{name}")).clone()
    };
    let column = |of: &Value, nth: usize| sums(&of["values"][nth]);
    let measured = &replay["motions"][0];
    type Of = fn(&TrajectoryRow) -> f64;
    let known: [(Vec<f64>, Of); 9] = [
        (time_s, |row| row.time_s),
        (sums(&measured["x"]), |row| row.x_m),
        (sums(&measured["theta"]), |row| row.theta_rad),
        (sums(&measured["phi"][1]), |row| row.phi_rad[1]),
        (column(&of("Skid velocity"), 2), |row| row.skid_m_s[2]),
        (column(&of("Skid friction"), 1), |row| row.lateral_n[1]),
        (column(&of("Roll friction"), 0), |row| row.roll_n[0]),
        (column(&of("Torque of joints 1, 2"), 1), |row| row.torque_nm[1]),
        (column(&of("Power of the actuators"), 0), |row| row.power_w),
    ];
    for (nth, (shown, of)) in known.iter().enumerate() {
        for (row, shown) in rows.iter().step_by(stride).zip(shown) {
            assert!((of(row) - shown).abs() < 0.50001e-4, "{nth}: {shown} and {}", of(row));
        }
    }
    let work_j = column(&of("Work of the actuators"), 0)[(settled + 1) * frames];
    assert!(near(work_j, integral(&rows, |row| row.power_w), 1e-3), "{work_j}");
    // Both kinds of forces are drawn to the same scale.
    let [across, along] = ["Skid friction", "Roll friction"].map(of);
    assert!(across["arrow"].as_f64() > Some(0.0) && across["arrow"] == along["arrow"]);
    assert_eq!((&across["across"], &along["across"]), (&true.into(), &false.into()));

    succeed(folder.path(), &arguments);
    assert_eq!(std::fs::read_to_string(folder.path().join("motion.html")).unwrap(), page);
}

#[test]
fn a_page_needs_a_single_motion_that_exists() {
    let folder = empty_folder();
    let several = ["simulate", "kinematic-skewed", "--model", "skid", "--omega", "3.9,4"];
    let output = trilink(folder.path(), &[&several[..], &["--page", "motion.html"]].concat());
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("--page: found 2 frequencies, needed one"));
    assert!(!folder.path().join("motion.html").exists());
    for (model, name) in [("no-skid", "Constraint force"), ("no-skid-roll", "Roll friction")] {
        let arguments = ["simulate", "semi-passive-symmetric", "--model", model, "--omega", "4"];
        succeed(folder.path(), &[&arguments[..], &["--page", "motion.html"]].concat());
        let page = std::fs::read_to_string(folder.path().join("motion.html")).unwrap();
        assert!(replay_of(&page)["time"].as_array().unwrap().len() <= 300);
        assert!(page.contains(&format!("</span>{name} of ")), "{model}");
    }
}
