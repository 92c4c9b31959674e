//! Kind and frequency of a recording, determined from the joint angles alone.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use trilink_ingest::{CommandedGait, GAIT_HARMONICS, Harmonics, strongest_line};
use trilink_robot::JointCommand;
use trilink_statistics::{mean, seen, wrap};
use trilink_tables::trial::TrialKind;

use super::motion::Motion;

/// Minimum range of the angle of a joint that counts as moving, degrees.
const MIN_RANGE_DEG: f64 = 4.0;
/// Minimum distance from start to end for a robot that counts as moving, m.
const MIN_DISTANCE_M: f64 = 0.15;
/// Maximum duration of the part of a recording that is used to estimate the frequency, s.
const MAX_SEARCHED_S: f64 = 120.0;
/// Minimum number of gait periods in the part of a recording that is used to estimate the frequency.
const MIN_PERIODS: f64 = 2.0;
/// Minimum number of frames per gait period.
const MIN_FRAMES: f64 = 20.0;
/// Stride between the frames that are used to estimate the frequency, which leaves at least five per period.
const STRIDE: usize = 4;
/// Maximum share of the joint angles' variance that a gait and its harmonics leave unexplained.
const MAX_UNEXPLAINED: f64 = 0.1;
/// Minimum ratio of a gait's amplitude in the last third of the motion to that in the first third.
const MIN_AMPLITUDE_RATIO: f64 = 0.6;

/// Motion of a joint, `offset + amplitude cos(phase of the gait + phase)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Swing {
    pub offset_rad: f64,
    pub amplitude_rad: f64,
    pub phase_rad: f64,
}

impl Swing {
    /// Returns the motion with the opposite sign, as seen from the other end of the robot.
    pub(super) fn reversed(self) -> Self {
        Self { offset_rad: -self.offset_rad, phase_rad: wrap(self.phase_rad + PI), ..self }
    }
}

/// Kind of a recording.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Recorded {
    /// Gait, with the motions of the joint angles; their offsets are relative to link frames that the file's markers
    /// define.
    Gait {
        omega_rad_s: f64,
        swings: Vec<Swing>,
    },
    /// Release of a joint, by index.
    Release {
        joint: usize,
    },
    CoastDown,
}

impl Recorded {
    /// Returns the kind of trial.
    pub(super) fn kind(&self) -> TrialKind {
        match self {
            Self::Gait { .. } => TrialKind::Gait,
            Self::Release { .. } => TrialKind::JointRelease,
            Self::CoastDown => TrialKind::CoastDown,
        }
    }

    /// Classifies a motion; returns a message if it is of no known kind.
    pub(super) fn classify(motion: &Motion) -> Result<Self, String> {
        let ranges_deg = motion.ranges_deg();
        let max_deg = ranges_deg.iter().copied().fold(f64::NAN, f64::max);
        if !max_deg.is_finite() {
            let joints = if ranges_deg.len() == 2 { "both joints" } else { "the joints" };
            return Err(format!("the file does not show {joints}"));
        }
        let distance_m = motion.distance_m;
        if max_deg < MIN_RANGE_DEG {
            if distance_m > MIN_DISTANCE_M {
                return Ok(Self::CoastDown);
            }
            return Err(format!(
                "no joint turns by more than {max_deg:.1} degrees, and the robot stands still"
            ));
        }
        let still = ranges_deg.iter().filter(|range_deg| **range_deg < MIN_RANGE_DEG).count();
        match gait(motion, &ranges_deg) {
            Some(gait) => Ok(gait),
            None if distance_m < MIN_DISTANCE_M && still + 1 == ranges_deg.len() => {
                let joint = ranges_deg.iter().position(|range_deg| *range_deg == max_deg);
                Ok(Self::Release { joint: joint.unwrap_or(0) })
            }
            None => Err("the joints turn, but not periodically".to_owned()),
        }
    }
}

/// Returns the gait if the joints move periodically and without a decay in amplitude.
fn gait(motion: &Motion, ranges_deg: &[f64]) -> Option<Recorded> {
    let Motion { rate_hz, phi_rad, .. } = motion;
    let step = fundamental(phi_rad, *rate_hz)?;
    // Placeholders: only the frequency and the set of joints that move are used.
    let is_moving = |range_deg: &f64| *range_deg >= MIN_RANGE_DEG;
    let placeholder = JointCommand::new(0.0, 1e-6, 0.0);
    let joints: Vec<Option<JointCommand>> =
        ranges_deg.iter().map(|range_deg| is_moving(range_deg).then_some(placeholder)).collect();
    let command = CommandedGait {
        joints: &joints,
        omega_rad_s: step * rate_hz,
        rate_hz: *rate_hz,
        skip_cycles: 0,
    };
    let found = command.estimate_phase(phi_rad).ok()?;
    let fit = |joint: usize, range: Range<usize>| {
        Harmonics::fit(&phi_rad[joint], range, &found.phase, GAIT_HARMONICS)
    };
    let whole: Vec<Harmonics> =
        (0..phi_rad.len()).map(|joint| fit(joint, found.moving.clone())).collect::<Option<_>>()?;
    let third = found.moving.len() / 3;
    let parts = [
        found.moving.start..found.moving.start + third,
        found.moving.end - third..found.moving.end,
    ];
    for (joint, whole) in whole.iter().enumerate().filter(|(i, _)| is_moving(&ranges_deg[*i])) {
        let fitted = whole.over(found.moving.clone(), &found.phase);
        let phi = &phi_rad[joint][found.moving.clone()];
        let middle = mean(seen(phi));
        let squares = |deviation: &dyn Fn(f64, f64) -> f64| -> f64 {
            let pairs = phi.iter().zip(&fitted).filter(|(phi, _)| !phi.is_nan());
            pairs.map(|(phi, fitted)| deviation(*phi, *fitted).powi(2)).sum()
        };
        let residual = squares(&|phi, fitted| phi - fitted);
        let total = squares(&|phi, _| phi - middle);
        let [early, late] =
            parts.clone().map(|part| fit(joint, part).map_or(f64::NAN, |part| part.amplitude(1)));
        if residual > MAX_UNEXPLAINED * total || late < MIN_AMPLITUDE_RATIO * early {
            return None;
        }
    }
    let swings = whole.iter().map(|fit| Swing {
        offset_rad: fit.offset(),
        amplitude_rad: fit.amplitude(1),
        phase_rad: wrap(fit.phase_rad()),
    });
    Some(Recorded::Gait { omega_rad_s: found.omega_rad_s, swings: swings.collect() })
}

/// Estimates the frequency at which the joints have the largest amplitude, rad per frame; `None` if the recording is
/// too short or no spectral line is found.
fn fundamental(phi_rad: &[Vec<f64>], rate_hz: f64) -> Option<f64> {
    let all = phi_rad[0].len();
    let searched = all.min((MAX_SEARCHED_S * rate_hz) as usize);
    let start = (all - searched) / 2;
    // Subtract the means, because gaps would turn the offsets into spectral lines.
    let series = phi_rad.iter().map(|phi| {
        let phi = &phi[start..start + searched];
        let middle = mean(seen(phi));
        phi.iter().step_by(STRIDE).map(|phi| phi - middle).collect::<Vec<f64>>()
    });
    let series: Vec<Vec<f64>> = series.collect();
    let frames = series[0].len();
    let stride = STRIDE as f64;
    let lowest = MIN_PERIODS * TAU / frames as f64;
    let highest = TAU / MIN_FRAMES * stride;
    if lowest >= highest {
        return None;
    }
    let middle = 0.5 * (lowest + highest);
    let reach = 0.5 * (highest - lowest);
    let series = series.iter().map(Vec::as_slice);
    let step = strongest_line(series, &(0..frames), middle, reach);
    // A maximum at an end of the range is not a spectral line.
    (step > lowest - 0.25 * PI / frames as f64 && step < highest).then_some(step / stride)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(seconds: f64, distance_m: f64, phi: impl Fn(f64) -> [f64; 2]) -> Motion {
        let angles = |joint: usize| {
            (0..(60.0 * seconds) as usize).map(|i| phi(i as f64 / 60.0)[joint]).collect::<Vec<_>>()
        };
        Motion {
            rate_hz: 60.0,
            phi_rad: vec![angles(0), angles(1)],
            shapes: Vec::new(),
            distance_m,
            course_rad: 0.0,
            middle: 1,
            heading_rad: 0.0,
            ahead_m: distance_m,
        }
    }

    #[test]
    fn a_gait_s_frequency_amplitudes_offsets_and_phases_are_those_of_the_joints() {
        for omega in [0.6, 2.0, 3.9, 9.0] {
            let phi = |t: f64| {
                [0.7 + 0.5 * (omega * t + 1.0).cos(), -0.2 + 0.4 * (omega * t - 0.3).cos()]
            };
            let found = Recorded::classify(&motion(40.0, 2.0, phi)).unwrap();
            let Recorded::Gait { omega_rad_s, swings } = found else { panic!("{found:?}") };
            let [front, rear] = swings[..] else { panic!("two joints") };
            assert!((omega_rad_s / omega - 1.0).abs() < 1e-6, "{omega_rad_s} for {omega}");
            assert!((front.offset_rad - 0.7).abs() < 1e-6 && (rear.offset_rad + 0.2).abs() < 1e-6);
            assert!((front.amplitude_rad - 0.5).abs() < 1e-6);
            assert!((wrap(rear.phase_rad - front.phase_rad) + 1.3).abs() < 1e-5);
        }
    }

    #[test]
    fn a_decaying_joint_is_a_release_and_a_moving_robot_with_held_joints_a_coast_down() {
        let swings = |t: f64| [0.02 * 1e-2 * t.cos(), 0.6 * (-1.5 * t).exp() * (9.0 * t).cos()];
        let found = Recorded::classify(&motion(5.0, 0.01, swings));
        assert_eq!(found, Ok(Recorded::Release { joint: 1 }));
        let held = |t: f64| [0.003 * t.sin(), 0.001];
        assert_eq!(Recorded::classify(&motion(5.0, 1.2, held)), Ok(Recorded::CoastDown));
        let stands = Recorded::classify(&motion(5.0, 0.01, held)).unwrap_err();
        assert!(stands.contains("the robot stands"), "{stands}");
        let bends = |t: f64| [0.2 * t, 0.1 * t * t];
        let bends = Recorded::classify(&motion(5.0, 1.0, bends)).unwrap_err();
        assert!(bends.contains("not periodically"), "{bends}");
    }
}
