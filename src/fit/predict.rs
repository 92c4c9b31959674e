//! What a fitted model predicts at the trials' frequencies and between them.

use rayon::prelude::*;

use super::conditions::Condition;
use super::fitted_point::FittedPoint;
use super::measurement::Measurement;
use super::objective::Objective;
use crate::config::GaitInput;
use crate::metrics::GaitMetrics;
use crate::motion::{
    Attractor, Model, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY, Solver,
};
use crate::robot::{Gait, JointCommand, Robot};
use crate::stats::{mean, wrap};
use crate::store::{PredictionRow, PredictionSource};

/// Frequencies of a curve.
const CURVE_POINTS: usize = 112;
/// Relative accuracy of a curve.
const CURVE_ACCURACY: f64 = 1e-8;

/// Rows of `predictions.parquet` for one model of one campaign.
pub(super) fn predictions(
    campaign: &str,
    point: &FittedPoint,
    robot: &Robot,
) -> Vec<PredictionRow> {
    let objective = point.evaluator.objective;
    let (model, conditions) = (objective.model, &objective.conditions);
    let row = |omega_rad_s, source, j, solved: &Result<_, MotionError>, from_rest| {
        let (metrics, status) = match solved {
            Ok(solved) => *solved,
            Err(error) => (GaitMetrics::MISSING, error.status()),
        };
        let campaign = campaign.to_owned();
        PredictionRow { campaign, model, omega_rad_s, source, metrics, j, status, from_rest }
    };
    let of_condition = |solver: &mut Solver, condition: &Condition| {
        let problem = objective.problem_of(robot, condition);
        let solved = problem.clone().and_then(|it| solve(solver, &it, REFERENCE_ACCURACY));
        let from_rest = problem.ok().zip(solved.as_ref().ok()).map(|(problem, (metrics, _))| {
            Attractor::from_rest(&solver.attractor(&problem, Ok(*metrics), REFERENCE_ACCURACY))
        });
        (solved, from_rest)
    };
    let all = conditions.all.par_iter();
    let solved: Vec<_> = all.map_init(Solver::default, of_condition).collect();
    let at_trial = |(measurement, (condition, differences)): (&Measurement, &(usize, _))| {
        let (solved, from_rest) = &solved[*condition];
        let solved = solved.clone().map(|(metrics, status)| {
            let expansion = point.evaluator.expansions[*condition].as_ref();
            (expansion.map_or(metrics, |of| of.metrics_at(&metrics, differences)), status)
        });
        let j = solved
            .as_ref()
            .map_or(f64::NAN, |(metrics, _)| objective.contribution(measurement, metrics));
        row(measurement.omega_rad_s, PredictionSource::Trial, j, &solved, *from_rest)
    };
    let trials = objective.measurements.iter().zip(&conditions.of_trials);
    let mut rows: Vec<PredictionRow> = trials.map(at_trial).collect();
    if model != Model::NoSkidMeasured {
        let omegas = objective.measurements.iter().map(|measurement| measurement.omega_rad_s);
        let low = omegas.clone().fold(f64::INFINITY, f64::min);
        let high = omegas.fold(0.0, f64::max);
        let gaits = GaitOverFrequency::new(objective);
        let on_curve = |solver: &mut Solver, i: usize| {
            let omega_rad_s = low + (high - low) * i as f64 / (CURVE_POINTS - 1) as f64;
            let gait = gaits.at(omega_rad_s).ok_or(MotionError::GaitUnknown);
            let problem = gait.map(|gait| objective.problem(robot, gait, omega_rad_s));
            let solved = problem.and_then(|problem| solve(solver, &problem, CURVE_ACCURACY));
            row(omega_rad_s, PredictionSource::Curve, f64::NAN, &solved, None)
        };
        let points = (0..CURVE_POINTS).into_par_iter();
        rows.par_extend(points.map_init(Solver::default, on_curve));
    }
    rows
}

/// The gait that drives a model, at any frequency: the command, or what was measured of it.
struct GaitOverFrequency {
    command: Gait,
    /// The mean of the gaits measured at each frequency, ascending; one where the command drives.
    known: Vec<(f64, Gait)>,
}

impl GaitOverFrequency {
    fn new(objective: &Objective) -> Self {
        let command = objective.gait;
        if objective.driven_by() == GaitInput::Commanded {
            return Self { command, known: vec![(0.0, command)] };
        }
        let frequencies = Measurement::frequencies(&objective.measurements);
        let at_frequency = |trials: &Vec<usize>| {
            let trials = trials.iter().map(|&trial| &objective.measurements[trial]);
            let known = trials.filter_map(|trial| Some((trial, objective.gait_of(trial)?)));
            let (omegas_rad_s, gaits): (Vec<f64>, Vec<Gait>) =
                known.map(|(trial, gait)| (trial.omega_rad_s, gait)).unzip();
            let weight = 1.0 / gaits.len() as f64;
            let weighted = gaits.iter().map(|gait| (weight, gait));
            (!gaits.is_empty()).then(|| (mean(omegas_rad_s), combined(&command, weighted)))
        };
        let mut known: Vec<(f64, Gait)> = frequencies.iter().filter_map(at_frequency).collect();
        known.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        Self { command, known }
    }

    /// In proportion between two frequencies that are known, as at the nearest beyond them; `None`
    /// where no gait was measured.
    fn at(&self, omega_rad_s: f64) -> Option<Gait> {
        let after = self.known.partition_point(|(known, _)| *known <= omega_rad_s);
        let (low, below) = self.known.get(after.saturating_sub(1))?;
        let (high, above) = self.known.get(after).or(self.known.last())?;
        if high <= low || omega_rad_s <= *low {
            return Some(*below);
        }
        let part = (omega_rad_s - low) / (high - low);
        let weighted = [(1.0 - part, below), (part, above)];
        Some(combined(&self.command, weighted.into_iter()))
    }
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
        })
    };
    Gait { joints: [0, 1].map(|i| command.joints[i].map(|command| joint(i, command))) }
}

/// The metrics of a motion, found from rest whatever was solved for before, and whether it is
/// stable.
fn solve(
    solver: &mut Solver,
    problem: &Problem,
    accuracy: f64,
) -> Result<(GaitMetrics, MotionStatus), MotionError> {
    solver.forget();
    let metrics = solver.solve(problem, accuracy)?;
    Ok((metrics, MotionStatus::of_floquet(solver.floquet()?)))
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
        let known = vec![(2.0, gait(0.1)), (4.0, gait(0.3))];
        let gaits = GaitOverFrequency { command, known };
        let offset_rad = |omega_rad_s: f64| {
            let gait = gaits.at(omega_rad_s).expect("known");
            gait.joints[0].expect("commanded").offset_rad
        };
        // Repeats that are a little slower than their mean.
        assert_eq!([1.9, 2.0, 4.0, 4.1].map(offset_rad), [0.1, 0.1, 0.3, 0.3]);
        assert!((offset_rad(3.0) - 0.2).abs() < 1e-12);
        assert_eq!(GaitOverFrequency { known: Vec::new(), ..gaits }.at(3.0), None);
    }
}
