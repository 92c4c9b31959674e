//! Statistics: location and scale, quantiles, distributions, least squares and angles.
//!
//! Distributions come from `statrs`. Its sample quantiles offer a single method (R-8) and sort a copy per
//! quantile; the quantiles here are R-7.
//!
//! - Location and scale: [`mean`], [`median`], [`median_absolute_deviation`], [`quantiles`] (R-7). NaN stands
//!   for a missing value: [`seen`] and [`extremes`] skip missing values, the other functions do not.
//! - Distributions: [`student`] and [`fisher`] for intervals, [`c4`] for the bias of
//!   a standard deviation; an [`Estimate`] is a value with its standard error.
//! - Linear least squares by additive [`NormalEquations`], nonlinear by [`least_squares`].
//! - Mean of a short series that oscillates slowly: [`mean_of_oscillation`].
//! - Repeatability and reproducibility: [`precision`].
//! - Variance components of linear mixed models: [`variance_components`].
//! - Angles in radians: [`wrap`] and [`unwrap`].
//!
//! ```
//! use trilink_statistics::{MAD_TO_DEVIATION, median, median_absolute_deviation, quantiles};
//!
//! // d (m) of five cycles, one of them disturbed: robust location, scale and quartiles.
//! let d_m = vec![0.478, 0.481, 0.476, 0.479, 0.512];
//! let deviation_m = MAD_TO_DEVIATION * median_absolute_deviation(&d_m);
//! assert_eq!(median(d_m.clone()), 0.479);
//! assert!((deviation_m - 0.003).abs() < 1e-4);
//! assert_eq!(quantiles(d_m, [0.25, 0.75]), [0.478, 0.481]);
//! ```

pub mod least_squares;
mod oscillating;
pub mod precision;
pub mod variance_components;

pub use oscillating::mean_of_oscillation;

use std::f64::consts::{PI, SQRT_2, TAU};

use nalgebra::{SMatrix, SVector};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};
use statrs::function::erf::erfc;
use statrs::function::gamma::ln_gamma;

/// Ratio of the standard deviation to the median absolute deviation of a normal distribution.
pub const MAD_TO_DEVIATION: f64 = 1.4826;

/// Half-width of a 95 % interval of a normal distribution, in standard deviations.
pub const HALF_WIDTH_95: f64 = 1.96;

/// Number of degrees of freedom above which a distribution is within 1e-6 of its limit for infinitely many
/// degrees of freedom.
const MAX_FREEDOM: f64 = 1e6;

/// Cumulative probabilities at the lower and upper limits of a 95 % interval.
pub const SIDES_95: [f64; 2] = [0.025, 0.975];

/// Returns the arithmetic mean; NaN if there are no values.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (count, sum) = values.into_iter().fold((0.0, -0.0), |(n, sum), x| (n + 1.0, sum + x));
    sum / count
}

/// Iterates over the values of a series that are not missing (NaN).
pub fn seen(series: &[f64]) -> impl Iterator<Item = f64> + Clone {
    series.iter().copied().filter(|x| !x.is_nan())
}

/// Returns the minimum and maximum, skipping missing values (NaN); infinities if there are no values.
pub fn extremes(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let none = [f64::INFINITY, f64::NEG_INFINITY];
    values.into_iter().fold(none, |[low, high], x| [low.min(x), high.max(x)])
}

/// Returns the median (the mean of the middle two for an even number of values); NaN if there are no values.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    match values[..] {
        [] => f64::NAN,
        _ => 0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2]),
    }
}

/// Returns the high median (the larger of the middle two for an even number of values); NaN if there are no
/// values.
pub fn median_high(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Returns the median absolute deviation from the [`median`], without a scale factor.
pub fn median_absolute_deviation(values: &[f64]) -> f64 {
    let middle = median(values.to_vec());
    median(values.iter().map(|x| (x - middle).abs()).collect())
}

/// Returns the quantiles at the given `probabilities`, linearly interpolated (R-7); NaN if there are no
/// values.
pub fn quantiles<const N: usize>(mut values: Vec<f64>, probabilities: [f64; N]) -> [f64; N] {
    values.sort_unstable_by(f64::total_cmp);
    probabilities.map(|probability| {
        let Some(last) = values.len().checked_sub(1) else { return f64::NAN };
        let position = probability * last as f64;
        let [below, above] = [position.floor(), position.ceil()].map(|i| values[i as usize]);
        below + position.fract() * (above - below)
    })
}

/// Returns the quantiles at the given `probabilities`, rounded down to the lower sample value; NaN if there
/// are no values.
pub fn quantiles_low<const N: usize>(mut values: Vec<f64>, probabilities: [f64; N]) -> [f64; N] {
    values.sort_unstable_by(f64::total_cmp);
    probabilities.map(|probability| match values.len() {
        0 => f64::NAN,
        count => values[(probability * (count - 1) as f64) as usize],
    })
}

/// Estimate of a quantity: its value and standard error.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Estimate {
    pub value: f64,
    pub se: f64,
}

impl Estimate {
    /// Missing estimate (NaN for the value and the standard error).
    pub const MISSING: Self = Self { value: f64::NAN, se: f64::NAN };

    /// Creates an estimate from a value and its standard error.
    pub const fn new(value: f64, se: f64) -> Self {
        Self { value, se }
    }
}

/// Normal equations of a linear least-squares problem; the normal equations of subsets of the data can be
/// added.
#[derive(Debug, Clone, Copy)]
pub struct NormalEquations<const N: usize> {
    pub matrix: SMatrix<f64, N, N>,
    pub right: SVector<f64, N>,
    /// Number of equations (data points).
    pub count: f64,
    /// Sum of the squared right-hand sides.
    pub squares: f64,
}

impl<const N: usize> Default for NormalEquations<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> NormalEquations<N> {
    /// Creates the normal equations for an empty set of data.
    pub fn new() -> Self {
        Self { matrix: SMatrix::zeros(), right: SVector::zeros(), count: 0.0, squares: 0.0 }
    }

    /// Adds `count` equations `row . unknowns = value` that share one row, given the sum of their values and
    /// the sum of the squared values.
    pub fn add_sums(&mut self, row: &SVector<f64, N>, count: f64, sum: f64, squares: f64) {
        self.matrix.ger(count, row, row, 1.0);
        self.right.axpy(sum, row, 1.0);
        self.count += count;
        self.squares += squares;
    }

    /// Adds up the normal equations of subsets of the data.
    pub fn sum<'e>(parts: impl Iterator<Item = &'e Self>) -> Self {
        parts.fold(Self::new(), |sum, part| Self {
            matrix: sum.matrix + part.matrix,
            right: sum.right + part.right,
            count: sum.count + part.count,
            squares: sum.squares + part.squares,
        })
    }

    /// Returns the solution and the inverse of the normal matrix, or `None` if the matrix is not positive
    /// definite.
    pub fn solve(&self) -> Option<(SVector<f64, N>, SMatrix<f64, N, N>)> {
        let factor = self.matrix.cholesky()?;
        Some((factor.solve(&self.right), factor.inverse()))
    }

    /// Returns the sum of squared residuals of a solution.
    pub fn residual_squares(&self, solution: &SVector<f64, N>) -> f64 {
        (self.squares - solution.dot(&self.right)).max(0.0)
    }
}

/// Wraps an angle into (-pi, pi].
pub fn wrap(angle_rad: f64) -> f64 {
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad;
    }
    PI - (PI - angle_rad).rem_euclid(TAU)
}

/// Removes jumps of whole turns from a series of angles, even across missing values (NaN).
pub fn unwrap(angles_rad: &mut [f64]) {
    let mut previous = f64::NAN;
    for angle in angles_rad.iter_mut().filter(|angle| !angle.is_nan()) {
        if !previous.is_nan() {
            *angle = previous + wrap(*angle - previous);
        }
        previous = *angle;
    }
}

/// Returns the ratio of the 97.5 % quantile of Student's t distribution to that of the normal distribution.
/// If a standard error has `freedom` degrees of freedom, the half-width of a 95 % interval is 1.96 standard
/// errors times this ratio. Infinite for zero degrees of freedom.
pub fn student(freedom: f64) -> f64 {
    let outside = 2.0 * SIDES_95[0];
    fisher(outside, [1.0, freedom]).sqrt() / HALF_WIDTH_95
}

/// Returns the probability that a standard normal deviate exceeds `deviate`.
pub fn normal_tail(deviate: f64) -> f64 {
    0.5 * erfc(deviate / SQRT_2)
}

/// Returns the quantile of Fisher's F distribution that is exceeded with probability `tail`. F is the ratio
/// of two variance estimates with `[numerator, denominator]` degrees of freedom. Infinite for zero degrees of
/// freedom.
pub fn fisher(tail: f64, [numerator, denominator]: [f64; 2]) -> f64 {
    // Bisects the logarithm of F: the quantile function of statrs is wrong in small tails and does not
    // terminate at a million degrees of freedom.
    let [numerator, denominator] = [numerator, denominator].map(|freedom| freedom.min(MAX_FREEDOM));
    let Ok(distribution) = FisherSnedecor::new(numerator, denominator) else {
        return f64::INFINITY;
    };
    let [mut low, mut high] = [-70.0, 70.0];
    for _ in 0..45 {
        let middle: f64 = 0.5 * (low + high);
        let is_below = distribution.sf(middle.exp()) > tail;
        *(if is_below { &mut low } else { &mut high }) = middle;
    }
    low.exp()
}

/// Returns the ratio of the expected sample standard deviation of normally distributed values to the true
/// standard deviation, for `freedom` degrees of freedom: the constant c4 of control charts (Johnson, Kotz and
/// Balakrishnan, *Continuous Univariate Distributions* 1, 2nd ed., Wiley 1994, section 13.8.2).
pub fn c4(freedom: f64) -> f64 {
    let freedom = freedom.min(MAX_FREEDOM);
    (2.0 / freedom).sqrt() * (ln_gamma(0.5 * (freedom + 1.0)) - ln_gamma(0.5 * freedom)).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    // Known values from Abramowitz and Stegun (tables 26.9 and 26.10) and from control-chart tables.
    #[test]
    fn distributions_agree_with_the_tables() {
        for (freedom, known) in [(1.0, 0.797885), (2.0, 0.886227), (9.0, 0.972659)] {
            let found = c4(freedom);
            assert!((found - known).abs() < 1e-6, "{found} for {known}");
        }
        for (freedom, quantile) in [(1.0, 12.706205), (3.0, 3.182446), (30.0, 2.042272)] {
            let found = student(freedom) * HALF_WIDTH_95;
            assert!((found / quantile - 1.0).abs() < 1e-6, "{found} for {quantile}");
        }
        for (tail, freedom, quantile) in [
            (0.025, [10.0, 20.0], 2.773671),
            (0.025, [40.0, 15.0], 2.585005),
            (0.005, [20.0, 10.0], 5.274016),
        ] {
            let found = fisher(tail, freedom);
            assert!((found / quantile - 1.0).abs() < 1e-6, "{found} for {quantile}");
        }
        // With two numerator degrees of freedom the tail is (1 + 2 x / n)^(-n / 2).
        for (n, x) in [(1.0_f64, 3e7), (5.0, 40.0), (300.0, 12.0)] {
            let tail = (1.0 + 2.0 * x / n).powf(-0.5 * n);
            let found = fisher(tail, [2.0, n]);
            assert!((found / x - 1.0).abs() < 1e-6, "{found} for {x}");
        }
        assert!((normal_tail(HALF_WIDTH_95) - 0.025).abs() < 1e-5);
    }

    #[test]
    fn zero_and_infinite_degrees_of_freedom_are_limits() {
        assert_eq!(student(0.0), f64::INFINITY);
        assert_eq!(fisher(0.01, [10.0, 0.0]), f64::INFINITY);
        assert!((student(f64::INFINITY) - 1.0).abs() < 1e-4);
        assert!((c4(f64::INFINITY) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_median_of_an_even_number_is_the_mean_or_the_larger_of_the_middle_two() {
        assert_eq!(median(vec![4.0, 1.0, 3.0, 2.0]), 2.5);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median_high(vec![4.0, 1.0, 3.0, 2.0]), 3.0);
        assert_eq!(median_high(vec![3.0, 1.0, 2.0]), 2.0);
        assert!(median(Vec::new()).is_nan() && median_high(Vec::new()).is_nan());
    }

    #[test]
    fn the_median_absolute_deviation_is_robust_to_an_outlier() {
        assert_eq!(median_absolute_deviation(&[1.0, 1.0, 2.0, 2.0, 4.0, 6.0, 9.0]), 1.0);
        assert_eq!(median_absolute_deviation(&[1.0, 2.0, 3.0, 4.0, 1e9]), 1.0);
    }

    #[test]
    fn quantiles_agree_with_numpy() {
        // numpy.quantile(..., method="linear") and "lower".
        let values = || vec![7.0, 1.0, 3.0, 2.0];
        assert_eq!(quantiles(values(), [0.0, 0.25, 0.5, 1.0]), [1.0, 1.75, 2.5, 7.0]);
        assert_eq!(quantiles_low(values(), [0.0, 0.25, 0.5, 1.0]), [1.0, 1.0, 2.0, 7.0]);
        assert!(quantiles(Vec::new(), [0.5])[0].is_nan());
        assert!(quantiles_low(Vec::new(), [0.5])[0].is_nan());
    }

    #[test]
    fn extremes_skip_missing_values() {
        assert_eq!(extremes([2.0, f64::NAN, -1.0]), [-1.0, 2.0]);
        assert_eq!(extremes([]), [f64::INFINITY, f64::NEG_INFINITY]);
    }

    #[test]
    fn means_are_sums_over_counts() {
        assert_eq!(mean([1.0, 2.0, 6.0]), 3.0);
        assert!(mean([]).is_nan());
    }

    #[test]
    fn normal_equations_of_subsets_add_up_to_those_of_the_whole() {
        let part = |times: std::ops::Range<i32>| {
            let mut equations = NormalEquations::new();
            for t in times.map(f64::from) {
                let value = 2.0 - 0.5 * t;
                equations.add_sums(&SVector::from([1.0, t]), 1.0, value, value * value);
            }
            equations
        };
        let whole = NormalEquations::sum([part(0..3), part(3..7)].iter());
        let (line, inverse) = whole.solve().unwrap();
        assert!((line - SVector::from([2.0, -0.5])).amax() < 1e-14);
        assert!((inverse * whole.matrix - SMatrix::identity()).amax() < 1e-14);
        assert!(whole.count == 7.0 && whole.residual_squares(&line) < 1e-13);
        assert!(part(0..1).solve().is_none());
    }

    #[test]
    fn angles_wrap_into_the_half_open_turn() {
        assert_eq!(wrap(PI), PI);
        assert_eq!(wrap(-PI), PI);
        assert!((wrap(7.0) - (7.0 - TAU)).abs() < 1e-15);
        assert!((wrap(-0.1) + 0.1).abs() < 1e-15);
    }

    #[test]
    fn unwrapping_follows_turns_across_missing_frames() {
        let turning = |i: usize| 0.4 * i as f64;
        let mut angles: Vec<f64> = (0..40).map(|i| wrap(turning(i))).collect();
        angles[17] = f64::NAN;
        angles[18] = f64::NAN;
        unwrap(&mut angles);
        for (i, angle) in angles.iter().enumerate() {
            assert!(angle.is_nan() == (i == 17 || i == 18));
            assert!(angle.is_nan() || (angle - turning(i)).abs() < 1e-12);
        }
    }
}
