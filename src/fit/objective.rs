//! How far a model is from the measurements (eq. 21 and 22).

use std::borrow::Cow;

use super::input::FreeParameter;
use super::least_absolute::Residual;
use super::measurement::Measurement;
use crate::config::{GaitInput, Weights};
use crate::metrics::GaitMetrics;
use crate::motion::{FIT_ACCURACY, Model, MotionError, Problem, Solver};
use crate::robot::{Gait, JointCommand, Parameter, Robot};
use crate::store::FitStatus;

/// What a trial without a steady motion contributes to the objective: far more than any motion
/// does, so that the search turns back.
pub(super) const PENALTY: f64 = 1e3;

/// Terms of eq. 22 for one trial: of d, v, the wheels' sigma and alpha_1.
pub(super) const TERMS: usize = 6;

/// Their metrics.
pub(super) const METRICS: [&str; TERMS] = ["d", "v", "sigma0", "sigma1", "sigma2", "alpha1"];

/// Numbers of a measured gait: offset, amplitude and phase of either joint.
pub(super) const GAIT_NUMBERS: usize = 6;

/// Eq. 22 for one model, averaged over a campaign's trials.
#[derive(Debug, Clone)]
pub struct Objective {
    pub model: Model,
    /// The campaign's robot as configured.
    pub robot: Robot,
    pub gait: Gait,
    pub weights: Weights,
    pub gait_input: GaitInput,
    pub measurements: Vec<Measurement>,
}

/// A trial's simulated metrics, and for every free parameter their derivatives with respect to its logarithm.
#[derive(Debug, Clone)]
pub(super) struct Response {
    pub metrics: GaitMetrics,
    d_metrics_d_logarithm: Vec<[f64; 7]>,
}

/// The objective at a point, linearised.
#[derive(Debug, Clone)]
pub(super) struct Linearised {
    pub cost: f64,
    /// Affine functions of the logarithms of the free parameters. A trial without a motion has
    /// none.
    pub residuals: Vec<Residual>,
}

impl Objective {
    /// The same objective of other measurements.
    pub fn with_measurements(&self, measurements: Vec<Measurement>) -> Self {
        let Self { model, ref robot, gait, weights, gait_input, .. } = *self;
        Self { model, robot: robot.clone(), gait, weights, gait_input, measurements }
    }

    /// The robot with `values` for the free `parameters`.
    pub fn robot_with(&self, parameters: &[FreeParameter], values: &[f64]) -> Robot {
        let mut robot = self.robot.clone();
        for (free, value) in parameters.iter().zip(values) {
            free.parameter.set(&mut robot, *value);
        }
        robot
    }

    /// The model's motion with a gait at any frequency.
    pub fn problem(&self, robot: &Robot, gait: Gait, omega_rad_s: f64) -> Problem {
        Problem { robot: robot.clone(), gait, model: self.model, omega_rad_s }
    }

    /// What drives the model: `no-skid-measured` is always driven by the measured gait.
    pub fn driven_by(&self) -> GaitInput {
        match self.model {
            Model::NoSkidMeasured => GaitInput::Measured,
            _ => self.gait_input,
        }
    }

    /// Whether the measured gait of each trial drives the model, not the command.
    pub fn is_driven_as_measured(&self) -> bool {
        self.driven_by() == GaitInput::Measured
    }

    /// The gait that drives the model in one trial; `None` if it was to be measured and was not.
    pub fn gait_of(&self, measurement: &Measurement) -> Option<Gait> {
        let mut gait = self.gait;
        if self.is_driven_as_measured() {
            for (joint, measured) in gait.joints.iter_mut().zip(measurement.gait) {
                if joint.is_some() {
                    *joint = Some(measured);
                }
            }
        }
        let is_known = gait.joints.iter().flatten().all(|joint| {
            let JointCommand { offset_rad, amplitude_rad, phase_rad } = joint;
            [offset_rad, amplitude_rad, phase_rad].iter().all(|number| number.is_finite())
        });
        is_known.then_some(gait)
    }

    /// The model's motion for one trial; `None` as [`Objective::gait_of`].
    pub fn problem_of(&self, robot: &Robot, measurement: &Measurement) -> Option<Problem> {
        let gait = self.gait_of(measurement)?;
        Some(self.problem(robot, gait, measurement.omega_rad_s))
    }

    /// Eq. 22 for one trial.
    pub fn contribution(&self, measurement: &Measurement, simulated: &GaitMetrics) -> f64 {
        self.parts(measurement, simulated).iter().sum()
    }

    /// The terms of eq. 22 for one trial, 0 where there is none.
    pub(super) fn parts(&self, measurement: &Measurement, simulated: &GaitMetrics) -> [f64; TERMS] {
        let simulated = simulated.to_array();
        let mut parts = [0.0; TERMS];
        for (i, weight, measured) in self.terms(measurement) {
            parts[i] = weight * ((measured - simulated[i]) / measured).abs();
        }
        parts
    }

    /// The terms of eq. 22 for one trial: indices in [`GaitMetrics::to_array`], weights and
    /// measured values. What was not measured and what weighs nothing is left out.
    pub(super) fn terms(
        &self,
        measurement: &Measurement,
    ) -> impl Iterator<Item = (usize, f64, f64)> {
        let weights = self.term_weights().into_iter().zip(measurement.metrics.to_array());
        let terms = weights.enumerate().map(|(i, (weight, measured))| (i, weight, measured));
        terms.filter(|(_, weight, measured)| *weight > 0.0 && measured.is_finite())
    }

    /// Weights of d, v, the wheels' sigma and alpha_1; Delta theta has none.
    pub(super) fn term_weights(&self) -> [f64; TERMS] {
        let Weights { d, v, sigma, alpha } = self.weights;
        [d, v, sigma, sigma, sigma, alpha]
    }

    /// The objective from the metrics that were simulated for each of the measurements; a trial
    /// without a motion counts with a penalty.
    pub(super) fn cost(&self, simulated: &[Option<GaitMetrics>]) -> f64 {
        let share = 1.0 / self.measurements.len() as f64;
        let contribution = |(measurement, metrics): (&Measurement, &Option<GaitMetrics>)| {
            let contribution = metrics.map(|metrics| self.contribution(measurement, &metrics));
            share * contribution.unwrap_or(PENALTY).min(PENALTY)
        };
        self.measurements.iter().zip(simulated).map(contribution).sum()
    }

    /// The same, linearised, from metrics and their derivatives.
    pub(super) fn linearised<'r>(
        &self,
        responses: impl IntoIterator<Item = Option<&'r Response>>,
    ) -> Linearised {
        let share = 1.0 / self.measurements.len() as f64;
        let (mut cost, mut residuals) = (0.0, Vec::new());
        for (measurement, response) in self.measurements.iter().zip(responses) {
            let Some(Response { metrics, d_metrics_d_logarithm }) = response else {
                cost += share * PENALTY;
                continue;
            };
            cost += share * self.contribution(measurement, metrics).min(PENALTY);
            let simulated = metrics.to_array();
            residuals.extend(self.terms(measurement).map(|(m, weight, measured)| Residual {
                weight: share * weight,
                value: simulated[m] / measured - 1.0,
                slope: d_metrics_d_logarithm.iter().map(|each| each[m] / measured).collect(),
            }));
        }
        Linearised { cost, residuals }
    }

    /// Something that evaluates the objective and remembers the last motions.
    pub fn evaluator(&self, parameters: Vec<FreeParameter>) -> Evaluator<'_> {
        Evaluator {
            objective: Cow::Borrowed(self),
            parameters,
            solvers: vec![Solver::default(); self.measurements.len()],
            accuracy: FIT_ACCURACY,
            solves: 0,
        }
    }
}

/// Evaluates the objective, each motion from the last one at its frequency.
#[derive(Clone)]
pub struct Evaluator<'a> {
    pub objective: Cow<'a, Objective>,
    pub parameters: Vec<FreeParameter>,
    solvers: Vec<Solver>,
    /// Of the motions' metrics, relative.
    pub accuracy: f64,
    /// Steady motions solved for so far.
    pub solves: usize,
}

impl<'a> Evaluator<'a> {
    /// An evaluator of other measurements, the motions of which start from those of the
    /// measurements at `indices` here.
    pub(super) fn of_others(&self, measurements: Vec<Measurement>, indices: &[usize]) -> Self {
        Self {
            objective: Cow::Owned(self.objective.with_measurements(measurements)),
            parameters: self.parameters.clone(),
            solvers: indices.iter().map(|&index| self.solvers[index].clone()).collect(),
            accuracy: self.accuracy,
            solves: 0,
        }
    }

    /// The objective; a trial without a motion counts with a penalty.
    pub fn cost(&mut self, values: &[f64]) -> f64 {
        let metrics = self.metrics(values);
        self.objective.cost(&metrics)
    }

    /// The metrics of every measurement's motion; `None` where there is none.
    pub(super) fn metrics(&mut self, values: &[f64]) -> Vec<Option<GaitMetrics>> {
        let robot = self.objective.robot_with(&self.parameters, values);
        (0..self.solvers.len()).map(|i| self.solve(i, &robot).ok()).collect()
    }

    /// The metrics of the motions that were solved for last, with their derivatives.
    pub(super) fn responses(
        &mut self,
        values: &[f64],
        metrics: &[Option<GaitMetrics>],
    ) -> Vec<Option<Response>> {
        let robot = self.objective.robot_with(&self.parameters, values);
        let wanted: Vec<Parameter> = self.parameters.iter().map(|free| free.parameter).collect();
        let response = |(metrics, solver): (&Option<GaitMetrics>, &mut Solver)| {
            let metrics = (*metrics)?;
            if wanted.is_empty() {
                return Some(Response { metrics, d_metrics_d_logarithm: Vec::new() });
            }
            let derivatives = solver.derivatives_of(&wanted).ok()?.parameters;
            let d_metrics_d_logarithm = wanted.iter().map(|parameter| {
                let value = parameter.of(&robot);
                derivatives[*parameter].to_array().map(|derivative| derivative * value)
            });
            Some(Response { metrics, d_metrics_d_logarithm: d_metrics_d_logarithm.collect() })
        };
        metrics.iter().zip(&mut self.solvers).map(response).collect()
    }

    /// What one standard error of each number of a trial's measured gait makes of its metrics;
    /// nothing where the command drives the model, or no error is known.
    pub(super) fn gait_effects(&mut self, values: &[f64]) -> Vec<Vec<[f64; TERMS]>> {
        if !self.objective.is_driven_as_measured() {
            return vec![Vec::new(); self.solvers.len()];
        }
        let robot = self.objective.robot_with(&self.parameters, values);
        let count = self.solvers.len();
        let mut effects =
            |i: usize| (0..GAIT_NUMBERS).map(|n| self.gait_effect(i, n, &robot)).collect();
        (0..count).map(&mut effects).collect()
    }

    /// By a central difference.
    fn gait_effect(&mut self, i: usize, number: usize, robot: &Robot) -> [f64; TERMS] {
        const STEP_RAD: f64 = 1e-3;
        let measurement = &self.objective.measurements[i];
        let mut error_rad = [0.0; GAIT_NUMBERS];
        error_rad[number] = measurement.gait_errors_rad.as_flattened()[number];
        if error_rad[number].is_nan() || error_rad[number] == 0.0 {
            return [0.0; TERMS];
        }
        let mut at = |step_rad: f64| {
            let mut steps_rad = [0.0; GAIT_NUMBERS];
            steps_rad[number] = step_rad;
            let moved = self.objective.measurements[i].with_gait_moved(steps_rad);
            let problem = self.objective.problem_of(robot, &moved)?;
            self.solves += 1;
            Some(self.solvers[i].solve(&problem, self.accuracy).ok()?.to_array())
        };
        let both = at(STEP_RAD).zip(at(-STEP_RAD));
        let scale = error_rad[number] / (2.0 * STEP_RAD);
        // Where the neighbouring motions do not exist nothing is known.
        both.map_or([0.0; TERMS], |(above, below)| {
            std::array::from_fn(|metric| scale * (above[metric] - below[metric]))
        })
    }

    /// The objective linearised at `values`.
    pub(super) fn linearised(&mut self, values: &[f64]) -> Linearised {
        let metrics = self.metrics(values);
        self.linearised_at(values, &metrics)
    }

    /// The same, where the metrics of the motions that were solved for last are known.
    pub(super) fn linearised_at(
        &mut self,
        values: &[f64],
        metrics: &[Option<GaitMetrics>],
    ) -> Linearised {
        let responses = self.responses(values, metrics);
        self.objective.linearised(responses.iter().map(Option::as_ref))
    }

    /// Whether all motions exist at `values`.
    pub fn status(&mut self, values: &[f64]) -> FitStatus {
        let robot = self.objective.robot_with(&self.parameters, values);
        for i in 0..self.solvers.len() {
            if let Err(error) = self.solve(i, &robot) {
                let omega_rad_s = self.objective.measurements[i].omega_rad_s;
                let status = error.status();
                return FitStatus::Failed(format!("{status}: at {omega_rad_s:.3} rad/s {error}"));
            }
        }
        FitStatus::Ok
    }

    fn solve(&mut self, i: usize, robot: &Robot) -> Result<GaitMetrics, MotionError> {
        self.solves += 1;
        let problem = self.objective.problem_of(robot, &self.objective.measurements[i]);
        let problem = problem.ok_or(MotionError::GaitUnknown)?;
        self.solvers[i].solve(&problem, self.accuracy)
    }
}
