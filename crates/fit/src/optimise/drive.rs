//! Drives: the periodic commands that move a robot.

use trilink_mechanics::Problem;
use trilink_robot::{
    AnyRobot, ChainNumber, CommandNumber, FreeJoint, Joint, JointCommand, JointNumber, Rotor,
};
use trilink_tables::GaitNumbers;

use super::commands::Command;

/// Periodic command that moves a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drive {
    /// Angle of a driven joint, or commanded angle of an elastic one, with the index of the joint.
    Angle(usize),
    /// Commanded torque, with the index of the joint.
    Torque(usize),
    /// Angle of a rotor, with the index of its link from front to rear.
    Rotor(usize),
}

impl Drive {
    /// Returns the drives of a problem that move the robot: the driven joints, the elastic joints whose commanded angle
    /// varies and the torques that are not zero, from front to rear, then the rotors whose angle varies.
    pub fn all(problem: &Problem) -> Vec<Self> {
        let mut drives = Vec::new();
        for joint in 0..problem.robot.joints() {
            let joint_of_chain = problem.robot.as_chain().map(|chain| &chain.joints[joint]);
            match joint_of_chain {
                Some(Joint::Free(FreeJoint { target, torque, .. })) => {
                    if target.half_range_rad() > 0.0 {
                        drives.push(Self::Angle(joint));
                    }
                    if torque.amplitude_nm != 0.0 || torque.mean_nm != 0.0 {
                        drives.push(Self::Torque(joint));
                    }
                }
                _ if problem.gait.joints[joint].is_some() => drives.push(Self::Angle(joint)),
                _ => {}
            }
        }
        let links = problem.robot.as_chain().map_or(&[][..], |chain| &chain.links).iter();
        let moves = |rotor: Rotor| rotor.angle.half_range_rad() > 0.0;
        let rotors = links.enumerate().filter(|(_, link)| link.rotor.is_some_and(moves));
        drives.extend(rotors.map(|(link, _)| Self::Rotor(link)));
        drives
    }

    fn number(self, of_angle: CommandNumber, of_torque: JointNumber) -> ChainNumber {
        match self {
            Self::Angle(joint) => ChainNumber::Command(joint, of_angle),
            Self::Torque(joint) => ChainNumber::Joint(joint, of_torque),
            Self::Rotor(link) => ChainNumber::Rotor(link, of_angle),
        }
    }

    /// Returns the amplitude of the angle or torque.
    pub fn amplitude(self) -> Command {
        Command::Number(self.number(CommandNumber::Amplitude, JointNumber::TorqueAmplitude))
    }

    /// Returns the offset or mean; `None` for a rotor, whose offset has no effect on the motion.
    pub(super) fn offset(self) -> Option<Command> {
        let number = self.number(CommandNumber::Offset, JointNumber::TorqueMean);
        (!matches!(self, Self::Rotor(_))).then_some(Command::Number(number))
    }

    pub(super) fn phase(self) -> Command {
        Command::Number(self.number(CommandNumber::Phase, JointNumber::TorquePhase))
    }

    /// Returns the in-phase and quadrature components of the second harmonic; none for a torque.
    pub(super) fn second_harmonic(self) -> Option<[Command; 2]> {
        use CommandNumber::{SecondInPhase, SecondQuadrature};
        let component = |number| self.number(number, JointNumber::TorqueMean);
        let both = [SecondInPhase, SecondQuadrature].map(component).map(Command::Number);
        (!matches!(self, Self::Torque(_))).then_some(both)
    }

    /// Returns the commands of the drive, with second harmonics.
    pub fn commands(self) -> impl Iterator<Item = Command> {
        let first = [Some(self.amplitude()), self.offset(), Some(self.phase())];
        first.into_iter().flatten().chain(self.second_harmonic().into_iter().flatten())
    }

    /// Returns the command of the angle; `None` for a torque.
    pub fn angle(self, problem: &Problem) -> Option<&JointCommand> {
        match self {
            Self::Angle(joint) => problem.command(joint),
            Self::Torque(_) => None,
            Self::Rotor(link) => {
                problem.robot.as_chain()?.links[link].rotor.as_ref().map(|rotor| &rotor.angle)
            }
        }
    }

    /// Returns access to the command of the angle; `None` for a torque.
    pub(super) fn angle_mut(self, problem: &mut Problem) -> Option<&mut JointCommand> {
        match self {
            Self::Angle(joint) => problem.command_mut(joint),
            Self::Torque(_) => None,
            Self::Rotor(link) => match &mut problem.robot {
                AnyRobot::ThreeLinks(_) => None,
                AnyRobot::Chain(chain) => {
                    chain.links[link].rotor.as_mut().map(|rotor| &mut rotor.angle)
                }
            },
        }
    }

    /// Returns the name of the part that the drive moves, for messages.
    pub(super) fn part(self, robot: &AnyRobot) -> String {
        match self {
            Self::Angle(joint) | Self::Torque(joint) => format!("joint {}", joint + 1),
            Self::Rotor(link) => format!("the rotor of link {}", name_of(link, robot)),
        }
    }

    /// Returns the name of a kind of number of the drive, such as `amplitude2` or `rotor.front.amplitude`.
    pub fn name(self, kind: &str, robot: &AnyRobot) -> String {
        match self {
            Self::Angle(joint) | Self::Torque(joint) => format!("{kind}{}", joint + 1),
            Self::Rotor(link) => format!("rotor.{}.{kind}", name_of(link, robot)),
        }
    }

    /// Returns the key of the command in a gait of the configuration.
    pub fn key(self, robot: &AnyRobot) -> String {
        match self {
            Self::Angle(joint) | Self::Torque(joint) => format!("joint{}", joint + 1),
            Self::Rotor(link) => {
                format!("rotor.{}", toml::Value::from(name_of(link, robot)))
            }
        }
    }

    /// Returns the keys and values of the command in the configuration.
    pub fn configured(self, problem: &Problem) -> Vec<(&'static str, f64)> {
        let Some(command) = self.angle(problem) else {
            let commands = self.commands();
            return ["torque_nm", "mean_nm", "phase_deg"]
                .into_iter()
                .zip(commands.map(|command| command.unit().shown().1 * command.value(problem)))
                .collect();
        };
        let numbers = command.to_array().map(f64::to_degrees);
        let mut keys: Vec<(&str, f64)> =
            ["offset_deg", "amplitude_deg", "phase_deg"].into_iter().zip(numbers).collect();
        if let Some(second) = command.second {
            keys.push(("amplitude2_deg", second.amplitude_rad().to_degrees()));
            keys.push(("phase2_deg", second.phase_rad().to_degrees()));
        }
        keys
    }

    /// Stores the numbers of the drive in `numbers`, those of second harmonics only if the command has them.
    pub(super) fn fill(self, problem: &Problem, numbers: &mut GaitNumbers) {
        for command in self.commands() {
            if let Some(number) = command.number_mut(numbers, &problem.robot) {
                *number = command.value(problem);
            }
        }
        let second = self.angle(problem).and_then(|angle| angle.second);
        if let Some((second, numbers)) = second.zip(self.second_mut(numbers, &problem.robot)) {
            [*numbers[0], *numbers[1]] = [second.amplitude_rad(), second.phase_rad()];
        }
    }

    /// Returns the entries in `numbers` for the amplitude and the phase of the second harmonic; `None` for a torque.
    pub(super) fn second_mut<'n>(
        self,
        numbers: &'n mut GaitNumbers,
        robot: &AnyRobot,
    ) -> Option<[&'n mut f64; 2]> {
        match self {
            Self::Angle(joint) => {
                Some([numbers.amplitude2_rad.get_mut(joint)?, numbers.phase2_rad.get_mut(joint)?])
            }
            Self::Torque(_) => None,
            Self::Rotor(link) => {
                let link = number_of(link, robot)?;
                Some([
                    numbers.rotor_amplitude2_rad.get_mut(link)?,
                    numbers.rotor_phase2_rad.get_mut(link)?,
                ])
            }
        }
    }
}

/// Returns the name of a link, given its index from front to rear.
fn name_of(link: usize, robot: &AnyRobot) -> &str {
    robot.as_chain().map_or("", |chain| &chain.links[link].name)
}

/// Returns the number of a link in table columns, given its index from front to rear.
pub(super) fn number_of(link: usize, robot: &AnyRobot) -> Option<usize> {
    robot.as_chain()?.numbering().into_iter().position(|one| one == link)
}
