//! Quantities that influence the metrics.

use trilink_mechanics::Problem;
use trilink_robot::{
    AnyRobot, ChainNumber, Gait, JointCommand, Parameter, Quantity as RobotQuantity, SecondHarmonic,
};

/// Robot parameter, gait parameter, number of a chain, or the frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Quantity {
    Robot(Parameter),
    Number(ChainNumber),
    /// Gait parameter: the joint (0 or 1), and the index of the parameter in [`JOINT_NUMBERS`].
    Gait(usize, usize),
    Omega,
}

/// Names of the parameters of a joint's command.
const JOINT_NUMBERS: [&str; 5] =
    ["offset", "amplitude", "phase", "second_amplitude", "second_phase"];
/// Number of parameters of a joint's command without second harmonic.
pub(super) const FIRST_HARMONIC_NUMBERS: usize = 3;

impl Quantity {
    /// Returns the quantity that a coefficient stands for: of a chain, the only number that it comprises.
    pub(super) fn of(coefficient: Parameter, robot: &AnyRobot) -> Self {
        let numbers = robot.as_chain().map(|chain| chain.numbers_of(coefficient));
        match numbers.as_deref() {
            Some([number]) => Self::Number(*number),
            _ => Self::Robot(coefficient),
        }
    }

    /// Returns all quantities that can influence the metrics, except sums of other quantities: of a chain, its numbers.
    pub(super) fn all(problem: &Problem) -> Vec<Self> {
        let robot = match &problem.robot {
            AnyRobot::ThreeLinks(robot) => robot,
            AnyRobot::Chain(chain) => {
                return chain.numbers().into_iter().map(Self::Number).collect();
            }
        };
        let gait = Gait::from(problem.gait);
        let mut all: Vec<Self> = RobotQuantity::ALL
            .into_iter()
            .flat_map(|quantity| quantity.parameters_of(robot))
            .filter(|parameter| problem.laws.is_relevant(*parameter, &gait))
            .map(Self::Robot)
            .collect();
        for (joint, command) in gait.joints.iter().enumerate() {
            let Some(command) = command else { continue };
            let has_second = command.second.is_some();
            let count = if has_second { JOINT_NUMBERS.len() } else { FIRST_HARMONIC_NUMBERS };
            all.extend((0..count).map(|number| Self::Gait(joint, number)));
        }
        all.push(Self::Omega);
        all
    }

    /// Returns the name with the unit, as in the option `--set`.
    pub(super) fn name(self, robot: &AnyRobot) -> String {
        match self {
            Self::Number(number) => {
                robot.as_chain().map_or(String::new(), |chain| chain.number_name(number))
            }
            Self::Robot(parameter) => parameter.name().to_owned(),
            Self::Gait(joint, number) => format!("{}{}_deg", JOINT_NUMBERS[number], joint + 1),
            Self::Omega => "omega_rad_s".to_owned(),
        }
    }

    /// Returns the factor that converts SI units to the unit in the name (angles to degrees).
    pub(super) fn scale(self) -> f64 {
        match self {
            Self::Robot(parameter) => 1.0 / parameter.quantity().definition().unit.in_si(),
            Self::Number(number) => 1.0 / number.in_si(),
            Self::Gait(..) => 1_f64.to_degrees(),
            Self::Omega => 1.0,
        }
    }

    /// Returns the value of the quantity in a problem, in SI units.
    pub(super) fn value(self, problem: &Problem) -> f64 {
        match self {
            Self::Robot(parameter) => problem.robot.value(parameter),
            Self::Number(number) => problem.number(number).unwrap_or(f64::NAN),
            Self::Gait(joint, number) => problem.gait.joints[joint]
                .as_ref()
                .map_or(f64::NAN, |command| command_number(command, number)),
            Self::Omega => problem.omega_rad_s,
        }
    }

    /// Sets the value of the quantity in a problem, in SI units.
    pub(super) fn set(self, problem: &mut Problem, value: f64) {
        match self {
            Self::Robot(parameter) => problem.robot.set(parameter, value),
            Self::Number(number) => {
                if let Some(number) = problem.number_mut(number) {
                    *number = value;
                }
            }
            Self::Gait(joint, number) => {
                if let Some(command) = &mut problem.gait.joints[joint] {
                    match number {
                        0..FIRST_HARMONIC_NUMBERS => *command.numbers_mut()[number] = value,
                        FIRST_HARMONIC_NUMBERS => {
                            let phase_rad = command.second().phase_rad();
                            command.second = Some(SecondHarmonic::new(value, phase_rad));
                        }
                        _ => {
                            let amplitude_rad = command.second().amplitude_rad();
                            command.second = Some(SecondHarmonic::new(amplitude_rad, value));
                        }
                    }
                }
            }
            Self::Omega => problem.omega_rad_s = value,
        }
    }
}

fn command_number(command: &JointCommand, number: usize) -> f64 {
    match number {
        0..FIRST_HARMONIC_NUMBERS => command.to_array()[number],
        FIRST_HARMONIC_NUMBERS => command.second().amplitude_rad(),
        _ => command.second().phase_rad(),
    }
}
