//! Scalar type in the equations: a single number, or several in the lanes of a SIMD vector.

use std::f64::consts::FRAC_2_PI;
use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// SIMD vector of [`LANES`] numbers.
pub type Lanes = wide::f64x2;

/// Number of lanes of [`Lanes`].
pub const LANES: usize = 2;

/// Scalar, or vector of one scalar per lane.
pub trait Number:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
{
    /// Number of lanes; 1 for a scalar.
    const COUNT: usize;

    /// Returns a number that has the given value in every lane.
    fn splat(value: f64) -> Self;

    /// Returns the value in the lane with the given index.
    fn lane(&self, lane: usize) -> f64;

    fn sin_cos(self) -> (Self, Self);

    fn tanh(self) -> Self;

    fn exp(self) -> Self;

    fn ln(self) -> Self;

    /// Returns the sines and cosines of two angles, evaluated together.
    fn both_sin_cos(angles_rad: [Self; 2]) -> [(Self, Self); 2];
}

impl Number for f64 {
    const COUNT: usize = 1;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn lane(&self, _: usize) -> f64 {
        *self
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        f64::sin_cos(self)
    }

    #[inline(always)]
    fn tanh(self) -> Self {
        Self::tanh(self)
    }

    #[inline(always)]
    fn exp(self) -> Self {
        Self::exp(self)
    }

    #[inline(always)]
    fn ln(self) -> Self {
        Self::ln(self)
    }

    #[inline(always)]
    fn both_sin_cos(angles_rad: [Self; 2]) -> [(Self, Self); 2] {
        let (sin, cos) = Number::sin_cos(Lanes::new(angles_rad));
        let [sin1, sin2] = sin.to_array();
        let [cos1, cos2] = cos.to_array();
        [(sin1, cos1), (sin2, cos2)]
    }
}

impl Number for Lanes {
    const COUNT: usize = LANES;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self::splat(value)
    }

    #[inline(always)]
    fn lane(&self, lane: usize) -> f64 {
        self.as_array()[lane]
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let quarters = nearest(self * Self::splat(FRAC_2_PI));
        // Reduces the angle by whole quarter turns, which are subtracted in three parts (Cody and Waite).
        let [large, small, smallest] = QUARTER_TURN;
        let rest = self - quarters * Self::splat(large);
        let rest = rest - quarters * Self::splat(small) - quarters * Self::splat(smallest);
        let square = rest * rest;
        let sin = rest + rest * square * polynomial(SIN, square);
        let cos = (Self::splat(1.0) - square * Self::splat(0.5))
            + square * square * polynomial(COS, square);
        // Sine and cosine (0 or +-1) of the whole quarter turns.
        let left = quarters - nearest(quarters * Self::splat(0.25)) * Self::splat(4.0);
        let size = left.abs();
        let sin_left = left * (Self::splat(2.0) - size);
        let cos_left = Self::splat(1.0) - size;
        (sin * cos_left + cos * sin_left, cos * cos_left - sin * sin_left)
    }

    #[inline(always)]
    fn tanh(self) -> Self {
        Self::tanh(self)
    }

    #[inline(always)]
    fn exp(self) -> Self {
        Self::exp(self)
    }

    #[inline(always)]
    fn ln(self) -> Self {
        Self::ln(self)
    }

    #[inline(always)]
    fn both_sin_cos(angles_rad: [Self; 2]) -> [(Self, Self); 2] {
        [Number::sin_cos(angles_rad[0]), Number::sin_cos(angles_rad[1])]
    }
}

/// Quarter turn split into three parts, the first two with so few digits that their products with integers
/// of up to seven digits are exact.
const QUARTER_TURN: [f64; 3] =
    [1.570_796_310_901_641_8, 1.589_325_471_229_585_7e-8, 6.123_233_995_736_766e-17];

/// Coefficients of polynomials for sine and cosine up to an eighth of a turn, beyond the leading terms, in
/// descending powers of the squared angle.
///
/// Reference: S. L. Moshier, *Methods and Programs for Mathematical Functions*, Ellis Horwood 1989.
const SIN: [f64; 6] = [
    1.589_623_015_765_465_6e-10,
    -2.505_074_776_285_780_7e-8,
    2.755_731_362_138_572_2e-6,
    -1.984_126_982_958_954e-4,
    8.333_333_333_322_118e-3,
    -1.666_666_666_666_663e-1,
];
const COS: [f64; 6] = [
    -1.135_853_652_138_768_2e-11,
    2.087_570_084_197_473e-9,
    -2.755_731_417_929_674e-7,
    2.480_158_728_885_170_4e-5,
    -1.388_888_888_887_305_6e-3,
    4.166_666_666_666_659_5e-2,
];

/// Evaluates a polynomial of degree 5 with a short dependency chain (Estrin's scheme).
#[inline(always)]
fn polynomial([c5, c4, c3, c2, c1, c0]: [f64; 6], x: Lanes) -> Lanes {
    let square = x * x;
    let low = Lanes::splat(c1) * x + Lanes::splat(c0);
    let middle = Lanes::splat(c3) * x + Lanes::splat(c2);
    let high = Lanes::splat(c5) * x + Lanes::splat(c4);
    (high * square + middle) * square + low
}

/// Rounds to the nearest integers, for magnitudes below 2^51.
#[inline(always)]
fn nearest(value: Lanes) -> Lanes {
    let large = Lanes::splat(1.5 / f64::EPSILON);
    (value + large) - large
}

#[cfg(test)]
mod tests {
    use super::{LANES, Lanes, Number};

    #[test]
    fn functions_agree_with_the_standard_library() {
        for i in -40_000..40_000 {
            let angles_rad = [f64::from(i) * 1.3e-3, f64::from(i) * 0.37];
            let (sin, cos) = Number::sin_cos(Lanes::new(angles_rad));
            for lane in 0..LANES {
                let known = angles_rad[lane].sin_cos();
                let error = (sin.lane(lane) - known.0).abs().max((cos.lane(lane) - known.1).abs());
                assert!(error <= f64::EPSILON, "{}: {error:e}", angles_rad[lane]);
            }
        }
        for i in (-4000..4000).filter(|i| *i != 0) {
            let value = f64::from(i) * 7.3e-3;
            let tanh = Number::tanh(Lanes::splat(value)).lane(0);
            let exp = Number::exp(Lanes::splat(value)).lane(1);
            for (name, found, known) in [("tanh", tanh, value.tanh()), ("exp", exp, value.exp())] {
                assert!((found / known - 1.0).abs() <= 4.0 * f64::EPSILON, "{name} {value}");
            }
        }
        for angle_rad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let (sin, cos) = Number::sin_cos(Lanes::splat(angle_rad));
            assert!(sin.lane(0).is_nan() && cos.lane(1).is_nan(), "{angle_rad}");
        }
    }
}
