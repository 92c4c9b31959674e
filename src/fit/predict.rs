//! What a fitted model predicts at the trials' frequencies and between them.

use rayon::prelude::*;

use super::bands::Bands;
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

/// A motion, and how far its metrics may be off.
#[derive(Clone)]
struct Predicted {
    solved: Result<(GaitMetrics, MotionStatus), MotionError>,
    /// Limits of the metrics, or why there are none.
    limits: Result<[GaitMetrics; 2], String>,
}

impl Predicted {
    /// Finds the motion from rest whatever was solved for before.
    fn solve(
        solver: &mut Solver,
        problem: Result<&Problem, MotionError>,
        accuracy: f64,
        bands: &Result<Bands, String>,
    ) -> Self {
        let solve = |problem: &Problem| {
            solver.forget();
            let metrics = solver.solve(problem, accuracy)?;
            let status = MotionStatus::of_floquet(solver.floquet()?);
            let limits = bands.as_ref().map_err(Clone::clone).and_then(|bands| {
                // Others go on from this motion.
                bands.limits(solver.clone(), problem, metrics).map_err(|error| {
                    format!("the fit to a resample has no motion at this frequency: {error}")
                })
            });
            Ok((metrics, status, limits))
        };
        match problem.and_then(solve) {
            Ok((metrics, status, limits)) => Self { solved: Ok((metrics, status)), limits },
            Err(error) => Self { limits: Err("there is no motion".to_owned()), solved: Err(error) },
        }
    }

    /// The same for a trial, of which the metrics differ a little.
    fn moved(&self, metrics_of: impl Fn(&GaitMetrics) -> GaitMetrics) -> Self {
        let Ok((metrics, status)) = &self.solved else { return self.clone() };
        let moved = metrics_of(metrics);
        let (from, to) = (metrics.to_array(), moved.to_array());
        let beside = |limit: GaitMetrics| {
            let limit = limit.to_array();
            GaitMetrics::from_array(std::array::from_fn(|i| limit[i] + (to[i] - from[i])))
        };
        let limits = self.limits.clone().map(|limits| limits.map(beside));
        Self { solved: Ok((moved, *status)), limits }
    }
}

/// Rows of `predictions.parquet` for one model of one campaign.
pub(super) fn predictions(
    campaign: &str,
    point: &FittedPoint,
    robot: &Robot,
    bands: &Result<Bands, String>,
) -> Vec<PredictionRow> {
    let objective = point.evaluator.objective;
    let (model, conditions) = (objective.model, &objective.conditions);
    let row = |omega_rad_s, source, j, predicted: Predicted, from_rest| {
        let (metrics, status) = match &predicted.solved {
            Ok(solved) => *solved,
            Err(error) => (GaitMetrics::MISSING, error.status()),
        };
        let none = [GaitMetrics::MISSING; 2];
        let ([lower, upper], no_interval) = match predicted.limits {
            Ok(limits) => (limits, String::new()),
            Err(why) => (none, why),
        };
        let campaign = campaign.to_owned();
        PredictionRow {
            campaign,
            model,
            omega_rad_s,
            source,
            metrics,
            lower,
            upper,
            no_interval,
            j,
            status,
            from_rest,
        }
    };
    let of_condition = |solver: &mut Solver, condition: &Condition| {
        let problem = objective.problem_of(robot, condition);
        let predicted = Predicted::solve(
            solver,
            problem.as_ref().map_err(Clone::clone),
            REFERENCE_ACCURACY,
            bands,
        );
        let from_rest =
            problem.ok().zip(predicted.solved.as_ref().ok()).map(|(problem, (metrics, _))| {
                Attractor::from_rest(&solver.attractor(&problem, Ok(*metrics), REFERENCE_ACCURACY))
            });
        (predicted, from_rest)
    };
    let all = conditions.all.par_iter();
    let predicted: Vec<_> = all.map_init(Solver::default, of_condition).collect();
    let at_trial = |(measurement, (condition, differences)): (&Measurement, &(usize, _))| {
        let (predicted, from_rest) = &predicted[*condition];
        let expansion = point.evaluator.expansions[*condition].as_ref();
        let predicted = predicted
            .moved(|metrics| expansion.map_or(*metrics, |of| of.metrics_at(metrics, differences)));
        let j = predicted
            .solved
            .as_ref()
            .map_or(f64::NAN, |(metrics, _)| objective.contribution(measurement, metrics));
        row(measurement.omega_rad_s, PredictionSource::Trial, j, predicted, *from_rest)
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
            let problem = problem.as_ref().map_err(Clone::clone);
            let predicted = Predicted::solve(solver, problem, CURVE_ACCURACY, bands);
            row(omega_rad_s, PredictionSource::Curve, f64::NAN, predicted, None)
        };
        let points = (0..CURVE_POINTS).into_par_iter();
        rows.par_extend(points.map_init(Solver::default, on_curve));
    }
    rows
}

/// The gait that drives a model, at any frequency: the command, or what was measured of it.
pub(super) struct GaitOverFrequency {
    command: Gait,
    /// The mean of the gaits measured at each frequency, ascending; one where the command drives.
    known: Vec<(f64, Gait)>,
}

impl GaitOverFrequency {
    pub fn new(objective: &Objective) -> Self {
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
    pub fn at(&self, omega_rad_s: f64) -> Option<Gait> {
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
