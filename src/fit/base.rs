//! A fit that others go on from: its motions are known.

use rayon::prelude::*;

use super::coefficient::Parameter;
use super::doubled::Doubled;
use super::measurement::Measurement;
use super::objective::{Evaluator, Linearised, Objective, PENALTY, Response, TERMS};
use super::resample::Resample;
use super::search::{Come, Descent};
use super::starts::{Start, search_from};
use crate::motion::{FIT_ACCURACY, REFERENCE_ACCURACY};

/// Fall of the objective, relative to it, below which a search that starts from the fit has
/// converged: far below what resampling moves it by.
const NEAR: f64 = 1e-5;

/// A fit with its motions.
pub(super) struct Base<'o> {
    pub values: Vec<f64>,
    pub cost: f64,
    responses: Vec<Option<Response>>,
    evaluator: Evaluator<'o>,
}

/// Where a search from the fit ended.
pub(super) struct Near {
    pub values: Vec<f64>,
    pub cost: f64,
    pub solves: usize,
    pub stopped: &'static str,
}

impl<'o> Base<'o> {
    /// Solves for the motions of a fit.
    pub fn new(objective: &'o Objective, parameters: &[Parameter], values: Vec<f64>) -> Self {
        let evaluator = objective.evaluator(parameters.to_vec());
        let unknown = Self { values: Vec::new(), cost: f64::NAN, responses: Vec::new(), evaluator };
        unknown.moved_to(values)
    }

    /// The fit with other values.
    pub fn moved_to(&self, values: Vec<f64>) -> Self {
        let mut evaluator = self.evaluator.clone();
        evaluator.accuracy = REFERENCE_ACCURACY;
        let responses = evaluator.responses(&values);
        evaluator.accuracy = FIT_ACCURACY;
        let cost = evaluator.objective.linearised(responses.iter().map(Option::as_ref)).cost;
        Self { values, cost, responses, evaluator }
    }

    /// `ok`, or which motion does not exist and why.
    pub fn status(&self) -> String {
        if self.responses.iter().all(Option::is_some) {
            return "ok".to_owned();
        }
        let mut evaluator = self.evaluator();
        evaluator.accuracy = REFERENCE_ACCURACY;
        evaluator.status(&self.values)
    }

    pub fn objective(&self) -> &Objective {
        &self.evaluator.objective
    }

    pub fn parameters(&self) -> &[Parameter] {
        &self.evaluator.parameters
    }

    /// An evaluator the motions of which start from the fit's.
    pub fn evaluator(&self) -> Evaluator<'o> {
        self.evaluator.clone()
    }

    /// The fit of resampled measurements, from here.
    pub fn refit(&self, resample: Resample) -> Near {
        let Resample { places, measurements } = resample;
        let mut evaluator = self.evaluator.of_others(measurements, &places);
        let responses = places.iter().map(|&place| self.responses[place].as_ref());
        let here = evaluator.objective.linearised(responses);
        let mut descent = Descent::from(&mut evaluator, self.values.clone(), here);
        let has_converged = descent.run(NEAR);
        let stopped = descent.stopped(has_converged);
        let Come { place: values, cost, .. } = descent.come;
        Near { values, cost, solves: evaluator.solves(), stopped }
    }

    /// The objective of resampled measurements, its terms linearised here.
    pub fn linearised(&self, resample: Resample) -> Linearised {
        let objective = self.objective().with_measurements(resample.measurements);
        let responses = resample.places.iter().map(|&place| self.responses[place].as_ref());
        objective.linearised(responses)
    }

    /// The fit with one parameter held, from what is known nearby.
    pub fn refit_holding(
        evaluator: &mut Evaluator<'o>,
        values: Vec<f64>,
        held: usize,
    ) -> (Vec<f64>, f64) {
        let mut descent = Descent::new(evaluator, values).holding(held);
        descent.run(NEAR);
        (descent.come.place, descent.come.cost)
    }

    /// The fit of another objective, from here.
    pub fn refit_otherwise(&self, objective: &Objective) -> Start {
        search_from(objective.evaluator(self.parameters().to_vec()), self.values.clone())
    }

    /// How the results of resamples are to be corrected; `noises` are the measurements' own.
    pub fn doubled(&self, noises: &[[f64; TERMS]]) -> Doubled {
        let measurements = self.objective().measurements();
        let sum: f64 = measurements
            .iter()
            .zip(noises)
            .flat_map(|(measurement, noises)| {
                let terms = self.objective().terms(measurement);
                terms.map(|(i, weight, measured)| weight * noises[i] / measured)
            })
            .sum();
        // Mean absolute value of a normal deviate.
        let mean = (2.0 / std::f64::consts::PI).sqrt();
        Doubled::new(self.cost, mean * sum / measurements.len() as f64)
    }

    /// The parts of the objective: of `d, v, sigma0, sigma1, sigma2, alpha1`.
    pub fn parts(&self) -> [f64; TERMS] {
        let measurements = self.objective().measurements();
        let mut sums = [0.0; TERMS];
        for (measurement, response) in measurements.iter().zip(&self.responses) {
            let Some(response) = response else { continue };
            let parts = self.objective().parts(measurement, &response.metrics);
            for (sum, part) in sums.iter_mut().zip(parts) {
                *sum += part / measurements.len() as f64;
            }
        }
        sums
    }

    /// The objective with every frequency's trials predicted by the fit to the others, and the
    /// motions that were solved for. Missing with a single frequency.
    pub fn left_out(&self) -> (f64, usize) {
        let measurements = self.objective().measurements();
        let frequencies = Measurement::frequencies(measurements);
        if frequencies.len() < 2 {
            return (f64::NAN, 0);
        }
        let without = |left_out: &Vec<usize>| -> (f64, usize) {
            let (values, mut solves) = if self.parameters().is_empty() {
                (Vec::new(), 0)
            } else {
                let places: Vec<usize> =
                    (0..measurements.len()).filter(|place| !left_out.contains(place)).collect();
                let kept = places.iter().map(|&place| measurements[place].clone()).collect();
                let near = self.refit(Resample { places, measurements: kept });
                (near.values, near.solves)
            };
            let alone = left_out.iter().map(|&place| measurements[place].clone()).collect();
            let mut evaluator = self.evaluator.of_others(alone, left_out);
            let cost = evaluator.cost(&values).min(PENALTY);
            solves += evaluator.solves();
            (cost * left_out.len() as f64, solves)
        };
        let each: Vec<(f64, usize)> = frequencies.par_iter().map(without).collect();
        let cost: f64 = each.iter().map(|(cost, _)| cost).sum();
        (cost / measurements.len() as f64, each.iter().map(|(_, solves)| solves).sum())
    }
}
