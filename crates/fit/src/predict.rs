//! What a fitted model predicts at the trials' frequencies and between them.

use rayon::prelude::*;
use trilink_mechanics::{
    Attractor, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY, Solver,
};
use trilink_robot::Robot;
use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_tables::{NoInterval, NoIntervalReason, PredictionRow, PredictionSource, ResidualRow};

use super::FitInput;
use super::bands::{Band, Bands, without_resample};
use super::conditions::Condition;
use super::fitted_point::FittedPoint;
use super::gait_over_frequency::{GaitErrors, GaitOverFrequency};
use super::measurement::Measurement;

/// Frequencies of a curve.
const CURVE_POINTS: usize = 112;
/// Relative accuracy of a curve.
const CURVE_ACCURACY: f64 = 1e-8;

/// A motion, and how far its metrics may be off.
struct Predicted {
    solved: Result<(GaitMetrics, MotionStatus), MotionError>,
    /// How far its metrics may be off, or why that is not known.
    band: Result<Band, NoInterval>,
}

impl Predicted {
    /// Finds the motion from rest whatever was solved for before.
    fn solve(
        solver: &mut Solver,
        problem: Result<&Problem, MotionError>,
        accuracy: f64,
        bands: &Result<Bands, NoInterval>,
    ) -> Self {
        let solve = |problem: &Problem| {
            solver.forget();
            let metrics = solver.solve(problem, accuracy)?;
            let status = solver.status()?;
            let band = bands.as_ref().map_err(Clone::clone).and_then(|bands| {
                // Others go on from this motion.
                let band = bands.band(solver.clone(), problem, metrics);
                band.map_err(|error| without_resample(&error))
            });
            Ok((metrics, status, band))
        };
        match problem.and_then(solve) {
            Ok((metrics, status, band)) => Self { solved: Ok((metrics, status)), band },
            Err(error) => Self { band: Err(NoIntervalReason::NoMotion.into()), solved: Err(error) },
        }
    }
}

/// Rows of `predictions.parquet` for one model of one campaign.
pub(super) fn predictions(
    input: &FitInput,
    point: &FittedPoint,
    robot: &Robot,
    bands: &Result<Bands, NoInterval>,
) -> Vec<PredictionRow> {
    let objective = point.evaluator.objective;
    let (campaign, model, conditions) = (&input.campaign.name, &input.model, &objective.conditions);
    // Of a motion, or of one nearby with these metrics.
    let row = |trial: &str,
               omega_rad_s,
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
            Ok(band) => (band.limits(&metrics, &errors_rad), None),
            Err(why) => ([GaitMetrics::MISSING; 2], Some(why.clone())),
        };
        PredictionRow {
            campaign: campaign.clone(),
            model: model.name,
            trial: trial.to_owned(),
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
        let (trial, source) = (&measurement.trial, PredictionSource::Trial);
        row(trial, omega_rad_s, source, j, predicted, own, errors_rad, *from_rest)
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
            row("", omega_rad_s, source, j, &predicted, None, errors_rad, None)
        };
        let points = (0..CURVE_POINTS).into_par_iter();
        rows.par_extend(points.map_init(Solver::default, on_curve));
    }
    rows
}

/// Rows of `residuals.parquet` of some measurements, which the first predictions are of in their order:
/// of every metric that was measured.
pub(super) fn residuals(
    measurements: &[Measurement],
    predictions: &[PredictionRow],
) -> Vec<ResidualRow> {
    let of_trial = |(measurement, row): (&Measurement, &PredictionRow)| {
        let (measured, errors, predicted) = (measurement.metrics, measurement.errors, row.metrics);
        let row = row.clone();
        let known = Metric::FITTED.into_iter().filter(move |of| measured[*of].is_finite());
        known.map(move |metric| {
            let residual = measured[metric] - predicted[metric];
            ResidualRow {
                campaign: row.campaign.clone(),
                model: row.model,
                trial: row.trial.clone(),
                omega_rad_s: row.omega_rad_s,
                metric: metric.column().to_owned(),
                measured: measured[metric],
                predicted: predicted[metric],
                residual,
                standard_error: errors[metric],
                residual_standard_errors: if errors[metric] > 0.0 {
                    residual / errors[metric]
                } else {
                    f64::NAN
                },
            }
        })
    };
    measurements.iter().zip(predictions).flat_map(of_trial).collect()
}
