//! Test of whether one set of coefficients describes several campaigns of one robot, or of robots with common wheels.
//!
//! The objective of a fit with shared coefficients exceeds the sum of the objectives of separate fits. If the true
//! coefficients are equal, this rise is due to noise and to model error, which differs between gaits. Both are present
//! in the residuals of the best-fitting model of a campaign; the larger residuals of any other model are due to its own
//! misfit, and would not explain coefficients that differ. The null distribution is therefore simulated with the
//! coefficients of the shared fit. If the best-fitting models of all campaigns are adequate, the simulated measurements
//! have the noise of the cycles and of the differences between trials and days (parametric bootstrap,
//! [`super::variation`]). Otherwise the logarithm of measured over predicted for every measurement is the residual of
//! the campaign's best-fitting model with a random sign, one for each block of neighbouring frequencies, since model
//! error is similar within a block and in all metrics (cluster wild bootstrap). A least-absolute-deviations fit passes
//! through as many measurements as it has coefficients. Their zero residuals are not representative and would keep the
//! simulated coefficients from moving; they are replaced by the median magnitude of the metric's other residuals. Each
//! simulation is fitted with the model linearised at the shared fit, with one common set of coefficients and with one
//! set for each campaign. Sharing is rejected if the rise, relative to the objective of the best-fitting models,
//! exceeds that of 95 of 100 simulations, relative to the objective of their separate fits. Campaigns that were
//! recorded on different days may differ because the floor did: unless the differences between days are known, sharing
//! is not rejected but not tested.
//!
//! Reference: A. C. Cameron, J. B. Gelbach and D. L. Miller, *Bootstrap-Based Improvements for
//! Inference with Clustered Errors*, Rev. Econ. Stat. 90 (2008) 414; X. Feng, X. He and J. Hu, *Wild
//! Bootstrap for Quantile Regression*, Biometrika 98 (2011) 995; for the ratio Davison and Hinkley
//! 1997, section 6.3.

use rand::RngExt;
use rayon::prelude::*;
use trilink_robot::metrics::{ByFitted, GaitMetrics, Metric};
use trilink_statistics::{median, quantiles_low};
use trilink_tables::{NotTested, NotTestedReason, Sharing};

use super::fitted_point::FittedPoint;
use super::intervals::frequency_blocks;
use super::least_absolute::{Residual, minimise, sum};
use super::measurement::Measurement;
use super::objective::{Objective, Observation};
use super::search::limits;
use super::variation::Variation;

/// Number of Monte Carlo simulations in the test of whether campaigns share their coefficients.
const DRAWS: usize = 999;
/// Confidence level of the test of whether campaigns share their coefficients: level of the quantile, over the
/// simulations, of the rise in the objective due to sharing.
const LEVEL: f64 = 0.95;
/// Minimum number of frequency blocks per campaign; with fewer blocks, the simulated residuals would have too few
/// independent random signs.
const MIN_BLOCKS: usize = 4;
/// Maximum change in the logarithm of a coefficient for which linearised residuals are used.
const RADIUS: f64 = 1.0;
/// Numerical error of an objective due to the search and the solver.
const INACCURACY: f64 = 1e-5;
/// Magnitude of the logarithm of measured over predicted below which a measurement counts as fitted exactly.
const ZERO: f64 = 1e-5;

/// Best-fitting model for the measurements of a campaign.
#[derive(Debug, Clone)]
pub(super) struct BestModel {
    /// Objective of the fit.
    pub j: f64,
    /// Predicted metrics for each trial.
    pub metrics: Vec<GaitMetrics>,
    /// Whether the model is adequate, so that its residuals are noise.
    pub is_adequate: bool,
}

/// Result of the test of whether campaigns share their coefficients. If the test was not possible, the values are NaN
/// and `not_tested` gives the reason.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SharingTest {
    /// Rise of the objective of the shared fit above the summed objectives of the separate fits, and the upper limit
    /// for this rise.
    pub rise: [f64; 2],
    /// P-value: fraction of the simulations in which the relative rise of the objective is at least that for the
    /// measurements, which count as one more simulation.
    pub p_value: f64,
    pub sharing: Option<Sharing>,
    pub not_tested: Option<NotTested>,
}

impl SharingTest {
    /// Returns the result for fits that cannot be tested, with the reason.
    pub(crate) fn none(why: impl Into<NotTested>) -> Self {
        let not_tested = Some(why.into());
        Self { rise: [f64::NAN; 2], p_value: f64::NAN, sharing: None, not_tested }
    }

    /// Tests a shared fit, given the summed objective `j_separate` of the separate fits of its model, and the best
    /// model for each campaign.
    pub(crate) fn new(
        shared: &FittedPoint,
        j_separate: f64,
        best_models: &[BestModel],
        variation: &Variation,
    ) -> Self {
        let added = shared.cost - j_separate;
        let j_best: f64 = best_models.iter().map(|model| model.j).sum();
        let rise = added / j_best;
        if shared.cost <= INACCURACY {
            return Self::none(NotTestedReason::NothingLeft);
        }
        if added < -INACCURACY * (1.0 + shared.cost) {
            return Self::none(NotTestedReason::NotLowest);
        }
        let objective = shared.evaluator.objective;
        let blocks = frequency_blocks(&objective.measurements);
        let campaigns = blocks.iter().zip(&objective.protocols);
        for (blocks, protocol) in campaigns {
            if blocks.len() < MIN_BLOCKS {
                return Self::none(NotTested::new(NotTestedReason::FewBlocks, &protocol.name));
            }
        }
        let residuals = log_residuals(objective, best_models);
        let is_noise = best_models.iter().all(|model| model.is_adequate);
        let rises: Option<Vec<f64>> = (0..DRAWS)
            .into_par_iter()
            .map(|number| {
                let simulated = if is_noise {
                    shared.observations(&variation.draw(number))
                } else {
                    let mut random = variation.resampler.random("sharing", number);
                    with_signs(shared, &residuals, &draw_signs(&blocks, &mut random))?
                };
                Some(rise_of(shared, &simulated))
            })
            .collect();
        let Some(rises) = rises else {
            return Self::none(NotTestedReason::NoMotion);
        };
        let above = rises.iter().filter(|simulated| **simulated >= rise).count();
        let p_value = (above + 1) as f64 / (DRAWS + 1) as f64;
        let limit = j_best * quantiles_low(rises, [LEVEL])[0];
        let is_kept = p_value >= 1.0 - LEVEL || added <= INACCURACY;
        if !is_kept && variation.ignores_days() && !share_a_day(&objective.measurements) {
            return Self::none(NotTestedReason::OtherDays);
        }
        let sharing = Some(if is_kept { Sharing::Kept } else { Sharing::Refused });
        Self { rise: [added, limit], p_value, sharing, not_tested: None }
    }
}

/// Returns whether every campaign has a trial of a day on which another campaign has one, too.
fn share_a_day(measurements: &[Measurement]) -> bool {
    measurements.chunk_by(|a, b| a.campaign == b.campaign).all(|own| {
        let is_shared = |of: &Measurement| {
            own.iter().any(|one| one.campaign != of.campaign && one.day == of.day)
        };
        measurements.iter().any(is_shared)
    })
}

/// Draws a random sign for each trial of all campaigns: the same for all trials of a block of frequencies.
fn draw_signs(campaigns: &[Vec<Vec<usize>>], random: &mut impl RngExt) -> Vec<f64> {
    let blocks = campaigns.iter().flatten();
    let mut signs = vec![1.0; blocks.clone().map(Vec::len).sum()];
    for block in blocks {
        let sign = if random.random() { 1.0 } else { -1.0 };
        block.iter().for_each(|&trial| signs[trial] = sign);
    }
    signs
}

/// Returns, for each trial, the logarithms of the ratios of the measured metrics to those predicted by the campaign's
/// best-fitting model; zero logarithms are replaced by typical ones.
fn log_residuals(objective: &Objective, best_models: &[BestModel]) -> Vec<ByFitted<f64>> {
    let mut residuals = Vec::with_capacity(objective.measurements.len());
    let campaigns = objective.measurements.chunk_by(|a, b| a.campaign == b.campaign);
    for (measurements, model) in campaigns.zip(best_models) {
        let first = residuals.len();
        for (measurement, predicted) in measurements.iter().zip(&model.metrics) {
            let mut own = ByFitted::splat(0.0);
            for (metric, _, measured) in objective.terms(measurement) {
                let ratio = measured / predicted[metric];
                // A model without skid does not predict the magnitude of errors in the skid ratios.
                own[metric] = if ratio.is_finite() && ratio > 0.0 { ratio.ln() } else { 0.0 };
            }
            residuals.push(own);
        }
        replace_zeros(&mut residuals[first..]);
    }
    residuals
}

/// Replaces the residuals of the measurements that a least-absolute-deviations fit passes through by the median
/// magnitude of the metric's other residuals.
fn replace_zeros(residuals: &mut [ByFitted<f64>]) {
    for metric in Metric::FITTED {
        let sizes = residuals.iter().map(|of| of[metric].abs());
        let typical = median(sizes.filter(|size| *size > ZERO).collect());
        if typical.is_finite() {
            let zeros = residuals.iter_mut().filter(|of| of[metric].abs() <= ZERO);
            zeros.for_each(|of| of[metric] = typical);
        }
    }
}

/// Returns simulated measurements that deviate from the shared fit by `residuals` with the given sign of each trial;
/// `None` if the model has no periodic solution for some trial.
fn with_signs(
    shared: &FittedPoint,
    residuals: &[ByFitted<f64>],
    signs: &[f64],
) -> Option<Vec<Observation>> {
    let objective = shared.evaluator.objective;
    let trials = residuals.iter().zip(signs).enumerate();
    trials
        .map(|(trial, (residuals, sign))| {
            let (predicted, _) = shared.metrics_of(trial)?;
            let measured = &objective.measurements[trial].metrics;
            // Metrics that were not measured contribute no term.
            let metrics = ByFitted::from_fn(|metric| {
                if measured[metric].is_finite() {
                    predicted[metric] * (sign * residuals[metric]).exp()
                } else {
                    f64::NAN
                }
            });
            Some(Observation { metrics, ..objective.observation(trial) })
        })
        .collect()
}

/// Returns the relative rise in the objective due to sharing for simulated measurements.
fn rise_of(shared: &FittedPoint, simulated: &[Observation]) -> f64 {
    let measurements = &shared.evaluator.objective.measurements;
    let campaign = |of: &Observation| measurements[of.trial].campaign;
    let campaigns = simulated.chunk_by(|a, b| campaign(a) == campaign(b));
    let separate: f64 = campaigns.map(|own| linearised_minimum(shared, own)).sum();
    linearised_minimum(shared, simulated) / separate - 1.0
}

/// Returns the minimum objective for the observations, with the model linearised at the fit.
fn linearised_minimum(point: &FittedPoint, observations: &[Observation]) -> f64 {
    let bounds = limits(&point.evaluator.parameters, &point.values, RADIUS);
    let residuals: Vec<Residual> =
        point.evaluator.terms_of(observations).residuals(&point.responses);
    sum(&residuals, &minimise(&residuals, &bounds, None))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn all_trials_of_a_block_have_one_sign() {
        let campaigns = [vec![vec![0, 1, 2], vec![3, 4, 5]], vec![vec![6, 7, 8]]];
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut patterns = BTreeSet::new();
        for _ in 0..40 {
            let signs = draw_signs(&campaigns, &mut random);
            let blocks = signs.chunks(3);
            assert!(blocks.clone().all(|block| block.iter().all(|sign| *sign == block[0])));
            patterns.insert(blocks.map(|block| block[0] > 0.0).collect::<Vec<bool>>());
        }
        assert_eq!(patterns.len(), 8);
    }
}
