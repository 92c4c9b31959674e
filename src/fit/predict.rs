//! What a fitted model predicts at the trials' frequencies and between them.

use super::objective::Objective;
use crate::metrics::GaitMetrics;
use crate::motion::{Model, MotionError, REFERENCE_ACCURACY, Settled, Solver, SteadyMotion};
use crate::robot::Robot;
use crate::store::PredictionRow;

/// Frequencies of a curve.
const CURVE_POINTS: usize = 112;

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
               solved: &Result<SteadyMotion, MotionError>,
               from_rest: &str| {
        let (metrics, status) = match solved {
            Ok(motion) => (motion.metrics, motion.status()),
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
    let mut rows = Vec::new();
    for measurement in objective.measurements() {
        let problem = objective.problem_of(robot, measurement).ok_or(MotionError::GaitUnknown);
        let solved = problem.clone().and_then(|problem| problem.solve(REFERENCE_ACCURACY));
        let j = solved
            .as_ref()
            .map_or(f64::NAN, |motion| objective.contribution(measurement, &motion.metrics));
        let from_rest = match (&solved, &problem) {
            (Ok(_), Ok(problem)) => {
                Settled::from_rest(&Solver::default().settle(problem, REFERENCE_ACCURACY))
            }
            _ => "",
        };
        rows.push(row(measurement.omega_rad_s, "trial", j, &solved, from_rest));
    }
    if model != Model::NoSkidMeasured {
        let omegas = objective.measurements().iter().map(|measurement| measurement.omega_rad_s);
        let low = omegas.clone().fold(f64::INFINITY, f64::min);
        let high = omegas.fold(0.0, f64::max);
        for i in 0..CURVE_POINTS {
            let omega_rad_s = low + (high - low) * i as f64 / (CURVE_POINTS - 1) as f64;
            let solved = objective.problem(robot, omega_rad_s).solve(REFERENCE_ACCURACY);
            rows.push(row(omega_rad_s, "curve", f64::NAN, &solved, ""));
        }
    }
    rows
}
