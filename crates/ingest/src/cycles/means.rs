//! Means over cycles and their standard errors, scaled so that 95 % of the means lie within 1.96 standard errors of the
//! true values.

use trilink_statistics::{Estimate, mean, student};

use super::noise::SkidNoise;
use crate::phase::Harmonics;

/// Maximum factor by which the correlation between neighbouring cycles may raise the variance of a mean, because a few
/// cycles determine this correlation poorly.
const MAX_FACTOR: f64 = 3.0;

/// Minimum variance between cycles, as a fraction of the standard error of the total variance, because a few cycles
/// cannot show that the cycles do not differ. (The variance of a variance estimate from n values is 2 / (n - 1) times
/// its square; Gauss.)
const MIN_BETWEEN_CYCLES: f64 = 0.35;

/// Returns the mean over independent cycles and its standard error.
pub(super) fn independent_mean(values: &[f64]) -> Estimate {
    let (value, variance) = moments(values);
    let n = values.len() as f64;
    Estimate { value, se: student(n - 1.0) * (variance / n).sqrt() }
}

/// Returns the mean over cycles of the change in a quantity from the start to the end of each cycle. `cycles` has the
/// number of each cycle.
///
/// One cycle ends where the next one starts, so that most of the noise at the ends cancels in the mean: for n
/// consecutive cycles, all but that of the first start and the last end. Differences between cycles beyond
/// `end_variance`, the noise variance at one end, do not cancel. `min_variance` is the known variance of one cycle's
/// value due to other noise.
pub(super) fn mean_of_changes(
    values: &[f64],
    cycles: &[usize],
    end_variance: f64,
    min_variance: f64,
) -> Estimate {
    let n = values.len() as f64;
    let (value, variance) = moments(values);
    let neighbours: Vec<f64> = (1..values.len())
        .filter(|&i| cycles[i] == cycles[i - 1] + 1)
        .map(|i| (values[i - 1] - value) * (values[i] - value))
        .collect();
    let runs = n - neighbours.len() as f64;
    let covariance = neighbours.iter().sum::<f64>() / (n - 1.0);
    let ends = (2.0 * end_variance).min(variance);
    // Positive correlation between neighbours indicates a drift.
    let factor = 1.0 + 2.0 * covariance / variance.max(f64::MIN_POSITIVE);
    let min_between = MIN_BETWEEN_CYCLES * variance * (2.0 / (n - 1.0)).sqrt();
    let between = (variance - ends).max(min_between) * factor.clamp(1.0, MAX_FACTOR);
    // The variance between cycles is estimated from a few cycles, the noise variances from all frames.
    let between = (student(n - 1.0).powi(2) * between).max(min_variance);
    let se = (between / n).sqrt().hypot((ends * runs).sqrt() / n);
    Estimate { value, se }
}

/// Returns the RMS of a wheel's skid velocity over several cycles, corrected for noise, m/s. `components` has the
/// components of the velocity in each cycle ([`Harmonics::components`]), and `cycles` has the number of each cycle.
/// `common` is the standard error that the mean squares of all cycles share, m^2/s^2.
///
/// Let w be the mean velocity of the n cycles as a function of phase, and e the deviation of one cycle from w. With
/// means over the cycle in angle brackets, the mean square of the cycle is `<w^2> + 2 <w e> + <e^2>`. Because velocity
/// is the derivative of position, `<w e>` contains the position noise at the start and at the end of the cycle, with
/// opposite signs and multiplied by the value of w there; in the sum over cycles, the noise at the end of one cycle
/// therefore cancels that at the start of the next. If noise explains all of `<e^2>`, the measured `<e^2>` is
/// subtracted, so that its error cancels. What remains is the noise of w, whose mean square is 1/n of that of a single
/// cycle's noise and has the same relative uncertainty.
pub(super) fn rms_without_noise(
    components: &[&[f64]],
    cycles: &[usize],
    noise: SkidNoise,
    common: f64,
) -> Estimate {
    let wave: Vec<f64> =
        (0..components[0].len()).map(|i| mean(components.iter().map(|cycle| cycle[i]))).collect();
    let products: Vec<f64> = components
        .iter()
        .map(|cycle| wave.iter().zip(*cycle).map(|(a, b)| a * b).sum::<f64>())
        .collect();
    let deviations: Vec<f64> = components
        .iter()
        .map(|cycle| cycle.iter().zip(&wave).map(|(a, b)| (a - b).powi(2)).sum::<f64>())
        .collect();
    let start = Harmonics::value_at_zero(&wave);
    let product = mean_of_changes(
        &products,
        cycles,
        noise.end_variance * start * start,
        noise.product_variance,
    );
    let mut deviations = independent_mean(&deviations);
    if noise.explains_all_differences {
        deviations.se /= (cycles.len() as f64).sqrt();
    }
    let square = (product.value + deviations.value - noise.square).max(0.0);
    let se = (2.0 * product.se).hypot(deviations.se).hypot(common);
    // Increase of the root if the square increases by its error; well defined also at zero.
    Estimate { value: square.sqrt(), se: (square + se).sqrt() - square.sqrt() }
}

/// Returns the mean and the sample variance of some values.
fn moments(values: &[f64]) -> (f64, f64) {
    let value = mean(values.iter().copied());
    let squares: f64 = values.iter().map(|x| (x - value).powi(2)).sum();
    (value, squares / (values.len() as f64 - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a generator of approximately independent standard normal deviates.
    fn normal(seed: u32) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            let mut uniform = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                f64::from(state >> 8) / f64::from(1 << 24)
            };
            (0..12).map(|_| uniform()).sum::<f64>() - 6.0
        }
    }

    #[test]
    fn independent_values_have_the_textbook_error_widened_as_students() {
        let Estimate { value, se } = independent_mean(&[1.0, 2.0, 4.0]);
        assert!((value - 7.0 / 3.0).abs() < 1e-15);
        let textbook = (7.0_f64 / 3.0).sqrt() / 3_f64.sqrt();
        // Quantile of Student's distribution divided by 1.959964.
        assert!((se / textbook / (4.302653 / 1.959964) - 1.0).abs() < 0.04);
    }

    /// Returns the fraction of 400 means over nine cycles that lie within 1.96 standard errors of the true value.
    fn coverage(mut change: impl FnMut(usize) -> f64, end_variance: f64) -> f64 {
        let cycles: Vec<usize> = (0..9).collect();
        let is_within = |_: &usize| {
            let values: Vec<f64> = cycles.iter().map(|&i| change(i)).collect();
            let Estimate { value, se } = mean_of_changes(&values, &cycles, end_variance, 0.0);
            value.abs() < 1.96 * se
        };
        (0..400).filter(is_within).count() as f64 / 400.0
    }

    #[test]
    fn the_mean_of_changes_has_the_errors_of_its_ends_and_of_differences_between_cycles() {
        let mut normal = normal(3);
        let mut last = 0.0;
        let mut change = |i: usize, between: f64| {
            let before = if i == 0 { normal() } else { last };
            last = normal();
            last - before + between * normal()
        };
        // Some of the variance of nine cycles might be genuine, although it is not here.
        let of_ends = coverage(|i| change(i, 0.0), 1.0);
        assert!((0.92..0.999).contains(&of_ends), "{of_ends}");
        let of_both = coverage(|i| change(i, 2.0), 1.0);
        assert!((0.92..0.995).contains(&of_both), "{of_both}");
        let alternating = [1.0, 2.0, 1.0, 2.0, 1.0, 2.0];
        let se =
            |end_variance| mean_of_changes(&alternating, &[0, 1, 2, 3, 4, 5], end_variance, 0.0).se;
        assert!(se(0.15) < 0.7 * se(0.0));
        // By chance a few cycles may differ by less than the known noise of each.
        let alike = mean_of_changes(&[1.0, 1.001, 0.999, 1.0], &[0, 2, 4, 6], 0.0, 0.04);
        assert!((alike.se - 0.1).abs() < 1e-12);
        // A drift affects neighbouring cycles in the same way.
        let drifting = [1.0, 1.1, 1.2, 1.8, 1.9, 2.0];
        let apart = mean_of_changes(&drifting, &[0, 2, 4, 6, 8, 10], 0.0, 0.0).se;
        assert!(mean_of_changes(&drifting, &[0, 1, 2, 3, 4, 5], 0.0, 0.0).se > 1.2 * apart);
    }

    const NUMBERS: [usize; 9] = [0, 1, 2, 3, 4, 5, 6, 7, 8];

    #[test]
    fn noise_as_large_as_the_signal_is_removed_and_differences_between_cycles_are_not() {
        let mut normal = normal(7);
        for differs in [0.0_f64, 0.15] {
            let mut within = 0;
            let mut sum = 0.0;
            const REPEATS: usize = 400;
            let rms = (1.0 + differs * differs).sqrt();
            for _ in 0..REPEATS {
                let mut cycle = || -> Vec<f64> {
                    let skid = 1.0 + differs * normal();
                    (0..21)
                        .map(|i| if i == 2 { skid } else { 0.0 } + normal() / 21_f64.sqrt())
                        .collect()
                };
                let cycles: [Vec<f64>; 9] = std::array::from_fn(|_| cycle());
                let noise = SkidNoise { square: 1.0, ..SkidNoise::NONE };
                let cycles = cycles.each_ref().map(Vec::as_slice);
                let Estimate { value, se } = rms_without_noise(&cycles, &NUMBERS, noise, 0.0);
                within += usize::from((value - rms).abs() < 1.96 * se);
                sum += value / rms;
            }
            assert!((sum / REPEATS as f64 - 1.0).abs() < 0.02, "{}", sum / REPEATS as f64);
            assert!(within >= REPEATS * 90 / 100, "{within}");
        }
        let noise = SkidNoise { square: 1.2, ..SkidNoise::NONE };
        let nothing = rms_without_noise(&[&[0.9], &[1.0], &[1.1]], &[0, 1, 2], noise, 0.0);
        assert!(nothing.value == 0.0 && nothing.se > 0.0);
    }

    #[test]
    fn noise_that_is_subtracted_as_measured_leaves_no_error_of_its_own() {
        let mut normal = normal(9);
        let mut within = 0;
        let mut errors = 0.0;
        let mut claimed = 0.0;
        const REPEATS: usize = 1000;
        for _ in 0..REPEATS {
            let mut component =
                |i: usize| if i == 2 { 1.0 } else { 0.0 } + normal() / 21_f64.sqrt();
            let cycles: [[f64; 21]; 9] =
                std::array::from_fn(|_| std::array::from_fn(&mut component));
            let cycles = cycles.each_ref().map(<[f64; 21]>::as_slice);
            let noise = SkidNoise::from_components(&cycles, 0.0, 1.0);
            assert!(noise.explains_all_differences);
            let Estimate { value, se } = rms_without_noise(&cycles, &NUMBERS, noise, 0.0);
            within += usize::from((value - 1.0).abs() < 1.96 * se);
            errors += (value - 1.0).powi(2) / REPEATS as f64;
            claimed += se * se / REPEATS as f64;
        }
        // The error is estimated from nine cycles and widened accordingly.
        let wide = (claimed / errors).sqrt() / student(8.0);
        assert!(within >= REPEATS * 92 / 100 && (0.9..1.15).contains(&wide), "{within} {wide}");
    }

    /// Tests a velocity wave that begins at its peak, so that position noise at either end of a cycle changes the
    /// wave's amplitude in that cycle.
    #[test]
    fn noise_at_an_end_shared_by_two_cycles_cancels_in_their_mean() {
        let mut normal = normal(5);
        let mut within = 0;
        let mut errors = 0.0;
        let mut claimed = 0.0;
        const REPEATS: usize = 400;
        for _ in 0..REPEATS {
            let ends: [f64; 10] = std::array::from_fn(|_| 0.01 * normal());
            let cycle = |i: usize| {
                let change = ends[i + 1] - ends[i];
                // cos and sin of amplitude 1.
                let cosine = std::f64::consts::FRAC_1_SQRT_2 + 2_f64.sqrt() * change;
                [0.0, cosine, 0.0]
            };
            let cycles: [[f64; 3]; 9] = std::array::from_fn(cycle);
            let noise = SkidNoise { end_variance: 1e-4, ..SkidNoise::NONE };
            let cycles = cycles.each_ref().map(<[f64; 3]>::as_slice);
            let Estimate { value, se } = rms_without_noise(&cycles, &NUMBERS, noise, 0.0);
            let off = value - std::f64::consts::FRAC_1_SQRT_2;
            within += usize::from(off.abs() < 1.96 * se);
            errors += off * off / REPEATS as f64;
            claimed += se * se / REPEATS as f64;
        }
        let wide = (claimed / errors).sqrt();
        assert!(within >= REPEATS * 90 / 100 && wide < 2.2, "{within} {wide}");
    }
}
