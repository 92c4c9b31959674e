//! Averages, quantiles, least squares and angles, each by one definition.
//!
//! They are written out because the crates differ from them: `statrs` has the quantiles of one
//! other method (R-8) only, and copies and sorts for each.
//!
//! - Location and scale: [`mean`], [`median`], [`median_absolute_deviation`], [`quantiles`] (R-7).
//!   NaN is a missing value: [`seen`] and [`extremes`] leave it out, the others do not.
//! - Distributions: [`student`] and [`fisher`] for intervals, [`mean_deviation`] (c4) for the bias of
//!   a standard deviation; an [`Estimate`] is a value with its standard error.
//! - Linear least squares by [`NormalEquations`] that add up, nonlinear by [`least_squares`].
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

use std::f64::consts::{PI, TAU};

use nalgebra::{SMatrix, SVector};

/// Median absolute deviation of normal deviates of unit deviation, the other way round.
pub const MAD_TO_DEVIATION: f64 = 1.4826;

/// Half the width of a 95 % interval of normal deviates, in their standard deviations.
pub const HALF_WIDTH_95: f64 = 1.96;

/// The quantiles between which 95 % are.
pub const SIDES_95: [f64; 2] = [0.025, 0.975];

/// Arithmetic mean; NaN of nothing.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (count, sum) = values.into_iter().fold((0.0, -0.0), |(n, sum), x| (n + 1.0, sum + x));
    sum / count
}

/// The values of a series that are not missing (NaN).
pub fn seen(series: &[f64]) -> impl Iterator<Item = f64> + Clone {
    series.iter().copied().filter(|x| !x.is_nan())
}

/// Smallest and largest value; what is missing (NaN) does not count.
pub fn extremes(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let none = [f64::INFINITY, f64::NEG_INFINITY];
    values.into_iter().fold(none, |[low, high], x| [low.min(x), high.max(x)])
}

/// Median; of an even number the mean of the two in the middle, NaN of nothing.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    match values[..] {
        [] => f64::NAN,
        _ => 0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2]),
    }
}

/// Median; of an even number the higher one of the two in the middle, NaN of nothing.
pub fn median_high(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Median of the distances from the median ([`median`]).
pub fn median_absolute_deviation(values: &[f64]) -> f64 {
    let middle = median(values.to_vec());
    median(values.iter().map(|x| (x - middle).abs()).collect())
}

/// Quantiles, in proportion between two of the sorted values (R-7); NaN of nothing.
pub fn quantiles<const N: usize>(mut values: Vec<f64>, parts: [f64; N]) -> [f64; N] {
    values.sort_unstable_by(f64::total_cmp);
    parts.map(|part| {
        let Some(last) = values.len().checked_sub(1) else { return f64::NAN };
        let position = part * last as f64;
        let [below, above] = [position.floor(), position.ceil()].map(|i| values[i as usize]);
        below + position.fract() * (above - below)
    })
}

/// Quantiles, the lower one of the two sorted values; NaN of nothing.
pub fn quantiles_low<const N: usize>(mut values: Vec<f64>, parts: [f64; N]) -> [f64; N] {
    values.sort_unstable_by(f64::total_cmp);
    parts.map(|part| match values.len() {
        0 => f64::NAN,
        count => values[(part * (count - 1) as f64) as usize],
    })
}

/// An estimate with its standard error.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Estimate {
    pub value: f64,
    pub se: f64,
}

impl Estimate {
    /// Nothing is known.
    pub const MISSING: Self = Self { value: f64::NAN, se: f64::NAN };

    /// A value with its standard error.
    pub const fn new(value: f64, se: f64) -> Self {
        Self { value, se }
    }
}

/// Sums of a linear least-squares problem: enough to solve it, and to add those of other parts.
#[derive(Debug, Clone, Copy)]
pub struct NormalEquations<const N: usize> {
    pub matrix: SMatrix<f64, N, N>,
    pub right: SVector<f64, N>,
    /// Equations, and the sum of their squared right-hand sides.
    pub count: f64,
    pub squares: f64,
}

impl<const N: usize> Default for NormalEquations<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> NormalEquations<N> {
    pub fn new() -> Self {
        Self { matrix: SMatrix::zeros(), right: SVector::zeros(), count: 0.0, squares: 0.0 }
    }

    /// Adds `count` equations `row . unknowns = value` of one row, given the sums of their values and their
    /// squares.
    pub fn add_sums(&mut self, row: &SVector<f64, N>, count: f64, sum: f64, squares: f64) {
        self.matrix.ger(count, row, row, 1.0);
        self.right.axpy(sum, row, 1.0);
        self.count += count;
        self.squares += squares;
    }

    pub fn sum<'e>(parts: impl Iterator<Item = &'e Self>) -> Self {
        parts.fold(Self::new(), |sum, part| Self {
            matrix: sum.matrix + part.matrix,
            right: sum.right + part.right,
            count: sum.count + part.count,
            squares: sum.squares + part.squares,
        })
    }

    /// The unknowns and the inverse of their matrix, `None` if it is not positive definite.
    pub fn solve(&self) -> Option<(SVector<f64, N>, SMatrix<f64, N, N>)> {
        let factor = self.matrix.cholesky()?;
        Some((factor.solve(&self.right), factor.inverse()))
    }

    /// Sum of squared residuals of a solution.
    pub fn residual_squares(&self, solution: &SVector<f64, N>) -> f64 {
        (self.squares - solution.dot(&self.right)).max(0.0)
    }
}

/// An angle in (-pi, pi].
pub fn wrap(angle_rad: f64) -> f64 {
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad;
    }
    PI - (PI - angle_rad).rem_euclid(TAU)
}

/// Removes jumps of whole turns, also across what is missing (NaN).
pub fn unwrap(angles_rad: &mut [f64]) {
    let mut previous = f64::NAN;
    for angle in angles_rad.iter_mut().filter(|angle| !angle.is_nan()) {
        if !previous.is_nan() {
            *angle = previous + wrap(*angle - previous);
        }
        previous = *angle;
    }
}

/// How much wider than of a normal distribution the middle 95 % of Student's are: a standard error
/// from a few cycles is itself uncertain (Abramowitz and Stegun, 26.7.5).
pub fn student(freedom: f64) -> f64 {
    let x = 1.0 / freedom;
    1.0 + x * (1.2104 + x * (1.4400 + x * 1.3040))
}

/// Quantile of the ratio of two variances of normal deviates, of so many degrees of freedom each: that
/// of Fisher's F at as many standard deviations as `normal` says (Paulson 1942; Abramowitz and Stegun,
/// 26.6.15). Of few degrees below it is infinite.
pub fn fisher(normal: f64, [above, below]: [f64; 2]) -> f64 {
    let [a, b] = [above, below].map(|freedom| 2.0 / (9.0 * freedom));
    let scale = (1.0 - b).powi(2) - normal * normal * b;
    let spread = (1.0 - a).powi(2) * b + a * scale;
    match scale > 0.0 {
        true => (((1.0 - a) * (1.0 - b) + normal * spread.sqrt()) / scale).powi(3),
        false => f64::INFINITY,
    }
}

/// How much smaller than the standard deviation that of a sample is on average, of normally
/// distributed values: c4 of control charts, for so many degrees of freedom (Johnson, Kotz and
/// Balakrishnan, *Continuous Univariate Distributions* 1, 2nd ed., Wiley 1994, section 13.8.2).
pub fn mean_deviation(freedom: f64) -> f64 {
    let x = 1.0 / freedom;
    1.0 - x * (0.25 - x * (0.03125 + x * (0.0390625 - x * 0.01025390625)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_s_deviation_is_too_small_on_average() {
        for (freedom, c4) in [(2.0, 0.886227), (4.0, 0.939986), (9.0, 0.972659)] {
            let found = mean_deviation(freedom);
            assert!((found - c4).abs() < 2e-3, "{found} for {c4}");
        }
    }

    #[test]
    fn student_s_quantiles_over_the_normal_one() {
        for (freedom, quantile) in [(3.0, 3.182446), (8.0, 2.306004), (30.0, 2.042272)] {
            assert!((student(freedom) * 1.959964 / quantile - 1.0).abs() < 0.01);
        }
    }

    #[test]
    fn quantiles_of_the_ratio_of_variances() {
        // scipy.stats.f.ppf at 0.975 and 0.995.
        for (normal, freedom, quantile) in [
            (1.959964, [10.0, 20.0], 2.773671),
            (1.959964, [40.0, 15.0], 2.585239),
            (2.575829, [20.0, 10.0], 5.274016),
        ] {
            let found = fisher(normal, freedom);
            assert!((found / quantile - 1.0).abs() < 0.03, "{found} {quantile}");
        }
        assert_eq!(fisher(3.0, [10.0, 1.0]), f64::INFINITY);
    }

    #[test]
    fn medians_of_an_even_number_are_between_the_middle_two_or_the_higher_one() {
        assert_eq!(median(vec![4.0, 1.0, 3.0, 2.0]), 2.5);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median_high(vec![4.0, 1.0, 3.0, 2.0]), 3.0);
        assert_eq!(median_high(vec![3.0, 1.0, 2.0]), 2.0);
        assert!(median(Vec::new()).is_nan() && median_high(Vec::new()).is_nan());
    }

    #[test]
    fn the_median_absolute_deviation_bears_an_outlier() {
        assert_eq!(median_absolute_deviation(&[1.0, 1.0, 2.0, 2.0, 4.0, 6.0, 9.0]), 1.0);
        assert_eq!(median_absolute_deviation(&[1.0, 2.0, 3.0, 4.0, 1e9]), 1.0);
    }

    #[test]
    fn quantiles_are_those_of_numpy() {
        // numpy.quantile(..., method="linear") and "lower".
        let values = || vec![7.0, 1.0, 3.0, 2.0];
        assert_eq!(quantiles(values(), [0.0, 0.25, 0.5, 1.0]), [1.0, 1.75, 2.5, 7.0]);
        assert_eq!(quantiles_low(values(), [0.0, 0.25, 0.5, 1.0]), [1.0, 1.0, 2.0, 7.0]);
        assert!(quantiles(Vec::new(), [0.5])[0].is_nan());
        assert!(quantiles_low(Vec::new(), [0.5])[0].is_nan());
    }

    #[test]
    fn extremes_pass_over_what_is_missing() {
        assert_eq!(extremes([2.0, f64::NAN, -1.0]), [-1.0, 2.0]);
        assert_eq!(extremes([]), [f64::INFINITY, f64::NEG_INFINITY]);
    }

    #[test]
    fn means_are_sums_over_counts() {
        assert_eq!(mean([1.0, 2.0, 6.0]), 3.0);
        assert!(mean([]).is_nan());
    }

    #[test]
    fn a_line_is_the_solution_of_its_equations_in_any_parts() {
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
