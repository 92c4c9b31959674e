//! Whether the joints do what they are commanded, and if not, which change of the command would
//! make it so.

use std::f64::consts::{PI, TAU};

use nalgebra::{Complex, ComplexField as _};
use trilink_robot::{Gait, JointCommand};
use trilink_statistics::{extremes, mean, median, seen, wrap};

use crate::checks::{Check, Finding};
use crate::error::Problem;
use crate::phase::CommandedGait;

/// How near a changed command must be to what was measured to be the cause, degrees.
const EXPLAINED_DEG: f64 = 5.0;
/// Joints that swing by less do not swing, rad.
const LEAST_SWING_RAD: f64 = 0.02;
/// A frequency this far from the commanded one is another one.
const FREQUENCY_TOLERANCE: f64 = 0.05;
/// How near a ratio of frequencies is to that of two units.
const RATIO_TOLERANCE: f64 = 0.02;

/// A quantity of a command.
#[derive(Clone, Copy, PartialEq)]
enum Quantity {
    Offset,
    Amplitude,
    Phase,
    /// Offset and phase, which tell the sense.
    Sense,
    All,
}

/// A mistake in the command of a joint: what it is about, what undoes it, and the question to
/// ask.
type Mistake = (Quantity, fn(f64) -> f64, &'static str);

const MISTAKES: [Mistake; 8] = [
    (Quantity::Phase, |phase| -phase, "is its sign wrong?"),
    (Quantity::Offset, |offset| -offset, "is its sign wrong?"),
    (Quantity::Sense, |sense| -sense, "does the joint turn the other way?"),
    (Quantity::Amplitude, |amplitude| 0.5 * amplitude, "is it from peak to peak?"),
    (Quantity::Amplitude, f64::to_degrees, "is it in radians?"),
    (Quantity::Phase, f64::to_degrees, "is it in radians?"),
    (Quantity::Offset, f64::to_degrees, "is it in radians?"),
    (Quantity::All, f64::to_degrees, "are they in radians?"),
];

/// A command as it would be without a mistake.
fn mended(command: JointCommand, quantity: Quantity, undo: fn(f64) -> f64) -> JointCommand {
    let JointCommand { offset_rad, amplitude_rad, phase_rad, .. } = command;
    match quantity {
        Quantity::Offset => JointCommand { offset_rad: undo(offset_rad), ..command },
        Quantity::Amplitude => JointCommand { amplitude_rad: undo(amplitude_rad), ..command },
        Quantity::Phase => JointCommand { phase_rad: undo(phase_rad), ..command },
        Quantity::Sense => {
            JointCommand { offset_rad: -offset_rad, phase_rad: wrap(phase_rad + PI), ..command }
        }
        Quantity::All => JointCommand {
            offset_rad: undo(offset_rad),
            amplitude_rad: undo(amplitude_rad),
            phase_rad: undo(phase_rad),
            ..command
        },
    }
}

/// Finds whether the joints did what they were commanded; `measured` is what they did, with
/// phases in any clock. What is found is an error if a cause is known or the joints do something
/// else altogether.
pub(crate) fn check_gait(measured: [JointCommand; 2], gait: &Gait) -> Finding {
    let off_deg = off_deg(measured, gait);
    let causes = if off_deg > Check::Gait.limit() { causes(measured, gait) } else { Vec::new() };
    let message = match &causes[..] {
        _ if off_deg <= Check::Gait.limit() => {
            format!("the joints are up to {off_deg:.1} degrees off the command")
        }
        [] => format!(
            "the joints are up to {off_deg:.1} degrees off the command: {}",
            compared(measured, gait)
        ),
        [(_, cause), others @ ..] => {
            let others = others.iter().map(|(in_short, _)| format!("; or {in_short}"));
            cause.clone() + &others.collect::<String>()
        }
    };
    let finding = Finding::at_most(Check::Gait, off_deg, message);
    if causes.is_empty() { finding } else { finding.failing() }
}

/// Largest difference between what the joints do and a gait, with the clock that brings them
/// nearest; a difference in phase counts by the angle that it makes.
pub(super) fn off_deg(measured: [JointCommand; 2], gait: &Gait) -> f64 {
    let clock_rad = clock_rad(measured, gait, |_| true);
    let off = pairs(measured, gait).flat_map(|(_, measured, command)| {
        let late = wrap(measured.phase_rad - clock_rad - command.phase_rad);
        [
            measured.offset_rad - command.offset_rad,
            measured.amplitude_rad - command.amplitude_rad,
            command.amplitude_rad * late,
        ]
    });
    off.map(f64::abs).fold(0.0, f64::max).to_degrees()
}

/// The joints that have a command, with what they do.
fn pairs(
    measured: [JointCommand; 2],
    gait: &Gait,
) -> impl Iterator<Item = (usize, JointCommand, JointCommand)> {
    let commands = gait.joints.into_iter().enumerate();
    commands.filter_map(move |(joint, command)| Some((joint, measured[joint], command?)))
}

/// By how much the phases of some joints are ahead of their commands, on average.
fn clock_rad(measured: [JointCommand; 2], gait: &Gait, of: impl Fn(usize) -> bool) -> f64 {
    let ahead =
        pairs(measured, gait).filter(|(joint, ..)| of(*joint)).map(|(_, found, command)| {
            Complex::from_polar(command.amplitude_rad, found.phase_rad - command.phase_rad)
        });
    ahead.sum::<Complex<f64>>().argument()
}

/// What each joint does beside what it should.
fn compared(measured: [JointCommand; 2], gait: &Gait) -> String {
    let each = pairs(measured, gait).map(|(joint, found, command)| {
        let phase_rad = found.phase_rad - clock_rad(measured, gait, |other| other != joint);
        let [found, command] = [(found, phase_rad), (command, command.phase_rad)].map(
            |(JointCommand { offset_rad, amplitude_rad, .. }, phase_rad)| {
                let [offset, amplitude, phase] =
                    [offset_rad, amplitude_rad, wrap(phase_rad)].map(f64::to_degrees);
                format!("offset {offset:.1}, amplitude {amplitude:.1}, phase {phase:.1} deg")
            },
        );
        format!("joint {}: measured {found}, configured {command}", joint + 1)
    });
    each.collect::<Vec<_>>().join("; ")
}

/// Every change of the command after which the joints do what it says, in short and in full.
fn causes(measured: [JointCommand; 2], gait: &Gait) -> Vec<(String, String)> {
    let explains = |gait: &Gait| off_deg(measured, gait) <= EXPLAINED_DEG;
    let mut found = Vec::new();
    for changed in [[false, true], [true, false], [true, true]] {
        for (quantity, undo, question) in MISTAKES {
            let mut right = *gait;
            let mut is_changed = true;
            for (command, _) in right.joints.iter_mut().zip(changed).filter(|(_, is)| *is) {
                let other = command.map(|command| mended(command, quantity, undo));
                is_changed &= *command != other;
                *command = other;
            }
            if is_changed && explains(&right) {
                let joints = [0, 1].into_iter().filter(|joint| changed[*joint]);
                let joints: Vec<String> = joints.map(|joint| (joint + 1).to_string()).collect();
                found.push((
                    format!("joint {}: {question}", joints.join(" and ")),
                    in_words(measured, gait, &right, changed, quantity, question),
                ));
            }
        }
    }
    let [first, second] = gait.joints;
    let turned = |command: Option<JointCommand>| {
        command.map(|command| mended(command, Quantity::Sense, |x| x))
    };
    let exchanges = [
        (
            [second, first],
            "joints 1 and 2 are exchanged",
            "each does what the other is commanded; exchange joint1 and joint2 of the gait",
        ),
        (
            [turned(second), turned(first)],
            "front and rear are exchanged",
            "exchange markers.link1 and markers.link2, and the signs of x and y of all markers",
        ),
    ];
    for (joints, what, advice) in exchanges {
        if explains(&Gait { joints }) {
            found.push((what.to_owned(), format!("{what}: {advice}")));
        }
    }
    found
}

/// What is wrong with some joints' commands, and what they should be.
fn in_words(
    measured: [JointCommand; 2],
    gait: &Gait,
    right: &Gait,
    changed: [bool; 2],
    quantity: Quantity,
    question: &str,
) -> String {
    let clock_rad = clock_rad(measured, right, |_| true);
    let (mut joints, mut changes) = (Vec::new(), Vec::new());
    for (joint, found, command) in pairs(measured, gait).filter(|(joint, ..)| changed[*joint]) {
        let phase_rad = wrap(found.phase_rad - clock_rad);
        let all = [
            ("offset", Quantity::Offset, found.offset_rad, command.offset_rad),
            ("amplitude", Quantity::Amplitude, found.amplitude_rad, command.amplitude_rad),
            ("phase", Quantity::Phase, phase_rad, command.phase_rad),
        ];
        let is_meant = |of: Quantity| match quantity {
            Quantity::All => true,
            Quantity::Sense => of != Quantity::Amplitude,
            other => other == of,
        };
        let (mut differ, mut set) = (Vec::new(), Vec::new());
        let mended = right.joints[joint].unwrap_or(command);
        let mended = [mended.offset_rad, mended.amplitude_rad, mended.phase_rad];
        for ((name, _, found, command), right) in
            all.into_iter().zip(mended).filter(|((_, of, ..), _)| is_meant(*of))
        {
            let (found, command) = (found.to_degrees(), command.to_degrees());
            differ.push(format!("measured {name} {found:+.1} deg, configured {}", plain(command)));
            set.push(format!("{name}_deg = {}", plain(right.to_degrees())));
        }
        joints.push(format!("joint {}: {}", joint + 1, differ.join(", ")));
        changes.push(format!("joint{} {}", joint + 1, set.join(", ")));
    }
    format!("{}: {question} set {}", joints.join("; "), changes.join(" and "))
}

/// A number as one would write it into the configuration.
fn plain(value: f64) -> String {
    let rounded = (value * 1e4).round() / 1e4;
    // No negative zero.
    format!("{}", rounded + 0.0)
}

/// Whether the commanded joints swing, and at the commanded frequency.
///
/// # Errors
/// They do not, or at another frequency.
pub(crate) fn check_swing(command: &CommandedGait, phi_rad: &[Vec<f64>; 2]) -> Result<(), Problem> {
    let joints = || phi_rad.iter().zip(command.gait.joints).filter(|(_, joint)| joint.is_some());
    let swing = |phi_rad: &[f64]| {
        let [low, high] = extremes(seen(phi_rad));
        0.5 * (high - low)
    };
    let most_rad = joints().map(|(phi_rad, _)| swing(phi_rad)).fold(0.0, f64::max);
    if most_rad < LEAST_SWING_RAD {
        return Err(Problem::NoSwing { most_deg: most_rad.to_degrees() });
    }
    let Some(step_rad) = joints().find_map(|(phi_rad, _)| frequency(phi_rad)) else {
        return Ok(());
    };
    let at_other = CommandedGait { omega_rad_s: step_rad * command.rate_hz, ..*command };
    let (other, commanded_rad_s) = (at_other.omega_rad_s, command.omega_rad_s);
    if (other / commanded_rad_s - 1.0).abs() <= FREQUENCY_TOLERANCE {
        return Ok(());
    }
    let omega_rad_s = at_other.estimate_phase(phi_rad).map_or(other, |driven| driven.omega_rad_s);
    let ratio = omega_rad_s / commanded_rad_s;
    let is_near = |other: f64| (ratio / other - 1.0).abs() <= RATIO_TOLERANCE;
    let set = format!("set omega_rad_s = {omega_rad_s:.4}");
    let cause = if is_near(TAU) {
        format!("is omega_rad_s in Hz? {set}")
    } else if is_near(TAU / 60.0) {
        format!("is omega_rad_s in revolutions per minute? {set}")
    } else if is_near(PI / 180.0) {
        format!("is omega_rad_s in degrees per second? {set}")
    } else if !(0.1..=10.0).contains(&ratio) {
        format!("is omega_rad_s right? {set}, or the file is another trial's")
    } else {
        format!(
            "if every trial is off by the factor {ratio:.3}, the rate is wrong: set vicon.rate_hz = \
             {:.4} for {}; else {set}, or the file is another trial's",
            command.rate_hz / ratio,
            command.rate_hz
        )
    };
    Err(Problem::OtherFrequency { omega_rad_s, commanded_rad_s, cause })
}

/// Phase per frame of an angle that swings evenly, by the times at which it rises through its
/// middle.
fn frequency(phi_rad: &[f64]) -> Option<f64> {
    const LEAST_PERIODS: usize = 3;
    let [low, high] = extremes(seen(phi_rad));
    if high - low < 2.0 * LEAST_SWING_RAD {
        return None;
    }
    let (middle, swing) = (mean(seen(phi_rad)), 0.25 * (high - low));
    let (mut is_low, mut rises) = (false, Vec::new());
    for (frame, phi) in phi_rad.iter().enumerate() {
        if *phi < middle - 0.5 * swing {
            is_low = true;
        } else if is_low && *phi > middle + 0.5 * swing {
            is_low = false;
            rises.push(frame as f64);
        }
    }
    let periods: Vec<f64> = rises.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if periods.len() < LEAST_PERIODS {
        return None;
    }
    // Some rises may be missing.
    let span = rises[rises.len() - 1] - rises[0];
    Some(TAU * (span / median(periods)).round() / span)
}
