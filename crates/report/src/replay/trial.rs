//! Replay of a trial: measured poses and skid velocities, missing and corrected markers, and the motion predicted by
//! the campaign's preferred model.

use std::f64::consts::TAU;
use std::ops::Range;

use trilink_base::numbers::{as_configured, fixed};
use trilink_mechanics::{FIT_ACCURACY, Pose, Sample};
use trilink_robot::metrics::padded;
use trilink_robot::{AnyGait, JointCommand};
use trilink_tables::config::MarkerLayout;
use trilink_tables::{FitRow, TrialRow};

use super::{Cycles, Direction, MAX_FRAMES, Mark, Marker, Motion, Quantity, Replay};
use crate::ReportInput;
use crate::recording::{Coordinates, MarkerState, Recording};
use crate::simulated;

/// Minimum number of frames per cycle in a replay; if the whole recording would have fewer, only part of it is shown.
const MIN_FRAMES_OF_CYCLE: usize = 16;
/// Maximum number of cycles in a repeated motion; even a recording that lasts for days has fewer.
const MAX_CYCLES: f64 = 1e6;

/// Returns the replay of a trial, or `None` if no pose is known. `fit` is the fit of the campaign's preferred model;
/// `skid_scale_m_s` is the skid velocity that sets the scale of the arrows, the same for all trials of a robot.
pub(crate) fn of_trial(
    trial: &TrialRow,
    recording: &Recording,
    robot: &str,
    input: &ReportInput,
    fit: Option<&FitRow>,
    skid_scale_m_s: Option<f64>,
) -> Option<Replay> {
    let layout = input.marker_layout(robot);
    let robot = input.robot(robot).filter(|of| of.joints() == recording.phi_rad.len())?;
    let window = window(trial, recording);
    let stride = window.len().div_ceil(MAX_FRAMES).max(1);
    let frames: Vec<usize> = window.clone().step_by(stride).collect();
    let time_s: Vec<f64> = frames.iter().map(|i| recording.time_s[*i]).collect();
    let poses = frames.iter().map(|i| recording.pose(*i)).collect();
    let mut motions = vec![Motion { name: "measured".to_owned(), colour: None, poses }];
    motions[0].poses.iter().flatten().next()?;
    let mut notes = vec![frames_note(recording, &window, stride, &time_s)];
    let cycles = recording.cycles.first().map(|first| {
        let prediction = predicted(trial, recording, input, fit, &time_s);
        notes.push(match prediction {
            Ok((motion, how)) => {
                let note = how + &end_deviation(&motions[0], &motion);
                motions.push(motion);
                note
            }
            Err(why) => format!("No predicted motion is overlaid: {why}."),
        });
        let period_s = TAU / trial.omega_rad_s;
        Cycles { number: first.cycle, start_s: first.start_s, period_s }
    });
    let (markers, marks) =
        layout.map_or((Vec::new(), Vec::new()), |layout| marks(recording, &layout, window, stride));
    let skid = Quantity {
        name: "Skid velocity".to_owned(),
        unit: "mm/s",
        units: 1e3,
        decimals: 1,
        values: recording
            .skid_m_s
            .iter()
            .map(|wheel| frames.iter().map(|i| wheel[*i]).collect())
            .collect(),
        arrow: Some(Direction::Across),
        full_scale: skid_scale_m_s,
    };
    let cycles = cycles.filter(|cycles| cycles.period_s.is_finite());
    let quantities = vec![skid];
    let robot = robot.to_chain(&AnyGait::NONE);
    Some(Replay { robot, time_s, motions, quantities, markers, marks, cycles, notes })
}

/// Returns the range of frames that the replay shows: all frames or, if the recording is too long, as many cycles from
/// the first used one as can be shown with at least [`MIN_FRAMES_OF_CYCLE`] frames per cycle.
fn window(trial: &TrialRow, recording: &Recording) -> Range<usize> {
    let time_s = &recording.time_s;
    let max_cycles = MAX_FRAMES / MIN_FRAMES_OF_CYCLE;
    let longest_s = max_cycles as f64 * TAU / trial.omega_rad_s;
    match (time_s.first(), time_s.last()) {
        (Some(first_s), Some(last_s)) if last_s - first_s > longest_s => {
            let used = recording.cycles.iter().find(|cycle| cycle.used);
            let from_s = used.map_or(*first_s, |cycle| cycle.start_s);
            recording.between(from_s, from_s + longest_s)
        }
        _ => 0..time_s.len(),
    }
}

/// Returns a sentence that says which frames of the recording are shown.
fn frames_note(
    recording: &Recording,
    window: &Range<usize>,
    stride: usize,
    time_s: &[f64],
) -> String {
    let every = match stride {
        1 => "every frame".to_owned(),
        stride => format!("one of every {stride} frames"),
    };
    let range = match (time_s.first(), time_s.last()) {
        (Some(from_s), Some(to_s)) if window.len() < recording.time_s.len() => {
            format!(" from {} to {} s of the recording", fixed(*from_s, 1), fixed(*to_s, 1))
        }
        _ => String::new(),
    };
    format!("The replay shows {every}{range}, with positions to 0.1 mm and angles to 0.1 mrad.")
}

/// Returns the motion that a fitted model predicts from the measured pose at the start of the first cycle in use, with
/// a description of this motion.
///
/// # Errors
/// Returns the reason if the motion cannot be predicted.
fn predicted(
    trial: &TrialRow,
    recording: &Recording,
    input: &ReportInput,
    fit: Option<&FitRow>,
    time_s: &[f64],
) -> Result<(Motion, String), String> {
    let fit = fit.ok_or("no model is fitted to the campaign")?;
    let used = recording.cycles.iter().filter(|cycle| cycle.used);
    let starts = used.filter_map(|cycle| Some((cycle, recording.pose_at(cycle.start_s)?)));
    let (cycle, start) = starts.into_iter().next().ok_or("no cycle of the trial is used")?;
    let times_s = time_s.iter().map(|time_s| time_s - cycle.start_s);
    let is_known = simulated::OMEGAS_RAD_S.contains(&trial.omega_rad_s);
    let unknown =
        || format!("the trial's frequency or gait, or the fit of {}, is not known", fit.model);
    let no_motion = |error| format!("{}: {error}", fit.model);
    let are_finite = |gait: &[Option<JointCommand>]| {
        gait.iter()
            .flatten()
            .map(|joint| joint.offset_rad + joint.amplitude_rad + joint.phase_rad)
            .all(f64::is_finite)
    };
    let problem = is_known.then(|| simulated::fitted_to(input, fit, trial)).flatten();
    let problem = problem.filter(|of| are_finite(&of.gait.joints)).ok_or_else(unknown)?;
    let samples = problem.cycle(FIT_ACCURACY, simulated::SAMPLES);
    let poses = repeated(&samples.map_err(no_motion)?, start, times_s);
    let colour = Some(input.look(fit.model).colour);
    let motion = Motion { name: fit.model.to_string(), colour, poses };
    let how = format!(
        "Dashed: steady motion of {} as fitted to the campaign, with the {} gait at {} rad/s, \
         starting with the pose and phase of the robot at the start of cycle {}, the first used cycle",
        fit.model,
        fit.gait_input.name(),
        as_configured(trial.omega_rad_s),
        cycle.cycle
    );
    Ok((motion, how))
}

/// Returns the poses and joint angles of a motion that starts at the pose `start` and repeats the cycle `samples`.
/// `times_s` are measured from the start and must be sorted; the result is `None` at times before the start and after
/// [`MAX_CYCLES`] cycles.
pub(crate) fn repeated(
    samples: &[Sample],
    mut start: Pose,
    times_s: impl Iterator<Item = f64>,
) -> Vec<Option<Coordinates>> {
    let [.., last] = samples else { return Vec::new() };
    let period_s = last.time_s;
    let intervals = samples.len() - 1;
    let mut cycles = 0.0;
    times_s
        .map(|time_s| {
            if !(time_s >= 0.0 && period_s > 0.0 && time_s <= MAX_CYCLES * period_s) {
                return None;
            }
            while time_s >= (cycles + 1.0) * period_s {
                (start, cycles) = (start * last.pose, cycles + 1.0);
            }
            let position = (time_s / period_s - cycles) * intervals as f64;
            let before = (position as usize).min(intervals - 1);
            let fraction = position - before as f64;
            let between = |a: f64, b: f64| a + fraction * (b - a);
            let [a, b] = [&samples[before], &samples[before + 1]];
            let joints = a.phi_rad.iter().zip(&b.phi_rad);
            let phi_rad: Vec<f64> = joints.map(|(a, b)| between(*a, *b)).collect();
            let [a, b] = [a.pose, b.pose];
            let pose = Pose {
                x_m: between(a.x_m, b.x_m),
                y_m: between(a.y_m, b.y_m),
                theta_rad: between(a.theta_rad, b.theta_rad),
            };
            Some((start * pose, padded(&phi_rad)))
        })
        .collect()
}

/// Returns the end of a sentence that states the deviation of the prediction from the measurement in the last frame in
/// which both are known.
fn end_deviation(measured: &Motion, predicted: &Motion) -> String {
    let both = measured.poses.iter().zip(&predicted.poses);
    let ends = both.rev().find_map(|(measured, predicted)| Some(((*measured)?.0, (*predicted)?.0)));
    let Some((measured, predicted)) = ends else { return ".".to_owned() };
    let away_mm = 1e3 * (predicted.x_m - measured.x_m).hypot(predicted.y_m - measured.y_m);
    let turned_deg = (predicted.theta_rad - measured.theta_rad).to_degrees();
    format!(
        "; at the end of the recording, the prediction deviates by {} mm and {}°.",
        fixed(away_mm, 1),
        fixed(turned_deg, 1)
    )
}

/// Returns the markers of the layout and the ranges of frames in which they were missing or corrected. A frame shown in
/// the replay stands for all recorded frames up to the next frame shown.
fn marks(
    recording: &Recording,
    layout: &MarkerLayout,
    window: Range<usize>,
    stride: usize,
) -> (Vec<Marker>, Vec<Mark>) {
    let mut markers = Vec::new();
    let mut marks = Vec::new();
    for (link, layout) in layout.links().into_iter().enumerate() {
        for (label, [x_mm, y_mm, _]) in layout {
            let states: Vec<MarkerState> = window
                .clone()
                .step_by(stride)
                .map(|from| {
                    (from..window.end.min(from + stride))
                        .map(|i| recording.marker(link, label, i))
                        .max()
                        .unwrap_or_default()
                })
                .collect();
            let mut from = 0;
            for run in states.chunk_by(|a, b| a == b) {
                let frames = [from, from + run.len() - 1];
                from += run.len();
                let is_corrected = run[0] == MarkerState::Corrected;
                let mark = Mark { frames, marker: markers.len(), is_corrected };
                marks.extend((run[0] != MarkerState::Seen).then_some(mark));
            }
            markers.push(Marker { link, label: label.clone(), position_mm: [*x_mm, *y_mm] });
        }
    }
    marks.sort_by_key(|mark| mark.frames);
    (markers, marks)
}

#[cfg(test)]
mod tests {
    use trilink_mechanics::{Laws, Problem};
    use trilink_tables::config::Config;
    use trilink_tables::{Columns as _, CycleRow};

    use super::*;

    #[test]
    fn times_outside_the_recording_have_no_pose() {
        let (robot, gait) = Config::default().campaign_setup("kinematic-symmetric").unwrap();
        let problem = Problem::new(robot, gait, Laws::SKID_ROLL, 3.9);
        let cycle = problem.cycle(FIT_ACCURACY, 8).unwrap();
        let times_s = [-1.0, 5.0, 1e300, f64::INFINITY].into_iter();
        let start = Pose { x_m: 0.0, y_m: 0.0, theta_rad: 0.0 };
        let poses = repeated(&cycle, start, times_s);
        let there: Vec<bool> = poses.iter().map(Option::is_some).collect();
        assert_eq!(there, [false, true, false, false]);
    }

    #[test]
    fn a_long_recording_is_shortened_so_that_each_cycle_has_enough_frames() {
        let recording = |seconds: usize| Recording {
            time_s: (0..100 * seconds).map(|i| i as f64 / 100.0).collect(),
            cycles: (0..seconds)
                .map(|i| CycleRow {
                    cycle: i as i64,
                    start_s: i as f64,
                    used: i >= 3,
                    ..CycleRow::blank()
                })
                .collect(),
            ..Recording::default()
        };
        let trial = TrialRow { omega_rad_s: TAU, ..TrialRow::blank() };
        assert_eq!(window(&trial, &recording(18)), 0..1800);
        let long = recording(600);
        let shown = window(&trial, &long);
        assert_eq!((shown.start, shown.len()), (300, 1801));
        let sentence = super::frames_note(&long, &shown, 7, &[3.0, 21.0]);
        assert!(
            sentence.starts_with("The replay shows one of every 7 frames from 3.0 to 21.0 s"),
            "{sentence}"
        );
        let unknown = TrialRow { omega_rad_s: f64::NAN, ..trial };
        assert_eq!(window(&unknown, &long), 0..60_000);
    }
}
