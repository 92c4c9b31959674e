//! Misfit between a model and the measurements: the objective J (eq. 21 and 22).

use trilink_base::cancel::CancelToken;
use trilink_mechanics::{FIT_ACCURACY, Laws, MotionError, Problem, Solver};
use trilink_robot::metrics::{ByFitted, GaitMetrics, Metric};
use trilink_robot::{AnyGait, AnyRobot, JointCommand, Parameter};
use trilink_tables::FitStatus;
use trilink_tables::config::{GaitInput, Weights};

use super::conditions::{Condition, Conditions, Differences, Expansion};
use super::input::FreeParameter;
use super::measurement::Measurement;
use super::robots::Robots;
use super::terms::{Linearised, Response, Target, Terms};

/// Failure of a fit: the model has no steady-state motion for one of the trials, or there is nothing to fit.
#[derive(Debug, Clone)]
pub struct Failure {
    /// Kind of failure: any status but `Ok`.
    pub status: FitStatus,
    pub reason: String,
}

/// Objective for one model: the weighted sum of relative deviations (eq. 22 of the paper), averaged over the trials of
/// a campaign, and summed over campaigns if several are fitted together.
#[derive(Debug, Clone)]
pub struct Objective {
    pub laws: Laws,
    /// Robots with their free parameters at their values from before the fit.
    pub(crate) robots: Robots,
    /// Gait and weights of each campaign, indexed by [`Measurement::campaign`].
    pub protocols: Vec<Protocol>,
    /// Whether the measured or the commanded gait drives the model.
    pub gait_input: GaitInput,
    pub measurements: Vec<Measurement>,
    /// Token that cancels the searches.
    pub(super) cancel: CancelToken,
    pub(super) conditions: Conditions,
}

/// Gait and weights common to all trials of a campaign.
#[derive(Debug, Clone, PartialEq)]
pub struct Protocol {
    /// Name of the campaign; empty if only one campaign is fitted.
    pub name: String,
    /// Commanded gait.
    pub gait: AnyGait,
    pub weights: Weights,
}

impl Protocol {
    /// Returns the weight of each metric in the objective; 0 for the amplitude of a driven joint from the second on.
    pub fn term_weights(&self) -> ByFitted<f64> {
        let is_driven = |metric: Metric| {
            let joint = Metric::ALPHA.iter().position(|alpha| *alpha == metric);
            !metric.is_of_three_links()
                && joint.is_some_and(|joint| self.gait.joints[joint].is_some())
        };
        ByFitted::from_fn(
            |metric| {
                if is_driven(metric) { 0.0 } else { self.weights.for_metric(metric) }
            },
        )
    }
}

/// Metrics of one trial, measured or resampled.
#[derive(Debug, Clone)]
pub(super) struct Observation {
    pub trial: usize,
    pub metrics: ByFitted<f64>,
    /// Differences of the trial's inputs (frequency and gait parameters) from those of its condition, the group of
    /// trials that share one periodic solution.
    pub differences: Differences,
}

impl Objective {
    /// Builds the objective for one campaign from its measurements, which must be sorted by [`Measurement::order`].
    pub fn new(
        laws: Laws,
        robot: impl Into<AnyRobot>,
        gait: impl Into<AnyGait>,
        weights: Weights,
        gait_input: GaitInput,
        measurements: Vec<Measurement>,
    ) -> Self {
        let protocol = Protocol { name: String::new(), gait: gait.into(), weights };
        Self::pooled(laws, robot.into().into(), vec![protocol], gait_input, measurements)
    }

    /// Builds the objective for several campaigns from their measurements, which must be sorted by
    /// [`Measurement::order`].
    pub(crate) fn pooled(
        laws: Laws,
        robots: Robots,
        protocols: Vec<Protocol>,
        gait_input: GaitInput,
        measurements: Vec<Measurement>,
    ) -> Self {
        let conditions = Conditions::default();
        let cancel = CancelToken::default();
        let mut all =
            Self { laws, robots, protocols, gait_input, measurements, cancel, conditions };
        all.conditions = Conditions::new(
            &all.measurements,
            |measurement| all.gait_of(measurement),
            |campaign, gait, omega_rad_s| all.problem(all.robots.of(campaign), gait, omega_rad_s),
        );
        all
    }

    /// Returns the same objective with the model driven by the given gait input.
    pub(crate) fn driven_as(&self, gait_input: GaitInput) -> Self {
        let driven = Self::pooled(
            self.laws,
            self.robots.clone(),
            self.protocols.clone(),
            gait_input,
            self.measurements.clone(),
        );
        Self { cancel: self.cancel.clone(), ..driven }
    }

    /// Returns the gait and the weights of the campaign that a measurement belongs to.
    pub(super) fn protocol(&self, measurement: &Measurement) -> &Protocol {
        &self.protocols[measurement.campaign]
    }

    /// Returns, for each campaign, how many of the trials with the given indices belong to it.
    pub(super) fn trials_by_campaign(&self, trials: impl Iterator<Item = usize>) -> Vec<f64> {
        let mut counts = vec![0.0; self.protocols.len()];
        trials.for_each(|trial| counts[self.measurements[trial].campaign] += 1.0);
        counts
    }

    /// Returns, for each measurement, the number of trials in the same campaign.
    pub(super) fn campaign_sizes(&self) -> Vec<f64> {
        let counts = self.trials_by_campaign(0..self.measurements.len());
        self.measurements.iter().map(|measurement| counts[measurement.campaign]).collect()
    }

    /// Returns whether the model's solution for any campaign depends on a parameter.
    pub(super) fn depends_on(&self, parameter: Parameter) -> bool {
        let mut protocols = self.protocols.iter().enumerate();
        protocols
            .any(|(campaign, of)| self.robots.depends_on(campaign, parameter, self.laws, &of.gait))
    }

    /// Returns the problem whose solution is the model's steady-state motion for a gait and a frequency.
    pub fn problem(&self, robot: &AnyRobot, gait: AnyGait, omega_rad_s: f64) -> Problem {
        Problem { robot: robot.clone(), gait, laws: self.laws, omega_rad_s }
    }

    /// Whether the measured gait of each trial drives the model, rather than the command.
    pub(crate) fn is_driven_as_measured(&self) -> bool {
        self.gait_input == GaitInput::Measured
    }

    /// Returns the gait that drives the model in a trial; `None` if the measured gait should drive it but is missing.
    pub(crate) fn gait_of(&self, measurement: &Measurement) -> Option<AnyGait> {
        let mut gait = self.protocol(measurement).gait;
        if self.is_driven_as_measured() {
            for (joint, measured) in gait.joints.iter_mut().zip(measurement.gait) {
                *joint = joint.map(|command| command.measured(measured));
            }
        }
        let mut numbers = gait.joints.into_iter().flatten().flat_map(JointCommand::to_array);
        numbers.all(f64::is_finite).then_some(gait)
    }

    /// Returns the problem whose solution is the model's steady-state motion for a condition.
    ///
    /// # Errors
    /// Returns an error if the measured gait should drive the model but is missing.
    pub(super) fn problem_of(
        &self,
        robots: &Robots,
        condition: &Condition,
    ) -> Result<Problem, MotionError> {
        let gait = condition.gait.ok_or(MotionError::GaitUnknown)?;
        Ok(self.problem(robots.of(condition.campaign), gait, condition.omega_rad_s))
    }

    /// Returns the contribution of one trial to the objective: the weighted sum of the relative deviations of its
    /// metrics from the simulated ones (eq. 22 of the paper).
    pub fn contribution(&self, measurement: &Measurement, simulated: &GaitMetrics) -> f64 {
        self.contributions(measurement, simulated).values().iter().sum()
    }

    /// Returns the term of each metric in the contribution of one trial to the objective (eq. 22 of the paper); 0 for a
    /// metric that is not in the objective.
    pub(super) fn contributions(
        &self,
        measurement: &Measurement,
        simulated: &GaitMetrics,
    ) -> ByFitted<f64> {
        let mut contributions = ByFitted::splat(0.0);
        for (metric, weight, measured) in self.terms(measurement) {
            contributions[metric] = weight * ((measured - simulated[metric]) / measured).abs();
        }
        contributions
    }

    /// Returns the metrics of a trial that have a term in the objective (eq. 22 of the paper), with their weights and
    /// measured values. Metrics that were not measured or have zero weight are omitted.
    pub(super) fn terms(
        &self,
        measurement: &Measurement,
    ) -> impl Iterator<Item = (Metric, f64, f64)> {
        let weights = self.protocol(measurement).term_weights();
        let metrics = measurement.metrics;
        let terms = Metric::FITTED.map(|metric| (metric, weights[metric], metrics[metric]));
        terms.into_iter().filter(|(_, weight, measured)| *weight > 0.0 && measured.is_finite())
    }

    /// Returns the original, not resampled, measurements.
    pub(super) fn observations(&self) -> Vec<Observation> {
        (0..self.measurements.len()).map(|trial| self.observation(trial)).collect()
    }

    pub(super) fn observation(&self, trial: usize) -> Observation {
        let metrics = self.measurements[trial].metrics.into();
        Observation { trial, metrics, differences: self.conditions.by_trial[trial].1 }
    }

    /// Creates an evaluator of the objective for the given free parameters.
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

/// Evaluator of the objective, whose solver starts from the previous periodic solution of each condition.
#[derive(Clone)]
pub struct Evaluator<'a> {
    pub objective: &'a Objective,
    pub parameters: Vec<FreeParameter>,
    solvers: Vec<Solver>,
    observations: Vec<Observation>,
    /// Expansion of each condition's metrics in terms of its trials' frequencies and gaits; `None` where none was
    /// computed.
    pub(super) expansions: Vec<Option<Expansion>>,
    pub(super) terms: Terms,
    /// Relative accuracy of the simulated metrics.
    pub accuracy: f64,
    /// Number of periodic solutions computed.
    pub solves: usize,
}

impl Evaluator<'_> {
    /// Returns an evaluator for other observations, whose solver starts from the periodic solutions that this evaluator
    /// has found.
    pub(super) fn with_observations(&self, observations: Vec<Observation>) -> Self {
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

    /// Returns the terms of the objective (eq. 22 of the paper) for the given observations. The latest expansion gives
    /// the ratio of each trial's metrics to those of its condition.
    pub(super) fn terms_of(&self, observations: &[Observation]) -> Terms {
        let objective = self.objective;
        let trials = observations.iter().map(|observation| observation.trial);
        let counts = objective.trials_by_campaign(trials);
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
        self.objective.conditions.by_trial[trial].0
    }

    /// Returns the ratios of a trial's metrics to those of its condition (the group of trials that share one periodic
    /// solution), given the differences of the trial's frequency and gait parameters from those of the condition.
    pub(super) fn ratios(&self, condition: usize, differences: &Differences) -> ByFitted<f64> {
        let expansion = self.expansions[condition].as_ref();
        expansion.map_or(ByFitted::splat(1.0), |expansion| expansion.ratios(differences))
    }

    /// Whether any trial of a condition (group of trials that share one periodic solution) differs from the condition
    /// in frequency or gait parameters.
    fn is_spread(&self, condition: usize) -> bool {
        let by_trial = &self.objective.conditions.by_trial;
        let mut trials = self.objective.conditions.all[condition].trials.iter();
        trials.any(|trial| by_trial[*trial].1.iter().any(|difference| *difference != 0.0))
    }

    /// Whether any trial differs in frequency or gait parameters from its condition (group of trials that share one
    /// periodic solution).
    pub(super) fn has_expansions(&self) -> bool {
        (0..self.solvers.len()).any(|condition| self.is_spread(condition))
    }

    /// Evaluates the objective; a trial for which the model has no periodic solution contributes a penalty.
    pub fn cost(&mut self, values: &[f64]) -> f64 {
        let metrics = self.metrics(values);
        self.expand(&metrics, false);
        self.terms.cost(metrics.into_iter())
    }

    /// Solves the model for every condition and returns the metrics; `None` where the model has no periodic solution,
    /// or where a condition has no observations.
    pub(super) fn metrics(&mut self, values: &[f64]) -> Vec<Option<GaitMetrics>> {
        let robots = self.objective.robots.with_values(&self.parameters, values);
        (0..self.solvers.len())
            .map(|i| if self.terms.is_unused(i) { None } else { self.solve(i, &robots).ok() })
            .collect()
    }

    /// Returns `metrics`, which must be those of the latest periodic solutions, with their derivatives; `None` for a
    /// condition without metrics or derivatives.
    pub(super) fn responses(
        &mut self,
        values: &[f64],
        metrics: &[Option<GaitMetrics>],
    ) -> Vec<Option<Response>> {
        let robots = self.objective.robots.with_values(&self.parameters, values);
        let conditions = self.objective.conditions.all.iter();
        let each = conditions.zip(metrics).zip(&mut self.solvers);
        each.map(|((condition, metrics), solver)| {
            let campaign = condition.campaign;
            let parameters = self.parameters.iter();
            let own: Vec<Option<Parameter>> =
                parameters.map(|free| robots.own(campaign, free.parameter)).collect();
            let there: Vec<Parameter> = own.iter().flatten().copied().collect();
            let robot = robots.of(campaign);
            let response = Response::from_last_motion(solver, (*metrics)?, robot, &there).ok()?;
            Some(response.with_zeros(&own))
        })
        .collect()
    }

    /// Expands the metrics of the latest periodic solutions in terms of the trials' inputs (frequency and gait
    /// parameters): for conditions from which trials differ in their inputs, or for all conditions if `with_all`.
    pub(super) fn expand(&mut self, metrics: &[Option<GaitMetrics>], with_all: bool) {
        for (condition, metrics) in metrics.iter().enumerate() {
            let Some(metrics) = metrics else { continue };
            if !with_all && !self.is_spread(condition) {
                continue;
            }
            let Ok(derivatives) = self.solvers[condition].input_derivatives() else { continue };
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

    /// Adds second derivatives to the expansions for conditions whose trials differ in their inputs. If there is no
    /// free parameter, the expansions already contain them.
    pub(super) fn add_second_order(&mut self, values: &[f64]) {
        if values.is_empty() {
            return;
        }
        let robots = self.objective.robots.with_values(&self.parameters, values);
        let Conditions { all, by_trial, .. } = &self.objective.conditions;
        for (i, condition) in all.iter().enumerate() {
            let problem = self.objective.problem_of(&robots, condition);
            let Ok(problem) = problem else { continue };
            if !self.is_spread(i) {
                continue;
            }
            let differences: Vec<Differences> =
                condition.trials.iter().map(|trial| by_trial[*trial].1).collect();
            let mut solver = self.solvers[i].successor();
            self.expansions[i] = Expansion::solve(&mut solver, &problem, &differences).ok();
        }
    }

    /// Linearises the objective at `values` and expands the trials' metrics there.
    pub(super) fn expanded(&mut self, values: &[f64]) -> Linearised {
        let metrics = self.metrics(values);
        self.expand(&metrics, false);
        self.linearised_at(values, &metrics)
    }

    /// Linearises the objective at `values`, given the metrics of the latest periodic solutions; the expansion of the
    /// trials' metrics remains that of an earlier point.
    pub(super) fn linearised_at(
        &mut self,
        values: &[f64],
        metrics: &[Option<GaitMetrics>],
    ) -> Linearised {
        let responses = self.responses(values, metrics);
        self.terms.linearised(&responses)
    }

    /// Checks that the model has a periodic solution for every condition at `values`.
    ///
    /// # Errors
    /// Returns an error for the first condition without a periodic solution.
    pub fn check_motions(&mut self, values: &[f64]) -> Result<(), Failure> {
        let robots = self.objective.robots.with_values(&self.parameters, values);
        for i in 0..self.solvers.len() {
            if let Err(error) = self.solve(i, &robots) {
                let omega_rad_s = self.objective.conditions.all[i].omega_rad_s;
                let status = match error {
                    MotionError::Singular { .. } => FitStatus::Singular,
                    MotionError::GaitUnknown => FitStatus::Failed,
                    _ => FitStatus::Diverged,
                };
                let reason = format!("at {omega_rad_s:.3} rad/s: {error}");
                return Err(Failure { status, reason });
            }
        }
        Ok(())
    }

    fn solve(&mut self, i: usize, robots: &Robots) -> Result<GaitMetrics, MotionError> {
        self.solves += 1;
        let problem = self.objective.problem_of(robots, &self.objective.conditions.all[i])?;
        self.solvers[i].solve(&problem, self.accuracy)
    }
}
