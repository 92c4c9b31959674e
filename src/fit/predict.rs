//! What a fitted model predicts at the trials' frequencies and between them.

use rayon::prelude::*;

use super::measurement::Measurement;
use super::objective::Objective;
use crate::metrics::GaitMetrics;
use crate::motion::{
    Attractor, Model, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY, Solver,
};
use crate::robot::Robot;
use crate::store::{PredictionRow, PredictionSource};

/// Frequencies of a curve.
const CURVE_POINTS: usize = 112;
/// Relative accuracy of a curve.
const CURVE_ACCURACY: f64 = 1e-8;

/// Rows of `predictions.parquet` for one model of one campaign.
pub(super) fn predictions(
    campaign: &str,
    objective: &Objective,
    robot: &Robot,
) -> Vec<PredictionRow> {
    let model = objective.model;
    let row = |omega_rad_s, source, j, solved: &Result<_, MotionError>, from_rest| {
        let (metrics, status) = match solved {
            Ok(solved) => *solved,
            Err(error) => (GaitMetrics::MISSING, error.status()),
        };
        let campaign = campaign.to_owned();
        PredictionRow { campaign, model, omega_rad_s, source, metrics, j, status, from_rest }
    };
    let at_trial = |solver: &mut Solver, measurement: &Measurement| {
        let problem = objective.problem_of(robot, measurement).ok_or(MotionError::GaitUnknown);
        let solved = problem.clone().and_then(|it| solve(solver, &it, REFERENCE_ACCURACY));
        let j = solved
            .as_ref()
            .map_or(f64::NAN, |(metrics, _)| objective.contribution(measurement, metrics));
        let from_rest = problem.ok().zip(solved.as_ref().ok()).map(|(problem, (metrics, _))| {
            Attractor::from_rest(&solver.attractor(&problem, Ok(*metrics), REFERENCE_ACCURACY))
        });
        row(measurement.omega_rad_s, PredictionSource::Trial, j, &solved, from_rest)
    };
    let trials = objective.measurements.par_iter();
    let mut rows: Vec<PredictionRow> = trials.map_init(Solver::default, at_trial).collect();
    if model != Model::NoSkidMeasured {
        let omegas = objective.measurements.iter().map(|measurement| measurement.omega_rad_s);
        let low = omegas.clone().fold(f64::INFINITY, f64::min);
        let high = omegas.fold(0.0, f64::max);
        let on_curve = |solver: &mut Solver, i: usize| {
            let omega_rad_s = low + (high - low) * i as f64 / (CURVE_POINTS - 1) as f64;
            let problem = objective.problem(robot, omega_rad_s);
            let solved = solve(solver, &problem, CURVE_ACCURACY);
            row(omega_rad_s, PredictionSource::Curve, f64::NAN, &solved, None)
        };
        let points = (0..CURVE_POINTS).into_par_iter();
        rows.par_extend(points.map_init(Solver::default, on_curve));
    }
    rows
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
