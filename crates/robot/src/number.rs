//! What the equations are evaluated in: one number, or several at once in the lanes of a vector.

use std::f64::consts::FRAC_2_PI;
use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// As many numbers as the processor works on at once.
pub type Lanes = wide::f64x2;

/// How many they are.
pub const LANES: usize = 2;

/// A number, or one in each of several lanes.
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
    /// Number of lanes.
    const COUNT: usize;

    /// The same in every lane.
    fn of(value: f64) -> Self;

    /// What is in a lane.
    fn lane(&self, lane: usize) -> f64;

    fn sin_cos(self) -> (Self, Self);

    fn tanh(self) -> Self;

    fn exp(self) -> Self;

    fn ln(self) -> Self;

    /// Of two angles at once.
    fn both_sin_cos(angles_rad: [Self; 2]) -> [(Self, Self); 2];
}

impl Number for f64 {
    const COUNT: usize = 1;

    #[inline(always)]
    fn of(value: f64) -> Self {
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
        let ([sin1, sin2], [cos1, cos2]) = (sin.to_array(), cos.to_array());
        [(sin1, cos1), (sin2, cos2)]
    }
}

impl Number for Lanes {
    const COUNT: usize = LANES;

    #[inline(always)]
    fn of(value: f64) -> Self {
        Self::splat(value)
    }

    #[inline(always)]
    fn lane(&self, lane: usize) -> f64 {
        self.as_array()[lane]
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let quarters = nearest(self * Self::splat(FRAC_2_PI));
        // The angle less whole quarter turns, which are taken off in three parts.
        let [large, small, smallest] = QUARTER_TURN;
        let rest = self - quarters * Self::splat(large);
        let rest = rest - quarters * Self::splat(small) - quarters * Self::splat(smallest);
        let square = rest * rest;
        let sin = rest + rest * square * polynomial(SIN, square);
        let cos = (Self::splat(1.0) - square * Self::splat(0.5))
            + square * square * polynomial(COS, square);
        // Sine and cosine, 0 or +-1, of the whole quarter turns.
        let left = quarters - nearest(quarters * Self::splat(0.25)) * Self::splat(4.0);
        let size = left.abs();
        let (sin_left, cos_left) = (left * (Self::splat(2.0) - size), Self::splat(1.0) - size);
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

/// Parts of a quarter turn, the first two of so few digits that their products with whole numbers
/// of up to seven digits are exact.
const QUARTER_TURN: [f64; 3] =
    [1.570_796_310_901_641_8, 1.589_325_471_229_585_7e-8, 6.123_233_995_736_766e-17];

/// Coefficients of the series of sine and cosine within an eighth of a turn, after their first
/// terms, in powers of the square, the highest first.
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

/// Value of a polynomial of degree 5 in few steps that wait for each other.
#[inline(always)]
fn polynomial([c5, c4, c3, c2, c1, c0]: [f64; 6], x: Lanes) -> Lanes {
    let (square, of) = (x * x, Lanes::splat);
    let (low, middle, high) = (of(c1) * x + of(c0), of(c3) * x + of(c2), of(c5) * x + of(c4));
    (high * square + middle) * square + low
}

/// The nearest whole numbers, while they are smaller than 2^51.
#[inline(always)]
fn nearest(value: Lanes) -> Lanes {
    let large = Lanes::splat(1.5 / f64::EPSILON);
    (value + large) - large
}

#[cfg(test)]
mod tests {
    use super::{LANES, Lanes, Number};

    #[test]
    fn functions_are_those_of_the_standard_library() {
        for i in -40_000..40_000 {
            let angles_rad = [f64::from(i) * 1.3e-3, f64::from(i) * 0.37];
            let (sin, cos) = Number::sin_cos(Lanes::new(angles_rad));
            for lane in 0..LANES {
                let known = angles_rad[lane].sin_cos();
                let missed = (sin.lane(lane) - known.0).abs().max((cos.lane(lane) - known.1).abs());
                assert!(missed <= f64::EPSILON, "{}: {missed:e}", angles_rad[lane]);
            }
        }
        for i in (-4000..4000).filter(|i| *i != 0) {
            let value = f64::from(i) * 7.3e-3;
            let missed = |found: f64, known: f64| (found / known - 1.0).abs();
            let (tanh, exp) = (Number::tanh(Lanes::splat(value)), Number::exp(Lanes::splat(value)));
            assert!(missed(tanh.lane(0), value.tanh()) <= 4.0 * f64::EPSILON, "tanh {value}");
            assert!(missed(exp.lane(1), value.exp()) <= 4.0 * f64::EPSILON, "exp {value}");
        }
        for angle_rad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let (sin, cos) = Number::sin_cos(Lanes::splat(angle_rad));
            assert!(sin.lane(0).is_nan() && cos.lane(1).is_nan(), "{angle_rad}");
        }
    }
}
