//! Estimates the frames in which the robot is driven, the actuation frequency, and the command's phase in each frame.

mod harmonics;

pub(crate) use harmonics::LinearPhase;
pub use harmonics::{GAIT_HARMONICS, Harmonics};

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use nalgebra::SVector;
use trilink_robot::JointCommand;
use trilink_statistics::{extremes, mean, seen, wrap};

use crate::error::Problem;
use crate::signals::noise;
use harmonics::{MIN_SAMPLES_PER_TERM, Regression};

/// Half-width of the frequency search range, relative to the commanded frequency.
const SEARCH: f64 = 0.1;
/// Minimum number of frames per period for resolving the harmonics.
const MIN_FRAMES_PER_PERIOD: f64 = 20.0;
/// Minimum number of periods for estimating frequency and phase separately.
const MIN_PERIODS: f64 = 2.0;
/// Minimum amplitude of a driven joint, relative to the commanded amplitude.
const MIN_AMPLITUDE: f64 = 0.1;
/// Phase interval, rad, over which the joints have to stay still for the robot to count as being at rest.
const REST_PHASE_RAD: f64 = 0.5;

/// Measured frequency and phase of the commanded joints' motion.
#[derive(Debug, Clone)]
pub struct GaitPhase {
    /// Phase of the command in every frame.
    pub phase: LinearPhase,
    /// Measured frequency, rad/s.
    pub omega_rad_s: f64,
    /// Standard error of the measured frequency, rad/s.
    pub omega_se_rad_s: f64,
    /// Range of frames in which the robot is driven.
    pub moving: Range<usize>,
    /// Number of harmonics used to describe the robot's motion in a cycle.
    pub shape_harmonics: usize,
}

/// Returns the number of harmonics used to describe the motion in a cycle, given the cycle's length in frames.
/// Harmonics above 5 Hz are left out where possible, because link vibrations dominate them, whereas wheel skid is
/// smooth.
fn shape_harmonics(frames_per_period: f64, rate_hz: f64) -> usize {
    const HIGHEST_HZ: f64 = 5.0;
    const MAX_HARMONICS: usize = 12;
    let max_resolved = ((frames_per_period / MIN_SAMPLES_PER_TERM as f64 - 1.0) / 2.0) as usize;
    let below = (HIGHEST_HZ * frames_per_period / rate_hz) as usize;
    below.clamp(GAIT_HARMONICS, MAX_HARMONICS).min(max_resolved).max(1)
}

/// Commanded joint: its index, its command, and its angle in every frame, rad.
type Joint<'j> = (usize, JointCommand, &'j [f64]);

/// Commanded gait of a trial, with its frequency and the frame rate of the recording.
pub struct CommandedGait<'a> {
    /// Commands of the joints from front to rear; `None` for a joint that is not commanded. If none is, the phase is that
    /// of the first harmonic of joint 1.
    pub joints: &'a [Option<JointCommand>],
    pub omega_rad_s: f64,
    pub rate_hz: f64,
    /// Number of initial cycles that may be transient and are left out of the frequency estimate if enough cycles
    /// remain.
    pub skip_cycles: usize,
}

impl CommandedGait<'_> {
    /// Estimates the frequency and the phase by harmonic regression on the unsmoothed angles of the commanded joints (of
    /// all joints if none is commanded), rad. `phi_rad` is NaN where a joint is occluded.
    ///
    /// # Errors
    /// Returns an error if the trial has too few frames per period or too few periods, or if a commanded joint is
    /// occluded or does not move.
    pub fn estimate_phase(&self, phi_rad: &[Vec<f64>]) -> Result<GaitPhase, Problem> {
        let step = self.omega_rad_s / self.rate_hz;
        let found = TAU / step;
        if found < MIN_FRAMES_PER_PERIOD {
            return Err(Problem::TooFast { found, needed: MIN_FRAMES_PER_PERIOD });
        }
        let is_commanded = self.joints.iter().any(Option::is_some);
        let joints = self.joints.iter().zip(phi_rad).enumerate();
        let joints: Vec<Joint> = joints
            .filter_map(|(joint, (command, phi_rad))| {
                let command = if is_commanded { *command } else { Some(JointCommand::default()) };
                Some((joint, command?, &phi_rad[..]))
            })
            .collect();
        let moving = moving(&joints, step);
        let periods = moving.len() as f64 * step / TAU;
        if periods < MIN_PERIODS {
            return Err(Problem::TooShort { found: periods, needed: MIN_PERIODS });
        }
        // The transient is left out if enough of the recording remains.
        let skipped = (self.skip_cycles as f64).min(periods - MIN_PERIODS).max(0.0);
        let steady = moving.start + (skipped * TAU / step) as usize..moving.end;
        let (step, variance) =
            measured_step(&joints, &steady, step).ok_or_else(|| occluded(&joints, &steady))?;
        Ok(GaitPhase {
            phase: self.phase(&joints, &steady, step)?,
            omega_rad_s: step * self.rate_hz,
            omega_se_rad_s: variance.sqrt() * self.rate_hz,
            moving,
            shape_harmonics: shape_harmonics(TAU / step - 2.0, self.rate_hz),
        })
    }

    /// Fits the phase of the command, which advances by `step` rad per frame, so that the first harmonics of the joint
    /// angles have, on average, their commanded phases, or, if no joint is commanded, that of joint 1 has phase 0.
    ///
    /// # Errors
    /// Returns an error if a commanded joint does not move.
    fn phase(
        &self,
        joints: &[Joint],
        steady: &Range<usize>,
        step: f64,
    ) -> Result<LinearPhase, Problem> {
        let is_commanded = self.joints.iter().any(Option::is_some);
        let mut phase = LinearPhase::centred(steady, step);
        let mut sin = 0.0;
        let mut cos = 0.0;
        for &(joint, command, phi) in joints {
            let fit = Harmonics::fit(phi, steady.clone(), &phase, GAIT_HARMONICS);
            let found = fit.as_ref().map_or(0.0, |fit| fit.amplitude(1));
            let Some(fit) = fit.filter(|_| found >= MIN_AMPLITUDE * command.amplitude_rad) else {
                return Err(Problem::NotDriven {
                    joint: joint + 1,
                    omega_rad_s: self.omega_rad_s,
                    found_deg: found.to_degrees(),
                    needed_deg: command.amplitude_rad.to_degrees(),
                });
            };
            let ahead = fit.phase_rad() - command.phase_rad;
            let weight = match (is_commanded, joint) {
                (true, _) => command.amplitude_rad,
                (false, 0) => 1.0,
                (false, _) => 0.0,
            };
            sin += weight * ahead.sin();
            cos += weight * ahead.cos();
        }
        phase.offset_rad = wrap(phase.offset_rad + sin.atan2(cos));
        Ok(phase)
    }
}

/// Returns the frames in which the robot is driven: from the first to the last in which a commanded joint is away from
/// its angle at the start or end of the recording. Handling of the robot at either end is excluded.
fn moving(joints: &[Joint], step: f64) -> Range<usize> {
    let frames = joints.first().map_or(0, |(_, _, phi)| phi.len());
    let start = resting_frames(joints, step, false);
    let end = frames.saturating_sub(resting_frames(joints, step, true)).max(start);
    without_handling(joints, start..end, step)
}

/// Returns the number of frames for which the robot rests at the start or, if `backwards`, at the end of the recording.
fn resting_frames(joints: &[Joint], step: f64, backwards: bool) -> usize {
    let still = joints.iter().map(|(_, _, phi)| {
        let tolerance = rest_tolerance(phi);
        let mut phi = phi.to_vec();
        if backwards {
            phi.reverse();
        }
        frames_at_rest(&phi, tolerance)
    });
    still.min().filter(|still| *still as f64 * step > REST_PHASE_RAD).unwrap_or(0)
}

/// Excludes motions at either end of the recording that are too short for a gait and separated from the gait by a rest:
/// putting the robot down and taking it away also move its joints.
fn without_handling(joints: &[Joint], moving: Range<usize>, step: f64) -> Range<usize> {
    /// Number of parts into which a period is divided to detect rest: in no gait do the joints rest for two consecutive
    /// parts.
    const PARTS: f64 = 8.0;
    /// Range of angles in a part, relative to that of the recording, above which the part is no rest even if noise is
    /// as large: of two consecutive parts, a sinusoidal gait covers at least 0.146 in one.
    const MAX_RANGE: f64 = 0.1;
    let frames = ((TAU / (PARTS * step)) as usize).max(1);
    let tolerance = |phi: &[f64]| {
        let [low, high] = extremes(seen(phi));
        f64::min(1.5 * rest_tolerance(phi), MAX_RANGE * (high - low))
    };
    let tolerances: Vec<f64> = joints.iter().map(|(_, _, phi)| tolerance(phi)).collect();
    let starts: Vec<usize> = moving.clone().step_by(frames).collect();
    let mut still = Vec::with_capacity(starts.len());
    for start in &starts {
        let part = *start..moving.end.min(start + frames);
        still.push(joints.iter().zip(&tolerances).all(|((_, _, phi), tolerance)| {
            let [low, high] = extremes(seen(&phi[part.clone()]));
            // False for occluded angles, for which nothing is known.
            (0.0..=*tolerance).contains(&(high - low))
        }));
    }
    let is_rest = |part: usize| {
        let is_still_before = part > 0 && still[part - 1];
        let is_still_after = still.get(part + 1) == Some(&true);
        still[part] && (is_still_before || is_still_after)
    };
    let parts: Vec<usize> = (0..starts.len()).collect();
    let motions = parts.chunk_by(|a, b| is_rest(*a) == is_rest(*b)).filter(|run| !is_rest(run[0]));
    let gaits: Vec<&[usize]> =
        motions.filter(|run| run.len() as f64 >= PARTS * MIN_PERIODS).collect();
    match (gaits.first(), gaits.last()) {
        (Some(first), Some(last)) => {
            let end = starts.get(last[last.len() - 1] + 1).copied().unwrap_or(moving.end);
            starts[first[0]]..end
        }
        _ => moving,
    }
}

/// Returns the deviation of a joint's angle from its value at rest, rad, up to which the joint counts as being at rest,
/// given the angle in the whole recording.
fn rest_tolerance(phi_rad: &[f64]) -> f64 {
    let [low, high] = extremes(seen(phi_rad));
    (6.0 * noise(phi_rad)).max(0.005 * (high - low))
}

/// Returns the number of frames before an angle deviates from its initial value by more than `tolerance` in three
/// successive visible frames, or the total number of frames if it never does.
fn frames_at_rest(phi_rad: &[f64], tolerance: f64) -> usize {
    const FIRST: usize = 5;
    const IN_A_ROW: usize = 3;
    let reference = mean(seen(phi_rad).take(FIRST));
    let visible: Vec<(usize, f64)> =
        phi_rad.iter().copied().enumerate().filter(|(_, phi)| !phi.is_nan()).collect();
    let is_away = |frames: &&[(usize, f64)]| {
        frames.iter().all(|(_, phi)| (phi - reference).abs() > tolerance)
    };
    visible.windows(IN_A_ROW).find(is_away).map_or(phi_rad.len(), |frames| frames[0].0)
}

/// Returns the error that the joint that is visible in the fewest frames of a range is occluded.
fn occluded(joints: &[Joint], range: &Range<usize>) -> Problem {
    let visible =
        joints.iter().map(|(joint, _, phi)| (seen(&phi[range.clone()]).count(), joint + 1));
    let (found, joint) = visible.min().unwrap_or_default();
    Problem::JointOccluded { joint, found, frames: range.len() }
}

/// Measures the phase step per frame, rad, and its variance; `None` if the harmonics cannot be fitted. The search
/// starts at the centre of the range and is refined on ever longer segments, so that the computing time is proportional
/// to the length of the recording.
fn measured_step(joints: &[Joint], range: &Range<usize>, commanded: f64) -> Option<(f64, f64)> {
    const FIRST_PERIODS: f64 = 30.0;
    const LONGER: usize = 4;
    let mut frames = range.len().min((FIRST_PERIODS * TAU / commanded) as usize);
    let mut found = None;
    loop {
        let segment = central(range, frames);
        // The shorter segments may be occluded.
        let coarse =
            found.map_or_else(|| spectral_peak(joints, &segment, commanded), |(step, _)| step);
        found = refined_step(joints, &segment, coarse, commanded);
        if frames == range.len() {
            return found;
        }
        frames = range.len().min(LONGER * frames);
    }
}

/// Returns the phase step per frame, near the commanded one, at which the spectrum of the joint angles peaks.
fn spectral_peak(joints: &[Joint], range: &Range<usize>, commanded: f64) -> f64 {
    let phi = joints.iter().map(|(_, _, phi)| *phi);
    strongest_line(phi, range, commanded, SEARCH * commanded)
        .clamp((1.0 - SEARCH) * commanded, (1.0 + SEARCH) * commanded)
}

/// Returns the phase step per frame, within `reach` of `middle`, at which the summed spectrum of the series peaks;
/// `middle` if no sample is visible.
pub fn strongest_line<'s>(
    series: impl Iterator<Item = &'s [f64]> + Clone,
    range: &Range<usize>,
    middle: f64,
    reach: f64,
) -> f64 {
    let power = |step_rad: f64| -> f64 {
        let phase = LinearPhase::centred(range, step_rad);
        let lines =
            series.clone().filter_map(|series| Harmonics::fit(series, range.clone(), &phase, 1));
        lines.map(|line| line.amplitude(1).powi(2)).sum()
    };
    // A spacing of a quarter of the width of a spectral line is fine enough for the refinement.
    let spacing = 0.5 * PI / range.len() as f64;
    let count = (reach / spacing).ceil() as i64;
    let steps = (-count..=count).map(|i| middle + spacing * i as f64);
    let powers = steps.map(|step| (step, power(step))).filter(|(_, power)| *power > 0.0);
    powers.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(middle, |(step, _)| step)
}

/// Refines the phase step per frame, rad, by Gauss-Newton iterations in which the harmonics are eliminated. Also
/// returns the variance of the step; `None` if the harmonics cannot be fitted or do not determine the step.
fn refined_step(
    joints: &[Joint],
    range: &Range<usize>,
    coarse: f64,
    commanded: f64,
) -> Option<(f64, f64)> {
    const ITERATIONS: usize = 12;
    const TOLERANCE: f64 = 1e-10;
    let mut step = coarse;
    let mut sums = SVector::<f64, 5>::zeros();
    for _ in 0..ITERATIONS {
        let phase = LinearPhase::centred(range, step);
        sums.fill(0.0);
        for (_, _, phi) in joints {
            sums += Regression::new(phi, range.clone(), &phase, GAIT_HARMONICS)?.step_equation();
        }
        if sums[1] <= 0.0 {
            return None;
        }
        // A change of more than the width of a spectral line would lead to another maximum.
        let line = PI / range.len() as f64;
        let change = (sums[0] / sums[1]).clamp(-line, line);
        let reach = 1.2 * SEARCH * commanded;
        step = (step + change).clamp(commanded - reach, commanded + reach);
        if change.abs() < TOLERANCE * commanded {
            break;
        }
    }
    let [_, curvature, squares, neighbours, freedom] = sums.into();
    // Neighbouring residuals are correlated if they are caused by the servo rather than by noise: the number of
    // independent samples is reduced as in a first-order process with that correlation.
    let correlation = (neighbours / squares.max(f64::MIN_POSITIVE)).clamp(0.0, 0.98);
    let inflation = (1.0 + correlation) / (1.0 - correlation);
    let variance = squares / freedom.max(1.0) * inflation / curvature;
    Some((step, variance))
}

/// Returns the central `frames` frames of a range.
fn central(range: &Range<usize>, frames: usize) -> Range<usize> {
    let start = range.start + (range.len() - frames) / 2;
    start..start + frames
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;
    use trilink_robot::Gait;

    use super::*;

    fn measure(
        phi: impl Fn(f64) -> [f64; 2],
        seconds: f64,
        omega: f64,
    ) -> Result<GaitPhase, String> {
        let frames = (seconds * 120.0) as usize;
        let phi_rad = [0, 1]
            .map(|joint| (0..frames).map(|i| phi(i as f64 / 120.0)[joint]).collect::<Vec<f64>>());
        let gait = Gait::symmetric();
        let command = CommandedGait {
            joints: &gait.joints,
            omega_rad_s: omega,
            rate_hz: 120.0,
            skip_cycles: 2,
        };
        command
            .estimate_phase(&phi_rad)
            .map_err(|error| error.in_file(Path::new("a.csv")).to_string())
    }

    fn gait_at(phase: f64) -> [f64; 2] {
        [0.5 * phase.cos() + 0.01 * (3.0 * phase).cos(), 0.04 + 0.52 * phase.sin()]
    }

    #[test]
    fn frequency_and_phase_of_a_clean_gait_are_exact() {
        for (omega, true_omega) in [(3.9, 3.9), (3.9, 3.7), (0.5, 0.52), (6.0, 6.3)] {
            let driven =
                measure(|t| gait_at(true_omega * t + 1.0), 60.0 / omega + 10.0, omega).unwrap();
            assert!((driven.omega_rad_s / true_omega - 1.0).abs() < 1e-9, "{omega}");
            assert!(wrap(driven.phase.offset_rad - 1.0).abs() < 1e-7);
            assert!(driven.omega_se_rad_s < 1e-6);
        }
    }

    #[test]
    fn rest_before_and_after_the_motion_is_left_out() {
        let begin = 4.0;
        let end = 20.0;
        let driven = measure(|t| gait_at(3.9 * (t.clamp(begin, end) - begin)), 27.0, 3.9).unwrap();
        assert!((driven.moving.start as f64 / 120.0 - begin).abs() < 0.1);
        assert!((driven.moving.end as f64 / 120.0 - end).abs() < 0.1);
        assert!((driven.omega_rad_s - 3.9).abs() < 2e-3);
    }

    #[test]
    fn joints_turned_by_hand_before_and_after_a_rest_are_no_gait() {
        // The robot is put down, rests, moves, rests for as long as it moved, and is taken away.
        let motion = |t: f64| {
            let turned = |from: f64, to: f64| {
                let part = ((t - from) / (to - from)).clamp(0.0, 1.0);
                0.4 * part * part * (3.0 - 2.0 * part)
            };
            let [phi1, phi2] = gait_at(3.9 * (t.clamp(8.0, 25.0) - 8.0));
            [phi1 + turned(45.0, 46.0), phi2 + turned(0.0, 1.5) - turned(45.5, 46.5)]
        };
        let driven = measure(motion, 48.0, 3.9).unwrap();
        assert!((driven.moving.start as f64 / 120.0 - 8.0).abs() < 0.9, "{:?}", driven.moving);
        assert!((driven.moving.end as f64 / 120.0 - 25.0).abs() < 0.9, "{:?}", driven.moving);
        assert!((driven.omega_rad_s - 3.9).abs() < 5e-3, "{}", driven.omega_rad_s);
        // A pause within the gait is not excluded.
        let clock = |t: f64| if (12.0..15.0).contains(&t) { 12.0 } else { t };
        let paused = measure(|t| gait_at(3.9 * clock(t)), 27.0, 3.9).unwrap();
        assert_eq!(paused.moving, 0..27 * 120);
    }

    #[test]
    fn a_small_motion_of_a_joint_that_is_not_commanded_has_no_rests() {
        let (omega_rad_s, rate_hz) = (2.0, 120.0);
        for seed in 0..10 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut noise_rad = || -> f64 { 0.003 * random.sample::<f64, _>(StandardNormal) };
            let angle = |i: u32| 0.057 * (2.0 / 120.0 * f64::from(i)).sin() + noise_rad();
            let gait = CommandedGait { joints: &[None], omega_rad_s, rate_hz, skip_cycles: 2 };
            let found = gait.estimate_phase(&[(0..5400).map(angle).collect()]).expect("a gait");
            assert!(found.moving.len() > 5200, "{seed}: {:?}", found.moving);
        }
    }

    #[test]
    fn a_trial_that_does_not_move_or_is_too_short_is_rejected() {
        let still = measure(|_| [0.1, 0.2], 20.0, 3.9).unwrap_err();
        assert_eq!(still, "a.csv: found 0.00 periods of motion, but at least 2 are needed");
        let short = measure(|t| gait_at(3.9 * t), 1.2, 3.9).unwrap_err();
        assert_eq!(short, "a.csv: found 0.74 periods of motion, but at least 2 are needed");
        let slow = measure(|t| [gait_at(0.3 * t)[0], gait_at(0.3 * t)[1]], 60.0, 5.0).unwrap_err();
        assert!(slow.starts_with("a.csv: joint 1 moves by only "), "{slow}");
        let fast = measure(|t| gait_at(50.0 * t), 10.0, 50.0).unwrap_err();
        assert!(fast.starts_with("a.csv: found 15.1 frames per commanded period"), "{fast}");
    }
}
