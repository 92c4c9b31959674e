//! Time derivatives of series with gaps.

use super::gaps::runs;

/// Weights of samples -2 to 2 in the fourth-order central difference.
pub(crate) const WEIGHTS: [f64; 5] = [1.0 / 12.0, -8.0 / 12.0, 0.0, 8.0 / 12.0, -1.0 / 12.0];

/// Returns the time derivative, per second, by fourth-order central differences. Within each run without gaps, the
/// differences are second-order next to the ends and one-sided at the ends. The derivative of an isolated sample is
/// NaN.
pub(crate) fn derivative(series: &[f64], rate_hz: f64) -> Vec<f64> {
    let mut rates = vec![f64::NAN; series.len()];
    for (start, end) in runs(series) {
        let run = &series[start..end];
        let last = run.len() - 1;
        for (i, rate) in rates[start..end].iter_mut().enumerate() {
            let per_frame = match (i.min(last - i), last) {
                (0, 0) => f64::NAN,
                (0, 1) => run[1] - run[0],
                (0, _) if i == 0 => 2.0 * run[1] - 1.5 * run[0] - 0.5 * run[2],
                (0, _) => 1.5 * run[last] - 2.0 * run[last - 1] + 0.5 * run[last - 2],
                (1, _) => 0.5 * (run[i + 1] - run[i - 1]),
                _ => (run[i - 2] - run[i + 2] + 8.0 * (run[i + 1] - run[i - 1])) / 12.0,
            };
            *rate = per_frame * rate_hz;
        }
    }
    rates
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polynomial(degree: i32, t: f64) -> [f64; 2] {
        [t.powi(degree), f64::from(degree) * t.powi(degree - 1)]
    }

    #[test]
    fn polynomials_are_differentiated_exactly_up_to_the_order() {
        for degree in 1..=4 {
            let series: Vec<f64> =
                (0..20).map(|i| polynomial(degree, f64::from(i) / 10.0)[0]).collect();
            for (i, rate) in derivative(&series, 10.0).iter().enumerate() {
                let truth = polynomial(degree, i as f64 / 10.0)[1];
                let is_exact = degree <= 2 || (2..18).contains(&i);
                assert!((rate - truth).abs() < 1e-12 || !is_exact, "{degree} {i}");
            }
        }
    }

    #[test]
    fn runs_between_gaps_are_differentiated_separately() {
        let nan = f64::NAN;
        let series = [0.0, 2.0, nan, 5.0, nan, 1.0, 2.0, 3.0];
        let expected = [2.0, 2.0, nan, nan, nan, 1.0, 1.0, 1.0];
        for (rate, expected) in derivative(&series, 1.0).iter().zip(expected) {
            assert!(rate.is_nan() && expected.is_nan() || (rate - expected).abs() < 1e-15);
        }
    }
}
