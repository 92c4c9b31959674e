//! Range of frequencies and gaits covered by the fitted trials; predictions outside it are extrapolations.

use std::f64::consts::TAU;
use std::fmt;

use trilink_mechanics::Problem;
use trilink_robot::{AnyGait, AnyRobot, Laws, MAX_JOINTS};
use trilink_statistics::extremes;
use trilink_tables::{Extrapolation, SAME_FREQUENCY};

use super::measurement::Measurement;
use super::optimise::{Command, CommandUnit, Drive};

/// Tolerance by which the measured ranges of gait parameters are widened: for amplitudes and offsets relative to the
/// joint's amplitude, for phases in rad. It is about the accuracy with which servos follow their commands.
const TOLERANCE: f64 = 0.05;

/// Factor by which a search may leave the measured range.
const SEARCH_FACTOR: f64 = 1.2;

// Quantities whose ranges are measured: the frequency, then, for each joint, the amplitude, the offset, the amplitude of
// the second harmonic, and the phase relative to that of the first driven joint.
const OMEGA: usize = 0;
const AMPLITUDE: usize = 1;
const OFFSET: usize = AMPLITUDE + MAX_JOINTS;
const SECOND: usize = OFFSET + MAX_JOINTS;
const PHASE: usize = SECOND + MAX_JOINTS;
const COUNT: usize = PHASE + MAX_JOINTS;

/// Value of each quantity, in rad/s or rad; NaN if a gait does not have that quantity.
type Numbers = [f64; COUNT];

/// Returns the name of a quantity, as in `optimise --free`.
fn name_of(number: usize) -> String {
    let Some(of_joint) = number.checked_sub(AMPLITUDE) else { return "omega".to_owned() };
    let kind = ["amplitude", "offset", "second", "phase"][of_joint / MAX_JOINTS];
    format!("{kind}{}", of_joint % MAX_JOINTS + 1)
}

/// Range of the frequency and of each gait parameter covered by the fitted trials.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredRange {
    ranges: [[f64; 2]; COUNT],
    /// Measured range `[min, max]` of each quantity, widened by that quantity's tolerance.
    limits: [[f64; 2]; COUNT],
    /// Commands that are not measured: those of elastic joints, torques and rotors, which are the same in all trials.
    unmeasured: Vec<Unmeasured>,
}

/// Command that is not measured.
#[derive(Debug, Clone, PartialEq)]
struct Unmeasured {
    command: Command,
    value: f64,
    tolerance: f64,
}

impl Unmeasured {
    /// Returns the unmeasured commands of a robot and a gait.
    fn all(robot: &AnyRobot, gait: &AnyGait) -> Vec<Self> {
        let problem = Problem::new(robot.clone(), *gait, Laws::SKID, 1.0);
        let is_measured = |drive: &Drive| match drive {
            Drive::Angle(joint) => gait.joints[*joint].is_some(),
            Drive::Torque(_) | Drive::Rotor(_) => false,
        };
        let drives = Drive::all(&problem).into_iter().filter(|drive| !is_measured(drive));
        let of_drive = |drive: Drive| {
            let amplitude = drive.amplitude().value(&problem).abs();
            let commands: Vec<Command> = drive.commands().collect();
            let problem = &problem;
            commands.into_iter().map(move |command| Self {
                command,
                value: command.value(problem),
                tolerance: TOLERANCE * if command.is_phase() { 1.0 } else { amplitude },
            })
        };
        drives.flat_map(of_drive).collect()
    }
}

/// Quantity that lies outside the range of the trials.
#[derive(Debug, Clone, PartialEq)]
struct Excess {
    /// Index of the quantity; those of unmeasured commands follow the others.
    number: usize,
    name: String,
    unit: CommandUnit,
    /// Minimum and maximum of the quantity over all motions that were checked against its range.
    values: [f64; 2],
    range: [f64; 2],
}

impl fmt::Display for Excess {
    fn fmt(&self, to: &mut fmt::Formatter) -> fmt::Result {
        let Self { name, values, range, .. } = self;
        let (unit, scale) = match self.unit {
            CommandUnit::Rad => ("degrees", 360.0 / TAU),
            other => other.shown(),
        };
        let [low, high] = values.map(|value| rounded(scale * value));
        write!(to, "{name} {low}")?;
        if high != low {
            write!(to, " to {high}")?;
        }
        let [low, high] = range.map(|value| rounded(scale * value));
        if low == high {
            write!(to, " {unit} (trials cover only {low})")
        } else {
            write!(to, " {unit} (trials cover {low} to {high})")
        }
    }
}

fn widened([low, high]: [f64; 2]) -> [f64; 2] {
    [low / SEARCH_FACTOR, high * SEARCH_FACTOR]
}

/// Rounds a value to four significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value) + 0.0
}

impl MeasuredRange {
    /// Returns the range covered by the measurements of one campaign, whose robot has the gait `command`; `None` if
    /// there are no measurements. Parameters that no trial measured are taken as commanded; second harmonics range from
    /// 0 to the command.
    pub fn new(measurements: &[Measurement], robot: &AnyRobot, command: &AnyGait) -> Option<Self> {
        let [commanded, none] =
            [command, &AnyGait { joints: [None; MAX_JOINTS] }].map(|of| numbers(of, f64::NAN));
        let all: Vec<Numbers> = measurements
            .iter()
            .map(|measurement| {
                let joints =
                    std::array::from_fn(|i| command.joints[i].map(|_| measurement.gait[i]));
                let mut numbers = numbers(&AnyGait { joints }, measurement.omega_rad_s);
                for phase in PHASE..COUNT {
                    numbers[phase] = wrap_near(numbers[phase], commanded[phase]);
                }
                numbers[SECOND..PHASE].copy_from_slice(&none[SECOND..PHASE]);
                numbers
            })
            .collect();
        let ranges: [[f64; 2]; COUNT] =
            std::array::from_fn(|number| match extremes(all.iter().map(|of| of[number])) {
                [low, high] if low <= high => [low, high],
                _ if (SECOND..PHASE).contains(&number) => [0.0, commanded[number]],
                _ => [commanded[number]; 2],
            });
        let limits = std::array::from_fn(|number| {
            let [low, high] = ranges[number];
            let margin_rad = match number {
                OMEGA => return [low * (1.0 - SAME_FREQUENCY), high * (1.0 + SAME_FREQUENCY)],
                PHASE.. => TOLERANCE,
                of_joint => TOLERANCE * ranges[AMPLITUDE + (of_joint - AMPLITUDE) % MAX_JOINTS][1],
            };
            [low - margin_rad, high + margin_rad]
        });
        let unmeasured = Unmeasured::all(robot, command);
        (!measurements.is_empty()).then_some(Self { ranges, limits, unmeasured })
    }

    /// Returns the measured range of the frequency, rad/s, widened by a fifth for a search.
    pub fn searched_omega_rad_s(&self) -> [f64; 2] {
        widened(self.ranges[OMEGA])
    }

    /// Returns the measured range of the amplitudes of all commanded joints, rad, widened by a fifth for a search;
    /// `None` if no joint is commanded.
    pub fn searched_amplitude_rad(&self) -> Option<[f64; 2]> {
        let amplitudes = &self.ranges[AMPLITUDE..OFFSET];
        let range = extremes(amplitudes.iter().flatten().copied());
        (range[0] <= range[1]).then(|| widened(range))
    }

    /// Returns the quantities of a problem's gait and frequency that lie outside the range.
    fn excess(&self, problem: &Problem) -> Vec<Excess> {
        let mut own = numbers(&problem.gait, problem.omega_rad_s);
        for phase in PHASE..COUNT {
            let [low, high] = self.ranges[phase];
            own[phase] = wrap_near(own[phase], 0.5 * (low + high));
        }
        let mut found = self.excess_of(own);
        if problem.robot.has_mirror_images(&problem.gait) {
            let mut mirrored = own;
            mirrored[OFFSET..SECOND].iter_mut().for_each(|offset_rad| *offset_rad *= -1.0);
            let of_mirror = self.excess_of(mirrored);
            if of_mirror.len() < found.len() {
                found = of_mirror;
            }
        }
        for (number, unmeasured) in (COUNT..).zip(&self.unmeasured) {
            let Unmeasured { command, value, tolerance } = unmeasured;
            let mut own = command.value(problem);
            if command.is_phase() {
                own = wrap_near(own, *value);
            }
            if (own - value).abs() > *tolerance {
                found.push(Excess {
                    number,
                    name: command.name(&problem.robot),
                    unit: command.unit(),
                    values: [own; 2],
                    range: [*value; 2],
                });
            }
        }
        found
    }

    fn excess_of(&self, numbers: Numbers) -> Vec<Excess> {
        let numbers = numbers.into_iter().enumerate();
        numbers
            .filter(|(number, value)| {
                let [low, high] = self.limits[*number];
                *value < low || *value > high
            })
            .map(|(number, value)| Excess {
                number,
                name: name_of(number),
                unit: if number == OMEGA { CommandUnit::RadPerSecond } else { CommandUnit::Rad },
                values: [value; 2],
                range: self.ranges[number],
            })
            .collect()
    }

    /// Whether a problem's gait or frequency lies outside the range.
    pub(crate) fn is_exceeded(&self, problem: &Problem) -> bool {
        !self.excess(problem).is_empty()
    }

    /// Returns whether a problem's gait or frequency lies outside the range, and in which quantities.
    pub fn extrapolation(&self, problem: &Problem) -> Extrapolation {
        let excess: Vec<String> = self.excess(problem).iter().map(Excess::to_string).collect();
        Extrapolation { extrapolated: Some(!excess.is_empty()), beyond_trials: excess.join(", ") }
    }

    /// Returns a warning that some of the problems are extrapolations, or that the range is not known (for the given
    /// reason); `None` if there is nothing to warn of.
    pub fn caution(
        range: Result<&Self, &str>,
        problems: impl ExactSizeIterator<Item = Problem>,
    ) -> Option<String> {
        let all = problems.len();
        match range {
            Ok(range) => range.summary(problems).map(|(count, beyond)| {
                format!(
                    "{count} of {all} motions are extrapolated beyond the trials of the fit: {beyond}"
                )
            }),
            Err(why) => Some(format!("the range of the trials of the fit is not known: {why}")),
        }
    }

    /// Returns how many of the problems are extrapolations, and in which quantities; `None` if none is.
    pub fn summary(&self, problems: impl IntoIterator<Item = Problem>) -> Option<(usize, String)> {
        let mut count = 0;
        let mut all = vec![None::<Excess>; COUNT + self.unmeasured.len()];
        for problem in problems {
            let excess = self.excess(&problem);
            count += usize::from(!excess.is_empty());
            for of in excess {
                let values = of.values;
                let merged = all[of.number].get_or_insert(of);
                merged.values = extremes(merged.values.into_iter().chain(values));
            }
        }
        let text: Vec<String> = all.iter().flatten().map(Excess::to_string).collect();
        (count > 0).then(|| (count, text.join(", ")))
    }
}

/// Returns the values of the quantities for a gait and a frequency.
fn numbers(gait: &AnyGait, omega_rad_s: f64) -> Numbers {
    let mut numbers = [f64::NAN; COUNT];
    numbers[OMEGA] = omega_rad_s;
    for (i, joint) in gait.joints.iter().enumerate() {
        let Some(joint) = joint else { continue };
        numbers[AMPLITUDE + i] = joint.amplitude_rad;
        numbers[OFFSET + i] = joint.offset_rad;
        numbers[SECOND + i] = joint.second().amplitude_rad();
    }
    let mut driven = gait.joints.iter().enumerate().filter_map(|(i, joint)| Some((i, (*joint)?)));
    if let Some((_, first)) = driven.next() {
        driven.for_each(|(i, joint)| numbers[PHASE + i] = joint.phase_rad - first.phase_rad);
    }
    numbers
}

/// Wraps an angle to within half a turn of `other_rad`.
fn wrap_near(angle_rad: f64, other_rad: f64) -> f64 {
    angle_rad - TAU * ((angle_rad - other_rad) / TAU).round()
}

#[cfg(test)]
mod tests {
    use trilink_mechanics::Problem;
    use trilink_robot::{Gait, JointCommand, Laws, Robot, SecondHarmonic};
    use trilink_tables::config::SigmaKind;
    use trilink_tables::{Columns as _, TrialRow};

    use super::*;

    fn problem(gait: Gait, omega_rad_s: f64) -> Problem {
        Problem::new(Robot::kinematic(), gait, Laws::SKID_ROLL, omega_rad_s)
    }

    /// Returns the range covered by two trials in which the servos reach the given fraction of the commanded
    /// amplitudes.
    fn trials(command: &Gait, fraction: f64) -> MeasuredRange {
        let measurements = [0.5, 2.8].map(|omega_rad_s| {
            let mut row = TrialRow { omega_rad_s, ..TrialRow::blank() };
            row.metrics.d_m = 0.1;
            for (measured, joint) in row.gait.iter_mut().zip(command.joints) {
                let Some(joint) = joint else { continue };
                measured.offset_rad = joint.offset_rad;
                measured.amplitude_rad = fraction * joint.amplitude_rad;
                measured.phase_rad = joint.phase_rad - 0.01;
            }
            Measurement::new(&row, SigmaKind::Raw).expect("a distance")
        });
        MeasuredRange::new(&measurements, &Robot::kinematic().into(), &(*command).into())
            .expect("trials")
    }

    fn changed(gait: Gait, joint: usize, change: impl Fn(&mut JointCommand)) -> Gait {
        let mut changed = gait;
        changed.joints[joint].iter_mut().for_each(change);
        changed
    }

    #[test]
    fn an_extrapolation_is_named_with_the_range_of_the_trials() {
        let gait = Gait::skewed();
        let range = trials(&gait, 0.98);
        let beyond = |gait: Gait, omega_rad_s: f64| {
            range.extrapolation(&problem(gait, omega_rad_s)).beyond_trials
        };
        for omega_rad_s in [0.5, 1.7, 2.8, 2.801] {
            assert_eq!(beyond(gait, omega_rad_s), "");
        }
        assert_eq!(beyond(gait, 12.0), "omega 12 rad/s (trials cover 0.5 to 2.8)");
        assert_eq!(beyond(gait, 0.25), "omega 0.25 rad/s (trials cover 0.5 to 2.8)");
        let wide = changed(gait, 0, |of| of.amplitude_rad *= 1.5);
        assert_eq!(beyond(wide, 2.0), "amplitude1 45 degrees (trials cover only 29.4)");
        let bent = changed(gait, 1, |of| of.offset_rad = 0.0);
        assert_eq!(beyond(bent, 2.0), "offset2 0 degrees (trials cover only -45)");
        let both = changed(wide, 1, |of| of.phase_rad += 1.0);
        assert!(
            beyond(both, 2.0).contains("degrees (trials cover only 29.4), phase2 -32"),
            "{both:?}"
        );
        let second = changed(gait, 1, |of| of.second = Some(SecondHarmonic::new(0.2, 1.0)));
        assert_eq!(beyond(second, 2.0), "second2 11.46 degrees (trials cover only 0)");
        // A phase shifted by a full turn is equivalent, and so is the mirror image.
        let turned = changed(gait, 0, |of| of.phase_rad += TAU);
        let mirror = |gait| changed(gait, 0, |of: &mut JointCommand| of.offset_rad *= -1.0);
        let mirrored = changed(mirror(turned), 1, |of| of.offset_rad *= -1.0);
        assert_eq!(beyond(mirrored, 2.0), "");
        let [slow, fast] = [0.1, 4.0].map(|omega_rad_s| problem(wide, omega_rad_s));
        assert_eq!(
            range.summary([slow, fast, problem(gait, 1.0)]),
            Some((
                2,
                "omega 0.1 to 4 rad/s (trials cover 0.5 to 2.8), amplitude1 45 degrees (trials cover only 29.4)"
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
        assert_eq!(MeasuredRange::new(&[], &Robot::kinematic().into(), &gait.into()), None);
    }
}
