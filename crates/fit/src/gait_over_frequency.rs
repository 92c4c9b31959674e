//! Driving gait of a model at frequencies between those of the trials.

use trilink_robot::{AnyGait, JointCommand, MAX_JOINTS};
use trilink_statistics::{mean, wrap};
use trilink_tables::config::GaitInput;

use super::measurement::Measurement;
use super::objective::Objective;

/// Standard errors of offset, amplitude and phase of each joint, rad.
pub(super) type GaitErrors = [[f64; 3]; MAX_JOINTS];
/// Standard errors of a gait that is known exactly.
pub(super) const EXACT: GaitErrors = [[0.0; 3]; MAX_JOINTS];
/// Standard errors that are not known.
pub(super) const UNKNOWN: GaitErrors = [[f64::NAN; 3]; MAX_JOINTS];

/// Commanded or measured gait that drives a model, as a function of frequency.
pub(super) struct GaitOverFrequency {
    command: AnyGait,
    /// Measured frequencies (rad/s) in ascending order, each with the mean measured gait and the standard errors of
    /// that mean; a single entry with the commanded gait where the command drives the model.
    known: Vec<(f64, AnyGait, GaitErrors)>,
}

impl GaitOverFrequency {
    /// Prepares the gaits for an objective with a single campaign.
    pub(crate) fn new(objective: &Objective) -> Self {
        let command = objective.protocols[0].gait;
        if objective.gait_input == GaitInput::Commanded {
            return Self { command, known: vec![(0.0, command, EXACT)] };
        }
        let frequencies = Measurement::frequencies(&objective.measurements);
        let mut known: Vec<(f64, AnyGait, GaitErrors)> = Vec::new();
        for trials in frequencies {
            let trials = trials.into_iter().map(|trial| &objective.measurements[trial]);
            let measured: Vec<(&Measurement, AnyGait)> =
                trials.filter_map(|trial| Some((trial, objective.gait_of(trial)?))).collect();
            if measured.is_empty() {
                continue;
            }
            let weight = 1.0 / measured.len() as f64;
            let gaits = measured.iter().map(|(_, gait)| (weight, gait));
            let errors = measured.iter().map(|(trial, _)| (weight, &trial.gait_errors_rad));
            let omega_rad_s = mean(measured.iter().map(|(trial, _)| trial.omega_rad_s));
            known.push((omega_rad_s, combined(&command, gaits), combined_errors(errors)));
        }
        known.sort_by(|(a, ..), (b, ..)| a.total_cmp(b));
        Self { command, known }
    }

    /// Interpolates the gait and its standard errors linearly between measured frequencies; beyond them takes the
    /// nearest gait. `None` if no gait was measured.
    pub(crate) fn at(&self, omega_rad_s: f64) -> Option<(AnyGait, GaitErrors)> {
        let after = self.known.partition_point(|(known, ..)| *known <= omega_rad_s);
        let (low, below, errors_below) = self.known.get(after.saturating_sub(1))?;
        let (high, above, errors_above) = self.known.get(after).or(self.known.last())?;
        if high <= low || omega_rad_s <= *low {
            return Some((*below, *errors_below));
        }
        let fraction = (omega_rad_s - low) / (high - low);
        let weighted = [(1.0 - fraction, below), (fraction, above)];
        let errors = [(1.0 - fraction, errors_below), (fraction, errors_above)];
        Some((combined(&self.command, weighted.into_iter()), combined_errors(errors.into_iter())))
    }
}

/// Returns the standard errors of a weighted mean of independent gaits.
fn combined_errors<'e>(errors: impl Iterator<Item = (f64, &'e GaitErrors)> + Clone) -> GaitErrors {
    std::array::from_fn(|joint| {
        std::array::from_fn(|number| {
            let errors = errors.clone();
            let squares = errors.map(|(weight, errors)| (weight * errors[joint][number]).powi(2));
            squares.sum::<f64>().sqrt()
        })
    })
}

/// Returns the weighted mean of gaits that follow one command; phases are averaged as differences from the command.
fn combined<'g>(
    command: &AnyGait,
    gaits: impl Iterator<Item = (f64, &'g AnyGait)> + Clone,
) -> AnyGait {
    let joint = |i: usize, command: JointCommand| {
        let start = JointCommand { offset_rad: 0.0, amplitude_rad: 0.0, ..command };
        let joints = gaits.clone().filter_map(|(weight, gait)| Some((weight, gait.joints[i]?)));
        joints.fold(start, |sum, (weight, joint)| JointCommand {
            offset_rad: sum.offset_rad + weight * joint.offset_rad,
            amplitude_rad: sum.amplitude_rad + weight * joint.amplitude_rad,
            phase_rad: sum.phase_rad + weight * wrap(joint.phase_rad - command.phase_rad),
            ..command
        })
    };
    let joints = |i: usize| command.joints[i].map(|command| joint(i, command));
    AnyGait { joints: std::array::from_fn(joints) }
}

#[cfg(test)]
mod tests {
    use trilink_robot::Gait;

    use super::*;

    #[test]
    fn below_and_beyond_the_known_frequencies_the_gait_is_that_of_the_nearest() {
        let command = AnyGait::from(Gait::symmetric());
        let gait = |offset_rad: f64| AnyGait {
            joints: command.joints.map(|joint| joint.map(|of| JointCommand { offset_rad, ..of })),
        };
        let known = vec![
            (2.0, gait(0.1), [[0.3; 3]; MAX_JOINTS]),
            (4.0, gait(0.3), [[0.4; 3]; MAX_JOINTS]),
        ];
        let gaits = GaitOverFrequency { command, known };
        let offset_rad = |omega_rad_s: f64| {
            let (gait, _) = gaits.at(omega_rad_s).expect("known");
            gait.joints[0].expect("commanded").offset_rad
        };
        // Just outside the known range, the nearest known gait applies.
        assert_eq!([1.9, 2.0, 4.0, 4.1].map(offset_rad), [0.1, 0.1, 0.3, 0.3]);
        assert!((offset_rad(3.0) - 0.2).abs() < 1e-12);
        // Standard errors of two independent gaits.
        let errors_rad =
            [2.0, 3.0].map(|omega_rad_s| gaits.at(omega_rad_s).expect("known").1[1][2]);
        assert!((errors_rad[0] - 0.3).abs() < 1e-12 && (errors_rad[1] - 0.25).abs() < 1e-12);
        assert_eq!(GaitOverFrequency { known: Vec::new(), ..gaits }.at(3.0), None);
    }
}
