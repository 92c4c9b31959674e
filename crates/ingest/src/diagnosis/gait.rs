//! Checks whether the joints follow their commands and, if not, finds changes to the commands that explain the motion.

use std::f64::consts::{PI, TAU};

use nalgebra::{Complex, ComplexField as _};
use trilink_robot::JointCommand;
use trilink_statistics::{extremes, mean, median, seen, wrap};

use crate::checks::{Check, Finding};
use crate::error::Problem;
use crate::phase::CommandedGait;

/// Maximum deviation of the measured gait from a modified command that explains it, degrees.
const EXPLAINED_DEG: f64 = 5.0;
/// Minimum amplitude of a joint that is considered to move, rad.
const MIN_SWING_RAD: f64 = 0.02;
/// Maximum relative deviation of the measured from the commanded frequency.
const FREQUENCY_TOLERANCE: f64 = 0.05;
/// Amplitude of the second harmonic of a command, relative to that of the first, above which the angle can rise twice in
/// a cycle.
const MAX_SINGLE_RISE: f64 = 0.25;
/// Maximum relative deviation of the ratio of measured to commanded frequency from the conversion factor between two
/// units of frequency, for a wrong unit to be suspected.
const RATIO_TOLERANCE: f64 = 0.02;

/// Quantity in a joint's command that a mistake affects.
#[derive(Clone, Copy, PartialEq)]
enum Quantity {
    Offset,
    Amplitude,
    Phase,
    /// Offset and phase together: both change if the joint's sense of rotation is reversed.
    Sense,
    All,
}

/// Mistake in a joint's command: affected quantity, correction of its value, and the question to put to the user.
type Mistake = (Quantity, fn(f64) -> f64, &'static str);

const MISTAKES: [Mistake; 8] = [
    (Quantity::Phase, |phase| -phase, "is the sign of the phase wrong?"),
    (Quantity::Offset, |offset| -offset, "is the sign of the offset wrong?"),
    (Quantity::Sense, |sense| -sense, "does the joint turn in the opposite direction?"),
    (Quantity::Amplitude, |amplitude| 0.5 * amplitude, "is the amplitude a peak-to-peak value?"),
    (Quantity::Amplitude, f64::to_degrees, "is the amplitude in radians?"),
    (Quantity::Phase, f64::to_degrees, "is the phase in radians?"),
    (Quantity::Offset, f64::to_degrees, "is the offset in radians?"),
    (Quantity::All, f64::to_degrees, "are all angles in radians?"),
];

/// Returns a joint's command with a mistake in one quantity corrected by `undo`.
fn corrected(command: JointCommand, quantity: Quantity, undo: fn(f64) -> f64) -> JointCommand {
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

/// Checks whether the joints follow their commands. The phases in `measured` may have any common origin. The finding is
/// an error if the cause is known or if the motion differs completely from the gait. `is_of_paper` states whether the
/// robot is the paper's.
pub(crate) fn check_gait(
    measured: &[JointCommand],
    gait: &[Option<JointCommand>],
    is_of_paper: bool,
) -> Finding {
    let deviation_deg = max_deviation_deg(measured, gait);
    let is_followed = deviation_deg <= Check::Gait.limit();
    let causes = if is_followed { Vec::new() } else { causes(measured, gait, is_of_paper) };
    let message = match &causes[..] {
        _ if is_followed => {
            format!("the joints deviate from the command by up to {deviation_deg:.1} degrees")
        }
        [] => format!(
            "the joints deviate from the command by up to {deviation_deg:.1} degrees: {}",
            compared(measured, gait)
        ),
        [(_, cause), others @ ..] => {
            let others = others.iter().map(|(in_short, _)| format!("; or {in_short}"));
            cause.clone() + &others.collect::<String>()
        }
    };
    let finding = Finding::at_most(Check::Gait, deviation_deg, message);
    if causes.is_empty() { finding } else { finding.failing() }
}

/// Returns the largest deviation of the joints' measured motion from a gait, degrees, for the time origin that
/// minimises it. A phase difference counts as the angle that it causes.
pub(super) fn max_deviation_deg(measured: &[JointCommand], gait: &[Option<JointCommand>]) -> f64 {
    let clock_rad = clock_rad(measured, gait, |_| true);
    let deviations = pairs(measured, gait).flat_map(|(_, measured, command)| {
        let late = wrap(measured.phase_rad - clock_rad - command.phase_rad);
        [
            measured.offset_rad - command.offset_rad,
            measured.amplitude_rad - command.amplitude_rad,
            command.amplitude_rad * late,
        ]
    });
    deviations.map(f64::abs).fold(0.0, f64::max).to_degrees()
}

/// Iterates over the joints that have a command, with index, measured motion and command.
fn pairs(
    measured: &[JointCommand],
    gait: &[Option<JointCommand>],
) -> impl Iterator<Item = (usize, JointCommand, JointCommand)> {
    let joints = measured.iter().zip(gait).enumerate();
    joints.filter_map(|(joint, (measured, command))| Some((joint, *measured, (*command)?)))
}

/// Returns the mean phase lead of the measured motion over the command, rad, over the joints for which `is_included`
/// returns true.
fn clock_rad(
    measured: &[JointCommand],
    gait: &[Option<JointCommand>],
    is_included: impl Fn(usize) -> bool,
) -> f64 {
    let ahead = pairs(measured, gait).filter(|(joint, ..)| is_included(*joint)).map(
        |(_, found, command)| {
            Complex::from_polar(command.amplitude_rad, found.phase_rad - command.phase_rad)
        },
    );
    ahead.sum::<Complex<f64>>().argument()
}

/// Describes, for each commanded joint, its measured motion and its command.
fn compared(measured: &[JointCommand], gait: &[Option<JointCommand>]) -> String {
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

/// Lists the changes to the command that explain the measured motion, each with a brief and a full description.
fn causes(
    measured: &[JointCommand],
    gait: &[Option<JointCommand>],
    is_of_paper: bool,
) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let joints = 0..gait.len();
    let single = joints.clone().rev().map(|one| joints.clone().map(|joint| joint == one).collect());
    let all = (gait.len() > 1).then(|| vec![true; gait.len()]);
    let choices: Vec<Vec<bool>> = single.chain(all).collect();
    for changed in choices {
        for (quantity, undo, question) in MISTAKES {
            let mut right = gait.to_vec();
            let mut is_changed = true;
            for (command, _) in right.iter_mut().zip(&changed).filter(|(_, is)| **is) {
                let other = command.map(|command| corrected(command, quantity, undo));
                is_changed &= *command != other;
                *command = other;
            }
            if is_changed && max_deviation_deg(measured, &right) <= EXPLAINED_DEG {
                let joints = joints.clone().filter(|joint| changed[*joint]);
                let joints: Vec<String> = joints.map(|joint| (joint + 1).to_string()).collect();
                found.push((
                    format!("joint {}: {question}", joints.join(" and ")),
                    in_words(measured, gait, &right, &changed, quantity, question),
                ));
            }
        }
    }
    let [first, second] = *gait else { return found };
    let [turned_first, turned_second] = [first, second]
        .map(|command| command.map(|command| corrected(command, Quantity::Sense, |x| x)));
    let tables = match is_of_paper {
        true => "markers.link1 and markers.link2",
        false => "the tables of the first and the last link in the marker layout",
    };
    let reversed = format!("swap {tables}, and reverse the signs of x and y of all markers");
    let exchanges = [
        (
            [second, first],
            "joints 1 and 2 are swapped",
            "each joint follows the other's command; swap joint1 and joint2 of the gait",
        ),
        ([turned_second, turned_first], "front and rear are swapped", &reversed),
    ];
    for (joints, mistake, advice) in exchanges {
        if max_deviation_deg(measured, &joints) <= EXPLAINED_DEG {
            found.push((mistake.to_owned(), format!("{mistake}: {advice}")));
        }
    }
    found
}

/// Describes, for the joints marked in `changed`, the mistake in their commands in `gait` and the correct values, which
/// are those in `right`.
fn in_words(
    measured: &[JointCommand],
    gait: &[Option<JointCommand>],
    right: &[Option<JointCommand>],
    changed: &[bool],
    quantity: Quantity,
    question: &str,
) -> String {
    let clock_rad = clock_rad(measured, right, |_| true);
    let mut joints = Vec::new();
    let mut changes = Vec::new();
    for (joint, found, command) in pairs(measured, gait).filter(|(joint, ..)| changed[*joint]) {
        let phase_rad = wrap(found.phase_rad - clock_rad);
        let all = [
            ("offset", Quantity::Offset, found.offset_rad, command.offset_rad),
            ("amplitude", Quantity::Amplitude, found.amplitude_rad, command.amplitude_rad),
            ("phase", Quantity::Phase, phase_rad, command.phase_rad),
        ];
        let mut differ = Vec::new();
        let mut set = Vec::new();
        let corrected = right[joint].unwrap_or(command);
        let corrected = [corrected.offset_rad, corrected.amplitude_rad, corrected.phase_rad];
        for ((name, one, found, command), right) in all.into_iter().zip(corrected) {
            let is_affected = match quantity {
                Quantity::All => true,
                Quantity::Sense => one != Quantity::Amplitude,
                other => other == one,
            };
            if !is_affected {
                continue;
            }
            let [found, command] = [found, command].map(f64::to_degrees);
            differ.push(format!("measured {name} {found:+.1} deg, configured {}", plain(command)));
            set.push(format!("{name}_deg = {}", plain(right.to_degrees())));
        }
        joints.push(format!("joint {}: {}", joint + 1, differ.join(", ")));
        changes.push(format!("joint{} {}", joint + 1, set.join(", ")));
    }
    format!("{}: {question} set {}", joints.join("; "), changes.join(" and "))
}

/// Formats a value as in the configuration.
fn plain(value: f64) -> String {
    let rounded = (value * 1e4).round() / 1e4;
    // Adding zero turns a negative zero into a positive one.
    format!("{}", rounded + 0.0)
}

/// Checks that the commanded joints, or all joints if none is commanded, swing at the commanded frequency.
///
/// # Errors
/// Returns an error if they do not swing, or swing at another frequency.
pub(crate) fn check_swing(command: &CommandedGait, phi_rad: &[Vec<f64>]) -> Result<(), Problem> {
    let is_commanded = command.joints.iter().any(Option::is_some);
    let commanded: Vec<(&Vec<f64>, JointCommand)> = phi_rad
        .iter()
        .zip(command.joints)
        .filter(|(_, joint)| joint.is_some() || !is_commanded)
        .map(|(phi_rad, joint)| (phi_rad, joint.unwrap_or_default()))
        .collect();
    let swings = commanded.iter().map(|(phi_rad, _)| {
        let [low, high] = extremes(seen(phi_rad));
        0.5 * (high - low)
    });
    let largest_rad = swings.fold(0.0, f64::max);
    if largest_rad < MIN_SWING_RAD {
        return Err(Problem::NoSwing { max_deg: largest_rad.to_degrees() });
    }
    let found = commanded.iter().find_map(|(phi_rad, joint)| Some((frequency(phi_rad)?, joint)));
    let Some((step_rad, joint)) = found else { return Ok(()) };
    let rises_rad_s = step_rad * command.rate_hz;
    let commanded_rad_s = command.omega_rad_s;
    let is_near = |omega: f64| (omega / commanded_rad_s - 1.0).abs() <= FREQUENCY_TOLERANCE;
    let second = joint.second().amplitude_rad() / joint.amplitude_rad;
    if is_near(rises_rad_s) || second > MAX_SINGLE_RISE && is_near(0.5 * rises_rad_s) {
        return Ok(());
    }
    let other = if second > 1.0 { 0.5 * rises_rad_s } else { rises_rad_s };
    let at_other = CommandedGait { omega_rad_s: other, ..*command };
    let omega_rad_s = at_other.estimate_phase(phi_rad).map_or(other, |driven| driven.omega_rad_s);
    // The times of a few rises are less accurate.
    if is_near(omega_rad_s) {
        return Ok(());
    }
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
        format!("is omega_rad_s correct? {set}, or check whether the file belongs to another trial")
    } else {
        format!(
            "if the frequencies of all trials deviate by the factor {ratio:.3}, the frame rate is wrong: set \
             vicon.rate_hz = {:.4} instead of {}; otherwise {set}, or check whether the file belongs to another \
             trial",
            command.rate_hz / ratio,
            command.rate_hz
        )
    };
    Err(Problem::OtherFrequency { omega_rad_s, commanded_rad_s, cause })
}

/// Returns the frequency of an angle that oscillates regularly, as phase per frame, rad, from the times at which the
/// angle rises through its mean; `None` if it moves too little or no period is visible.
fn frequency(phi_rad: &[f64]) -> Option<f64> {
    let [low, high] = extremes(seen(phi_rad));
    if high - low < 2.0 * MIN_SWING_RAD {
        return None;
    }
    let middle = mean(seen(phi_rad));
    let swing = 0.25 * (high - low);
    let mut is_low = false;
    let mut rises = Vec::new();
    for (frame, phi) in phi_rad.iter().enumerate() {
        if *phi < middle - 0.5 * swing {
            is_low = true;
        } else if is_low && *phi > middle + 0.5 * swing {
            is_low = false;
            rises.push(frame);
        }
    }
    let between = rises.windows(2).map(|pair| &phi_rad[pair[0]..pair[1]]);
    let visible = between.filter(|phi| 2 * seen(phi).count() > phi.len());
    let periods: Vec<f64> = visible.map(|phi| phi.len() as f64).collect();
    if periods.is_empty() {
        return None;
    }
    // Some of the rises may be occluded.
    let span = (rises.last()? - rises.first()?) as f64;
    Some(TAU * (span / median(periods)).round() / span)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn front_and_rear_of_a_robot_that_is_read_backwards_are_named_by_their_tables() {
        let joint = |offset_rad: f64, phase_rad: f64| JointCommand::new(offset_rad, 0.5, phase_rad);
        let gait = [Some(joint(0.3, 0.0)), Some(joint(0.1, -1.2))];
        let measured = [joint(-0.1, PI - 1.2), joint(-0.3, PI)];
        for (is_of_paper, tables) in [
            (true, "swap markers.link1 and markers.link2, and reverse"),
            (
                false,
                "swap the tables of the first and the last link in the marker layout, and reverse",
            ),
        ] {
            let finding = check_gait(&measured, &gait, is_of_paper);
            let expected = format!("front and rear are swapped: {tables}");
            assert!(finding.message.contains(&expected), "{}", finding.message);
        }
    }
}
