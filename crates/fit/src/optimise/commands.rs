//! Commands: frequency and gait parameters that an optimisation varies, and their bounds.

use std::f64::consts::PI;

use trilink_mechanics::Problem;
use trilink_robot::{AnyRobot, ChainNumber, CommandNumber, JointNumber};
use trilink_tables::config::did_you_mean;
use trilink_tables::{GaitNumbers, Objective};

use super::drive::{Drive, number_of};

/// Frequency or gait parameter that can be free in an optimisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// Frequency, rad/s.
    Omega,
    /// Number of a [`Drive`], rad or N m. Those of the driven joints of a robot of three links are named like those of a
    /// chain.
    Number(ChainNumber),
}

/// Unit of a [`Command`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CommandUnit {
    RadPerSecond,
    Rad,
    NewtonMetre,
}

impl CommandUnit {
    /// Returns the name of the unit in which values are shown, and the factor that converts values to it.
    pub fn shown(self) -> (&'static str, f64) {
        match self {
            Self::RadPerSecond => ("rad/s", 1.0),
            Self::Rad => ("degrees", 1_f64.to_degrees()),
            Self::NewtonMetre => ("N m", 1.0),
        }
    }
}

impl Command {
    /// Returns all commands that influence the steady-state motion, without second harmonics. Only phase differences
    /// between drives matter: the phase of the first one is never included.
    pub fn all(problem: &Problem) -> Vec<Self> {
        let drives = Drive::all(problem);
        let amplitudes = drives.iter().map(|drive| drive.amplitude());
        let offsets = drives.iter().filter_map(|drive| drive.offset());
        let phases = drives.iter().skip(1).map(|drive| drive.phase());
        [Self::Omega].into_iter().chain(amplitudes).chain(offsets).chain(phases).collect()
    }

    /// Returns whether the command is a component of a second harmonic.
    pub fn is_second(self) -> bool {
        self.is_of(&[CommandNumber::SecondInPhase, CommandNumber::SecondQuadrature])
    }

    /// Returns whether the command is one of the given numbers of an angle.
    fn is_of(self, numbers: &[CommandNumber]) -> bool {
        match self {
            Self::Number(ChainNumber::Command(_, own) | ChainNumber::Rotor(_, own)) => {
                numbers.contains(&own)
            }
            _ => false,
        }
    }

    /// Returns the drive to which the command belongs; `None` for the frequency.
    fn drive(self) -> Option<Drive> {
        match self {
            Self::Number(ChainNumber::Command(joint, _)) => Some(Drive::Angle(joint)),
            Self::Number(ChainNumber::Joint(joint, _)) => Some(Drive::Torque(joint)),
            Self::Number(ChainNumber::Rotor(link, _)) => Some(Drive::Rotor(link)),
            Self::Omega | Self::Number(ChainNumber::Link(..)) => None,
        }
    }

    /// Returns the index of the command in this list: offset, amplitude and phase of the angle that a drive commands,
    /// then the two components of its second harmonic; `None` for any other command.
    pub(super) fn index_in(self, drive: Drive) -> Option<usize> {
        let Self::Number(ChainNumber::Command(_, own) | ChainNumber::Rotor(_, own)) = self else {
            return None;
        };
        let is_own = self.drive() == Some(drive);
        CommandNumber::ALL.into_iter().position(|number| is_own && number == own)
    }

    /// Adds to `free` the components of the second harmonic of every joint and rotor that has a free command.
    pub fn with_second_harmonics(mut free: Vec<Self>, problem: &Problem) -> Vec<Self> {
        let drives = Drive::all(problem).into_iter();
        let drives =
            drives.filter(|drive| free.iter().any(|command| command.drive() == Some(*drive)));
        let mut seconds: Vec<Self> = drives.filter_map(Drive::second_harmonic).flatten().collect();
        seconds.retain(|command| !free.contains(command));
        free.extend(seconds);
        free
    }

    /// Parses names of a problem's commands, such as `omega` or `amplitude1`, or `amplitudes` for the amplitudes of all
    /// commanded joints and rotors.
    ///
    /// # Errors
    /// Returns an error if a name is unknown or the command has no influence on the motion.
    pub fn parse(names: &[String], problem: &Problem) -> Result<Vec<Self>, String> {
        let mut all = Self::all(problem);
        let seconds = Drive::all(problem).into_iter().filter_map(Drive::second_harmonic);
        all.extend(seconds.flatten());
        let mut free: Vec<Self> = Vec::new();
        for name in names.iter().flat_map(|names| names.split(',')).map(str::trim) {
            let named: Vec<Self> = all
                .iter()
                .filter(|command| command.is_named(name, &problem.robot))
                .copied()
                .collect();
            if named.is_empty() {
                return Err(unknown_command(name, &all, problem));
            }
            free.extend(named);
        }
        free.sort_by_key(|command| all.iter().position(|one| one == command));
        free.dedup();
        Ok(free)
    }

    /// Returns the name of the kind of number.
    fn kind(self) -> &'static str {
        match self {
            Self::Omega => "omega",
            Self::Number(ChainNumber::Joint(_, JointNumber::TorqueMean)) => "mean",
            Self::Number(ChainNumber::Joint(_, JointNumber::TorquePhase)) => "phase",
            Self::Number(ChainNumber::Joint(..)) => "torque",
            Self::Number(number) => number.key().trim_end_matches("_deg"),
        }
    }

    /// Returns the name of the command, such as `amplitude1`, `torque2` or `rotor.front.amplitude`.
    pub fn name(self, robot: &AnyRobot) -> String {
        match self.drive() {
            None => self.kind().to_owned(),
            Some(drive) => drive.name(self.kind(), robot),
        }
    }

    /// Returns whether a name denotes the command or a group that contains the command. Names from
    /// `simulate --sensitivities` are accepted, too; the amplitude or the phase of a second harmonic then denotes both
    /// of its components.
    fn is_named(self, name: &str, robot: &AnyRobot) -> bool {
        if let (Self::Number(number), Some(chain)) = (self, robot.as_chain())
            && chain.number_name(number) == name
        {
            return true;
        }
        let units = ["_deg", "_rad_s", "_nm"];
        let name = units.into_iter().fold(name, |name, unit| name.trim_end_matches(unit));
        let own = self.name(robot);
        let kind = self.kind();
        let of = |group: &str| own.replace(kind, group) == name;
        own == name
            || self.group().is_some_and(|group| group == name)
            || self.is_second()
                && ["second", "second_amplitude", "second_phase"].map(of).contains(&true)
    }

    /// Returns the name of the group of commands of the same kind; `None` for the frequency.
    fn group(self) -> Option<String> {
        match self {
            Self::Omega => None,
            Self::Number(_) if self.is_second() => Some("seconds".to_owned()),
            Self::Number(_) => Some(format!("{}s", self.kind())),
        }
    }

    /// Returns the value of the command in a problem, rad/s, rad or N m.
    pub fn value(self, problem: &Problem) -> f64 {
        match self {
            Self::Omega => problem.omega_rad_s,
            Self::Number(number) => problem.number(number).unwrap_or(0.0),
        }
    }

    /// Sets the value of the command in a problem, rad/s, rad or N m.
    pub fn set(self, problem: &mut Problem, value: f64) {
        let Self::Number(number) = self else {
            problem.omega_rad_s = value;
            return;
        };
        if self.is_second()
            && let Some(command) = self.drive().and_then(|drive| drive.angle_mut(problem))
        {
            command.second.get_or_insert_default();
        }
        if let Some(number) = problem.number_mut(number) {
            *number = value;
        }
    }

    /// Returns the entry in `numbers` that corresponds to the command; `None` for a component of a second harmonic.
    pub(super) fn number_mut<'n>(
        self,
        numbers: &'n mut GaitNumbers,
        robot: &AnyRobot,
    ) -> Option<&'n mut f64> {
        use CommandNumber::{Amplitude, Offset, Phase};
        let (of_part, part): (&mut Vec<f64>, usize) = match self {
            Self::Omega => return Some(&mut numbers.omega_rad_s),
            Self::Number(ChainNumber::Command(joint, Offset)) => (&mut numbers.offset_rad, joint),
            Self::Number(ChainNumber::Command(joint, Amplitude)) => {
                (&mut numbers.amplitude_rad, joint)
            }
            Self::Number(ChainNumber::Command(joint, Phase)) => (&mut numbers.phase_rad, joint),
            Self::Number(ChainNumber::Joint(joint, JointNumber::TorqueMean)) => {
                (&mut numbers.torque_mean_nm, joint)
            }
            Self::Number(ChainNumber::Joint(joint, JointNumber::TorqueAmplitude)) => {
                (&mut numbers.torque_amplitude_nm, joint)
            }
            Self::Number(ChainNumber::Joint(joint, JointNumber::TorquePhase)) => {
                (&mut numbers.torque_phase_rad, joint)
            }
            Self::Number(ChainNumber::Rotor(link, Amplitude)) => {
                (&mut numbers.rotor_amplitude_rad, number_of(link, robot)?)
            }
            Self::Number(ChainNumber::Rotor(link, Phase)) => {
                (&mut numbers.rotor_phase_rad, number_of(link, robot)?)
            }
            Self::Number(_) => return None,
        };
        of_part.get_mut(part)
    }

    /// Returns the range of the command. An offset has the full range of the joint angle; the limit on
    /// |offset| + amplitude is applied separately. The range of a torque is empty unless torques are limited.
    pub(super) fn range(self, bounds: &Bounds) -> [f64; 2] {
        use CommandNumber as C;
        let torque_nm = bounds.torque_nm.unwrap_or(0.0);
        let symmetric = |largest: f64| [-largest, largest];
        match self {
            Self::Omega => bounds.omega_rad_s,
            // The turn in which searches start, plus one more on each side.
            _ if self.is_phase() => [-3.0 * PI, 3.0 * PI],
            Self::Number(ChainNumber::Rotor(_, C::Amplitude)) => bounds.rotor_amplitude_rad,
            Self::Number(ChainNumber::Command(_, C::Amplitude)) => bounds.amplitude_rad,
            Self::Number(ChainNumber::Rotor(..)) => symmetric(bounds.rotor_amplitude_rad[1]),
            _ if self.is_second() => symmetric(bounds.amplitude_rad[1]),
            Self::Number(ChainNumber::Joint(_, JointNumber::TorqueAmplitude)) => [0.0, torque_nm],
            Self::Number(ChainNumber::Joint(..)) => symmetric(torque_nm),
            Self::Number(_) => symmetric(bounds.angle_rad),
        }
    }

    /// Returns the unit of the command.
    pub fn unit(self) -> CommandUnit {
        match self {
            Self::Omega => CommandUnit::RadPerSecond,
            Self::Number(number) if number.key().ends_with("_nm") => CommandUnit::NewtonMetre,
            Self::Number(_) => CommandUnit::Rad,
        }
    }

    /// Returns whether the command is a phase, whose values are equivalent modulo a full turn.
    pub fn is_phase(self) -> bool {
        self.is_of(&[CommandNumber::Phase])
            || matches!(self, Self::Number(ChainNumber::Joint(_, JointNumber::TorquePhase)))
    }

    pub(super) fn is_offset(self) -> bool {
        self.is_of(&[CommandNumber::Offset])
            || matches!(self, Self::Number(ChainNumber::Joint(_, JointNumber::TorqueMean)))
    }

    /// Returns whether the command changes sign when the gait is mirrored.
    pub(super) fn is_odd(self) -> bool {
        self.is_offset() || self.is_second()
    }
}

/// Returns the error message for an unknown command name; `all` are the known commands.
fn unknown_command(name: &str, all: &[Command], problem: &Problem) -> String {
    let Problem { robot, .. } = problem;
    let drives = Drive::all(problem);
    let single = all.iter().filter(|command| !command.is_second());
    let mut known: Vec<String> = single.map(|command| command.name(robot)).collect();
    for group in all.iter().filter_map(|command| command.group()) {
        if !known.contains(&group) {
            known.push(group);
        }
    }
    let bare = name.trim_end_matches("_deg");
    let hint = match drives.first() {
        Some(_) if drives.len() == 1 && ["phase1", "phase2", "phases"].contains(&bare) => {
            "; the phase of the only commanded joint has no effect on the motion".to_owned()
        }
        Some(first) if first.phase().name(robot) == bare => match robot {
            AnyRobot::ThreeLinks(_) => {
                "; only the difference between the phases of the two joints matters".to_owned()
            }
            AnyRobot::Chain(_) => {
                format!("; only phases relative to that of {} matter", first.part(robot))
            }
        },
        _ => did_you_mean(name, known.iter().map(String::as_str)),
    };
    format!("--free: found `{name}`, needed one of `{}`{hint}", known.join("`, `"))
}

/// Ranges of the commands to search, and limits on the resulting motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    pub omega_rad_s: [f64; 2],
    pub amplitude_rad: [f64; 2],
    pub rotor_amplitude_rad: [f64; 2],
    /// Maximum absolute angle of every commanded joint, which is |offset| + amplitude without a second harmonic.
    pub angle_rad: f64,
    /// Maximum joint rate of every commanded joint, which is amplitude times omega without a second harmonic.
    pub rate_rad_s: f64,
    /// Maximum mean power of the actuators, W.
    pub power_w: Option<f64>,
    /// Maximum torque of every actuator, N m.
    pub torque_nm: Option<f64>,
    /// Another objective and its worst permitted value.
    pub least: Option<(Objective, f64)>,
}

impl Bounds {
    /// Checks that every free command of a problem has a range.
    ///
    /// # Errors
    /// Returns an error if a torque is free although torques are not limited.
    pub fn check(&self, free: &[Command], problem: &Problem) -> Result<(), String> {
        let torque = free.iter().find(|command| command.unit() == CommandUnit::NewtonMetre);
        match torque {
            Some(torque) if self.torque_nm.is_none() => Err(format!(
                "optimise.torque_nm: found nothing, needed the largest torque of an actuator, because `{}` is free; set \
                 the key or the option --torque-nm",
                torque.name(&problem.robot)
            )),
            _ => Ok(()),
        }
    }

    /// Describes the bounds in words, those of rotors only if the robot has rotors that move.
    pub(super) fn describe(&self, problem: &Problem) -> String {
        let Self { omega_rad_s: [slowest, fastest], amplitude_rad, .. } = self;
        let [low, high] = amplitude_rad.map(degrees);
        let [angle, rate] = [self.angle_rad, self.rate_rad_s].map(degrees);
        let mut words = format!(
            "omega {slowest} to {fastest} rad/s, amplitudes {low} to {high} degrees, angles up to {angle} degrees, \
             rates up to {rate} degrees/s"
        );
        if Drive::all(problem).iter().any(|drive| matches!(drive, Drive::Rotor(_))) {
            let [low, high] = self.rotor_amplitude_rad.map(degrees);
            words += &format!(", amplitudes of rotors {low} to {high} degrees");
        }
        if let Some(power_w) = self.power_w {
            words += &format!(", mean power up to {power_w} W");
        }
        if let Some(torque_nm) = self.torque_nm {
            words += &format!(", torques up to {torque_nm} N m");
        }
        if let Some((objective, value)) = self.least {
            let side = if objective.is_minimised() { "at most" } else { "at least" };
            words += &format!(", {objective} {side} {value} {}", objective.unit());
        }
        words
    }
}

/// Converts an angle to degrees, rounded so that a value entered in degrees is printed unchanged.
pub(super) fn degrees(rad: f64) -> f64 {
    (1e6 * rad.to_degrees()).round() / 1e6
}
