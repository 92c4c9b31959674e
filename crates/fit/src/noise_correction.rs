//! Correction of the bootstrap of least absolute deviations for noise that counts twice.
//!
//! A resample adds noise to measurements that have noise already, so that its residuals are
//! spread by both. Where an estimate is linear in the measurements, as for least squares, that
//! does not matter. The variance of least absolute deviations goes with the density of the
//! residuals at zero, and with how many of their signs the noise can turn. Let the residuals
//! have `t` times the variance of the noise; it is 1 for a model that is true and large for one
//! that is not. With normal distributions, the variance of the estimate is as
//! `(1 - 2/pi asin((t - 1) / t)) t`, and over resamples as
//! `(1 - 2/pi asin(t / (1 + t))) (1 + t)`: from 4/3 as large to equal.
//!
//! Reference for the variance: R. Koenker, *Quantile Regression*, Cambridge 2005, section 4.2.

use std::f64::consts::PI;

use trilink_statistics::student;

use super::fitted_point::FittedPoint;
use super::resampler::Resampler;

/// Factors of the results of resamples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NoiseCorrection {
    /// The spread of the coefficients' logarithms.
    pub spread: f64,
    /// The rise of the objective when a coefficient is held.
    pub rise: f64,
}

impl NoiseCorrection {
    /// Of a fit. What its trials draw has the deviations of their cycles, which all of these together tell
    /// as well as Student's distribution with their degrees of freedom says.
    pub(crate) fn of(point: &FittedPoint, resampler: &Resampler) -> Self {
        let Self { spread, rise } = Self::new(point.cost, point.noise_cost(resampler));
        let widened = student(resampler.freedom());
        Self { spread: widened * spread, rise: widened.powi(2) * rise }
    }

    /// From the objective at the fit, and the part of it that noise alone would make.
    fn new(cost: f64, noise: f64) -> Self {
        let ratio = (cost / noise).powi(2);
        // The fit has taken up some of the noise.
        let t = if ratio > 1.0 { ratio.min(1e6) } else { 1.0 };
        let turned = |sine: f64| 1.0 - 2.0 / PI * sine.asin();
        let variance = turned((t - 1.0) / t) * t / (turned(t / (1.0 + t)) * (1.0 + t));
        // The rise is the variance times the density of the residuals at zero.
        Self { spread: variance.sqrt(), rise: variance * ((1.0 + t) / t).sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use trilink_statistics::median_high;

    use super::*;

    #[test]
    fn a_true_model_s_intervals_shrink_and_a_wrong_one_s_stay() {
        let of_true = NoiseCorrection::new(0.2, 0.2);
        assert!((of_true.spread - 0.75_f64.sqrt()).abs() < 1e-12);
        assert!((of_true.rise - 0.75 * 2_f64.sqrt()).abs() < 1e-12);
        assert_eq!(NoiseCorrection::new(0.1, 0.2), of_true);
        let of_wrong = NoiseCorrection::new(20.0, 0.2);
        assert!((of_wrong.spread - 1.0).abs() < 1e-3 && (of_wrong.rise - 1.0).abs() < 1e-3);
        // Noise-free measurements.
        assert!(
            NoiseCorrection::new(0.3, 0.0).spread.is_finite()
                && NoiseCorrection::new(0.0, 0.0).rise > 0.0
        );
    }

    #[test]
    fn the_median_of_normal_deviates_has_these_variances() {
        // The simplest least absolute deviations: medians of 401 values with unit noise.
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let variance = |values: &[f64]| {
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64
        };
        let samples: Vec<Vec<f64>> =
            (0..100).map(|_| (0..401).map(|_| normal()).collect()).collect();
        let medians: Vec<f64> = samples.iter().map(|sample| median_high(sample.clone())).collect();
        let resampled: f64 = samples
            .iter()
            .map(|sample| {
                let resample =
                    |_| median_high(sample.iter().map(|value| value + normal()).collect());
                variance(&(0..100).map(resample).collect::<Vec<f64>>())
            })
            .sum::<f64>()
            / samples.len() as f64;
        let ratio = variance(&medians) / resampled;
        let expected = NoiseCorrection::new(1.0, 1.0).spread.powi(2);
        assert!((ratio / expected - 1.0).abs() < 0.25, "{ratio} for {expected}");
    }
}
