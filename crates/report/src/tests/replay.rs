//! Tests of the replay on trial pages: poses as integers, and the drawing.

use serde_json::Value;
use trilink_mechanics::Pose;
use trilink_tables::{Table, poses_path, wheels_path};

use super::{Path, SKEWED, read, standard};

/// Returns the JSON data that the script on a page reads.
pub(super) fn numbers(page: &str) -> Value {
    let start = "<script type=\"application/json\">";
    let from = page.find(start).expect("a replay") + start.len();
    let data = &page[from..][..page[from..].find("</script>").expect("an end")];
    serde_json::from_str(data).expect("JSON")
}

/// Returns the integers whose successive differences are given.
fn sums(differences: &Value) -> Vec<Option<i64>> {
    let mut sum = 0;
    let differences = differences.as_array().expect("an array").iter();
    differences
        .map(|step| {
            sum += step.as_i64()?;
            Some(sum)
        })
        .collect()
}

fn trial_page(trial: &str) -> (std::path::PathBuf, String) {
    let folder = standard().0.path();
    let page = read(&folder.join(format!("reports/trials/{trial}.html")));
    (folder.join("derived"), page)
}

/// Returns the largest deviation (in the table's units) of the integers in a replay, given in `whole` by column name,
/// from every `stride`-th row of a table, over the frames in which both are known.
fn farthest(derived: &Path, table: &str, stride: usize, whole: &[(&str, Vec<Option<i64>>)]) -> f64 {
    let table = Table::read(&derived.join(table)).expect("a table");
    whole
        .iter()
        .map(|(name, whole)| {
            let values = table.values::<f64>(name).expect("numbers");
            let shown: Vec<f64> = values.into_iter().step_by(stride).collect();
            assert_eq!(shown.len(), whole.len(), "{name}");
            let both =
                shown.iter().zip(whole).filter_map(|(value, whole)| Some((value, (*whole)?)));
            both.map(|(value, whole)| (value - 1e-4 * whole as f64).abs()).fold(0.0, f64::max)
        })
        .fold(0.0, f64::max)
}

#[test]
fn replay_frames_store_the_poses_as_integers() {
    let trial = format!("{SKEWED}-3.90-r1");
    let (derived, page) = trial_page(&trial);
    let data = numbers(&page);
    let time = sums(&data["time"]);
    let frames = Table::read(&poses_path(&derived, &trial)).expect("poses").frame.height();
    let stride = frames.div_ceil(300);
    assert!(stride > 1 && time.len() <= 300 && time.len() == frames.div_ceil(stride));
    assert!(page.contains(&format!(
        "one of every {stride} frames, with positions to 0.1 mm and angles to 0.1 mrad"
    )));
    let measured = &data["motions"][0];
    let own = [
        ("time_s", time),
        ("x_m", sums(&measured["x"])),
        ("y_m", sums(&measured["y"])),
        ("theta_rad", sums(&measured["theta"])),
        ("phi1_rad", sums(&measured["phi"][0])),
        ("phi2_rad", sums(&measured["phi"][1])),
    ];
    // The synthetic robot has no pose in frames 300 to 339.
    let unseen = own[1].1.iter().filter(|x| x.is_none()).count();
    assert_eq!(unseen, (300..340).filter(|i| i % stride == 0).count());
    let off = farthest(&derived, &format!("poses/{trial}.parquet"), stride, &own);
    assert!(off > 0.0 && off < 0.500001e-4, "{off}");
    let skid = &data["quantities"][0];
    let skid: Vec<_> = ["skid0_m_s", "skid1_m_s", "skid2_m_s"]
        .into_iter()
        .enumerate()
        .map(|(wheel, name)| (name, sums(&skid["values"][wheel])))
        .collect();
    let wheels = wheels_path(&derived, &trial);
    let wheels = wheels.strip_prefix(&derived).expect("below").to_string_lossy().into_owned();
    let off = farthest(&derived, &wheels, stride, &skid);
    assert!(off > 0.0 && off < 0.500001e-4, "{off}");
}

#[test]
fn every_kind_of_trial_has_a_replay_with_limited_frame_count() {
    let (folder, _) = standard();
    let mut pages = 0;
    for entry in std::fs::read_dir(folder.path().join("reports/trials")).expect("a folder") {
        let page = read(&entry.expect("an entry").path());
        let data = numbers(&page);
        let frames = data["time"].as_array().expect("times").len();
        assert!((100..=300).contains(&frames), "{frames} frames");
        assert!(page.matches("class=\"robot\"").count() > 0);
        assert!(page.len() < 300_000, "{} bytes", page.len());
        pages += 1;
    }
    assert!(pages > 30);
}

#[test]
fn prediction_starts_at_the_start_of_the_first_used_cycle() {
    let trial = format!("{SKEWED}-3.90-r1");
    let (_, page) = trial_page(&trial);
    let data = numbers(&page);
    let [measured, predicted] = [0, 1].map(|motion| &data["motions"][motion]);
    assert_eq!(predicted["name"], "skid-roll");
    assert!(page.contains(
        "Dashed: steady motion of skid-roll as fitted to the campaign, with the measured gait"
    ));
    assert!(
        page.contains("at the start of cycle 2, the first used cycle; at the end of the recording, the prediction deviates by ")
    );
    let [number, start_s, period_s] =
        [0, 1, 2].map(|i| data["cycles"][i].as_f64().expect("a number"));
    let start_s = start_s + (2.0 - number) * period_s;
    let time = sums(&data["time"]);
    let first = sums(&predicted["x"]).iter().position(Option::is_some).expect("a pose");
    let at_s = |frame: usize| 1e-4 * time[frame].expect("a time") as f64;
    assert!(at_s(first) >= start_s - 1e-4 && at_s(first - 1) < start_s);
    // The robot moves more slowly than a few metres per second.
    for axis in ["x", "y", "theta"] {
        let [a, b] = [measured, predicted].map(|of| sums(&of[axis])[first].expect("a pose") as f64);
        let most = 0.1 + 3.0 * 1e4 * (at_s(first) - start_s);
        assert!((a - b).abs() <= most, "{axis}: {a} and {b}, needed {most} at most apart");
    }
    assert!(sums(&predicted["x"])[first..].iter().all(Option::is_some));
}

#[test]
fn arrow_lengths_agree_with_the_stated_scale() {
    let (_, page) = trial_page(&format!("{SKEWED}-3.90-r1"));
    let data = numbers(&page);
    let skid = &data["quantities"][0];
    // Arrow lengths are stored in units of 0.1 mm and velocities in units of 0.1 mm/s.
    let per_mm = 1.0 / skid["arrow"].as_f64().expect("a scale");
    let per_mm_text = trilink_base::numbers::as_configured(per_mm);
    let text = format!("</span> mm&#x2f;s: 1 mm for {per_mm_text} mm&#x2f;s</li>");
    assert!(page.contains(&text), "{text}");
    let largest = skid["values"].as_array().expect("wheels").iter().flat_map(sums).flatten();
    let longest = largest.map(|value| value.unsigned_abs()).max().expect("a value") as f64 / per_mm;
    let robot = 0.5 * data["length"].as_f64().expect("a length");
    assert!(longest > 0.1 * robot && longest < robot, "{longest}");
    // All trials of a robot have one scale.
    let (_, other) = trial_page("kinematic-symmetric-3.90-r1");
    assert!(other.contains(&text), "{text}");
    assert_eq!((&skid["across"], &skid["unit"]), (&true.into(), &"mm/s".into()));
    // The moving average is incomplete at the ends of the recording, so the first frame has no velocities and no
    // arrows.
    for values in skid["values"].as_array().expect("wheels") {
        let values = values.as_array().expect("a wheel");
        let known = values.iter().filter(|value| !value.is_null()).count();
        assert!(values[0].is_null() && values[values.len() - 1].is_null(), "{values:?}");
        assert!(known > values.len() / 2, "{known} of {}", values.len());
    }
    assert!(!page.contains("class=\"arrow skid\" d="));
}

#[test]
fn missing_and_corrected_markers_are_shown_in_the_affected_frames() {
    let trial = format!("{SKEWED}-3.90-r1");
    let (derived, page) = trial_page(&trial);
    let data = numbers(&page);
    let frames = Table::read(&poses_path(&derived, &trial)).expect("poses").frame.height();
    let stride = frames.div_ceil(300);
    let marks = data["marks"].as_array().expect("marks");
    let names: Vec<String> = marks
        .iter()
        .map(|mark| {
            let marker = &data["markers"][mark[2].as_u64().expect("a marker") as usize];
            format!("{} {}", marker[2].as_str().expect("a label"), mark[3])
        })
        .collect();
    assert_eq!(names, ["F1 0", "F2 0", "F3 0", "R2 0", "R1 1", "R3 1"]);
    let first = &marks[0];
    let last = &marks[5];
    assert_eq!((&first[0], &first[1]), (&(300 / stride).into(), &(339 / stride).into()));
    assert_eq!((&last[0], &last[1]), (&(600 / stride).into(), &(659 / stride).into()));
    assert!(page.contains("marker missing") && page.contains("marker corrected"));
}

#[test]
fn a_repeated_cycle_begins_at_its_start_and_is_unknown_before() {
    use trilink_mechanics::{FIT_ACCURACY, Laws, Problem};
    let robot = trilink_robot::Robot::kinematic().into();
    let gait = trilink_robot::Gait::skewed().into();
    let problem = Problem { robot, gait, laws: Laws::SKID_ROLL, omega_rad_s: 3.9 };
    let samples = problem.cycle(FIT_ACCURACY, 240).expect("a motion");
    let period_s = samples[240].time_s;
    let start = Pose { x_m: 0.3, y_m: -0.2, theta_rad: 1.1 };
    let times = [-0.1, 0.0, 0.5 * period_s, period_s, 2.0 * period_s];
    let found = crate::replay::repeated(&samples, start, times.into_iter());
    assert!(found[0].is_none());
    let near =
        |a: Pose, b: Pose| (a.x_m - b.x_m).hypot(a.y_m - b.y_m) + (a.theta_rad - b.theta_rad).abs();
    let end = samples[240].pose;
    let known = [start, start * samples[120].pose, start * end, start * end * end];
    for (found, known) in found[1..].iter().zip(known) {
        assert!(near(found.expect("a pose").0, known) < 1e-9, "{found:?} {known:?}");
    }
    let joints = found[2].expect("a pose").1;
    assert!((joints[0] - samples[120].phi_rad[0]).abs() < 1e-12);
}
