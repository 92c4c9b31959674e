//! What the equations are evaluated in: one number, or several at once in the lanes of a vector.

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
        self.sin_cos()
    }
}
