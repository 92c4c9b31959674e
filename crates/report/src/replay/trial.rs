//! The replay of a trial: its poses, how its wheels skid, which markers were missing or corrected,
//! and the motion that the campaign's preferred model predicts.

use std::f64::consts::TAU;
use std::ops::Range;

use trilink_base::numbers::{as_configured, fixed};
use trilink_mechanics::{FIT_ACCURACY, Pose, Problem, Sample, Solver};
use trilink_robot::{JointCommand, Robot};
use trilink_tables::{FitRow, TrialRow};

use super::{Coordinates, Cycles, Direction, MOST_FRAMES, Mark, Marker, Motion, Quantity, Replay};
use crate::recording::{MarkerState, Recording};
use crate::{ReportInput, simulated};

/// Frames of a cycle at least; of a longer recording only a part is shown.
const LEAST_FRAMES_OF_CYCLE: usize = 16;
/// Of which a motion is repeated at most: of a recording of days there are fewer.
const MOST_CYCLES: f64 = 1e6;

/// The replay of a trial; `None` if no pose is known. `fit` is that of the preferred model.
pub(crate) fn of_trial(
    trial: &TrialRow,
    recording: &Recording,
    robot: Robot,
    input: &ReportInput,
    fit: Option<&FitRow>,
) -> Option<Replay> {
    let window = window(trial, recording);
    let stride = window.len().div_ceil(MOST_FRAMES).max(1);
    let frames: Vec<usize> = window.clone().step_by(stride).collect();
    let time_s: Vec<f64> = frames.iter().map(|i| recording.time_s[*i]).collect();
    let poses = frames.iter().map(|i| recording.pose(*i)).collect();
    let mut motions = vec![Motion { name: "measured".to_owned(), colour: None, poses }];
    motions[0].poses.iter().flatten().next()?;
    let mut notes = vec![shown(recording, &window, stride, &time_s)];
    let cycles = recording.cycles.first().map(|first| {
        let prediction = predicted(trial, recording, input, fit, &time_s);
        notes.push(match prediction {
            Ok((motion, how)) => {
                let off = difference(&motions[0], &motion);
                motions.push(motion);
                how + &off
            }
            Err(why) => format!("No model's motion is shown over it: {why}."),
        });
        let period_s = TAU / trial.omega_rad_s;
        Cycles { number: first.cycle, start_s: first.start_s, period_s }
    });
    let (markers, marks) = marks(recording, input, window, stride);
    let skid = |wheel: &Vec<f64>| frames.iter().map(|i| wheel[*i]).collect();
    let skid = Quantity {
        name: "Skid velocity",
        unit: "mm/s",
        units: 1e3,
        decimals: 1,
        values: recording.skid_m_s.iter().map(skid).collect(),
        arrow: Some(Direction::Across),
    };
    let cycles = cycles.filter(|cycles| cycles.period_s.is_finite());
    let quantities = vec![skid];
    Some(Replay { robot, time_s, motions, quantities, markers, marks, cycles, notes })
}

/// Frames that are shown: all, or as many cycles from the first in use on as have enough frames
/// each.
fn window(trial: &TrialRow, recording: &Recording) -> Range<usize> {
    let time_s = &recording.time_s;
    let most_cycles = MOST_FRAMES / LEAST_FRAMES_OF_CYCLE;
    let longest_s = most_cycles as f64 * TAU / trial.omega_rad_s;
    match (time_s.first(), time_s.last()) {
        (Some(first_s), Some(last_s)) if last_s - first_s > longest_s => {
            let used = recording.cycles.iter().find(|cycle| cycle.used);
            let from_s = used.map_or(*first_s, |cycle| cycle.start_s);
            recording.between(from_s, from_s + longest_s)
        }
        _ => 0..time_s.len(),
    }
}

/// A sentence on the frames that are shown.
fn shown(recording: &Recording, window: &Range<usize>, stride: usize, time_s: &[f64]) -> String {
    let every = match stride {
        1 => "every frame".to_owned(),
        stride => format!("one of {stride} frames"),
    };
    let part = match (time_s.first(), time_s.last()) {
        (Some(from_s), Some(to_s)) if window.len() < recording.time_s.len() => {
            format!(" from {} to {} s of the recording", fixed(*from_s, 1), fixed(*to_s, 1))
        }
        _ => String::new(),
    };
    format!("Shown is {every}{part}: positions to 0.1 mm, angles to 0.1 mrad.")
}

/// The motion of a fitted model that starts where and when the first cycle in use does, and how it
/// came about; or why there is none.
fn predicted(
    trial: &TrialRow,
    recording: &Recording,
    input: &ReportInput,
    fit: Option<&FitRow>,
    time_s: &[f64],
) -> Result<(Motion, String), String> {
    let fit = fit.ok_or("no model is fitted to its campaign")?;
    let used = recording.cycles.iter().filter(|cycle| cycle.used);
    let starts = used.filter_map(|cycle| Some((cycle, recording.pose_at(cycle.start_s)?)));
    let (cycle, start) = starts.into_iter().next().ok_or("it has no cycle in use")?;
    let is_known = simulated::OMEGAS_RAD_S.contains(&trial.omega_rad_s);
    let problem = is_known.then(|| simulated::fitted_to(input, fit, trial)).flatten();
    let numbers = |joint: &JointCommand| joint.offset_rad + joint.amplitude_rad + joint.phase_rad;
    let is_known = |of: &Problem| of.gait.joints.iter().flatten().map(numbers).all(f64::is_finite);
    let problem = problem.filter(is_known).ok_or_else(|| {
        format!("the fit of {}, the trial's frequency or its gait is not known", fit.model)
    })?;
    let mut solver = Solver::default();
    solver.solve(&problem, FIT_ACCURACY).map_err(|error| format!("{}: {error}", fit.model))?;
    let samples = solver.cycle(simulated::SAMPLES);
    let samples = samples.map_err(|error| format!("{}: {error}", fit.model))?;
    let poses = time_s.iter().map(|time_s| time_s - cycle.start_s);
    let motion = Motion {
        name: fit.model.to_string(),
        colour: Some(input.look(fit.model).colour),
        poses: repeated(&samples, start, poses),
    };
    let how = format!(
        "Dashed: {} as fitted to the campaign, with the {} gait at {} rad/s, in steady motion, \
         from the pose and the phase that the robot has where cycle {} begins, the first in use",
        fit.model,
        fit.gait_input.name(),
        as_configured(problem.omega_rad_s),
        cycle.cycle
    );
    Ok((motion, how))
}

/// Poses and joint angles at rising times after the start of a motion that repeats a cycle; none
/// before, or after a million cycles.
pub(crate) fn repeated(
    samples: &[Sample],
    mut start: Pose,
    times_s: impl Iterator<Item = f64>,
) -> Vec<Option<Coordinates>> {
    let [.., last] = samples else { return Vec::new() };
    let (period_s, intervals) = (last.time_s, samples.len() - 1);
    let mut cycles = 0.0;
    let at = |time_s: f64| {
        if !(time_s >= 0.0 && period_s > 0.0 && time_s <= MOST_CYCLES * period_s) {
            return None;
        }
        while time_s >= (cycles + 1.0) * period_s {
            (start, cycles) = (start * last.pose, cycles + 1.0);
        }
        let place = (time_s / period_s - cycles) * intervals as f64;
        let before = (place as usize).min(intervals - 1);
        let part = place - before as f64;
        let (a, b) = (&samples[before], &samples[before + 1]);
        let between = |a: f64, b: f64| a + part * (b - a);
        let pose = Pose {
            x_m: between(a.pose.x_m, b.pose.x_m),
            y_m: between(a.pose.y_m, b.pose.y_m),
            theta_rad: between(a.pose.theta_rad, b.pose.theta_rad),
        };
        Some((start * pose, [0, 1].map(|joint| between(a.phi_rad[joint], b.phi_rad[joint]))))
    };
    times_s.map(at).collect()
}

/// How far a prediction is off where both end.
fn difference(measured: &Motion, predicted: &Motion) -> String {
    let both = measured.poses.iter().zip(&predicted.poses);
    let ends = both.rev().find_map(|(measured, predicted)| Some(((*measured)?.0, (*predicted)?.0)));
    let Some((measured, predicted)) = ends else { return ".".to_owned() };
    let away_mm = 1e3 * (predicted.x_m - measured.x_m).hypot(predicted.y_m - measured.y_m);
    let turned_deg = (predicted.theta_rad - measured.theta_rad).to_degrees();
    format!("; at the end it is {} mm and {}° off.", fixed(away_mm, 1), fixed(turned_deg, 1))
}

/// The markers of the layout, and when they were missing or corrected. A frame that is shown
/// stands for all up to the next one.
fn marks(
    recording: &Recording,
    input: &ReportInput,
    window: Range<usize>,
    stride: usize,
) -> (Vec<Marker>, Vec<Mark>) {
    let (mut markers, mut marks) = (Vec::new(), Vec::new());
    for (link, layout) in input.markers().links().into_iter().enumerate() {
        for (label, [x_mm, y_mm, _]) in layout {
            let of_frame = |i: usize| recording.marker(link, label, i);
            let states: Vec<MarkerState> = window
                .clone()
                .step_by(stride)
                .map(|from| {
                    (from..window.end.min(from + stride)).map(of_frame).max().unwrap_or_default()
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
    use trilink_mechanics::Laws;
    use trilink_tables::config::Config;
    use trilink_tables::{Columns as _, CycleRow};

    use super::*;

    #[test]
    fn at_a_time_that_no_recording_has_there_is_no_pose() {
        let (robot, gait) = Config::default().campaign_setup("kinematic-symmetric").unwrap();
        let problem = Problem { robot, gait, laws: Laws::SKID_ROLL, omega_rad_s: 3.9 };
        let mut solver = Solver::default();
        solver.solve(&problem, FIT_ACCURACY).unwrap();
        let times_s = [-1.0, 5.0, 1e300, f64::INFINITY].into_iter();
        let start = Pose { x_m: 0.0, y_m: 0.0, theta_rad: 0.0 };
        let poses = repeated(&solver.cycle(8).unwrap(), start, times_s);
        let there: Vec<bool> = poses.iter().map(Option::is_some).collect();
        assert_eq!(there, [false, true, false, false]);
    }

    #[test]
    fn of_a_long_recording_so_many_cycles_in_use_are_shown_that_each_has_enough_frames() {
        let cycle = |i: usize| CycleRow {
            cycle: i as i64,
            start_s: i as f64,
            used: i >= 3,
            ..CycleRow::blank()
        };
        let recording = |seconds: usize| Recording {
            time_s: (0..100 * seconds).map(|i| i as f64 / 100.0).collect(),
            cycles: (0..seconds).map(cycle).collect(),
            ..Recording::default()
        };
        let trial = TrialRow { omega_rad_s: TAU, ..TrialRow::blank() };
        assert_eq!(window(&trial, &recording(18)), 0..1800);
        let long = recording(600);
        let shown = window(&trial, &long);
        assert_eq!((shown.start, shown.len()), (300, 1801));
        let said = super::shown(&long, &shown, 7, &[3.0, 21.0]);
        assert!(said.starts_with("Shown is one of 7 frames from 3.0 to 21.0 s"), "{said}");
        let unknown = TrialRow { omega_rad_s: f64::NAN, ..trial };
        assert_eq!(window(&unknown, &long), 0..60_000);
    }
}
