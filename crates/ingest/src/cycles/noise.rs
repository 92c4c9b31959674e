//! What the markers' noise makes of the means.
//!
//! Above the motion's frequencies everything is noise, and its level there is that of white noise of
//! the positions. What is left of the links' tilt is slower, and comes to some times more: how much is
//! seen in what differs from cycle to cycle. But the skid itself may differ, too, so that no more of
//! that is taken for noise than [`LARGEST_EXCESS`] times the white noise.

use trilink_statistics::mean;

use super::measure::{Cycle, CycleData};
use crate::signals::{THIRD, THIRD_GAIN, WEIGHTS, noise};

/// How many times the white noise all noise may be. It is 1.5 times at 2 rad/s and more, and 3 times
/// at 0.5 rad/s, where a cycle takes as long as a suspension's swing.
const LARGEST_EXCESS: f64 = 4.0;
/// Of differentiated white noise that is summed up again, the variance at an end: what is left of
/// the derivative's weights is (-1, 7, 7, -1) / 12.
const END: f64 = 100.0 / 144.0;

/// Variance of a smoothed position at one end of a cycle, m^2, and of the heading, rad^2.
pub(super) fn end_variances(data: &CycleData, window: usize) -> [f64; 2] {
    let filled = &data.tracked.filled;
    let [x, y, theta] = [&filled.x_m, &filled.y_m, &filled.theta_rad].map(|series| noise(series));
    [0.5 * (x * x + y * y), theta * theta].map(|variance| variance / window as f64)
}

/// What noise makes of a wheel's skid velocity in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SkidNoise {
    /// Of the mean square, m^2/s^2.
    pub square: f64,
    /// Whether that is all by which cycles differ.
    pub is_all_that_differs: bool,
    /// Variance of the mean velocity by the noise of the position at one end, m^2/s^2.
    pub end_variance: f64,
    /// Variance of the mean product of the cycles' mean wave with one cycle by white noise, but for its ends, m^4/s^4.
    pub product_variance: f64,
}

impl SkidNoise {
    pub(super) const NONE: Self =
        Self { square: 0.0, is_all_that_differs: false, end_variance: 0.0, product_variance: 0.0 };

    /// Of cycles with these components of the wheel's skid velocity.
    pub(super) fn new(data: &CycleData, cycles: &[&Cycle], wheel: usize) -> Self {
        let (count, step) = (data.driven.shape_harmonics, data.driven.phase.step_rad);
        let frames = mean(cycles.iter().map(|cycle| cycle.end - cycle.start));
        // By how much third differences tell more of a series than of its derivative.
        let differences = (THIRD_GAIN / squares(&third_of_derivative())).sqrt();
        // Standard deviation of the position, times the frames per second.
        let noise_m_s = noise(&data.raw_wheels.skid_m_s[wheel]) * differences;
        let skid: Vec<&[f64]> = cycles.iter().map(|cycle| &cycle.skid_m_s[wheel][..]).collect();
        let end_variance = END * (noise_m_s / frames).powi(2);
        let neighbours = cycles.windows(2).filter(|pair| pair[0].end == pair[1].start).count();
        // Of all components: an end is in the offset, and in each cosine by the root of 2.
        let in_common = neighbours as f64 * (1.0 + 2.0 * count as f64) * end_variance;
        let white = |k: usize| component_variance(k, step, frames) * noise_m_s.powi(2);
        let wave = |i: usize| mean(skid.iter().map(|cycle| cycle[i]));
        let product = |k: usize| (wave(2 * k - 1).powi(2) + wave(2 * k).powi(2)) * white(k);
        let product_variance = (1..=count).map(product).sum();
        let white = 2.0 * (1..=count).map(white).sum::<f64>();
        Self { end_variance, product_variance, ..Self::of_components(&skid, in_common, white) }
    }

    /// Of cycles of these components, given the mean square that white noise makes. Neighbours have the noise at
    /// an end in common, with opposite signs (`in_common`: the sum of these variances), so that they differ by more
    /// than noise makes in each.
    pub(super) fn of_components(cycles: &[&[f64]], in_common: f64, white: f64) -> Self {
        let n = cycles.len() as f64;
        let differs = |i: usize| {
            let middle = mean(cycles.iter().map(|cycle| cycle[i]));
            cycles.iter().map(|cycle| (cycle[i] - middle).powi(2)).sum::<f64>() / (n - 1.0)
        };
        let differ = (0..cycles[0].len()).map(differs).sum::<f64>();
        let own = (differ - 2.0 * in_common / (n * (n - 1.0))).max(0.0);
        let most = LARGEST_EXCESS * white;
        Self { square: own.min(most), is_all_that_differs: own <= most, ..Self::NONE }
    }
}

/// Variance of each of harmonic `k`'s two components in so many frames of the derivative of white noise, per frame, of
/// unit variance: without what its ends make of them.
fn component_variance(k: usize, step_rad: f64, frames: f64) -> f64 {
    let (sin, sin2) = ((k as f64 * step_rad).sin(), (2.0 * k as f64 * step_rad).sin());
    ((8.0 * sin - sin2) / 6.0).powi(2) / frames
}

fn third_of_derivative() -> [f64; WEIGHTS.len() + THIRD.len() - 1] {
    let mut both = [0.0; WEIGHTS.len() + THIRD.len() - 1];
    for (i, a) in WEIGHTS.iter().enumerate() {
        for (j, b) in THIRD.iter().enumerate() {
            both[i + j] += a * b;
        }
    }
    both
}

fn squares(weights: &[f64]) -> f64 {
    weights.iter().map(|weight| weight * weight).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_of_white_noise_s_derivative_vary_by_their_ends_and_by_what_is_between() {
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
            // Begins and ends between two frames, as cycles do.
            let velocities = &derivative(&positions, 1.0)[4..];
            let cycle = Harmonics::fit(velocities, 0..FRAMES, &phase, 3).expect("a cycle");
            for (sum, component) in squares.iter_mut().zip(cycle.components()) {
                *sum += component * component / REPEATS as f64;
            }
        }
        for k in 1..=3 {
            let between = component_variance(k, phase.step_rad, FRAMES as f64);
            let ends = 4.0 * END / (FRAMES * FRAMES) as f64;
            let [cosine, sine] = [squares[2 * k - 1], squares[2 * k]];
            assert!((sine / between - 1.0).abs() < 0.1, "{k}: {sine} {between}");
            assert!(
                (cosine / (between + ends) - 1.0).abs() < 0.1,
                "{k}: {cosine} {between} {ends}"
            );
        }
    }

    #[test]
    fn skid_that_differs_from_cycle_to_cycle_by_15_percent_is_skid() {
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
        let noise = SkidNoise::of_components(&cycles, 0.0, WHITE);
        assert!(!noise.is_all_that_differs);
        let debiased = (square - noise.square).sqrt();
        assert!((debiased / skid - 1.0).abs() < 0.005, "{debiased} {skid}");
        // Neighbours that have the noise at their common end with opposite signs differ by more than they have.
        let apart = [[0.0, 1.0], [0.02, 1.0], [0.0, 1.0], [0.02, 1.0]];
        let apart: Vec<&[f64]> = apart.iter().map(|cycle| &cycle[..]).collect();
        let noise = |in_common| SkidNoise::of_components(&apart, in_common, WHITE).square;
        let (own, less) = (noise(0.0), noise(1e-4));
        assert!((own - less - 2e-4 / 12.0).abs() < 1e-15, "{own} {less}");
        // Of differences that noise explains, all are noise.
        let still = [&[0.03, 1.0][..], &[-0.03, 1.0], &[0.0, 1.0]];
        let noise = SkidNoise::of_components(&still, 0.0, WHITE);
        assert!((noise.square - 9e-4).abs() < 1e-12 && noise.is_all_that_differs);
    }
}
