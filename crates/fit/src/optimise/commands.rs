//! The numbers of a gait that may vary.

use std::f64::consts::PI;
use std::fmt;

use trilink_mechanics::Problem;
use trilink_robot::Gait;
use trilink_tables::config::did_you_mean;
use trilink_tables::{GaitNumbers, Objective};

/// The numbers of a joint's command, as they are named.
const NUMBERS: [&str; 5] = ["offset", "amplitude", "phase", "second_in_phase", "second_quadrature"];
const OFFSET: usize = 0;
const AMPLITUDE: usize = 1;
const PHASE: usize = 2;
const IN_PHASE: usize = 3;
const QUADRATURE: usize = 4;

/// Most numbers of a gait: the frequency and five of each joint.
pub(super) const MOST_COMMANDS: usize = 11;

/// A number of the gait that may vary.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// The frequency, rad/s.
    Omega,
    /// Offset, amplitude or phase (0, 1, 2) of a joint (0 or 1), or a part of its second harmonic, in
    /// phase or in quadrature (3, 4), rad.
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
    /// All that a motion depends on: of two phases it is their difference, of one nothing.
    pub fn all(gait: &Gait) -> Vec<Self> {
        let commanded = |joint: &usize| gait.joints[*joint].is_some();
        let of_all =
            |number: usize| (0..2).filter(commanded).map(move |joint| Self::Joint(joint, number));
        let phase = gait.passive_joint().is_none().then_some(Self::Joint(1, PHASE));
        [Self::Omega]
            .into_iter()
            .chain(of_all(AMPLITUDE))
            .chain(of_all(OFFSET))
            .chain(phase)
            .collect()
    }

    /// The parts of the second harmonics of the commanded joints that satisfy a condition.
    pub fn seconds(gait: &Gait, of: impl Fn(usize) -> bool) -> Vec<Self> {
        let joints = (0..2).filter(|joint| gait.joints[*joint].is_some() && of(*joint));
        joints.flat_map(Self::parts_of_second).collect()
    }

    /// The parts of the second harmonic of a joint, in phase and in quadrature.
    pub(super) fn parts_of_second(joint: usize) -> [Self; 2] {
        [IN_PHASE, QUADRATURE].map(|part| Self::Joint(joint, part))
    }

    /// Whether it is a part of a second harmonic.
    pub fn is_second(self) -> bool {
        matches!(self, Self::Joint(_, IN_PHASE | QUADRATURE))
    }

    /// These commands with the second harmonics of the joints of which one is among them.
    pub fn with_seconds(mut free: Vec<Self>, gait: &Gait) -> Vec<Self> {
        let is_free =
            |joint: usize| free.iter().any(|of| matches!(of, Self::Joint(own, _) if *own == joint));
        let mut seconds = Self::seconds(gait, is_free);
        seconds.retain(|of| !free.contains(of));
        free.extend(seconds);
        free
    }

    /// The commands with these names, of a gait: `omega`, `amplitude1`, or `amplitudes` for those of all commanded
    /// joints.
    ///
    /// # Errors
    /// Nothing has this name, or the motion does not depend on it.
    pub fn parse(names: &[String], gait: &Gait) -> Result<Vec<Self>, String> {
        let mut all = Self::all(gait);
        all.extend(Self::seconds(gait, |_| true));
        let mut free: Vec<Self> = Vec::new();
        for name in names.iter().flat_map(|names| names.split(',')).map(str::trim) {
            let written = name;
            // As `simulate --sensitivities` has them, too: both numbers of a second harmonic are one.
            let name = name.trim_end_matches("_deg").trim_end_matches("_rad_s");
            let of_second = |joint: usize| {
                ["second", "second_amplitude", "second_phase"]
                    .map(|of| format!("{of}{}", joint + 1))
            };
            let of_group = |command: &&Self| match command {
                Self::Omega => false,
                Self::Joint(joint, IN_PHASE | QUADRATURE) => {
                    name == "seconds" || of_second(*joint).iter().any(|of| of == name)
                }
                Self::Joint(_, number) => name == format!("{}s", NUMBERS[*number]),
            };
            let named: Vec<Self> =
                all.iter().filter(|of| of.to_string() == name || of_group(of)).copied().collect();
            if named.is_empty() {
                return Err(unknown(written, gait, &Self::all(gait)));
            }
            free.extend(named);
        }
        free.sort_by_key(|of| all.iter().position(|one| one == of));
        free.dedup();
        Ok(free)
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

    /// The number of a gait's that it is; `None` of a part of a second harmonic.
    pub(super) fn number_mut(self, of: &mut GaitNumbers) -> Option<&mut f64> {
        Some(match self {
            Self::Omega => &mut of.omega_rad_s,
            Self::Joint(joint, OFFSET) => &mut of.offset_rad[joint],
            Self::Joint(joint, AMPLITUDE) => &mut of.amplitude_rad[joint],
            Self::Joint(joint, PHASE) => &mut of.phase_rad[joint],
            Self::Joint(..) => return None,
        })
    }

    /// Where it may be; angles are limited in sum, so that an offset alone may be as large as they.
    pub(super) fn range(self, bounds: &Bounds) -> [f64; 2] {
        match self {
            Self::Omega => bounds.omega_rad_s,
            Self::Joint(_, AMPLITUDE) => bounds.amplitude_rad,
            // A turn to each side of where searches begin.
            Self::Joint(_, PHASE) => [-3.0 * PI, 3.0 * PI],
            Self::Joint(_, IN_PHASE | QUADRATURE) => {
                [-bounds.amplitude_rad[1], bounds.amplitude_rad[1]]
            }
            Self::Joint(..) => [-bounds.angle_rad, bounds.angle_rad],
        }
    }

    /// Whether a value and the same a whole turn later are one.
    pub(super) fn is_phase(self) -> bool {
        matches!(self, Self::Joint(_, PHASE))
    }

    pub(super) fn is_offset(self) -> bool {
        matches!(self, Self::Joint(_, OFFSET))
    }

    /// Whether the mirror image of a gait has the opposite.
    pub(super) fn is_odd(self) -> bool {
        self.is_offset() || self.is_second()
    }
}

fn unknown(name: &str, gait: &Gait, all: &[Command]) -> String {
    let known: Vec<String> = all.iter().map(Command::to_string).collect();
    let why = match name.trim_end_matches("_deg") {
        "phase1" | "phase2" | "phases" if gait.passive_joint().is_some() => {
            "; the phase of the only commanded joint changes nothing".to_owned()
        }
        "phase1" => "; only the difference of both phases matters".to_owned(),
        _ => did_you_mean(name, known.iter().map(String::as_str)),
    };
    format!(
        "--free: found `{name}`, needed `{}`, `amplitudes`, `offsets` or `seconds`{why}",
        known.join("`, `")
    )
}

/// What gaits are searched, and what their motions may take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    pub omega_rad_s: [f64; 2],
    pub amplitude_rad: [f64; 2],
    /// Most of |offset| + amplitude of every commanded joint, or with a second harmonic of its angle.
    pub angle_rad: f64,
    /// Most of amplitude times omega of every commanded joint, or with a second harmonic of its rate.
    pub rate_rad_s: f64,
    /// Most of the actuators' mean power, W.
    pub power_w: Option<f64>,
    /// Most of every actuator's torque, N m.
    pub torque_nm: Option<f64>,
    /// Another objective, and a value than which it must not be worse.
    pub least: Option<(Objective, f64)>,
}

impl fmt::Display for Bounds {
    fn fmt(&self, to: &mut fmt::Formatter) -> fmt::Result {
        let Self { omega_rad_s: [slowest, fastest], amplitude_rad, .. } = self;
        let [least, most] = amplitude_rad.map(degrees);
        let [angle, rate] = [self.angle_rad, self.rate_rad_s].map(degrees);
        write!(
            to,
            "omega {slowest} to {fastest} rad/s, amplitudes {least} to {most} degrees, angles to {angle} degrees, \
             rates to {rate} degrees/s"
        )?;
        if let Some(power_w) = self.power_w {
            write!(to, ", mean power to {power_w} W")?;
        }
        if let Some(torque_nm) = self.torque_nm {
            write!(to, ", torques to {torque_nm} N m")?;
        }
        match self.least {
            Some((objective, value)) => {
                let side = if objective.is_minimised() { "at most" } else { "at least" };
                write!(to, ", {objective} {side} {value} {}", objective.unit())
            }
            None => Ok(()),
        }
    }
}

/// As it was written in degrees.
pub(super) fn degrees(rad: f64) -> f64 {
    (1e6 * rad.to_degrees()).round() / 1e6
}
