//! What a fitted model predicts at the trials' frequencies and between them.

use rayon::prelude::*;

use super::FitInput;
use super::bands::{Band, Bands, GaitErrors};
use super::conditions::Condition;
use super::fitted_point::FittedPoint;
use super::measurement::Measurement;
use super::objective::Objective;
use crate::config::GaitInput;
use crate::metrics::GaitMetrics;
use crate::motion::{Attractor, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY, Solver};
use crate::robot::{Gait, JointCommand, Robot};
use crate::stats::{mean, wrap};
use crate::store::{PredictionRow, PredictionSource};

/// Frequencies of a curve.
const CURVE_POINTS: usize = 112;
/// Relative accuracy of a curve.
const CURVE_ACCURACY: f64 = 1e-8;

/// A motion, and how far its metrics may be off.
struct Predicted {
    solved: Result<(GaitMetrics, MotionStatus), MotionError>,
    /// How far its metrics may be off, or why that is not known.
    band: Result<Band, String>,
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
            let status = solver.status()?;
            let band = bands.as_ref().map_err(Clone::clone).and_then(|bands| {
                // Others go on from this motion.
                bands.band(solver.clone(), problem, metrics).map_err(|error| {
                    format!("the fit to a resample has no motion at this frequency: {error}")
                })
            });
            Ok((metrics, status, band))
        };
        match problem.and_then(solve) {
            Ok((metrics, status, band)) => Self { solved: Ok((metrics, status)), band },
            Err(error) => Self { band: Err("there is no motion".to_owned()), solved: Err(error) },
        }
    }
}

/// Rows of `predictions.parquet` for one model of one campaign.
pub(super) fn predictions(
    input: &FitInput,
    point: &FittedPoint,
    robot: &Robot,
    bands: &Result<Bands, String>,
) -> Vec<PredictionRow> {
    let objective = point.evaluator.objective;
    let (campaign, model, conditions) = (&input.campaign.name, &input.model, &objective.conditions);
    // Of a motion, or of one nearby with these metrics.
    let row = |omega_rad_s,
               source,
               j,
               predicted: &Predicted,
               own: Option<GaitMetrics>,
               errors_rad: GaitErrors,
               from_rest| {
        let (metrics, status) = match &predicted.solved {
            Ok((metrics, status)) => (own.unwrap_or(*metrics), *status),
            Err(error) => (GaitMetrics::MISSING, error.status()),
        };
        let ([lower, upper], no_interval) = match &predicted.band {
            Ok(band) => (band.limits(&metrics, &errors_rad), String::new()),
            Err(why) => ([GaitMetrics::MISSING; 2], why.clone()),
        };
        PredictionRow {
            campaign: campaign.clone(),
            model: model.name,
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
        let own = predicted.solved.as_ref().ok().map(|(metrics, _)| {
            expansion.map_or(*metrics, |of| of.metrics_at(metrics, differences))
        });
        let j = own.map_or(f64::NAN, |metrics| objective.contribution(measurement, &metrics));
        let (omega_rad_s, errors_rad) = (measurement.omega_rad_s, measurement.gait_errors_rad);
        row(omega_rad_s, PredictionSource::Trial, j, predicted, own, errors_rad, *from_rest)
    };
    let trials = objective.measurements.iter().zip(&conditions.of_trials);
    let mut rows: Vec<PredictionRow> = trials.map(at_trial).collect();
    if !model.value.is_of_trials() {
        let omegas = objective.measurements.iter().map(|measurement| measurement.omega_rad_s);
        let low = omegas.clone().fold(f64::INFINITY, f64::min);
        let high = omegas.fold(0.0, f64::max);
        let gaits = GaitOverFrequency::new(objective);
        let on_curve = |solver: &mut Solver, i: usize| {
            let omega_rad_s = low + (high - low) * i as f64 / (CURVE_POINTS - 1) as f64;
            let found = gaits.at(omega_rad_s).ok_or(MotionError::GaitUnknown);
            let problem =
                found.clone().map(|(gait, _)| objective.problem(robot, gait, omega_rad_s));
            let problem = problem.as_ref().map_err(Clone::clone);
            let predicted = Predicted::solve(solver, problem, CURVE_ACCURACY, bands);
            let errors_rad = found.map_or([[f64::NAN; 3]; 2], |(_, errors_rad)| errors_rad);
            let (source, j) = (PredictionSource::Curve, f64::NAN);
            row(omega_rad_s, source, j, &predicted, None, errors_rad, None)
        };
        let points = (0..CURVE_POINTS).into_par_iter();
        rows.par_extend(points.map_init(Solver::default, on_curve));
    }
    rows
}

/// The gait that drives a model, at any frequency: the command, or what was measured of it.
pub(super) struct GaitOverFrequency {
    command: Gait,
    /// The mean of the gaits measured at each frequency, ascending, and its standard errors; one
    /// where the command drives.
    known: Vec<(f64, Gait, GaitErrors)>,
}

impl GaitOverFrequency {
    pub fn new(objective: &Objective) -> Self {
        let command = objective.gait;
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
    pub fn at(&self, omega_rad_s: f64) -> Option<(Gait, GaitErrors)> {
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
