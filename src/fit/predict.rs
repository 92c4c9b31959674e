//! What a fitted model predicts at the trials' frequencies and between them.

use rayon::prelude::*;

use super::measurement::Measurement;
use super::objective::Objective;
use crate::metrics::GaitMetrics;
use crate::motion::{Attractor, Model, MotionError, Problem, REFERENCE_ACCURACY, Solver};
use crate::robot::Robot;
use crate::store::PredictionRow;

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
    let model = objective.model();
    let row = |omega_rad_s,
               source: &str,
               j,
               solved: &Result<(GaitMetrics, &'static str), MotionError>,
               from_rest: &str| {
        let (metrics, status) = match solved {
            Ok((metrics, status)) => (*metrics, *status),
            Err(error) => (GaitMetrics::MISSING, error.status()),
        };
        let [d_m, v_m_s, sigma0, sigma1, sigma2, alpha1_rad, dtheta_rad] = metrics.to_array();
        PredictionRow {
            campaign: campaign.to_owned(),
            model: model.name().to_owned(),
            omega_rad_s,
            source: source.to_owned(),
            d_m,
            v_m_s,
            sigma0,
            sigma1,
            sigma2,
            alpha1_rad,
            dtheta_rad,
            j,
            status: status.to_owned(),
            from_rest: from_rest.to_owned(),
        }
    };
    let at_trial = |solver: &mut Solver, measurement: &Measurement| {
        let problem = objective.problem_of(robot, measurement).ok_or(MotionError::GaitUnknown);
        let solved = problem.clone().and_then(|it| solve(solver, &it, REFERENCE_ACCURACY));
        let j = solved
            .as_ref()
            .map_or(f64::NAN, |(metrics, _)| objective.contribution(measurement, metrics));
        let from_rest = match (problem, &solved) {
            (Ok(problem), Ok((metrics, _))) => {
                Attractor::from_rest(&solver.attractor(&problem, Ok(*metrics), REFERENCE_ACCURACY))
            }
            _ => "",
        };
        row(measurement.omega_rad_s, "trial", j, &solved, from_rest)
    };
    let trials = objective.measurements().par_iter();
    let mut rows: Vec<PredictionRow> = trials.map_init(Solver::default, at_trial).collect();
    if model != Model::NoSkidMeasured {
        let omegas = objective.measurements().iter().map(|measurement| measurement.omega_rad_s);
        let low = omegas.clone().fold(f64::INFINITY, f64::min);
        let high = omegas.fold(0.0, f64::max);
        let on_curve = |solver: &mut Solver, i: usize| {
            let omega_rad_s = low + (high - low) * i as f64 / (CURVE_POINTS - 1) as f64;
            let problem = objective.problem(robot, omega_rad_s);
            let solved = solve(solver, &problem, CURVE_ACCURACY);
            row(omega_rad_s, "curve", f64::NAN, &solved, "")
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
) -> Result<(GaitMetrics, &'static str), MotionError> {
    solver.forget();
    let metrics = solver.solve(problem, accuracy)?;
    let is_unstable = solver.floquet()?.is_some_and(|modulus| modulus >= 1.0);
    Ok((metrics, if is_unstable { "unstable" } else { "stable" }))
}
