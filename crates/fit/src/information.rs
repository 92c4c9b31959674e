//! What single trials tell of a fitted model's coefficients, to first order: those that were fitted,
//! and any other that could be made. How well that would measure is a power of its frequency
//! ([`super::tell_apart`]).

use rayon::prelude::*;
use trilink_mechanics::{FIT_ACCURACY, Problem, Solver};
use trilink_robot::metrics::{ByFitted, ByMetric, GaitMetrics, Metric};
use trilink_robot::{Gait, JointCommand, Robot};
use trilink_tables::{Columns as _, Extrapolation};

use super::fitted_point::FittedPoint;
use super::gait_over_frequency::GaitOverFrequency;
use super::input::FreeParameter;
use super::least_absolute::{Residual, minimise};
use super::measured_range::MeasuredRange;
use super::measurement::Measurement;
use super::resampler::Resampler;
use super::search::limits;
use super::tell_apart::Noise;
use super::terms::Response;

/// What one trial tells, relative to its metrics.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialInformation {
    pub metrics: GaitMetrics,
    /// Weights in the objective; zero of what is not measured.
    pub weights: ByFitted<f64>,
    /// Changes of the metrics with the logarithm of each free parameter.
    pub slopes: Vec<ByFitted<f64>>,
    /// Standard deviations of what a measurement is off by. d and v are one measurement.
    pub noise: ByFitted<f64>,
    /// Changes with a standard error of each number of the measured gait.
    pub by_gait: Vec<ByFitted<f64>>,
    /// Changes with each of the robot's uncertain numbers off by its standard deviation.
    pub by_assumed: Vec<ByFitted<f64>>,
}

/// Trials of a fitted model.
pub struct FitInformation<'f> {
    point: &'f FittedPoint<'f>,
    resampler: &'f Resampler,
    /// Shifts of the logarithms of the free parameters.
    replicates: &'f [Vec<f64>],
    others: &'f [Robot],
    gaits: GaitOverFrequency,
    noise: Noise,
    /// Metrics that any trial has.
    measured: ByFitted<bool>,
}

impl<'f> FitInformation<'f> {
    pub(super) fn new(
        point: &'f FittedPoint<'f>,
        resampler: &'f Resampler,
        replicates: &'f [Vec<f64>],
        others: &'f [Robot],
    ) -> Self {
        let objective = point.evaluator.objective;
        let has = |metric: Metric| {
            let mut terms = objective.measurements.iter().flat_map(|of| objective.terms(of));
            terms.any(|(of, ..)| of == metric)
        };
        Self {
            point,
            resampler,
            replicates,
            others,
            gaits: GaitOverFrequency::new(objective),
            noise: Noise::new(resampler),
            measured: ByFitted::from_fn(has),
        }
    }

    /// The free parameters, and their fitted values.
    pub fn free(&self) -> impl Iterator<Item = (&FreeParameter, f64)> {
        self.point.evaluator.parameters.iter().zip(self.point.values.iter().copied())
    }

    /// What the logarithms of the free parameters are shifted by in each replicate.
    pub fn replicates(&self) -> &[Vec<f64>] {
        self.replicates
    }

    /// The gait that is commanded.
    pub fn command(&self) -> Gait {
        self.point.evaluator.objective.protocols[0].gait
    }

    /// Whether the measured gait drives the model.
    pub(crate) fn is_driven_as_measured(&self) -> bool {
        self.point.evaluator.objective.is_driven_as_measured()
    }

    /// Lowest and highest frequency of the trials, rad/s.
    pub fn range_rad_s(&self) -> [f64; 2] {
        trilink_statistics::extremes(self.measurements().iter().map(|of| of.omega_rad_s))
    }

    /// Whether a trial with a commanded gait at a frequency is beyond those that were fitted.
    pub fn extrapolation(&self, command: Gait, omega_rad_s: f64) -> Extrapolation {
        let objective = self.point.evaluator.objective;
        let problem = objective.problem(&objective.robot, command, omega_rad_s);
        let range = MeasuredRange::new(self.measurements(), &self.command());
        range.map_or_else(Extrapolation::blank, |range| range.extrapolation(&problem))
    }

    fn measurements(&self) -> &[Measurement] {
        &self.point.evaluator.objective.measurements
    }

    fn values(&self, shifts: &[f64]) -> Vec<f64> {
        let both = self.point.values.iter().zip(shifts);
        both.map(|(value, shift)| value * shift.exp()).collect()
    }

    /// The trials that were fitted, at these shifts of the coefficients' logarithms; those are left out
    /// of which the model has no motion there. With `assumed` also what the robot's uncertain numbers
    /// make of them.
    pub fn trials(&self, shifts: &[f64], assumed: bool) -> Vec<TrialInformation> {
        let objective = self.point.evaluator.objective;
        let values = self.values(shifts);
        let mut evaluator = self.point.evaluator.clone();
        let metrics = evaluator.metrics(&values);
        let responses = evaluator.responses(&values, &metrics);
        let others = if assumed { self.others } else { &[] };
        let conditions = &objective.conditions;
        let assumed: Vec<Vec<Option<GaitMetrics>>> = others
            .par_iter()
            .map(|other| {
                let mut solver = Solver::default();
                let mut of = |condition| {
                    let robot = self.with_values(other, &values);
                    let problem = objective.problem_of(&robot, condition).ok()?;
                    solver.solve(&problem, FIT_ACCURACY).ok()
                };
                conditions.all.iter().map(&mut of).collect()
            })
            .collect();
        let noises = self.resampler.noises();
        let of_trial = |(trial, measurement): (usize, &Measurement)| {
            let (condition, _) = conditions.of_trials[trial];
            let response = responses[condition].as_ref()?;
            let mut weights = ByFitted::splat(0.0);
            objective.terms(measurement).for_each(|(metric, weight, _)| weights[metric] = weight);
            let own = measurement.metrics;
            let by_gait = &self.point.gait_effects[trial];
            let relative = |of: &ByFitted<f64>| ByFitted::from_fn(|i| known(of[i] / own[i]));
            Some(TrialInformation {
                metrics: response.metrics,
                weights,
                slopes: slopes(response),
                noise: relative(&noises[trial]),
                by_gait: by_gait.iter().map(relative).collect(),
                by_assumed: assumed
                    .iter()
                    .map(|of| changes(&response.metrics, of[condition].as_ref()))
                    .collect(),
            })
        };
        self.measurements().iter().enumerate().filter_map(of_trial).collect()
    }

    /// A trial with a commanded gait at a frequency, at these shifts; `None` where it has no stable motion.
    pub fn candidate(
        &self,
        command: Gait,
        omega_rad_s: f64,
        shifts: &[f64],
        assumed: bool,
    ) -> Option<TrialInformation> {
        let mut solver = Solver::default();
        let objective = self.point.evaluator.objective;
        let robot = self.with_values(&objective.robot, &self.values(shifts));
        let gait = self.driven_by(command, omega_rad_s)?;
        let problem = objective.problem(&robot, gait, omega_rad_s);
        let metrics = solver.solve(&problem, FIT_ACCURACY).ok()?;
        if !solver.status().ok()?.is_stable() {
            return None;
        }
        let free: Vec<_> = self.free().map(|(free, _)| free.parameter).collect();
        let by_gait = match self.is_driven_as_measured() {
            true => self.gait_effects(&mut solver, &metrics, omega_rad_s)?,
            false => Vec::new(),
        };
        let response = Response::of_last(&mut solver, metrics, &robot, &free).ok()?;
        let noise = self.noise.at(omega_rad_s);
        let weights = objective.protocols[0].term_weights();
        let is_measured = |i: Metric| self.measured[i] && noise[i] > 0.0;
        let others = if assumed { self.others } else { &[] };
        let by_assumed = others.iter().map(|other| {
            let problem =
                Problem { robot: self.with_values(other, &self.values(shifts)), ..problem.clone() };
            changes(&metrics, solver.solve(&problem, FIT_ACCURACY).ok().as_ref())
        });
        Some(TrialInformation {
            metrics,
            weights: ByFitted::from_fn(|i| if is_measured(i) { weights[i] } else { 0.0 }),
            slopes: slopes(&response),
            noise: noise.map(known),
            by_gait,
            by_assumed: by_assumed.collect(),
        })
    }

    /// What the nearest trial's standard errors of the measured gait make of the metrics of the motion
    /// that was solved for last.
    fn gait_effects(
        &self,
        solver: &mut Solver,
        metrics: &GaitMetrics,
        omega_rad_s: f64,
    ) -> Option<Vec<ByFitted<f64>>> {
        let derivatives = solver.derivatives().ok()?.gait;
        let distance = |of: &Measurement| (of.omega_rad_s / omega_rad_s).ln().abs();
        let nearest = self.measurements().iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let errors_rad = nearest.map_or([[0.0; 3]; 2], |of| of.gait_errors_rad);
        let both = derivatives.as_flattened().iter().zip(errors_rad.as_flattened());
        let effect = |(of, error_rad): (&GaitMetrics, &f64)| {
            ByFitted::from_fn(|i| known(of[i] * error_rad / metrics[i]))
        };
        Some(both.map(effect).collect())
    }

    /// The gait that drives the model under a command: where it is measured, the command and what the
    /// measured ones differ by from the campaign's.
    fn driven_by(&self, command: Gait, omega_rad_s: f64) -> Option<Gait> {
        let own = self.command();
        let (measured, _) = self.gaits.at(omega_rad_s)?;
        let joint = |i: usize| {
            let (command, own, measured) =
                (command.joints[i]?, own.joints[i]?, measured.joints[i]?);
            Some(JointCommand {
                offset_rad: command.offset_rad + measured.offset_rad - own.offset_rad,
                amplitude_rad: command.amplitude_rad * measured.amplitude_rad / own.amplitude_rad,
                phase_rad: command.phase_rad + measured.phase_rad - own.phase_rad,
                second: command.second,
            })
        };
        Some(Gait { joints: [0, 1].map(joint) })
    }

    fn with_values(&self, robot: &Robot, values: &[f64]) -> Robot {
        let mut robot = robot.clone();
        let free = &self.point.evaluator.parameters;
        free.iter().zip(values).for_each(|(free, value)| free.parameter.set(&mut robot, *value));
        robot
    }

    /// Shifts of the coefficients' logarithms with which the model, linearised, is nearest to trials
    /// whose metrics are off those of the fit by these parts; within the coefficients' bounds.
    pub fn nearest(&self, trials: &[&TrialInformation], off: &[ByFitted<f64>]) -> Vec<f64> {
        let residuals = trials.iter().zip(off).flat_map(|(trial, off)| {
            let terms = Metric::FITTED.into_iter().filter(|i| trial.weights[*i] > 0.0);
            terms.map(move |i| {
                let slope = trial.slopes.iter().map(|of| of[i]).collect();
                Residual::single(off[i], trial.weights[i], slope)
            })
        });
        let residuals: Vec<Residual> = residuals.collect();
        let bounds = limits(&self.point.evaluator.parameters, &self.point.values, f64::INFINITY);
        minimise(&residuals, &bounds, None).as_slice().to_vec()
    }
}

/// Changes with the logarithm of each free parameter, relative.
fn slopes(response: &Response) -> Vec<ByFitted<f64>> {
    let metrics = response.metrics;
    let relative = |of: &ByMetric<f64>| ByFitted::from_fn(|i| known(of[i] / metrics[i]));
    response.d_metrics_d_logarithm.iter().map(relative).collect()
}

/// What another motion has more than this one, relative; nothing where there is none.
fn changes(metrics: &GaitMetrics, other: Option<&GaitMetrics>) -> ByFitted<f64> {
    let other = other.unwrap_or(metrics);
    ByFitted::from_fn(|i| known(other[i] / metrics[i] - 1.0))
}

/// Zero where a metric is missing or none.
fn known(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}
