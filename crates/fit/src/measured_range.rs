//! What the trials of a fit cover: a motion beyond them is an extrapolation.

use std::f64::consts::TAU;
use std::fmt;

use trilink_mechanics::Problem;
use trilink_robot::Gait;
use trilink_statistics::extremes;
use trilink_tables::Extrapolation;

use super::measurement::{Measurement, SAME_FREQUENCY};

/// Tolerance of a joint's angles, relative to its amplitude: servos follow their commands no
/// better. Of phases, in rad.
const ANGLE_TOLERANCE: f64 = 0.05;

/// What is compared: the names that `optimise --free` has for them.
const NAMES: [&str; 8] =
    ["omega", "amplitude1", "amplitude2", "offset1", "offset2", "second1", "second2", "phase2"];
const OMEGA: usize = 0;
const AMPLITUDE: usize = 1;
const OFFSET: usize = 3;
const SECOND: usize = 5;
const PHASE: usize = 7;

/// A value of each; NaN if a gait has none.
type Numbers = [f64; NAMES.len()];

/// The frequencies and gaits that the trials of a fit cover, each by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredRange {
    ranges: [[f64; 2]; NAMES.len()],
    /// With their tolerances.
    limits: [[f64; 2]; NAMES.len()],
}

/// A number of a motion that no trial has.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Beyond {
    number: usize,
    /// Smallest and largest of all motions.
    values: [f64; 2],
    range: [f64; 2],
}

impl fmt::Display for Beyond {
    fn fmt(&self, to: &mut fmt::Formatter) -> fmt::Result {
        let Self { number, values, range } = *self;
        let (scale, unit) = if number == OMEGA { (1.0, "rad/s") } else { (360.0 / TAU, "degrees") };
        let [low, high] = values.map(|value| rounded(scale * value));
        write!(to, "{} {low}", NAMES[number])?;
        if high != low {
            write!(to, " to {high}")?;
        }
        let [low, high] = range.map(|value| rounded(scale * value));
        match low == high {
            true => write!(to, " {unit} (trials {low})"),
            false => write!(to, " {unit} (trials {low} to {high})"),
        }
    }
}

/// To four digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value) + 0.0
}

impl MeasuredRange {
    /// The range of one campaign's measurements with a commanded gait; `None` without any. What no
    /// trial measured is taken as commanded; second harmonics cover 0 to the command.
    pub fn new(measurements: &[Measurement], command: &Gait) -> Option<Self> {
        let [commanded, none] =
            [command, &Gait { joints: [None; 2] }].map(|of| numbers(of, f64::NAN));
        let measured = |of: &Measurement| {
            let joint = |i: usize| command.joints[i].map(|_| of.gait[i]);
            let mut numbers = numbers(&Gait { joints: [0, 1].map(joint) }, of.omega_rad_s);
            numbers[PHASE] = wrap_near(numbers[PHASE], commanded[PHASE]);
            numbers[SECOND..PHASE].copy_from_slice(&none[SECOND..PHASE]);
            numbers
        };
        let all: Vec<Numbers> = measurements.iter().map(measured).collect();
        let range = |number: usize| match extremes(all.iter().map(|of| of[number])) {
            [low, high] if low <= high => [low, high],
            _ if (SECOND..PHASE).contains(&number) => [0.0, commanded[number]],
            _ => [commanded[number]; 2],
        };
        let ranges: [[f64; 2]; NAMES.len()] = std::array::from_fn(range);
        let limits = |number: usize| {
            let [low, high] = ranges[number];
            let margin_rad = match number {
                OMEGA => return [low * (1.0 - SAME_FREQUENCY), high * (1.0 + SAME_FREQUENCY)],
                PHASE => ANGLE_TOLERANCE,
                of_joint => ANGLE_TOLERANCE * ranges[AMPLITUDE + (of_joint - AMPLITUDE) % 2][1],
            };
            [low - margin_rad, high + margin_rad]
        };
        let limits = std::array::from_fn(limits);
        (!measurements.is_empty()).then_some(Self { ranges, limits })
    }

    /// What of a motion no trial has.
    fn beyond(&self, problem: &Problem) -> Vec<Beyond> {
        let mut own = numbers(&problem.gait, problem.omega_rad_s);
        own[PHASE] = wrap_near(own[PHASE], 0.5 * (self.ranges[PHASE][0] + self.ranges[PHASE][1]));
        let mut mirrored = own;
        mirrored[OFFSET..SECOND].iter_mut().for_each(|offset_rad| *offset_rad *= -1.0);
        // The mirror image of a motion is one as well, unless the spring rests at an angle.
        let has_mirror =
            problem.gait.passive_joint().is_none() || problem.robot.rest_angle_rad == 0.0;
        let of = |numbers: Numbers| -> Vec<Beyond> {
            let all = numbers.into_iter().enumerate().map(|(number, value)| {
                let (range, [low, high]) = (self.ranges[number], self.limits[number]);
                let is_beyond = value < low || value > high;
                is_beyond.then_some(Beyond { number, values: [value; 2], range })
            });
            all.flatten().collect()
        };
        let (found, of_mirror) = (of(own), of(mirrored));
        if has_mirror && of_mirror.len() < found.len() { of_mirror } else { found }
    }

    /// Whether a motion is an extrapolation.
    pub(crate) fn is_exceeded(&self, problem: &Problem) -> bool {
        !self.beyond(problem).is_empty()
    }

    /// Whether a motion is an extrapolation, and in what.
    pub fn extrapolation(&self, problem: &Problem) -> Extrapolation {
        let beyond: Vec<String> = self.beyond(problem).iter().map(Beyond::to_string).collect();
        Extrapolation { extrapolated: Some(!beyond.is_empty()), beyond_trials: beyond.join(", ") }
    }

    /// How many of some motions are extrapolations, and in what; `None` if none is.
    pub fn summary(&self, problems: impl IntoIterator<Item = Problem>) -> Option<(usize, String)> {
        let (mut count, mut all) = (0, [None::<Beyond>; NAMES.len()]);
        for problem in problems {
            let found = self.beyond(&problem);
            count += usize::from(!found.is_empty());
            for of in found {
                let known = all[of.number].get_or_insert(of);
                known.values = extremes(known.values.into_iter().chain(of.values));
            }
        }
        let text: Vec<String> = all.iter().flatten().map(Beyond::to_string).collect();
        (count > 0).then(|| (count, text.join(", ")))
    }
}

/// Those of a motion.
fn numbers(gait: &Gait, omega_rad_s: f64) -> Numbers {
    let mut numbers = [f64::NAN; NAMES.len()];
    numbers[OMEGA] = omega_rad_s;
    for (i, joint) in gait.joints.iter().enumerate() {
        let Some(joint) = joint else { continue };
        numbers[AMPLITUDE + i] = joint.amplitude_rad;
        numbers[OFFSET + i] = joint.offset_rad;
        numbers[SECOND + i] = joint.second().amplitude_rad();
    }
    if let [Some(first), Some(second)] = gait.joints {
        numbers[PHASE] = second.phase_rad - first.phase_rad;
    }
    numbers
}

/// Wraps an angle to within half a turn of another one.
fn wrap_near(angle_rad: f64, other_rad: f64) -> f64 {
    angle_rad - TAU * ((angle_rad - other_rad) / TAU).round()
}

#[cfg(test)]
mod tests {
    use trilink_robot::{JointCommand, Laws, Robot, SecondHarmonic};
    use trilink_tables::config::SigmaKind;
    use trilink_tables::{Columns as _, TrialRow};

    use super::*;

    fn problem(gait: Gait, omega_rad_s: f64) -> Problem {
        Problem { robot: Robot::kinematic(), gait, laws: Laws::SKID_ROLL, omega_rad_s }
    }

    /// Trials of a gait that the servos follow by a part of its amplitudes.
    fn trials(command: &Gait, part: f64) -> MeasuredRange {
        let of = |omega_rad_s: f64| {
            let mut row = TrialRow { omega_rad_s, ..TrialRow::blank() };
            row.metrics.d_m = 0.1;
            for (measured, joint) in row.gait.iter_mut().zip(command.joints) {
                let Some(joint) = joint else { continue };
                measured.offset_rad = joint.offset_rad;
                measured.amplitude_rad = part * joint.amplitude_rad;
                measured.phase_rad = joint.phase_rad - 0.01;
            }
            Measurement::new(&row, SigmaKind::Raw).expect("a distance")
        };
        MeasuredRange::new(&[0.5, 2.8].map(of), command).expect("trials")
    }

    fn changed(gait: Gait, joint: usize, change: impl Fn(&mut JointCommand)) -> Gait {
        let mut changed = gait;
        changed.joints[joint].iter_mut().for_each(change);
        changed
    }

    #[test]
    fn what_no_trial_has_is_named_with_the_range_of_the_trials() {
        let gait = Gait::skewed();
        let range = trials(&gait, 0.98);
        let beyond = |gait: Gait, omega_rad_s: f64| {
            range.extrapolation(&problem(gait, omega_rad_s)).beyond_trials
        };
        for omega_rad_s in [0.5, 1.7, 2.8, 2.801] {
            assert_eq!(beyond(gait, omega_rad_s), "");
        }
        assert_eq!(beyond(gait, 12.0), "omega 12 rad/s (trials 0.5 to 2.8)");
        assert_eq!(beyond(gait, 0.25), "omega 0.25 rad/s (trials 0.5 to 2.8)");
        let wide = changed(gait, 0, |of| of.amplitude_rad *= 1.5);
        assert_eq!(beyond(wide, 2.0), "amplitude1 45 degrees (trials 29.4)");
        let bent = changed(gait, 1, |of| of.offset_rad = 0.0);
        assert_eq!(beyond(bent, 2.0), "offset2 0 degrees (trials -45)");
        let both = changed(wide, 1, |of| of.phase_rad += 1.0);
        assert!(beyond(both, 2.0).contains("degrees (trials 29.4), phase2 -32"), "{both:?}");
        let second = changed(gait, 1, |of| of.second = Some(SecondHarmonic::new(0.2, 1.0)));
        assert_eq!(beyond(second, 2.0), "second2 11.46 degrees (trials 0)");
        // A turn later it is the same, and so is the mirror image.
        let turned = changed(gait, 0, |of| of.phase_rad += TAU);
        let mirror = |gait| changed(gait, 0, |of: &mut JointCommand| of.offset_rad *= -1.0);
        let mirrored = changed(mirror(turned), 1, |of| of.offset_rad *= -1.0);
        assert_eq!(beyond(mirrored, 2.0), "");
        let [slow, fast] = [0.1, 4.0].map(|omega_rad_s| problem(wide, omega_rad_s));
        assert_eq!(
            range.summary([slow, fast, problem(gait, 1.0)]),
            Some((
                2,
                "omega 0.1 to 4 rad/s (trials 0.5 to 2.8), amplitude1 45 degrees (trials 29.4)"
                    .to_owned()
            ))
        );
        assert_eq!(range.summary([problem(gait, 1.0)]), None);
    }

    #[test]
    fn a_gait_that_no_trial_measured_is_taken_as_commanded() {
        let gait = Gait::passive_symmetric();
        let range = trials(&gait, f64::NAN);
        assert!(!range.is_exceeded(&problem(gait, 2.0)));
        let wide = changed(gait, 1, |of| of.amplitude_rad *= 1.2);
        assert!(range.is_exceeded(&problem(wide, 2.0)));
        assert_eq!(MeasuredRange::new(&[], &gait), None);
    }
}
