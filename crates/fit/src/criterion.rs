//! Schwarz's information criterion (BIC) that selects among the models of a campaign.
//!
//! The weighted relative deviations of a metric are assumed to be independent and to follow a Laplace distribution,
//! whose scale is estimated by their mean absolute value. The pair d and v, the skid ratios, and alpha_1 have separate
//! scales, since skid ratios scatter differently from distances. d and v = d omega / 2 pi of a trial are one
//! measurement: their relative deviations are equal, so that the measurement has the sum of both weights and counts
//! once. For a metric with `n` measurements whose weighted deviations sum to `S`, minus twice the log-likelihood is
//! `2 n ln(S / n)`, up to a constant common to all models. The criterion is the sum of these values over the metrics
//! plus `k ln N`, for `k` free parameters and a total of `N` measurements.
//!
//! The criterion is evaluated at the maximum of the likelihood rather than at the fit. The fit follows the weights of
//! the objective. If a metric has a small weight, the criterion at the fit would favour superfluous coefficients that
//! improve this metric. The maximum is found with the model linearised at the fit, by reweighting the metrics until their
//! scales converge. A parameter that ended at a bound counts as free: the likelihood then equals that of the simpler
//! model without the parameter, and the simpler model should be preferred.
//!
//! A model's misfit is similar at neighbouring frequencies, so that measurements are not quite independent: only large
//! differences in the criterion are meaningful.
//!
//! References: G. Schwarz, *Estimating the dimension of a model*, Ann. Statist. 6 (1978); for the
//! Laplace likelihood C. M. Hurvich and C.-L. Tsai, *Model selection for least absolute deviations
//! regression in small samples*, Statist. Probab. Lett. 9 (1990).

use trilink_mechanics::REFERENCE_ACCURACY;
use trilink_robot::metrics::{ByFitted, Metric};

use super::fitted_point::FittedPoint;
use super::least_absolute::minimise;
use super::resampler::Resampler;
use super::search::limits;
use super::terms::Terms;

/// Maximum change in the logarithm of a coefficient for which the linearised model is used.
const RADIUS: f64 = 1.0;

/// Maximum number of iterations that reweight the metrics by their scales.
const MAX_ROUNDS: usize = 20;
/// Decrease in the criterion below which the scales have converged.
const CRITERION_TOLERANCE: f64 = 1e-6;

/// Groups of metrics that share a distribution: d and v, the skid ratios of the wheels, the amplitudes of the joints.
const GROUPS: [&[Metric]; 3] = [&[Metric::D, Metric::V], &Metric::SIGMA, &Metric::ALPHA];

/// Number of measurements in each group of metrics; d and v of a trial are one measurement.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Counts([usize; GROUPS.len()]);

impl Counts {
    /// Counts the measured metrics of the given trials, for metrics with a nonzero weight.
    pub(crate) fn new(
        weights: &ByFitted<f64>,
        trials: impl Iterator<Item = ByFitted<f64>>,
    ) -> Self {
        let mut counts = Self::default();
        for metrics in trials {
            let [pair, others @ ..] = GROUPS.map(|group| {
                let known = |i: &&Metric| weights[**i] > 0.0 && metrics[**i].is_finite();
                group.iter().filter(known).count()
            });
            counts.0[0] += pair.min(1);
            counts.0[1..].iter_mut().zip(others).for_each(|(sum, count)| *sum += count);
        }
        counts
    }

    pub(crate) fn total(self) -> usize {
        self.0.iter().sum()
    }

    /// Returns, for each metric, the reciprocal of the scale (mean weighted deviation) of its group of metrics, given
    /// the sum of each metric's weighted deviations.
    fn per_scale(self, sums: &ByFitted<f64>) -> ByFitted<f64> {
        let mut factors = ByFitted::splat(0.0);
        for (group, count) in GROUPS.iter().zip(self.0) {
            let sum: f64 = group.iter().map(|i| sums[*i]).sum();
            let count = count as f64;
            group.iter().for_each(|i| factors[*i] = count / sum.max(count * REFERENCE_ACCURACY));
        }
        factors
    }

    /// Evaluates the Schwarz criterion of a model with `free` free parameters, given each metric's weighted deviations
    /// summed over the trials.
    pub(crate) fn criterion(self, sums: &ByFitted<f64>, free: usize) -> f64 {
        let groups = GROUPS.iter().zip(self.0);
        let likelihood: f64 = groups
            .map(|(group, count)| {
                let sum: f64 = group.iter().map(|i| sums[*i]).sum();
                let count = count as f64;
                if count == 0.0 {
                    return 0.0;
                }
                // Deviations below the accuracy of the solver are not meaningful.
                2.0 * count * (sum / count).max(REFERENCE_ACCURACY).ln()
            })
            .sum();
        likelihood + free as f64 * (self.total() as f64).ln()
    }
}

/// Returns the lowest Schwarz criterion that the model linearised at its fit can attain; `terms` are the terms of the
/// objective, averaged over `trials` trials.
fn lowest_criterion(point: &FittedPoint, terms: &Terms, counts: Counts, trials: usize) -> f64 {
    let bounds = limits(&point.evaluator.parameters, &point.values, RADIUS);
    let mut step = minimise(&terms.residuals(&point.responses), &bounds, None);
    let mut lowest = f64::INFINITY;
    for _ in 0..MAX_ROUNDS {
        let contributions = terms.contributions(&point.responses, step.as_slice());
        let sums = contributions.map(|contribution| trials as f64 * contribution);
        let criterion = counts.criterion(&sums, point.values.len());
        if criterion > lowest - CRITERION_TOLERANCE {
            break;
        }
        lowest = criterion;
        let reweighted = terms.reweighted(&counts.per_scale(&sums));
        step = minimise(&reweighted.residuals(&point.responses), &bounds, None);
    }
    lowest
}

/// Returns the information criterion of a fitted model, and the number of measurements.
pub(super) fn criterion(point: &FittedPoint) -> (f64, usize) {
    let objective = point.evaluator.objective;
    let observations = objective.observations();
    let trials = observations.iter().map(|of| of.metrics);
    let counts = Counts::new(&objective.protocols[0].term_weights(), trials);
    let terms = point.evaluator.terms_of(&observations);
    (lowest_criterion(point, &terms, counts, observations.len()), counts.total())
}

/// Returns the Schwarz criterion for the bootstrap resample with the given index, in which the campaign's frequencies
/// and the trials at each of them are drawn at random; the model is linearised at its fit.
pub(super) fn resampled_criterion(
    point: &FittedPoint,
    resampler: &Resampler,
    number: usize,
) -> f64 {
    let weights = point.evaluator.objective.protocols[0].term_weights();
    let drawn = resampler.draw_frequencies(number);
    let counts = Counts::new(&weights, drawn.iter().map(|of| of.metrics));
    lowest_criterion(point, &point.resampled_terms(&drawn), counts, drawn.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    const WEIGHTS: [f64; 6] = [10.0, 1.0, 0.2, 0.2, 0.2, 0.0];

    fn of(values: [f64; 6]) -> ByFitted<f64> {
        ByFitted::of_three_links(values, 0.0)
    }

    fn counts(trials: usize) -> Counts {
        let trial = |_| of([0.1, 0.2, 0.03, 0.03, 0.03, f64::NAN]);
        Counts::new(&of(WEIGHTS), (0..trials).map(trial))
    }

    #[test]
    fn d_and_v_of_a_trial_are_one_measurement() {
        assert_eq!(counts(13), Counts([13, 39, 0]));
        let only_v = [f64::NAN, 0.2, f64::NAN, 0.03, 0.03, 0.5];
        assert_eq!(Counts::new(&of(WEIGHTS), [of(only_v)].into_iter()), Counts([1, 2, 0]));
        // The criterion is unchanged if d alone carries the weight of both.
        let sums = |d: f64, v: f64| counts(13).criterion(&of([d, v, 0.01, 0.01, 0.01, 0.0]), 3);
        assert_eq!(sums(1.0, 0.1), sums(1.1, 0.0));
    }

    #[test]
    fn a_free_parameter_costs_the_logarithm_of_the_number_of_measurements() {
        let all = counts(13);
        let criterion = |d: f64, sigma: f64, free| {
            all.criterion(&of([d, 0.1 * d, sigma, sigma, sigma, 0.0]), free)
        };
        assert!((criterion(1.0, 0.01, 4) - criterion(1.0, 0.01, 3) - 52.0_f64.ln()).abs() < 1e-12);
        // Three more parameters pay off if they reduce the deviations of d by 37 %, whatever the weight of sigma.
        assert!(criterion(0.65, 0.01, 6) > criterion(1.0, 0.01, 3));
        assert!(criterion(0.62, 0.01, 6) < criterion(1.0, 0.01, 3));
        let gain =
            |factor: f64| criterion(1.0, 0.01 * factor, 3) - criterion(1.0, 0.02 * factor, 3);
        assert!((gain(1.0) - gain(50.0)).abs() < 1e-9);
    }

    #[test]
    fn measurements_without_deviations_have_a_criterion() {
        assert!(counts(4).criterion(&ByFitted::splat(0.0), 3).is_finite());
    }
}
