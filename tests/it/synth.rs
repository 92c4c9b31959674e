//! Tests of synthetic trials: reproducible from their seed, and in the format of the camera system.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde_json::Value;
use trilink_mechanics::{Laws, Problem, REFERENCE_ACCURACY};
use trilink_robot::Model;
use trilink_synth::Recipe;
use trilink_tables::config::{Config, RobotConfig};
use trilink_tables::trial::TrialList;
use trilink_tables::{Columns as _, Table, TrialRow, TrialStatus};

use crate::common::{files, succeed, text, trilink};

const RATE_HZ: f64 = 120.0;
/// Number of fields per row: frame and sub-frame, then three coordinates for each of ten markers.
const FIELDS: usize = 2 + 3 * 10;

type Folder = BTreeMap<PathBuf, Vec<u8>>;

/// Returns the files that `trilink synth` writes for a seed and a number of threads.
fn synth(seed: &str, threads: &str) -> Folder {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let arguments = ["synth", "trials", "--omega", "1,3.9", "--seed", seed, "--threads", threads];
    succeed(folder.path(), &arguments);
    files(&folder.path().join("trials"))
}

/// Returns the folder of trials that the tests share.
fn trials() -> &'static Folder {
    static TRIALS: OnceLock<Folder> = OnceLock::new();
    TRIALS.get_or_init(|| synth("1", "1"))
}

/// Returns the paths and contents of the marker files of gaits.
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

/// Returns the fields of each frame in an exported marker file.
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
        // The lists contain the commanded frequencies, which are equal.
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
fn frame_numbers_may_start_at_another_number_than_one() {
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

/// Creates a folder with a configuration for one campaign of the kinematic robot.
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

/// Returns the poses and the metrics of a kinematic trial that was synthesised and ingested in the given file format.
fn measured(format: &str, extension: &str) -> (Vec<Vec<f64>>, Vec<f64>) {
    let folder = kinematic("symmetric");
    succeed(folder.path(), &["synth", "trials", "--omega", "3.9", "--format", format]);
    let trial = "kinematic-symmetric-3.90-r1";
    assert!(folder.path().join(format!("trials/{trial}.{extension}")).is_file());
    succeed(folder.path(), &["ingest"]);
    let read = |name: &str| Table::read(&folder.path().join("derived").join(name)).unwrap();
    let poses = read(&format!("poses/{trial}.parquet"));
    let columns = ["time_s", "x_m", "y_m", "theta_rad", "phi1_rad", "phi2_rad"];
    let trials = read("trials.parquet");
    let row = trials.values::<String>("trial").unwrap().iter().position(|name| name == trial);
    let metrics = ["d_m", "v_m_s", "sigma0", "sigma1", "sigma2", "omega_rad_s"];
    (
        columns.map(|column| poses.values::<f64>(column).unwrap().to_vec()).into(),
        metrics.map(|column| trials.values::<f64>(column).unwrap()[row.unwrap()]).into(),
    )
}

#[test]
fn every_format_of_a_trial_gives_the_same_poses_and_metrics() {
    let (csv, metrics) = measured("csv", "csv");
    // The tolerance is 0.01 mm on a link of 0.1 m.
    let bounds = [1e-9, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4];
    for (format, extension) in
        [("c3d", "c3d"), ("motive", "csv"), ("trc", "trc"), ("qualisys", "tsv"), ("table", "csv")]
    {
        let (poses, others) = measured(format, extension);
        for ((own, csv), bound) in poses.iter().zip(&csv).zip(bounds) {
            assert_eq!(own.len(), csv.len());
            assert!(csv.len() > 1000);
            for (own, csv) in own.iter().zip(csv) {
                assert_eq!(own.is_nan(), csv.is_nan());
                assert!(own.is_nan() || (own - csv).abs() < bound, "{format}: {own} {csv}");
            }
        }
        for (own, csv) in others.iter().zip(&metrics) {
            println!("{format}: {own} {csv}");
            assert!((own / csv - 1.0).abs() < 1e-4, "{format}: {own} {csv}");
        }
    }
}

#[test]
fn trials_with_misplaced_markers_keep_their_displacement_and_every_such_frame_is_flagged() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let arguments = ["synth", "trials", "--omega", "1,3.9,6", "--seed", "3", "--misplaced", "0.1"];
    succeed(folder.path(), &arguments);
    std::fs::write(folder.path().join("pipeline.toml"), "paths = { raw = \"trials\" }").unwrap();
    // A problem that affects all trials of a campaign needs attention.
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
        assert!(message.contains("frames have two swapped labels, which are corrected: "));
        assert!(message.contains("frames have an outlying marker, which is left out: "));

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

/// A second harmonic that flattens the peaks is not mistaken for clipping, and the joints follow their commands.
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
        // The second harmonic lags as a first-order servo at twice the frequency.
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

/// Returns the content of `truth.json` in the subfolder `trials` of a folder.
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
        let solved = Problem::new(robot, gait, Laws::COULOMB, omega_rad_s);
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
    assert!(floors.iter().all(|floor| (0.8..1.2).contains(floor)), "{floors:?}");
    assert_ne!(floors[0], floors[1]);
    let listed = TrialList::load(&folder.path().join("trials")).unwrap().trial;
    let listed = listed.iter().find(|trial| trial.id == "kinematic-symmetric-3.90-r1");
    assert_eq!(listed.and_then(|trial| trial.day.as_deref()), Some("day 2"));

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
        // The joint lags behind the command, and the load makes its amplitude differ from what the lag alone would
        // give.
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
        // Friction varies between cycles, but not in the truth.
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
    // 13 frequencies, three of them with three trials in two of the campaigns, and three trials that are not gaits.
    assert_eq!(recipe.trials(&config), 3 * 13 + 2 * 6 + 3);
    for robot in config.robot.values_mut().filter_map(RobotConfig::three_links_mut) {
        robot.clear(trilink_robot::Quantity::SkidDry);
    }
    let plain = Recipe::demo(&config, 1);
    assert!(plain.laws.is_empty() && plain.days == 1 && plain.trials(&config) == 3 * 13 + 3);
}

#[test]
fn the_true_models_of_the_demo_compete() {
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
fn settings_that_no_trial_can_be_made_from_are_reported() {
    let folder = kinematic("symmetric");
    for (options, named) in [
        (&["--law", "coulom"][..], "found model `coulom`, needed one of `coulomb`, "),
        (&["--law", "coulom"], "did you mean `coulomb`?"),
        (&["--law", "kinematics=coulomb"], "found robot `kinematics`, needed one of `kinematic`"),
        (&["--law", "no-skid-measured"], "is driven by the measured gaits of trials"),
        (&["--law", "no-skid"], "kinematic-symmetric-2.00-r1`: no skid-free motion exists"),
        (&["--repeat-omega", "3"], "found 3 rad/s, needed one of the frequencies of the trials: 2"),
        (&["--repeats", "0"], "0 is not in 1..=99"),
        (&["--days", "100"], "100 is not in 1..=99"),
        (&["--slope", "3"], "found `3`, needed a slope of 0 to 2 degrees"),
        (&["--slope", "0.3,north"], "found `0.3,north`, needed a slope"),
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
    assert!(
        stderr.contains("mine: contains trials that `trilink synth` did not write"),
        "{stderr}"
    );
    assert!(files(folder.path()) == before);
}

/// The columns of a coast-down's row that this test reads, by trial.
fn coast_downs(folder: &Path) -> BTreeMap<String, Value> {
    let arguments = ["inspect", "robot_parameters", "--json"];
    let rows: Vec<Value> = serde_json::from_str(&succeed(folder, &arguments)).expect("rows");
    rows.into_iter()
        .filter(|row| row["kind"] == "coast-down")
        .map(|row| (row["trial"].as_str().expect("a name").to_owned(), row))
        .collect()
}

#[test]
fn a_tilted_floor_is_found_from_coast_downs_in_opposite_directions_and_from_no_others() {
    let folder = kinematic("symmetric");
    succeed(folder.path(), &["synth", "trials", "--omega", "3.9", "--slope", "0.3,30"]);
    let trials = folder.path().join("trials");
    let truth = std::fs::read_to_string(trials.join("truth.json")).expect("the truth");
    let truth: Value = serde_json::from_str(&truth).expect("JSON");
    assert_eq!(truth["slope"]["slope_deg"], 0.3);
    succeed(folder.path(), &["ingest"]);
    let rows = coast_downs(folder.path());
    assert_eq!(rows.len(), 4);
    // Rises per metre along x and y of a floor that rises by 0.3 degrees towards 30 degrees from x.
    let known = [0.004_534_5, 0.002_618];
    for (trial, row) in &rows {
        let truth = &truth["robots"][trial];
        assert_eq!(
            (row["law"].as_str(), row["pooled_trials"].as_i64()),
            (Some("viscous"), Some(4))
        );
        assert!(row["roll_dry_sum_n"].is_null(), "{row}");
        let heading = row["heading_rad"].as_f64().expect("a direction");
        let turned = heading - truth["heading_rad"].as_f64().expect("a direction");
        assert!(turned.sin().abs() < 0.02 && turned.cos() > 0.0, "{turned}");
        for (column, known) in [
            ("slope_x_rad", known[0]),
            ("slope_y_rad", known[1]),
            ("roll_sum_kg_s", truth["roll_sum_kg_s"].as_f64().expect("a sum")),
        ] {
            let found = row[column].as_f64().expect("a number");
            let se = row[format!("{column}_se")].as_f64().expect("a number");
            println!("{trial} {column}: {found} +- {se}, known {known}");
            assert!((found - known).abs() < 4.0 * se && se < 0.03 * known.abs(), "{column}");
        }
    }
    // Without three of the coast-downs, neither the slope nor dry friction is known.
    let list = trials.join("trials.toml");
    let text = std::fs::read_to_string(&list).expect("a list");
    let entries: Vec<&str> = text.split("[[trial]]").collect();
    let kept = entries.iter().filter(|entry| {
        !["r2", "r3", "r4"].iter().any(|r| entry.contains(&format!("coast-down-{r}")))
    });
    let text = kept.copied().collect::<Vec<_>>().join("[[trial]]");
    std::fs::write(&list, text).expect("it is written");
    for r in ["r2", "r3", "r4"] {
        let file = trials.join(format!("kinematic-coast-down-{r}.csv"));
        std::fs::remove_file(file).expect("it is removed");
    }
    let printed = succeed(folder.path(), &["ingest"]);
    assert!(
        printed.contains("kinematic-coast-down-r1: ") && printed.contains("dry friction or slope")
    );
    let rows = coast_downs(folder.path());
    let row = &rows["kinematic-coast-down-r1"];
    assert_eq!((rows.len(), row["slope_status"].as_str()), (1, Some("one direction")));
    assert_eq!(row["status"].as_str(), Some("dry friction or slope"));
    for column in ["roll_dry_sum_n", "slope_along_rad", "slope_x_rad"] {
        assert!(row[column].is_null(), "{column}");
    }
    assert!(row["roll_sum_kg_s"].is_f64(), "the viscous coefficient does not depend on the slope");
}

#[test]
fn trials_with_more_friction_are_flagged_and_not_fitted() {
    let folder = kinematic("symmetric");
    let synth = ["synth", "trials", "--omega", "2,2.5,3,3.5,4,5", "--repeats", "3"];
    succeed(folder.path(), &synth);
    assert!(truth_in(folder.path())["trials"]["kinematic-symmetric-2.00-r1"]["friction"].is_null());
    let varied = ["--trial-variation", "0.005", "--unlike", "3"];
    succeed(folder.path(), &[&synth[..], &varied].concat());
    succeed(folder.path(), &["ingest"]);
    let truth = truth_in(folder.path());
    let trials = truth["trials"].as_object().unwrap();
    let friction = |trial: &Value| trial["friction"].as_f64().unwrap();
    let unlike = trials.iter().filter(|(_, trial)| friction(trial) > 1.3);
    let unlike: Vec<&str> = unlike.map(|(id, _)| id.as_str()).collect();
    assert_eq!(unlike.len(), 3, "{trials:?}");
    assert!(trials.values().all(|trial| (friction(trial) / 1.25 - 1.0).abs() > 0.1));
    let checks = Table::read(&folder.path().join("derived/checks.parquet")).unwrap();
    let [names, codes] = ["trial", "check"].map(|of| checks.values::<String>(of).unwrap());
    let flagged = names.iter().zip(codes.iter());
    let flagged = flagged.filter(|(_, code)| *code == "W028 unlike-repeats");
    assert_eq!(flagged.map(|(name, _)| name.as_str()).collect::<Vec<_>>(), unlike);
    succeed(folder.path(), &["fit"]);
    let fits = Table::read(&folder.path().join("derived/fits.parquet")).unwrap();
    let left_out = fits.values::<String>("unlike_repeats").unwrap();
    assert!(left_out.iter().all(|of| *of == unlike.join(", ")), "{left_out:?}");
}

#[test]
fn robots_are_off_their_configured_values_by_their_standard_deviations() {
    let folder = kinematic("symmetric");
    let config = folder.path().join("pipeline.toml");
    let exact = std::fs::read_to_string(&config).unwrap();
    let synth = ["synth", "trials", "--omega", "1,2,3,4", "--seed", "4", "--declared-errors"];
    succeed(folder.path(), &synth);
    assert!(truth_in(folder.path())["off_configured"].is_null(), "no value has an error");
    let deviations = "[robot.kinematic]\nh_m = 0.144\nl_m = 0.112\nb_m = 0.0685\n\
                      mass_kg = [1.04, 0.2, 0.2]\ninertia_kg_m2 = [86e-4, 5e-4, 5e-4]\n\
                      roll_kg_s = [0.6, 0.3, 0.3]\nskid_kg_s = [100.0, 50.0, 50.0]\n\
                      [robot.kinematic.standard_deviation]\nh_m = 0.0004\nl_m = 0.0002\n\
                      mass_kg = \"3 %\"\ninertia_kg_m2 = \"5 %\"\n\
                      [robot.kinematic.same]\nh_m = \"ruler\"\nl_m = \"ruler\"\n";
    std::fs::write(&config, exact + deviations).unwrap();
    succeed(folder.path(), &synth);
    let truth = truth_in(folder.path());
    let off = &truth["off_configured"]["kinematic"];
    let error = |name: &str, value: f64, sd: f64| (off[name].as_f64().unwrap() - value) / sd;
    let [h, l] = [error("h_m", 0.144, 0.0004), error("l_m", 0.112, 0.0002)];
    let mass = error("mass0_kg", 1.04, 0.0312);
    println!("errors in standard deviations: {h}, {l}, {mass}");
    assert!((h - l).abs() < 1e-9, "one ruler");
    assert!((h - mass).abs() > 1e-3, "a scale is no ruler");
    assert!([h, mass].iter().all(|error| (1e-3..3.0).contains(&error.abs())));
    assert!(off["b_m"].is_null(), "exact");
    succeed(folder.path(), &["ingest"]);
    succeed(folder.path(), &["fit"]);
    let fits = Table::read(&folder.path().join("derived/fits.parquet")).unwrap();
    assert_eq!(fits.values::<bool>("adequate").unwrap(), [true]);
}

/// Moves the markers in the first and last three seconds of a CSV file; `to` receives the distance from the untouched
/// part, 0 to 1, and returns the new position, or `None` to hide the marker.
fn disturb_ends(path: &Path, to: impl Fn(f64, [f64; 3]) -> Option<[f64; 3]>) {
    let content = std::fs::read_to_string(path).unwrap();
    let lines: Vec<&str> = content.lines().collect();
    let frames = (3.0 * RATE_HZ) as usize;
    let changed = lines.iter().enumerate().map(|(i, line)| {
        let row = i.saturating_sub(5);
        let from_end =
            (frames.saturating_sub(row)).max((row + frames + 5).saturating_sub(lines.len()));
        if i < 5 || from_end == 0 {
            return (*line).to_owned();
        }
        let cells: Vec<&str> = line.split(',').collect();
        let markers = cells[2..].chunks_exact(3).map(|marker| {
            let seen: Vec<f64> = marker.iter().filter_map(|cell| cell.parse().ok()).collect();
            let moved = <[f64; 3]>::try_from(seen)
                .ok()
                .and_then(|position| to(from_end as f64 / frames as f64, position));
            moved.map_or(",,".to_owned(), |of| of.map(|x| format!("{x:.3}")).join(","))
        });
        format!("{},{},{}", cells[0], cells[1], markers.collect::<Vec<_>>().join(","))
    });
    std::fs::write(path, changed.collect::<Vec<_>>().join("\r\n") + "\r\n").unwrap();
}

#[test]
fn what_happens_before_and_after_the_motion_never_fails_a_trial() {
    let folder = kinematic("symmetric");
    succeed(folder.path(), &["synth", "trials", "--omega", "2,3.9"]);
    let path = folder.path().join("trials/kinematic-symmetric-3.90-r1.csv");
    let sound = std::fs::read(&path).unwrap();
    let measured = || {
        trilink(folder.path(), &["ingest"]);
        let trials = Table::read(&folder.path().join("derived/trials.parquet")).unwrap();
        let rows = TrialRow::from_table(&trials).unwrap();
        rows.into_iter().find(|row| row.trial == "kinematic-symmetric-3.90-r1").unwrap()
    };
    let d_m = measured().metrics.d_m;
    let carried =
        |a: f64, [x, y, z]: [f64; 3]| Some([x + 800.0 * a, y + 300.0 * a * a, z + 500.0 * a]);
    let shaken = |a: f64, [x, y, z]: [f64; 3]| {
        Some([x + 50.0 * a * (40.0 * a).sin(), y + 50.0 * a * (31.0 * a).cos(), z])
    };
    type Moved<'f> = &'f dyn Fn(f64, [f64; 3]) -> Option<[f64; 3]>;
    let ends: [(&str, Moved); 3] =
        [("carried", &carried), ("shaken", &shaken), ("not in view", &|_, _| None)];
    for (name, to) in ends {
        std::fs::write(&path, &sound).unwrap();
        disturb_ends(&path, to);
        let row = measured();
        println!("{name}: {} {} {:+.2e}", row.status, row.cycles, row.metrics.d_m / d_m - 1.0);
        assert_ne!(row.status, TrialStatus::Failed, "{name}: {}", row.message);
        let is_right = (row.metrics.d_m / d_m - 1.0).abs() < 0.005;
        assert!(is_right || row.status == TrialStatus::Flagged, "{name}: {row:?}");
    }
}
