//! The numbers that a motion depends on.

use crate::motion::Problem;
use crate::robot::{JointCommand, Parameter, SecondHarmonic};

/// A number of the robot, of the gait, or the frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Quantity {
    Dimension(Dimension),
    /// Of a link.
    Mass(usize),
    Inertia(usize),
    Coefficient(Parameter),
    RestAngle,
    /// Of a commanded joint (0 or 1): offset, amplitude, phase, those of its second harmonic.
    Gait(usize, usize),
    Omega,
}

/// A length of the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Dimension {
    H,
    L,
    B,
}

/// The numbers of a joint's command.
const JOINT_NUMBERS: [&str; 5] =
    ["offset", "amplitude", "phase", "second_amplitude", "second_phase"];
/// Those of the mean and of the first harmonic.
pub(super) const OF_FIRST: usize = 3;

impl Quantity {
    /// All that a motion can depend on, sums of others aside.
    pub fn all(problem: &Problem) -> Vec<Self> {
        let mut all: Vec<Self> = [Dimension::H, Dimension::L, Dimension::B]
            .map(Self::Dimension)
            .into_iter()
            .chain((0..3).map(Self::Mass))
            .chain((0..3).map(Self::Inertia))
            .collect();
        let known = |of: &Parameter| !of.is_sum() && problem.laws.know(*of, &problem.gait);
        all.extend(Parameter::ALL.into_iter().filter(known).map(Self::Coefficient));
        all.extend(problem.gait.passive_joint().map(|_| Self::RestAngle));
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
    pub fn name(self) -> String {
        match self {
            Self::Dimension(Dimension::H) => "h_m".to_owned(),
            Self::Dimension(Dimension::L) => "l_m".to_owned(),
            Self::Dimension(Dimension::B) => "b_m".to_owned(),
            Self::Mass(link) => format!("mass{link}_kg"),
            Self::Inertia(link) => format!("inertia{link}_kg_m2"),
            Self::Coefficient(parameter) => parameter.name().to_owned(),
            Self::RestAngle => "rest_angle_deg".to_owned(),
            Self::Gait(joint, number) => format!("{}{}_deg", JOINT_NUMBERS[number], joint + 1),
            Self::Omega => "omega_rad_s".to_owned(),
        }
    }

    /// How many of its unit one of the problem's is: angles are degrees.
    pub fn scale(self) -> f64 {
        match self {
            Self::RestAngle | Self::Gait(..) => 1_f64.to_degrees(),
            _ => 1.0,
        }
    }

    /// Its value in a problem, in SI units.
    pub fn of(self, problem: &Problem) -> f64 {
        let robot = &problem.robot;
        match self {
            Self::Dimension(Dimension::H) => robot.h_m,
            Self::Dimension(Dimension::L) => robot.l_m,
            Self::Dimension(Dimension::B) => robot.b_m,
            Self::Mass(link) => robot.mass_kg[link],
            Self::Inertia(link) => robot.inertia_kg_m2[link],
            Self::Coefficient(parameter) => parameter.of(robot),
            Self::RestAngle => robot.rest_angle_rad,
            Self::Gait(joint, number) => {
                problem.gait.joints[joint].as_ref().map_or(f64::NAN, |of| number_of(of, number))
            }
            Self::Omega => problem.omega_rad_s,
        }
    }

    /// Gives it a value in a problem, in SI units.
    pub fn set(self, problem: &mut Problem, value: f64) {
        let robot = &mut problem.robot;
        match self {
            Self::Dimension(Dimension::H) => robot.h_m = value,
            Self::Dimension(Dimension::L) => robot.l_m = value,
            Self::Dimension(Dimension::B) => robot.b_m = value,
            Self::Mass(link) => robot.mass_kg[link] = value,
            Self::Inertia(link) => robot.inertia_kg_m2[link] = value,
            Self::Coefficient(parameter) => parameter.set(robot, value),
            Self::RestAngle => robot.rest_angle_rad = value,
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
