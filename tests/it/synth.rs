//! Synthetic trials: the same for a seed, and like what the camera system writes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde_json::Value;
use trilink_mechanics::{Laws, Problem, REFERENCE_ACCURACY};
use trilink_robot::Model;
use trilink_synth::Recipe;
use trilink_tables::Table;
use trilink_tables::config::Config;

use crate::common::{files, succeed, text, trilink};

const RATE_HZ: f64 = 120.0;
/// Frame and sub-frame, then three coordinates of each of ten markers.
const FIELDS: usize = 2 + 3 * 10;

type Folder = BTreeMap<PathBuf, Vec<u8>>;

/// What synth writes for a seed and a number of threads.
fn synth(seed: &str, threads: &str) -> Folder {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let arguments = ["synth", "trials", "--omega", "1,3.9", "--seed", seed, "--threads", threads];
    succeed(folder.path(), &arguments);
    files(&folder.path().join("trials"))
}

/// The folder that the tests look at.
fn trials() -> &'static Folder {
    static TRIALS: OnceLock<Folder> = OnceLock::new();
    TRIALS.get_or_init(|| synth("1", "1"))
}

/// The marker files of gaits.
fn exports() -> Vec<(&'static Path, String)> {
    let exports: Vec<_> = trials()
        .iter()
        .filter(|(path, _)| path.extension().is_some_and(|extension| extension == "csv"))
        .filter(|(path, _)| {
            text_of(path).contains("-symmetric-") || text_of(path).contains("-skewed-")
        })
        .map(|(path, bytes)| (path.as_path(), text(bytes)))
        .collect();
    assert_eq!(exports.len(), 6);
    exports
}

/// The fields of each frame.
fn frames(export: &str) -> Vec<Vec<&str>> {
    export.lines().skip(5).map(|line| line.split(',').collect()).collect()
}

#[test]
fn a_seed_gives_the_same_bytes_at_every_run_and_with_any_number_of_threads() {
    assert!(synth("1", "1") == *trials());
    assert!(synth("1", "2") == *trials());
}

#[test]
fn another_seed_gives_other_bytes() {
    let others = synth("2", "2");
    assert_eq!(others.keys().collect::<Vec<_>>(), trials().keys().collect::<Vec<_>>());
    for (path, bytes) in &others {
        // The list says what was commanded, which is the same.
        let same = path == Path::new("trials.toml");
        assert_eq!(*bytes == trials()[path], same, "{}", path.display());
    }
}

#[test]
fn a_folder_that_was_made_by_synth_is_made_anew() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let arguments = ["synth", "trials", "--omega", "3.9", "--seed"];
    for seed in ["1", "2", "1"] {
        succeed(folder.path(), &[&arguments[..], &[seed]].concat());
    }
    let again = files(&folder.path().join("trials"));
    let other = tempfile::tempdir().expect("a temporary folder");
    succeed(other.path(), &[&arguments[..], &["1"]].concat());
    assert!(again == files(&other.path().join("trials")));
}

#[test]
fn the_files_have_the_header_and_line_ends_of_an_export() {
    for (path, export) in exports() {
        let name = path.display();
        assert_eq!(export.matches('\n').count(), export.matches("\r\n").count(), "{name}");
        assert!(export.ends_with("\r\n"), "{name}");
        let lines: Vec<&str> = export.lines().take(5).collect();
        assert_eq!(lines[..2], ["Trajectories", "120"], "{name}");
        assert!(lines[2].starts_with(",,Snake:M1,,,Snake:M2,,,"), "{name}: {}", lines[2]);
        assert!(lines[3].starts_with("Frame,Sub Frame,X,Y,Z,X,Y,Z,"), "{name}: {}", lines[3]);
        assert!(lines[4].starts_with(",,mm,mm,mm,"), "{name}: {}", lines[4]);
    }
}

#[test]
fn frames_count_up_from_another_than_the_first() {
    for (path, export) in exports() {
        let frames = frames(&export);
        let number = |i: usize| frames[i][0].parse::<usize>().expect("a frame's number");
        assert_ne!(number(0), 1, "{}", path.display());
        for (i, frame) in frames.iter().enumerate() {
            assert_eq!(number(i), number(0) + i);
            assert_eq!(frame[1], "0");
            assert_eq!(frame.len(), FIELDS);
        }
    }
}

#[test]
fn a_trial_goes_on_for_at_least_eight_cycles_after_the_transient() {
    for (path, export) in exports() {
        let omega = if text_of(path).contains("-1.00-") { 1.0 } else { 3.9 };
        let cycles = frames(&export).len() as f64 / RATE_HZ * omega / std::f64::consts::TAU;
        assert!(cycles > 10.0, "{}: {cycles}", path.display());
    }
}

fn text_of(path: &Path) -> &str {
    path.to_str().expect("a plain name")
}

#[test]
fn numbers_have_at_most_six_significant_digits() {
    for (path, export) in exports() {
        let mut six = 0;
        for number in frames(&export).iter().flat_map(|frame| &frame[2..]) {
            let digits: String = number.chars().filter(char::is_ascii_digit).collect();
            let significant = digits.trim_start_matches('0').len();
            assert!(significant <= 6, "{}: {number}", path.display());
            six += usize::from(significant == 6);
        }
        assert!(six > 1000, "{}: rounded further than the camera system does", path.display());
    }
}

#[test]
fn gaps_are_whole_markers_and_as_frequent_and_long_as_in_real_exports() {
    let mut gaps = Vec::new();
    for (path, export) in exports() {
        let frames = frames(&export);
        let mut missing = 0;
        for marker in 0..10 {
            let mut gap = 0;
            for frame in &frames {
                let place = &frame[2 + 3 * marker..5 + 3 * marker];
                let empty = place.iter().filter(|number| number.is_empty()).count();
                assert!(empty == 0 || empty == 3, "{}: {place:?}", path.display());
                if empty == 3 {
                    missing += 1;
                    gap += 1;
                } else if gap > 0 {
                    gaps.push(std::mem::take(&mut gap));
                }
            }
            if gap > 0 {
                gaps.push(gap);
            }
        }
        let share = missing as f64 / (10 * frames.len()) as f64;
        assert!((0.02..=0.09).contains(&share), "{}: {share}", path.display());
    }
    gaps.sort_unstable();
    assert_eq!(gaps[gaps.len() / 2], 1, "the median gap, frames");
    let short = gaps.iter().filter(|gap| f64::from(**gap) <= 0.1 * RATE_HZ).count();
    assert!(short as f64 >= 0.9 * gaps.len() as f64, "{short} of {} are short", gaps.len());
}

/// A folder with one campaign of the kinematic robot.
fn kinematic(gait: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = format!(
        "paths = {{ raw = \"trials\" }}\n[campaign.kinematic-{gait}]\nrobot = \"kinematic\"\ngait = \
         \"{gait}\"\nmodels = [\"skid-roll\"]\nweights = {{ d = 10.0, v = 1.0, sigma = 0.2, alpha = \
         0.0 }}\n"
    );
    std::fs::write(folder.path().join("pipeline.toml"), config).unwrap();
    folder
}

/// The poses of a kinematic trial that was synthesised and ingested in a format.
fn poses(format: &str) -> Vec<Vec<f64>> {
    let folder = kinematic("symmetric");
    succeed(folder.path(), &["synth", "trials", "--omega", "3.9", "--format", format]);
    assert!(folder.path().join(format!("trials/kinematic-symmetric-3.90-r1.{format}")).is_file());
    succeed(folder.path(), &["ingest"]);
    let path = folder.path().join("derived/poses/kinematic-symmetric-3.90-r1.parquet");
    let table = Table::read(&path).unwrap();
    let columns = ["time_s", "x_m", "y_m", "theta_rad", "phi1_rad", "phi2_rad"];
    columns.map(|column| table.values::<f64>(column).unwrap().to_vec()).into()
}

#[test]
fn c3d_and_csv_of_a_trial_give_the_same_poses() {
    let (c3d, csv) = (poses("c3d"), poses("csv"));
    // Of a link 0.1 m long this is the angle of 0.01 mm.
    let bounds = [1e-12, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4];
    for ((c3d, csv), bound) in c3d.iter().zip(&csv).zip(bounds) {
        assert_eq!(c3d.len(), csv.len());
        assert!(csv.len() > 1000);
        for (c3d, csv) in c3d.iter().zip(csv) {
            assert_eq!(c3d.is_nan(), csv.is_nan());
            assert!(c3d.is_nan() || (c3d - csv).abs() < bound, "{c3d} {csv}");
        }
    }
}

#[test]
fn trials_with_misplaced_markers_keep_their_displacement_and_every_such_frame_is_flagged() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let arguments = ["synth", "trials", "--omega", "1,3.9,6", "--seed", "3", "--misplaced", "0.1"];
    succeed(folder.path(), &arguments);
    std::fs::write(folder.path().join("pipeline.toml"), "paths = { raw = \"trials\" }").unwrap();
    // What all trials of a campaign have in common needs a person.
    assert_eq!(trilink(folder.path(), &["ingest"]).status.code(), Some(1));
    let truth = std::fs::read_to_string(folder.path().join("trials/truth.json")).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&truth).unwrap();
    let read = |name: &str| Table::read(&folder.path().join("derived").join(name)).unwrap();
    let trials = read("trials.parquet");
    for (i, trial) in trials.values::<String>("trial").unwrap().iter().enumerate() {
        let truth = &truth["trials"][trial];
        if truth.is_null() {
            continue;
        }
        let error = trials.values::<f64>("d_m").unwrap()[i] / truth["d_m"].as_f64().unwrap() - 1.0;
        assert!(error.abs() < 0.01, "{trial}: {error}");
        let message = &trials.values::<String>("message").unwrap()[i];
        assert!(message.contains("frames have two labels that are swapped, and swapped back: "));
        assert!(message.contains("frames have a marker that jumped and is left out: "));

        let poses = read(&format!("poses/{trial}.parquet"));
        let frames = poses.values::<i64>("frame").unwrap();
        let misplaced = truth["misplaced"].as_array().unwrap();
        let part = misplaced.len() as f64 / frames.len() as f64;
        assert!((0.08..0.12).contains(&part), "{trial}: {part}");
        let flagged: usize = (0..3)
            .map(|link| {
                let outliers = poses.values::<String>(&format!("outlier{link}")).unwrap();
                outliers.iter().filter(|outlier| *outlier != "none").count()
            })
            .sum();
        assert_eq!(flagged, misplaced.len(), "{trial}");
        for planted in misplaced {
            let row = (planted["frame"].as_i64().unwrap() - frames[0]) as usize;
            let outlier =
                &poses.values::<String>(&format!("outlier{}", planted["link"])).unwrap()[row];
            assert_ne!(outlier, "none", "{trial}: {planted}");
            let right = if planted["swapped"] == true { "swapped" } else { "jumped" };
            assert!([right, "ambiguous"].contains(&outlier.as_str()), "{trial}: {planted}");
            let corrected =
                &poses.values::<String>(&format!("corrected{}", planted["link"])).unwrap()[row];
            let labels = corrected.split(", ").filter(|label| !label.is_empty()).count();
            let named = ["ambiguous", "jumped", "swapped"].iter().position(|how| how == outlier);
            assert_eq!(Some(labels), named, "{trial}: {corrected}");
        }
    }
}

/// A second harmonic that makes peaks flatter is no clipping, and the joints do what they are commanded.
#[test]
fn trials_of_a_gait_with_second_harmonics_are_ingested_as_they_were_made() {
    let folder = kinematic("symmetric");
    let path = folder.path().join("pipeline.toml");
    let gait = "\n[gait.symmetric]\n\
        joint1 = { amplitude_deg = 30.0, amplitude2_deg = 6.0, phase2_deg = 170.0 }\n\
        joint2 = { amplitude_deg = 30.0, phase_deg = -90.0, amplitude2_deg = 5.0 }\n";
    let without = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, without + gait).unwrap();
    let synth = ["synth", "trials", "--omega", "2,3.9", "--law", "kinematic=skid-roll"];
    succeed(folder.path(), &[&synth[..], &["--servo-lag", "0.01"]].concat());
    trilink(folder.path(), &["ingest"]);
    let truth = truth_in(folder.path());
    let trials = Table::read(&folder.path().join("derived/trials.parquet")).unwrap();
    let column = |name: &str| trials.values::<f64>(name).unwrap().to_vec();
    let text = |name: &str| trials.values::<String>(name).unwrap().to_vec();
    let (status, message) = (text("status"), text("message"));
    let mut found = 0;
    for (i, name) in text("trial").iter().enumerate() {
        let planted = &truth["trials"][name];
        if planted.is_null() {
            continue;
        }
        let number = |of: &Value| of.as_f64().unwrap();
        let joint = &planted["gait"][0];
        // Behind the command by the lag at twice the frequency.
        let lag = (0.02 * number(&planted["omega_rad_s"])).atan();
        assert!(
            (number(&joint["phase2_rad"]) - 170_f64.to_radians() + lag).abs() < 1e-9,
            "{joint}"
        );
        assert_ne!(status[i], "failed", "{name}: {}", message[i]);
        assert!(
            !message[i].contains("harmonic") && !message[i].contains("command"),
            "{}",
            message[i]
        );
        for (of, most) in [("d_m", 2e-3), ("alpha1_rad", 2e-3), ("sigma0_debiased", 0.05)] {
            let known = match of {
                "sigma0_debiased" => number(&planted["sigma"][0]),
                of => number(&planted[of]),
            };
            let off = column(of)[i] / known - 1.0;
            assert!(off.abs() < most, "{name}: {of} {} {known}", column(of)[i]);
        }
        found += 1;
    }
    assert_eq!(found, 2);
}

/// `truth.json` of a folder with `trials`.
fn truth_in(folder: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(folder.join("trials/truth.json")).unwrap()).unwrap()
}

fn three(of: &Value) -> [f64; 3] {
    serde_json::from_value(of.clone()).unwrap()
}

#[test]
fn trials_of_a_law_have_the_motion_of_its_model_and_a_robot_has_one_floor() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("pipeline.toml"), "paths = { raw = \"trials\" }").unwrap();
    succeed(folder.path(), &["synth", "trials", "--law", "coulomb", "--omega", "2,3.9"]);
    succeed(folder.path(), &["ingest"]);
    let (truth, config) = (truth_in(folder.path()), Config::default());
    let campaigns = &truth["campaigns"];
    assert_eq!(campaigns["kinematic-skewed"], campaigns["kinematic-symmetric"]);
    let trials = Table::read(&folder.path().join("derived/trials.parquet")).unwrap();
    let column = |name: &str| trials.values::<f64>(name).unwrap().to_vec();
    let (d_m, v_m_s) = (column("d_m"), column("v_m_s"));
    let sigma = [0, 1, 2].map(|wheel| column(&format!("sigma{wheel}_debiased")));
    let mut compared = 0;
    for (i, name) in trials.values::<String>("trial").unwrap().iter().enumerate() {
        let planted = &truth["trials"][name];
        let Some((campaign, _)) = config.campaign.iter().find(|(key, _)| name.starts_with(*key))
        else {
            continue;
        };
        let of_campaign = &campaigns[campaign];
        assert_eq!(of_campaign["law"]["model"], "coulomb");
        assert!(of_campaign["skid_kg_s"].is_null());
        let (mut robot, mut gait) = config.campaign_setup(campaign).unwrap();
        let usual_n = robot.skid_dry_n;
        robot.skid_dry_n = three(&of_campaign["skid_dry_n"]);
        for (planted_n, usual_n) in robot.skid_dry_n.iter().zip(usual_n) {
            assert!((planted_n / usual_n - 1.0).abs() <= 0.1, "{planted_n} {usual_n}");
        }
        for (joint, reached) in gait.joints.iter_mut().zip(planted["gait"].as_array().unwrap()) {
            if let Some(joint) = joint {
                joint.offset_rad = reached["offset_rad"].as_f64().unwrap();
                joint.amplitude_rad = reached["amplitude_rad"].as_f64().unwrap();
            }
        }
        let omega_rad_s = planted["omega_rad_s"].as_f64().unwrap();
        let solved = Problem { robot, gait, laws: Laws::COULOMB, omega_rad_s };
        let solved = solved.solve(REFERENCE_ACCURACY).unwrap().metrics;
        for (of, measured, known) in
            [("d_m", d_m[i], solved.d_m), ("v_m_s", v_m_s[i], solved.v_m_s)]
        {
            let planted = planted[of].as_f64().unwrap();
            assert!((planted / known - 1.0).abs() < 1e-8, "{name}: {of} {planted} {known}");
            assert!((measured / planted - 1.0).abs() < 1e-3, "{name}: {of} {measured} {planted}");
        }
        for (wheel, planted) in three(&planted["sigma"]).into_iter().enumerate() {
            let measured = sigma[wheel][i];
            let near = (measured - planted).abs() < 0.03 * planted;
            assert!(near, "{name}: sigma{wheel} {measured} {planted}");
        }
        compared += 1;
    }
    assert_eq!(compared, 6);
}

#[test]
fn a_laboratory_repeats_frequencies_on_several_days_with_servos_that_lag_and_friction_that_varies()
{
    let folder = kinematic("symmetric");
    let synth = ["synth", "trials", "--omega", "2,3.9", "--law", "kinematic=coulomb"];
    succeed(folder.path(), &synth);
    let plain = files(&folder.path().join("trials"));
    let once = &truth_in(folder.path())["trials"]["kinematic-symmetric-3.90-r1"]["gait"][0];
    let repeats = ["--repeats", "3", "--repeat-omega", "3.9"];
    succeed(folder.path(), &[&synth[..], &repeats].concat());
    let repeated = files(&folder.path().join("trials"));
    for (path, bytes) in &plain {
        let same = path.extension().is_some_and(|extension| extension == "csv");
        assert!(!same || *bytes == repeated[path], "{}", path.display());
    }
    let varied = ["--days", "2", "--servo-lag", "0.02", "--servo-compliance", "0.05"];
    let varied = [&varied[..], &["--friction-variation", "0.05"]].concat();
    succeed(folder.path(), &[&synth[..], &repeats, &varied].concat());
    succeed(folder.path(), &["ingest"]);

    let truth = truth_in(folder.path());
    let day = |id: &str| truth["trials"][format!("kinematic-symmetric-{id}")]["day"].as_u64();
    let days = ["2.00-r1", "3.90-r1", "3.90-r2", "3.90-r3", "2.00-r2"].map(day);
    assert_eq!(days, [Some(1), Some(2), Some(1), Some(2), None]);
    let floors = [&truth["days"]["1"], &truth["days"]["2"]].map(|floor| floor.as_f64().unwrap());
    assert!((floors[0] + floors[1] - 2.0).abs() < 1e-12 && floors[0] != floors[1], "{floors:?}");

    let trials = Table::read(&folder.path().join("derived/trials.parquet")).unwrap();
    let column = |name: &str| trials.values::<f64>(name).unwrap().to_vec();
    let (d_m, se_m) = (column("d_m"), column("d_m_se"));
    let (amplitude_rad, phase) = (column("phi1_amplitude_rad"), column("omega_rad_s"));
    let mut found = 0;
    for (i, name) in trials.values::<String>("trial").unwrap().iter().enumerate() {
        let planted = &truth["trials"][name];
        if planted.is_null() {
            continue;
        }
        let joint = &planted["gait"][0];
        let [reached, lag] = ["amplitude_rad", "phase_rad"].map(|of| joint[of].as_f64().unwrap());
        // Behind the command by the lag, and less than the lag alone leaves by the load.
        let command = once["amplitude_rad"].as_f64().unwrap();
        let part = (1.0 + (0.02 * phase[i]).powi(2)).sqrt();
        assert!((lag + (0.02 * phase[i]).atan()).abs() < 0.03 && lag < 0.0, "{name}: {lag}");
        assert!((reached * part / command - 1.0).abs() < 0.06, "{name}: {reached} {command}");
        assert!(reached * part != command, "{name}");
        assert!(
            (amplitude_rad[i] - reached).abs() < 5e-4,
            "{name}: {} {reached}",
            amplitude_rad[i]
        );
        let d = planted["d_m"].as_f64().unwrap();
        // Each cycle has friction of its own, which the truth has not.
        assert!((d_m[i] / d - 1.0).abs() < 0.02, "{name}: {} +- {} {d}", d_m[i], se_m[i]);
        assert!(se_m[i] > 3e-4 * d, "{name}: cycles differ by {}", se_m[i]);
        found += 1;
    }
    assert_eq!(found, 4);
}

#[test]
fn the_demo_has_a_dry_robot_in_an_untidy_laboratory_and_a_tidy_viscous_one() {
    let mut config = Config::default();
    let recipe = Recipe::demo(&config, 1);
    assert_eq!(recipe.laws, BTreeMap::from([("kinematic".to_owned(), Model::new("coulomb"))]));
    assert_eq!(recipe.tidy, BTreeSet::from(["semi-passive".to_owned()]));
    // 13 frequencies, three of them with three trials in two of the campaigns, and three decays.
    assert_eq!(recipe.trials(&config), 3 * 13 + 2 * 6 + 3);
    for robot in config.robot.values_mut() {
        robot.clear(trilink_robot::Quantity::SkidDry);
    }
    let plain = Recipe::demo(&config, 1);
    assert!(plain.laws.is_empty() && plain.days == 1 && plain.trials(&config) == 3 * 13 + 3);
}

#[test]
fn what_made_the_demos_trials_competes() {
    let folder = kinematic("symmetric");
    succeed(folder.path(), &["synth", "trials", "--omega", "3.9", "--law", "coulomb"]);
    succeed(folder.path(), &["ingest"]);
    let planned = |command: &str| succeed(folder.path(), &[command, "--dry-run"]);
    assert!(planned("demo").contains("kinematic-symmetric coulomb"), "{}", planned("demo"));
    assert!(!planned("run").contains("coulomb"));
}

#[test]
fn a_motion_without_friction_is_recorded_too() {
    let folder = kinematic("skewed");
    succeed(folder.path(), &["synth", "trials", "--omega", "3", "--law", "no-skid"]);
    succeed(folder.path(), &["ingest"]);
    let planted = &truth_in(folder.path())["trials"]["kinematic-skewed-3.00-r1"];
    assert_eq!(three(&planted["sigma"]), [0.0; 3]);
    let trials = Table::read(&folder.path().join("derived/trials.parquet")).unwrap();
    let names = trials.values::<String>("trial").unwrap();
    let row = names.iter().position(|name| name == "kinematic-skewed-3.00-r1").unwrap();
    let d_m = trials.values::<f64>("d_m").unwrap()[row];
    assert!((d_m / planted["d_m"].as_f64().unwrap() - 1.0).abs() < 1e-3, "{d_m} {planted}");
}

#[test]
fn what_no_trial_can_be_made_of_is_named() {
    let folder = kinematic("symmetric");
    for (options, named) in [
        (&["--law", "coulom"][..], "found model `coulom`, needed one of `coulomb`, "),
        (&["--law", "coulom"], "did you mean `coulomb`?"),
        (&["--law", "kinematics=coulomb"], "found robot `kinematics`, needed one of `kinematic`"),
        (&["--law", "no-skid-measured"], "is driven by the measured gaits of trials"),
        (&["--law", "no-skid"], "kinematic-symmetric-2.00-r1`: at phase"),
        (&["--repeat-omega", "3"], "found 3 rad/s, needed frequencies of the trials: 2"),
        (&["--repeats", "0"], "0 is not in 1..=99"),
        (&["--days", "100"], "100 is not in 1..=99"),
        (&["--servo-lag", "20"], "found `20`, needed a number from 0 to 1 s"),
        (&["--servo-compliance", "x"], "found `x`, needed a number from 0 to 1 rad/(N m)"),
        (&["--friction-variation", "1.5"], "found `1.5`, needed a number from 0 to 1"),
    ] {
        let synth = ["synth", "trials", "--omega", "2"];
        let output = trilink(folder.path(), &[&synth[..], options].concat());
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{options:?}: {stderr}");
        assert!(stderr.contains(named), "{options:?}: {stderr}");
    }
    let other = "\n[model.ours]\nskid = \"stribeck\"\nroll = \"none\"\n";
    let path = folder.path().join("pipeline.toml");
    let config = std::fs::read_to_string(&path).unwrap() + other;
    std::fs::write(&path, config).unwrap();
    let output = trilink(folder.path(), &["synth", "trials", "--omega", "2", "--law", "ours"]);
    let stderr = text(&output.stderr);
    assert!(stderr.contains("robot.kinematic.skid_static_n"), "{stderr}");
    assert!(stderr.contains("which model `ours`"), "{stderr}");
}

#[test]
fn trials_that_are_not_synthetic_are_left_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let list =
        "[[trial]]\nid = \"a\"\nfile = \"a.csv\"\nkind = \"coast-down\"\nrobot = \"kinematic\"\n";
    std::fs::create_dir(folder.path().join("mine")).expect("a folder");
    std::fs::write(folder.path().join("mine/trials.toml"), list).expect("a list");
    let before = files(folder.path());
    let output = trilink(folder.path(), &["synth", "mine", "--omega", "3.9"]);
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("mine: has trials that were not made by synth"), "{stderr}");
    assert!(files(folder.path()) == before);
}
