//! Terms of eq. 22 as functions of the conditions' metrics.

use std::sync::Arc;

use trilink_mechanics::{MotionError, Solver};
use trilink_robot::metrics::{ByFitted, ByMetric, GaitMetrics, Metric};
use trilink_robot::{AnyRobot, Parameter};

use super::deviations::Deviations;
use super::least_absolute::Residual;

/// Contribution to the objective of a trial for which the model has no periodic solution: far larger than any other, so
/// that the search turns back.
pub(super) const PENALTY: f64 = 1e3;

/// Simulated metrics for a condition (group of trials that share one periodic solution), and their derivatives with
/// respect to the logarithm of each free parameter.
#[derive(Debug, Clone)]
pub(super) struct Response {
    pub metrics: GaitMetrics,
    pub d_metrics_d_logarithm: Vec<ByMetric<f64>>,
}

/// Objective linearised at given values of the free parameters.
#[derive(Debug, Clone)]
pub(super) struct Linearised {
    pub cost: f64,
    /// For each metric in the objective, its approximation by an affine function of the logarithms of the free
    /// parameters, and its weighted deviations from the measured values. Metrics for which there is no periodic
    /// solution are left out.
    pub residuals: Vec<Residual>,
}

/// Measured value of a metric, with its weight in the objective, for a condition (group of trials that share one
/// periodic solution).
#[derive(Debug, Clone, Copy)]
pub(super) struct Target {
    pub condition: usize,
    pub metric: Metric,
    pub value: f64,
    pub weight: f64,
}

/// Objective (eq. 22 of the paper) as a function of the metrics of the conditions (groups of trials that share one
/// periodic solution). The trials of a condition are merged into one convex function per metric, so that the cost of an
/// evaluation hardly grows with the number of repeats.
#[derive(Debug, Clone, Default)]
pub(super) struct Terms {
    /// Weight of each group of trials that share one periodic solution: the sum, over the trials of the group, of the
    /// reciprocal of the number of trials in the trial's campaign.
    shares: Vec<f64>,
    /// Deviations from the measured values, for each metric of each condition.
    deviations: Vec<ByFitted<Option<Arc<Deviations>>>>,
}

impl Terms {
    /// Collects the targets by condition (group of trials that share one periodic solution); `shares` are the weights
    /// of the conditions.
    pub(crate) fn new(shares: Vec<f64>, targets: impl Iterator<Item = Target>) -> Self {
        let mut collected = vec![ByFitted::from_fn(|_| Vec::new()); shares.len()];
        for Target { condition, metric, value, weight } in targets {
            collected[condition][metric].push((value, weight));
        }
        let deviations = collected.into_iter().map(|by_metric| {
            by_metric.map(|targets: Vec<(f64, f64)>| {
                (!targets.is_empty()).then(|| Arc::new(Deviations::new(targets)))
            })
        });
        Self { shares, deviations: deviations.collect() }
    }

    /// Returns the terms with the weights of each metric multiplied by that metric's factor.
    pub(crate) fn reweighted(&self, factors: &ByFitted<f64>) -> Self {
        let deviations = self.deviations.iter().map(|by_metric| {
            ByFitted::from_fn(|i| Some(Arc::new(by_metric[i].as_ref()?.times(factors[i]))))
        });
        Self { shares: self.shares.clone(), deviations: deviations.collect() }
    }

    /// Whether no trial belongs to the condition (group of trials that share one periodic solution) at the given index.
    pub(crate) fn is_unused(&self, condition: usize) -> bool {
        self.shares[condition] == 0.0
    }

    /// Evaluates the objective for the simulated metrics of each condition; a condition without a periodic solution
    /// (`None`) contributes a penalty.
    pub(crate) fn cost(&self, simulated: impl Iterator<Item = Option<GaitMetrics>>) -> f64 {
        let all = simulated.zip(&self.deviations).zip(&self.shares);
        all.map(|((metrics, by_metric), share)| {
            let penalty = share * PENALTY;
            let Some(metrics) = metrics else { return penalty };
            let contributions = by_metric.iter().map(|(metric, deviations)| {
                deviations.as_ref().map_or(0.0, |of| of.value(metrics[metric]))
            });
            contributions.sum::<f64>().min(penalty)
        })
        .sum()
    }

    /// Returns the contribution of each metric to the objective after a step in the logarithms of the free parameters,
    /// with the metrics linearised by `responses`.
    pub(crate) fn contributions(
        &self,
        responses: &[Option<Response>],
        steps: &[f64],
    ) -> ByFitted<f64> {
        let mut contributions = ByFitted::splat(0.0);
        for (response, by_metric) in responses.iter().zip(&self.deviations) {
            let Some(response) = response else { continue };
            let change = response.change(steps);
            for (metric, deviations) in by_metric.iter() {
                let value = response.metrics[metric] + change[metric];
                contributions[metric] += deviations.as_ref().map_or(0.0, |of| of.value(value));
            }
        }
        contributions
    }

    /// Returns the objective linearised at the given responses.
    pub(crate) fn linearised(&self, responses: &[Option<Response>]) -> Linearised {
        let metrics = responses.iter().map(|response| response.as_ref().map(|of| of.metrics));
        Linearised { cost: self.cost(metrics), residuals: self.residuals(responses) }
    }

    /// Returns the residuals linearised at the given responses.
    pub(crate) fn residuals(&self, responses: &[Option<Response>]) -> Vec<Residual> {
        let mut residuals = Vec::new();
        for (response, deviations) in responses.iter().zip(&self.deviations) {
            let Some(response) = response else { continue };
            residuals.extend(deviations.iter().filter_map(|(metric, of)| {
                let deviations = Arc::clone(of.as_ref()?);
                let (value, slope) = response.affine(metric);
                Some(Residual { value, slope, deviations })
            }));
        }
        residuals
    }
}

impl Response {
    /// Differentiates the metrics of the periodic solution that the solver found last.
    ///
    /// # Errors
    /// Returns an error if the periodic solution has no derivatives.
    pub(crate) fn from_last_motion(
        solver: &mut Solver,
        metrics: GaitMetrics,
        robot: &AnyRobot,
        free: &[Parameter],
    ) -> Result<Self, MotionError> {
        if free.is_empty() {
            return Ok(Self { metrics, d_metrics_d_logarithm: Vec::new() });
        }
        let derivatives = solver.derivatives_of(free)?.into_iter();
        let d_metrics_d_logarithm = free.iter().zip(derivatives).map(|(parameter, derivatives)| {
            let value = robot.value(*parameter);
            ByMetric::from(derivatives).map(|derivative| derivative * value)
        });
        Ok(Self { metrics, d_metrics_d_logarithm: d_metrics_d_logarithm.collect() })
    }

    /// Adds zero derivatives with respect to the parameters that are `None`, which the robot does not have.
    pub(crate) fn with_zeros(self, parameters: &[Option<Parameter>]) -> Self {
        let mut there = self.d_metrics_d_logarithm.into_iter();
        let mut next = || there.next().unwrap_or(ByMetric::splat(0.0));
        let zero = || ByMetric::splat(0.0);
        let all = parameters.iter().map(|own| if own.is_some() { next() } else { zero() });
        Self { d_metrics_d_logarithm: all.collect(), ..self }
    }

    /// Returns the relative changes in the metrics per unit of the logarithm of each free parameter; 0 where there is
    /// no relative change, as for a metric that is zero.
    pub(crate) fn relative_slopes(&self) -> Vec<ByFitted<f64>> {
        let relative = |of: &ByMetric<f64>| {
            ByFitted::from_fn(|i| {
                let slope = of[i] / self.metrics[i];
                if slope.is_finite() { slope } else { 0.0 }
            })
        };
        self.d_metrics_d_logarithm.iter().map(relative).collect()
    }

    /// Returns the first-order change in the metrics due to shifts of the logarithms of the free parameters.
    pub(crate) fn change(&self, shifts: &[f64]) -> ByMetric<f64> {
        let mut change = ByMetric::splat(0.0);
        for (shift, derivatives) in shifts.iter().zip(&self.d_metrics_d_logarithm) {
            derivatives.iter().for_each(|(metric, slope)| change[metric] += shift * slope);
        }
        change
    }

    /// Returns the value of a metric, and its derivatives with respect to the logarithms of the free parameters.
    pub(crate) fn affine(&self, metric: Metric) -> (f64, Vec<f64>) {
        let slope = self.d_metrics_d_logarithm.iter().map(|each| each[metric]).collect();
        (self.metrics[metric], slope)
    }
}
