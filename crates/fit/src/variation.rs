//! Variation of friction between trials and between days, beyond the noise of a trial's cycles.
//!
//! Every trial has its own friction coefficients, `c exp(a_day + b_day + a_trial + b_trial)`, where `a` is common to
//! all coefficients and `b` is different for each of them; in addition, the distances, the skid ratios and alpha_1 of a
//! trial have errors that all its cycles share. All these deviations are normally distributed. Near the fit the
//! logarithms of the metrics are linear in them, so that the logarithms of measured over predicted metrics follow a
//! linear mixed model (Lindstrom and Bates 1990), whose variances are estimated by restricted maximum likelihood
//! ([`trilink_statistics::variance_components`]). The noise of the cycles and of the measured gait is a known part of
//! the covariance.
//!
//! The misfit of a wrong model must not be taken for variation. With repeated trials, the fixed effects of the mixed
//! model are therefore the means of each metric at each frequency, and the variances follow from the repeats alone
//! (pure error). Without repeats they are polynomials of the logarithm of the frequency, which describe a smooth
//! misfit, and the variances follow from what is not smooth, as in difference-based estimates (Gasser, Sroka and
//! Jennen-Steinmetz 1986).
//!
//! References: M. J. Lindstrom and D. M. Bates, *Nonlinear mixed effects models for repeated measures data*, Biometrics
//! 46 (1990) 673; T. Gasser, L. Sroka and C. Jennen-Steinmetz, *Residual variance and residual pattern in nonlinear
//! regression*, Biometrika 73 (1986) 625.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use trilink_robot::metrics::{ByFitted, Metric, WeightKey};
use trilink_robot::{Parameter, Per};
use trilink_statistics::variance_components::{
    Block, RandomEffects, VarianceComponents, pseudo_inverse,
};
use trilink_statistics::{c4, student};
use trilink_tables::FitNotes;

use super::discrimination::line;
use super::fitted_point::FittedPoint;
use super::input::FreeParameter;
use super::measurement::Measurement;
use super::resample::{DrawnTrial, draw_deviation_ratio};
use super::resampler::Resampler;
use super::terms::Response;

/// Variance components, in the order of the estimated variances.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Component {
    /// Friction of a day, relative to the mean of all days, common to all coefficients.
    DayCommon,
    /// Friction of a day, independent for each coefficient.
    DayEach,
    /// Friction of a trial, relative to that of its day, common to all coefficients.
    TrialCommon,
    /// Friction of a trial, independent for each coefficient.
    TrialEach,
    /// Relative error of d and v that all cycles of a trial share.
    Distance,
    /// Relative error of each skid ratio that all cycles of a trial share.
    Skid,
    /// Relative error of alpha_1 that all cycles of a trial share.
    Amplitude,
}

impl Component {
    const ALL: [Self; 7] = [
        Self::DayCommon,
        Self::DayEach,
        Self::TrialCommon,
        Self::TrialEach,
        Self::Distance,
        Self::Skid,
        Self::Amplitude,
    ];

    /// Returns the component of the errors of a metric that all cycles of a trial share.
    fn of_metric(metric: Metric) -> Self {
        match metric.definition().weight {
            Some(WeightKey::D | WeightKey::V) => Self::Distance,
            Some(WeightKey::Alpha) => Self::Amplitude,
            _ => Self::Skid,
        }
    }

    fn is_of_day(self) -> bool {
        matches!(self, Self::DayCommon | Self::DayEach)
    }
}

/// Minimum number of repeated trials, not counting the first at each frequency, from which variances are estimated.
const MIN_REPEATS: usize = 3;
/// Maximum degree of the polynomials that describe a smooth misfit.
const MAX_DEGREE: usize = 3;
/// Minimum relative standard deviation of a metric within a trial, so that its covariance is positive definite.
const MIN_DEVIATION: f64 = 1e-6;
/// Factor by which mean correlations are shrunk, so that their matrix is positive definite.
const SHRINKAGE: f64 = 0.99;
/// Minimum prediction of a metric, in its unit, that has a logarithm of measured over predicted.
const MIN_PREDICTION: f64 = 1e-9;

/// Trial with the changes of its metrics due to variations of friction.
#[derive(Clone)]
struct Trial {
    /// Index of the trial's day.
    day: usize,
    /// Predicted metrics; `None` if the model has no periodic solution.
    predicted: Option<ByFitted<f64>>,
    /// Relative changes of the metrics per relative change of each friction coefficient.
    loads: Vec<ByFitted<f64>>,
    /// Metrics with a term in the objective, a known noise and a prediction; d stands for v, too.
    metrics: Vec<Metric>,
}

impl Trial {
    /// Returns the relative changes of the metrics in `self.metrics` (rows) for each random effect (columns) of a
    /// component.
    fn effects(&self, component: Component) -> DMatrix<f64> {
        let count = self.metrics.len();
        let load = |row: usize, coefficient: usize| self.loads[coefficient][self.metrics[row]];
        match component {
            Component::DayCommon | Component::TrialCommon => {
                DMatrix::from_fn(count, 1, |row, _| {
                    (0..self.loads.len()).map(|coefficient| load(row, coefficient)).sum()
                })
            }
            Component::DayEach | Component::TrialEach => {
                DMatrix::from_fn(count, self.loads.len(), load)
            }
            Component::Distance | Component::Skid | Component::Amplitude => {
                let is_own = |row: &usize| Component::of_metric(self.metrics[*row]) == component;
                let own: Vec<usize> = (0..count).filter(is_own).collect();
                DMatrix::from_fn(count, own.len(), |row, nth| f64::from(own[nth] == row))
            }
        }
    }
}

/// Source of the estimated variances.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum VariationFrom {
    /// Repeated trials.
    Repeats,
    /// Residuals, of which the part that is a smooth function of the frequency is misfit.
    Residuals,
    /// There are too few trials for an estimate; no variation is assumed.
    Nothing,
}

/// Noise of the trials of a fit: that of the cycles, and the variation of friction between trials and days.
#[derive(Clone)]
pub(super) struct Variation<'r> {
    pub resampler: &'r Resampler,
    trials: Vec<Trial>,
    days: usize,
    coefficients: usize,
    components: VarianceComponents,
    /// Relative covariance of each trial's metrics (`Trial::metrics`) due to the noise of its cycles and its gait, from
    /// the cycles of all trials.
    known: Vec<DMatrix<f64>>,
    /// For each trial, ratios of the standard deviations of its metrics due to the noise of its cycles, from the cycles
    /// of all trials and from its own cycles.
    scales: Vec<ByFitted<f64>>,
    pub from: VariationFrom,
}

impl<'r> Variation<'r> {
    /// Estimates the variation at a fit. `day_sd` is the relative standard deviation of each friction coefficient
    /// between days, which is used if the trials do not determine the differences between days.
    pub(crate) fn new(point: &FittedPoint, resampler: &'r Resampler, day_sd: f64) -> Self {
        let measurements = &point.evaluator.objective.measurements;
        let friction = friction_coefficients(point);
        let names: BTreeSet<&str> = measurements.iter().map(|of| of.day.as_str()).collect();
        let days: Vec<&str> = names.into_iter().collect();
        let trials = trials(point, resampler, &friction, &days);
        let own = trials.iter().enumerate();
        let own = own.map(|(index, trial)| known_covariance(point, resampler, index, trial));
        let own: Vec<DMatrix<f64>> = own.collect();
        let mut known = own.clone();
        pool_variances(&mut known, &trials, measurements);
        let scales =
            trials.iter().zip(own.iter().zip(&known)).map(|(trial, pair)| scales(trial, pair));
        let scales = scales.collect();
        pool_correlations(&mut known, &trials, measurements);
        let mut all = Self {
            resampler,
            trials,
            days: days.len(),
            coefficients: friction.len(),
            components: none(),
            known,
            scales,
            from: VariationFrom::Nothing,
        };
        all.estimate(measurements);
        if !all.knows_days() {
            all.components.variances[Component::DayEach as usize] = day_sd.powi(2);
        }
        all
    }

    /// Returns the same noise without the estimated variation between trials and days; a configured variation between
    /// days is kept.
    pub(crate) fn without_variation(&self) -> Self {
        let mut all = self.clone();
        for component in Component::ALL {
            if self.knows_days() || component != Component::DayEach {
                all.components.variances[component as usize] = 0.0;
            }
        }
        all.components.covariance.fill(0.0);
        all
    }

    /// Estimates the variances of the components.
    fn estimate(&mut self, measurements: &[Measurement]) {
        let frequencies = Measurement::frequencies(measurements);
        let repeats = measurements.len() - frequencies.len();
        if repeats < MIN_REPEATS && frequencies.len() < FitNotes::MIN_FREQUENCIES {
            return;
        }
        let (design, from) = if repeats >= MIN_REPEATS {
            (means_by_frequency(&frequencies, measurements), VariationFrom::Repeats)
        } else {
            (polynomials(&frequencies, measurements), VariationFrom::Residuals)
        };
        let mut blocks = self.blocks(measurements, &design);
        let rows: usize = blocks.iter().map(|block| block.observations.len()).sum();
        // A robot has few of the metrics for which the design has columns.
        let is_used = |column: &usize| {
            blocks.iter().any(|block| block.design.column(*column).iter().any(|x| *x != 0.0))
        };
        let used: Vec<usize> = (0..design.columns).filter(is_used).collect();
        if rows <= used.len() {
            return;
        }
        blocks.iter_mut().for_each(|block| block.design = block.design.select_columns(&used));
        if let Some(components) = VarianceComponents::estimate(&blocks) {
            self.components = components;
            self.from = from;
        }
    }

    /// Returns the observations that share random effects: those of a day if there are several days, or else those of
    /// a trial.
    fn blocks(&self, measurements: &[Measurement], design: &Design) -> Vec<Block> {
        let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (index, trial) in self.trials.iter().enumerate() {
            let group = if self.days > 1 { trial.day } else { index };
            groups.entry(group).or_default().push(index);
        }
        groups.values().filter_map(|trials| self.block(measurements, design, trials)).collect()
    }

    fn block(
        &self,
        measurements: &[Measurement],
        design: &Design,
        trials: &[usize],
    ) -> Option<Block> {
        let count = trials.iter().map(|index| self.trials[*index].metrics.len()).sum();
        if count == 0 {
            return None;
        }
        let mut block = Block {
            observations: DVector::zeros(count),
            design: DMatrix::zeros(count, design.columns),
            known_covariance: DMatrix::zeros(count, count),
            random_effects: vec![Vec::new(); Component::ALL.len()],
        };
        let mut by_day = [Component::DayCommon, Component::DayEach].map(|component| {
            let columns = if component == Component::DayCommon { 1 } else { self.coefficients };
            DMatrix::zeros(count, columns)
        });
        let mut first = 0;
        for &index in trials {
            let trial = &self.trials[index];
            let Some(predicted) = &trial.predicted else { continue };
            let size = trial.metrics.len();
            for (row, metric) in trial.metrics.iter().enumerate() {
                let measured = measurements[index].metrics[*metric];
                block.observations[first + row] = (measured / predicted[*metric]).ln();
                for (column, value) in (design.row)(index, *metric) {
                    block.design[(first + row, column)] = value;
                }
            }
            block
                .known_covariance
                .view_mut((first, first), (size, size))
                .copy_from(&self.known[index]);
            for component in Component::ALL {
                let effects = trial.effects(component);
                if component.is_of_day() {
                    by_day[component as usize].rows_mut(first, size).copy_from(&effects);
                } else {
                    block.random_effects[component as usize].push(RandomEffects { first, effects });
                }
            }
            first += size;
        }
        if self.days > 1 {
            for (component, effects) in by_day.into_iter().enumerate() {
                block.random_effects[component].push(RandomEffects { first: 0, effects });
            }
        }
        Some(block)
    }

    /// Returns the number of days on which the trials were recorded.
    pub(crate) fn days(&self) -> usize {
        self.days
    }

    /// Returns whether the trials determine the variation between days.
    fn knows_days(&self) -> bool {
        [Component::DayCommon, Component::DayEach]
            .iter()
            .any(|component| self.components.is_identified[*component as usize])
    }

    /// Returns whether nothing is known about differences between days: the trials do not determine them, and no
    /// standard deviation is configured.
    pub(crate) fn ignores_days(&self) -> bool {
        !self.knows_days() && self.deviation(Component::DayEach) == 0.0
    }

    /// Returns the standard deviation of a component.
    fn deviation(&self, component: Component) -> f64 {
        self.components.variances[component as usize].sqrt()
    }

    /// Returns the standard deviations of the metrics of every trial, due to its cycles and to the variation between
    /// trials and days.
    pub(crate) fn noises(&self) -> Vec<ByFitted<f64>> {
        let own = self.resampler.noises().into_iter().enumerate();
        own.map(|(index, own)| {
            let variation = self.deviations(index);
            ByFitted::from_fn(|metric| {
                if own[metric] > 0.0 { own[metric].hypot(variation[metric]) } else { own[metric] }
            })
        })
        .collect()
    }

    /// Returns the standard deviations of a trial's metrics due to the variation of friction and to the errors that all
    /// its cycles share, in the units of the metrics.
    pub(crate) fn deviations(&self, index: usize) -> ByFitted<f64> {
        let [of_day, of_trial] =
            [true, false].map(|is_of_day| self.deviations_of(index, is_of_day));
        ByFitted::from_fn(|metric| of_day[metric].hypot(of_trial[metric]))
    }

    /// Returns the part of [`Self::deviations`] that is due to differences between days, or between trials of a day.
    pub(crate) fn deviations_of(&self, index: usize, is_of_day: bool) -> ByFitted<f64> {
        let trial = &self.trials[index];
        let Some(predicted) = &trial.predicted else { return ByFitted::splat(0.0) };
        ByFitted::from_fn(|metric| {
            let loads = trial.loads.iter().map(|loads| loads[metric]);
            let common: f64 = loads.clone().sum();
            let each: f64 = loads.map(|load| load * load).sum();
            let variance: f64 = Component::ALL
                .into_iter()
                .filter(|component| component.is_of_day() == is_of_day)
                .map(|component| {
                    let size = match component {
                        Component::DayCommon | Component::TrialCommon => common.powi(2),
                        Component::DayEach | Component::TrialEach => each,
                        of_metric => f64::from(of_metric == Component::of_metric(metric)),
                    };
                    self.components.variances[component as usize] * size
                })
                .sum();
            predicted[metric] * variance.sqrt()
        })
    }

    /// Draws relative deviations of the metrics of all trials due to the variation of friction and to the errors that
    /// all cycles of a trial share. The differences between days are multiplied by `day_factor`.
    pub(crate) fn draw_deviations(&self, number: usize, day_factor: f64) -> Vec<ByFitted<f64>> {
        let mut random = self.resampler.random("variation", number);
        let count = self.coefficients;
        let [day_common, day_each, trial_common, trial_each] = [
            Component::DayCommon,
            Component::DayEach,
            Component::TrialCommon,
            Component::TrialEach,
        ]
        .map(|component| self.deviation(component));
        let days: Vec<Vec<f64>> = (0..self.days)
            .map(|_| {
                let deviations = [day_common, day_each].map(|deviation| day_factor * deviation);
                friction_deviations(count, deviations, &mut random)
            })
            .collect();
        let trials = self.trials.iter().map(|trial| {
            let own = friction_deviations(count, [trial_common, trial_each], &mut random);
            let mut normal = ByFitted::from_fn(|metric| {
                let is_drawn = metric.is_of_three_links() || trial.metrics.contains(&metric);
                if is_drawn { StandardNormal.sample(&mut random) } else { 0.0 }
            });
            normal[Metric::V] = normal[Metric::D];
            ByFitted::from_fn(|metric| {
                let by_friction: f64 = trial
                    .loads
                    .iter()
                    .zip(&days[trial.day])
                    .zip(&own)
                    .map(|((loads, day), own)| loads[metric] * (day + own))
                    .sum();
                let normal: f64 = normal[metric];
                by_friction + self.deviation(Component::of_metric(metric)) * normal
            })
        });
        trials.collect()
    }

    /// Draws measurements that the fitted model would give with this noise; metrics that were not measured are missing.
    /// The noise of a trial's cycles is scaled to its expectation from the cycles of all trials: estimates that
    /// minimise absolute deviations depend on the density of the noise at zero, which chance differences between trials
    /// raise.
    pub(crate) fn draw(&self, number: usize) -> Vec<DrawnTrial> {
        let noises = self.resampler.draw_noise(number).into_iter();
        let deviations = self.draw_deviations(number, 1.0);
        noises
            .zip(deviations)
            .map(|(mut drawn, deviations)| {
                let measured = self.resampler.measurements[drawn.index].metrics;
                let predicted = self.trials[drawn.index].predicted.as_ref();
                drawn.metrics = ByFitted::from_fn(|metric| {
                    let exact = predicted.map_or(f64::NAN, |of| of[metric]);
                    let noise = self.scales[drawn.index][metric] * drawn.metrics[metric];
                    let value = exact * deviations[metric].exp() + noise;
                    let is_there = measured[metric].is_finite() && value > 0.0;
                    if is_there { value } else { f64::NAN }
                });
                drawn
            })
            .collect()
    }

    /// Returns the degrees of freedom of the estimated variances of the metrics: of those between days (`is_of_day`),
    /// or of those between the trials of a day.
    pub(crate) fn degrees_of_freedom_of(&self, is_of_day: bool) -> f64 {
        let weights = Component::ALL.map(|component| {
            if component.is_of_day() != is_of_day {
                return 0.0;
            }
            self.trials.iter().map(|trial| trial.effects(component).norm_squared()).sum()
        });
        self.components.degrees_of_freedom(&weights, 0.0, f64::INFINITY)
    }

    /// Draws the ratio of the estimated to the true standard deviation of the differences between trials or days, given
    /// the degrees of freedom of the estimate.
    pub(crate) fn draw_ratio(&self, freedom: f64, of: &str, number: usize) -> f64 {
        let mut random = self.resampler.random(of, number);
        draw_deviation_ratio(freedom, &mut random).unwrap_or(1.0)
    }

    /// Returns the coverage factor of each fitted coefficient relative to that of a normal distribution: the ratio of
    /// the 97.5 % quantiles of Student's t distribution, with the degrees of freedom of the coefficient's variance
    /// (Satterthwaite), and of the normal distribution.
    pub(crate) fn widenings(&self, point: &FittedPoint) -> Vec<f64> {
        self.degrees_of_freedom(point).into_iter().map(student).collect()
    }

    /// Returns, for each trial, the matrix that maps errors of the logarithms of its metrics (columns) to errors of the
    /// logarithms of the coefficients (rows); `None` if there is no such linear approximation. The weighted
    /// least-absolute-deviations estimate is approximated by weighted least squares, whose weights are those of the
    /// objective over the standard deviations of the residuals.
    fn estimators(&self, point: &FittedPoint) -> Option<Vec<DMatrix<f64>>> {
        let count = point.values.len();
        let sizes = point.evaluator.objective.campaign_sizes();
        let mut normal = DMatrix::zeros(count, count);
        let mut weighted: Vec<DMatrix<f64>> = Vec::with_capacity(self.trials.len());
        for (index, trial) in self.trials.iter().enumerate() {
            let (condition, _) = point.evaluator.objective.conditions.by_trial[index];
            let slopes =
                point.responses[condition].as_ref().map_or(Vec::new(), Response::relative_slopes);
            let slopes = DMatrix::from_fn(trial.metrics.len(), count, |row, column| {
                slopes.get(column).map_or(0.0, |of| of[trial.metrics[row]])
            });
            let weights = self.weights(point, index) / sizes[index];
            let own = slopes.transpose() * DMatrix::from_diagonal(&weights);
            normal += &own * slopes;
            weighted.push(own);
        }
        // Without the directions that the trials do not determine.
        let inverse = pseudo_inverse(&normal)?;
        Some(weighted.iter().map(|own| &inverse * own).collect())
    }

    /// Returns the weights of a trial's metrics in the objective, each divided by the standard deviation of the
    /// metric's residual.
    fn weights(&self, point: &FittedPoint, index: usize) -> DVector<f64> {
        let objective = point.evaluator.objective;
        let trial = &self.trials[index];
        let mut of_metric = ByFitted::splat(0.0);
        for (metric, weight, _) in objective.terms(&objective.measurements[index]) {
            of_metric[metric] = weight;
        }
        let variation = self.deviations(index);
        DVector::from_fn(trial.metrics.len(), |row, _| {
            let metric = trial.metrics[row];
            // d and v are one measurement with the weight of both.
            let weight = if matches!(metric, Metric::D | Metric::V) {
                of_metric[Metric::D] + of_metric[Metric::V]
            } else {
                of_metric[metric]
            };
            let predicted = trial.predicted.as_ref().map_or(1.0, |of| of[metric]);
            let known = self.known[index][(row, row)].sqrt();
            weight / known.hypot(variation[metric] / predicted)
        })
    }

    /// Returns the degrees of freedom of the variance of each fitted coefficient.
    pub(crate) fn degrees_of_freedom(&self, point: &FittedPoint) -> Vec<f64> {
        let count = point.values.len();
        let Some(estimators) = self.estimators(point) else { return vec![f64::INFINITY; count] };
        let mut by_component = vec![vec![0.0; Component::ALL.len()]; count];
        let mut known = vec![0.0; count];
        let mut of_days: Vec<[DMatrix<f64>; 2]> = (0..self.days)
            .map(|_| [1, self.coefficients].map(|columns| DMatrix::zeros(count, columns)))
            .collect();
        for (index, (trial, estimator)) in self.trials.iter().zip(&estimators).enumerate() {
            let own = estimator * &self.known[index] * estimator.transpose();
            (0..count).for_each(|k| known[k] += own[(k, k)]);
            for component in Component::ALL {
                let effects = estimator * trial.effects(component);
                if component.is_of_day() {
                    of_days[trial.day][component as usize] += effects;
                } else {
                    for k in 0..count {
                        by_component[k][component as usize] += effects.row(k).norm_squared();
                    }
                }
            }
        }
        for day in &of_days {
            for (component, effects) in day.iter().enumerate() {
                for k in 0..count {
                    by_component[k][component] += effects.row(k).norm_squared();
                }
            }
        }
        let of_cycles = self.resampler.degrees_of_freedom();
        (0..count)
            .map(|k| self.components.degrees_of_freedom(&by_component[k], known[k], of_cycles))
            .collect()
    }
}

fn none() -> VarianceComponents {
    let count = Component::ALL.len();
    VarianceComponents {
        variances: vec![0.0; count],
        covariance: DMatrix::zeros(count, count),
        is_identified: vec![false; count],
    }
}

/// Draws relative deviations of the friction coefficients: a common one and independent ones, with the given standard
/// deviations.
fn friction_deviations(
    count: usize,
    [common, each]: [f64; 2],
    random: &mut ChaCha8Rng,
) -> Vec<f64> {
    let mut normal = || -> f64 { StandardNormal.sample(random) };
    let of_all = common * normal();
    (0..count).map(|_| of_all + each * normal()).collect()
}

/// Returns the friction coefficients of the wheels, free or assumed, that are above zero and on which the model
/// depends.
fn friction_coefficients(point: &FittedPoint) -> Vec<FreeParameter> {
    let objective = point.evaluator.objective;
    let robots = objective.robots.with_values(&point.evaluator.parameters, &point.values);
    let of_wheels = |parameter: &Parameter| {
        let definition = parameter.quantity().definition();
        definition.is_resistance && definition.per == Per::Wheel && !parameter.is_sum()
    };
    let parameters = Parameter::OF_ANY_ROBOT.into_iter().filter(of_wheels);
    parameters
        .filter(|parameter| robots.value(*parameter) > 0.0 && objective.depends_on(*parameter))
        .map(|parameter| FreeParameter { parameter, bounds: [0.0, f64::INFINITY] })
        .collect()
}

/// Returns the trials of a fit; `days` are the names of all days.
fn trials(
    point: &FittedPoint,
    resampler: &Resampler,
    friction: &[FreeParameter],
    days: &[&str],
) -> Vec<Trial> {
    let objective = point.evaluator.objective;
    let responses = point.responses_to(friction);
    let noises = resampler.noises();
    let trials = objective.measurements.iter().zip(&noises).enumerate();
    trials
        .map(|(index, (measurement, noises))| {
            let day = days.iter().position(|day| *day == measurement.day).expect("one of the days");
            let response = responses[objective.conditions.by_trial[index].0].as_ref();
            let predicted: Option<ByFitted<f64>> =
                point.metrics_of(index).map(|(metrics, _)| metrics.into());
            let mut metrics: Vec<Metric> =
                objective.terms(measurement).map(|(metric, ..)| metric).collect();
            metrics.retain(|metric| {
                let is_predicted = predicted.is_some_and(|of| of[*metric] > MIN_PREDICTION);
                is_predicted && response.is_some() && noises[*metric] > 0.0
            });
            // d and v are one measurement.
            let has_distance = metrics.contains(&Metric::D);
            metrics.retain(|metric| *metric != Metric::V || !has_distance);
            let none = || vec![ByFitted::splat(0.0); friction.len()];
            let loads = response.map_or_else(none, Response::relative_slopes);
            Trial { day, predicted, loads, metrics }
        })
        .collect()
}

/// Returns the ratios of the standard deviations of a trial's metrics in two covariances: that of its own cycles, and
/// that of the cycles of all trials; 1 for other metrics.
fn scales(trial: &Trial, (own, pooled): (&DMatrix<f64>, &DMatrix<f64>)) -> ByFitted<f64> {
    let mut scales = ByFitted::splat(1.0);
    for (row, metric) in trial.metrics.iter().enumerate() {
        scales[*metric] = (pooled[(row, row)] / own[(row, row)]).sqrt();
    }
    if !trial.metrics.contains(&Metric::V) {
        scales[Metric::V] = scales[Metric::D];
    }
    scales
}

/// Returns the relative covariance of a trial's metrics due to the noise of its cycles and its gait.
fn known_covariance(
    point: &FittedPoint,
    resampler: &Resampler,
    index: usize,
    trial: &Trial,
) -> DMatrix<f64> {
    let noise = resampler.noise(index);
    let count = trial.metrics.len();
    let measured = resampler.measurements[index].metrics;
    let effects = &point.gait_effects[index];
    let of_metric = |metric: Metric| -> Vec<f64> { effects.iter().map(|of| of[metric]).collect() };
    let effects: Vec<Vec<f64>> = trial.metrics.iter().map(|metric| of_metric(*metric)).collect();
    DMatrix::from_fn(count, count, |i, j| {
        let [a, b] = [i, j].map(|k| trial.metrics[k]);
        let covariance = noise.covariance_of_residuals([(a, &effects[i]), (b, &effects[j])]);
        let relative = covariance / (measured[a] * measured[b]);
        relative + if i == j { MIN_DEVIATION.powi(2) } else { 0.0 }
    })
}

/// Replaces the variances of single trials, which are uncertain because each follows from a few cycles, by a power law
/// of the frequency for each metric, so that chance differences between them do not appear as variation between trials.
/// The slope is that of the Theil-Sen line, and the level is the mean of the variances, weighted by their degrees of
/// freedom. Correlations are kept.
fn pool_variances(known: &mut [DMatrix<f64>], trials: &[Trial], measurements: &[Measurement]) {
    for metric in Metric::FITTED {
        let rows: Vec<(usize, usize)> = trials
            .iter()
            .enumerate()
            .filter_map(|(index, trial)| {
                Some((index, trial.metrics.iter().position(|of| *of == metric)?))
            })
            .collect();
        let cycles = |index: usize| measurements[index].cycles.max(1) as f64;
        // Standard deviations of a cycle.
        let points: Vec<[f64; 2]> = rows
            .iter()
            .map(|&(index, row)| {
                let variance = known[index][(row, row)] * cycles(index);
                [measurements[index].frequency_rad_s.ln(), 0.5 * variance.ln()]
            })
            .collect();
        let [_, power] = line(points);
        let law =
            |index: usize| measurements[index].frequency_rad_s.powf(2.0 * power) / cycles(index);
        let [mut sum, mut total] = [0.0; 2];
        for &(index, row) in &rows {
            let freedom = measurements[index].degrees_of_freedom();
            let unbiased = if freedom > 0.0 { c4(freedom).powi(2) } else { 1.0 };
            let weight = freedom.max(1.0);
            sum += weight * unbiased * known[index][(row, row)] / law(index);
            total += weight;
        }
        for &(index, row) in &rows {
            let factor = (sum / total * law(index) / known[index][(row, row)]).sqrt();
            known[index].row_mut(row).scale_mut(factor);
            known[index].column_mut(row).scale_mut(factor);
        }
    }
}

/// Replaces the correlations of each pair of metrics by their mean over the trials, weighted by the degrees of freedom:
/// the correlations of a few cycles are not of full rank.
fn pool_correlations(known: &mut [DMatrix<f64>], trials: &[Trial], measurements: &[Measurement]) {
    let mut sums = ByFitted::from_fn(|_| ByFitted::splat([0.0; 2]));
    for (index, trial) in trials.iter().enumerate() {
        let weight = measurements[index].degrees_of_freedom();
        for (i, a) in trial.metrics.iter().enumerate() {
            for (j, b) in trial.metrics.iter().enumerate() {
                let scale = (known[index][(i, i)] * known[index][(j, j)]).sqrt();
                sums[*a][*b][0] += weight * known[index][(i, j)] / scale;
                sums[*a][*b][1] += weight;
            }
        }
    }
    for (index, trial) in trials.iter().enumerate() {
        let deviations = known[index].diagonal().map(f64::sqrt);
        for (i, a) in trial.metrics.iter().enumerate() {
            for (j, b) in trial.metrics.iter().enumerate().filter(|(j, _)| *j != i) {
                let [sum, total] = sums[*a][*b];
                let correlation = if total > 0.0 { SHRINKAGE * sum / total } else { 0.0 };
                known[index][(i, j)] = correlation * deviations[i] * deviations[j];
            }
        }
    }
}

/// Design of the fixed effects.
struct Design<'d> {
    columns: usize,
    /// Returns the nonzero coefficients, with their columns, for a metric of the trial with the given index.
    row: Row<'d>,
}

type Row<'d> = Box<dyn Fn(usize, Metric) -> Vec<(usize, f64)> + 'd>;

/// Design with the mean of each metric at each frequency.
fn means_by_frequency<'d>(
    frequencies: &[Vec<usize>],
    measurements: &'d [Measurement],
) -> Design<'d> {
    let mut of_trial = vec![0; measurements.len()];
    for (nth, trials) in frequencies.iter().enumerate() {
        trials.iter().for_each(|trial| of_trial[*trial] = nth);
    }
    let metrics = Metric::FITTED.len();
    Design {
        columns: metrics * frequencies.len(),
        row: Box::new(move |trial, metric| {
            vec![(metrics * of_trial[trial] + metric as usize, 1.0)]
        }),
    }
}

/// Design with a polynomial of the logarithm of the frequency for each metric of each campaign.
fn polynomials<'d>(frequencies: &[Vec<usize>], measurements: &'d [Measurement]) -> Design<'d> {
    let campaigns = 1 + measurements.iter().map(|of| of.campaign).max().unwrap_or(0);
    let counts: Vec<usize> = (0..campaigns)
        .map(|campaign| {
            frequencies.iter().filter(|trials| measurements[trials[0]].campaign == campaign).count()
        })
        .collect();
    let ranges: Vec<[f64; 2]> = (0..campaigns)
        .map(|campaign| {
            let own = measurements.iter().filter(|of| of.campaign == campaign);
            trilink_statistics::extremes(own.map(|of| of.frequency_rad_s.ln()))
        })
        .collect();
    let metrics = Metric::FITTED.len();
    let terms = MAX_DEGREE + 1;
    Design {
        columns: campaigns * metrics * terms,
        row: Box::new(move |trial, metric| {
            let measurement = &measurements[trial];
            let campaign = measurement.campaign;
            let degree = MAX_DEGREE.min(counts[campaign].saturating_sub(1) / 2);
            let [low, high] = ranges[campaign];
            let middle = low.midpoint(high);
            let half = (0.5 * (high - low)).max(f64::MIN_POSITIVE);
            let x = (measurement.frequency_rad_s.ln() - middle) / half;
            let first = (campaign * metrics + metric as usize) * terms;
            (0..=degree).map(|power| (first + power, x.powi(power as i32))).collect()
        }),
    }
}
