//! Fitted parameters with the model's periodic solutions, from which refits start.

use rayon::prelude::*;
use trilink_mechanics::{FIT_ACCURACY, REFERENCE_ACCURACY, Solver};
use trilink_robot::metrics::{ByFitted, GaitMetrics};

use super::conditions::GAIT_NUMBERS;
use super::input::FreeParameter;
use super::least_absolute::Residual;
use super::measurement::Measurement;
use super::objective::{Evaluator, Failure, Observation};
use super::resample::DrawnTrial;
use super::robots::Robots;
use super::search::{Ended, Iterate};
use super::starts::Start;
use super::terms::{PENALTY, Response, Terms};
use super::variation::Variation;

/// Relative decrease of the objective below which a refit has converged: much smaller than the changes due to
/// resampling.
const REFIT_TOLERANCE: f64 = 1e-5;

/// Fitted parameter values with the model's periodic solutions.
#[derive(Clone)]
pub(super) struct FittedPoint<'o> {
    pub values: Vec<f64>,
    pub cost: f64,
    /// Predicted metrics of each condition with their derivatives; `None` where the model has no periodic solution.
    pub responses: Vec<Option<Response>>,
    /// For each trial, changes in the metrics per standard deviation of each parameter of the measured gait.
    pub gait_effects: Vec<Vec<ByFitted<f64>>>,
    /// Evaluator whose solver starts from the periodic solutions of the fit.
    pub evaluator: Evaluator<'o>,
}

/// Fit with one parameter held fixed.
#[derive(Debug, Clone)]
pub(super) struct HeldPoint {
    /// Values of all free parameters, including the held one.
    pub values: Vec<f64>,
    pub cost: f64,
}

impl HeldPoint {
    /// Fits the parameters, starting from `values`, while the parameter at index `held` keeps its value.
    pub(crate) fn fit(evaluator: &mut Evaluator, values: Vec<f64>, held: usize) -> Self {
        let iterate = Iterate::new(evaluator, values).holding(held);
        let Iterate { values, cost, .. } =
            iterate.run(evaluator, REFIT_TOLERANCE, true, &Ended::default());
        Self { values, cost }
    }
}

impl<'o> FittedPoint<'o> {
    /// Creates the point by solving the model at the fitted parameter values.
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

    /// Checks that the model has a periodic solution for every trial.
    ///
    /// # Errors
    /// Returns an error for the first trial without a periodic solution.
    pub(crate) fn check_motions(&self) -> Result<(), Failure> {
        let mut evaluator = self.evaluator.clone();
        evaluator.accuracy = REFERENCE_ACCURACY;
        evaluator.check_motions(&self.values)
    }

    /// Fits a resample, starting from this point; `ended` counts finished searches.
    pub(crate) fn refit(&self, resample: &[DrawnTrial], ended: &Ended) -> Start {
        self.refit_to(self.observations(resample), ended)
    }

    fn refit_to(&self, observations: Vec<Observation>, ended: &Ended) -> Start {
        let mut evaluator = self.evaluator.with_observations(observations);
        let at = evaluator.terms.linearised(&self.responses);
        let iterate = Iterate::from_linearised(self.values.clone(), at);
        let Iterate { values: ended, cost, stopped, .. } =
            iterate.run(&mut evaluator, REFIT_TOLERANCE, true, ended);
        Start { began: self.values.clone(), ended, cost, solves: evaluator.solves, stopped }
    }

    /// Returns the predicted metrics of a trial, and their ratios to those of the trial's condition; `None` if the
    /// model has no periodic solution for this condition.
    pub(crate) fn metrics_of(&self, trial: usize) -> Option<(GaitMetrics, ByFitted<f64>)> {
        let (condition, differences) = &self.evaluator.objective.conditions.by_trial[trial];
        let mut metrics = self.responses[*condition].as_ref()?.metrics;
        let ratios = self.evaluator.ratios(*condition, differences);
        ratios.iter().for_each(|(metric, ratio)| metrics[metric] *= ratio);
        Some((metrics, ratios))
    }

    /// Returns copies of robots with the given values of the free parameters.
    pub(crate) fn with_values(&self, robots: &Robots, values: &[f64]) -> Robots {
        robots.with_values(&self.evaluator.parameters, values)
    }

    /// Solves the model of robots with the given values of the free parameters in every condition, and returns the
    /// metrics; `None` where there is no periodic solution.
    pub(crate) fn metrics_of_robots(
        &self,
        robots: &Robots,
        values: &[f64],
    ) -> Vec<Option<GaitMetrics>> {
        let objective = self.evaluator.objective;
        let robots = self.with_values(robots, values);
        let mut solvers = vec![Solver::default(); robots.len()];
        let conditions = objective.conditions.all.iter();
        conditions
            .map(|condition| {
                let problem = objective.problem_of(&robots, condition).ok()?;
                solvers[condition.campaign].solve(&problem, FIT_ACCURACY).ok()
            })
            .collect()
    }

    /// Returns the metrics of each condition with their derivatives with respect to the logarithms of the given
    /// `parameters`, which need not be the free ones; `None` where the model has no periodic solution.
    pub(crate) fn responses_to(&self, parameters: &[FreeParameter]) -> Vec<Option<Response>> {
        let objective = self.evaluator.objective;
        let robots = self.with_values(&objective.robots, &self.values);
        let values: Vec<f64> = parameters.iter().map(|of| robots.value(of.parameter)).collect();
        let metrics: Vec<Option<GaitMetrics>> =
            self.responses.iter().map(|response| response.as_ref().map(|of| of.metrics)).collect();
        let mut evaluator = self.evaluator.clone();
        evaluator.parameters = parameters.to_vec();
        evaluator.responses(&values, &metrics)
    }

    /// Returns the observations of a resample; where measured gaits drive the model, they include the resampled changes
    /// of the gaits.
    pub(crate) fn observations(&self, resample: &[DrawnTrial]) -> Vec<Observation> {
        let objective = self.evaluator.objective;
        let with_drawn = |drawn: &DrawnTrial| {
            let mut observation = objective.observation(drawn.index);
            observation.metrics = drawn.metrics;
            if objective.is_driven_as_measured() {
                let (condition, _) = objective.conditions.by_trial[drawn.index];
                let condition = &objective.conditions.all[condition];
                let steps = condition.gait_differences(&drawn.gait_steps_rad);
                for (difference, step) in observation.differences.iter_mut().zip(steps) {
                    *difference += step;
                }
            }
            observation
        };
        resample.iter().map(with_drawn).collect()
    }

    /// Returns the terms of the objective for a resample.
    pub(crate) fn resampled_terms(&self, resample: &[DrawnTrial]) -> Terms {
        self.evaluator.terms_of(&self.observations(resample))
    }

    /// Returns the residuals for a resample, linearised at this point.
    pub(crate) fn resampled_residuals(&self, resample: &[DrawnTrial]) -> Vec<Residual> {
        self.resampled_terms(resample).residuals(&self.responses)
    }

    /// Returns, for the metrics of every trial, the standard deviation of predicted minus measured due to noise.
    pub(crate) fn noises(&self, variation: &Variation) -> Vec<ByFitted<f64>> {
        let trials = self.gait_effects.iter().enumerate();
        trials
            .map(|(index, effects)| {
                let noise = variation.resampler.noise(index);
                let spread = variation.deviations(index);
                ByFitted::from_fn(|i| {
                    let gait_effects: Vec<f64> = effects.iter().map(|effect| effect[i]).collect();
                    noise.deviation_of_residual(i, &gait_effects).hypot(spread[i])
                })
            })
            .collect()
    }

    /// Returns the logarithms of the ratios of `values` to the fitted values.
    pub(crate) fn shift_to(&self, values: &[f64]) -> Vec<f64> {
        values.iter().zip(&self.values).map(|(other, value)| (other / value).ln()).collect()
    }

    /// Refits without the measurements at the given indices.
    pub(crate) fn refit_without(&self, left_out: &[usize]) -> Start {
        let mut observations = self.evaluator.objective.observations();
        observations.retain(|observation| !left_out.contains(&observation.trial));
        self.refit_to(observations, &Ended::default())
    }

    /// Returns the contribution of each metric to the objective.
    pub(crate) fn contributions(&self) -> ByFitted<f64> {
        let measurements = &self.evaluator.objective.measurements;
        let sizes = self.evaluator.objective.campaign_sizes();
        let mut sums = ByFitted::splat(0.0);
        for (trial, measurement) in measurements.iter().enumerate() {
            let Some((metrics, _)) = self.metrics_of(trial) else { continue };
            let contributions = self.evaluator.objective.contributions(measurement, &metrics);
            for (metric, sum) in sums.iter_mut() {
                *sum += contributions[metric] / sizes[trial];
            }
        }
        sums
    }

    /// Returns the leave-one-frequency-out cross-validation error and the number of periodic solutions computed. The
    /// error is the objective with the trials at each frequency predicted by the fit to all other frequencies; NaN if
    /// there is only one frequency.
    pub(crate) fn leave_one_frequency_out(&self) -> (f64, usize) {
        let measurements = &self.evaluator.objective.measurements;
        let frequencies = Measurement::frequencies(measurements);
        if frequencies.len() < 2 {
            return (f64::NAN, 0);
        }
        let each: Vec<(f64, usize)> = frequencies
            .par_iter()
            .map(|left_out| {
                let (cost, solves) = self.prediction_error(left_out);
                (cost * left_out.len() as f64, solves)
            })
            .collect();
        let cost: f64 = each.iter().map(|(cost, _)| cost).sum();
        (cost / measurements.len() as f64, each.iter().map(|(_, solves)| solves).sum())
    }

    /// Returns the extrapolation error (objective for the upper third of the frequencies, predicted by a fit to the
    /// rest), the highest fitted frequency (rad/s), and the number of periodic solutions computed. Error and frequency
    /// are NaN if the upper third has fewer than two frequencies or the rest do not outnumber the free parameters.
    pub(crate) fn extrapolated(&self) -> ([f64; 2], usize) {
        let measurements = &self.evaluator.objective.measurements;
        let frequencies = Measurement::frequencies(measurements);
        let (below, above) = frequencies.split_at(frequencies.len() - frequencies.len() / 3);
        match below.last().and_then(|trials| trials.last()) {
            Some(&last) if above.len() >= 2 && below.len() > self.values.len() => {
                let (cost, solves) = self.prediction_error(&above.concat());
                ([cost, measurements[last].frequency_rad_s], solves)
            }
            _ => ([f64::NAN; 2], 0),
        }
    }

    /// Fits the model without the measurements at the given indices. Returns the objective of these measurements, and
    /// the number of periodic solutions computed.
    fn prediction_error(&self, left_out: &[usize]) -> (f64, usize) {
        let (values, solves) = if self.evaluator.parameters.is_empty() {
            (Vec::new(), 0)
        } else {
            let refit = self.refit_without(left_out);
            (refit.ended, refit.solves)
        };
        let objective = self.evaluator.objective;
        let observations = left_out.iter().map(|trial| objective.observation(*trial)).collect();
        let mut evaluator = self.evaluator.with_observations(observations);
        (evaluator.cost(&values).min(PENALTY), solves + evaluator.solves)
    }
}

/// Returns the changes in each trial's metrics per standard deviation of each parameter of its measured gait; empty
/// where the command drives the model.
fn gait_effects(evaluator: &Evaluator) -> Vec<Vec<ByFitted<f64>>> {
    let objective = evaluator.objective;
    let trials = 0..objective.measurements.len();
    if objective.is_driven_as_measured() {
        trials.map(|trial| gait_effects_of_trial(evaluator, trial)).collect()
    } else {
        vec![Vec::new(); trials.len()]
    }
}

/// Returns the changes in a trial's metrics per standard deviation of each parameter of its measured gait.
fn gait_effects_of_trial(evaluator: &Evaluator, trial: usize) -> Vec<ByFitted<f64>> {
    let objective = evaluator.objective;
    let deviations_rad = objective.measurements[trial].gait_deviations_rad();
    let (condition, _) = objective.conditions.by_trial[trial];
    (0..GAIT_NUMBERS)
        .map(|number| match &evaluator.expansions[condition] {
            // Without an expansion of the metrics, the effect is unknown and taken as zero.
            Some(expansion) if deviations_rad.as_flattened()[number].is_finite() => {
                expansion.effect(1 + number, deviations_rad.as_flattened()[number])
            }
            _ => ByFitted::splat(0.0),
        })
        .collect()
}
