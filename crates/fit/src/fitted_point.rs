//! The point of a fit, with its motions: refits begin there.

use rayon::prelude::*;
use trilink_mechanics::{FIT_ACCURACY, REFERENCE_ACCURACY};
use trilink_robot::metrics::{ByFitted, GaitMetrics};
use trilink_tables::FitStatus;

use super::conditions::GAIT_NUMBERS;
use super::least_absolute::Residual;
use super::measurement::Measurement;
use super::objective::{Evaluator, Observation};
use super::resample::DrawnTrial;
use super::resampler::Resampler;
use super::search::{Ended, Iterate};
use super::starts::Start;
use super::terms::{PENALTY, Response, Terms};
use super::trial_noise::TrialNoise;

/// Fall of the objective, relative to it, below which a refit has converged: far below what
/// resampling moves it by.
const REFIT_TOLERANCE: f64 = 1e-5;

/// The point of a fit, with its motions.
#[derive(Clone)]
pub(super) struct FittedPoint<'o> {
    pub values: Vec<f64>,
    pub cost: f64,
    /// Of the conditions.
    pub responses: Vec<Option<Response>>,
    /// What a standard deviation of each number of the measured gaits makes of the metrics.
    pub gait_effects: Vec<Vec<ByFitted<f64>>>,
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
    pub(crate) fn fit(evaluator: &mut Evaluator, values: Vec<f64>, held: usize) -> Self {
        let iterate = Iterate::begin(evaluator, values).holding(held);
        let Iterate { values, cost, .. } =
            iterate.run(evaluator, REFIT_TOLERANCE, true, &Ended::default());
        Self { values, cost }
    }
}

impl<'o> FittedPoint<'o> {
    /// Solves for the motions of a fit with these values.
    pub(crate) fn new(mut evaluator: Evaluator<'o>, values: Vec<f64>) -> Self {
        evaluator.accuracy = REFERENCE_ACCURACY;
        let metrics = evaluator.metrics(&values);
        evaluator.add_second_order(&values);
        evaluator.expand(&metrics, evaluator.objective.is_driven_as_measured());
        let responses = evaluator.responses(&values, &metrics);
        evaluator.accuracy = FIT_ACCURACY;
        let cost = evaluator.terms.linearised(&responses).cost;
        let gait_effects = gait_effects(&evaluator);
        Self { values, cost, responses, gait_effects, evaluator }
    }

    /// Whether all motions exist.
    pub(crate) fn status(&self) -> FitStatus {
        let mut evaluator = self.evaluator.clone();
        evaluator.accuracy = REFERENCE_ACCURACY;
        evaluator.status(&self.values)
    }

    /// The fit of resampled measurements, from here.
    pub(crate) fn refit(&self, resample: &[DrawnTrial], ended: &Ended) -> Start {
        self.refit_to(self.observations(resample), ended)
    }

    fn refit_to(&self, observations: Vec<Observation>, ended: &Ended) -> Start {
        let mut evaluator = self.evaluator.of_others(observations);
        let at = evaluator.terms.linearised(&self.responses);
        let iterate = Iterate::from_linearised(self.values.clone(), at);
        let Iterate { values: ended, cost, stopped, .. } =
            iterate.run(&mut evaluator, REFIT_TOLERANCE, true, ended);
        Start { began: self.values.clone(), ended, cost, solves: evaluator.solves, stopped }
    }

    /// The metrics of a trial's motion, and those in the objective over its condition's.
    pub(crate) fn metrics_of(&self, trial: usize) -> Option<(GaitMetrics, ByFitted<f64>)> {
        let (condition, differences) = &self.evaluator.objective.conditions.of_trials[trial];
        let mut metrics = self.responses[*condition].as_ref()?.metrics;
        let ratios = self.evaluator.ratios(*condition, differences);
        ratios.iter().for_each(|(metric, ratio)| metrics[metric] *= ratio);
        Some((metrics, ratios))
    }

    /// Resampled measurements, with the motions of resampled gaits.
    fn observations(&self, resample: &[DrawnTrial]) -> Vec<Observation> {
        let objective = self.evaluator.objective;
        let observation = |drawn: &DrawnTrial| {
            let mut observation = objective.observation(drawn.index);
            observation.metrics = drawn.metrics;
            if objective.is_driven_as_measured() {
                let (condition, _) = objective.conditions.of_trials[drawn.index];
                let condition = &objective.conditions.all[condition];
                let moved = condition.gait_differences(&drawn.gait_steps_rad);
                let both = observation.differences.iter_mut().zip(moved);
                both.for_each(|(difference, moved)| *difference += moved);
            }
            observation
        };
        resample.iter().map(observation).collect()
    }

    /// The objective of resampled measurements.
    pub(crate) fn resampled_terms(&self, resample: &[DrawnTrial]) -> Terms {
        self.evaluator.terms_of(&self.observations(resample))
    }

    /// Their residuals, linearised here.
    pub(crate) fn resampled_residuals(&self, resample: &[DrawnTrial]) -> Vec<Residual> {
        self.resampled_terms(resample).residuals(&self.responses)
    }

    /// Standard deviations of the residuals of every measurement by noise: predicted less measured.
    pub(crate) fn noises(&self, resampler: &Resampler) -> Vec<ByFitted<f64>> {
        let of_trial = |((noise, spread), effects): ((&TrialNoise, ByFitted<f64>), &Vec<_>)| {
            ByFitted::from_fn(|i| {
                let by_gait: Vec<f64> = effects.iter().map(|of: &ByFitted<f64>| of[i]).collect();
                noise.deviation_of_residual(i, &by_gait).hypot(spread[i])
            })
        };
        resampler.noises_and_spreads().zip(&self.gait_effects).map(of_trial).collect()
    }

    /// What noise contributes to the objective before a fit.
    pub(crate) fn noise_cost(&self, resampler: &Resampler) -> f64 {
        let objective = self.evaluator.objective;
        let mut sums = vec![0.0; objective.protocols.len()];
        for (of, noises) in objective.measurements.iter().zip(self.noises(resampler)) {
            for (i, weight, measured) in objective.terms(of) {
                sums[of.campaign] += weight * noises[i] / measured;
            }
        }
        // Mean absolute value of a normal deviate.
        let mean = (2.0 / std::f64::consts::PI).sqrt();
        let counts = objective.trials_by_campaign(0..objective.measurements.len());
        sums.iter().zip(counts).map(|(sum, count)| mean * sum / count).sum()
    }

    /// How far the logarithms of other values are from these.
    pub(crate) fn shift_to(&self, values: &[f64]) -> Vec<f64> {
        values.iter().zip(&self.values).map(|(other, value)| (other / value).ln()).collect()
    }

    /// The fit without some measurements.
    pub(crate) fn refit_without(&self, left_out: &[usize]) -> Start {
        let mut observations = self.evaluator.objective.observations();
        observations.retain(|observation| !left_out.contains(&observation.trial));
        self.refit_to(observations, &Ended::default())
    }

    /// The parts of the objective.
    pub(crate) fn parts(&self) -> ByFitted<f64> {
        let measurements = &self.evaluator.objective.measurements;
        let sizes = self.evaluator.objective.campaign_sizes();
        let mut sums = ByFitted::splat(0.0);
        for (trial, measurement) in measurements.iter().enumerate() {
            let Some((metrics, _)) = self.metrics_of(trial) else { continue };
            let parts = self.evaluator.objective.parts(measurement, &metrics);
            for (metric, sum) in sums.iter_mut() {
                *sum += parts[metric] / sizes[trial];
            }
        }
        sums
    }

    /// Leave-one-frequency-out cross-validation: the objective with every frequency's trials
    /// predicted by the fit to the others, and the motions that were solved for. Missing with a
    /// single frequency.
    pub(crate) fn leave_one_frequency_out(&self) -> (f64, usize) {
        let measurements = &self.evaluator.objective.measurements;
        let frequencies = Measurement::frequencies(measurements);
        if frequencies.len() < 2 {
            return (f64::NAN, 0);
        }
        let without = |left_out: &Vec<usize>| -> (f64, usize) {
            let (cost, solves) = self.predicted(left_out);
            (cost * left_out.len() as f64, solves)
        };
        let each: Vec<(f64, usize)> = frequencies.par_iter().map(without).collect();
        let cost: f64 = each.iter().map(|(cost, _)| cost).sum();
        (cost / measurements.len() as f64, each.iter().map(|(_, solves)| solves).sum())
    }

    /// The upper third of the frequencies predicted by the fit to the others: its objective, the
    /// highest frequency that was fitted, and the motions that were solved for. Missing where
    /// fewer than two are predicted, or no more are fitted than parameters are free.
    pub(crate) fn extrapolated(&self) -> ([f64; 2], usize) {
        let measurements = &self.evaluator.objective.measurements;
        let frequencies = Measurement::frequencies(measurements);
        let (below, above) = frequencies.split_at(frequencies.len() - frequencies.len() / 3);
        match below.last().and_then(|trials| trials.last()) {
            Some(&last) if above.len() >= 2 && below.len() > self.values.len() => {
                let (cost, solves) = self.predicted(&above.concat());
                ([cost, measurements[last].frequency_rad_s], solves)
            }
            _ => ([f64::NAN; 2], 0),
        }
    }

    /// The objective of some measurements by the fit to the others, and the motions that were
    /// solved for.
    fn predicted(&self, left_out: &[usize]) -> (f64, usize) {
        let (values, solves) = if self.evaluator.parameters.is_empty() {
            (Vec::new(), 0)
        } else {
            let refit = self.refit_without(left_out);
            (refit.ended, refit.solves)
        };
        let at = |trial: &usize| self.evaluator.objective.observation(*trial);
        let mut evaluator = self.evaluator.of_others(left_out.iter().map(at).collect());
        (evaluator.cost(&values).min(PENALTY), solves + evaluator.solves)
    }
}

/// What one standard deviation of each number of a trial's measured gait makes of its metrics; nothing
/// where the command drives the model.
fn gait_effects(evaluator: &Evaluator) -> Vec<Vec<ByFitted<f64>>> {
    let objective = evaluator.objective;
    let of_trial = |trial: usize| -> Vec<ByFitted<f64>> {
        let deviations_rad = objective.measurements[trial].gait_deviations_rad();
        let (condition, _) = objective.conditions.of_trials[trial];
        let effect = |number: usize| match &evaluator.expansions[condition] {
            // Where the neighbouring motions do not exist nothing is known.
            Some(expansion) if deviations_rad.as_flattened()[number].is_finite() => {
                expansion.effect(1 + number, deviations_rad.as_flattened()[number])
            }
            _ => ByFitted::splat(0.0),
        };
        (0..GAIT_NUMBERS).map(effect).collect()
    };
    match objective.is_driven_as_measured() {
        true => (0..objective.measurements.len()).map(of_trial).collect(),
        false => vec![Vec::new(); objective.measurements.len()],
    }
}
