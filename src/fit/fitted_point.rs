//! The point of a fit, with its motions: refits begin there.

use rayon::prelude::*;

use super::least_absolute::Residual;
use super::measurement::Measurement;
use super::objective::{Evaluator, GAIT_NUMBERS, PENALTY, Response, TERMS};
use super::resample::Resample;
use super::search::{Ended, Iterate};
use super::starts::Start;
use crate::metrics::GaitMetrics;
use crate::motion::{FIT_ACCURACY, REFERENCE_ACCURACY};
use crate::store::FitStatus;

/// Fall of the objective, relative to it, below which a refit has converged: far below what
/// resampling moves it by.
const REFIT_TOLERANCE: f64 = 1e-5;

/// The point of a fit, with its motions.
#[derive(Clone)]
pub(super) struct FittedPoint<'o> {
    pub values: Vec<f64>,
    pub cost: f64,
    responses: Vec<Option<Response>>,
    /// What a standard error of each number of the measured gaits makes of the metrics.
    pub gait_effects: Vec<Vec<[f64; TERMS]>>,
    /// Its motions start from the fit's.
    pub evaluator: Evaluator<'o>,
}

/// The fit with one parameter held.
#[derive(Debug, Clone)]
pub(super) struct HeldPoint {
    /// All free parameters.
    pub values: Vec<f64>,
    pub cost: f64,
}

impl HeldPoint {
    /// From values nearby.
    pub fn fit(evaluator: &mut Evaluator, values: Vec<f64>, held: usize) -> Self {
        let iterate = Iterate::begin(evaluator, values).holding(held);
        let Iterate { values, cost, .. } =
            iterate.run(evaluator, REFIT_TOLERANCE, true, &Ended::default());
        Self { values, cost }
    }
}

impl<'o> FittedPoint<'o> {
    /// Solves for the motions of a fit with these values.
    pub fn new(mut evaluator: Evaluator<'o>, values: Vec<f64>) -> Self {
        evaluator.accuracy = REFERENCE_ACCURACY;
        let metrics = evaluator.metrics(&values);
        let responses = evaluator.responses(&values, &metrics);
        let gait_effects = evaluator.gait_effects(&values);
        evaluator.accuracy = FIT_ACCURACY;
        let cost = evaluator.objective.linearised(responses.iter().map(Option::as_ref)).cost;
        Self { values, cost, responses, gait_effects, evaluator }
    }

    /// Whether all motions exist.
    pub fn status(&self) -> FitStatus {
        let mut evaluator = self.evaluator.clone();
        evaluator.accuracy = REFERENCE_ACCURACY;
        evaluator.status(&self.values)
    }

    /// The fit of resampled measurements, from here.
    pub fn refit(&self, resample: Resample, ended: &Ended) -> Start {
        let Resample { indices, measurements, .. } = resample;
        let mut evaluator = self.evaluator.of_others(measurements, &indices);
        let at = match evaluator.objective.is_driven_as_measured() {
            true => evaluator.linearised(&self.values),
            false => {
                let responses = indices.iter().map(|&index| self.responses[index].as_ref());
                evaluator.objective.linearised(responses)
            }
        };
        let iterate = Iterate::from_linearised(self.values.clone(), at);
        let Iterate { values: ended, cost, stopped, .. } =
            iterate.run(&mut evaluator, REFIT_TOLERANCE, true, ended);
        Start { began: self.values.clone(), ended, cost, solves: evaluator.solves, stopped }
    }

    /// The residuals, linearised here.
    pub fn residuals(&self) -> Vec<Residual> {
        self.evaluator.objective.linearised(self.responses.iter().map(Option::as_ref)).residuals
    }

    /// The residuals of resampled measurements, linearised here.
    pub fn resampled_residuals(&self, resample: Resample) -> Vec<Residual> {
        let Resample { indices, measurements, gait_moves } = resample;
        let moved = |(&index, moves): (&usize, &[f64; GAIT_NUMBERS])| {
            let mut response = self.responses[index].clone()?;
            let mut metrics = response.metrics.to_array();
            for (effect, moved) in self.gait_effects[index].iter().zip(moves) {
                metrics
                    .iter_mut()
                    .zip(effect)
                    .for_each(|(metric, effect)| *metric += moved * effect);
            }
            response.metrics = GaitMetrics::from_array(metrics);
            Some(response)
        };
        let responses: Vec<Option<Response>> = indices.iter().zip(&gait_moves).map(moved).collect();
        let objective = self.evaluator.objective.with_measurements(measurements);
        objective.linearised(responses.iter().map(Option::as_ref)).residuals
    }

    /// What noise of these standard deviations contributes to the objective before a fit.
    pub fn noise_cost(&self, noises: &[[f64; TERMS]]) -> f64 {
        let measurements = &self.evaluator.objective.measurements;
        let both = measurements.iter().zip(noises).zip(&self.gait_effects);
        let sum: f64 = both
            .flat_map(|((measurement, noises), effects)| {
                let terms = self.evaluator.objective.terms(measurement);
                terms.map(|(i, weight, measured)| {
                    let by_gait = effects.iter().map(|effect| effect[i].powi(2)).sum::<f64>();
                    weight * (noises[i].powi(2) + by_gait).sqrt() / measured
                })
            })
            .sum();
        // Mean absolute value of a normal deviate.
        let mean = (2.0 / std::f64::consts::PI).sqrt();
        mean * sum / measurements.len() as f64
    }

    /// How far the logarithms of other values are from these.
    pub fn shift_to(&self, values: &[f64]) -> Vec<f64> {
        values.iter().zip(&self.values).map(|(other, value)| (other / value).ln()).collect()
    }

    /// The fit without some measurements.
    pub fn refit_without(&self, left_out: &[usize]) -> Start {
        let measurements = &self.evaluator.objective.measurements;
        let all = 0..measurements.len();
        let indices: Vec<usize> = all.filter(|index| !left_out.contains(index)).collect();
        let measurements = indices.iter().map(|&index| measurements[index].clone()).collect();
        let resample = Resample { indices, measurements, ..Resample::default() };
        self.refit(resample, &Ended::default())
    }

    /// The parts of the objective: of d, v, the wheels' sigma and alpha_1.
    pub fn parts(&self) -> [f64; TERMS] {
        let measurements = &self.evaluator.objective.measurements;
        let mut sums = [0.0; TERMS];
        for (measurement, response) in measurements.iter().zip(&self.responses) {
            let Some(response) = response else { continue };
            let parts = self.evaluator.objective.parts(measurement, &response.metrics);
            for (sum, part) in sums.iter_mut().zip(parts) {
                *sum += part / measurements.len() as f64;
            }
        }
        sums
    }

    /// Leave-one-frequency-out cross-validation: the objective with every frequency's trials
    /// predicted by the fit to the others, and the motions that were solved for. Missing with a
    /// single frequency.
    pub fn leave_one_frequency_out(&self) -> (f64, usize) {
        let measurements = &self.evaluator.objective.measurements;
        let frequencies = Measurement::frequencies(measurements);
        if frequencies.len() < 2 {
            return (f64::NAN, 0);
        }
        let at = |index: &usize| measurements[*index].clone();
        let without = |left_out: &Vec<usize>| -> (f64, usize) {
            let (values, mut solves) = if self.evaluator.parameters.is_empty() {
                (Vec::new(), 0)
            } else {
                let refit = self.refit_without(left_out);
                (refit.ended, refit.solves)
            };
            let mut evaluator =
                self.evaluator.of_others(left_out.iter().map(at).collect(), left_out);
            let cost = evaluator.cost(&values).min(PENALTY);
            solves += evaluator.solves;
            (cost * left_out.len() as f64, solves)
        };
        let each: Vec<(f64, usize)> = frequencies.par_iter().map(without).collect();
        let cost: f64 = each.iter().map(|(cost, _)| cost).sum();
        (cost / measurements.len() as f64, each.iter().map(|(_, solves)| solves).sum())
    }
}
