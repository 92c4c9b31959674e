//! The information criterion that models of a campaign are chosen by.
//!
//! The weighted relative deviations of a metric are taken to be independent and of one Laplace
//! distribution, whose scale is estimated by their mean size; d and v, the skid ratios and alpha_1
//! have a scale each, since skid ratios scatter otherwise than distances. d and v = d omega / 2 pi of a trial are one
//! measurement: as both deviate alike, its weight is the sum of theirs, and it counts once. With
//! the sum `S` of the weighted deviations of the `n` measurements of a metric, twice the negative
//! logarithm of the likelihood is, but for what all models have in common, the sum of
//! `2 n ln(S / n)` over the metrics, and the criterion is that plus `k ln N` of `k` free parameters
//! and `N` measurements in all: Schwarz's (BIC). It is taken where the likelihood is largest: the fit
//! follows the objective's weights, and where those leave a metric aside a model with more
//! coefficients than it needs would win by fitting that metric, too. From the fit that
//! point is reached with the model linearised there, its metrics reweighted until their scales converge.
//! A parameter that ended at a bound counts, as the model had it: with it there the likelihood is
//! that of the model without it, and the latter is the one to prefer.
//!
//! Neighbouring frequencies are not quite independent, as a model's misfit is alike there: large
//! differences count.
//!
//! Reference: G. Schwarz, *Estimating the dimension of a model*, Ann. Statist. 6 (1978); for the
//! Laplace likelihood C. M. Hurvich and C.-L. Tsai, *Model selection for least absolute deviations
//! regression in small samples*, Statist. Probab. Lett. 9 (1990).

use trilink_mechanics::REFERENCE_ACCURACY;
use trilink_robot::metrics::{ByFitted, Metric};

use super::fitted_point::FittedPoint;
use super::least_absolute::minimise;
use super::resampler::Resampler;
use super::search::limits;
use super::terms::Terms;

/// How far a linearised model's coefficients may go: factors' logarithms.
const RADIUS: f64 = 1.0;

/// Rounds in which the metrics' weights follow their scales, at most, and the fall of the criterion
/// that ends them.
const MOST_ROUNDS: usize = 20;
const ROUND: f64 = 1e-6;

/// Terms that are of one distribution: d and v, the wheels' sigma, alpha_1.
const GROUPS: [&[Metric]; 3] = [&[Metric::D, Metric::V], &Metric::SIGMA, &[Metric::Alpha1]];

/// How many measurements the metrics have: of d and v together, of the wheels' sigma, of alpha_1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Counts([usize; GROUPS.len()]);

impl Counts {
    /// Of trials' metrics, of which those count that have a weight and are known.
    pub(crate) fn new(
        weights: &ByFitted<f64>,
        trials: impl Iterator<Item = ByFitted<f64>>,
    ) -> Self {
        let mut counts = Self::default();
        for metrics in trials {
            let known = |i: &&Metric| weights[**i] > 0.0 && metrics[**i].is_finite();
            let [of_pair, others @ ..] = GROUPS.map(|group| group.iter().filter(known).count());
            counts.0[0] += of_pair.min(1);
            counts.0[1..].iter_mut().zip(others).for_each(|(sum, count)| *sum += count);
        }
        counts
    }

    pub(crate) fn total(self) -> usize {
        self.0.iter().sum()
    }

    /// What weighs the metrics by their scales, of which these are the sums.
    fn per_scale(self, sums: &ByFitted<f64>) -> ByFitted<f64> {
        let mut factors = ByFitted::splat(0.0);
        for (group, count) in GROUPS.iter().zip(self.0) {
            let sum: f64 = group.iter().map(|i| sums[*i]).sum();
            let count = count as f64;
            group.iter().for_each(|i| factors[*i] = count / sum.max(count * REFERENCE_ACCURACY));
        }
        factors
    }

    /// The criterion of a model with so many free parameters, from its metrics' weighted
    /// deviations, summed over the trials.
    pub(crate) fn criterion(self, sums: &ByFitted<f64>, free: usize) -> f64 {
        let of_group = |(group, count): (&&[Metric], usize)| {
            let sum: f64 = group.iter().map(|i| sums[*i]).sum();
            let count = count as f64;
            // What is less than the motions' own inaccuracy is nothing.
            if count > 0.0 { 2.0 * count * (sum / count).max(REFERENCE_ACCURACY).ln() } else { 0.0 }
        };
        let likelihood: f64 = GROUPS.iter().zip(self.0).map(of_group).sum();
        likelihood + free as f64 * (self.total() as f64).ln()
    }
}

/// The lowest criterion that the model linearised at its fit has for these terms of so many trials.
fn lowest(point: &FittedPoint, terms: &Terms, counts: Counts, trials: usize) -> f64 {
    let bounds = limits(&point.evaluator.parameters, &point.values, RADIUS);
    let nearest = |terms: &Terms| minimise(&terms.residuals(&point.responses), &bounds, None);
    let (mut step, mut lowest) = (nearest(terms), f64::INFINITY);
    for _ in 0..MOST_ROUNDS {
        let sums = terms.parts(&point.responses, step.as_slice()).map(|part| trials as f64 * part);
        let criterion = counts.criterion(&sums, point.values.len());
        if criterion > lowest - ROUND {
            break;
        }
        lowest = criterion;
        step = nearest(&terms.reweighted(&counts.per_scale(&sums)));
    }
    lowest
}

/// The criterion at a fit, and how many measurements are in it.
pub(super) fn criterion(point: &FittedPoint) -> (f64, usize) {
    let objective = point.evaluator.objective;
    let observations = objective.observations();
    let trials = observations.iter().map(|of| of.metrics);
    let counts = Counts::new(&objective.protocols[0].term_weights(), trials);
    let terms = point.evaluator.terms_of(&observations);
    (lowest(point, &terms, counts, observations.len()), counts.total())
}

/// The criterion of the resample with this number, frequencies resampled, too: of the fit to it by
/// the model linearised at its fit.
pub(super) fn resampled(point: &FittedPoint, resampler: &Resampler, number: usize) -> f64 {
    let weights = point.evaluator.objective.protocols[0].term_weights();
    let drawn = resampler.draw_frequencies(number);
    let counts = Counts::new(&weights, drawn.iter().map(|of| of.metrics));
    lowest(point, &point.resampled_terms(&drawn), counts, drawn.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    const WEIGHTS: [f64; 6] = [10.0, 1.0, 0.2, 0.2, 0.2, 0.0];

    fn counts(trials: usize) -> Counts {
        Counts::new(
            &WEIGHTS.into(),
            (0..trials).map(|_| [0.1, 0.2, 0.03, 0.03, 0.03, f64::NAN].into()),
        )
    }

    #[test]
    fn d_and_v_of_a_trial_are_one_measurement() {
        assert_eq!(counts(13), Counts([13, 39, 0]));
        let only_v = [f64::NAN, 0.2, f64::NAN, 0.03, 0.03, 0.5];
        assert_eq!(Counts::new(&WEIGHTS.into(), [only_v.into()].into_iter()), Counts([1, 2, 0]));
        // With d alone, of the weight of both, it is the same.
        let sums = |d: f64, v: f64| counts(13).criterion(&[d, v, 0.01, 0.01, 0.01, 0.0].into(), 3);
        assert_eq!(sums(1.0, 0.1), sums(1.1, 0.0));
    }

    #[test]
    fn a_free_parameter_costs_what_the_criterion_says() {
        let all = counts(13);
        let of = |d: f64, sigma: f64, free| {
            all.criterion(&[d, 0.1 * d, sigma, sigma, sigma, 0.0].into(), free)
        };
        assert!((of(1.0, 0.01, 4) - of(1.0, 0.01, 3) - 52.0_f64.ln()).abs() < 1e-12);
        // Three more parameters are worth that d is nearer by 37 %, whatever sigma's weight is.
        assert!(of(0.65, 0.01, 6) > of(1.0, 0.01, 3) && of(0.62, 0.01, 6) < of(1.0, 0.01, 3));
        let of_sigma = |factor: f64| of(1.0, 0.01 * factor, 3) - of(1.0, 0.02 * factor, 3);
        assert!((of_sigma(1.0) - of_sigma(50.0)).abs() < 1e-9);
    }

    #[test]
    fn what_is_without_noise_has_a_criterion() {
        assert!(counts(4).criterion(&ByFitted::splat(0.0), 3).is_finite());
    }
}
