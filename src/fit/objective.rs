//! How far a model is from the measurements (eq. 21 and 22).

use super::absolute::Term;
use crate::config::{Fit, GaitInput, SigmaKind, Weights};
use crate::metrics::GaitMetrics;
use crate::motion::{self, FIT_ACCURACY, Model, MotionError, Problem, Solver};
use crate::robot::{Gait, JointCommand, Robot};
use crate::store::TrialRow;

/// What a trial without a steady motion contributes to the objective: far more than any motion
/// does, so that the search turns back.
pub(super) const PENALTY: f64 = 1e3;

/// What one trial measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement {
    pub omega_rad_s: f64,
    pub metrics: GaitMetrics,
    /// Standard errors of the metrics.
    pub errors: GaitMetrics,
    /// Mean and first harmonic of the measured joint angles.
    pub gait: [JointCommand; 2],
}

impl Measurement {
    /// The measurement of a trial; `None` if the trial has no metrics. A skid ratio of which
    /// nothing is left above the noise is missing, and its terms are left out of eq. 22.
    pub fn new(trial: &TrialRow, sigma: SigmaKind) -> Option<Self> {
        let sigma = trial.sigma(sigma);
        let metrics = GaitMetrics { sigma: sigma.map(|(value, _)| value), ..trial.metrics() };
        let usable = trial.omega_rad_s > 0.0
            && [metrics.d_m, metrics.v_m_s, metrics.alpha1_rad].iter().all(|value| *value > 0.0);
        let joint = |offset_rad, amplitude_rad, phase_rad| JointCommand {
            offset_rad,
            amplitude_rad,
            phase_rad,
        };
        usable.then(|| Self {
            omega_rad_s: trial.omega_rad_s,
            metrics,
            errors: GaitMetrics {
                d_m: trial.d_m_se,
                v_m_s: trial.v_m_s_se,
                sigma: sigma.map(|(_, error)| error),
                alpha1_rad: trial.alpha1_rad_se,
                dtheta_rad: trial.dtheta_rad_se,
            },
            gait: [
                joint(trial.phi1_offset_rad, trial.phi1_amplitude_rad, trial.phi1_phase_rad),
                joint(trial.phi2_offset_rad, trial.phi2_amplitude_rad, trial.phi2_phase_rad),
            ],
        })
    }
}

/// A coefficient that a fit can free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coefficient {
    /// Skid resistance of a wheel, kg/s.
    Skid(usize),
    /// Damping of the passive joint, N m s/rad.
    Damping,
}

impl Coefficient {
    /// The coefficient's column in the tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Skid(0) => "skid0_kg_s",
            Self::Skid(1) => "skid1_kg_s",
            Self::Skid(_) => "skid2_kg_s",
            Self::Damping => "damping_nm_s_rad",
        }
    }

    /// The coefficient's value in a robot.
    pub fn of(self, robot: &Robot) -> f64 {
        match self {
            Self::Skid(wheel) => robot.skid_kg_s[wheel],
            Self::Damping => robot.damping_nm_s_rad,
        }
    }

    /// What the motion is differentiated by.
    fn derivative(self) -> motion::Parameter {
        match self {
            Self::Skid(wheel) => motion::Parameter::Skid(wheel),
            Self::Damping => motion::Parameter::Damping,
        }
    }

    fn set(self, robot: &mut Robot, value: f64) {
        match self {
            Self::Skid(wheel) => robot.skid_kg_s[wheel] = value,
            Self::Damping => robot.damping_nm_s_rad = value,
        }
    }
}

/// A free coefficient and its bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    pub coefficient: Coefficient,
    pub bounds: [f64; 2],
}

impl Parameter {
    /// The parameters that a fit of `model` frees.
    pub fn free_in(model: Model, gait: &Gait, fit: &Fit) -> Vec<Self> {
        let skid =
            |wheel| Self { coefficient: Coefficient::Skid(wheel), bounds: fit.skid_bounds_kg_s };
        let damping =
            Self { coefficient: Coefficient::Damping, bounds: fit.damping_bounds_nm_s_rad };
        match model {
            Model::Skid | Model::SkidRoll => [0, 1, 2].map(skid).into(),
            Model::NoSkidDamped if gait.passive_joint().is_some() => vec![damping],
            _ => Vec::new(),
        }
    }
}

/// Eq. 22 for one model, averaged over a campaign's trials.
#[derive(Debug, Clone)]
pub struct Objective {
    model: Model,
    robot: Robot,
    gait: Gait,
    weights: Weights,
    gait_input: GaitInput,
    measurements: Vec<Measurement>,
}

impl Objective {
    pub fn new(
        model: Model,
        robot: Robot,
        gait: Gait,
        weights: Weights,
        gait_input: GaitInput,
        measurements: Vec<Measurement>,
    ) -> Self {
        Self { model, robot, gait, weights, gait_input, measurements }
    }

    /// The model.
    pub fn model(&self) -> Model {
        self.model
    }

    /// The measurements in the order of the trials.
    pub fn measurements(&self) -> &[Measurement] {
        &self.measurements
    }

    /// The campaign's robot as configured.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The robot with `values` for the free `parameters`.
    pub fn robot_with(&self, parameters: &[Parameter], values: &[f64]) -> Robot {
        let mut robot = self.robot.clone();
        for (parameter, value) in parameters.iter().zip(values) {
            parameter.coefficient.set(&mut robot, *value);
        }
        robot
    }

    /// The model's motion at the commanded gait and any frequency.
    pub fn problem(&self, robot: &Robot, omega_rad_s: f64) -> Problem {
        Problem { robot: robot.clone(), gait: self.gait, model: self.model, omega_rad_s }
    }

    /// The model's motion for one trial, driven by the command or by the measured gait;
    /// `no-skid-measured` always takes the latter.
    pub fn problem_of(&self, robot: &Robot, measurement: &Measurement) -> Problem {
        let mut problem = self.problem(robot, measurement.omega_rad_s);
        if self.model == Model::NoSkidMeasured || self.gait_input == GaitInput::Measured {
            for (joint, measured) in problem.gait.joints.iter_mut().zip(measurement.gait) {
                if joint.is_some() {
                    *joint = Some(measured);
                }
            }
        }
        problem
    }

    /// Eq. 22 for one trial.
    pub fn contribution(&self, measurement: &Measurement, simulated: &GaitMetrics) -> f64 {
        let simulated = simulated.to_array();
        self.terms(measurement)
            .map(|(i, weight, measured)| weight * ((measured - simulated[i]) / measured).abs())
            .sum()
    }

    /// The terms of eq. 22 for one trial: places in [`GaitMetrics::to_array`], weights and
    /// measured values. What was not measured and what weighs nothing is left out.
    fn terms(&self, measurement: &Measurement) -> impl Iterator<Item = (usize, f64, f64)> {
        let weights = self.term_weights().into_iter().zip(measurement.metrics.to_array());
        let terms = weights.enumerate().map(|(i, (weight, measured))| (i, weight, measured));
        terms.filter(|(_, weight, measured)| *weight > 0.0 && measured.is_finite())
    }

    /// Standard error of the objective at the truth that the measurements' errors imply.
    pub fn standard_error(&self) -> f64 {
        let square: f64 = self
            .measurements
            .iter()
            .map(|measurement| {
                let measured = measurement.metrics.to_array();
                let errors = measurement.errors.to_array();
                let terms = self.term_weights().into_iter().zip(errors.into_iter().zip(measured));
                terms
                    .filter(|(_, (error, measured))| error.is_finite() && measured.is_finite())
                    .map(|(weight, (error, measured))| (weight * error / measured).powi(2))
                    .sum::<f64>()
            })
            .sum();
        square.sqrt() / self.measurements.len() as f64
    }

    /// Weights of `d, v, sigma0, sigma1, sigma2, alpha1`; Delta theta has none.
    fn term_weights(&self) -> [f64; 6] {
        let Weights { d, v, sigma, alpha } = self.weights;
        [d, v, sigma, sigma, sigma, alpha]
    }

    /// Something that evaluates the objective and remembers the last motions.
    pub fn evaluator(&self, parameters: Vec<Parameter>) -> Evaluator<'_> {
        Evaluator {
            objective: self,
            parameters,
            solvers: vec![Solver::default(); self.measurements.len()],
            accuracy: FIT_ACCURACY,
            solves: 0,
        }
    }
}

/// Evaluates the objective, each motion from the last one at its frequency.
pub struct Evaluator<'a> {
    pub objective: &'a Objective,
    pub parameters: Vec<Parameter>,
    solvers: Vec<Solver>,
    /// Of the motions' metrics, relative.
    pub accuracy: f64,
    solves: usize,
}

impl Evaluator<'_> {
    /// Steady motions solved for so far.
    pub fn solves(&self) -> usize {
        self.solves
    }

    /// The objective; a trial without a motion counts with a penalty.
    pub fn cost(&mut self, values: &[f64]) -> f64 {
        let robot = self.objective.robot_with(&self.parameters, values);
        let count = self.solvers.len();
        let sum: f64 = (0..count)
            .map(|i| {
                let measurement = &self.objective.measurements[i];
                self.solve(i, &robot).map_or(PENALTY, |metrics| {
                    self.objective.contribution(measurement, &metrics).min(PENALTY)
                })
            })
            .sum();
        sum / count as f64
    }

    /// The objective and its terms as affine functions of the logarithms of the parameters,
    /// relative to `values`; a trial without a motion counts with a penalty and has none.
    pub(super) fn linearised(&mut self, values: &[f64]) -> (f64, Vec<Term>) {
        let robot = self.objective.robot_with(&self.parameters, values);
        let count = self.solvers.len();
        let share = 1.0 / count as f64;
        let (mut cost, mut terms) = (0.0, Vec::new());
        for i in 0..count {
            let found = self.solve(i, &robot).and_then(|metrics| {
                self.solvers[i].derivatives().map(|derivatives| (metrics, derivatives))
            });
            let Ok((metrics, derivatives)) = found else {
                cost += share * PENALTY;
                continue;
            };
            let measurement = &self.objective.measurements[i];
            cost += share * self.objective.contribution(measurement, &metrics).min(PENALTY);
            let simulated = metrics.to_array();
            let by: Vec<[f64; 7]> = self
                .parameters
                .iter()
                .zip(values)
                .map(|(parameter, value)| {
                    let place = parameter.coefficient.derivative().place();
                    derivatives[place].to_array().map(|by| by * value)
                })
                .collect();
            terms.extend(self.objective.terms(measurement).map(|(m, weight, measured)| Term {
                weight: share * weight,
                value: simulated[m] / measured - 1.0,
                slope: by.iter().map(|by| by[m] / measured).collect(),
            }));
        }
        (cost, terms)
    }

    /// `ok`, or which motion does not exist at `values` and why.
    pub fn status(&mut self, values: &[f64]) -> String {
        let robot = self.objective.robot_with(&self.parameters, values);
        for i in 0..self.solvers.len() {
            if let Err(error) = self.solve(i, &robot) {
                let omega_rad_s = self.objective.measurements[i].omega_rad_s;
                return format!("{}: at {omega_rad_s:.3} rad/s {error}", error.status());
            }
        }
        "ok".to_owned()
    }

    fn solve(&mut self, i: usize, robot: &Robot) -> Result<GaitMetrics, MotionError> {
        self.solves += 1;
        let problem = self.objective.problem_of(robot, &self.objective.measurements[i]);
        self.solvers[i].solve(&problem, self.accuracy)
    }
}
