//! The terms of eq. 22 as functions of the conditions' metrics.

use std::sync::Arc;

use trilink_mechanics::{MotionError, Solver};
use trilink_robot::metrics::{ByFitted, ByMetric, GaitMetrics, Metric};
use trilink_robot::{Parameter, Robot};

use super::deviations::Deviations;
use super::least_absolute::Residual;

/// What a trial without a steady motion contributes to the objective: far more than any motion
/// does, so that the search turns back.
pub(super) const PENALTY: f64 = 1e3;

/// A condition's simulated metrics, and for every free parameter their derivatives with respect to its logarithm.
#[derive(Debug, Clone)]
pub(super) struct Response {
    pub metrics: GaitMetrics,
    pub d_metrics_d_logarithm: Vec<ByMetric<f64>>,
}

/// The objective at a point, linearised.
#[derive(Debug, Clone)]
pub(super) struct Linearised {
    pub cost: f64,
    /// The metrics with a term as affine functions of the logarithms of the free parameters, and
    /// what they deviate from. A condition without a motion has none.
    pub residuals: Vec<Residual>,
}

/// A value that a condition's metric deviates from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target {
    pub condition: usize,
    pub metric: Metric,
    pub value: f64,
    pub weight: f64,
}

/// Eq. 22 as a function of the conditions' metrics. What repeats add is one convex function of
/// each, so that it costs no more with more of them.
#[derive(Debug, Clone, Default)]
pub(super) struct Terms {
    /// Trials of each condition, as a part of all.
    shares: Vec<f64>,
    /// Of each condition's metrics.
    deviations: Vec<ByFitted<Option<Arc<Deviations>>>>,
}

impl Terms {
    /// Of conditions with these parts of all trials.
    pub(crate) fn new(shares: Vec<f64>, targets: impl Iterator<Item = Target>) -> Self {
        let mut collected = vec![ByFitted::from_fn(|_| Vec::new()); shares.len()];
        for Target { condition, metric, value, weight } in targets {
            collected[condition][metric].push((value, weight));
        }
        let some = |of: Vec<(f64, f64)>| (!of.is_empty()).then(|| Arc::new(Deviations::new(of)));
        Self { shares, deviations: collected.into_iter().map(|of| of.map(some)).collect() }
    }

    /// The same with the weight of each metric times a factor.
    pub(crate) fn reweighted(&self, factors: &ByFitted<f64>) -> Self {
        let of_condition = |of: &ByFitted<Option<Arc<Deviations>>>| {
            ByFitted::from_fn(|i| Some(Arc::new(of[i].as_ref()?.times(factors[i]))))
        };
        let deviations = self.deviations.iter().map(of_condition).collect();
        Self { shares: self.shares.clone(), deviations }
    }

    /// Whether a condition's motion does not matter.
    pub(crate) fn is_idle(&self, condition: usize) -> bool {
        self.shares[condition] == 0.0
    }

    /// The objective from the metrics that were simulated for each condition; a trial without a
    /// motion counts with a penalty.
    pub(crate) fn cost(&self, simulated: impl Iterator<Item = Option<GaitMetrics>>) -> f64 {
        let all = simulated.zip(&self.deviations).zip(&self.shares);
        all.map(|((metrics, deviations), share)| {
            let most = share * PENALTY;
            metrics.map_or(most, |metrics| {
                let of_metric = |(metric, of): (Metric, &Option<Arc<Deviations>>)| {
                    of.as_ref().map_or(0.0, |of| of.value(metrics[metric]))
                };
                deviations.iter().map(of_metric).sum::<f64>().min(most)
            })
        })
        .sum()
    }

    /// What each metric adds to it where the logarithms of the free parameters are off those of
    /// the responses by these steps.
    pub(crate) fn parts(&self, responses: &[Option<Response>], steps: &[f64]) -> ByFitted<f64> {
        let mut parts = ByFitted::splat(0.0);
        for (response, deviations) in responses.iter().zip(&self.deviations) {
            let Some(response) = response else { continue };
            let change = response.change(steps);
            for (metric, of) in deviations.iter() {
                let value = response.metrics[metric] + change[metric];
                parts[metric] += of.as_ref().map_or(0.0, |of| of.value(value));
            }
        }
        parts
    }

    /// The objective, linearised, from metrics and their derivatives.
    pub(crate) fn linearised(&self, responses: &[Option<Response>]) -> Linearised {
        let metrics = responses.iter().map(|of| of.as_ref().map(|of| of.metrics));
        Linearised { cost: self.cost(metrics), residuals: self.residuals(responses) }
    }

    /// The functions alone.
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
    /// Of the motion of a robot that was solved for last.
    ///
    /// # Errors
    /// It has no derivatives.
    pub(crate) fn of_last(
        solver: &mut Solver,
        metrics: GaitMetrics,
        robot: &Robot,
        free: &[Parameter],
    ) -> Result<Self, MotionError> {
        if free.is_empty() {
            return Ok(Self { metrics, d_metrics_d_logarithm: Vec::new() });
        }
        let derivatives = solver.derivatives_of(free)?.parameters;
        let d_metrics_d_logarithm = free.iter().map(|parameter| {
            let value = parameter.of(robot);
            ByMetric::from(derivatives[*parameter]).map(|derivative| derivative * value)
        });
        Ok(Self { metrics, d_metrics_d_logarithm: d_metrics_d_logarithm.collect() })
    }

    /// What shifts of the logarithms of the free parameters make of the metrics.
    pub(crate) fn change(&self, shifts: &[f64]) -> ByMetric<f64> {
        let mut change = ByMetric::splat(0.0);
        for (shift, derivatives) in shifts.iter().zip(&self.d_metrics_d_logarithm) {
            derivatives.iter().for_each(|(metric, slope)| change[metric] += shift * slope);
        }
        change
    }

    /// A metric, and its derivatives.
    pub(crate) fn affine(&self, metric: Metric) -> (f64, Vec<f64>) {
        let slope = self.d_metrics_d_logarithm.iter().map(|each| each[metric]).collect();
        (self.metrics[metric], slope)
    }
}
