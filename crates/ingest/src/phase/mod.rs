//! When the robot is driven, at which frequency, and which phase of the command each frame has.

mod harmonics;

pub(crate) use harmonics::LinearPhase;
pub use harmonics::{GAIT_HARMONICS, Harmonics};

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use nalgebra::SVector;
use trilink_robot::{Gait, JointCommand};
use trilink_statistics::{extremes, mean, seen, wrap};

use crate::error::Problem;
use crate::signals::noise;
use harmonics::{LEAST_SAMPLES, LEAST_SAMPLES_PER_TERM, Regression};

/// The frequency is looked for this far from the commanded one.
const SEARCH: f64 = 0.1;
/// Fewer frames per period cannot carry the harmonics.
const LEAST_FRAMES_PER_PERIOD: f64 = 20.0;
/// Fewer periods do not separate frequency and phase.
const LEAST_PERIODS: f64 = 2.0;
/// A commanded joint that reaches less than this part of its amplitude is not driven.
const LEAST_AMPLITUDE: f64 = 0.1;
/// The robot rests if its joints stay where they are for longer than this phase, rad.
const REST_PHASE_RAD: f64 = 0.5;

/// What the commanded joints did.
#[derive(Debug, Clone)]
pub struct GaitPhase {
    /// Phase of the command in every frame.
    pub phase: LinearPhase,
    pub omega_rad_s: f64,
    pub omega_se_rad_s: f64,
    /// Frames in which the robot is driven.
    pub moving: Range<usize>,
    /// Harmonics that describe what the robot does in a cycle.
    pub shape_harmonics: usize,
}

/// Harmonics that the motion of a cycle has, by its length. The wheels' skid is smooth above
/// this frequency, and there the links shake.
fn shape_harmonics(frames_per_period: f64, rate_hz: f64) -> usize {
    const HIGHEST_HZ: f64 = 5.0;
    const MOST: usize = 12;
    let most = ((frames_per_period / LEAST_SAMPLES_PER_TERM as f64 - 1.0) / 2.0) as usize;
    let below = (HIGHEST_HZ * frames_per_period / rate_hz) as usize;
    below.clamp(GAIT_HARMONICS, MOST).min(most).max(1)
}

/// A commanded joint: its index, its command and its angle in every frame, rad.
type Joint<'j> = (usize, JointCommand, &'j [f64]);

/// The commanded gait and how the trial is sampled.
pub struct CommandedGait<'a> {
    pub gait: &'a Gait,
    pub omega_rad_s: f64,
    pub rate_hz: f64,
    /// Cycles that may be transient and are not needed for the frequency.
    pub skip_cycles: usize,
}

impl CommandedGait<'_> {
    /// Finds frequency and phase by harmonic regression on the commanded joints' unsmoothed
    /// angles; NaN where a joint was not seen.
    pub fn estimate_phase(&self, phi_rad: &[Vec<f64>; 2]) -> Result<GaitPhase, Problem> {
        let step = self.omega_rad_s / self.rate_hz;
        let found = TAU / step;
        if found < LEAST_FRAMES_PER_PERIOD {
            return Err(Problem::TooFast { found, needed: LEAST_FRAMES_PER_PERIOD });
        }
        let commanded = |joint: usize| Some((joint, self.gait.joints[joint]?, &phi_rad[joint][..]));
        let joints: Vec<Joint> = (0..2).filter_map(commanded).collect();
        let moving = moving(&joints, step);
        let periods = moving.len() as f64 * step / TAU;
        let too_short = || Problem::TooShort { found: periods, needed: LEAST_PERIODS };
        if periods < LEAST_PERIODS {
            return Err(too_short());
        }
        for (joint, _, phi) in &joints {
            let found = seen(&phi[moving.clone()]).count();
            if found < LEAST_SAMPLES {
                let (joint, needed) = (joint + 1, LEAST_SAMPLES);
                return Err(Problem::JointUnseen { joint, found, needed });
            }
        }
        // The transient is left out if enough remains.
        let skipped = (self.skip_cycles as f64).min(periods - LEAST_PERIODS).max(0.0);
        let steady = moving.start + (skipped * TAU / step) as usize..moving.end;
        let (step, variance) = measured_step(&joints, &steady, step).ok_or_else(too_short)?;
        Ok(GaitPhase {
            phase: self.phase(&joints, &steady, step)?,
            omega_rad_s: step * self.rate_hz,
            omega_se_rad_s: variance.sqrt() * self.rate_hz,
            moving,
            shape_harmonics: shape_harmonics(TAU / step - 2.0, self.rate_hz),
        })
    }

    /// The phase in which the joints' first harmonics have, on average, their commanded phases.
    fn phase(
        &self,
        joints: &[Joint],
        steady: &Range<usize>,
        step: f64,
    ) -> Result<LinearPhase, Problem> {
        let mut phase = LinearPhase::centred(steady, step);
        let (mut sin, mut cos) = (0.0, 0.0);
        for &(joint, command, phi) in joints {
            let fit = Harmonics::fit(phi, steady.clone(), &phase, GAIT_HARMONICS);
            let found = fit.as_ref().map_or(0.0, |fit| fit.amplitude(1));
            let Some(fit) = fit.filter(|_| found >= LEAST_AMPLITUDE * command.amplitude_rad) else {
                return Err(Problem::NotDriven {
                    joint: joint + 1,
                    omega_rad_s: self.omega_rad_s,
                    found_deg: found.to_degrees(),
                    needed_deg: command.amplitude_rad.to_degrees(),
                });
            };
            let ahead = fit.phase_rad() - command.phase_rad;
            sin += command.amplitude_rad * ahead.sin();
            cos += command.amplitude_rad * ahead.cos();
        }
        phase.offset_rad = wrap(phase.offset_rad + sin.atan2(cos));
        Ok(phase)
    }
}

/// The frames in which the robot is driven: from the first to the last in which a commanded joint leaves
/// the angle at which the recording starts or ends, without what is no gait at either end.
fn moving(joints: &[Joint], step: f64) -> Range<usize> {
    let frames = joints.first().map_or(0, |(_, _, phi)| phi.len());
    let rest = |backwards: bool| {
        let still = joints.iter().map(|(_, _, phi)| {
            let tolerance = rest_tolerance(phi);
            let mut phi = phi.to_vec();
            if backwards {
                phi.reverse();
            }
            frames_at_rest(&phi, tolerance)
        });
        still.min().filter(|still| *still as f64 * step > REST_PHASE_RAD).unwrap_or(0)
    };
    let start = rest(false);
    without_handling(joints, start..frames.saturating_sub(rest(true)).max(start), step)
}

/// Leaves out what is too short for a gait at either end and apart from it by a rest: hands that put the
/// robot down or take it away turn its joints, too.
fn without_handling(joints: &[Joint], moving: Range<usize>, step: f64) -> Range<usize> {
    /// Of a period; no gait is still for two parts in a row.
    const PARTS: f64 = 8.0;
    let frames = ((TAU / (PARTS * step)) as usize).max(1);
    let tolerances: Vec<f64> = joints.iter().map(|(_, _, phi)| 1.5 * rest_tolerance(phi)).collect();
    let is_still = |start: usize| {
        joints.iter().zip(&tolerances).all(|((_, _, phi), tolerance)| {
            let [low, high] = extremes(seen(&phi[start..moving.end.min(start + frames)]));
            // Of what was not seen nothing is known.
            (0.0..=*tolerance).contains(&(high - low))
        })
    };
    let starts: Vec<usize> = moving.clone().step_by(frames).collect();
    let still: Vec<bool> = starts.iter().map(|start| is_still(*start)).collect();
    let is_rest = |part: usize| {
        let of = |other: Option<usize>| other.and_then(|other| still.get(other)) == Some(&true);
        still[part] && (of(part.checked_sub(1)) || of(Some(part + 1)))
    };
    let parts: Vec<usize> = (0..starts.len()).collect();
    let motions = parts.chunk_by(|a, b| is_rest(*a) == is_rest(*b)).filter(|run| !is_rest(run[0]));
    let gaits: Vec<&[usize]> =
        motions.filter(|run| run.len() as f64 >= PARTS * LEAST_PERIODS).collect();
    match (gaits.first(), gaits.last()) {
        (Some(first), Some(last)) => {
            let end = starts.get(last[last.len() - 1] + 1).copied().unwrap_or(moving.end);
            starts[first[0]]..end
        }
        _ => moving,
    }
}

/// How far an angle that rests is from where it is, at most.
fn rest_tolerance(phi_rad: &[f64]) -> f64 {
    let [low, high] = extremes(seen(phi_rad));
    (6.0 * noise(phi_rad)).max(0.005 * (high - low))
}

/// Frames before an angle leaves, for good, where it starts.
fn frames_at_rest(phi_rad: &[f64], tolerance: f64) -> usize {
    const FIRST: usize = 5;
    const IN_A_ROW: usize = 3;
    let reference = mean(seen(phi_rad).take(FIRST));
    let mut away = 0;
    for (i, phi) in phi_rad.iter().enumerate().filter(|(_, phi)| !phi.is_nan()) {
        away = if (phi - reference).abs() > tolerance { away + 1 } else { 0 };
        if away == IN_A_ROW {
            return i + 1 - IN_A_ROW;
        }
    }
    phi_rad.len()
}

/// The step per frame with its variance. It is looked for in the middle of the range, and refined
/// there and on longer and longer parts, so that a long recording takes a time in proportion.
fn measured_step(joints: &[Joint], range: &Range<usize>, commanded: f64) -> Option<(f64, f64)> {
    const FIRST_PERIODS: f64 = 30.0;
    const LONGER: usize = 4;
    let part = |frames: usize| {
        let start = range.start + (range.len() - frames) / 2;
        start..start + frames
    };
    let mut frames = range.len().min((FIRST_PERIODS * TAU / commanded) as usize);
    let mut step = spectral_peak(joints, &part(frames), commanded);
    while frames < range.len() {
        step = refined_step(joints, &part(frames), step, commanded)?.0;
        frames = range.len().min(LONGER * frames);
    }
    refined_step(joints, range, step, commanded)
}

/// The step per frame, near the commanded one, at which the joints' spectrum is largest.
fn spectral_peak(joints: &[Joint], range: &Range<usize>, commanded: f64) -> f64 {
    let phi = joints.iter().map(|(_, _, phi)| *phi);
    strongest_line(phi, range, commanded, SEARCH * commanded)
        .clamp((1.0 - SEARCH) * commanded, (1.0 + SEARCH) * commanded)
}

/// The step per frame within `reach` of the middle one at which the spectrum of the series together
/// is largest; the middle one if nothing was seen.
pub fn strongest_line<'s>(
    series: impl Iterator<Item = &'s [f64]> + Clone,
    range: &Range<usize>,
    middle: f64,
    reach: f64,
) -> f64 {
    let power = |step_rad: f64| -> f64 {
        let phase = LinearPhase::centred(range, step_rad);
        let line = |series: &[f64]| Harmonics::fit(series, range.clone(), &phase, 1);
        series.clone().filter_map(line).map(|line| line.amplitude(1).powi(2)).sum()
    };
    // A quarter of the width of a spectral line is fine enough for the refinement.
    let spacing = 0.5 * PI / range.len() as f64;
    let count = (reach / spacing).ceil() as i64;
    let steps = (-count..=count).map(|i| middle + spacing * i as f64);
    let best = steps.map(|step| (step, power(step))).max_by(|a, b| a.1.total_cmp(&b.1));
    best.map_or(middle, |(step, _)| step)
}

/// Least-squares step per frame with its variance, by Gauss-Newton on the step with the
/// harmonics eliminated.
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
        // A step of more than a spectral line would follow another maximum.
        let line = PI / range.len() as f64;
        let change = (sums[0] / sums[1]).clamp(-line, line);
        let reach = 1.2 * SEARCH * commanded;
        step = (step + change).clamp(commanded - reach, commanded + reach);
        if change.abs() < TOLERANCE * commanded {
            break;
        }
    }
    let [_, curvature, squares, neighbours, freedom] = sums.into();
    // Neighbouring residuals are alike where the servo, not the noise, makes them: as many
    // independent samples are missing as in a first-order process of that correlation.
    let correlation = (neighbours / squares.max(f64::MIN_POSITIVE)).clamp(0.0, 0.98);
    let inflation = (1.0 + correlation) / (1.0 - correlation);
    let variance = squares / freedom.max(1.0) * inflation / curvature;
    Some((step, variance))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn measure(
        phi: impl Fn(f64) -> [f64; 2],
        seconds: f64,
        omega: f64,
    ) -> Result<GaitPhase, String> {
        let frames = (seconds * 120.0) as usize;
        let at = |joint: usize| (0..frames).map(|i| phi(i as f64 / 120.0)[joint]).collect();
        let gait = Gait::symmetric();
        let command =
            CommandedGait { gait: &gait, omega_rad_s: omega, rate_hz: 120.0, skip_cycles: 2 };
        command
            .estimate_phase(&[at(0), at(1)])
            .map_err(|error| error.of(Path::new("a.csv")).to_string())
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
        let (begin, end) = (4.0, 20.0);
        let driven = measure(|t| gait_at(3.9 * (t.clamp(begin, end) - begin)), 27.0, 3.9).unwrap();
        assert!((driven.moving.start as f64 / 120.0 - begin).abs() < 0.1);
        assert!((driven.moving.end as f64 / 120.0 - end).abs() < 0.1);
        assert!((driven.omega_rad_s - 3.9).abs() < 2e-3);
    }

    #[test]
    fn joints_that_hands_turn_before_and_after_a_rest_are_no_gait() {
        // The robot is put down, waits, moves, waits as long as it moved, and is taken away.
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
        // A pause of the gait is none of that.
        let clock = |t: f64| if (12.0..15.0).contains(&t) { 12.0 } else { t };
        let paused = measure(|t| gait_at(3.9 * clock(t)), 27.0, 3.9).unwrap();
        assert_eq!(paused.moving, 0..27 * 120);
    }

    #[test]
    fn a_trial_that_does_not_move_or_is_too_short_says_so() {
        let still = measure(|_| [0.1, 0.2], 20.0, 3.9).unwrap_err();
        assert_eq!(still, "a.csv: found 0.00 periods of motion, needed at least 2");
        let short = measure(|t| gait_at(3.9 * t), 1.2, 3.9).unwrap_err();
        assert_eq!(short, "a.csv: found 0.74 periods of motion, needed at least 2");
        let slow = measure(|t| [gait_at(0.3 * t)[0], gait_at(0.3 * t)[1]], 60.0, 5.0).unwrap_err();
        assert!(slow.starts_with("a.csv: found joint 1 moving by only "), "{slow}");
        let fast = measure(|t| gait_at(50.0 * t), 10.0, 50.0).unwrap_err();
        assert!(fast.starts_with("a.csv: found 15.1 frames per commanded period"), "{fast}");
    }
}
