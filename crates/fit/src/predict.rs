//! Predictions of a fitted model at the frequencies of the trials and between them.

use rayon::prelude::*;
use trilink_mechanics::{MotionError, MotionStatus, Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::metrics::{ByFitted, GaitMetrics, Metric};
use trilink_tables::{
    Columns as _, NoInterval, NoIntervalReason, PredictionRow, PredictionSource, ResidualRow,
};

use super::FitInput;
use super::bands::{Band, Bands, without_resample};
use super::fitted_point::FittedPoint;
use super::gait_over_frequency::{GaitErrors, GaitOverFrequency, UNKNOWN};
use super::measurement::Measurement;
use super::robots::Robots;

/// Number of frequencies on a prediction curve.
const CURVE_POINTS: usize = 112;
/// Relative accuracy of the metrics on a prediction curve.
const CURVE_ACCURACY: f64 = 1e-8;

/// Predicted steady-state motion with the uncertainty of its metrics.
struct Predicted {
    solved: Result<(GaitMetrics, MotionStatus), MotionError>,
    /// Uncertainty of the metrics, or the reason why there is none.
    band: Result<Band, NoInterval>,
}

impl Predicted {
    /// Solves for the steady-state motion with a cold start from rest, independently of the solver's earlier solutions.
    fn solve(
        solver: &mut Solver,
        problem: Result<&Problem, MotionError>,
        accuracy: f64,
        bands: &Result<Bands, NoInterval>,
    ) -> Self {
        let solved = problem.and_then(|problem| {
            solver.forget();
            let metrics = solver.solve(problem, accuracy)?;
            Ok((problem, metrics, solver.status()?))
        });
        match solved {
            Ok((problem, metrics, status)) => {
                // The bands continue from this solution with a separate copy of the solver.
                let band = bands.as_ref().map_err(Clone::clone).and_then(|bands| {
                    let band = bands.band(solver.clone(), problem, metrics);
                    band.map_err(|error| without_resample(&error))
                });
                Self { solved: Ok((metrics, status)), band }
            }
            Err(error) => Self { band: Err(NoIntervalReason::NoMotion.into()), solved: Err(error) },
        }
    }

    /// Returns a copy of `blank` with the values of this prediction filled in. `own`, if given, are the metrics of a
    /// trial with nearly the same motion, and replace those of this motion. `errors_rad` are the standard errors of the
    /// gait parameters.
    fn row(
        &self,
        blank: &PredictionRow,
        own: Option<GaitMetrics>,
        errors_rad: &GaitErrors,
    ) -> PredictionRow {
        let (metrics, status) = match &self.solved {
            Ok((metrics, status)) => (own.unwrap_or(*metrics), *status),
            Err(error) => (GaitMetrics::MISSING, error.status()),
        };
        let ([lower, upper], no_interval) = match &self.band {
            Ok(band) => (band.limits(&metrics, errors_rad), None),
            Err(why) => ([GaitMetrics::MISSING; 2], Some(why.clone())),
        };
        PredictionRow { metrics, lower, upper, no_interval, status, ..blank.clone() }
    }
}

/// Returns the rows of `predictions.parquet` for one model of one campaign.
pub(super) fn predictions(
    input: &FitInput,
    point: &FittedPoint,
    robots: &Robots,
    bands: &Result<Bands, NoInterval>,
) -> Vec<PredictionRow> {
    let blank = PredictionRow {
        campaign: input.campaign.name.clone(),
        model: input.model.name,
        ..PredictionRow::blank()
    };
    let mut rows = predictions_at_trials(point, robots, bands, &blank);
    if !input.model.value.is_of_trials() {
        rows.extend(predictions_on_curve(point, robots, bands, &blank));
    }
    rows
}

/// Returns the predictions for all trials, each at the trial's own frequency and gait.
fn predictions_at_trials(
    point: &FittedPoint,
    robots: &Robots,
    bands: &Result<Bands, NoInterval>,
    blank: &PredictionRow,
) -> Vec<PredictionRow> {
    let objective = point.evaluator.objective;
    let conditions = &objective.conditions;
    let by_condition: Vec<_> = conditions
        .all
        .par_iter()
        .map_init(Solver::default, |solver, condition| {
            let problem = objective.problem_of(robots, condition);
            let predicted = Predicted::solve(
                solver,
                problem.as_ref().map_err(Clone::clone),
                REFERENCE_ACCURACY,
                bands,
            );
            let solved = problem.ok().zip(predicted.solved.as_ref().ok());
            let from_rest =
                solved.map(|(problem, (metrics, _))| solver.from_rest(&problem, *metrics));
            (predicted, from_rest)
        })
        .collect();
    let trials = objective.measurements.iter().zip(&conditions.by_trial);
    trials
        .map(|(measurement, (condition, differences))| {
            let (predicted, from_rest) = &by_condition[*condition];
            let expansion = point.evaluator.expansions[*condition].as_ref();
            let own = predicted.solved.as_ref().ok().map(|(metrics, _)| {
                expansion.map_or(*metrics, |of| of.metrics_at(metrics, differences))
            });
            PredictionRow {
                trial: measurement.trial.clone(),
                omega_rad_s: measurement.omega_rad_s,
                source: PredictionSource::Trial,
                j: own.map_or(f64::NAN, |metrics| objective.contribution(measurement, &metrics)),
                from_rest: *from_rest,
                ..predicted.row(blank, own, &measurement.gait_errors_rad)
            }
        })
        .collect()
}

/// Returns the predictions at evenly spaced frequencies over the range covered by the trials.
fn predictions_on_curve(
    point: &FittedPoint,
    robots: &Robots,
    bands: &Result<Bands, NoInterval>,
    blank: &PredictionRow,
) -> Vec<PredictionRow> {
    let objective = point.evaluator.objective;
    let omegas = objective.measurements.iter().map(|measurement| measurement.omega_rad_s);
    let low = omegas.clone().fold(f64::INFINITY, f64::min);
    let high = omegas.fold(0.0, f64::max);
    let gaits = GaitOverFrequency::new(objective);
    let points = (0..CURVE_POINTS).into_par_iter();
    points
        .map_init(Solver::default, |solver, i| {
            let omega_rad_s = low + (high - low) * i as f64 / (CURVE_POINTS - 1) as f64;
            let driving = gaits.at(omega_rad_s);
            let problem =
                driving.map(|(gait, _)| objective.problem(robots.first(), gait, omega_rad_s));
            let problem = problem.as_ref().ok_or(MotionError::GaitUnknown);
            let predicted = Predicted::solve(solver, problem, CURVE_ACCURACY, bands);
            let errors_rad = driving.map_or(UNKNOWN, |(_, errors_rad)| errors_rad);
            PredictionRow {
                trial: String::new(),
                omega_rad_s,
                source: PredictionSource::Curve,
                j: f64::NAN,
                from_rest: None,
                ..predicted.row(blank, None, &errors_rad)
            }
        })
        .collect()
}

/// Returns the rows of `residuals.parquet`, one for every measured metric of every trial. `predictions` must begin with
/// one row for each of the `measurements`, in the same order.
pub(super) fn residuals(
    measurements: &[Measurement],
    predictions: &[PredictionRow],
    noises: &[ByFitted<f64>],
) -> Vec<ResidualRow> {
    let trials = measurements.iter().zip(predictions).zip(noises);
    trials
        .flat_map(|((measurement, row), noises)| {
            let known = Metric::FITTED.into_iter().filter(|i| measurement.metrics[*i].is_finite());
            known.map(|metric| ResidualRow {
                noise: noises[metric],
                ..residual(measurement, row, metric)
            })
        })
        .collect()
}

/// Returns the residual row for one metric of a trial.
fn residual(measurement: &Measurement, row: &PredictionRow, metric: Metric) -> ResidualRow {
    let measured = measurement.metrics[metric];
    let predicted = row.metrics[metric];
    let standard_error = measurement.errors[metric];
    let residual = measured - predicted;
    ResidualRow {
        campaign: row.campaign.clone(),
        model: row.model,
        trial: row.trial.clone(),
        omega_rad_s: row.omega_rad_s,
        metric: metric.column().to_owned(),
        measured,
        predicted,
        residual,
        standard_error,
        residual_standard_errors: if standard_error > 0.0 {
            residual / standard_error
        } else {
            f64::NAN
        },
        ..ResidualRow::blank()
    }
}
