//! Commands: frequency and gait parameters that an optimisation varies, and their bounds.

use std::f64::consts::PI;
use std::fmt;

use trilink_mechanics::Problem;
use trilink_robot::Gait;
use trilink_tables::config::did_you_mean;
use trilink_tables::{GaitNumbers, Objective};

/// Names of the parameters of a joint's command.
const NUMBERS: [&str; 5] = ["offset", "amplitude", "phase", "second_in_phase", "second_quadrature"];
const OFFSET: usize = 0;
const AMPLITUDE: usize = 1;
const PHASE: usize = 2;
const IN_PHASE: usize = 3;
const QUADRATURE: usize = 4;

/// Maximum number of commands of a gait: the frequency and five parameters per joint.
pub(super) const MAX_COMMANDS: usize = 11;

/// Frequency or gait parameter that can be free in an optimisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// Frequency, rad/s.
    Omega,
    /// Parameter of a joint's command, rad. The first index is the joint (0 or 1); the second one selects offset,
    /// amplitude or phase (0, 1, 2), or the in-phase or quadrature component of the second harmonic (3, 4).
    Joint(usize, usize),
}

impl fmt::Display for Command {
    fn fmt(&self, to: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Omega => to.write_str("omega"),
            Self::Joint(joint, number) => write!(to, "{}{}", NUMBERS[*number], joint + 1),
        }
    }
}

impl Command {
    /// Returns all commands that influence the steady-state motion, without second harmonics. Only the phase difference
    /// between two commanded joints matters: phase 1 is never included, and phase 2 only if both joints are commanded.
    pub fn all(gait: &Gait) -> Vec<Self> {
        let commanded = (0..2).filter(|joint| gait.joints[*joint].is_some());
        let amplitudes = commanded.clone().map(|joint| Self::Joint(joint, AMPLITUDE));
        let offsets = commanded.map(|joint| Self::Joint(joint, OFFSET));
        let phase = gait.passive_joint().is_none().then_some(Self::Joint(1, PHASE));
        [Self::Omega].into_iter().chain(amplitudes).chain(offsets).chain(phase).collect()
    }

    /// Returns the second-harmonic components of those commanded joints for which `is_wanted` returns true.
    fn second_harmonics(gait: &Gait, is_wanted: impl Fn(usize) -> bool) -> Vec<Self> {
        let joints = (0..2).filter(|joint| gait.joints[*joint].is_some() && is_wanted(*joint));
        joints.flat_map(Self::second_harmonic_of).collect()
    }

    /// Returns the in-phase and quadrature components of a joint's second harmonic.
    pub(super) fn second_harmonic_of(joint: usize) -> [Self; 2] {
        [IN_PHASE, QUADRATURE].map(|component| Self::Joint(joint, component))
    }

    /// Returns whether the command is a component of a second harmonic.
    pub fn is_second(self) -> bool {
        matches!(self, Self::Joint(_, IN_PHASE | QUADRATURE))
    }

    /// Adds to `free` the components of the second harmonic of every joint that has a free command.
    pub fn with_second_harmonics(mut free: Vec<Self>, gait: &Gait) -> Vec<Self> {
        let mut seconds = Self::second_harmonics(gait, |joint| {
            free.iter().any(|command| matches!(command, Self::Joint(own, _) if *own == joint))
        });
        seconds.retain(|command| !free.contains(command));
        free.extend(seconds);
        free
    }

    /// Parses names of a gait's commands, such as `omega` or `amplitude1`, or `amplitudes` for the amplitudes of all
    /// commanded joints.
    ///
    /// # Errors
    /// Returns an error if a name is unknown or the command has no influence on the motion.
    pub fn parse(names: &[String], gait: &Gait) -> Result<Vec<Self>, String> {
        let mut all = Self::all(gait);
        all.extend(Self::second_harmonics(gait, |_| true));
        let mut free: Vec<Self> = Vec::new();
        for name in names.iter().flat_map(|names| names.split(',')).map(str::trim) {
            let named: Vec<Self> =
                all.iter().filter(|command| command.is_named(name)).copied().collect();
            if named.is_empty() {
                return Err(unknown_command(name, gait, &Self::all(gait)));
            }
            free.extend(named);
        }
        free.sort_by_key(|command| all.iter().position(|one| one == command));
        free.dedup();
        Ok(free)
    }

    /// Returns whether a name denotes the command or a group that contains the command. Names from
    /// `simulate --sensitivities` are accepted, too; the amplitude or the phase of a second harmonic then denotes both
    /// of its components.
    fn is_named(self, name: &str) -> bool {
        let name = name.trim_end_matches("_deg").trim_end_matches("_rad_s");
        self.to_string() == name
            || match self {
                Self::Omega => false,
                Self::Joint(joint, IN_PHASE | QUADRATURE) => {
                    name == "seconds"
                        || ["second", "second_amplitude", "second_phase"]
                            .iter()
                            .any(|group| format!("{group}{}", joint + 1) == name)
                }
                Self::Joint(_, number) => name == format!("{}s", NUMBERS[number]),
            }
    }

    pub(super) fn value(self, problem: &Problem) -> f64 {
        match self {
            Self::Omega => problem.omega_rad_s,
            Self::Joint(joint, number) => {
                problem.gait.joints[joint].map_or(0.0, |of| match number {
                    IN_PHASE => of.second().in_phase_rad,
                    QUADRATURE => of.second().quadrature_rad,
                    _ => of.to_array()[number],
                })
            }
        }
    }

    pub(super) fn set(self, problem: &mut Problem, value: f64) {
        match self {
            Self::Omega => problem.omega_rad_s = value,
            Self::Joint(joint, number) => {
                if let Some(command) = &mut problem.gait.joints[joint] {
                    match number {
                        IN_PHASE => command.second.get_or_insert_default().in_phase_rad = value,
                        QUADRATURE => command.second.get_or_insert_default().quadrature_rad = value,
                        _ => *command.numbers_mut()[number] = value,
                    }
                }
            }
        }
    }

    /// Returns the entry in `numbers` that corresponds to the command; `None` for a component of a second harmonic.
    pub(super) fn number_mut(self, numbers: &mut GaitNumbers) -> Option<&mut f64> {
        Some(match self {
            Self::Omega => &mut numbers.omega_rad_s,
            Self::Joint(joint, OFFSET) => &mut numbers.offset_rad[joint],
            Self::Joint(joint, AMPLITUDE) => &mut numbers.amplitude_rad[joint],
            Self::Joint(joint, PHASE) => &mut numbers.phase_rad[joint],
            Self::Joint(..) => return None,
        })
    }

    /// Returns the range of the command. An offset has the full range of the joint angle; the limit on
    /// |offset| + amplitude is applied separately.
    pub(super) fn range(self, bounds: &Bounds) -> [f64; 2] {
        match self {
            Self::Omega => bounds.omega_rad_s,
            Self::Joint(_, AMPLITUDE) => bounds.amplitude_rad,
            // The turn in which searches start, plus one more on each side.
            Self::Joint(_, PHASE) => [-3.0 * PI, 3.0 * PI],
            Self::Joint(_, IN_PHASE | QUADRATURE) => {
                [-bounds.amplitude_rad[1], bounds.amplitude_rad[1]]
            }
            Self::Joint(..) => [-bounds.angle_rad, bounds.angle_rad],
        }
    }

    /// Returns whether the command is a phase, whose values are equivalent modulo a full turn.
    pub(super) fn is_phase(self) -> bool {
        matches!(self, Self::Joint(_, PHASE))
    }

    pub(super) fn is_offset(self) -> bool {
        matches!(self, Self::Joint(_, OFFSET))
    }

    /// Returns whether the command changes sign when the gait is mirrored.
    pub(super) fn is_odd(self) -> bool {
        self.is_offset() || self.is_second()
    }
}

/// Returns the error message for an unknown command name.
fn unknown_command(name: &str, gait: &Gait, all: &[Command]) -> String {
    let known: Vec<String> = all.iter().map(Command::to_string).collect();
    let hint = match name.trim_end_matches("_deg") {
        "phase1" | "phase2" | "phases" if gait.passive_joint().is_some() => {
            "; the phase of the only commanded joint has no effect on the motion".to_owned()
        }
        "phase1" => "; only the difference between the phases of the two joints matters".to_owned(),
        _ => did_you_mean(name, known.iter().map(String::as_str)),
    };
    format!(
        "--free: found `{name}`, needed `{}`, `amplitudes`, `offsets` or `seconds` (the second harmonics){hint}",
        known.join("`, `")
    )
}

/// Ranges of the commands to search, and limits on the resulting motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    pub omega_rad_s: [f64; 2],
    pub amplitude_rad: [f64; 2],
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

impl fmt::Display for Bounds {
    fn fmt(&self, to: &mut fmt::Formatter) -> fmt::Result {
        let Self { omega_rad_s: [slowest, fastest], amplitude_rad, .. } = self;
        let [low, high] = amplitude_rad.map(degrees);
        let [angle, rate] = [self.angle_rad, self.rate_rad_s].map(degrees);
        write!(
            to,
            "omega {slowest} to {fastest} rad/s, amplitudes {low} to {high} degrees, angles up to {angle} degrees, \
             rates up to {rate} degrees/s"
        )?;
        if let Some(power_w) = self.power_w {
            write!(to, ", mean power up to {power_w} W")?;
        }
        if let Some(torque_nm) = self.torque_nm {
            write!(to, ", torques up to {torque_nm} N m")?;
        }
        if let Some((objective, value)) = self.least {
            let side = if objective.is_minimised() { "at most" } else { "at least" };
            write!(to, ", {objective} {side} {value} {}", objective.unit())?;
        }
        Ok(())
    }
}

/// Converts an angle to degrees, rounded so that a value entered in degrees is printed unchanged.
pub(super) fn degrees(rad: f64) -> f64 {
    (1e6 * rad.to_degrees()).round() / 1e6
}
