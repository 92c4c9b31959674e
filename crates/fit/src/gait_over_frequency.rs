//! The gait that drives a model between the frequencies of its trials.

use trilink_robot::{Gait, JointCommand};
use trilink_statistics::{mean, wrap};
use trilink_tables::config::GaitInput;

use super::measurement::Measurement;
use super::objective::Objective;

/// Standard errors of offset, amplitude and phase of either joint.
pub(super) type GaitErrors = [[f64; 3]; 2];

/// The gait that drives a model, at any frequency: the command, or what was measured of it.
pub(super) struct GaitOverFrequency {
    command: Gait,
    /// The mean of the gaits measured at each frequency, ascending, and its standard errors; one
    /// where the command drives.
    known: Vec<(f64, Gait, GaitErrors)>,
}

impl GaitOverFrequency {
    /// Of an objective of one campaign.
    pub(crate) fn new(objective: &Objective) -> Self {
        let command = objective.protocols[0].gait;
        if objective.gait_input == GaitInput::Commanded {
            return Self { command, known: vec![(0.0, command, [[0.0; 3]; 2])] };
        }
        let frequencies = Measurement::frequencies(&objective.measurements);
        let at_frequency = |trials: &Vec<usize>| {
            let trials = trials.iter().map(|&trial| &objective.measurements[trial]);
            let known: Vec<(&Measurement, Gait)> =
                trials.filter_map(|trial| Some((trial, objective.gait_of(trial)?))).collect();
            let weight = 1.0 / known.len() as f64;
            let weighted = known.iter().map(|(_, gait)| (weight, gait));
            let errors = known.iter().map(|(trial, _)| (weight, &trial.gait_errors_rad));
            let omega_rad_s = mean(known.iter().map(|(trial, _)| trial.omega_rad_s));
            let all = || (omega_rad_s, combined(&command, weighted), combined_errors(errors));
            (!known.is_empty()).then(all)
        };
        let mut known: Vec<_> = frequencies.iter().filter_map(at_frequency).collect();
        known.sort_by(|(a, ..), (b, ..)| a.total_cmp(b));
        Self { command, known }
    }

    /// In proportion between two frequencies that are known, as at the nearest beyond them, with
    /// standard errors; `None` where no gait was measured.
    pub(crate) fn at(&self, omega_rad_s: f64) -> Option<(Gait, GaitErrors)> {
        let after = self.known.partition_point(|(known, ..)| *known <= omega_rad_s);
        let (low, below, errors_below) = self.known.get(after.saturating_sub(1))?;
        let (high, above, errors_above) = self.known.get(after).or(self.known.last())?;
        if high <= low || omega_rad_s <= *low {
            return Some((*below, *errors_below));
        }
        let part = (omega_rad_s - low) / (high - low);
        let weighted = [(1.0 - part, below), (part, above)];
        let errors = [(1.0 - part, errors_below), (part, errors_above)];
        Some((combined(&self.command, weighted.into_iter()), combined_errors(errors.into_iter())))
    }
}

/// Standard errors of a weighted mean of independent gaits.
fn combined_errors<'e>(errors: impl Iterator<Item = (f64, &'e GaitErrors)> + Clone) -> GaitErrors {
    let squares = |joint: usize, number: usize| -> f64 {
        errors.clone().map(|(weight, errors)| (weight * errors[joint][number]).powi(2)).sum()
    };
    std::array::from_fn(|joint| std::array::from_fn(|number| squares(joint, number).sqrt()))
}

/// Weighted mean of gaits that follow one command; phases by the shorter way around.
fn combined<'g>(command: &Gait, gaits: impl Iterator<Item = (f64, &'g Gait)> + Clone) -> Gait {
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
    Gait { joints: [0, 1].map(|i| command.joints[i].map(|command| joint(i, command))) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn below_and_beyond_the_known_frequencies_the_gait_is_that_of_the_nearest() {
        let command = Gait::symmetric();
        let gait = |offset_rad: f64| Gait {
            joints: command.joints.map(|joint| joint.map(|of| JointCommand { offset_rad, ..of })),
        };
        let known = vec![(2.0, gait(0.1), [[0.3; 3]; 2]), (4.0, gait(0.3), [[0.4; 3]; 2])];
        let gaits = GaitOverFrequency { command, known };
        let offset_rad = |omega_rad_s: f64| {
            let (gait, _) = gaits.at(omega_rad_s).expect("known");
            gait.joints[0].expect("commanded").offset_rad
        };
        // Repeats that are a little slower than their mean.
        assert_eq!([1.9, 2.0, 4.0, 4.1].map(offset_rad), [0.1, 0.1, 0.3, 0.3]);
        assert!((offset_rad(3.0) - 0.2).abs() < 1e-12);
        // Errors of two that are independent.
        let errors_rad =
            [2.0, 3.0].map(|omega_rad_s| gaits.at(omega_rad_s).expect("known").1[1][2]);
        assert!((errors_rad[0] - 0.3).abs() < 1e-12 && (errors_rad[1] - 0.25).abs() < 1e-12);
        assert_eq!(GaitOverFrequency { known: Vec::new(), ..gaits }.at(3.0), None);
    }
}
