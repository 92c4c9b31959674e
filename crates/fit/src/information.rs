//! First-order information that single trials give about the coefficients of a fitted model, for fitted trials and for
//! candidates. The noise of a candidate trial is modelled as a power of its frequency ([`super::discrimination`]).

use rayon::prelude::*;
use trilink_mechanics::{FIT_ACCURACY, Problem, Solver};
use trilink_robot::metrics::{ByFitted, GaitMetrics, Metric};
use trilink_robot::{AnyGait, JointCommand};
use trilink_tables::{Columns as _, Extrapolation};

use super::discrimination::NoiseModel;
use super::fitted_point::FittedPoint;
use super::gait_over_frequency::{EXACT, GaitOverFrequency};
use super::input::FreeParameter;
use super::least_absolute::{Residual, minimise};
use super::measured_range::MeasuredRange;
use super::measurement::Measurement;
use super::robots::Robots;
use super::search::limits;
use super::terms::Response;
use super::variation::Variation;

/// Information that one trial gives about the coefficients. All changes are relative to the trial's metrics.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialInformation {
    pub metrics: GaitMetrics,
    /// Weights in the objective; zero for metrics that are not measured.
    pub weights: ByFitted<f64>,
    /// Changes in the metrics per unit of the logarithm of each free parameter.
    pub slopes: Vec<ByFitted<f64>>,
    /// Relative standard deviations of the measured metrics due to noise; d and v count as one measurement.
    pub noise: ByFitted<f64>,
    /// Changes in the metrics per standard error of each parameter of the measured gait.
    pub by_gait: Vec<ByFitted<f64>>,
    /// Changes in the metrics when each uncertain robot parameter is increased by its standard deviation.
    pub by_assumed: Vec<ByFitted<f64>>,
}

/// Information that trials give about the coefficients of a fitted model.
pub struct FitInformation<'f> {
    point: &'f FittedPoint<'f>,
    variation: &'f Variation<'f>,
    /// Shifts of the logarithms of the free parameters in each replicate.
    replicates: &'f [Vec<f64>],
    /// Copies of the robot, each with one uncertain parameter increased by its standard deviation.
    perturbed_robots: &'f [Robots],
    gaits: GaitOverFrequency,
    noise: NoiseModel,
    /// For each metric, whether any trial has a term for it in the objective.
    measured: ByFitted<bool>,
}

impl<'f> FitInformation<'f> {
    pub(super) fn new(
        point: &'f FittedPoint<'f>,
        variation: &'f Variation<'f>,
        replicates: &'f [Vec<f64>],
        perturbed_robots: &'f [Robots],
    ) -> Self {
        let objective = point.evaluator.objective;
        let measured = ByFitted::from_fn(|metric| {
            let mut terms = objective.measurements.iter().flat_map(|of| objective.terms(of));
            terms.any(|(of, ..)| of == metric)
        });
        Self {
            point,
            variation,
            replicates,
            perturbed_robots,
            gaits: GaitOverFrequency::new(objective),
            noise: NoiseModel::new(&objective.measurements, &variation.noises()),
            measured,
        }
    }

    /// Returns the free parameters with their fitted values.
    pub fn free(&self) -> impl Iterator<Item = (&FreeParameter, f64)> {
        self.point.evaluator.parameters.iter().zip(self.point.values.iter().copied())
    }

    /// Returns the shifts of the logarithms of the free parameters in each replicate.
    pub fn replicates(&self) -> &[Vec<f64>] {
        self.replicates
    }

    /// Returns the campaign's commanded gait.
    pub fn command(&self) -> AnyGait {
        self.point.evaluator.objective.protocols[0].gait
    }

    /// Whether the measured gait, rather than the command, drives the model.
    pub(crate) fn is_driven_as_measured(&self) -> bool {
        self.point.evaluator.objective.is_driven_as_measured()
    }

    /// Returns the lowest and the highest frequency of the trials, rad/s.
    pub fn range_rad_s(&self) -> [f64; 2] {
        trilink_statistics::extremes(self.measurements().iter().map(|of| of.omega_rad_s))
    }

    /// Returns whether a trial with the given commanded gait and frequency lies outside the range of the fitted trials,
    /// and in which quantities.
    pub fn extrapolation(&self, command: AnyGait, omega_rad_s: f64) -> Extrapolation {
        let objective = self.point.evaluator.objective;
        let problem = objective.problem(objective.robots.first(), command, omega_rad_s);
        let range =
            MeasuredRange::new(self.measurements(), objective.robots.first(), &self.command());
        range.map_or_else(Extrapolation::blank, |range| range.extrapolation(&problem))
    }

    fn measurements(&self) -> &[Measurement] {
        &self.point.evaluator.objective.measurements
    }

    /// Returns the values of the free parameters for given shifts of their logarithms from the fit.
    fn values(&self, shifts: &[f64]) -> Vec<f64> {
        let pairs = self.point.values.iter().zip(shifts);
        pairs.map(|(value, shift)| value * shift.exp()).collect()
    }

    /// Returns the information of the fitted trials at the given shifts of the coefficients' logarithms. Trials for
    /// which the model has no periodic solution are left out. `assumed` adds the changes due to the uncertain robot
    /// parameters.
    pub fn trials(&self, shifts: &[f64], assumed: bool) -> Vec<TrialInformation> {
        let objective = self.point.evaluator.objective;
        let values = self.values(shifts);
        let mut evaluator = self.point.evaluator.clone();
        let metrics = evaluator.metrics(&values);
        let responses = evaluator.responses(&values, &metrics);
        let perturbed = if assumed { self.perturbed_robots } else { &[] };
        let assumed: Vec<Vec<Option<GaitMetrics>>> = perturbed
            .par_iter()
            .map(|robot| self.point.metrics_of_robots(robot, &values))
            .collect();
        let noises = self.variation.noises();
        let trials = self.measurements().iter().enumerate();
        trials
            .filter_map(|(trial, measurement)| {
                let (condition, _) = objective.conditions.by_trial[trial];
                let response = responses[condition].as_ref()?;
                let mut weights = ByFitted::splat(0.0);
                for (metric, weight, _) in objective.terms(measurement) {
                    weights[metric] = weight;
                }
                let own = measurement.metrics;
                let relative = |of: &ByFitted<f64>| ByFitted::from_fn(|i| known(of[i] / own[i]));
                let by_assumed = assumed
                    .iter()
                    .map(|of| changes(&response.metrics, of[condition].as_ref()))
                    .collect();
                Some(TrialInformation {
                    metrics: response.metrics,
                    weights,
                    slopes: response.relative_slopes(),
                    noise: relative(&noises[trial]),
                    by_gait: self.point.gait_effects[trial].iter().map(relative).collect(),
                    by_assumed,
                })
            })
            .collect()
    }

    /// Returns the information of a candidate trial with the given commanded gait and frequency, at the given shifts of
    /// the coefficients' logarithms; `None` if the model has no stable solution. `assumed` adds the changes due to the
    /// uncertain robot parameters.
    pub fn candidate(
        &self,
        command: AnyGait,
        omega_rad_s: f64,
        shifts: &[f64],
        assumed: bool,
    ) -> Option<TrialInformation> {
        let mut solver = Solver::default();
        let objective = self.point.evaluator.objective;
        let values = self.values(shifts);
        let robots = self.point.with_values(&objective.robots, &values);
        let robot = robots.first();
        let gait = self.driven_by(command, omega_rad_s)?;
        let problem = objective.problem(robot, gait, omega_rad_s);
        let metrics = solver.solve(&problem, FIT_ACCURACY).ok()?;
        if !solver.status().ok()?.is_stable() {
            return None;
        }
        let free: Vec<_> = self.free().map(|(free, _)| free.parameter).collect();
        let by_gait = if self.is_driven_as_measured() {
            self.gait_effects(&mut solver, &metrics, omega_rad_s)?
        } else {
            Vec::new()
        };
        let response = Response::from_last_motion(&mut solver, metrics, robot, &free).ok()?;
        let noise = self.noise.at(omega_rad_s);
        let weights = objective.protocols[0].term_weights();
        let is_measured = |i: Metric| self.measured[i] && noise[i] > 0.0;
        let perturbed = if assumed { self.perturbed_robots } else { &[] };
        let by_assumed = perturbed.iter().map(|robots| {
            let robots = self.point.with_values(robots, &values);
            let problem = Problem { robot: robots.first().clone(), ..problem.clone() };
            changes(&metrics, solver.solve(&problem, FIT_ACCURACY).ok().as_ref())
        });
        Some(TrialInformation {
            metrics,
            weights: ByFitted::from_fn(|i| if is_measured(i) { weights[i] } else { 0.0 }),
            slopes: response.relative_slopes(),
            noise: noise.map(known),
            by_gait,
            by_assumed: by_assumed.collect(),
        })
    }

    /// Returns the relative changes in `metrics`, those of the solver's last solution, per standard error of each
    /// parameter of the measured gait. The standard errors are those of the trial that is nearest in frequency. `None`
    /// if the solution has no derivatives.
    fn gait_effects(
        &self,
        solver: &mut Solver,
        metrics: &GaitMetrics,
        omega_rad_s: f64,
    ) -> Option<Vec<ByFitted<f64>>> {
        let derivatives = solver.input_derivatives().ok()?.gait;
        let distance = |of: &Measurement| (of.omega_rad_s / omega_rad_s).ln().abs();
        let nearest = self.measurements().iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let errors_rad = nearest.map_or(EXACT, |of| of.gait_errors_rad);
        let pairs = derivatives.as_flattened().iter().zip(errors_rad.as_flattened());
        let effects = pairs.map(|(derivative, error_rad)| {
            ByFitted::from_fn(|i| known(derivative[i] * error_rad / metrics[i]))
        });
        Some(effects.collect())
    }

    /// Returns the gait that drives the model for a given command and frequency; `None` if no gait was measured. Where
    /// measured gaits drive the model, it is the command changed by the mean deviation of the measured gaits from the
    /// campaign's command at that frequency.
    fn driven_by(&self, command: AnyGait, omega_rad_s: f64) -> Option<AnyGait> {
        let own = self.command();
        let (measured, _) = self.gaits.at(omega_rad_s)?;
        let joint = |i: usize| {
            let command = command.joints[i]?;
            let own = own.joints[i]?;
            let measured = measured.joints[i]?;
            Some(JointCommand {
                offset_rad: command.offset_rad + measured.offset_rad - own.offset_rad,
                amplitude_rad: command.amplitude_rad * measured.amplitude_rad / own.amplitude_rad,
                phase_rad: command.phase_rad + measured.phase_rad - own.phase_rad,
                second: command.second,
            })
        };
        Some(AnyGait { joints: std::array::from_fn(joint) })
    }

    /// Returns the shifts of the coefficients' logarithms, within their bounds, for which the linearised model comes
    /// closest to `trials` whose metrics differ from those of the fit by the relative `deviations`.
    pub fn nearest(&self, trials: &[&TrialInformation], deviations: &[ByFitted<f64>]) -> Vec<f64> {
        let residuals = trials.iter().zip(deviations).flat_map(|(trial, deviation)| {
            let terms = Metric::FITTED.into_iter().filter(|i| trial.weights[*i] > 0.0);
            terms.map(move |i| {
                let slope = trial.slopes.iter().map(|of| of[i]).collect();
                Residual::single(deviation[i], trial.weights[i], slope)
            })
        });
        let residuals: Vec<Residual> = residuals.collect();
        let bounds = limits(&self.point.evaluator.parameters, &self.point.values, f64::INFINITY);
        minimise(&residuals, &bounds, None).as_slice().to_vec()
    }
}

/// Returns the relative changes from `metrics` to `other`; zero if `other` is `None`.
pub(super) fn changes(metrics: &GaitMetrics, other: Option<&GaitMetrics>) -> ByFitted<f64> {
    let other = other.unwrap_or(metrics);
    ByFitted::from_fn(|i| known(other[i] / metrics[i] - 1.0))
}

/// Returns the value, or zero if it is not finite.
fn known(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}
