//! Mean of a short series that oscillates slowly and irregularly.
//!
//! The average of the series is a poor estimate of the mean if only one or two oscillations are seen, and the scatter
//! of the series says little about the average's error. The series is modelled as a constant, plus a stochastic cycle
//! (Harvey 1989), plus white noise. For a given period and damping of the cycle, the Kalman filter yields the generalised
//! least-squares estimate of the constant and the restricted likelihood (de Jong 1991). The estimates are averaged over
//! a grid of periods and dampings with this likelihood as weight (Bayesian model averaging with equal prior weights).
//!
//! References: A. C. Harvey, *Forecasting, Structural Time Series Models and the Kalman Filter*, Cambridge 1989; P. de
//! Jong, *The diffuse Kalman filter*, Annals of Statistics 19 (1991) 1073.

use std::f64::consts::TAU;

use nalgebra::{Matrix2, RowVector2, Vector2};

use crate::{Estimate, extremes, mean, seen, student};

/// Number of finite periods of the cycle on the grid, geometrically spaced from [`MIN_PERIOD`] to twice the length of the
/// series, so that neighbours differ by at most a fifth for series of up to 100 values. The grid also has an infinite
/// period, with which the cycle is a first-order autoregression.
const PERIODS: u32 = 22;
/// Shortest period of the cycle, in steps of the series.
const MIN_PERIOD: f64 = 4.0;
/// Number of decay times of the cycle's autocorrelation on the grid, geometrically spaced from one step to four times
/// the length of the series.
const DECAYS: u32 = 7;
/// Number of values below which the cycle is not estimated.
const MIN_VALUES: usize = 4;
/// Number of estimated quantities: the mean, the period and the damping.
const ESTIMATED: f64 = 3.0;

/// Estimates the mean of a series of equally spaced values, in which NaN stands for a missing value. `noise_variance` is
/// the approximate variance of the white noise in each value.
///
/// The standard error is for intervals of 1.96 standard errors. It is too small for a series that is shorter than one
/// oscillation or not longer than its correlation time. For fewer than four values, the estimate is the average with
/// the uncertainty of a single value; the standard error of a single value is missing (NaN), and so is the estimate
/// from no value.
pub fn mean_of_oscillation(series: &[f64], noise_variance: f64) -> Estimate {
    let count = seen(series).count() as f64;
    let average = mean(seen(series));
    let squares: f64 = seen(series).map(|value| (value - average).powi(2)).sum();
    let [low, high] = extremes(seen(series));
    if count < MIN_VALUES as f64 {
        let freedom = count - 1.0;
        return Estimate::new(average, student(freedom) * (squares / freedom).sqrt());
    }
    if low == high {
        return Estimate::new(average, (noise_variance / count).sqrt());
    }
    let centred: Vec<f64> = series.iter().map(|value| value - average).collect();
    let length = series.len() as f64;
    let spaced = |[first, last]: [f64; 2], i: u32, count: u32| {
        first * (last / first).powf(f64::from(i) / f64::from(count - 1))
    };
    let periods = (0..PERIODS).map(|i| spaced([MIN_PERIOD, 2.0 * length], i, PERIODS));
    let members: Vec<Member> = periods
        .chain([f64::INFINITY])
        .flat_map(|period| {
            (0..DECAYS).map(move |i| (period, spaced([1.0, 4.0 * length], i, DECAYS)))
        })
        .map(|(period, decay)| {
            let cycle = Cycle { frequency_rad: TAU / period, damping: (-1.0 / decay).exp() };
            cycle.member(&centred, noise_variance / (squares / count))
        })
        .collect();
    let best = members.iter().map(|member| member.log_likelihood).fold(f64::MIN, f64::max);
    let weights: Vec<f64> =
        members.iter().map(|member| (member.log_likelihood - best).exp()).collect();
    let sum: f64 = weights.iter().sum();
    let weighted = |of: &dyn Fn(&Member) -> f64| {
        members.iter().zip(&weights).map(|(member, weight)| weight * of(member)).sum::<f64>() / sum
    };
    let value = weighted(&|member| member.mean);
    let variance = weighted(&|member| member.variance + (member.mean - value).powi(2));
    Estimate::new(average + value, student(count - ESTIMATED) * variance.sqrt())
}

/// Cycle of the grid: frequency, rad, and damping factor, per step of the series.
#[derive(Debug, Clone, Copy)]
struct Cycle {
    frequency_rad: f64,
    damping: f64,
}

/// Estimate of the mean with one cycle of the grid.
#[derive(Debug, Clone, Copy)]
struct Member {
    mean: f64,
    variance: f64,
    /// Logarithm of the restricted likelihood, up to a constant.
    log_likelihood: f64,
}

impl Cycle {
    /// Filters the series and, with the same gains, a series of ones; the regression of the former's innovations on the
    /// latter's gives the mean. `noise` is the ratio of the variances of the noise and the cycle; the scale of both is
    /// estimated.
    fn member(self, series: &[f64], noise: f64) -> Member {
        let (sin, cos) = self.frequency_rad.sin_cos();
        let step = self.damping * Matrix2::new(cos, sin, -sin, cos);
        let disturbance = (1.0 - self.damping * self.damping) * Matrix2::identity();
        // States of the cycle (columns) that follow from the series and from ones, and their covariance.
        let mut states = Matrix2::zeros();
        let mut covariance = Matrix2::<f64>::identity();
        let mut log_variance = 0.0;
        let mut products = Matrix2::zeros();
        for value in series {
            if !value.is_nan() {
                let innovations = RowVector2::new(*value, 1.0) - states.row(0);
                let variance = covariance[(0, 0)] + noise;
                let gain: Vector2<f64> = covariance.column(0) / variance;
                log_variance += variance.ln();
                products += innovations.transpose() * innovations / variance;
                states += gain * innovations;
                covariance -= gain * gain.transpose() * variance;
            }
            states = step * states;
            covariance = step * covariance * step.transpose() + disturbance;
        }
        let information = products[(1, 1)];
        let mean = products[(0, 1)] / information;
        let residual_squares = (products[(0, 0)] - mean * products[(0, 1)]).max(f64::MIN_POSITIVE);
        let freedom = seen(series).count() as f64 - 1.0;
        let log_likelihood =
            -0.5 * (log_variance + information.ln() + freedom * residual_squares.ln());
        Member { mean, variance: residual_squares / freedom / information, log_likelihood }
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    const NOISE: f64 = 0.1;
    const SERIES: usize = 300;

    /// Returns the RMS error of the estimate, relative to that of the average and relative to its standard error, for
    /// series with a mean of zero, half of which have missing values.
    fn errors(length: usize, draw: impl Fn(&mut ChaCha8Rng) -> Vec<f64>) -> [f64; 2] {
        let mut random = ChaCha8Rng::seed_from_u64(length as u64);
        let mut squares = [0.0; 3];
        for nth in 0..SERIES {
            let mut series = draw(&mut random);
            for value in &mut series {
                let noise: f64 = StandardNormal.sample(&mut random);
                *value += NOISE * noise;
            }
            if nth % 2 == 0 {
                series[length / 3..length / 2].fill(f64::NAN);
            }
            let average = mean(seen(&series));
            let Estimate { value, se } = mean_of_oscillation(&series, NOISE * NOISE);
            for (sum, error) in squares.iter_mut().zip([average, value, value / se]) {
                *sum += error * error;
            }
        }
        let [average, error, in_se] = squares.map(|sum| (sum / SERIES as f64).sqrt());
        [error / average, in_se]
    }

    /// Draws a sum of sines with these amplitudes and ranges of the period.
    fn sines(length: usize, parts: &[(f64, Range<f64>)], random: &mut ChaCha8Rng) -> Vec<f64> {
        let mut series = vec![0.0; length];
        for (amplitude, periods) in parts {
            let period = random.random_range(periods.clone());
            let phase = random.random_range(0.0..TAU);
            for (value, i) in series.iter_mut().zip(0..) {
                *value += amplitude * (TAU * f64::from(i) / period + phase).sin();
            }
        }
        series
    }

    /// Draws a first-order autoregression of unit variance that is correlated over some steps.
    fn autoregression(length: usize, steps: f64, random: &mut ChaCha8Rng) -> Vec<f64> {
        let damping = (-1.0 / steps).exp();
        let mut value: f64 = StandardNormal.sample(random);
        let next = |_| {
            let disturbance: f64 = StandardNormal.sample(random);
            let next = damping * value + (1.0 - damping * damping).sqrt() * disturbance;
            std::mem::replace(&mut value, next)
        };
        (0..length).map(next).collect()
    }

    #[test]
    fn the_mean_of_few_oscillations_is_estimated_better_than_by_the_average() {
        for length in [12, 17, 27, 39] {
            let [ratio, in_se] =
                errors(length, |random| sines(length, &[(1.0, 6.0..20.0)], random));
            assert!(ratio < 0.6 && (0.4..1.0).contains(&in_se), "{length}: {ratio} {in_se}");
        }
    }

    #[test]
    fn the_standard_error_holds_for_other_series_longer_than_their_correlation() {
        for length in [10, 17, 27, 39, 100] {
            let parts = [(1.0, 6.0..20.0), (0.5, 3.0..9.0)];
            let two = errors(length, |random| sines(length, &parts, random));
            let correlated = errors(length, |random| autoregression(length, 3.0, random));
            let white = errors(length, |random| autoregression(length, 0.01, random));
            for (name, [ratio, in_se]) in
                [("two", two), ("correlated", correlated), ("white", white)]
            {
                let holds = ratio < 1.25 && (0.3..1.7).contains(&in_se);
                let holds = holds && (length < 17 || in_se < 1.1);
                assert!(holds, "{name}, {length}: {ratio} {in_se}");
            }
        }
    }

    #[test]
    fn a_series_shorter_than_an_oscillation_has_a_large_standard_error() {
        for length in [5, 6, 8] {
            let [_, in_se] = errors(length, |random| sines(length, &[(1.0, 6.0..20.0)], random));
            assert!((0.5..2.5).contains(&in_se), "{length}: {in_se}");
        }
    }

    #[test]
    fn the_average_of_very_few_values_is_as_uncertain_as_one_of_them() {
        let few = mean_of_oscillation(&[1.0, f64::NAN, 2.0, 3.0], 0.01);
        assert!(few.value == 2.0 && few.se == student(2.0), "{few:?}");
        let one = mean_of_oscillation(&[1.0], 0.01);
        assert!(one.value == 1.0 && one.se.is_nan(), "{one:?}");
        assert!(mean_of_oscillation(&[f64::NAN], 0.01).value.is_nan());
        // The average of nine times 0.1 is not exactly 0.1.
        let equal = mean_of_oscillation(&[0.1; 9], 0.09);
        assert!((equal.value - 0.1).abs() < 1e-15 && (equal.se - 0.1).abs() < 1e-15, "{equal:?}");
    }
}
