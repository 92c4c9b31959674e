//! The numbers that a motion depends on.

use trilink_mechanics::Problem;
use trilink_robot::{JointCommand, Parameter, Quantity as OfRobot, SecondHarmonic};

/// A number of the robot, of the gait, or the frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Quantity {
    Robot(Parameter),
    /// Of a commanded joint (0 or 1): offset, amplitude, phase, those of its second harmonic.
    Gait(usize, usize),
    Omega,
}

/// The numbers of a joint's command.
const JOINT_NUMBERS: [&str; 5] =
    ["offset", "amplitude", "phase", "second_amplitude", "second_phase"];
/// Those of the mean and of the first harmonic.
pub(super) const OF_FIRST: usize = 3;

impl Quantity {
    /// All that a motion can depend on, sums of others aside.
    pub(super) fn all(problem: &Problem) -> Vec<Self> {
        let of_robot = OfRobot::ALL.into_iter().flat_map(OfRobot::parameters);
        let known = |of: &Parameter| !of.is_sum() && problem.laws.know(*of, &problem.gait);
        let mut all: Vec<Self> = of_robot.filter(known).map(Self::Robot).collect();
        for (joint, command) in problem.gait.joints.iter().enumerate() {
            let Some(command) = command else { continue };
            let has_second = command.second.is_some();
            let count = if has_second { JOINT_NUMBERS.len() } else { OF_FIRST };
            all.extend((0..count).map(|number| Self::Gait(joint, number)));
        }
        all.push(Self::Omega);
        all
    }

    /// Its name, with its unit, as `--set` has it.
    pub(super) fn name(self) -> String {
        match self {
            Self::Robot(parameter) => parameter.name().to_owned(),
            Self::Gait(joint, number) => format!("{}{}_deg", JOINT_NUMBERS[number], joint + 1),
            Self::Omega => "omega_rad_s".to_owned(),
        }
    }

    /// How many of its unit one of the problem's is: angles are degrees.
    pub(super) fn scale(self) -> f64 {
        match self {
            Self::Robot(of) => 1.0 / of.quantity().definition().unit.in_si(),
            Self::Gait(..) => 1_f64.to_degrees(),
            Self::Omega => 1.0,
        }
    }

    /// Its value in a problem, in SI units.
    pub(super) fn of(self, problem: &Problem) -> f64 {
        match self {
            Self::Robot(parameter) => parameter.of(&problem.robot),
            Self::Gait(joint, number) => {
                problem.gait.joints[joint].as_ref().map_or(f64::NAN, |of| number_of(of, number))
            }
            Self::Omega => problem.omega_rad_s,
        }
    }

    /// Gives it a value in a problem, in SI units.
    pub(super) fn set(self, problem: &mut Problem, value: f64) {
        match self {
            Self::Robot(parameter) => parameter.set(&mut problem.robot, value),
            Self::Gait(joint, number) => {
                if let Some(of) = &mut problem.gait.joints[joint] {
                    match number {
                        0..OF_FIRST => *of.numbers_mut()[number] = value,
                        OF_FIRST => {
                            let phase_rad = of.second().phase_rad();
                            of.second = Some(SecondHarmonic::new(value, phase_rad));
                        }
                        _ => {
                            let amplitude_rad = of.second().amplitude_rad();
                            of.second = Some(SecondHarmonic::new(amplitude_rad, value));
                        }
                    }
                }
            }
            Self::Omega => problem.omega_rad_s = value,
        }
    }
}

fn number_of(command: &JointCommand, number: usize) -> f64 {
    match number {
        0..OF_FIRST => command.to_array()[number],
        OF_FIRST => command.second().amplitude_rad(),
        _ => command.second().phase_rad(),
    }
}
