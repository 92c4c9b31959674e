//! Adequacy of a model: a lack-of-fit test.
//!
//! Residuals of a true model are noise alone: the standard errors of the trial means, the variation of friction between
//! trials and days ([`super::variation`]), the declared standard deviations of the robot parameters, and, where the
//! measured gait drives the model, the effect of errors in the measured gait on the predicted metrics. [`DRAWS`] Monte
//! Carlo draws of this noise are fitted with the model linearised at the fit. They give the joint distribution of
//!
//! - the objective that noise alone leaves (the ratio to its mean is the lack of fit),
//! - the lag-1 autocorrelation of the residuals ordered by frequency, and
//! - the number of runs of residuals of one sign (Wald and Wolfowitz).
//!
//! The model is adequate if all three statistics are within their limits. The limits are such that 95 of 100 draws
//! satisfy them jointly, and that each is exceeded equally often (the minimum-p-value step of Westfall and Young). The
//! two pattern statistics are tested only where the objective exceeds its mean for noise alone. Metrics with unknown
//! noise are not tested; coordinates that were filtered before the export have unknown noise, since their standard
//! errors assume white noise. Nothing is tested unless there are more measurements than free coefficients, since a fit
//! would otherwise absorb nearly all of the noise. The noise is normally distributed, with unbiased standard deviations
//! that are estimated from each trial's cycles and therefore uncertain: each draw is judged by standard deviations that
//! are drawn from the distribution of such estimates.
//!
//! Without repeats, the variation between trials is known only from the residuals themselves. A model that fits with
//! the noise of the cycles alone is adequate; a model that does not fit even with the variation that residuals show
//! beyond a smooth function of the frequency is inadequate; between the two, repeats would have to tell.
//!
//! References: N. R. Draper and H. Smith, *Applied Regression Analysis*, 3rd ed., Wiley 1998,
//! sections 2.1 (lack of fit and pure error) and 7.3 (runs); for the draws Davison and Hinkley
//! 1997, section 4.2; P. H. Westfall and S. S. Young, *Resampling-Based Multiple Testing*, Wiley
//! 1993, section 2.3.

use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use trilink_robot::metrics::{ByFitted, Metric, WeightKey};
use trilink_statistics::{mean, quantiles_low};
use trilink_tables::{Misfit, MisfitRun, Side, Undecided, UndecidedReason};

use super::fitted_point::FittedPoint;
use super::information::changes;
use super::least_absolute::{dot, minimise};
use super::measurement::Measurement;
use super::robots::Robots;
use super::search::limits;
use super::terms::{Target, Terms};
use super::variation::{Variation, VariationFrom};

/// Number of Monte Carlo draws of noise.
const DRAWS: usize = 400;
/// Fraction of the Monte Carlo draws of noise that pass all three tests of adequacy; it determines the limits of the
/// tests. Fits of the true model to simulated recordings pass at a similar rate: 525 of 540 fits in 180 simulated
/// nightly runs (crates/fit/tests/it/coverage.rs).
const LEVEL: f64 = 0.95;
/// Minimum number of degrees of freedom of the variance between days; with fewer, a drawn deviation would have no mean.
const MIN_DAY_FREEDOM: f64 = 2.0;
/// Maximum change in the logarithm of a coefficient for which linearised residuals are used.
const RADIUS: f64 = 1.0;
/// RMS relative misfit beyond which a model is inadequate even if there are too few trials to estimate how much trials
/// differ from each other: trials of one robot hardly differ by more.
const MAX_UNTESTED: f64 = 0.1;
/// Minimum number of residuals for the autocorrelation and runs tests.
const MIN_PATTERN: usize = 5;
/// Magnitude, in standard deviations, below which a residual counts as fitted exactly.
const ZERO: f64 = 1e-4;

/// Result of the lack-of-fit test. Ratios are NaN where the noise is not known, as with filtered coordinates.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Adequacy {
    /// Ratio of the objective to its mean for noise alone, and the upper limit for this ratio.
    pub lack_of_fit: [f64; 2],
    /// Lack-of-fit ratio of the objective's terms that share a metric weight, for each weight in [`WeightKey::ALL`].
    pub by_metric: [f64; WeightKey::ALL.len()],
    /// Largest autocorrelation of the residuals among the metrics, and its upper limit.
    pub autocorrelation: [f64; 2],
    /// Number of runs of residuals of one sign, relative to its mean for independent residuals: the smallest such ratio
    /// among the metrics, and the lower limit for this ratio.
    pub runs: [f64; 2],
    pub is_adequate: Option<bool>,
    /// Metrics, frequencies and sign of the largest deviations, or the RMS deviations where the noise is not known;
    /// `None` for an adequate model, and for one with at least as many coefficients as measurements.
    pub misfit: Option<Misfit>,
    /// Reason why it is not known whether the model is adequate.
    pub undecided: Option<Undecided>,
}

impl Adequacy {
    pub(crate) const UNKNOWN: Self = Self {
        lack_of_fit: [f64::NAN; 2],
        by_metric: [f64::NAN; WeightKey::ALL.len()],
        autocorrelation: [f64::NAN; 2],
        runs: [f64::NAN; 2],
        is_adequate: None,
        misfit: None,
        undecided: None,
    };

    /// Tests a fit for which the model has a periodic solution at every trial.
    pub(crate) fn new(
        point: &FittedPoint,
        variation: &Variation,
        perturbed_robots: &[Robots],
    ) -> Self {
        let assumed = assumed_changes(point, perturbed_robots);
        let test = |variation: &Variation| Self::with_noise(point, variation, &assumed);
        if variation.from == VariationFrom::Repeats {
            return test(variation);
        }
        // Without repeats, a misfit beyond the noise of the cycles may be due to differences between trials.
        let by_cycles = test(&variation.without_variation());
        if by_cycles.is_adequate != Some(false) {
            return by_cycles;
        }
        let (tested, is_refused) = if variation.from == VariationFrom::Residuals {
            let by_residuals = test(variation);
            let is_refused = by_residuals.is_adequate == Some(false);
            (by_residuals, is_refused)
        } else {
            let terms = terms(point, variation);
            let squares = mean(terms.iter().map(|term| term.value.powi(2)));
            (by_cycles, squares.sqrt() > MAX_UNTESTED)
        };
        if is_refused {
            return tested;
        }
        let measurements = &point.evaluator.objective.measurements;
        let undecided = Some(Undecided {
            reason: UndecidedReason::NoRepeats,
            of: repeats_needed(measurements),
        });
        Self { is_adequate: None, undecided, ..tested }
    }

    /// Tests a fit with the given noise.
    fn with_noise(
        point: &FittedPoint,
        variation: &Variation,
        assumed: &[Vec<ByFitted<f64>>],
    ) -> Self {
        let resampler = variation.resampler;
        let terms = terms(point, variation);
        if independent_count(&terms) <= point.values.len() {
            let undecided = Some(UndecidedReason::FewMeasurements.into());
            return Self { undecided, ..Self::UNKNOWN };
        }
        let filtered = resampler.measurements.iter().filter(|of| of.is_filtered).count();
        let without_noise = terms.iter().all(|term| term.deviation == 0.0);
        let tested = if filtered > 0 || without_noise {
            None
        } else {
            Self::tested(point, variation, assumed, &terms)
        };
        tested.unwrap_or_else(|| {
            let undecided = if filtered > 0 {
                let trials = format!("{filtered} of {} trials", resampler.measurements.len());
                Undecided::new(UndecidedReason::Filtered, &trials)
            } else {
                UndecidedReason::UnknownNoise.into()
            };
            let misfit = rms_misfit(&terms);
            Self { misfit, undecided: Some(undecided), ..Self::UNKNOWN }
        })
    }

    /// Tests the terms of the objective with known noise; `None` if that noise is too small or too large for a
    /// comparison.
    fn tested(
        point: &FittedPoint,
        variation: &Variation,
        assumed: &[Vec<ByFitted<f64>>],
        terms: &[Term],
    ) -> Option<Self> {
        let observed_ratios = vec![ByFitted::splat(1.0); variation.resampler.measurements.len()];
        let observed = Statistics::new(terms, |term| term.value, &observed_ratios);
        let drawn = Drawn(draw_statistics(point, variation, assumed, terms));
        let expected_cost = drawn.mean(Statistics::cost);
        let mut noise = ByFitted::splat(0.0);
        terms.iter().for_each(|term| noise[term.metric] += term.weight * term.deviation);
        // The fit passes exactly through all measurements with known noise.
        if expected_cost < ZERO * noise.values().iter().sum::<f64>() {
            return None;
        }
        let level = 1.0 - drawn.per_test_level(expected_cost);
        let [cost, autocorrelation, runs] =
            TESTS.map(|test| [test(&observed), drawn.quantile(test, level)]);
        let lack_of_fit = cost.map(|j| j / expected_cost);
        let runs = runs.map(|runs| -runs);
        // Absurdly small or large standard errors give ratios that are not finite.
        if lack_of_fit.iter().any(|ratio| !ratio.is_finite()) {
            return None;
        }
        let by_metric = WeightKey::ALL.map(|key| {
            let group_cost =
                |all: &Statistics| key.metrics().map(|metric| all.costs[metric]).sum::<f64>();
            group_cost(&observed) / drawn.mean(group_cost)
        });
        let is_patterned = |metric: Metric| {
            observed.autocorrelations[metric] > autocorrelation[1]
                || observed.runs[metric] < runs[1]
        };
        let has_pattern = lack_of_fit[0] > 1.0 && Metric::FITTED.into_iter().any(is_patterned);
        let is_adequate = lack_of_fit[0] <= lack_of_fit[1] && !has_pattern;
        let ratios: ByFitted<f64> =
            ByFitted::from_fn(|i| observed.costs[i] / drawn.mean(|all| all.costs[i]));
        let mut misfitting: Vec<Metric> = Metric::FITTED.into_iter().collect();
        misfitting.retain(|i| observed.costs[*i] > ZERO * noise[*i]);
        misfitting.sort_by(|a, b| ratios[*b].total_cmp(&ratios[*a]));
        // The metrics may fail jointly where none fails by itself: then report the one with the largest ratio.
        let worst = misfitting.first().copied();
        misfitting.retain(|i| {
            let limit =
                drawn.quantile(|all| all.costs[*i], level) / drawn.mean(|all| all.costs[*i]);
            !is_adequate && (ratios[*i] > limit || is_patterned(*i))
        });
        if misfitting.is_empty() && !is_adequate {
            misfitting.extend(worst);
        }
        // v deviates exactly as d does.
        let has_d = misfitting.contains(&Metric::D);
        misfitting.retain(|metric| *metric != Metric::V || !has_d);
        let named = misfitting.into_iter().take(Misfit::MAX_RUNS);
        Some(Self {
            lack_of_fit,
            by_metric,
            autocorrelation,
            runs,
            is_adequate: Some(is_adequate),
            undecided: None,
            misfit: Misfit::off(named.filter_map(|metric| worst_run(terms, metric)).collect()),
        })
    }
}

/// Returns a low, a middle and a high frequency of the trials, at which repeats would tell whether trials differ.
fn repeats_needed(measurements: &[Measurement]) -> Vec<String> {
    let mut all: Vec<f64> = measurements.iter().map(|of| of.frequency_rad_s).collect();
    all.sort_by(f64::total_cmp);
    let mut needed: Vec<String> =
        [0, all.len() / 2, all.len() - 1].map(|index| format!("{:.2} rad/s", all[index])).into();
    needed.dedup();
    needed
}

/// Term of the objective, evaluated at the fit.
struct Term<'o> {
    /// Name of the campaign; empty if only one campaign is fitted.
    campaign: &'o str,
    measurement: usize,
    condition: usize,
    metric: Metric,
    measured: f64,
    omega_rad_s: f64,
    weight: f64,
    /// Residual: ratio of the predicted to the measured metric, minus 1.
    value: f64,
    /// Derivative of the residual with respect to the metric predicted for the condition, the group of trials that
    /// share one periodic solution.
    gain: f64,
    /// Standard deviation of the residual due to noise; 0 if the noise is not known.
    deviation: f64,
}

impl Term<'_> {
    /// Whether the prediction exceeds the measured value.
    fn is_above(&self) -> bool {
        self.value > 0.0
    }

    /// Returns the magnitude of the residual in standard deviations of the noise.
    fn size(&self) -> f64 {
        (self.value / self.deviation).abs()
    }
}

/// Returns the terms of the objective at the fit for all measurements, ordered by campaign and frequency.
fn terms<'o>(point: &FittedPoint<'o>, variation: &Variation) -> Vec<Term<'o>> {
    let objective = point.evaluator.objective;
    let sizes = objective.campaign_sizes();
    let own_noises = variation.resampler.noises();
    let noises = point.noises(variation);
    let mut terms = Vec::new();
    for (measurement, each) in objective.measurements.iter().enumerate() {
        let Some((predicted, ratios)) = point.metrics_of(measurement) else { continue };
        let (condition, _) = objective.conditions.by_trial[measurement];
        let share = 1.0 / sizes[measurement];
        for (metric, weight, measured) in objective.terms(each) {
            let is_known = own_noises[measurement][metric] > 0.0;
            terms.push(Term {
                campaign: &objective.protocol(each).name,
                measurement,
                condition,
                metric,
                measured,
                omega_rad_s: each.frequency_rad_s,
                weight: share * weight,
                value: predicted[metric] / measured - 1.0,
                gain: ratios[metric] / measured,
                deviation: if is_known { noises[measurement][metric] / measured } else { 0.0 },
            });
        }
    }
    terms
}

/// Counts the independent measurements among the terms; d and v of one trial count once.
fn independent_count(terms: &[Term]) -> usize {
    let trials = terms.chunk_by(|a, b| a.measurement == b.measurement);
    trials
        .map(|terms| {
            let has = |metric: Metric| terms.iter().any(|term| term.metric == metric);
            terms.len() - usize::from(has(Metric::D) && has(Metric::V))
        })
        .sum()
}

/// Returns the test statistics for [`DRAWS`] draws of noise.
fn draw_statistics(
    point: &FittedPoint,
    variation: &Variation,
    assumed: &[Vec<ByFitted<f64>>],
    terms: &[Term],
) -> Vec<Statistics> {
    let known = variation.resampler.noises();
    let [day_freedom, trial_freedom] =
        [true, false].map(|is_of_day| variation.degrees_of_freedom_of(is_of_day));
    // A variance near zero has few degrees of freedom by Satterthwaite's formula, but is not likely to be large.
    let day_freedom = day_freedom.max(variation.days() as f64 - 1.0).max(MIN_DAY_FREEDOM);
    let [by_day, by_trial] = [true, false].map(|is_of_day| -> Vec<ByFitted<f64>> {
        (0..known.len()).map(|index| variation.deviations_of(index, is_of_day)).collect()
    });
    let bounds = limits(&point.evaluator.parameters, &point.values, RADIUS);
    (0..DRAWS)
        .into_par_iter()
        .map(|number| {
            // The days are too few to determine their variance, so that the true one is drawn given its estimate.
            let day_factor = 1.0 / variation.draw_ratio(day_freedom, "days", number);
            let noise = draw_noise(point, variation, assumed, terms, number, day_factor);
            let mut left = residuals_after_fit(point, terms, &noise, &bounds).into_iter();
            let of_cycles = variation.resampler.noise_ratios(number);
            let of_trials = variation.draw_ratio(trial_freedom, "told variation", number);
            let ratios: Vec<ByFitted<f64>> = of_cycles
                .iter()
                .enumerate()
                .map(|(index, of_cycles)| {
                    ByFitted::from_fn(|i| {
                        let parts = [known[index][i], by_day[index][i], by_trial[index][i]];
                        let ratios = [*of_cycles, 1.0, of_trials];
                        let square = |part: f64, ratio: f64| (ratio * part).powi(2);
                        let estimated: f64 = parts
                            .iter()
                            .zip(ratios)
                            .map(|(part, ratio)| square(*part, ratio))
                            .sum();
                        let exact: f64 = parts.iter().map(|part| square(*part, 1.0)).sum();
                        let ratio = (estimated / exact).sqrt();
                        if ratio.is_finite() { ratio } else { 1.0 }
                    })
                })
                .collect();
            Statistics::new(terms, |_| left.next().unwrap_or(f64::NAN), &ratios)
        })
        .collect()
}

/// Draws residuals that consist of noise alone, as if the fitted model were true. `assumed` are the relative changes of
/// the predicted metrics per standard deviation of each uncertain robot parameter. The differences between days are
/// multiplied by `day_factor`.
fn draw_noise(
    point: &FittedPoint,
    variation: &Variation,
    assumed: &[Vec<ByFitted<f64>>],
    terms: &[Term],
    number: usize,
    day_factor: f64,
) -> Vec<f64> {
    let drawn = variation.resampler.draw_noise(number);
    let deviations = variation.draw_deviations(number, day_factor);
    let mut random = variation.resampler.random("assumed", number);
    let shifts: Vec<f64> = assumed.iter().map(|_| StandardNormal.sample(&mut random)).collect();
    let residuals = terms.iter().map(|term| {
        if term.deviation == 0.0 {
            return 0.0;
        }
        let &Term { measurement: index, metric, measured, .. } = term;
        let deviations_rad = variation.resampler.noise(index).gait_deviations_rad();
        let steps_rad = drawn[index].gait_steps_rad.as_flattened();
        let by_gait: f64 = point.gait_effects[index]
            .iter()
            .zip(steps_rad.iter().zip(deviations_rad))
            .filter(|(_, (_, deviation_rad))| **deviation_rad > 0.0)
            .map(|(effects, (step_rad, deviation_rad))| effects[metric] * step_rad / deviation_rad)
            .sum();
        let by_assumed: f64 =
            assumed.iter().zip(&shifts).map(|(of, shift)| shift * of[index][metric]).sum();
        (by_gait - drawn[index].metrics[metric]) / measured - deviations[index][metric] - by_assumed
    });
    residuals.collect()
}

/// Returns, for each uncertain robot parameter, the relative changes of the metrics of every trial when the parameter
/// is increased by its standard deviation; 0 where the changed robot has no periodic solution.
fn assumed_changes(point: &FittedPoint, perturbed_robots: &[Robots]) -> Vec<Vec<ByFitted<f64>>> {
    let objective = point.evaluator.objective;
    perturbed_robots
        .par_iter()
        .map(|robots| {
            let metrics = point.metrics_of_robots(robots, &point.values);
            let trials = objective.conditions.by_trial.iter().map(|(condition, _)| {
                let response = point.responses[*condition].as_ref();
                response.map_or(ByFitted::splat(0.0), |response| {
                    changes(&response.metrics, metrics[*condition].as_ref())
                })
            });
            trials.collect()
        })
        .collect()
}

/// Returns what remains of the given `residuals` after a fit with the linearised model.
fn residuals_after_fit(
    point: &FittedPoint,
    terms: &[Term],
    residuals: &[f64],
    bounds: &[[f64; 2]],
) -> Vec<f64> {
    // Residuals as functions of the change in each condition's metric by the fit.
    let targets = terms.iter().zip(residuals).map(|(term, residual)| {
        let &Term { condition, metric, gain, .. } = term;
        Target { condition, metric, value: -residual / gain, weight: term.weight * gain }
    });
    let shares = vec![1.0; point.responses.len()];
    let mut changes = Terms::new(shares, targets).residuals(&point.responses);
    changes.iter_mut().for_each(|change| change.value = 0.0);
    let step = minimise(&changes, bounds, None);
    let changes: Vec<ByFitted<f64>> = point
        .responses
        .iter()
        .map(|response| {
            ByFitted::from_fn(|metric| {
                let slopes = response.as_ref().map(|of| of.affine(metric).1);
                slopes.map_or(0.0, |slopes| dot(&slopes, step.as_slice()))
            })
        })
        .collect();
    let left = terms
        .iter()
        .zip(residuals)
        .map(|(term, residual)| residual + term.gain * changes[term.condition][term.metric]);
    left.collect()
}

/// Test statistics of a set of residuals.
struct Statistics {
    /// Contribution of each metric with known noise to the objective, divided by the mean ratio of the estimated to the
    /// true standard deviation of the noise.
    costs: ByFitted<f64>,
    autocorrelations: ByFitted<f64>,
    runs: ByFitted<f64>,
}

impl Statistics {
    /// Computes the statistics of residuals; `ratios` are the ratios of the estimated to the true standard deviation of
    /// the noise, one for each measurement.
    fn new(
        terms: &[Term],
        mut residual: impl FnMut(&Term) -> f64,
        ratios: &[ByFitted<f64>],
    ) -> Self {
        let mut costs = ByFitted::splat(0.0);
        let mut noise = 0.0;
        let mut estimated_noise = 0.0;
        let mut series: ByFitted<Vec<f64>> = ByFitted::from_fn(|_| Vec::new());
        for term in terms {
            let value = residual(term);
            if term.deviation > 0.0 {
                let ratio = ratios[term.measurement][term.metric];
                costs[term.metric] += term.weight * value.abs();
                series[term.metric].push(value / (term.deviation * ratio));
                noise += term.weight * term.deviation;
                estimated_noise += term.weight * term.deviation * ratio;
            }
        }
        costs.iter_mut().for_each(|(_, cost)| *cost *= noise / estimated_noise);
        // The residuals of v have the same pattern as those of d: v is not tested separately.
        series[Metric::V].clear();
        let autocorrelations = ByFitted::from_fn(|metric| autocorrelation(&series[metric]));
        Self { costs, autocorrelations, runs: series.map(|series| runs(&series)) }
    }

    fn cost(&self) -> f64 {
        self.costs.values().iter().sum()
    }

    fn autocorrelation(&self) -> f64 {
        self.autocorrelations.values().iter().copied().fold(f64::NAN, f64::max)
    }

    fn runs(&self) -> f64 {
        self.runs.values().iter().copied().fold(f64::NAN, f64::min)
    }
}

/// Test statistics; large values are evidence against the model.
const TESTS: [fn(&Statistics) -> f64; 3] =
    [Statistics::cost, Statistics::autocorrelation, |all| -all.runs()];

/// Test statistics for all draws of noise.
struct Drawn(Vec<Statistics>);

impl Drawn {
    fn mean(&self, statistic: impl Fn(&Statistics) -> f64) -> f64 {
        mean(self.0.iter().map(statistic))
    }

    fn quantile(&self, statistic: impl Fn(&Statistics) -> f64, level: f64) -> f64 {
        quantiles_low(self.0.iter().map(statistic).collect(), [level])[0]
    }

    /// Returns the significance level per test at which a fraction [`LEVEL`] of the draws pass all tests;
    /// `expected_cost` is the mean objective of the draws.
    fn per_test_level(&self, expected_cost: f64) -> f64 {
        let [of_cost, of_autocorrelation, of_runs] = TESTS.map(|test| self.p_values(test));
        let smallest = self.0.iter().enumerate().map(|(i, all)| {
            if all.cost() > expected_cost {
                of_cost[i].min(of_autocorrelation[i]).min(of_runs[i])
            } else {
                of_cost[i]
            }
        });
        quantiles_low(smallest.collect(), [1.0 - LEVEL])[0]
    }

    /// Returns the p-value of each draw in one test, among all draws.
    fn p_values(&self, test: fn(&Statistics) -> f64) -> Vec<f64> {
        let mut sorted: Vec<f64> = self.0.iter().map(test).collect();
        sorted.sort_by(f64::total_cmp);
        let draws = self.0.iter().map(|all| {
            let value = test(all);
            let below = sorted.partition_point(|other| other.total_cmp(&value).is_lt());
            1.0 - below as f64 / self.0.len() as f64
        });
        draws.collect()
    }
}

/// Returns the lag-1 autocorrelation of residuals about zero; NaN for fewer than [`MIN_PATTERN`] residuals.
fn autocorrelation(series: &[f64]) -> f64 {
    if series.len() < MIN_PATTERN {
        return f64::NAN;
    }
    let products = series.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>();
    products / series.iter().map(|z| z * z).sum::<f64>()
}

/// Returns the number of runs of residuals of one sign, divided by its mean for independent signs, (n + 1) / 2; NaN for
/// fewer than [`MIN_PATTERN`] residuals.
fn runs(series: &[f64]) -> f64 {
    let signs: Vec<bool> =
        series.iter().filter(|z| z.abs() > ZERO).map(|z| z.is_sign_positive()).collect();
    if signs.len() < MIN_PATTERN {
        return f64::NAN;
    }
    let count = signs.chunk_by(|a, b| a == b).count() as f64;
    count / (0.5 * (signs.len() + 1) as f64)
}

/// Returns the range of neighbouring frequencies over which a metric's residuals have one sign and deviate most; `None`
/// if the metric has no residuals with known noise.
fn worst_run(terms: &[Term], metric: Metric) -> Option<MisfitRun> {
    let known = terms.iter().filter(|term| term.metric == metric && term.deviation > 0.0);
    let known: Vec<&Term> = known.collect();
    let runs = known.chunk_by(|a, b| {
        a.campaign == b.campaign && (a.is_above() == b.is_above() || b.size() <= ZERO)
    });
    let worst = runs.max_by(|a, b| {
        let [a, b] = [a, b].map(|run| run.iter().map(|term| term.size()).sum::<f64>());
        a.total_cmp(&b)
    })?;
    // The fit may have made all these residuals small.
    let largest = worst.iter().map(|term| term.size()).fold(0.0, f64::max);
    let deviating = worst.iter().filter(|term| term.size() >= largest.min(1.0));
    let deviating: Vec<&&Term> = deviating.collect();
    let (first, last) = (deviating.first()?, deviating.last()?);
    // The residual compares predicted with measured; the report compares measured with predicted.
    let relative = deviating.iter().map(|term| (1.0 / (1.0 + term.value) - 1.0).abs());
    let [least, most] = trilink_statistics::extremes(relative);
    let side = if first.is_above() { Side::Below } else { Side::Above };
    let (side, [least, most]) = match (least.is_finite(), most.is_finite()) {
        (false, _) => (Side::Absent, [f64::NAN; 2]),
        // The model does not predict this metric at some of the frequencies.
        (true, false) => (side, [least; 2]),
        (true, true) => (side, [least, most]),
    };
    Some(MisfitRun {
        side,
        metric,
        campaign: first.campaign.to_owned(),
        least,
        most,
        largest: known
            .iter()
            .map(|term| term.value)
            .filter(|value| value.is_finite())
            .max_by(|a, b| a.abs().total_cmp(&b.abs()))
            .unwrap_or(f64::NAN),
        from_rad_s: first.omega_rad_s,
        to_rad_s: last.omega_rad_s,
    })
}

/// Returns the RMS relative deviation of each metric, which is reported if the noise is not known; `None` if there are
/// no terms.
fn rms_misfit(terms: &[Term]) -> Option<Misfit> {
    Misfit::rms(ByFitted::from_fn(|metric| {
        let of_metric = terms.iter().filter(|term| term.metric == metric);
        mean(of_metric.map(|term| term.value.powi(2))).sqrt()
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smooth_misfit_has_a_large_autocorrelation_and_few_runs() {
        let smooth = [-2.0, -1.0, -1.0, 0.5, 1.0, 2.0, 2.0];
        let rough = [-2.0, 1.0, -1.0, 0.5, -1.0, 2.0, -2.0];
        assert!(autocorrelation(&smooth) > 0.5 && autocorrelation(&rough) < -0.5);
        assert_eq!((runs(&smooth), runs(&rough)), (0.5, 1.75));
        // Residuals that are fitted exactly are ignored.
        assert_eq!(runs(&[1.0, 1.0, 1e-9, -1e-9, 1.0, 1.0, 1.0]), 1.0 / 3.0);
        assert!(runs(&smooth[..4]).is_nan() && autocorrelation(&smooth[..4]).is_nan());
    }

    #[test]
    fn the_level_per_test_gives_the_joint_level() {
        // Permutations without correlation between them.
        let draw = |i: usize| {
            let fraction = |factor: usize| (i * factor % 401) as f64 / 401.0;
            let [mut costs, mut autocorrelations, mut runs] = [ByFitted::splat(f64::NAN); 3];
            costs = costs.map(|_| 0.5 + fraction(37));
            autocorrelations[Metric::D] = fraction(101);
            runs[Metric::D] = fraction(211);
            Statistics { costs, autocorrelations, runs }
        };
        let drawn = Drawn((1..=DRAWS).map(draw).collect());
        let expected_cost = drawn.mean(Statistics::cost);
        let level = drawn.per_test_level(expected_cost);
        // Between the level of a single test and Bonferroni's, since the patterns are tested in only half of the draws.
        assert!(level > 0.05 / 3.0 && level < 0.05, "{level}");
        let limits = TESTS.map(|test| drawn.quantile(test, 1.0 - level));
        let is_adequate = |all: &&Statistics| {
            let has_pattern = all.autocorrelation() > limits[1] || -all.runs() > limits[2];
            all.cost() <= limits[0] && !(has_pattern && all.cost() > expected_cost)
        };
        let adequate = drawn.0.iter().filter(is_adequate).count();
        assert!(adequate.abs_diff(380) <= 3, "{adequate}");
        // Without pattern statistics, only the objective is tested.
        let without_pattern = |i| Statistics {
            autocorrelations: ByFitted::splat(f64::NAN),
            runs: ByFitted::splat(f64::NAN),
            ..draw(i)
        };
        let drawn = Drawn((1..=DRAWS).map(without_pattern).collect());
        assert!((drawn.per_test_level(expected_cost) - 0.05).abs() < 0.003);
    }

    #[test]
    fn the_worst_run_is_named_with_its_side_and_frequencies() {
        let term = |(omega_rad_s, value): (f64, f64)| Term {
            campaign: "",
            measurement: 0,
            condition: 0,
            metric: Metric::Sigma0,
            measured: 0.03,
            omega_rad_s,
            weight: 1.0,
            value,
            gain: 1.0 / 0.03,
            deviation: 0.01,
        };
        // Ratios of predicted to measured, minus 1.
        let values = [(0.5, -0.03), (1.0, 0.002), (2.0, -0.02), (3.0, 0.25), (4.0, 1.0 / 3.0)];
        let terms: Vec<Term> = values.into_iter().map(term).collect();
        let text = |terms: &[Term]| worst_run(terms, Metric::Sigma0).map(|run| run.to_string());
        assert_eq!(
            text(&terms).as_deref(),
            Some("the measured sigma0 is 20 to 25 % below that of the model at 3 to 4 rad/s")
        );
        assert_eq!(
            text(&terms[..1]).as_deref(),
            Some("the measured sigma0 is 3.1 % above that of the model at 0.5 rad/s")
        );
        let largest = |terms: &[Term]| worst_run(terms, Metric::Sigma0).expect("a run").largest;
        assert_eq!([largest(&terms), largest(&terms[..3])], [1.0 / 3.0, -0.03]);
        // A run within the noise is reported by its largest deviation.
        assert_eq!(
            text(&terms[1..2]).as_deref(),
            Some("the measured sigma0 is 0.20 % below that of the model at 1 rad/s")
        );
        assert_eq!(worst_run(&terms, Metric::D), None);
        let rms = rms_misfit(&terms[3..]).map(|misfit| misfit.to_string());
        assert_eq!(rms.as_deref(), Some("the RMS error of the model is 29 % in sigma0"));
        assert_eq!(rms_misfit(&[]), None);
        // A model without skid.
        let none = [(0.5, -1.0), (1.0, -1.0)].map(term);
        assert_eq!(text(&none).as_deref(), Some("the model predicts no sigma0 at 0.5 to 1 rad/s"));
    }
}
