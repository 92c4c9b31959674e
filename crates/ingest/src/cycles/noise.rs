//! Contribution of the marker noise to the cycle means.
//!
//! Above the frequencies of the motion the signal is noise only, at the level of white noise in the positions. The
//! noise from the residual tilt of the links is slower and several times as large; the differences between cycles show
//! its magnitude. Since the skid itself may also differ between cycles, at most [`MAX_EXCESS`] times the white noise is
//! attributed to noise.

use trilink_statistics::mean;

use super::measure::{Cycle, CycleData};
use crate::signals::{THIRD, THIRD_GAIN, WEIGHTS, noise};

/// Maximum assumed ratio of the total noise in a skid velocity to its white component. The actual ratio is 1.5 at gait
/// frequencies of 2 rad/s and above, and 3 at 0.5 rad/s, where a cycle lasts as long as one oscillation of the
/// suspension.
const MAX_EXCESS: f64 = 4.0;
/// Variance that one end of a cycle contributes to the sum, over the cycle, of the derivative of white noise of unit
/// variance. In the sum all weights of the derivative cancel except (-1, 7, 7, -1) / 12 at each end.
const END_GAIN: f64 = 100.0 / 144.0;

/// Returns the noise variances of the smoothed position, m^2, and heading, rad^2, at one end of a cycle; `window` is
/// the width of the moving average, samples.
pub(super) fn end_variances(data: &CycleData, window: usize) -> [f64; 2] {
    if let Some(errors) = &data.motion.errors {
        return errors.pose_variances;
    }
    let filled = &data.tracked.filled;
    let [x, y, theta] = [&filled.x_m, &filled.y_m, &filled.theta_rad].map(|series| noise(series));
    [0.5 * (x * x + y * y), theta * theta].map(|variance| variance / window as f64)
}

/// Contribution of noise to a wheel's skid velocity in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SkidNoise {
    /// Contribution of noise to the mean squared skid velocity, m^2/s^2.
    pub square: f64,
    /// Whether noise explains all differences between cycles.
    pub explains_all_differences: bool,
    /// Variance of the cycle's mean skid velocity due to position noise at one end of the cycle, m^2/s^2.
    pub end_variance: f64,
    /// Variance, due to white noise except that at the cycle's ends, of the mean product of a single cycle and the mean
    /// wave over all cycles, m^4/s^4.
    pub product_variance: f64,
}

impl SkidNoise {
    pub(super) const NONE: Self = Self {
        square: 0.0,
        explains_all_differences: false,
        end_variance: 0.0,
        product_variance: 0.0,
    };

    /// Estimates the noise of a wheel's skid velocity from the used cycles.
    pub(super) fn new(data: &CycleData, cycles: &[&Cycle], wheel: usize) -> Self {
        let count = data.driven.shape_harmonics;
        let step = data.driven.phase.step_rad;
        let frames = mean(cycles.iter().map(|cycle| cycle.end - cycle.start));
        // Ratio of the noise gains of third differences for a series and for its derivative.
        let gain_ratio = (THIRD_GAIN / squares(&third_of_derivative())).sqrt();
        // Standard deviation of the position noise times the frame rate.
        let noise_m_s = noise(&data.raw_wheels.skid_m_s[wheel]) * gain_ratio;
        let skid: Vec<&[f64]> = cycles.iter().map(|cycle| &cycle.skid_m_s[wheel][..]).collect();
        let end_variance = END_GAIN * (noise_m_s / frames).powi(2);
        let neighbours = cycles.windows(2).filter(|pair| pair[0].end == pair[1].start).count();
        // Sum over all components: noise at an end enters the offset with factor 1, and each cosine with factor
        // sqrt(2).
        let shared_variance = neighbours as f64 * (1.0 + 2.0 * count as f64) * end_variance;
        let mut product_variance = 0.0;
        let mut white = 0.0;
        for k in 1..=count {
            let variance = component_variance(k, step, frames) * noise_m_s.powi(2);
            let [cosine, sine] =
                [2 * k - 1, 2 * k].map(|i| mean(skid.iter().map(|cycle| cycle[i])));
            product_variance += (cosine.powi(2) + sine.powi(2)) * variance;
            white += variance;
        }
        let white = 2.0 * white;
        Self {
            end_variance,
            product_variance,
            ..Self::from_components(&skid, shared_variance, white)
        }
    }

    /// Estimates the noise from the differences between cycles, given the components of the skid velocity in each of
    /// them (`cycles`) and the mean square due to white noise (`white`). Position noise at the common end of two
    /// neighbouring cycles enters their velocities with opposite signs, so that they differ by more than two cycles
    /// with independent noise; the estimate is corrected for this. `shared_variance` is the variance of a component due
    /// to the noise at a common end, summed over all common ends and all components.
    pub(super) fn from_components(cycles: &[&[f64]], shared_variance: f64, white: f64) -> Self {
        let n = cycles.len() as f64;
        let variances = (0..cycles[0].len()).map(|i| {
            let middle = mean(cycles.iter().map(|cycle| cycle[i]));
            cycles.iter().map(|cycle| (cycle[i] - middle).powi(2)).sum::<f64>() / (n - 1.0)
        });
        let total = variances.sum::<f64>();
        let own = (total - 2.0 * shared_variance / (n * (n - 1.0))).max(0.0);
        let max_square = MAX_EXCESS * white;
        Self {
            square: own.min(max_square),
            explains_all_differences: own <= max_square,
            ..Self::NONE
        }
    }
}

/// Returns the variance of each of the two components of harmonic `k`, over a cycle of `frames` frames with a phase of
/// `step_rad` per frame, if the series is the derivative, per frame, of white noise of unit variance. The contribution
/// of the cycle's ends is not included.
fn component_variance(k: usize, step_rad: f64, frames: f64) -> f64 {
    let sin = (k as f64 * step_rad).sin();
    let sin2 = (2.0 * k as f64 * step_rad).sin();
    ((8.0 * sin - sin2) / 6.0).powi(2) / frames
}

/// Returns the weights of the derivative filter convolved with those of the third difference.
fn third_of_derivative() -> [f64; WEIGHTS.len() + THIRD.len() - 1] {
    let mut both = [0.0; WEIGHTS.len() + THIRD.len() - 1];
    for (i, a) in WEIGHTS.iter().enumerate() {
        for (j, b) in THIRD.iter().enumerate() {
            both[i + j] += a * b;
        }
    }
    both
}

/// Returns the sum of the squared weights of a filter.
fn squares(weights: &[f64]) -> f64 {
    weights.iter().map(|weight| weight * weight).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_components_of_differentiated_white_noise_have_the_predicted_variances() {
        use crate::phase::{Harmonics, LinearPhase};
        use crate::signals::derivative;
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(2);
        const FRAMES: usize = 60;
        let phase =
            LinearPhase { step_rad: std::f64::consts::TAU / FRAMES as f64, offset_rad: 0.0 };
        let mut squares = [0.0; 7];
        const REPEATS: usize = 4000;
        for _ in 0..REPEATS {
            let positions: Vec<f64> =
                (0..FRAMES + 9).map(|_| StandardNormal.sample(&mut random)).collect();
            // The cycle begins and ends between two frames, as in trials.
            let velocities = &derivative(&positions, 1.0)[4..];
            let cycle = Harmonics::fit(velocities, 0..FRAMES, &phase, 3).expect("a cycle");
            for (sum, component) in squares.iter_mut().zip(cycle.components()) {
                *sum += component * component / REPEATS as f64;
            }
        }
        for k in 1..=3 {
            let between = component_variance(k, phase.step_rad, FRAMES as f64);
            let ends = 4.0 * END_GAIN / (FRAMES * FRAMES) as f64;
            let [cosine, sine] = [squares[2 * k - 1], squares[2 * k]];
            assert!((sine / between - 1.0).abs() < 0.1, "{k}: {sine} {between}");
            assert!(
                (cosine / (between + ends) - 1.0).abs() < 0.1,
                "{k}: {cosine} {between} {ends}"
            );
        }
    }

    #[test]
    fn skid_that_differs_between_cycles_by_15_percent_is_not_taken_for_noise() {
        const WHITE: f64 = 1e-3;
        let of_cycle = |i: usize| -> Vec<f64> {
            let skid = 1.0 + 0.15 * [1.0, -1.0, 0.5, -1.5, 1.2, -0.7, 0.9, -1.1, 0.7][i % 9];
            let noise =
                |k: usize| (WHITE / 21.0).sqrt() * ((i * 37 + k * 101) as f64).sin() * 1.414;
            (0..21).map(|k| if k == 1 { skid } else { 0.0 } + noise(k)).collect()
        };
        let cycles: Vec<Vec<f64>> = (0..9).map(of_cycle).collect();
        let cycles: Vec<&[f64]> = cycles.iter().map(Vec::as_slice).collect();
        let square = mean(cycles.iter().map(|cycle| cycle.iter().map(|v| v * v).sum::<f64>()));
        let skid = mean(cycles.iter().map(|cycle| cycle[1] * cycle[1])).sqrt();
        let noise = SkidNoise::from_components(&cycles, 0.0, WHITE);
        assert!(!noise.explains_all_differences);
        let debiased = (square - noise.square).sqrt();
        assert!((debiased / skid - 1.0).abs() < 0.005, "{debiased} {skid}");
        // Neighbours that share the noise at their common end with opposite signs differ by more than the noise of
        // each.
        let apart = [[0.0, 1.0], [0.02, 1.0], [0.0, 1.0], [0.02, 1.0]];
        let apart: Vec<&[f64]> = apart.iter().map(|cycle| &cycle[..]).collect();
        let noise =
            |shared_variance| SkidNoise::from_components(&apart, shared_variance, WHITE).square;
        let own = noise(0.0);
        let less = noise(1e-4);
        assert!((own - less - 2e-4 / 12.0).abs() < 1e-15, "{own} {less}");
        // Differences that noise explains are attributed to noise entirely.
        let still = [&[0.03, 1.0][..], &[-0.03, 1.0], &[0.0, 1.0]];
        let noise = SkidNoise::from_components(&still, 0.0, WHITE);
        assert!((noise.square - 9e-4).abs() < 1e-12 && noise.explains_all_differences);
    }
}
