//! How far a model is from the measurements (eq. 21 and 22).

use trilink_base::cancel::CancelToken;
use trilink_mechanics::{FIT_ACCURACY, Laws, MotionError, Problem, Solver};
use trilink_robot::metrics::{ByFitted, GaitMetrics, Metric};
use trilink_robot::{Gait, JointCommand, Parameter, Robot};
use trilink_tables::FitStatus;
use trilink_tables::config::{GaitInput, Weights};

use super::conditions::{Condition, Conditions, Differences, Expansion};
use super::input::FreeParameter;
use super::measurement::Measurement;
use super::terms::{Linearised, Response, Target, Terms};

/// Eq. 22 for one model, averaged over a campaign's trials; of several campaigns of one robot the
/// sum of these.
#[derive(Debug, Clone)]
pub struct Objective {
    pub laws: Laws,
    /// The robot as configured.
    pub robot: Robot,
    /// The campaigns, as [`Measurement::campaign`] counts them.
    pub protocols: Vec<Protocol>,
    /// What drives the model.
    pub gait_input: GaitInput,
    pub measurements: Vec<Measurement>,
    /// Cancels the searches.
    pub(super) cancel: CancelToken,
    pub(super) conditions: Conditions,
}

/// What the trials of a campaign have in common.
#[derive(Debug, Clone, PartialEq)]
pub struct Protocol {
    /// The campaign, where it is not alone.
    pub name: String,
    /// The command.
    pub gait: Gait,
    pub weights: Weights,
}

impl Protocol {
    /// Weights of the metrics that have a term.
    pub fn term_weights(&self) -> ByFitted<f64> {
        ByFitted::from_fn(|metric| self.weights.of(metric))
    }
}

/// One trial as it was measured or drawn.
#[derive(Debug, Clone)]
pub(super) struct Observation {
    pub trial: usize,
    pub metrics: ByFitted<f64>,
    pub differences: Differences,
}

impl Objective {
    /// Of one campaign's sorted measurements.
    pub fn new(
        laws: Laws,
        robot: Robot,
        gait: Gait,
        weights: Weights,
        gait_input: GaitInput,
        measurements: Vec<Measurement>,
    ) -> Self {
        let alone = Protocol { name: String::new(), gait, weights };
        Self::pooled(laws, robot, vec![alone], gait_input, measurements)
    }

    /// Of the sorted measurements of one campaign after the other.
    pub(crate) fn pooled(
        laws: Laws,
        robot: Robot,
        protocols: Vec<Protocol>,
        gait_input: GaitInput,
        measurements: Vec<Measurement>,
    ) -> Self {
        let conditions = Conditions::default();
        let cancel = CancelToken::default();
        let mut all = Self { laws, robot, protocols, gait_input, measurements, cancel, conditions };
        all.conditions = Conditions::new(
            &all.measurements,
            |measurement| all.gait_of(measurement),
            |gait, omega_rad_s| all.problem(&all.robot, gait, omega_rad_s),
        );
        all
    }

    /// The same driven by another gait.
    pub(crate) fn driven_as(&self, gait_input: GaitInput) -> Self {
        let Self { laws, ref robot, ref protocols, ref measurements, .. } = *self;
        let (robot, protocols) = (robot.clone(), protocols.clone());
        let driven = Self::pooled(laws, robot, protocols, gait_input, measurements.clone());
        Self { cancel: self.cancel.clone(), ..driven }
    }

    /// The gait and the weights of a measurement's campaign.
    pub(super) fn protocol(&self, measurement: &Measurement) -> &Protocol {
        &self.protocols[measurement.campaign]
    }

    /// How many of these trials each campaign has.
    pub(super) fn trials_by_campaign(&self, trials: impl Iterator<Item = usize>) -> Vec<f64> {
        let mut counts = vec![0.0; self.protocols.len()];
        trials.for_each(|trial| counts[self.measurements[trial].campaign] += 1.0);
        counts
    }

    /// How many trials the campaign of each measurement has.
    pub(super) fn campaign_sizes(&self) -> Vec<f64> {
        let counts = self.trials_by_campaign(0..self.measurements.len());
        self.measurements.iter().map(|of| counts[of.campaign]).collect()
    }

    /// The robot with `values` for the free `parameters`.
    pub(crate) fn robot_with(&self, parameters: &[FreeParameter], values: &[f64]) -> Robot {
        let mut robot = self.robot.clone();
        for (free, value) in parameters.iter().zip(values) {
            free.parameter.set(&mut robot, *value);
        }
        robot
    }

    /// The model's motion with a gait at any frequency.
    pub fn problem(&self, robot: &Robot, gait: Gait, omega_rad_s: f64) -> Problem {
        Problem { robot: robot.clone(), gait, laws: self.laws, omega_rad_s }
    }

    /// Whether the measured gait of each trial drives the model, not the command.
    pub(crate) fn is_driven_as_measured(&self) -> bool {
        self.gait_input == GaitInput::Measured
    }

    /// The gait that drives the model in one trial; `None` if it was to be measured and was not.
    pub(crate) fn gait_of(&self, measurement: &Measurement) -> Option<Gait> {
        let mut gait = self.protocol(measurement).gait;
        if self.is_driven_as_measured() {
            for (joint, measured) in gait.joints.iter_mut().zip(measurement.gait) {
                *joint = joint.map(|command| command.measured(measured));
            }
        }
        let mut numbers = gait.joints.into_iter().flatten().flat_map(JointCommand::to_array);
        let is_known = numbers.all(f64::is_finite);
        is_known.then_some(gait)
    }

    /// The model's motion in a condition.
    ///
    /// # Errors
    /// The gait that drives it was not measured.
    pub(super) fn problem_of(
        &self,
        robot: &Robot,
        condition: &Condition,
    ) -> Result<Problem, MotionError> {
        let gait = condition.gait.ok_or(MotionError::GaitUnknown)?;
        Ok(self.problem(robot, gait, condition.omega_rad_s))
    }

    /// Eq. 22 for one trial.
    pub fn contribution(&self, measurement: &Measurement, simulated: &GaitMetrics) -> f64 {
        self.parts(measurement, simulated).values().iter().sum()
    }

    /// The terms of eq. 22 for one trial, 0 where there is none.
    pub(super) fn parts(
        &self,
        measurement: &Measurement,
        simulated: &GaitMetrics,
    ) -> ByFitted<f64> {
        let mut parts = ByFitted::splat(0.0);
        for (metric, weight, measured) in self.terms(measurement) {
            parts[metric] = weight * ((measured - simulated[metric]) / measured).abs();
        }
        parts
    }

    /// The terms of eq. 22 for one trial: metrics, weights and measured values. What was not
    /// measured and what weighs nothing is left out.
    pub(super) fn terms(
        &self,
        measurement: &Measurement,
    ) -> impl Iterator<Item = (Metric, f64, f64)> {
        let weights = self.protocol(measurement).term_weights();
        let metrics = measurement.metrics;
        let terms = Metric::FITTED.map(|metric| (metric, weights[metric], metrics[metric]));
        terms.into_iter().filter(|(_, weight, measured)| *weight > 0.0 && measured.is_finite())
    }

    /// The measurements as they are.
    pub(super) fn observations(&self) -> Vec<Observation> {
        (0..self.measurements.len()).map(|trial| self.observation(trial)).collect()
    }

    pub(super) fn observation(&self, trial: usize) -> Observation {
        let metrics = self.measurements[trial].metrics.into();
        Observation { trial, metrics, differences: self.conditions.of_trials[trial].1 }
    }

    /// Something that evaluates the objective and remembers the last motions.
    pub fn evaluator(&self, parameters: Vec<FreeParameter>) -> Evaluator<'_> {
        let count = self.conditions.all.len();
        Evaluator {
            objective: self,
            parameters,
            solvers: vec![Solver::default(); count],
            observations: self.observations(),
            expansions: self.conditions.expansions.clone(),
            terms: Terms::default(),
            accuracy: FIT_ACCURACY,
            solves: 0,
        }
        .with_terms()
    }
}

/// Evaluates the objective, each motion from the last one of its condition.
#[derive(Clone)]
pub struct Evaluator<'a> {
    pub objective: &'a Objective,
    pub parameters: Vec<FreeParameter>,
    solvers: Vec<Solver>,
    observations: Vec<Observation>,
    /// What the trials' motions make of their conditions', as far as that is known.
    pub(super) expansions: Vec<Option<Expansion>>,
    pub(super) terms: Terms,
    /// Of the motions' metrics, relative.
    pub accuracy: f64,
    /// Steady motions solved for so far.
    pub solves: usize,
}

impl Evaluator<'_> {
    /// An evaluator of other observations; its motions start from those here.
    pub(super) fn of_others(&self, observations: Vec<Observation>) -> Self {
        let Self { objective, ref parameters, ref solvers, ref expansions, accuracy, .. } = *self;
        Self {
            objective,
            parameters: parameters.clone(),
            solvers: solvers.iter().map(Solver::successor).collect(),
            observations,
            expansions: expansions.clone(),
            terms: Terms::default(),
            accuracy,
            solves: 0,
        }
        .with_terms()
    }

    fn with_terms(mut self) -> Self {
        self.terms = self.terms_of(&self.observations);
        self
    }

    /// Eq. 22 of observations: a trial's metric is its condition's in the ratio that the
    /// expansion has at the point where it was made.
    pub(super) fn terms_of(&self, observations: &[Observation]) -> Terms {
        let objective = self.objective;
        let counts = objective.trials_by_campaign(observations.iter().map(|of| of.trial));
        let share = |trial: usize| 1.0 / counts[objective.measurements[trial].campaign];
        let mut shares = vec![0.0; self.solvers.len()];
        for &Observation { trial, .. } in observations {
            shares[self.condition_of(trial)] += share(trial);
        }
        let targets = observations.iter().flat_map(|observation| {
            let condition = self.condition_of(observation.trial);
            let ratios = self.ratios(condition, &observation.differences);
            let weights =
                objective.protocol(&objective.measurements[observation.trial]).term_weights();
            let share = share(observation.trial);
            let known = Metric::FITTED.into_iter().filter(move |&metric| {
                weights[metric] > 0.0 && observation.metrics[metric].is_finite()
            });
            known.map(move |metric| {
                let value = observation.metrics[metric] / ratios[metric];
                Target { condition, metric, value, weight: share * weights[metric] / value }
            })
        });
        Terms::new(shares, targets)
    }

    fn condition_of(&self, trial: usize) -> usize {
        self.objective.conditions.of_trials[trial].0
    }

    /// The metrics of a trial over its condition's.
    pub(super) fn ratios(&self, condition: usize, differences: &Differences) -> ByFitted<f64> {
        let expansion = self.expansions[condition].as_ref();
        expansion.map_or(ByFitted::splat(1.0), |expansion| expansion.ratios(differences))
    }

    /// Whether the trials of a condition differ.
    fn is_spread(&self, condition: usize) -> bool {
        let of_trials = &self.objective.conditions.of_trials;
        let mut trials = self.objective.conditions.all[condition].trials.iter();
        trials.any(|trial| of_trials[*trial].1.iter().any(|difference| *difference != 0.0))
    }

    /// Whether those of any condition do.
    pub(super) fn has_expansions(&self) -> bool {
        (0..self.solvers.len()).any(|condition| self.is_spread(condition))
    }

    /// The objective; a trial without a motion counts with a penalty.
    pub fn cost(&mut self, values: &[f64]) -> f64 {
        let metrics = self.metrics(values);
        self.expand(&metrics, false);
        self.terms.cost(metrics.into_iter())
    }

    /// The metrics of every condition's motion; `None` where there is none, or none matters.
    pub(super) fn metrics(&mut self, values: &[f64]) -> Vec<Option<GaitMetrics>> {
        let robot = self.objective.robot_with(&self.parameters, values);
        let count = self.solvers.len();
        let solve = |i| if self.terms.is_idle(i) { None } else { self.solve(i, &robot).ok() };
        (0..count).map(solve).collect()
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
            Response::of_last(solver, (*metrics)?, &robot, &wanted).ok()
        };
        metrics.iter().zip(&mut self.solvers).map(response).collect()
    }

    /// Expands the conditions' motions, those that were solved for last: where trials differ, or
    /// all of them.
    pub(super) fn expand(&mut self, metrics: &[Option<GaitMetrics>], with_all: bool) {
        for (condition, metrics) in metrics.iter().enumerate() {
            let (true, Some(metrics)) = (with_all || self.is_spread(condition), metrics) else {
                continue;
            };
            let Ok(derivatives) = self.solvers[condition].derivatives() else { continue };
            let mut expansion = Expansion::new(metrics, &derivatives);
            if let Some(last) = self.expansions[condition].take() {
                expansion.keep_second_order(last);
            }
            self.expansions[condition] = Some(expansion);
        }
        if self.has_expansions() {
            self.terms = self.terms_of(&self.observations);
        }
    }

    /// Adds the second order where trials differ. It is known where nothing is free.
    pub(super) fn add_second_order(&mut self, values: &[f64]) {
        if values.is_empty() {
            return;
        }
        let robot = self.objective.robot_with(&self.parameters, values);
        let Conditions { all, of_trials, .. } = &self.objective.conditions;
        for (i, condition) in all.iter().enumerate() {
            let problem = self.objective.problem_of(&robot, condition);
            let (true, Ok(problem)) = (self.is_spread(i), problem) else { continue };
            let differences: Vec<Differences> =
                condition.trials.iter().map(|trial| of_trials[*trial].1).collect();
            let mut solver = self.solvers[i].successor();
            self.expansions[i] = Expansion::solve(&mut solver, &problem, &differences).ok();
        }
    }

    /// The objective linearised at `values`, where the trials' motions are expanded.
    pub(super) fn expanded(&mut self, values: &[f64]) -> Linearised {
        let metrics = self.metrics(values);
        self.expand(&metrics, false);
        self.linearised_at(values, &metrics)
    }

    /// The same, where the metrics of the motions that were solved for last are known, and the
    /// trials' motions were expanded elsewhere.
    pub(super) fn linearised_at(
        &mut self,
        values: &[f64],
        metrics: &[Option<GaitMetrics>],
    ) -> Linearised {
        let responses = self.responses(values, metrics);
        self.terms.linearised(&responses)
    }

    /// Whether all motions exist at `values`.
    pub fn status(&mut self, values: &[f64]) -> FitStatus {
        let robot = self.objective.robot_with(&self.parameters, values);
        for i in 0..self.solvers.len() {
            if let Err(error) = self.solve(i, &robot) {
                let omega_rad_s = self.objective.conditions.all[i].omega_rad_s;
                let status = error.status();
                return FitStatus::Failed(format!("{status}: at {omega_rad_s:.3} rad/s {error}"));
            }
        }
        FitStatus::Ok
    }

    fn solve(&mut self, i: usize, robot: &Robot) -> Result<GaitMetrics, MotionError> {
        self.solves += 1;
        let problem = self.objective.problem_of(robot, &self.objective.conditions.all[i])?;
        self.solvers[i].solve(&problem, self.accuracy)
    }
}
