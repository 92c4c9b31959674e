//! Tests of the whole ingest stage on known motions and on folders with faults.

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::PathBuf;

use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use trilink_mechanics::Posture;
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Quantity, Robot};
use trilink_statistics::Estimate;
use trilink_statistics::mean;
use trilink_synth::{Recipe, Tilt, synthesise};
use trilink_tables::config::{Poses, RobotConfig};
use trilink_tables::trial::TrialFolders;
use trilink_tables::{Columns as _, Coordinates, Provenance, Severity};

use super::*;

mod bodies;
mod chains;
pub(crate) mod coloured;
mod coverage;
mod decays;
mod laws;
mod skid;
mod slopes;
mod smoothing;
mod synthetic;

use synthetic::{Motion, Recording, header};

fn gait_trial(id: &str, campaign: &str, omega_rad_s: f64) -> Trial {
    Trial {
        id: id.to_owned(),
        file: format!("{id}.csv"),
        kind: TrialKind::Gait,
        campaign: Some(campaign.to_owned()),
        robot: None,
        omega_rad_s: Some(omega_rad_s),
        day: None,
        smoothing_window: None,
        aliases: BTreeMap::new(),
    }
}

/// Returns x, y and theta of link 0, and phi1 and phi2.
fn coordinates((pose, phi_rad): &Posture) -> [f64; 5] {
    [pose.x_m, pose.y_m, pose.theta_rad, phi_rad[0], phi_rad[1]]
}

fn names(table: &Table, column: &str) -> Vec<String> {
    table.values(column).unwrap()
}

fn column_names(table: &Table) -> String {
    let names: Vec<&str> =
        table.frame.columns().iter().map(|column| column.name().as_str()).collect();
    names.join(" ")
}

fn process_text(text: &str, trial: &Trial) -> Result<ProcessedTrial, TrialFailure> {
    process_with(text, trial, &Config::default())
}

fn process_with(
    text: &str,
    trial: &Trial,
    config: &Config,
) -> Result<ProcessedTrial, TrialFailure> {
    let input = IngestInput::new(config, trial)?;
    process(Path::new("a.csv"), text.as_bytes(), trial, &input, &mut PartialResult::new(trial))
}

fn symmetric(omega_rad_s: f64) -> (Recording, Trial) {
    let recording = Recording::new(Motion::new(omega_rad_s, 0.0));
    (recording, gait_trial("a", "kinematic-symmetric", omega_rad_s))
}

fn relative_error(found: f64, truth: f64) -> f64 {
    (found / truth - 1.0).abs()
}

fn error_deg(found: f64, truth: f64) -> f64 {
    (found - truth).to_degrees().abs()
}

#[test]
fn metrics_and_gait_of_a_known_motion_are_found() {
    let quarter = std::f64::consts::FRAC_PI_4;
    for (omega, offset, campaign) in [
        (0.5, 0.0, "kinematic-symmetric"),
        (3.9, quarter, "kinematic-skewed"),
        (6.0, 0.0, "kinematic-symmetric"),
    ] {
        let mut motion = Motion::new(omega * 1.004, offset);
        motion.first_phase_rad = 0.9;
        let truth = motion.truth(&Robot::kinematic());
        let text = Recording::new(motion.clone()).export();
        let processed = process_text(&text, &gait_trial("a", campaign, omega)).unwrap();
        let row = processed.row;
        assert_eq!((row.status, row.message.as_str()), (TrialStatus::Ok, ""));
        assert!(relative_error(row.omega_rad_s, motion.omega_rad_s) < 1e-4);
        assert!((row.omega_rad_s - motion.omega_rad_s).abs() < 4.0 * row.omega_rad_s_se);
        let GaitMetrics { d_m, v_m_s, alpha_rad: [alpha1_rad, ..], dtheta_rad, .. } = row.metrics;
        assert!(relative_error(d_m, truth.d_m) < 1e-3, "{omega}: {d_m} {}", truth.d_m);
        assert!(relative_error(v_m_s, truth.v_m_s) < 1e-3);
        assert!(error_deg(dtheta_rad, truth.dtheta_rad) < 0.1);
        assert!(error_deg(alpha1_rad, truth.alpha_rad[0]) < 0.1, "{omega} {alpha1_rad}");
        for (found, truth) in row.sigma_debiased.iter().zip(truth.sigma) {
            assert!(relative_error(found.value, truth) < 0.03, "{omega}: {found:?} {truth}");
        }
        let found = row.gait.map(|joint| [joint.offset_rad, joint.amplitude_rad, joint.phase_rad]);
        for (found, truth) in found.iter().flatten().zip(motion.joints.iter().flatten()) {
            assert!(error_deg(*found, *truth) < 0.1, "{omega}: {found} {truth}");
        }
        // The joints have no other harmonics, and noise contributes little.
        assert!(row.gait.iter().all(|joint| joint.harmonics_rad.to_degrees() < 0.03));
        let left = [row.smoothing_left1, row.smoothing_left2, row.smoothing_left3];
        assert!(left.is_sorted_by(|a, b| a > b) && left[0] < 1.0 && left[2] > 0.5, "{left:?}");
        assert!(row.cycles >= 7 && row.coverage > 0.9 && row.coverage < 0.97);
        assert!((0.15..0.3).contains(&row.residual_mm));
    }
}

#[test]
fn standard_errors_of_d_are_of_the_right_size() {
    let (mut recording, trial) = symmetric(3.9);
    let truth = recording.motion.truth(&Robot::kinematic());
    let mut within = 0;
    for seed in 0..20 {
        recording.seed = seed;
        let row = process_text(&recording.export(), &trial).unwrap().row;
        within += usize::from((row.metrics.d_m - truth.d_m).abs() < 2.0 * row.metrics_se.d_m);
        assert!(row.metrics_se.d_m < 1e-3 * row.metrics.d_m);
    }
    assert!(within >= 17, "{within}");
}

#[test]
fn a_skid_below_the_noise_is_recovered_with_the_right_standard_error() {
    const SEEDS: u64 = 12;
    let mut motion = Motion::new(3.9, std::f64::consts::FRAC_PI_4);
    motion.sigma = Some([0.01, 0.02, 0.03]);
    let truth = motion.truth(&Robot::kinematic());
    let trial = gait_trial("a", "kinematic-skewed", 3.9);
    let mut recording = Recording::new(motion);
    recording.noise_mm = 0.4;
    let mut within = 0;
    let mut mean = [0.0; 3];
    let mut mean_raw = [0.0; 3];
    for seed in 0..SEEDS {
        recording.seed = seed;
        let row = process_text(&recording.export(), &trial).unwrap().row;
        for (wheel, debiased) in row.sigma_debiased.into_iter().enumerate() {
            let Estimate { value, se } = debiased;
            within += usize::from((value - truth.sigma[wheel]).abs() < 2.0 * se);
            mean[wheel] += value / truth.sigma[wheel] / SEEDS as f64;
            mean_raw[wheel] += row.metrics.sigma[wheel] / truth.sigma[wheel] / SEEDS as f64;
        }
    }
    assert!(mean.iter().all(|mean| (mean - 1.0).abs() < 0.01), "{mean:?}");
    assert!(mean_raw[1] > 1.05, "the noise would not matter: {mean_raw:?}");
    assert!(within as u64 >= SEEDS * 3 * 9 / 10, "{within}");
}

#[test]
fn poses_are_those_of_the_robot_and_missing_frames_are_null() {
    let (mut recording, trial) = symmetric(2.0);
    recording.noise_mm = 0.0;
    recording.loss = 0.0;
    let processed = process_text(&recording.export(), &trial).unwrap();
    let poses = &processed.poses;
    assert_eq!(poses.values::<i64>("frame").unwrap()[..2], [371, 372]);
    assert_eq!(poses.values::<f64>("time_s").unwrap()[120], 1.0);
    assert!((poses.values::<f64>("x_m").unwrap()[0] - 0.5).abs() < 1e-5);
    assert!((poses.values::<f64>("y_m").unwrap()[0] + 0.3).abs() < 1e-5);
    let [offset, amplitude, lead] = recording.motion.joints[1];
    let phase: f64 = 2.0 * 4.0 + lead;
    assert!(
        (poses.values::<f64>("phi2_rad").unwrap()[480] - offset - amplitude * phase.cos()).abs()
            < 1e-3
    );
    assert!(names(poses, "fill1").iter().all(|fill| *fill == "measured"));
    assert_eq!(
        column_names(poses),
        "trial frame time_s x_m y_m theta_rad phi1_rad phi2_rad \
         residual0_mm residual1_mm residual2_mm fill0 fill1 fill2 outlier0 outlier1 outlier2 \
         unseen0 unseen1 unseen2 corrected0 corrected1 corrected2"
    );
    assert_eq!(
        column_names(&processed.wheels),
        "trial frame time_s roll0_m_s roll1_m_s roll2_m_s skid0_m_s skid1_m_s skid2_m_s"
    );
}

/// Returns an export in which the cells of link 1's markers (14 to 22 of each line, counted from 0) are empty in a
/// range of rows.
fn without_link1(text: &str, rows: std::ops::Range<usize>) -> String {
    const HEADER: usize = 5;
    let lines = text.split_inclusive("\r\n").enumerate().map(|(i, line)| {
        if !(rows.start + HEADER..rows.end + HEADER).contains(&i) {
            return line.to_owned();
        }
        let mut cells: Vec<&str> = line.split(',').collect();
        cells[14..23].fill("");
        cells.join(",")
    });
    lines.collect()
}

fn used_cycles(trial: &ProcessedTrial) -> Vec<i64> {
    trial.cycles.iter().filter(|cycle| cycle.used).map(|cycle| cycle.cycle).collect()
}

#[test]
fn short_gaps_are_filled_and_long_ones_left_out() {
    let (mut recording, trial) = symmetric(3.9);
    recording.loss = 0.0;
    let text = recording.export();
    let whole = process_text(&text, &trial).unwrap();
    let all = used_cycles(&whole);
    assert!(all.len() >= 6 && *all == *(all[0]..=10).collect::<Vec<_>>(), "{all:?}");

    let short = process_text(&without_link1(&text, 900..912), &trial).unwrap();
    assert_eq!((used_cycles(&short), short.row.status), (all.clone(), TrialStatus::Ok));
    let fill = names(&short.poses, "fill1");
    assert_eq!((fill[899].as_str(), fill[905].as_str()), ("measured", "interpolated"));
    let unseen = names(&short.poses, "unseen1");
    assert_eq!((unseen[899].as_str(), unseen[905].as_str()), ("", "F1, F2, F3"));
    assert!(names(&short.poses, "corrected1").iter().all(String::is_empty));

    let long = process_text(&without_link1(&text, 900..1020), &trial).unwrap();
    // A second of 1.61 s cycles: frames 900 to 1020 lie in cycles 4 (773 to 967) and 5.
    let others: Vec<i64> = all.into_iter().filter(|cycle| ![4, 5].contains(cycle)).collect();
    assert_eq!(used_cycles(&long), others);
    assert!(long.cycles[4].metrics.d_m.is_nan() && long.cycles[5].metrics.d_m.is_nan());
    let gaps = check_of(&long, "W007");
    let expected = ("info", "2 cycles with gaps are left out");
    assert_eq!((gaps.severity.name(), gaps.message.as_str()), expected);
    assert_eq!(long.row.status, TrialStatus::Ok);
    assert_eq!(names(&long.poses, "fill1")[905], "missing");
    let phi1 = long.poses.values::<f64>("phi1_rad").unwrap();
    assert!(phi1[900..1020].iter().all(|phi| phi.is_nan()));
    assert!(!phi1[899].is_nan() && !phi1[1020].is_nan());
    assert!(long.poses.values::<f64>("phi2_rad").unwrap().iter().all(|phi| !phi.is_nan()));
    // Other cycles do not change.
    assert!((long.cycles[8].metrics.d_m - whole.cycles[8].metrics.d_m).abs() < 1e-5);
}

#[test]
fn a_marker_without_all_of_its_coordinates_is_occluded_and_named() {
    let (recording, trial) = symmetric(3.9);
    let text = recording.export();
    // In three frames the second marker, `M2`, lacks its Y.
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut changed = 0;
    for line in lines.iter_mut().skip(1000) {
        let mut cells: Vec<&str> = line.split(',').collect();
        if changed < 3 && cells.len() > 8 && !cells[6].is_empty() {
            cells[6] = "";
            changed += 1;
            *line = cells.join(",");
        }
    }
    assert_eq!(changed, 3);
    let whole = process_text(&text, &trial).unwrap();
    assert!(whole.checks.iter().all(|check| !check.check.starts_with("W031")));
    let cut = process_text(&lines.join("\n"), &trial).unwrap();
    let check = check_of(&cut, "W031");
    assert_eq!(check.message, "3 positions are incomplete and count as occluded: `Robot:M2`");
    assert_eq!((check.value, cut.row.status), (3.0, TrialStatus::Flagged));
    assert!(cut.row.coverage < whole.row.coverage);
}

/// The poses of the other links stay identical bit for bit if every link is fitted separately; if the links are fitted
/// together, such that they meet at their joints, these poses change by less than can be measured.
#[test]
fn a_second_without_a_links_markers_does_not_change_the_other_links() {
    assert_others_unchanged(Poses::Links, 0.0);
    assert_others_unchanged(Poses::Chain, 3e-5);
}

fn assert_others_unchanged(poses: Poses, tolerance: f64) {
    const GAP: std::ops::Range<usize> = 900..1020;
    const WINDOW: usize = 9;
    let (recording, mut trial) = symmetric(3.9);
    trial.smoothing_window = Some(WINDOW);
    let text = recording.export();
    let mut config = Config::default();
    config.ingest.poses = poses;
    let [whole, gapped] = [text.clone(), without_link1(&text, GAP)]
        .map(|text| process_with(&text, &trial, &config).unwrap());
    // The moving average and the derivative are affected in the neighbourhood of the gap, as they are near a filled
    // short gap.
    let affected = GAP.start - 2 * WINDOW..GAP.end + 2 * WINDOW;
    let assert_same =
        |table: fn(&ProcessedTrial) -> &Table, column: &str, skipped: &Range<usize>| {
            let [whole, gapped] =
                [&whole, &gapped].map(|trial| table(trial).values::<f64>(column).unwrap());
            for (i, (whole, gapped)) in whole.iter().zip(gapped).enumerate() {
                let is_near = (whole - gapped).abs() <= tolerance;
                let is_same = whole.to_bits() == gapped.to_bits() || (tolerance > 0.0 && is_near);
                assert!(is_same || skipped.contains(&i), "{column} {i}: {whole} {gapped}");
            }
        };
    let nowhere = if poses == Poses::Links { 0..0 } else { affected.clone() };
    for column in ["x_m", "y_m", "theta_rad", "phi2_rad"] {
        assert_same(|trial| &trial.poses, column, &nowhere);
    }
    if poses == Poses::Links {
        for column in ["residual0_mm", "residual2_mm"] {
            assert_same(|trial| &trial.poses, column, &nowhere);
        }
    }
    assert_same(|trial| &trial.poses, "phi1_rad", &affected);
    for column in ["roll0_m_s", "skid0_m_s", "roll2_m_s", "skid2_m_s"] {
        assert_same(|trial| &trial.wheels, column, &nowhere);
    }
    for column in ["roll1_m_s", "skid1_m_s"] {
        assert_same(|trial| &trial.wheels, column, &affected);
    }
    assert_eq!(used_cycles(&whole), (2..=10).collect::<Vec<_>>());
    assert_eq!(used_cycles(&gapped), [2, 3, 6, 7, 8, 9, 10]);
    // Frequency and phase are measured on all frames of both joints: if one joint is occluded for a second, they change
    // by less than their standard errors, and so do the starts of the cycles.
    assert!((whole.row.omega_rad_s - gapped.row.omega_rad_s).abs() < whole.row.omega_rad_s_se);
    for i in used_cycles(&gapped) {
        let [whole, gapped] = [&whole, &gapped].map(|trial| &trial.cycles[i as usize]);
        assert!((whole.metrics.d_m / gapped.metrics.d_m - 1.0).abs() < 1e-4);
        assert!((whole.start_s - gapped.start_s).abs() < 1e-3);
    }
}

#[test]
fn a_long_occlusion_of_a_joint_fails_a_trial_only_if_too_few_cycles_are_left() {
    let (mut recording, trial) = symmetric(3.9);
    recording.cycles = 60.0;
    let text = recording.export();
    let frames = text.lines().count() - 5;
    // The central 30 cycles, from which the frequency is first estimated, are occluded.
    let processed =
        process_text(&without_link1(&text, frames / 5..frames * 4 / 5), &trial).unwrap();
    assert_eq!(used_cycles(&processed).len(), 20);
    assert!((processed.row.omega_rad_s - 3.9).abs() < 1e-4);

    recording.cycles = 20.0;
    let text = recording.export();
    let frames = text.lines().count() - 5;
    for (rows, expected) in [
        (
            frames / 10..frames,
            "joint 1 is visible in only 0 of the 3480 frames from which the gait's frequency and phase are measured",
        ),
        (
            frames / 10..frames * 9 / 10,
            "only 1 of 19 cycles can be used, but at least 2 are needed: the first 2 were still settling, \
             16 have gaps or jumps, in 0 the joints do not follow the gait",
        ),
    ] {
        let error = process_text(&without_link1(&text, rows), &trial).unwrap_err().to_string();
        assert!(error.starts_with(&format!("a.csv: {expected}")), "{error}");
    }
}

#[test]
fn a_frame_jump_is_a_gap_in_time() {
    let (recording, trial) = symmetric(3.9);
    let text = recording.export();
    let lines: Vec<&str> = text.split_inclusive("\r\n").collect();
    let jumping: String = lines[..905].iter().chain(&lines[1025..]).copied().collect();
    let jumped = process_text(&jumping, &trial).unwrap();
    let frames = jumped.poses.values::<i64>("frame").unwrap();
    assert!(frames.windows(2).all(|pair| pair[1] == pair[0] + 1));
    assert_eq!(frames.len(), lines.len() - 5);
    assert!(jumped.poses.values::<f64>("x_m").unwrap()[901..1019].iter().all(|x| x.is_nan()));
    assert!((jumped.row.omega_rad_s - 3.9).abs() < 4e-4);
    let message = &jumped.row.message;
    assert!(message.contains("120 frames are missing from the file"), "{message}");
    assert_eq!(check_of(&jumped, "W007").message, "2 cycles with gaps are left out");
}

/// Changes the rows of an export; a row has frame, subframe, and three cells for each marker.
fn with_rows(text: &str, change: impl FnOnce(&mut Vec<Vec<String>>)) -> String {
    const HEADER: usize = 5;
    let lines: Vec<&str> = text.lines().collect();
    let mut rows: Vec<Vec<String>> =
        lines[HEADER..].iter().map(|line| line.split(',').map(str::to_owned).collect()).collect();
    change(&mut rows);
    let header = lines[..HEADER].iter().map(|line| (*line).to_owned());
    header.chain(rows.iter().map(|row| row.join(","))).map(|line| line + "\r\n").collect()
}

#[test]
fn a_cycle_in_which_a_camera_is_knocked_is_not_used() {
    let (mut recording, trial) = symmetric(3.9);
    recording.loss = 0.0;
    let text = recording.export();
    let knocked = with_rows(&text, |rows| {
        for x in rows[900..].iter_mut().flat_map(|row| row[2..].iter_mut().step_by(3)) {
            *x = format!("{:.6}", x.parse::<f64>().unwrap() + 5.0);
        }
    });
    let [whole, knocked] = [&text, &knocked].map(|text| process_text(text, &trial).unwrap());
    // Frame 900 lies in cycle 4 (773 to 967).
    let [mut expected, used] = [&whole, &knocked]
        .map(|trial| trial.cycles.iter().map(|cycle| cycle.used).collect::<Vec<_>>());
    assert!(std::mem::replace(&mut expected[4], false));
    assert_eq!(used, expected);
    assert!(knocked.cycles[4].reason.contains("a gap or a jump"));
    assert_eq!(names(&knocked.poses, "fill0")[899..902], ["measured", "missing", "measured"]);
    for (i, (whole, knocked)) in whole.cycles.iter().zip(&knocked.cycles).enumerate() {
        let [whole, knocked] = [whole, knocked].map(|cycle| cycle.metrics.d_m);
        assert!(i == 4 || (knocked / whole - 1.0).abs() < 1e-4, "{i}: {knocked} {whole}");
    }
    assert_eq!(knocked.row.status, TrialStatus::Flagged, "{:?}", check_of(&knocked, "W025"));
    assert!(knocked.row.message.starts_with("the robot jumps by "), "{}", knocked.row.message);
}

#[test]
fn a_trial_whose_rows_were_deleted_or_doubled_and_renumbered_fails() {
    let (mut recording, trial) = symmetric(3.9);
    recording.loss = 0.0;
    let text = recording.export();
    let next = |row: usize| {
        with_rows(&text, |rows| {
            let first: usize = rows[0][0].parse().unwrap();
            *rows = rows[..900].iter().chain(&rows[row..]).cloned().collect();
            rows.iter_mut().zip(first..).for_each(|(row, number)| row[0] = number.to_string());
        })
    };
    for (next, found) in [
        (next(906), "about 6 frames may be missing: were rows deleted"),
        (next(895), "about 5 frames may be repeated: were rows duplicated"),
    ] {
        let failure = process_text(&next, &trial).unwrap_err().to_string();
        assert!(failure.contains("W025 jump: the robot jumps by "), "{failure}");
        assert!(failure.contains(found), "{failure}");
        assert!(failure.ends_with(" (value 1, limit 0)"), "{failure}");
    }
}

#[test]
fn a_transient_is_skipped() {
    let (mut recording, trial) = symmetric(3.9);
    recording.motion.transient = 0.3;
    let truth = recording.motion.truth(&Robot::kinematic());
    let processed = process_text(&recording.export(), &trial).unwrap();
    // 0.3 exp(-k) drops to 0.05 % of d for k between 6 and 7.
    assert!((6..=8).contains(&processed.cycles.iter().position(|cycle| cycle.used).unwrap()));
    assert!((processed.row.metrics.d_m / truth.d_m - 1.0).abs() < 5e-4);
}

#[test]
fn a_frequency_off_the_command_is_flagged() {
    let (recording, mut trial) = symmetric(3.9);
    trial.omega_rad_s = Some(4.1);
    let row = process_text(&recording.export(), &trial).unwrap().row;
    assert_eq!(row.status, TrialStatus::Flagged);
    assert!((row.omega_rad_s - 3.9).abs() < 1e-3);
    assert!(row.message.contains("commanded 4.1 rad/s"), "{}", row.message);
}

#[test]
fn another_frequency_of_a_few_periods_is_named() {
    let (mut recording, mut trial) = symmetric(3.9);
    recording.cycles = 3.2;
    for commanded in [2.73, 4.4, 11.7] {
        trial.omega_rad_s = Some(commanded);
        let error = process_text(&recording.export(), &trial).unwrap_err().to_string();
        let expected = format!("a.csv: measured 3.9000 rad/s, commanded {commanded} rad/s: ");
        assert!(error.starts_with(&expected), "{error}");
        assert!(error.contains("set omega_rad_s = 3.9000"), "{error}");
    }
}

#[test]
fn the_trials_own_window_takes_precedence_over_the_configured_one() {
    let (recording, mut trial) = symmetric(3.9);
    let text = recording.export();
    let mut config = Config::default();
    config.ingest.smoothing_window = SmoothingWindow::Window(11);
    let window = |trial: &Trial| {
        let processed = process_with(&text, trial, &config).unwrap();
        processed.row.smoothing_window
    };
    assert_eq!(window(&trial), 11);
    trial.smoothing_window = Some(7);
    assert_eq!(window(&trial), 7);
}

#[test]
fn faults_of_a_trial_are_reported() {
    let (recording, trial) = symmetric(3.9);
    let text = recording.export();
    let message = |text: &str| process_text(text, &trial).unwrap_err().to_string();
    assert_eq!(
        message(&text.replace("Robot:F2", "Robot:G2")),
        "a.csv: the file has no marker `F2`, which markers.link1 of pipeline.toml requires; `G2` is not in the \
         layout: if it is this marker, rename it or add `aliases = { G2 = \"F2\" }` to trials.toml; \
         the most similar of the file's 10 labels are `Robot:M2`, `Robot:F1`, `Robot:G2`"
    );
    assert_eq!(
        message(&text.replacen("Robot:R1", "Other:M1", 1).replacen("Robot:R2", "Robot:R1", 1)),
        "a.csv: the marker `M1` of markers.link0 matches the labels `Robot:M1`, `Other:M1`; replace the label in that \
         table by one of these, in the form `Subject:Marker`"
    );
    assert_eq!(
        message(&text.replacen("\r\n120\r\n", "\r\n100\r\n", 1)),
        "a.csv: the file's frame rate is 100 Hz, but vicon.rate_hz is 120 Hz; correct vicon.rate_hz, \
         or set vicon.rate_from_file = true"
    );
    let lines: Vec<&str> = text.split_inclusive("\r\n").collect();
    assert_eq!(
        message(&lines[..5 + 618].concat()),
        "a.csv: only 1 of 3 cycles can be used, but at least 2 are needed: the first 2 were still settling, 0 have \
         gaps or jumps, in 0 the joints do not follow the gait"
    );
    let unseen = without_link1(&text, 0..lines.len());
    assert_eq!(
        message(&unseen),
        "a.csv: no frame shows two markers of link 1 together, but its pose requires two"
    );
}

#[test]
fn an_impossible_value_fails_the_trial_with_the_check_that_found_it() {
    let (recording, trial) = symmetric(3.9);
    let text = recording.export();
    let failed = |change: &dyn Fn(&mut Config)| {
        let mut config = Config::default();
        change(&mut config);
        let input = IngestInput::new(&config, &trial).unwrap();
        let mut known = PartialResult::new(&trial);
        let path = Path::new("a.csv");
        let failure = process(path, text.as_bytes(), &trial, &input, &mut known).unwrap_err();
        known.failed(&failure)
    };
    let (row, checks) = failed(&|config| {
        std::mem::swap(&mut config.markers.link1, &mut config.markers.link2);
    });
    assert_eq!(row.status, TrialStatus::Failed);
    assert!(row.message.starts_with("a.csv: W018 joint-places: a joint is 2"), "{}", row.message);
    assert!(row.message.contains(", limit 10)"), "{}", row.message);
    assert_eq!((&checks[0].check[..4], &checks[0].message), ("E001", &row.message));
    let joint = checks.iter().find(|row| row.check.starts_with("W018")).unwrap();
    assert_eq!((joint.severity, joint.limit), (Severity::Error, 10.0));
    assert!(row.coverage > 0.8 && row.residual_mm > 0.0);

    let (row, _) = failed(&|config| {
        let joint = config.gait.get_mut("symmetric").unwrap().joint2.as_mut().unwrap();
        joint.phase_deg = joint.phase_deg.map(|deg| -deg);
    });
    let phase = "a.csv: W009 gait: joint 2: measured phase -90.6 deg, configured 90: is the sign";
    assert!(row.message.starts_with(phase), "{}", row.message);
    assert!(row.message.contains("joints 1 and 2 are swapped"), "{}", row.message);
    // No metrics, but the motion of the joints.
    assert!(row.metrics.d_m.is_nan() && row.sigma_debiased[1].value.is_nan() && row.cycles == 0);
    assert!((row.omega_rad_s - 3.9).abs() < 1e-3);
    assert!((row.gait[1].amplitude_rad - 0.54).abs() < 1e-3, "{:?}", row.gait);

    let (row, _) = failed(&|config| config.markers.link1.get_mut("F1").unwrap()[1] += 40.0);
    let elsewhere =
        "F1` of link 1 is configured at x = 45, y = 70 mm, but measured at x = 45.0, y = 30.";
    assert!(row.message.contains(elsewhere), "{}", row.message);
    let (row, _) = failed(&|config| {
        config.markers.link1.get_mut("F1").unwrap()[1] += 40.0;
        config.markers.link1.get_mut("F2").unwrap()[0] += 20.0;
    });
    assert!(row.message.starts_with("a.csv: W0"), "{}", row.message);
}

#[test]
fn a_file_without_a_rate_gets_the_configured_one_and_reports_it() {
    let (recording, trial) = symmetric(3.9);
    let text = recording.export().replacen("\r\n120\r\n", "\r\n", 1);
    let row = process_text(&text, &trial).unwrap().row;
    assert_eq!(row.message, "the file states no frame rate; 120 Hz is assumed (vicon.rate_hz)");
    assert!((row.omega_rad_s - 3.9).abs() < 4e-4);
    let mut config = Config::default();
    config.vicon.rate_from_file = true;
    assert_eq!(
        process_with(&text, &trial, &config).unwrap_err().to_string(),
        "a.csv: the file states no frame rate, but vicon.rate_from_file = true requires one: \
         set vicon.rate_from_file = false and vicon.rate_hz to the frame rate"
    );
}

#[test]
fn a_jump_of_the_frames_stays_a_gap_in_time_and_rows_without_a_number_are_counted() {
    let (recording, trial) = symmetric(3.9);
    let text = recording.export();
    let mut lines: Vec<String> = text.split_inclusive("\r\n").map(str::to_owned).collect();
    let whole = process_text(&text, &trial).unwrap();
    // Two rows have lost their numbers, and 300 frames are missing from the file.
    for line in &mut lines[700..702] {
        *line = ",,".to_owned() + line.splitn(3, ',').last().unwrap();
    }
    lines.drain(702..1000);
    let jumped = process_text(&lines.concat(), &trial).unwrap();
    assert_eq!(jumped.poses.len(), whole.poses.len());
    let message = jumped.row.message;
    let d_m = jumped.row.metrics.d_m;
    assert!(message.contains("300 frames are missing from the file"), "{message}");
    assert!(message.contains("2 rows without a frame number are left out"), "{message}");
    assert!((d_m / whole.row.metrics.d_m - 1.0).abs() < 2e-3);
}

/// Creates a folder with good and bad trials.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let (mut recording, _) = symmetric(3.9);
    let text = recording.export();
    write("good.csv", &text);
    recording.seed = 6;
    write("second.csv", &recording.export());
    write("empty.csv", "");
    let others = folder.path().join("others");
    let recipe = Recipe { omegas_rad_s: Vec::new(), ..Recipe::new(1) };
    synthesise(&Config::default(), &others, &recipe, &|_| Ok(())).unwrap();
    write("coast.csv", &fs::read_to_string(others.join("kinematic-coast-down-r1.csv")).unwrap());
    write("text.csv", &text.replacen(",0,", ",0,lost ", 1));
    let frame = text.split_inclusive("\r\n").nth(5).unwrap();
    write("still.csv", &(header(&Config::default().markers, 120.0) + frame));
    let mut list = String::new();
    for (id, rest) in [
        ("good", "campaign = 'kinematic-symmetric'\nomega_rad_s = 3.9"),
        ("absent", "campaign = 'kinematic-symmetric'\nomega_rad_s = 3.9"),
        ("empty", "campaign = 'kinematic-symmetric'\nomega_rad_s = 3.9"),
        ("text", "campaign = 'kinematic-symmetric'\nomega_rad_s = 3.9"),
        ("still", "campaign = 'kinematic-symmetric'\nomega_rad_s = 3.9"),
        ("unknown", "campaign = 'kinematic-symetric'\nomega_rad_s = 3.9"),
        ("second", "campaign = 'kinematic-symmetric'\nomega_rad_s = 3.9"),
    ] {
        list += &format!("[[trial]]\nid = '{id}'\nfile = '{id}.csv'\nkind = 'gait'\n{rest}\n");
    }
    list +=
        "[[trial]]\nid = 'coast'\nfile = 'coast.csv'\nkind = 'coast-down'\nrobot = 'kinematic'\n";
    write("trials.toml", &list);
    folder
}

fn ingest(folder: &Path, derived: &Path, threads: usize) -> Ingested {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| ingest_folder(folder, derived)).unwrap()
}

/// Ingests all trials of a folder as a complete run does.
fn ingest_folder(
    folder: &Path,
    derived: &Path,
) -> Result<Ingested, Box<dyn std::error::Error + Send + Sync>> {
    let mut config = Config::default();
    config.paths.raw = vec![folder.to_owned()];
    config.paths.base = folder.parent().unwrap().to_owned();
    let listed = TrialFolders::load(&config.paths)?;
    let TrialFolders { folders, trials, .. } = &listed;
    let inputs: Vec<_> =
        trials.iter().map(|listed| IngestInput::new(&config, &listed.trial)).collect();
    let entries: Vec<Entry> = trials
        .iter()
        .zip(&inputs)
        .map(|(listed, input)| Entry { folder: &folders[listed.folder], listed, input })
        .collect();
    let provenance = || Provenance { input: String::new() };
    let done =
        ingest_trials(derived, &entries, &|_, _| provenance(), &|_| (), &Default::default())?;
    let mut all = Ingested::default();
    let mut written = Vec::new();
    for IngestedTrial { rows, written: tables, .. } in done {
        all.extend(rows);
        let names = tables.into_keys().map(|path| path.strip_prefix(derived).unwrap().to_owned());
        written.extend(names.map(|name| name.to_str().unwrap().to_owned()));
    }
    FolderInput::new(&config, &listed).diagnose(&mut all, &Default::default());
    for path in outdated_tables(derived, &written.iter().map(String::as_str).collect())? {
        fs::remove_file(path)?;
    }
    all.write(derived, &provenance())?;
    Ok(all)
}

/// Returns the relative names and contents of all files below a folder, except locks and records of what is up to date.
fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if ![".lock", "up-to-date.json"].iter().any(|name| path.ends_with(name)) {
                let name = path.strip_prefix(folder).unwrap().to_owned();
                found.push((name, fs::read(&path).unwrap()));
            }
        }
    }
    found.sort();
    found
}

#[test]
fn bad_trials_fail_without_affecting_others() {
    let folder = folder();
    let derived = tempfile::tempdir().unwrap();
    let ingested = ingest(folder.path(), derived.path(), 2);
    let statuses: Vec<(&str, &str)> =
        ingested.trials.iter().map(|row| (row.trial.as_str(), row.status.name())).collect();
    assert_eq!(
        statuses,
        [
            ("good", "ok"),
            ("absent", "failed"),
            ("empty", "failed"),
            ("text", "failed"),
            ("still", "failed"),
            ("unknown", "failed"),
            ("second", "ok"),
            ("coast", "ok"),
        ]
    );
    let message = |i: usize| ingested.trials[i].message.as_str();
    // Paths are relative to the configuration.
    let home = Path::new(folder.path().file_name().unwrap());
    let path = |name: &str| home.join(name).display().to_string();
    assert_eq!(message(1), path("absent.csv") + ": no such file");
    let found = ": found an empty file, needed a `Trajectories` section";
    assert_eq!(message(2), path("empty.csv") + found);
    assert!(message(3).contains("text.csv, line 6, column 3 (Robot:M1 X): found `lost "));
    let still = path("still.csv") + ": the joints swing by at most 0.";
    assert!(message(4).starts_with(&still), "{}", message(4));
    assert!(message(5).contains("did you mean `kinematic-symmetric`?"), "{}", message(5));

    let names: Vec<String> =
        files(derived.path()).iter().map(|(name, _)| name.display().to_string()).collect();
    assert_eq!(
        names,
        [
            "checks.parquet",
            "cycles/good.parquet",
            "cycles/second.parquet",
            "poses/coast.parquet",
            "poses/good.parquet",
            "poses/second.parquet",
            "robot_parameters.parquet",
            "trials.parquet",
            "wheels/coast.parquet",
            "wheels/good.parquet",
            "wheels/second.parquet",
        ]
    );
    let table = Table::read(&derived.path().join("trials.parquet")).unwrap();
    let rows = TrialRow::from_table(&table).unwrap();
    assert_eq!(format!("{rows:?}"), format!("{:?}", ingested.trials));
    let coast = &rows[7];
    assert_eq!((coast.kind, coast.smoothing_window), (TrialKind::CoastDown, 9));
    assert!(coast.metrics.d_m.is_nan() && coast.coverage > 0.9);
    let errors = ingested.checks.iter().filter(|row| row.check == "E001 failed").count();
    assert_eq!(errors, 5);
    // Checks made before a trial failed are also reported.
    let still: Vec<&str> = ingested
        .checks
        .iter()
        .filter(|row| row.trial == "still")
        .map(|row| &row.check[..4])
        .collect();
    assert_eq!(still[..3], ["E001", "W001", "W002"]);
    let good: Vec<&str> = ingested
        .checks
        .iter()
        .filter(|row| row.trial == "good" && row.severity == Severity::Ok)
        .map(|row| &row.check[..4])
        .collect();
    let codes = [
        "W001", "W002", "W003", "W004", "W008", "W011", "W012", "W013", "W017", "W024", "W025",
        "W026", "W018", "W005", "W006", "W007", "W009", "W010", "W019", "W023",
    ];
    assert_eq!(good, codes);
}

/// Returns the rows of a gap-free export, preceded and followed by handling of the robot: at the end the robot stands
/// for a second and is then lifted, tilted and moved a metre away within half a second; at the start the same happens
/// in reverse.
fn put_down_and_taken_away(text: &str) -> String {
    const STANDS: usize = 120;
    const MOVES: usize = 60;
    /// Number of frames of the handling motion that take place within a single frame, as if the robot were snatched
    /// away.
    const SNATCHED: usize = 6;
    with_rows(text, |rows| {
        let mut noise = ChaCha8Rng::seed_from_u64(3);
        let mut moved = |row: &[String], frames_away: usize| -> Vec<String> {
            let numbers: Vec<f64> = row[2..].iter().filter_map(|cell| cell.parse().ok()).collect();
            let fraction = frames_away as f64 / MOVES as f64;
            let (sin, cos) = (0.5 * fraction).sin_cos();
            let [y0, z0] = [numbers[1], numbers[2]];
            let positions = numbers.chunks(3).flat_map(|position| {
                let [y, z] = [position[1] - y0, position[2] - z0];
                [
                    position[0] + 1000.0 * fraction,
                    y0 + cos * y - sin * z,
                    z0 + sin * y + cos * z + 300.0 * fraction,
                ]
            });
            let mut cell = |mm: f64| {
                let normal: f64 = StandardNormal.sample(&mut noise);
                format!("{:.3}", mm + 0.2 * normal)
            };
            row[..2].iter().cloned().chain(positions.map(&mut cell)).collect()
        };
        let first = rows[0].clone();
        let last = rows[rows.len() - 1].clone();
        let begin = (SNATCHED..MOVES).rev().chain([0; STANDS]).map(|away| moved(&first, away));
        let mut all: Vec<Vec<String>> = begin.collect();
        all.append(rows);
        all.extend([0; STANDS].into_iter().chain(SNATCHED..MOVES).map(|away| moved(&last, away)));
        all.iter_mut().zip(1..).for_each(|(row, number)| row[0] = number.to_string());
        *rows = all;
    })
}

#[test]
fn a_recording_in_which_the_robot_is_put_down_and_taken_away_need_not_be_trimmed() {
    for omega_rad_s in [2.0, 3.9] {
        let (mut recording, trial) = symmetric(omega_rad_s);
        recording.loss = 0.0;
        let text = recording.export();
        let trimmed = process_text(&text, &trial).unwrap();
        let untrimmed = process_text(&put_down_and_taken_away(&text), &trial).unwrap();
        assert_eq!(untrimmed.row.status, TrialStatus::Ok, "{}", untrimmed.row.message);
        let jump = check_of(&untrimmed, "W025");
        assert_eq!((jump.severity, jump.value), (Severity::Info, 0.0));
        assert!(jump.message.contains("before or after the cycles in use"), "{}", jump.message);
        // By chance, the number of cycles skipped as transient may differ by one.
        let cycles = [&trimmed, &untrimmed].map(|trial| trial.row.cycles);
        assert!(cycles.iter().all(|count| *count >= 5), "{cycles:?}");
        assert!((untrimmed.row.omega_rad_s / trimmed.row.omega_rad_s - 1.0).abs() < 1e-4);
        let [there, here] = [&untrimmed, &trimmed].map(|trial| trial.row.metrics);
        assert!((there.d_m / here.d_m - 1.0).abs() < 1e-3, "{there:?} {here:?}");
        for (there, here) in there.sigma.into_iter().zip(here.sigma).take(3) {
            assert!((there / here - 1.0).abs() < 0.02, "{there} {here}");
        }
    }
}

#[test]
fn rows_deleted_outside_of_the_used_cycles_change_nothing() {
    let (mut recording, trial) = symmetric(3.9);
    recording.loss = 0.0;
    let text = recording.export();
    let whole = process_text(&text, &trial).unwrap();
    let rows = text.lines().count() - 5;
    // In the first cycle and after the last.
    for deleted in [50..65, rows - 40..rows - 25] {
        let cut = with_rows(&text, |rows| {
            rows.drain(deleted.clone());
            rows.iter_mut().zip(1..).for_each(|(row, number)| row[0] = number.to_string());
        });
        let cut = process_text(&cut, &trial).unwrap();
        assert_eq!(cut.row.status, TrialStatus::Ok, "{}", cut.row.message);
        assert_eq!(check_of(&cut, "W025").severity, Severity::Info);
        // Deleting frames anywhere in the gait changes the frequency by more.
        let error = (cut.row.omega_rad_s - whole.row.omega_rad_s).abs();
        assert!(error < 4.0 * whole.row.omega_rad_s_se, "{error} {}", whole.row.omega_rad_s_se);
        assert!((cut.row.metrics.d_m / whole.row.metrics.d_m - 1.0).abs() < 1e-3);
    }
}

#[test]
fn noise_of_recordings_is_white_and_that_of_a_smoothed_export_is_flagged() {
    for (trial, _) in ingested(&Recipe { omegas_rad_s: vec![0.5, 3.9, 6.0], ..Recipe::new(4) }) {
        let check = check_of(&trial, "W026");
        assert!(check.severity == Severity::Ok && (0.8..1.25).contains(&check.value), "{check:?}");
        assert_eq!(trial.row.noise_white, Some(true));
    }
    let (mut recording, trial) = symmetric(3.9);
    recording.loss = 0.0;
    // A moving average over seven frames.
    let smoothed = with_rows(&recording.export(), |rows| {
        let exact: Vec<Vec<f64>> = rows
            .iter()
            .map(|row| row[2..].iter().map(|cell| cell.parse::<f64>().unwrap()).collect())
            .collect();
        for (row, near) in rows[3..].iter_mut().zip(exact.windows(7)) {
            for (column, cell) in row[2..].iter_mut().enumerate() {
                *cell = format!("{:.3}", mean(near.iter().map(|row| row[column])));
            }
        }
    });
    let smoothed = process_text(&smoothed, &trial).unwrap();
    let check = check_of(&smoothed, "W026");
    assert!(check.severity == Severity::Warning && check.value > 4.0, "{check:?}");
    assert!(smoothed.row.message.contains("export unfiltered"), "{}", smoothed.row.message);
    assert_eq!(smoothed.row.noise_white, Some(false));
}

/// Processes the trials of a recipe and returns them with their true values.
fn ingested(recipe: &Recipe) -> Vec<(ProcessedTrial, serde_json::Value)> {
    let folder = tempfile::tempdir().unwrap();
    let config = Config::default();
    let trials = synthesise(&config, folder.path(), recipe, &|_| Ok(())).unwrap();
    let truth = fs::read_to_string(folder.path().join("truth.json")).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&truth).unwrap();
    trials
        .iter()
        .map(|trial| {
            let processed = process_trial(folder.path(), trial, &config).unwrap();
            (processed, truth["trials"][&trial.id].clone())
        })
        .collect()
}

fn check_of<'p>(processed: &'p ProcessedTrial, code: &str) -> &'p CheckRow {
    processed.checks.iter().find(|row| row.check.starts_with(code)).unwrap()
}

#[test]
fn a_tilted_floor_and_a_tilted_link_are_corrected_and_flagged() {
    let degree = 1_f64.to_radians();
    let tilt = Tilt {
        floor_rad: [0.6 * degree, 0.8 * degree],
        links_rad: [[0.0; 2], [0.8 * degree, -0.6 * degree], [0.0; 2]],
    };
    let recipe = Recipe { omegas_rad_s: vec![1.0, 3.9], tilt, ..Recipe::new(2) };
    for (processed, truth) in ingested(&recipe).iter().filter(|(_, truth)| !truth.is_null()) {
        let row = &processed.row;
        let check = check_of(processed, "W017");
        assert_eq!(check.severity, Severity::Warning);
        assert!((check.value - 1.0).abs() < 0.1, "{}: {}", row.trial, check.value);
        let (floor, link) = check.message.split_once(", ").unwrap();
        assert!(floor.starts_with("the floor is tilted by ") && link.starts_with("link 1 is"));
        assert!(
            floor.ends_with("(the tilt was corrected)")
                && link.ends_with("(the tilt was corrected)")
        );
        let planted = |key: &str| truth[key].as_f64().unwrap();
        assert!((row.metrics.d_m / planted("d_m") - 1.0).abs() < 2e-3, "{}", row.trial);
        let alpha1_deg = (row.metrics.alpha_rad[0] - planted("alpha1_rad")).to_degrees();
        assert!(alpha1_deg.abs() < 0.1, "{}: {alpha1_deg}", row.trial);
        for (found, planted) in row.gait.iter().zip(truth["gait"].as_array().unwrap()) {
            let Some(offset) = planted["offset_rad"].as_f64() else { continue };
            let amplitude = planted["amplitude_rad"].as_f64().unwrap();
            for error in [found.offset_rad - offset, found.amplitude_rad - amplitude] {
                assert!(error.to_degrees().abs() < 0.1, "{}: {error}", row.trial);
            }
        }
    }
}

#[test]
fn a_soft_suspension_and_noise_cause_no_tilt_and_no_joint_displacement() {
    let recipe = Recipe { omegas_rad_s: vec![0.5, 3.9, 6.0], ..Recipe::new(5) };
    for (processed, _) in ingested(&recipe) {
        for code in ["W017", "W018"] {
            let check = check_of(&processed, code);
            assert_eq!(check.severity, Severity::Ok, "{}: {}", check.trial, check.message);
        }
        assert_eq!(check_of(&processed, "W017").value, 0.0);
    }
}

#[test]
fn h_and_l_that_are_wrong_by_a_millimetre_are_flagged_and_do_not_bend_the_joints() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe { omegas_rad_s: vec![3.9], ..Recipe::new(3) };
    let trials = synthesise(&Config::default(), folder.path(), &recipe, &|_| Ok(())).unwrap();
    let mut wrong = Config::default();
    for robot in wrong.robot.values_mut().filter_map(RobotConfig::three_links_mut) {
        let Robot { h_m, l_m, .. } = robot.to_robot();
        robot.set(Quantity::H, h_m.map(|h_m| h_m + 0.001));
        robot.set(Quantity::L, l_m.map(|l_m| l_m - 0.001));
    }
    for trial in trials.iter().filter(|trial| trial.kind == TrialKind::Gait) {
        let right = process_trial(folder.path(), trial, &Config::default()).unwrap();
        let found = process_trial(folder.path(), trial, &wrong).unwrap();
        assert_eq!(check_of(&right, "W018").severity, Severity::Ok);
        assert_eq!(check_of(&found, "W018").severity, Severity::Warning);
        let bent = (right.row.metrics.alpha_rad[0] - found.row.metrics.alpha_rad[0]).to_degrees();
        assert!(bent.abs() < 0.02, "{}: {bent}", trial.id);
        let longer = found.row.metrics.d_m / right.row.metrics.d_m - 1.0;
        assert!(longer.abs() < 1e-3, "{}: {longer}", trial.id);
    }
}

#[test]
fn a_few_jumped_markers_are_reported_and_many_are_flagged() {
    for (misplaced, severity) in [(0.004, Severity::Info), (0.1, Severity::Warning)] {
        let recipe = Recipe { omegas_rad_s: vec![3.9], misplaced, ..Recipe::new(4) };
        let (processed, _) = &ingested(&recipe)[0];
        let check = check_of(processed, "W011");
        assert_eq!(check.severity, severity, "{}", check.message);
        assert!(check.message.contains("have an outlying marker, which is left out: "));
        assert!(check.value > 0.0 && check.limit == 0.02);
        let is_reported = processed.row.message.contains("have an outlying marker");
        assert_eq!(is_reported, severity == Severity::Warning, "{}", processed.row.message);
    }
}

#[test]
fn masses_and_moments_of_inertia_in_grams_are_found_from_the_measured_parameters() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe { omegas_rad_s: Vec::new(), ..Recipe::new(4) };
    let trials = synthesise(&Config::default(), folder.path(), &recipe, &|_| Ok(())).unwrap();
    let mut in_grams = Config::default();
    for robot in in_grams.robot.values_mut().filter_map(RobotConfig::three_links_mut) {
        let Robot { mass_kg, inertia_kg_m2, .. } = robot.to_robot();
        robot.set(Quantity::Mass, mass_kg.map(|mass| 1e3 * mass));
        robot.set(Quantity::Inertia, inertia_kg_m2.map(|inertia| 1e3 * inertia));
    }
    assert!(!trials.is_empty());
    for trial in trials {
        let Ingested { trials, checks, .. } = check_trial(folder.path(), &trial, &in_grams);
        let row = &trials[0];
        let check = checks.iter().find(|row| row.check.starts_with("W022")).unwrap();
        assert_eq!(check.severity, Severity::Error);
        assert!((check.value - 1000.0).abs() < 100.0 && check.limit == 3.0, "{check:?}");
        assert!(check.message.ends_with(": probably mass_kg is in grams"), "{}", check.message);
        assert_eq!(row.status, TrialStatus::Failed);
        assert!(row.message.contains(&check.message), "{}", row.message);
        let right = process_trial(folder.path(), &trial, &Config::default()).unwrap();
        assert_eq!(check_of(&right, "W022").severity, Severity::Ok);
    }
}

/// Measures joint releases and coast-downs for several seeds. They are synthesised with a configuration that `change`
/// has altered, and processed with one that has other values of the parameters to be measured. Returns the measured
/// rows with the true robots.
fn measured_parameters(change: &dyn Fn(&mut Config)) -> Vec<(Robot, RobotParameterRow)> {
    let mut found = Vec::new();
    for seed in 1..=10 {
        let folder = tempfile::tempdir().unwrap();
        let recipe = Recipe { omegas_rad_s: Vec::new(), ..Recipe::new(seed) };
        let mut config = Config::default();
        change(&mut config);
        let trials = synthesise(&config, folder.path(), &recipe, &|_| Ok(())).unwrap();
        let mut configured = Config::default();
        for robot in configured.robot.values_mut().filter_map(RobotConfig::three_links_mut) {
            robot.set(Quantity::Roll, [0.5, 1.0, 1.5]);
            robot.set(Quantity::Stiffness, [0.25]);
            robot.set(Quantity::Damping, [0.01]);
        }
        for trial in trials {
            let processed = process_trial(folder.path(), &trial, &configured).unwrap();
            assert_eq!(processed.row.message, "", "{}", trial.id);
            let truth =
                config.robot[trial.robot.as_ref().unwrap()].three_links().unwrap().to_robot();
            found.push((truth, processed.parameters.unwrap()));
        }
    }
    found
}

#[test]
fn a_release_gives_stiffness_and_damping_and_a_coast_down_the_roll_resistance() {
    let stiff = |config: &mut Config| {
        let robot = config.robot.get_mut("semi-passive").unwrap().three_links_mut().unwrap();
        robot.set(Quantity::Stiffness, [0.3]);
        robot.set(Quantity::Damping, [0.004]);
        robot.set(Quantity::RestAngle, [45.0]);
        robot.set(Quantity::Roll, [0.9, 0.5, 0.2]);
    };
    let mut within = 0;
    let mut count = 0;
    let mut worst = [0.0_f64; 5];
    for (truth, row) in [measured_parameters(&|_| ()), measured_parameters(&stiff)].concat() {
        let mut check = |i: usize, Estimate { value: found, se }: Estimate, truth: f64| {
            count += 1;
            within += usize::from((found - truth).abs() < 2.0 * se);
            worst[i] = worst[i].max((found / truth - 1.0).abs());
        };
        if row.kind == TrialKind::CoastDown {
            let sum = truth.roll_kg_s.iter().sum();
            check(0, row.roll_sum_kg_s, sum);
            assert_eq!((row.joint, row.roll_sum_configured_kg_s), (0, 3.0));
            assert!((row.roll_kg_s[2].value - 0.5 * row.roll_sum_kg_s.value).abs() < 1e-12);
            assert!((row.roll_kg_s[0].se - row.roll_sum_kg_s.se / 6.0).abs() < 1e-12);
            assert!(row.stiffness_nm_rad.value.is_nan());
            continue;
        }
        assert_eq!((row.joint, row.stiffness_configured_nm_rad), (1, 0.25));
        check(1, row.stiffness_nm_rad, truth.stiffness_nm_rad);
        check(2, row.damping_nm_s_rad, truth.damping_nm_s_rad);
        let ratio =
            truth.damping_nm_s_rad / (2.0 * (truth.stiffness_nm_rad * row.inertia_kg_m2).sqrt());
        check(3, row.damping_ratio, ratio);
        check(4, row.damping_ratio_decrement, ratio);
        assert!((row.rest_angle_rad.value - truth.rest_angle_rad).abs() < 0.01);
        let swing_rad = (row.decay_rad(0.0) - row.rest_angle_rad.value).abs();
        assert!(row.released_s > 0.0 && swing_rad > 0.1, "{} {swing_rad}", row.released_s);
        assert!((row.decay_rad(60.0) - row.rest_angle_rad.value).abs() < 1e-3 * swing_rad);
    }
    let bounds = [0.03, 0.02, 0.05, 0.05, 0.1];
    assert!(worst.iter().zip(bounds).all(|(worst, bound)| *worst < bound), "{worst:?}");
    assert!(within * 10 >= count * 8, "{within} of {count} within two standard errors {worst:?}");
}

#[test]
fn a_trial_without_a_decay_reports_it() {
    let (recording, mut trial) = symmetric(3.9);
    let text = recording.export();
    trial.campaign = None;
    trial.omega_rad_s = None;
    trial.robot = Some("semi-passive".to_owned());
    trial.kind = TrialKind::CoastDown;
    let driven = process_text(&text, &trial);
    assert!(
        driven.as_ref().map_or(true, |trial| trial.row.status == TrialStatus::Flagged),
        "{driven:?}"
    );
    let lines: Vec<&str> = text.split_inclusive("\r\n").collect();
    let frame = lines[5].split_once(',').unwrap().1;
    let still: String = (0..300).map(|i| format!("{},{frame}", i + 1)).collect();
    let still = lines[..5].concat() + &still;
    let message = |trial: &Trial| process_text(&still, trial).unwrap_err().to_string();
    assert_eq!(
        message(&trial),
        "a.csv: the robot reaches only 0.000 m/s: push it to 0.05 m/s or more"
    );
    trial.kind = TrialKind::JointRelease;
    assert_eq!(
        message(&trial),
        "a.csv: the joints deviate from their rest angles by only 0.00 degrees: release one joint at an angle of 2.9 \
         degrees or more"
    );
}

#[test]
fn tables_are_identical_for_any_number_of_threads() {
    let folder = folder();
    let [one, two] = [1, 2].map(|threads| {
        let derived = tempfile::tempdir().unwrap();
        ingest(folder.path(), derived.path(), threads);
        files(derived.path())
    });
    assert_eq!(one.len(), 11);
    assert!(one == two);
}

#[test]
fn tables_of_trials_that_are_gone_or_fail_now_are_removed() {
    let folder = folder();
    let derived = tempfile::tempdir().unwrap();
    ingest(folder.path(), derived.path(), 2);
    let notes = derived.path().join("poses/notes.txt");
    fs::write(&notes, "mine").unwrap();
    let [good, gone, foreign] = ["good", "gone", "foreign"]
        .map(|name| derived.path().join(format!("poses/{name}.parquet")));
    fs::copy(good, gone).unwrap();
    fs::write(&foreign, "mine").unwrap();
    fs::write(folder.path().join("second.csv"), "").unwrap();
    ingest(folder.path(), derived.path(), 2);
    let exists = |name: &str| derived.path().join(name).exists();
    assert!(exists("poses/good.parquet") && exists("cycles/good.parquet"));
    assert!(notes.exists() && foreign.exists());
    for folder in ["poses", "wheels", "cycles"] {
        assert!(!exists(&format!("{folder}/second.parquet")));
        assert!(!exists(&format!("{folder}/gone.parquet")));
    }
}

#[test]
fn a_folder_without_a_list_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let ingested = ingest_folder(folder.path(), folder.path());
    assert!(ingested.unwrap_err().to_string().contains("this trial folder has no trials.toml"));
    assert!(files(folder.path()).is_empty());
}

#[test]
fn results_of_a_known_recording_do_not_change() {
    let (recording, trial) = symmetric(3.9);
    let processed = process_text(&recording.export(), &trial).unwrap();
    let TrialRow { omega_rad_s, metrics, sigma_debiased, .. } = processed.row;
    let GaitMetrics { d_m, v_m_s, sigma: [sigma0, ..], alpha_rad: [alpha1_rad, ..], .. } = metrics;
    let sigma1_debiased = sigma_debiased[1].value;
    let pose = processed.poses.values::<f64>("theta_rad").unwrap()[300];
    let wheel = processed.wheels.values::<f64>("skid1_m_s").unwrap()[300];
    let found = [omega_rad_s, d_m, v_m_s, sigma0, sigma1_debiased, alpha1_rad, pose, wheel];
    let found = found.map(|number| format!("{number:.4e}")).join(" ");
    const KNOWN: &str =
        "3.9000e0 3.7495e-1 2.3273e-1 3.7636e-2 6.2934e-1 5.0993e-1 1.7158e-1 -3.1501e-1";
    assert_eq!(found, KNOWN);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Any damaged file yields either metrics or a reason for failure.
    #[test]
    fn damaged_files_never_panic(
        damage in prop::collection::vec((0.0_f64..1.0, 0_usize..7), 1..12),
        cut in 0.05_f64..1.0,
    ) {
        let (mut recording, trial) = symmetric(6.0);
        recording.cycles = 5.0;
        let mut text = recording.export();
        text.truncate((cut * text.len() as f64) as usize);
        for (at, kind) in damage {
            let at = (at * text.len() as f64) as usize;
            text.insert_str(at, ["", ",", "\n", "-", "1e9", "9", "."][kind]);
        }
        match process_text(&text, &trial) {
            Ok(processed) => prop_assert!(processed.row.metrics.d_m.is_finite()),
            Err(failure) => prop_assert!(failure.to_string().len() > 20),
        }
        for kind in [TrialKind::JointRelease, TrialKind::CoastDown] {
            let robot = Some("semi-passive".to_owned());
            let other = Trial { kind, campaign: None, robot, omega_rad_s: None, ..trial.clone() };
            match process_text(&text, &other) {
                Ok(processed) => {
                    let found = processed.parameters.unwrap();
                    let is_flagged = processed.row.status == TrialStatus::Flagged;
                    prop_assert!(
                        is_flagged
                            || found.stiffness_nm_rad.value > 0.0
                            || found.roll_sum_kg_s.value > 0.0
                    );
                }
                Err(failure) => prop_assert!(failure.to_string().len() > 20),
            }
        }
    }
}
