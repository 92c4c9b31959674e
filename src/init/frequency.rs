//! What a file is a recording of, and its frequency: from the joints' angles alone.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use trilink_ingest::{CommandedGait, GAIT_HARMONICS, Harmonics, strongest_line};
use trilink_robot::{Gait, JointCommand};
use trilink_statistics::{mean, seen, wrap};
use trilink_tables::trial::TrialKind;

use super::motion::Motion;

/// Joints that turn by less are held, degrees.
const HELD_DEG: f64 = 4.0;
/// Robots that get less far stand, m.
const STANDS_M: f64 = 0.15;
/// The part of the recording in which a frequency is looked for first, s.
const LOOKED_AT_S: f64 = 120.0;
/// Periods that it has at least, and frames of a period.
const LEAST_PERIODS: f64 = 2.0;
const LEAST_FRAMES: f64 = 20.0;
/// Frames of which one is looked at for the frequency: five a period are enough.
const STRIDE: usize = 4;
/// What a gait and its harmonics leave of the joints' variance at most.
const LEFT: f64 = 0.1;
/// A gait's amplitude in the last third of the motion is not below this part of that in the first.
const LEAST_KEPT: f64 = 0.6;

/// `offset + amplitude cos(phase of the gait + phase)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Swing {
    pub offset_rad: f64,
    pub amplitude_rad: f64,
    pub phase_rad: f64,
}

impl Swing {
    /// Seen from the other end of the robot.
    pub(super) fn reversed(self) -> Self {
        Self { offset_rad: -self.offset_rad, phase_rad: wrap(self.phase_rad + PI), ..self }
    }
}

/// What was recorded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Recorded {
    /// Of phi1 and phi2; their offsets have the constants of the motion's frames.
    Gait {
        omega_rad_s: f64,
        swings: [Swing; 2],
    },
    /// Of joint 1 or 2, by index.
    Release {
        joint: usize,
    },
    CoastDown,
}

impl Recorded {
    pub(super) fn kind(&self) -> TrialKind {
        match self {
            Self::Gait { .. } => TrialKind::Gait,
            Self::Release { .. } => TrialKind::JointRelease,
            Self::CoastDown => TrialKind::CoastDown,
        }
    }

    /// What a motion is, or what it is not. Link 1 is the front link.
    pub(super) fn of(motion: &Motion) -> Result<Self, String> {
        let ranges_deg = motion.ranges_deg();
        let most_deg = ranges_deg[0].max(ranges_deg[1]);
        if !most_deg.is_finite() {
            return Err("does not show both joints".to_owned());
        }
        let way_m = motion.way_m;
        if most_deg < HELD_DEG {
            return match way_m > STANDS_M {
                true => Ok(Self::CoastDown),
                false => Err(format!(
                    "no joint turns by more than {most_deg:.1} degrees, and the robot stands"
                )),
            };
        }
        let found = gait(motion, ranges_deg);
        let joint = usize::from(ranges_deg[1] > ranges_deg[0]);
        match found {
            Some(gait) => Ok(gait),
            None if way_m < STANDS_M && ranges_deg[1 - joint] < HELD_DEG => {
                Ok(Self::Release { joint })
            }
            None => Err("the joints turn, but not periodically".to_owned()),
        }
    }
}

/// The gait, if the joints move periodically and do not come to rest by and by.
fn gait(motion: &Motion, ranges_deg: [f64; 2]) -> Option<Recorded> {
    let Motion { rate_hz, turns_rad: [front, rear], .. } = motion;
    // Link 1 is turned by theta - phi1, link 2 by theta + phi2.
    let phi_rad = [front.iter().map(|turn| -turn).collect(), rear.clone()];
    let step = fundamental(&phi_rad, *rate_hz)?;
    // Any gait of this frequency: what the joints do is measured, not compared.
    let joint = |range_deg: f64| {
        let any = JointCommand::new(0.0, 1e-6, 0.0);
        (range_deg >= HELD_DEG).then_some(any)
    };
    let any = Gait { joints: ranges_deg.map(joint) };
    let command = CommandedGait {
        gait: &any,
        omega_rad_s: step * rate_hz,
        rate_hz: *rate_hz,
        skip_cycles: 0,
    };
    let found = command.estimate_phase(&phi_rad).ok()?;
    let fit = |joint: usize, range: Range<usize>| {
        Harmonics::fit(&phi_rad[joint], range, &found.phase, GAIT_HARMONICS)
    };
    let whole = [fit(0, found.moving.clone())?, fit(1, found.moving.clone())?];
    let third = found.moving.len() / 3;
    let parts = [
        found.moving.start..found.moving.start + third,
        found.moving.end - third..found.moving.end,
    ];
    for (joint, whole) in whole.iter().enumerate().filter(|(i, _)| ranges_deg[*i] >= HELD_DEG) {
        let fitted = whole.over(found.moving.clone(), &found.phase);
        let phi = &phi_rad[joint][found.moving.clone()];
        let middle = mean(seen(phi));
        let squares = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            let pairs = phi.iter().zip(&fitted).filter(|(phi, _)| !phi.is_nan());
            pairs.map(|(phi, fitted)| of(*phi, *fitted).powi(2)).sum()
        };
        let (left, all) = (squares(&|phi, fitted| phi - fitted), squares(&|phi, _| phi - middle));
        let [early, late] =
            parts.clone().map(|part| fit(joint, part).map_or(f64::NAN, |part| part.amplitude(1)));
        if left > LEFT * all || late < LEAST_KEPT * early {
            return None;
        }
    }
    let swing = |fit: &Harmonics| Swing {
        offset_rad: fit.offset(),
        amplitude_rad: fit.amplitude(1),
        phase_rad: wrap(fit.phase_rad()),
    };
    let swings = whole.each_ref().map(swing);
    Some(Recorded::Gait { omega_rad_s: found.omega_rad_s, swings })
}

/// The frequency at which the joints swing most, as a step per frame, rad.
fn fundamental(phi_rad: &[Vec<f64>; 2], rate_hz: f64) -> Option<f64> {
    let all = phi_rad[0].len();
    let looked_at = all.min((LOOKED_AT_S * rate_hz) as usize);
    let start = (all - looked_at) / 2;
    // About their means, so that gaps do not make lines of the offsets.
    let series = phi_rad.each_ref().map(|phi| {
        let phi = &phi[start..start + looked_at];
        let middle = mean(seen(phi));
        phi.iter().step_by(STRIDE).map(|phi| phi - middle).collect::<Vec<f64>>()
    });
    let (frames, stride) = (series[0].len(), STRIDE as f64);
    let (lowest, highest) = (LEAST_PERIODS * TAU / frames as f64, TAU / LEAST_FRAMES * stride);
    if lowest >= highest {
        return None;
    }
    let (middle, reach) = (0.5 * (lowest + highest), 0.5 * (highest - lowest));
    let series = series.iter().map(Vec::as_slice);
    let step = strongest_line(series, &(0..frames), middle, reach);
    // At the very ends nothing is a line.
    (step > lowest - 0.25 * PI / frames as f64 && step < highest).then_some(step / stride)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(seconds: f64, way_m: f64, phi: impl Fn(f64) -> [f64; 2]) -> Motion {
        let angles = |joint: usize| {
            (0..(60.0 * seconds) as usize).map(|i| phi(i as f64 / 60.0)[joint]).collect::<Vec<_>>()
        };
        Motion {
            rate_hz: 60.0,
            turns_rad: [angles(0).iter().map(|phi| -phi).collect(), angles(1)],
            shapes: Default::default(),
            way_m,
            course_rad: 0.0,
            heading_rad: 0.0,
            ahead_m: way_m,
        }
    }

    #[test]
    fn a_gait_s_frequency_amplitudes_offsets_and_phases_are_those_of_the_joints() {
        for omega in [0.6, 2.0, 3.9, 9.0] {
            let phi = |t: f64| {
                [0.7 + 0.5 * (omega * t + 1.0).cos(), -0.2 + 0.4 * (omega * t - 0.3).cos()]
            };
            let found = Recorded::of(&motion(40.0, 2.0, phi)).unwrap();
            let Recorded::Gait { omega_rad_s, swings: [front, rear] } = found else {
                panic!("{found:?}")
            };
            assert!((omega_rad_s / omega - 1.0).abs() < 1e-6, "{omega_rad_s} for {omega}");
            assert!((front.offset_rad - 0.7).abs() < 1e-6 && (rear.offset_rad + 0.2).abs() < 1e-6);
            assert!((front.amplitude_rad - 0.5).abs() < 1e-6);
            assert!((wrap(rear.phase_rad - front.phase_rad) + 1.3).abs() < 1e-5);
        }
    }

    #[test]
    fn what_decays_is_a_release_what_is_held_and_moves_a_coast_down() {
        let swings = |t: f64| [0.02 * 1e-2 * t.cos(), 0.6 * (-1.5 * t).exp() * (9.0 * t).cos()];
        let found = Recorded::of(&motion(5.0, 0.01, swings));
        assert_eq!(found, Ok(Recorded::Release { joint: 1 }));
        let held = |t: f64| [0.003 * t.sin(), 0.001];
        assert_eq!(Recorded::of(&motion(5.0, 1.2, held)), Ok(Recorded::CoastDown));
        let stands = Recorded::of(&motion(5.0, 0.01, held)).unwrap_err();
        assert!(stands.contains("the robot stands"), "{stands}");
        let bends = |t: f64| [0.2 * t, 0.1 * t * t];
        let bends = Recorded::of(&motion(5.0, 1.0, bends)).unwrap_err();
        assert!(bends.contains("not periodically"), "{bends}");
    }
}
