//! Tests of `init`: from marker files alone to a fitted coefficient.

use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;
use trilink_robot::Model;
use trilink_tables::config::{Config, RobotConfig};
use trilink_tables::trial::{TrialKind, TrialList};
use trilink_tables::{
    Columns as _, ComparisonRow, FitRow, FitStatus, Outcome, Table, TrialRow, TrialStatus,
};

use crate::common::{succeed, text, trilink};

/// Robot whose labels and dimensions differ from the paper's; both joints are commanded.
const CART: &str = r#"
[vicon]
rate_hz = 100.0
[robot.cart]
h_m = 0.2
l_m = 0.13
b_m = 0.075
mass_kg = [1.6, 0.42, 0.38]
inertia_kg_m2 = [0.016, 0.0011, 0.0010]
roll_kg_s = [0.8, 0.4, 0.4]
skid_kg_s = [150.0, 70.0, 60.0]
skid_dry_n = [2.9, 1.3, 1.4]
[gait.level]
joint1 = { offset_deg = 0.0, amplitude_deg = 26.0, phase_deg = 0.0 }
joint2 = { offset_deg = 0.0, amplitude_deg = 31.0, phase_deg = -80.0 }
[gait.bent]
joint1 = { offset_deg = 35.0, amplitude_deg = 28.0, phase_deg = 0.0 }
joint2 = { offset_deg = -35.0, amplitude_deg = 28.0, phase_deg = -90.0 }
[campaign.weave]
robot = "cart"
gait = "level"
models = ["skid-roll"]
weights = { d = 10.0, v = 1.0, sigma = 1.0, alpha = 0.0 }
[campaign.hook]
robot = "cart"
gait = "bent"
models = ["skid-roll"]
weights = { d = 10.0, v = 1.0, sigma = 1.0, alpha = 0.0 }
[markers.link0]
Body-L = [60.0, 52.0, 70.0]
Body-R = [-20.0, -52.0, 70.0]
Body-T = [-125.0, 30.0, 85.0]
[markers.link1]
N1 = [60.0, 0.0, 50.0]
N2 = [-40.0, 33.0, 50.0]
N3 = [-35.0, -28.0, 64.0]
[markers.link2]
T1 = [-66.0, 5.0, 50.0]
T2 = [20.0, 36.0, 50.0]
T3 = [45.0, -31.0, 64.0]
"#;

/// Settings that make the fits of the tests quick without changing a coefficient. Several motions under dry friction fit
/// the same trials to different degrees, so that one or two starts do not suffice.
const QUICK: &str = "starts = 8\nbootstrap = 2\nprofiles = false\n";

/// Entries that the user adds to the configuration: masses and dimensions that no camera sees.
const EDITED: [&str; 3] =
    ["b_m = 0.075", "mass_kg = [1.6, 0.42, 0.38]", "inertia_kg_m2 = [0.016, 0.0011, 0.0010]"];

/// Creates a folder that contains only `truth.json` and, in `raw/`, the marker files of the trials whose names satisfy
/// `kept`.
fn recorded(settings: &str, omegas: &str, kept: impl Fn(&str) -> bool) -> TempDir {
    recorded_of("skid-roll", settings, omegas, kept)
}

/// Creates a folder that contains only `truth.json` and, in `raw/`, the marker files of the trials whose names satisfy
/// `kept` and whose motion follows the model.
fn recorded_of(model: &str, settings: &str, omegas: &str, kept: impl Fn(&str) -> bool) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("pipeline.toml"), settings).unwrap();
    let synth = ["-q", "synth", "raw", "--omega", omegas, "--seed", "3", "--law", model];
    succeed(path, &synth);
    std::fs::rename(path.join("raw/truth.json"), path.join("truth.json")).unwrap();
    std::fs::remove_file(path.join("pipeline.toml")).unwrap();
    for name in names(&path.join("raw")) {
        if !name.ends_with(".csv") || !kept(&name) {
            std::fs::remove_file(path.join("raw").join(name)).unwrap();
        }
    }
    folder
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn read(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).unwrap()
}

/// Replaces lines of the form `key = value` in the file `name` by those in `lines` with the same keys.
fn edit(folder: &Path, name: &str, lines: &[&str]) {
    let mut content: Vec<String> = read(folder, name).lines().map(str::to_owned).collect();
    for line in lines {
        let key = line.split(" = ").next().unwrap();
        let is_of = |of: &&mut String| of.split(" = ").next() == Some(key);
        *content.iter_mut().find(is_of).unwrap_or_else(|| panic!("no {key}")) = line.to_string();
    }
    std::fs::write(folder.join(name), content.join("\n") + "\n").unwrap();
}

/// Changes a configuration so that its fits are quick.
fn quick(folder: &Path) {
    let content = read(folder, "pipeline.toml");
    let content = match content.split_once("[fit]\n") {
        Some((before, after)) => format!("{before}[fit]\n{QUICK}{after}"),
        None => content.replacen("\n[vicon]\n", &format!("\n[fit]\n{QUICK}\n[vicon]\n"), 1),
    };
    std::fs::write(folder.join("pipeline.toml"), content).unwrap();
}

fn found(folder: &Path, arguments: &[&str], status: i32) -> Value {
    let output = trilink(folder, &[&["-q", "init", "--json"], arguments].concat());
    assert_eq!(output.status.code(), Some(status), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = trilink(folder, &[&["-q"], arguments].concat());
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stdout));
    text(&output.stderr)
}

fn truth(folder: &Path) -> Value {
    let truth: Value = serde_json::from_str(&read(folder, "truth.json")).unwrap();
    truth["campaigns"].clone()
}

/// Asserts that a model is clearly preferred and adequate, and that its free coefficients are within a relative error
/// `within` of the true values `planted`.
fn assert_preferred(folder: &Path, model: &str, planted: &Value, within: f64) {
    let table = |name: &str| Table::read(&folder.join("derived").join(name)).unwrap();
    let fits = FitRow::from_table(&table("fits.parquet")).unwrap();
    let fit = fits.iter().find(|fit| fit.model.name() == model).unwrap();
    assert_eq!((&fit.status, fit.adequate), (&FitStatus::Ok, Some(true)));
    let compared = ComparisonRow::from_table(&table("comparison.parquet")).unwrap();
    let preferred = compared.iter().find(|row| row.preferred).unwrap();
    assert_eq!((preferred.model.name(), preferred.outcome), (model, Outcome::Clear));
    for (parameter, planted) in fit.free.iter().zip(planted.as_array().unwrap()) {
        let (found, planted) = (fit.parameters[*parameter], planted.as_f64().unwrap());
        assert!((found / planted - 1.0).abs() < within, "{parameter:?}: {found} for {planted}");
    }
}

#[test]
fn dry_friction_is_identified_from_marker_files_and_dimensions() {
    let kept = |name: &str| name.starts_with("hook") || name.contains("coast");
    let folder = recorded_of("coulomb", CART, "2,4.5", kept);
    let path = folder.path();
    const GIVEN: [&str; 4] = ["--l-m", "0.13", "--front", "N1"];
    assert!(GIVEN.len() / 2 + EDITED.len() <= 5);
    // A mean skid to one side under dry friction biases the links' directions; a coast-down does not have this bias.
    let found = found(path, &[&["raw"][..], &GIVEN].concat(), 0);
    for (joint, sign) in [(0, 1.0), (1, -1.0)] {
        let offset = found["campaigns"][0]["joints"][joint]["offset_deg"].as_f64().unwrap();
        assert!((offset - sign * 35.0).abs() < 1.0, "{offset}");
    }
    edit(path, "pipeline.toml", &EDITED);
    quick(path);
    succeed(path, &["-q", "ingest"]);
    succeed(path, &["-q", "fit"]);
    assert_preferred(path, "coulomb", &truth(path)["hook"]["skid_dry_n"], 0.03);
}

#[test]
fn from_marker_files_and_dimensions_to_a_coefficient_by_five_edits() {
    let folder = recorded(CART, "2,4.5", |name| name.starts_with("weave"));
    let path = folder.path();
    // Give the files names without a meaning.
    for (i, name) in names(&path.join("raw")).iter().enumerate() {
        let new = format!("raw/Take {:02}.csv", i + 1);
        std::fs::rename(path.join("raw").join(name), path.join(new)).unwrap();
    }
    let told = succeed(path, &["-q", "init", "raw", "--l-m", "0.13"]);
    assert!(told.contains("middle link: Body-L, Body-R, Body-T"), "{told}");
    assert!(told.contains("then run: trilink check"), "{told}");

    // The user gives the length on the command line, and edits the marked lines.
    const GIVEN: [&str; 1] = ["--l-m 0.13"];
    assert!(GIVEN.len() + EDITED.len() <= 5);
    // Before the edits, commands reject the unknown numbers.
    let unknown = refused(path, &["check"]);
    assert!(
        unknown.contains("found nan for 3 keys") && unknown.contains("b_m (line "),
        "{unknown}"
    );
    edit(path, "pipeline.toml", &EDITED);
    quick(path);
    succeed(path, &["-q", "check"]);
    const EXACT: &str = "confidence limits treat the robot's declared parameters as exact";
    assert!(!succeed(path, &["run"]).contains(EXACT));

    assert_preferred(path, "skid-roll", &truth(path)["weave"]["skid_kg_s"], 0.15);
    let config = Config::load(&path.join("pipeline.toml")).unwrap();
    let (robot, gait) = config.campaign_setup("take").unwrap();
    assert!((robot.h_m[0] - 0.2).abs() < 3e-4, "{:?}", robot.h_m);
    // Typical standard uncertainties are written, each marked for review.
    let laws = config.model[&Model::new("skid-roll")].laws();
    let robots: Vec<_> = config.robot.values().filter_map(RobotConfig::three_links).collect();
    let deviations = robots[0].errors(laws, &gait).concat();
    let deviations: Vec<(&str, f64)> =
        deviations.iter().map(|(of, sd)| (of.name(), (1e7 * sd).round() / 1e7)).collect();
    let expected = [
        ("h_m", 5e-4),
        ("l_m", 5e-4),
        ("b_m", 1e-3),
        ("mass0_kg", 0.016),
        ("mass1_kg", 0.0042),
        ("mass2_kg", 0.0038),
        ("inertia0_kg_m2", 8e-4),
        ("inertia1_kg_m2", 5.5e-5),
        ("inertia2_kg_m2", 5e-5),
    ];
    assert_eq!(deviations, expected);
    let content = read(path, "pipeline.toml");
    let (_, table) = content.split_once(".standard_deviation]\n").expect("the table");
    let lines: Vec<&str> = table.lines().take_while(|line| !line.is_empty()).collect();
    assert_eq!(lines.len(), 5, "{lines:?}");
    assert!(lines.iter().all(|line| line.contains("# CHECK: standard uncertainty")), "{lines:?}");
    // Without any, the terminal says so.
    let content = lines.iter().fold(content.clone(), |content, line| content.replace(line, ""));
    std::fs::write(path.join("pipeline.toml"), content).unwrap();
    let fitted = succeed(path, &["fit"]);
    assert!(fitted.contains(EXACT) && fitted.contains(".standard_deviation]"), "{fitted}");
    let [first, second] = gait.joints.map(Option::unwrap);
    for (found, expected_deg) in [
        (first.amplitude_rad, 26.0),
        (second.amplitude_rad, 31.0),
        (first.offset_rad, 0.0),
        (second.offset_rad, 0.0),
        (second.phase_rad, -80.0),
    ] {
        let found_deg = found.to_degrees();
        assert!((found_deg - expected_deg).abs() < 1.0, "{found_deg} for {expected_deg}");
    }
}

#[test]
fn two_campaigns_in_two_folders_with_files_that_are_not_trials() {
    let folder =
        recorded(CART, "2.5,4", |name| name.starts_with("weave") || name.contains("coast"));
    let path = folder.path();
    let hook = recorded(CART, "2.5,4", |name| name.starts_with("hook"));
    for name in ["first", "second", "nothing"] {
        std::fs::create_dir(path.join(name)).unwrap();
    }
    for name in names(&path.join("raw")) {
        let to = format!("first/{name}");
        std::fs::rename(path.join("raw").join(&name), path.join(to)).unwrap();
    }
    for name in names(&hook.path().join("raw")) {
        let mut content = read(hook.path(), &format!("raw/{name}"));
        if name.contains("2.50") {
            // A subject with another name, and two markers on the floor.
            content = content.replace("Snake:", "Schlange:");
            let beside = |(i, line): (usize, &str)| match i {
                0 | 1 => format!("{line}\r\n"),
                2 => format!("{line}Wand:W1,,,Wand:W2,,,\r\n"),
                3 => format!("{line},X,Y,Z,X,Y,Z\r\n"),
                4 => format!("{line},mm,mm,mm,mm,mm,mm\r\n"),
                _ => format!("{line},1500.0,20.0,10.0,1600.0,{}.0,10.0\r\n", 40 + i % 2),
            };
            content = content.lines().enumerate().map(beside).collect();
        }
        std::fs::write(path.join("second").join(&name), content).unwrap();
    }
    let whole = std::fs::read(path.join("second/hook-4.00-r1.csv")).unwrap();
    let damaged = [&whole[..whole.len() / 3], b"\n1,0,what,is,this\n"].concat();
    std::fs::write(path.join("second/hook-9.00-r1.csv"), damaged).unwrap();

    let arguments = ["first", "second", "nothing", "--l-m", "0.13"];
    let found = found(path, &arguments, 1);
    let campaigns = found["campaigns"].as_array().unwrap();
    let named: Vec<_> = campaigns.iter().map(|of| of["name"].as_str().unwrap()).collect();
    assert_eq!(named, ["hook", "weave"]);
    for (of, offset_deg) in campaigns.iter().zip([35.0, 0.0]) {
        assert_eq!((of["files"].as_u64(), &of["passive_joint"]), (Some(2), &Value::Null));
        for (joint, sign) in [(0, 1.0), (1, -1.0)] {
            let offset = of["joints"][joint]["offset_deg"].as_f64().unwrap();
            assert!((offset - sign * offset_deg).abs() < 1.0, "{offset} for {offset_deg}");
        }
    }
    assert_eq!(found["elsewhere"], serde_json::json!(["W1", "W2"]));
    assert_eq!(found["empty"], serde_json::json!(["nothing"]));
    assert_eq!(found["robot"], "snake");
    let problem = |of: &&Value| of["problem"].is_string();
    let left_out: Vec<_> = found["files"].as_array().unwrap().iter().filter(problem).collect();
    assert_eq!(left_out.len(), 1, "{left_out:?}");
    assert_eq!(left_out[0]["file"], "hook-9.00-r1.csv");

    let [first, second] = ["first", "second"].map(|of| TrialList::load(&path.join(of)).unwrap());
    assert_eq!(second.ignore, ["hook-9.00-r1.csv"]);
    assert!(read(path, "second/trials.toml").contains("# CHECK: line"), "the reason is there");
    let omegas: Vec<_> = second.trial.iter().map(|trial| trial.omega_rad_s).collect();
    assert_eq!(omegas, [Some(2.5), Some(4.0)]);
    let kinds: Vec<_> = first.trial.iter().map(|trial| trial.kind).collect();
    assert_eq!(kinds, [TrialKind::CoastDown, TrialKind::Gait, TrialKind::Gait]);
    assert!(!path.join("nothing/trials.toml").exists());

    edit(path, "pipeline.toml", &EDITED);
    succeed(path, &["-q", "check"]);
    let checked = succeed(path, &["-q", "config", "check"]);
    assert!(checked.contains("campaign hook: robot snake, gait hook, 2 trials"), "{checked}");
}

/// Changes the coordinates of each marker in every frame of a marker file.
fn change(path: &Path, to: impl Fn([f64; 3]) -> [f64; 3]) {
    let content = std::fs::read_to_string(path).unwrap();
    let changed = |(i, line): (usize, &str)| {
        if i < 5 || line.trim().is_empty() {
            return line.to_owned();
        }
        let cells: Vec<&str> = line.split(',').collect();
        let markers = cells[2..].chunks_exact(3).flat_map(|marker| {
            let seen = marker.iter().filter(|cell| !cell.is_empty());
            let seen: Vec<f64> = seen.map(|cell| cell.parse().unwrap()).collect();
            match <[f64; 3]>::try_from(seen) {
                Ok(position) => to(position).map(|x| x.to_string()),
                Err(_) => Default::default(),
            }
        });
        let begin = cells[..2].iter().map(|cell| (*cell).to_owned());
        begin.chain(markers).collect::<Vec<_>>().join(",")
    };
    let lines: Vec<String> = content.lines().enumerate().map(changed).collect();
    std::fs::write(path, lines.join("\r\n") + "\r\n").unwrap();
}

#[test]
fn files_with_another_axis_up_are_said_to_have_it() {
    let folder = recorded(CART, "2.5,4", |name| name.starts_with("weave"));
    let path = folder.path();
    let [first, second] =
        ["weave-2.50-r1.csv", "weave-4.00-r1.csv"].map(|of| path.join("raw").join(of));
    let said = |up: &str| {
        format!(
            "the file's {up} axis points up instead of its z axis: the coordinates of the markers along {up} hardly \
             change, and the other two coordinates show three moving links; export with z up"
        )
    };
    // One of two files is left out, with the cause.
    change(&first, |[x, y, z]| [x, z, -y]);
    let left_out = found(path, &["raw", "--l-m", "0.13", "--front", "N1"], 1);
    assert_eq!(left_out["files"][0]["problem"], said("y"));
    assert_eq!(left_out["files"][1]["problem"], Value::Null);
    std::fs::remove_file(path.join("pipeline.toml")).unwrap();
    std::fs::remove_file(path.join("raw/trials.toml")).unwrap();
    // If the turned file is the only one, the cause is the reason why nothing is written.
    change(&second, |[x, y, z]| [z, x, y]);
    let refused = refused(path, &["init", "raw"]);
    for (file, up) in [("weave-2.50-r1.csv", "y"), ("weave-4.00-r1.csv", "x")] {
        assert!(refused.contains(&format!("{file}: {}", said(up))), "{refused}");
    }
    assert!(!path.join("pipeline.toml").exists());
}

#[test]
fn the_unit_of_files_that_do_not_say_theirs_is_given_once() {
    let folder = recorded(CART, "3", |name| name.starts_with("weave"));
    let path = folder.path();
    let name = "raw/weave-3.00-r1.csv";
    change(&path.join(name), |position| position.map(|x| x / 10.0));
    let content = read(path, name);
    let units = content.lines().nth(4).unwrap().to_owned() + "\r\n";
    std::fs::write(path.join(name), content.replacen(&units, "", 1)).unwrap();
    let unknown = refused(path, &["init", "raw", "--unit", "km"]);
    assert!(unknown.contains("found `km`, needed mm, cm, m or in"), "{unknown}");
    succeed(path, &["-q", "init", "raw", "--l-m", "0.13", "--unit", "cm"]);
    assert!(
        read(path, "pipeline.toml")
            .contains("unit = \"cm\"  # unit of the files that do not state one")
    );
    edit(path, "pipeline.toml", &EDITED);
    let config = Config::load(&path.join("pipeline.toml")).unwrap();
    let [h_m, _] = config.robot["snake"].three_links().unwrap().to_robot().h_m;
    assert!((h_m - 0.2).abs() < 1e-3, "{h_m}");
    succeed(path, &["-q", "check"]);

    // A file that lacks metadata is marked in the list.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("pipeline.toml"), CART).unwrap();
    let synth = ["-q", "synth", "raw", "--omega", "3", "--seed", "3", "--law", "skid-roll"];
    succeed(path, &[&synth[..], &["--format", "c3d"]].concat());
    std::fs::remove_file(path.join("pipeline.toml")).unwrap();
    let kept = "weave-3.00-r1.c3d";
    let others = names(&path.join("raw")).into_iter().filter(|name| name != kept);
    others.for_each(|name| std::fs::remove_file(path.join("raw").join(name)).unwrap());
    let mut file = std::fs::read(path.join("raw").join(kept)).unwrap();
    let at = file.windows(7).position(|bytes| bytes == b"\x05\x01UNITS").unwrap();
    file[at + 6] = b'X';
    std::fs::write(path.join("raw").join(kept), file).unwrap();
    let found = found(path, &["raw", "--l-m", "0.13"], 0);
    let told = "unit: found none (POINT:UNITS), used mm (vicon.unit)";
    let marks = found["marks"].as_array().unwrap();
    assert!(marks.iter().any(|mark| mark["of"] == "file" && mark["text"] == told), "{marks:?}");
    assert!(read(path, "raw/trials.toml").contains(&format!("# CHECK: {told}")));
}

#[test]
fn every_format_leads_to_the_same_project_without_being_named() {
    let setup = |format: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        std::fs::write(path.join("pipeline.toml"), CART).unwrap();
        let synth = ["-q", "synth", "raw", "--omega", "3,4", "--seed", "3", "--law", "skid-roll"];
        succeed(path, &[&synth[..], &["--format", format]].concat());
        for file in ["pipeline.toml", "raw/trials.toml", "raw/truth.json"] {
            std::fs::remove_file(path.join(file)).unwrap();
        }
        let mut setup = found(path, &["raw", "--l-m", "0.13"], 0);
        [setup["links"].take(), setup["campaigns"].take()]
    };
    let [links, campaigns] = setup("csv");
    let bodies = serde_json::json!([["middle"], ["front"], ["rear"]]);
    let markers = ["c3d", "motive", "trc", "qualisys", "table"].map(|format| (format, &links));
    let poses = ["tracker", "motive-bodies", "qualisys-6d", "poses", "poses-parquet"];
    for (format, links) in markers.into_iter().chain(poses.map(|format| (format, &bodies))) {
        let [own, own_campaigns] = setup(format);
        assert_eq!(own, *links, "{format}");
        let [own, all] = [&own_campaigns, &campaigns].map(|all| all.as_array().unwrap());
        assert_eq!((own.len(), all.len()), (2, 2), "{format}");
        for (own, expected) in own.iter().zip(all) {
            assert_eq!(own["name"], expected["name"], "{format}");
            let [own, expected] =
                [own, expected].map(|one| one["joints"][0]["offset_deg"].as_f64().unwrap());
            assert!((own - expected).abs() < 0.5, "{format}: {own} {expected}");
        }
    }
}

#[test]
fn nothing_is_overwritten_and_errors_are_reported() {
    let folder = recorded(CART, "3", |name| name.starts_with("weave"));
    let path = folder.path();
    std::fs::create_dir(path.join("empty")).unwrap();
    let empty = refused(path, &["init", "empty"]);
    assert!(empty.contains("empty: found no marker file"), "{empty}");
    let absent = refused(path, &["init", "absent"]);
    assert!(absent.contains("absent: cannot be read"), "{absent}");
    let millimetres = refused(path, &["init", "raw", "--l-m", "130"]);
    assert!(millimetres.contains("found `130`"), "{millimetres}");
    let no_link = refused(path, &["init", "raw", "--front", "Nose"]);
    assert!(no_link.contains("found `Nose`") && no_link.contains("N1, N2, N3"), "{no_link}");
    assert!(!path.join("pipeline.toml").exists() && !path.join("raw/trials.toml").exists());

    std::fs::write(path.join("pipeline.toml"), "# mine\n").unwrap();
    let there = refused(path, &["init", "raw"]);
    assert!(
        there.contains("pipeline.toml: file already exists; --add adds")
            && !there.contains("--force"),
        "{there}"
    );
    assert_eq!(read(path, "pipeline.toml"), "# mine\n");
    // An existing list is read, but not changed.
    let list = "[[trial]]\nid = \"a\"\nfile = \"weave-3.00-r1.csv\"\nkind = \"gait\"\ncampaign = \"mine\"\nomega_rad_s = 3.0\n";
    std::fs::write(path.join("raw/trials.toml"), list).unwrap();
    let elsewhere = found(path, &["raw", "--out", "config", "--front", "T1"], 0);
    assert_eq!(elsewhere["kept"], serde_json::json!(["raw/trials.toml"]));
    assert_eq!(elsewhere["campaigns"][0]["name"], "mine");
    assert_eq!(elsewhere["links"][1], serde_json::json!(["T1", "T2", "T3"]));
    assert_eq!(read(path, "raw/trials.toml"), list);
    let written = read(path, "config/pipeline.toml");
    assert!(written.contains("raw = \"../raw\""), "{written}");
    // A single frequency does not show whether a joint is passive, and l is estimated from the wheels.
    let marks = elsewhere["marks"].as_array().unwrap();
    let marked =
        |of: &str| marks.iter().filter(|mark| mark["text"].as_str().unwrap().contains(of)).count();
    assert_eq!((marked("--l-m"), marked("a single frequency"), marked("front link")), (1, 1, 0));

    succeed(path, &["-q", "init", "raw", "--force"]);
    assert!(read(path, "pipeline.toml").starts_with("# Created by"));
    assert!(read(path, "raw/trials.toml").contains("campaign = \"mine\""));
}

#[test]
fn a_passive_joint_is_found_and_its_parameters_are_measured() {
    let settings = include_str!("../fixtures/trolley.toml");
    let folder = recorded(settings, "2.5,4.2", |name| !name.starts_with("wriggling"));
    let path = folder.path();
    let found = found(path, &["raw", "--l-m", "0.13"], 0);
    assert_eq!(found["campaigns"][0]["passive_joint"], 2);
    let kind = |kind: &str| {
        found["files"].as_array().unwrap().iter().filter(|of| of["kind"] == kind).count()
    };
    assert_eq!([kind("gait"), kind("joint-release"), kind("coast-down")], [2, 1, 1]);
    let doubts = read(path, "pipeline.toml");
    assert!(doubts.contains("# CHECK: joint 2 is taken as passive"), "{doubts}");
    edit(path, "pipeline.toml", &EDITED);
    succeed(path, &["-q", "check"]);
}

/// Returns the draft of a chain's configuration with numbers for those that no camera sees; a link whose wheel the files
/// do not show has none.
fn filled(draft: &str) -> String {
    let mut has_wheel = true;
    let lines = draft.lines().filter_map(|line| {
        has_wheel = !line.starts_with("wheel_m = nan") && (has_wheel || line.is_empty());
        let key = line.split(" = ").next().unwrap_or_default();
        let value = match key {
            "com_m" => "0.0",
            "mass_kg" => "0.3",
            "inertia_kg_m2" => "1e-3",
            "stiffness_nm_rad" => "0.1",
            "damping_nm_s_rad" => "0.01",
            _ => return has_wheel.then(|| line.to_owned()),
        };
        Some(format!("{key} = {value}"))
    });
    lines.collect::<Vec<_>>().join("\n")
}

#[test]
fn the_links_of_chains_are_found_in_their_order_and_their_trials_can_be_processed() {
    let gallery = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/robots");
    // The letter with which the labels of each link's markers begin, from front to rear, and the passive joints.
    for (robot, letters, passive) in [
        ("twistcar.toml", "FR", &[][..]),
        ("passive-snake.toml", "HBTN", &[2, 3]),
        ("driven-snake.toml", "ABCDEFG", &[]),
    ] {
        let mut settings = read(&gallery, robot);
        let links = letters.len();
        // Labels that do not show the order of the links.
        let names = |link: usize| [1, 2, 3].map(|i| format!("K{}{i}", (3 * link + 4) % 10));
        for (link, letter) in letters.chars().enumerate() {
            for (i, name) in (1..).zip(names(link)) {
                settings = settings.replace(&format!("{letter}{i} = ["), &format!("{name} = ["));
            }
        }
        let folder = recorded(&settings, "3,4,5", |_| true);
        let path = folder.path();
        let rear = names(links - 1)[0].clone();
        found(path, &["raw", "--front", &rear], 0);
        let found = found(path, &["raw", "--front", &names(0)[0], "--force"], 0);
        let expected: Vec<[String; 3]> = (0..links).map(names).collect();
        assert_eq!(found["links"], serde_json::json!(expected), "{robot}");
        let [campaign] = &found["campaigns"].as_array().unwrap()[..] else { panic!("{robot}") };
        let known = campaign["passive_joints"].as_array().cloned().unwrap_or_default();
        assert_eq!(known, passive, "{robot}");

        let truth: Value = serde_json::from_str(&read(path, "truth.json")).unwrap();
        let of_trials = truth["trials"].as_object().unwrap();
        let gait = of_trials.values().next().unwrap()["gait"].as_array().unwrap();
        for (joint, driven) in gait.iter().enumerate().filter(|(_, driven)| !driven.is_null()) {
            let found = &campaign["joints"][joint];
            for key in ["offset", "amplitude", "phase"] {
                let number = |of: &Value, unit: &str| of[format!("{key}_{unit}")].as_f64().unwrap();
                let off_deg = number(found, "deg") - number(driven, "rad").to_degrees();
                let off_deg = (off_deg + 180.0).rem_euclid(360.0) - 180.0;
                assert!(off_deg.abs() < 1.0, "{robot} joint {}: {key} {off_deg}", joint + 1);
            }
        }
        std::fs::write(path.join("pipeline.toml"), filled(&read(path, "pipeline.toml"))).unwrap();
        succeed(path, &["-q", "ingest"]);
        let table = Table::read(&path.join("derived/trials.parquet")).unwrap();
        for row in TrialRow::from_table(&table).unwrap() {
            assert!(row.status.has_metrics(), "{robot}: {}", row.message);
            let Some(d_m) = of_trials.get(&row.id).map(|of| of["d_m"].as_f64().unwrap()) else {
                continue;
            };
            let off = (row.metrics.d_m / d_m - 1.0).abs();
            assert!(off < 0.01, "{robot}: {} {d_m}", row.metrics.d_m);
        }
    }
}

#[test]
fn a_release_alone_shows_two_links_but_no_layout() {
    let settings = include_str!("../fixtures/trolley.toml");
    let folder = recorded(settings, "2.5", |name| name.contains("release"));
    let error = refused(folder.path(), &["init", "raw"]);
    assert!(error.contains("the marker layout is not identifiable"), "{error}");
    assert!(error.trim_end().ends_with("no file shows a gait"), "{error}");
    assert!(!folder.path().join("pipeline.toml").exists());
}

#[test]
fn a_coast_down_determines_directions_that_gaits_with_offsets_bias() {
    let kept = |name: &str| name.starts_with("hook") || name.contains("coast");
    let folder = recorded(CART, "3", kept);
    let path = folder.path();
    let marked = "mean skid to one side";
    let straight = found(path, &["raw", "--l-m", "0.13", "--front", "N1"], 0);
    for (joint, offset_deg) in [(0, 35.0), (1, -35.0)] {
        let found = straight["campaigns"][0]["joints"][joint]["offset_deg"].as_f64().unwrap();
        assert!((found - offset_deg).abs() < 1.0, "{found} for {offset_deg}");
    }
    assert!(!read(path, "pipeline.toml").contains(marked));

    std::fs::remove_file(path.join("raw/cart-coast-down-r1.csv")).unwrap();
    found(path, &["raw", "--l-m", "0.13", "--front", "N1", "--force"], 0);
    assert!(read(path, "pipeline.toml").contains(marked));
}

#[test]
fn a_second_robot_is_added_to_the_configuration_of_the_first_and_both_are_on_one_page() {
    let folder = recorded(CART, "3,4", |name| name.starts_with("weave"));
    let path = folder.path();
    // The second robot has the same labels in other places and is longer.
    let other = CART
        .replace("h_m = 0.2\n", "h_m = 0.24\n")
        .replace("Body-L = [60.0, 52.0, 70.0]", "Body-L = [75.0, 40.0, 66.0]")
        .replace("N2 = [-40.0, 33.0, 50.0]", "N2 = [-30.0, 38.0, 50.0]");
    let second = recorded(&other, "3,4", |name| name.starts_with("weave"));
    std::fs::rename(second.path().join("raw"), path.join("second")).unwrap();

    succeed(path, &["-q", "init", "raw", "--l-m", "0.13", "--front", "N1"]);
    edit(path, "pipeline.toml", &EDITED);
    quick(path);
    let before = read(path, "pipeline.toml");
    let added = found(path, &["--add", "second", "--l-m", "0.13", "--front", "N1"], 0);
    assert_eq!(
        (&added["robot"], &added["campaigns"][0]["name"]),
        (&"snake-2".into(), &"weave-2".into())
    );
    let after = read(path, "pipeline.toml");
    let unchanged = before.replace("raw = \"raw\"", "raw = [\"raw\", \"second\"]");
    assert!(after.starts_with(unchanged.trim_end()), "{after}");
    let marked = added["marks"].as_array().unwrap();
    assert!(marked.iter().any(|mark| mark["of"] == "b_m"), "{marked:?}");
    let filled = after
        .replace("b_m = nan", EDITED[0])
        .replace("mass_kg = [nan, nan, nan]", EDITED[1])
        .replace("inertia_kg_m2 = [nan, nan, nan]", EDITED[2]);
    std::fs::write(path.join("pipeline.toml"), filled).unwrap();

    succeed(path, &["-q", "run"]);
    let trials = Table::read(&path.join("derived/trials.parquet")).unwrap();
    let trials = TrialRow::from_table(&trials).unwrap();
    assert_eq!(trials.len(), 4);
    for (campaign, folder, truths) in [("weave", "raw", path), ("weave-2", "second", second.path())]
    {
        let truth: Value = serde_json::from_str(&read(truths, "truth.json")).unwrap();
        let of_campaign = trials.iter().filter(|trial| trial.campaign == campaign);
        assert_eq!(of_campaign.clone().count(), 2);
        for trial in of_campaign {
            assert_eq!(trial.trial, format!("{folder}_{}", trial.id));
            let known = truth["trials"][&trial.id]["d_m"].as_f64().unwrap();
            let error = (trial.metrics.d_m / known - 1.0).abs();
            assert!(error < 0.01 && trial.status == TrialStatus::Ok, "{trial:?}");
        }
    }
    let page = read(path, "reports/index.html");
    assert!(page.contains("weave-2") && page.contains("second_weave-3.00-r1"));
    // Without its layout, the second robot's markers are not where the first robot's are.
    let without = read(path, "pipeline.toml").replace("[layout.snake-2.", "[layout.snake.");
    std::fs::write(path.join("pipeline.toml"), without).unwrap();
    let run = trilink(path, &["-q", "run"]);
    assert_eq!(run.status.code(), Some(1), "{}", text(&run.stderr));
}
