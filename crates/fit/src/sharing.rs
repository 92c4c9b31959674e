//! Whether one set of coefficients describes several campaigns of one robot.
//!
//! One set of them for all campaigns leaves more of the objective than one for each. If the
//! coefficients are the same, that rise is by chance: by noise, and by what any model is off, which is
//! differently so under each gait. Both are in what a campaign's nearest model leaves: what another
//! model leaves beyond that is its own fault, and no excuse for coefficients that differ. So worlds are
//! drawn in which the coefficients are the same, those of the shared fit, and every measurement is off by
//! what the nearest model of its campaign leaves of it, the logarithm of measured over predicted, with a
//! random sign. Where that model fits, what it leaves is noise, and every measurement has a sign of its
//! own. Where it does not, there is one for each block of neighbouring frequencies, since what a model is
//! off by is alike there and in all metrics (the wild bootstrap of clusters). A fit of least absolute
//! deviations goes through as many measurements as it has coefficients; of these it does not tell what
//! they are off by, which would hold every world's coefficients where they are, and they are off by the
//! median of the others of the metric. Each world is fitted with the motions linearised at the shared
//! fit, with one set of coefficients and with one for each campaign. Sharing is refused if the rise, over
//! what the nearest models leave, is more than in 95 of 100 worlds over what the separate fits leave there.
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
use super::intervals::blocks;
use super::least_absolute::{Residual, minimise, sum};
use super::measurement::Measurement;
use super::objective::{Objective, Observation};
use super::resampler::Resampler;
use super::search::limits;

/// Worlds that are drawn.
const DRAWS: usize = 999;
/// Part of them that a rise by chance is within.
const LEVEL: f64 = 0.95;
/// Fewer blocks of a campaign have too few signs.
const LEAST_BLOCKS: usize = 4;
/// Linearised residuals are good within about this factor's logarithm.
const RADIUS: f64 = 1.0;
/// Of the objective: less is the search's and the motions' own inaccuracy.
const INACCURACY: f64 = 1e-5;

/// Of the logarithm of measured over predicted: less is a measurement that the fit goes through.
const EXACT: f64 = 1e-5;

/// Of a campaign the model that is nearest to its measurements.
#[derive(Debug, Clone)]
pub(super) struct Nearest {
    /// Its objective.
    pub j: f64,
    /// Of its motions at the trials.
    pub metrics: Vec<GaitMetrics>,
    /// Whether it leaves no more than noise.
    pub fits: bool,
}

/// The result of the test. Ratios are NaN where there is none, for the reason in `not_tested`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SharingTest {
    /// What sharing adds to the objective of the separate fits, and the limit of that.
    pub rise: [f64; 2],
    /// Part of the worlds with a larger rise.
    pub p_value: f64,
    pub sharing: Option<Sharing>,
    pub not_tested: Option<NotTested>,
}

impl SharingTest {
    pub(crate) fn none(why: impl Into<NotTested>) -> Self {
        let not_tested = Some(why.into());
        Self { rise: [f64::NAN; 2], p_value: f64::NAN, sharing: None, not_tested }
    }

    /// Tests a shared fit, where the model's separate ones leave `j_separate`, with each campaign's
    /// nearest model.
    pub(crate) fn new(
        shared: &FittedPoint,
        j_separate: f64,
        nearest: &[Nearest],
        resampler: &Resampler,
    ) -> Self {
        let added = shared.cost - j_separate;
        let j_nearest: f64 = nearest.iter().map(|of| of.j).sum();
        let rise = added / j_nearest;
        if shared.cost <= INACCURACY {
            return Self::none(NotTestedReason::NothingLeft);
        }
        if added < -INACCURACY * (1.0 + shared.cost) {
            return Self::none(NotTestedReason::NotLowest);
        }
        let blocks = blocks(&shared.evaluator.objective.measurements);
        let protocols = &shared.evaluator.objective.protocols;
        let few = blocks.iter().zip(protocols).find(|(of, _)| of.len() < LEAST_BLOCKS);
        if let Some((_, of)) = few {
            return Self::none(NotTested::of(NotTestedReason::FewBlocks, &of.name));
        }
        let left = left_by(shared.evaluator.objective, nearest);
        let rises: Option<Vec<f64>> = (0..DRAWS)
            .into_par_iter()
            .map(|number| {
                let mut random = resampler.random("sharing", number);
                let mut signs = vec![ByFitted::splat(0.0); left.len()];
                for (blocks, nearest) in blocks.iter().zip(nearest) {
                    draw_signs(blocks, nearest.fits, &mut random, &mut signs);
                }
                rise_of_world(shared, &left, &signs)
            })
            .collect();
        let Some(rises) = rises else {
            return Self::none(NotTestedReason::NoMotion);
        };
        let above = rises.iter().filter(|drawn| **drawn >= rise).count();
        let p_value = (above + 1) as f64 / (DRAWS + 1) as f64;
        let limit = j_nearest * quantiles_low(rises, [LEVEL])[0];
        let is_kept = p_value >= 1.0 - LEVEL || added <= INACCURACY;
        let sharing = Some(if is_kept { Sharing::Kept } else { Sharing::Refused });
        Self { rise: [added, limit], p_value, sharing, not_tested: None }
    }
}

/// Draws signs of what is left of a campaign's metrics: each measurement's own where it is noise, one
/// for each block of frequencies where it is not. d and v of a trial are one measurement.
fn draw_signs(
    blocks: &[Vec<usize>],
    is_noise: bool,
    random: &mut impl RngExt,
    signs: &mut [ByFitted<f64>],
) {
    let mut sign = || if random.random() { 1.0 } else { -1.0 };
    for block in blocks {
        let of_block = sign();
        for &trial in block {
            let of_d = if is_noise { sign() } else { of_block };
            let of = |metric| match metric {
                Metric::D | Metric::V => of_d,
                _ if is_noise => sign(),
                _ => of_block,
            };
            signs[trial] = ByFitted::from_fn(of);
        }
    }
}

/// Of each trial the logarithms of measured over predicted by its campaign's nearest model, where it
/// goes through a measurement as large as they typically are.
fn left_by(objective: &Objective, nearest: &[Nearest]) -> Vec<ByFitted<f64>> {
    let campaigns = objective.measurements.chunk_by(|a, b| a.campaign == b.campaign);
    let of_campaign = |(own, nearest): (&[Measurement], &Nearest)| {
        let of_trial = |(measurement, predicted): (&Measurement, &GaitMetrics)| {
            let mut left = ByFitted::splat(0.0);
            for (metric, _, measured) in objective.terms(measurement) {
                let ratio = measured / predicted[metric];
                // A model without skid says nothing of how far off its skid ratios are.
                left[metric] = if ratio.is_finite() && ratio > 0.0 { ratio.ln() } else { 0.0 };
            }
            left
        };
        let mut left: Vec<_> = own.iter().zip(&nearest.metrics).map(of_trial).collect();
        fill_exact(&mut left);
        left
    };
    campaigns.zip(nearest).flat_map(of_campaign).collect()
}

/// A least-absolute fit goes through as many measurements as it has coefficients: gives these the
/// median size of the metric's others.
fn fill_exact(left: &mut [ByFitted<f64>]) {
    for metric in Metric::FITTED {
        let sizes = left.iter().map(|of| of[metric].abs());
        let typical = median(sizes.filter(|size| *size > EXACT).collect());
        let exact = left.iter_mut().filter(|of| of[metric].abs() <= EXACT);
        exact.filter(|_| typical.is_finite()).for_each(|of| of[metric] = typical);
    }
}

/// The relative rise in a world where the shared fit is the truth but for what is `left`, with these
/// signs; `None` if a motion is missing.
fn rise_of_world(
    shared: &FittedPoint,
    left: &[ByFitted<f64>],
    signs: &[ByFitted<f64>],
) -> Option<f64> {
    let objective = shared.evaluator.objective;
    let observe = |trial: usize| -> Option<Observation> {
        let (predicted, _) = shared.metrics_of(trial)?;
        let measured = &objective.measurements[trial].metrics;
        // What was not measured has no term.
        let metrics = ByFitted::from_fn(|of| match measured[of].is_finite() {
            true => predicted[of] * (signs[trial][of] * left[trial][of]).exp(),
            false => f64::NAN,
        });
        Some(Observation { metrics, ..objective.observation(trial) })
    };
    let world: Vec<Observation> =
        (0..left.len()).map(observe).collect::<Option<Vec<Observation>>>()?;
    let bounds = limits(&shared.evaluator.parameters, &shared.values, RADIUS);
    let lowest = |observations: &[Observation]| {
        let residuals: Vec<Residual> =
            shared.evaluator.terms_of(observations).residuals(&shared.responses);
        sum(&residuals, &minimise(&residuals, &bounds, None))
    };
    let campaign = |of: &Observation| objective.measurements[of.trial].campaign;
    let separate: f64 = world.chunk_by(|a, b| campaign(a) == campaign(b)).map(lowest).sum();
    Some(lowest(&world) / separate - 1.0)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn noise_has_a_sign_for_each_measurement_and_misfit_one_for_each_block() {
        let blocks = [vec![0, 1, 2], vec![3, 4, 5], vec![6, 7, 8]];
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut draw = |is_noise| {
            let mut signs = vec![ByFitted::splat(0.0); 9];
            draw_signs(&blocks, is_noise, &mut random, &mut signs);
            let signs: Vec<[f64; 6]> = signs.iter().map(|of| *of.values()).collect();
            assert!(signs.iter().flatten().all(|sign: &f64| sign.abs() == 1.0));
            signs
        };
        let [mut differ_in_block, mut differ_in_trial] = [false; 2];
        for _ in 0..20 {
            for of in draw(false).chunks(3) {
                assert!(of.iter().flatten().all(|sign| *sign == of[0][0]));
            }
            let noise = draw(true);
            assert!(noise.iter().all(|[d, v, ..]| d == v));
            differ_in_block |= noise[0][0] != noise[1][0];
            differ_in_trial |= noise[0][0] != noise[0][2] || noise[0][3] != noise[0][4];
        }
        assert!(differ_in_block && differ_in_trial);
    }
}
