//! Means over cycles and what they are worth. 95 % of what is measured lies within 1.96 standard
//! errors of the truth.

use trilink_statistics::{Estimate, mean, student};

use super::noise::SkidNoise;
use crate::phase::Harmonics;

/// How far the correlation of neighbouring cycles may raise the variance of a mean: its estimate
/// from a few cycles is rough.
const LARGEST_FACTOR: f64 = 3.0;

/// Part of a variance's own error (Gauss: its variance is 2 / (n - 1) of its square) that what differs
/// between cycles has at least: of a few cycles it is not known to be none.
const LEAST_OWN: f64 = 0.35;

/// Mean over cycles that have nothing in common.
pub(super) fn mean_of(values: &[f64]) -> Estimate {
    let (value, variance) = moments(values);
    let n = values.len() as f64;
    Estimate { value, se: student(n - 1.0) * (variance / n).sqrt() }
}

/// Mean over cycles of what changes from their starts to their ends; `cycles` are their numbers.
/// Where one ends the next one starts, and so most of what noise at the ends makes of a mean cancels:
/// of n cycles in a row, all but that of the first and the last. What differs between cycles beyond
/// `end_variance`, that of one end, does not cancel. `least` is the variance of one cycle's value that noise is known
/// to make beside that of its ends.
pub(super) fn mean_change(
    values: &[f64],
    cycles: &[usize],
    end_variance: f64,
    least: f64,
) -> Estimate {
    let n = values.len() as f64;
    let (value, variance) = moments(values);
    let neighbours: Vec<f64> = (1..values.len())
        .filter(|&i| cycles[i] == cycles[i - 1] + 1)
        .map(|i| (values[i - 1] - value) * (values[i] - value))
        .collect();
    let rows = n - neighbours.len() as f64;
    let covariance = neighbours.iter().sum::<f64>() / (n - 1.0);
    let ends = (2.0 * end_variance).min(variance);
    // Neighbours that are alike have a drift in common.
    let factor = 1.0 + 2.0 * covariance / variance.max(f64::MIN_POSITIVE);
    let least_own = LEAST_OWN * variance * (2.0 / (n - 1.0)).sqrt();
    let own = (variance - ends).max(least_own) * factor.clamp(1.0, LARGEST_FACTOR);
    // A few cycles tell the one, all frames the others.
    let own = (student(n - 1.0).powi(2) * own).max(least);
    let se = (own / n).sqrt().hypot((ends * rows).sqrt() / n);
    Estimate { value, se }
}

/// RMS of what has these components in the cycles ([`Harmonics::components`]), without noise.
/// `common` is the standard error of all mean squares together.
///
/// A cycle's square is the mean wave's, twice the mean wave times what the cycle differs from it by,
/// and the square of that. The second is a mean of changes of position, weighted by the wave: what
/// noise makes of it at the end of a cycle, where the wave is `w(0)`, the next cycle has too. Where all
/// of the third is noise, it is subtracted as it came out, and its own error with it; what is left is the
/// noise of the mean wave, an n-th part, of which nobody knows more than of a single cycle's.
pub(super) fn rms_without_noise(
    components: &[&[f64]],
    cycles: &[usize],
    noise: SkidNoise,
    common: f64,
) -> Estimate {
    let wave: Vec<f64> =
        (0..components[0].len()).map(|i| mean(components.iter().map(|cycle| cycle[i]))).collect();
    let product = |other: &[f64]| wave.iter().zip(other).map(|(a, b)| a * b).sum::<f64>();
    let products: Vec<f64> = components.iter().map(|cycle| product(cycle)).collect();
    let apart = |cycle: &&[f64]| cycle.iter().zip(&wave).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let apart: Vec<f64> = components.iter().map(apart).collect();
    let begin = Harmonics::value_at_zero(&wave);
    let along =
        mean_change(&products, cycles, noise.end_variance * begin * begin, noise.product_variance);
    let mut apart = mean_of(&apart);
    if noise.is_all_that_differs {
        apart.se /= (cycles.len() as f64).sqrt();
    }
    let square = (along.value + apart.value - noise.square).max(0.0);
    let se = (2.0 * along.se).hypot(apart.se).hypot(common);
    // By how much the root grows when the square grows by its error: well-defined at zero too.
    Estimate { value: square.sqrt(), se: (square + se).sqrt() - square.sqrt() }
}

/// Mean and variance of a sample.
fn moments(values: &[f64]) -> (f64, f64) {
    let value = mean(values.iter().copied());
    let squares: f64 = values.iter().map(|x| (x - value).powi(2)).sum();
    (value, squares / (values.len() as f64 - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Successive values are as good as independent and normal.
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
        let Estimate { value, se } = mean_of(&[1.0, 2.0, 4.0]);
        assert!((value - 7.0 / 3.0).abs() < 1e-15);
        let textbook = (7.0_f64 / 3.0).sqrt() / 3_f64.sqrt();
        // Quantiles of Student's distribution over 1.959964.
        assert!((se / textbook / (4.302653 / 1.959964) - 1.0).abs() < 0.04);
    }

    /// Part of 400 means of nine cycles within 1.96 errors.
    fn coverage(mut change: impl FnMut(usize) -> f64, end_variance: f64) -> f64 {
        let cycles: Vec<usize> = (0..9).collect();
        let is_within = |_: &usize| {
            let values: Vec<f64> = cycles.iter().map(|&i| change(i)).collect();
            let Estimate { value, se } = mean_change(&values, &cycles, end_variance, 0.0);
            value.abs() < 1.96 * se
        };
        (0..400).filter(is_within).count() as f64 / 400.0
    }

    #[test]
    fn the_mean_of_changes_has_the_error_of_its_ends_and_of_what_differs() {
        let (mut normal, mut last) = (normal(3), 0.0);
        let mut change = |i: usize, own: f64| {
            let before = if i == 0 { normal() } else { last };
            last = normal();
            last - before + own * normal()
        };
        // Some of what nine cycles show may be their own, though here nothing is.
        let of_ends = coverage(|i| change(i, 0.0), 1.0);
        assert!((0.92..0.999).contains(&of_ends), "{of_ends}");
        let of_both = coverage(|i| change(i, 2.0), 1.0);
        assert!((0.92..0.995).contains(&of_both), "{of_both}");
        let alternating = [1.0, 2.0, 1.0, 2.0, 1.0, 2.0];
        let se =
            |end_variance| mean_change(&alternating, &[0, 1, 2, 3, 4, 5], end_variance, 0.0).se;
        assert!(se(0.15) < 0.7 * se(0.0));
        // By chance a few cycles may differ by less than what noise is known to make of each.
        let alike = mean_change(&[1.0, 1.001, 0.999, 1.0], &[0, 2, 4, 6], 0.0, 0.04);
        assert!((alike.se - 0.1).abs() < 1e-12);
        // A drift is in all means over neighbours.
        let drifting = [1.0, 1.1, 1.2, 1.8, 1.9, 2.0];
        let apart = mean_change(&drifting, &[0, 2, 4, 6, 8, 10], 0.0, 0.0).se;
        assert!(mean_change(&drifting, &[0, 1, 2, 3, 4, 5], 0.0, 0.0).se > 1.2 * apart);
    }

    const NUMBERS: [usize; 9] = [0, 1, 2, 3, 4, 5, 6, 7, 8];

    #[test]
    fn noise_as_large_as_the_signal_is_taken_out_and_what_differs_between_cycles_is_not() {
        let mut normal = normal(7);
        for differs in [0.0_f64, 0.15] {
            let (mut within, mut sum) = (0, 0.0);
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
    fn the_error_of_noise_that_is_subtracted_as_it_came_out_is_not_in_what_is_left() {
        let (mut normal, mut within, mut errors, mut claimed) = (normal(9), 0, 0.0, 0.0);
        const REPEATS: usize = 1000;
        for _ in 0..REPEATS {
            let mut component =
                |i: usize| if i == 2 { 1.0 } else { 0.0 } + normal() / 21_f64.sqrt();
            let cycles: [[f64; 21]; 9] =
                std::array::from_fn(|_| std::array::from_fn(&mut component));
            let cycles = cycles.each_ref().map(<[f64; 21]>::as_slice);
            let noise = SkidNoise::of_components(&cycles, 0.0, 1.0);
            assert!(noise.is_all_that_differs);
            let Estimate { value, se } = rms_without_noise(&cycles, &NUMBERS, noise, 0.0);
            within += usize::from((value - 1.0).abs() < 1.96 * se);
            errors += (value - 1.0).powi(2) / REPEATS as f64;
            claimed += se * se / REPEATS as f64;
        }
        // A few cycles tell the error that all have: of nine it is this much wider.
        let wide = (claimed / errors).sqrt() / student(8.0);
        assert!(within >= REPEATS * 92 / 100 && (0.9..1.15).contains(&wide), "{within} {wide}");
    }

    /// A wave that begins at its peak, whose velocity the noise of its position at the ends of the
    /// cycles makes larger and smaller in turn.
    #[test]
    fn noise_at_an_end_that_two_cycles_share_leaves_their_mean() {
        let (mut normal, mut within, mut errors, mut claimed) = (normal(5), 0, 0.0, 0.0);
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
