//! Whether a model is adequate: a lack-of-fit test.
//!
//! A model that is true misses the measurements by their noise alone: by the standard errors of
//! the cycles' means, by what repeats of a frequency differ by (pure error, where there are
//! repeats), and where the measured gait drives the model by what that gait's own errors make of
//! its motion. Noise is drawn by these [`DRAWS`] times and fitted with the model linearised at the
//! fit; so often is the distribution known of
//!
//! - the objective that noise alone leaves (the ratio to its mean is the lack of fit),
//! - the lag-1 autocorrelation of the residuals over frequency, and
//! - the runs of residuals of one sign (Wald and Wolfowitz).
//!
//! The model is adequate if none of the three is outside of limits that 95 of 100 draws are all
//! within, and that each of the three is as often outside of (Westfall and Young's step of the
//! least p-value); a pattern counts where the objective is more than noise alone leaves on average.
//! What a metric is off by without anything that tells its noise does not
//! count, and nothing tells it where coordinates were filtered before the export: errors are then of
//! noise that is not white. No more measurements than free coefficients test nothing: noise would leave next to
//! nothing of them. Errors are normally distributed with the standard deviations that their trial's
//! cycles tell, without bias, and not exactly: a draw is judged by what its own cycles and repeats
//! would tell.
//! Assumed is that trials err independently of each other; what they share counts as misfit.
//!
//! Reference: N. R. Draper and H. Smith, *Applied Regression Analysis*, 3rd ed., Wiley 1998,
//! sections 2.1 (lack of fit and pure error) and 7.3 (runs); for the draws Davison and Hinkley
//! 1997, section 4.2; P. H. Westfall and S. S. Young, *Resampling-Based Multiple Testing*, Wiley
//! 1993, section 2.3.

use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use trilink_robot::metrics::{ByFitted, Metric, WeightKey};
use trilink_statistics::{mean, quantiles_low};
use trilink_tables::{Misfit, MisfitRms, MisfitRun, Side};

use super::fitted_point::FittedPoint;
use super::least_absolute::{dot, minimise};
use super::resampler::Resampler;
use super::search::limits;
use super::terms::{Response, Target, Terms};

/// Draws of noise.
const DRAWS: usize = 400;
/// Part of them that an adequate model is within, by all three tests. Of recordings it is about as many: 522 of
/// the 540 fits of 180 nights by the model that is true (crates/fit/tests/it/coverage.rs).
const LEVEL: f64 = 0.95;
/// Linearised residuals are good within about this factor's logarithm.
const RADIUS: f64 = 1.0;
/// Fewer residuals have no pattern.
const LEAST_PATTERN: usize = 5;
/// Standard deviations below which a residual is one of those that the fit has made zero.
const ZERO: f64 = 1e-4;

/// The result of the test. Ratios are NaN where nothing tells the noise, as of filtered coordinates.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Adequacy {
    /// The objective over the mean of what noise alone leaves, and the limit of this ratio.
    pub lack_of_fit: [f64; 2],
    /// The ratio for the terms of each of [`WeightKey::ALL`].
    pub by_metric: [f64; WeightKey::ALL.len()],
    /// The largest of a metric's residuals, and its limit.
    pub autocorrelation: [f64; 2],
    /// The fewest, over the number of independent residuals', and its limit.
    pub runs: [f64; 2],
    pub is_adequate: Option<bool>,
    /// Where and to which side the measurements are off, or by how much where nothing tells the noise; `None`
    /// for an adequate model, and for one with as many coefficients as measurements.
    pub misfit: Option<Misfit>,
}

impl Adequacy {
    pub(crate) const UNKNOWN: Self = Self {
        lack_of_fit: [f64::NAN; 2],
        by_metric: [f64::NAN; WeightKey::ALL.len()],
        autocorrelation: [f64::NAN; 2],
        runs: [f64::NAN; 2],
        is_adequate: None,
        misfit: None,
    };

    /// Tests a fit all motions of which exist.
    pub(crate) fn new(point: &FittedPoint, resampler: &Resampler) -> Self {
        let terms = terms(point, resampler);
        if independent(&terms) <= point.values.len() {
            return Self::UNKNOWN;
        }
        let unknown = || Self { misfit: how_far_off(&terms), ..Self::UNKNOWN };
        let is_filtered = resampler.measurements.iter().any(|of| of.is_filtered);
        if is_filtered || terms.iter().all(|term| term.deviation == 0.0) {
            return unknown();
        }
        let exactly = vec![ByFitted::splat(1.0); resampler.measurements.len()];
        let observed = Statistics::new(&terms, |term| term.value, &exactly);
        let bounds = limits(&point.evaluator.parameters, &point.values, RADIUS);
        let drawn: Vec<Statistics> = (0..DRAWS)
            .into_par_iter()
            .map(|number| {
                let (noise, told) = noise(point, resampler, &terms, number);
                let left = left_by_fit(point, &terms, &noise, &bounds);
                let mut left = left.into_iter();
                Statistics::new(&terms, |_| left.next().unwrap_or(f64::NAN), &told)
            })
            .collect();
        let alone = |of: &dyn Fn(&Statistics) -> f64| mean(drawn.iter().map(of));
        let explained = alone(&Statistics::cost);
        let mut noise = ByFitted::splat(0.0);
        terms.iter().for_each(|term| noise[term.metric] += term.weight * term.deviation);
        // It goes through all measurements the noise of which is known, whatever they are.
        if explained < ZERO * noise.values().iter().sum::<f64>() {
            return unknown();
        }
        let part = 1.0 - rarity(&drawn, explained);
        let highest = |of: &dyn Fn(&Statistics) -> f64| {
            quantiles_low(drawn.iter().map(of).collect(), [part])[0]
        };
        let [cost, autocorrelation, runs] = TESTS.map(|test| [test(&observed), highest(&test)]);
        let (lack_of_fit, runs) = (cost.map(|j| j / explained), runs.map(|runs| -runs));
        // Absurd errors tell nothing.
        if lack_of_fit.iter().any(|ratio| !ratio.is_finite()) {
            return unknown();
        }
        let by_metric = WeightKey::ALL.map(|key| {
            let of_group = |all: &Statistics| key.metrics().map(|i| all.costs[i]).sum::<f64>();
            of_group(&observed) / alone(&of_group)
        });
        let is_patterned = |i: Metric| {
            observed.autocorrelations[i] > autocorrelation[1] || observed.runs[i] < runs[1]
        };
        // Of each metric.
        let ratios: ByFitted<f64> =
            ByFitted::from_fn(|i| observed.costs[i] / alone(&|all| all.costs[i]));
        let has_pattern = lack_of_fit[0] > 1.0 && Metric::FITTED.into_iter().any(is_patterned);
        let is_adequate = lack_of_fit[0] <= lack_of_fit[1] && !has_pattern;
        let is_off = |i: &Metric| {
            let most = highest(&|all| all.costs[*i]) / alone(&|all| all.costs[*i]);
            !is_adequate && (ratios[*i] > most || is_patterned(*i))
        };
        let is_left = |i: &Metric| observed.costs[*i] > ZERO * noise[*i];
        let mut off: Vec<Metric> = Metric::FITTED.into_iter().filter(is_left).collect();
        off.sort_by(|a, b| ratios[*b].total_cmp(&ratios[*a]));
        // All together they may be off where none is by itself: then the one that is the most.
        let first = off.first().copied();
        off.retain(is_off);
        if off.is_empty() && !is_adequate {
            off.extend(first);
        }
        // v errs as d does.
        let has_d = off.contains(&Metric::D);
        off.retain(|i| *i != Metric::V || !has_d);
        let named = off.into_iter().take(Misfit::MOST).filter_map(|i| where_off(&terms, i));
        Self {
            lack_of_fit,
            by_metric,
            autocorrelation,
            runs,
            is_adequate: Some(is_adequate),
            misfit: Misfit::off(named.collect()),
        }
    }
}

/// A term of the objective at the fit.
struct Term<'o> {
    /// The campaign, where it is not alone.
    campaign: &'o str,
    measurement: usize,
    condition: usize,
    metric: Metric,
    measured: f64,
    omega_rad_s: f64,
    weight: f64,
    /// Predicted over measured, less 1.
    value: f64,
    /// By how much that changes with the condition's metric.
    gain: f64,
    /// Standard deviation of that by noise; 0 if nothing tells it.
    deviation: f64,
}

/// The terms of all measurements, by frequency.
fn terms<'o>(point: &FittedPoint<'o>, resampler: &Resampler) -> Vec<Term<'o>> {
    let objective = point.evaluator.objective;
    let sizes = objective.campaign_sizes();
    let mut terms = Vec::new();
    let noises = resampler.noises().into_iter().zip(point.noises(resampler));
    for ((measurement, each), (own, all)) in objective.measurements.iter().enumerate().zip(noises) {
        let Some((predicted, ratios)) = point.metrics_of(measurement) else { continue };
        let condition = objective.conditions.of_trials[measurement].0;
        let (share, campaign) = (1.0 / sizes[measurement], &*objective.protocol(each).name);
        for (metric, weight, measured) in objective.terms(each) {
            let value = predicted[metric] / measured - 1.0;
            let (weight, gain) = (share * weight, ratios[metric] / measured);
            let deviation = if own[metric] > 0.0 { all[metric] / measured } else { 0.0 };
            let omega_rad_s = each.frequency_rad_s;
            terms.push(Term {
                campaign,
                measurement,
                condition,
                metric,
                measured,
                omega_rad_s,
                weight,
                value,
                gain,
                deviation,
            });
        }
    }
    terms
}

/// How many measurements they are of.
fn independent(terms: &[Term]) -> usize {
    let of_trial = |terms: &[Term]| {
        let has = |metric: Metric| terms.iter().any(|term| term.metric == metric);
        terms.len() - usize::from(has(Metric::D) && has(Metric::V))
    };
    terms.chunk_by(|a, b| a.measurement == b.measurement).map(of_trial).sum()
}

/// Residuals of noise alone, where the fit is the truth; and how many times their noise would be told.
fn noise(
    point: &FittedPoint,
    resampler: &Resampler,
    terms: &[Term],
    number: usize,
) -> (Vec<f64>, Vec<ByFitted<f64>>) {
    let mut random = ["noise", "gait noise"].map(|purpose| resampler.random(purpose, number));
    let errors: Vec<ByFitted<f64>> = resampler
        .noises_and_spreads()
        .zip(&point.gait_effects)
        .map(|((noise, spread), effects)| {
            let drawn = noise.draw(&mut random);
            let mut own: ByFitted<f64> =
                ByFitted::from_fn(|_| StandardNormal.sample(&mut random[0]));
            own[Metric::V] = own[Metric::D];
            ByFitted::from_fn(|i| {
                let by_gait = effects.iter().zip(&drawn.gait).map(|(of, gait)| of[i] * gait);
                let measured = drawn.metrics[i] * noise.deviation(i) + own[i] * spread[i];
                by_gait.sum::<f64>() - measured
            })
        })
        .collect();
    let of_term = |term: &Term| match term.deviation > 0.0 {
        true => errors[term.measurement][term.metric] / term.measured,
        false => 0.0,
    };
    (terms.iter().map(of_term).collect(), resampler.told(number))
}

/// What a fit leaves of residuals.
fn left_by_fit(
    point: &FittedPoint,
    terms: &[Term],
    residuals: &[f64],
    bounds: &[[f64; 2]],
) -> Vec<f64> {
    // As functions of what the fit changes a condition's metric by.
    let target = |(term, residual): (&Term, &f64)| {
        let &Term { condition, metric, gain, .. } = term;
        Target { condition, metric, value: -residual / gain, weight: term.weight * gain }
    };
    let shares = vec![1.0; point.responses.len()];
    let changes = Terms::new(shares, terms.iter().zip(residuals).map(target));
    let mut changes = changes.residuals(&point.responses);
    changes.iter_mut().for_each(|change| change.value = 0.0);
    let step = minimise(&changes, bounds, None);
    let changes: Vec<ByFitted<f64>> = point
        .responses
        .iter()
        .map(|response| {
            let change = |of: &Response, metric| dot(&of.affine(metric).1, step.as_slice());
            ByFitted::from_fn(|metric| response.as_ref().map_or(0.0, |of| change(of, metric)))
        })
        .collect();
    let left = |(term, residual): (&Term, &f64)| {
        residual + term.gain * changes[term.condition][term.metric]
    };
    terms.iter().zip(residuals).map(left).collect()
}

/// What is tested of residuals.
struct Statistics {
    /// Contributions of the metrics to the objective, as far as their noise is known, over how many times the
    /// noise is told.
    costs: ByFitted<f64>,
    autocorrelations: ByFitted<f64>,
    runs: ByFitted<f64>,
}

impl Statistics {
    /// Of residuals, and of how many times its noise is told of each measurement.
    fn new(terms: &[Term], mut residual: impl FnMut(&Term) -> f64, told: &[ByFitted<f64>]) -> Self {
        let mut costs = ByFitted::splat(0.0);
        let [mut noise, mut told_noise] = [0.0; 2];
        let mut series: ByFitted<Vec<f64>> = ByFitted::from_fn(|_| Vec::new());
        for term in terms {
            let value = residual(term);
            if term.deviation > 0.0 {
                let told = told[term.measurement][term.metric];
                costs[term.metric] += term.weight * value.abs();
                series[term.metric].push(value / (term.deviation * told));
                noise += term.weight * term.deviation;
                told_noise += term.weight * term.deviation * told;
            }
        }
        costs.iter_mut().for_each(|(_, cost)| *cost *= noise / told_noise);
        // v has no pattern of its own.
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

/// What is tested, the more of it the worse.
const TESTS: [fn(&Statistics) -> f64; 3] =
    [Statistics::cost, Statistics::autocorrelation, |all| -all.runs()];

/// How rare each test may find an adequate model, so that [`LEVEL`] of the draws are adequate, of
/// which the objective is so large on average.
fn rarity(drawn: &[Statistics], explained: f64) -> f64 {
    let [of_cost, of_autocorrelation, of_runs] = TESTS.map(|test| {
        let mut sorted: Vec<f64> = drawn.iter().map(test).collect();
        sorted.sort_by(f64::total_cmp);
        let below = |value: f64| sorted.partition_point(|other| other.total_cmp(&value).is_lt());
        let part = |all| 1.0 - below(test(all)) as f64 / drawn.len() as f64;
        drawn.iter().map(part).collect::<Vec<f64>>()
    });
    let rarest = |(i, all): (usize, &Statistics)| match all.cost() > explained {
        true => of_cost[i].min(of_autocorrelation[i]).min(of_runs[i]),
        false => of_cost[i],
    };
    quantiles_low(drawn.iter().enumerate().map(rarest).collect(), [1.0 - LEVEL])[0]
}

/// Lag-1 autocorrelation of residuals around zero; NaN of a few.
fn autocorrelation(series: &[f64]) -> f64 {
    if series.len() < LEAST_PATTERN {
        return f64::NAN;
    }
    let products = series.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>();
    products / series.iter().map(|z| z * z).sum::<f64>()
}

/// Runs of one sign, over the (n + 1) / 2 that independent signs have on average; NaN of a few.
fn runs(series: &[f64]) -> f64 {
    let signs: Vec<bool> =
        series.iter().filter(|z| z.abs() > ZERO).map(|z| z.is_sign_positive()).collect();
    if signs.len() < LEAST_PATTERN {
        return f64::NAN;
    }
    let count = signs.chunk_by(|a, b| a == b).count() as f64;
    count / (0.5 * (signs.len() + 1) as f64)
}

/// Of a metric's residuals of one sign at neighbouring frequencies those that are the furthest
/// off.
fn where_off(terms: &[Term], metric: Metric) -> Option<MisfitRun> {
    let known = terms.iter().filter(|term| term.metric == metric && term.deviation > 0.0);
    let known: Vec<&Term> = known.collect();
    let size = |term: &&Term| (term.value / term.deviation).abs();
    let sign = |term: &&Term| term.value > 0.0;
    let goes_on =
        |a: &&Term, b: &&Term| a.campaign == b.campaign && (sign(a) == sign(b) || size(b) <= ZERO);
    let furthest = known.chunk_by(goes_on).max_by(|a, b| {
        let sum = |run: &[&Term]| run.iter().map(size).sum::<f64>();
        sum(a).total_cmp(&sum(b))
    })?;
    // Predicted over measured, less 1, as measured over predicted.
    let part = |term: &&Term| (1.0 / (1.0 + term.value) - 1.0).abs();
    // The fit may have brought all of them near.
    let largest = furthest.iter().map(size).fold(0.0, f64::max);
    let off = furthest.iter().filter(|term| size(term) >= largest.min(1.0));
    let off: Vec<&&Term> = off.collect();
    let (first, last) = (off.first()?, off.last()?);
    let [least, most] = trilink_statistics::extremes(off.iter().map(|term| part(term)));
    let (side, [least, most]) = match (least.is_finite(), most.is_finite()) {
        (false, _) => (Side::Absent, [f64::NAN; 2]),
        // It has none at some of the frequencies.
        (true, is_everywhere) => {
            let side = if first.value > 0.0 { Side::Below } else { Side::Above };
            (side, [least, if is_everywhere { most } else { least }])
        }
    };
    Some(MisfitRun {
        side,
        metric,
        campaign: first.campaign.to_owned(),
        least,
        most,
        from_rad_s: first.omega_rad_s,
        to_rad_s: last.omega_rad_s,
    })
}

/// By how much each metric is off, where there is no noise to compare that with.
fn how_far_off(terms: &[Term]) -> Option<Misfit> {
    let [d, v, sigma @ .., alpha1] = Metric::FITTED.map(|metric| {
        let of_metric = terms.iter().filter(|term| term.metric == metric);
        mean(of_metric.map(|term| term.value.powi(2))).sqrt()
    });
    Misfit::rms(MisfitRms { d, v, sigma, alpha1 })
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
        // Residuals that the fit has made zero have no sign.
        assert_eq!(runs(&[1.0, 1.0, 1e-9, -1e-9, 1.0, 1.0, 1.0]), 1.0 / 3.0);
        assert!(runs(&smooth[..4]).is_nan() && autocorrelation(&smooth[..4]).is_nan());
    }

    #[test]
    fn so_many_draws_of_noise_alone_are_adequate_by_all_tests_at_once() {
        // Permutations that do not go with one another.
        let draw = |i: usize| {
            let part = |of: usize| (i * of % 401) as f64 / 401.0;
            let [mut costs, mut autocorrelations, mut runs] = [ByFitted::splat(f64::NAN); 3];
            costs = costs.map(|_| 0.5 + part(37));
            (autocorrelations[Metric::D], runs[Metric::D]) = (part(101), part(211));
            Statistics { costs, autocorrelations, runs }
        };
        let drawn: Vec<Statistics> = (1..=DRAWS).map(draw).collect();
        let explained = mean(drawn.iter().map(Statistics::cost));
        let rarity = rarity(&drawn, explained);
        // Between that of one test and Bonferroni's, as a pattern counts in every other draw.
        assert!(rarity > 0.05 / 3.0 && rarity < 0.05, "{rarity}");
        let highest = |of: &dyn Fn(&Statistics) -> f64| {
            quantiles_low(drawn.iter().map(of).collect(), [1.0 - rarity])[0]
        };
        let limits = TESTS.map(|test| highest(&test));
        let is_adequate = |all: &&Statistics| {
            let has_pattern = all.autocorrelation() > limits[1] || -all.runs() > limits[2];
            all.cost() <= limits[0] && !(has_pattern && all.cost() > explained)
        };
        let adequate = drawn.iter().filter(is_adequate).count();
        assert!(adequate.abs_diff(380) <= 3, "{adequate}");
        // What has no pattern is judged by its objective alone.
        let no_pattern = |i| Statistics {
            autocorrelations: ByFitted::splat(f64::NAN),
            runs: ByFitted::splat(f64::NAN),
            ..draw(i)
        };
        let drawn: Vec<Statistics> = (1..=DRAWS).map(no_pattern).collect();
        assert!((self::rarity(&drawn, explained) - 0.05).abs() < 0.003);
    }

    #[test]
    fn the_furthest_run_is_named_with_its_side_and_frequencies() {
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
        // Predicted over measured, less 1.
        let values = [(0.5, -0.03), (1.0, 0.002), (2.0, -0.02), (3.0, 0.25), (4.0, 1.0 / 3.0)];
        let terms: Vec<Term> = values.into_iter().map(term).collect();
        let said = |terms: &[Term]| where_off(terms, Metric::Sigma0).map(|run| run.to_string());
        assert_eq!(
            said(&terms).as_deref(),
            Some("sigma0 is measured 20 to 25 % below the model at 3 to 4 rad/s")
        );
        assert_eq!(
            said(&terms[..1]).as_deref(),
            Some("sigma0 is measured 3.1 % above the model at 0.5 rad/s")
        );
        // The least that is off is where it is furthest off.
        assert_eq!(
            said(&terms[1..2]).as_deref(),
            Some("sigma0 is measured 0.20 % below the model at 1 rad/s")
        );
        assert_eq!(where_off(&terms, Metric::D), None);
        let rms = how_far_off(&terms[3..]).map(|misfit| misfit.to_string());
        assert_eq!(rms.as_deref(), Some("the model is off by 29 % in sigma0 (RMS)"));
        assert_eq!(how_far_off(&[]), None);
        // A model without skid.
        let none = [(0.5, -1.0), (1.0, -1.0)].map(term);
        assert_eq!(said(&none).as_deref(), Some("the model has no sigma0 at 0.5 to 1 rad/s"));
    }
}
