//! Means over cycles and what they are worth. 95 % of what is measured lies within 1.96 standard
//! errors of the truth.

use crate::stats::{Estimate, mean};

/// How far the correlation of neighbouring cycles may raise the variance of a mean: its estimate
/// from a few cycles is rough.
const LARGEST_FACTOR: f64 = 3.0;

/// Mean over cycles that have nothing in common.
pub fn mean_of(values: &[f64]) -> Estimate {
    let (value, variance) = moments(values);
    let n = values.len() as f64;
    Estimate { value, se: student(n - 1.0) * (variance / n).sqrt() }
}

/// Mean over cycles of what changes from their starts to their ends; `cycles` are their numbers.
/// Where one ends the next one starts, and so most of what noise at the ends makes of a mean cancels:
/// of n cycles in a row, all but that of the first and the last. What differs between cycles beyond
/// `end_variance`, that of one end, does not cancel.
pub fn mean_change(values: &[f64], cycles: &[usize], end_variance: f64) -> Estimate {
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
    let own = (variance - ends) * factor.clamp(1.0, LARGEST_FACTOR);
    let se = student(n - 1.0) * (own / n + ends * rows / (n * n)).sqrt();
    Estimate { value, se }
}

/// RMS of what has the given mean squares in the cycles, of which noise makes `noise`. `common` is
/// the standard error of all mean squares together.
pub fn rms_without_noise(squares: &[f64], noise: f64, common: f64) -> Estimate {
    let Estimate { value, se } = mean_of(squares);
    let (square, se) = ((value - noise).max(0.0), se.hypot(common));
    // By how much the root grows when the square grows by its error: well-defined at zero too.
    Estimate { value: square.sqrt(), se: (square + se).sqrt() - square.sqrt() }
}

/// Mean and variance of a sample.
fn moments(values: &[f64]) -> (f64, f64) {
    let value = mean(values.iter().copied());
    let squares: f64 = values.iter().map(|x| (x - value).powi(2)).sum();
    (value, squares / (values.len() as f64 - 1.0))
}

/// How much wider than of a normal distribution the middle 95 % of Student's are: a standard error
/// from a few cycles is itself uncertain (Abramowitz and Stegun, 26.7.5).
fn student(freedom: f64) -> f64 {
    let x = 1.0 / freedom;
    1.0 + x * (1.2104 + x * (1.4400 + x * 1.3040))
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
        for (freedom, quantile) in [(3.0, 3.182446), (8.0, 2.306004), (30.0, 2.042272)] {
            assert!((student(freedom) * 1.959964 / quantile - 1.0).abs() < 0.01);
        }
    }

    /// Part of 400 means of nine cycles within 1.96 errors.
    fn coverage(mut change: impl FnMut(usize) -> f64, end_variance: f64) -> f64 {
        let cycles: Vec<usize> = (0..9).collect();
        let is_within = |_: &usize| {
            let values: Vec<f64> = cycles.iter().map(|&i| change(i)).collect();
            let Estimate { value, se } = mean_change(&values, &cycles, end_variance);
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
        let of_ends = coverage(|i| change(i, 0.0), 1.0);
        assert!((0.92..0.995).contains(&of_ends), "{of_ends}");
        let of_both = coverage(|i| change(i, 2.0), 1.0);
        assert!((0.92..0.995).contains(&of_both), "{of_both}");
        let alternating = [1.0, 2.0, 1.0, 2.0, 1.0, 2.0];
        let se = |end_variance| mean_change(&alternating, &[0, 1, 2, 3, 4, 5], end_variance).se;
        assert!(se(0.15) < 0.5 * se(0.0));
        // A drift is in all means over neighbours.
        let drifting = [1.0, 1.1, 1.2, 1.8, 1.9, 2.0];
        let apart = mean_change(&drifting, &[0, 2, 4, 6, 8, 10], 0.0).se;
        assert!(mean_change(&drifting, &[0, 1, 2, 3, 4, 5], 0.0).se > 1.2 * apart);
    }

    #[test]
    fn noise_as_large_as_the_signal_is_taken_out_and_what_differs_between_cycles_is_not() {
        let mut normal = normal(7);
        for differs in [0.0_f64, 0.15] {
            let (mut within, mut sum) = (0, 0.0);
            const REPEATS: usize = 400;
            let rms = (1.0 + differs * differs).sqrt();
            for _ in 0..REPEATS {
                let square = |_| {
                    let skid = 1.0 + differs * normal();
                    (0..21)
                        .map(|i| {
                            let own = if i == 2 { skid } else { 0.0 };
                            (own + normal() / 21_f64.sqrt()).powi(2)
                        })
                        .sum()
                };
                let squares: Vec<f64> = (0..9).map(square).collect();
                let Estimate { value, se } = rms_without_noise(&squares, 1.0, 0.0);
                within += usize::from((value - rms).abs() < 1.96 * se);
                sum += value / rms;
            }
            assert!((sum / REPEATS as f64 - 1.0).abs() < 0.02, "{}", sum / REPEATS as f64);
            assert!(within >= REPEATS * 90 / 100, "{within}");
        }
        let nothing = rms_without_noise(&[0.9, 1.0, 1.1], 1.2, 0.0);
        assert!(nothing.value == 0.0 && nothing.se > 0.0);
    }
}
