//! Means over cycles and what they are worth.

use super::measure::Cycle;
use crate::stats::{self, Estimate};

/// How far the correlation of neighbouring cycles may change the variance of a mean: its
/// estimate from a few cycles is rough, so a large gain is not believed.
const VARIANCE_FACTORS: (f64, f64) = (0.5, 3.0);

/// Mean over cycles; `cycles` are their numbers. Neighbours share an end point, so their
/// covariance goes into the standard error.
pub fn mean(values: &[f64], cycles: &[usize]) -> Estimate {
    let n = values.len() as f64;
    let value = values.iter().sum::<f64>() / n;
    let products = |pairs: &mut dyn Iterator<Item = (f64, f64)>| -> f64 {
        pairs.map(|(a, b)| (a - value) * (b - value)).sum()
    };
    let squares = products(&mut values.iter().map(|&x| (x, x)));
    let neighbours = (1..values.len())
        .filter(|&i| cycles[i] == cycles[i - 1] + 1)
        .map(|i| (values[i - 1], values[i]));
    let covariance = products(&mut { neighbours });
    let factor = if squares > 0.0 { 1.0 + 2.0 * covariance / squares } else { 1.0 };
    let factor = factor.clamp(VARIANCE_FACTORS.0, VARIANCE_FACTORS.1);
    Estimate { value, se: (squares / (n - 1.0) / n * factor).sqrt() }
}

/// RMS skid velocity (m/s) of what all cycles have in common. With n cycles, the power of
/// their mean is the common power plus the noise's over n, and the mean of their powers the
/// common power plus the noise's; the two give both. The standard error is the jackknife's
/// over cycles, widened to the standard deviation of Student's distribution: from a few cycles
/// it is itself uncertain.
pub fn common_skid(cycles: &[&Cycle], wheel: usize) -> Estimate {
    let skid: Vec<&[f64]> = cycles.iter().map(|cycle| cycle.skid_m_s[wheel].as_slice()).collect();
    let n = skid.len();
    let mut total = vec![0.0; skid.first().map_or(0, |components| components.len())];
    let mut powers = Vec::with_capacity(n);
    for components in &skid {
        total.iter_mut().zip(*components).for_each(|(sum, v)| *sum += v);
        powers.push(components.iter().map(|v| v * v).sum::<f64>());
    }
    let all_power: f64 = powers.iter().sum();
    let common = |without: Option<usize>| -> f64 {
        let count = n as f64 - f64::from(u8::from(without.is_some()));
        let left_out = |i: usize| without.map_or(0.0, |k| skid[k][i]);
        let mean_power: f64 =
            total.iter().enumerate().map(|(i, sum)| ((sum - left_out(i)) / count).powi(2)).sum();
        let power = (all_power - without.map_or(0.0, |k| powers[k])) / count;
        (count * mean_power - power) / (count - 1.0)
    };
    let power = common(None);
    if n < 3 {
        return Estimate { value: power.max(0.0).sqrt(), se: f64::NAN };
    }
    let left_out: Vec<f64> = (0..n).map(|k| common(Some(k))).collect();
    let middle = stats::mean(left_out.iter().copied());
    let squares: f64 = left_out.iter().map(|x| (x - middle).powi(2)).sum();
    let freedom = n as f64 - 1.0;
    let student = (freedom / (freedom - 2.0).max(1.0)).sqrt();
    let power_se = (squares * freedom / n as f64).sqrt() * student;
    let power = power.max(0.0);
    // By how much the root grows when the power grows by its error: well-defined at zero too.
    Estimate { value: power.sqrt(), se: (power + power_se).sqrt() - power.sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::GaitMetrics;

    const COMPONENTS: usize = 21;

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

    fn with_skid(skid: Vec<f64>) -> Cycle {
        Cycle {
            start: 0.0,
            end: 0.0,
            metrics: GaitMetrics::MISSING,
            skid_m_s: [skid, Vec::new(), Vec::new()],
            is_gait: true,
        }
    }

    #[test]
    fn independent_values_have_the_textbook_error() {
        let estimate = mean(&[1.0, 2.0, 4.0], &[3, 5, 7]);
        assert!((estimate.value - 7.0 / 3.0).abs() < 1e-15);
        let deviation = (7.0_f64 / 3.0).sqrt();
        assert!((estimate.se - deviation / 3_f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn alternating_neighbours_lower_the_error_and_similar_ones_raise_it() {
        let textbook = |values: &[f64]| mean(values, &[0, 2, 4, 6, 8, 10]).se;
        let chained = |values: &[f64]| mean(values, &[0, 1, 2, 3, 4, 5]).se;
        let alternating = [1.0, 2.0, 1.0, 2.0, 1.0, 2.0];
        assert!((chained(&alternating) / textbook(&alternating) - 0.5_f64.sqrt()).abs() < 1e-12);
        let drifting = [1.0, 1.1, 1.2, 1.8, 1.9, 2.0];
        assert!(chained(&drifting) > 1.2 * textbook(&drifting));
        assert_eq!(chained(&[1.0; 6]), 0.0);
    }

    #[test]
    fn noise_of_twice_the_signal_is_taken_out() {
        let mut normal = normal(7);
        let (mut within, mut sum) = (0, 0.0);
        const REPEATS: usize = 200;
        let truth = 0.0014;
        let noise = 0.0028 / (COMPONENTS as f64).sqrt();
        for _ in 0..REPEATS {
            let cycles: Vec<Cycle> = (0..9)
                .map(|_| {
                    let at = |i: usize| if i == 2 { truth } else { 0.0 } + noise * normal();
                    with_skid((0..COMPONENTS).map(at).collect())
                })
                .collect();
            let estimate = common_skid(&cycles.iter().collect::<Vec<_>>(), 0);
            within += usize::from((estimate.value - truth).abs() < 2.0 * estimate.se);
            sum += estimate.value;
        }
        assert!((sum / REPEATS as f64 / truth - 1.0).abs() < 0.01);
        assert!(within >= REPEATS * 88 / 100, "{within}");
    }

    #[test]
    fn pure_noise_leaves_about_nothing() {
        let mut normal = normal(3);
        let cycles: Vec<Cycle> = (0..10)
            .map(|_| with_skid((0..COMPONENTS).map(|_| 0.001 * normal()).collect()))
            .collect();
        let estimate = common_skid(&cycles.iter().collect::<Vec<_>>(), 0);
        assert!(estimate.value < 0.001 && estimate.se > 0.0);
    }
}
