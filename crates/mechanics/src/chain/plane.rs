//! Vectors, directions and moving points in the plane.

use trilink_robot::Number;

/// Vector in the plane.
pub(super) type Vector<T> = [T; 2];

#[inline(always)]
pub(super) fn sum<T: Number>(a: Vector<T>, b: Vector<T>) -> Vector<T> {
    [a[0] + b[0], a[1] + b[1]]
}

#[inline(always)]
pub(super) fn scaled<T: Number>(factor: T, a: Vector<T>) -> Vector<T> {
    [factor * a[0], factor * a[1]]
}

/// Returns the vector turned counterclockwise by a right angle.
#[inline(always)]
pub(super) fn normal<T: Number>(a: Vector<T>) -> Vector<T> {
    [-a[1], a[0]]
}

#[inline(always)]
pub(super) fn inner<T: Number>(a: Vector<T>, b: Vector<T>) -> T {
    a[0] * b[0] + a[1] * b[1]
}

/// Returns the moment of the vector `b` with the lever arm `a`.
#[inline(always)]
pub(super) fn moment<T: Number>(a: Vector<T>, b: Vector<T>) -> T {
    a[0] * b[1] - a[1] * b[0]
}

/// Returns the vector rotated by the angle whose cosine and sine are given.
#[inline(always)]
pub(super) fn rotated<T: Number>([cos, sin]: Vector<T>, [x, y]: Vector<T>) -> Vector<T> {
    [cos * x - sin * y, sin * x + cos * y]
}

/// Point, or sum of points times masses, that moves in a frame: its position, velocity and acceleration there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moving<T> {
    pub at: Vector<T>,
    pub rate: Vector<T>,
    pub acceleration: Vector<T>,
}

impl<T: Number> Moving<T> {
    #[inline(always)]
    pub(super) fn zero() -> Self {
        let zero = [T::splat(0.0); 2];
        Self { at: zero, rate: zero, acceleration: zero }
    }

    /// Adds another point times a factor.
    #[inline(always)]
    pub(super) fn add(&mut self, factor: f64, other: &Self) {
        let factor = T::splat(factor);
        self.at = sum(self.at, scaled(factor, other.at));
        self.rate = sum(self.rate, scaled(factor, other.rate));
        self.acceleration = sum(self.acceleration, scaled(factor, other.acceleration));
    }

    /// Returns the point at a distance, in metres, along a link, given [`Heading::unit`].
    #[inline(always)]
    pub(super) fn ahead(mut self, length_m: f64, unit: &Self) -> Self {
        self.add(length_m, unit);
        self
    }

    /// Returns the vectors rotated by the angle whose cosine and sine are given.
    #[inline(always)]
    pub(super) fn rotated(&self, turn: Vector<T>) -> Self {
        Self {
            at: rotated(turn, self.at),
            rate: rotated(turn, self.rate),
            acceleration: rotated(turn, self.acceleration),
        }
    }

    /// Returns the acceleration, relative to the frame's origin, of the point in a frame that turns at `rate` with the
    /// angular acceleration `acceleration`.
    #[inline(always)]
    pub(super) fn carried(&self, rate: T, acceleration: T) -> Vector<T> {
        let turning = sum(scaled(acceleration, self.at), scaled(rate + rate, self.rate));
        let [x, y] = normal(turning);
        let [inward_x, inward_y] = scaled(rate * rate, self.at);
        sum([x - inward_x, y - inward_y], self.acceleration)
    }

    /// Returns the derivative of [`Moving::carried`] with respect to the turning rate.
    #[inline(always)]
    pub(super) fn dcarried_drate(&self, rate: T) -> Vector<T> {
        let two = T::splat(2.0);
        sum(scaled(-(two * rate), self.at), normal(scaled(two, self.rate)))
    }
}

/// Heading of a link relative to a frame, with its rate (rad/s) and acceleration (rad/s^2).
#[derive(Debug, Clone, Copy)]
pub(super) struct Heading<T> {
    /// Cosine and sine of the heading.
    pub turn: Vector<T>,
    pub rate: T,
    pub acceleration: T,
}

impl<T: Number> Heading<T> {
    /// Returns the heading of the frame itself.
    #[inline(always)]
    pub(super) fn straight() -> Self {
        let [zero, one] = [0.0, 1.0].map(T::splat);
        Self { turn: [one, zero], rate: zero, acceleration: zero }
    }

    /// Returns the motion of the point one metre along the heading from a point, relative to that point.
    #[inline(always)]
    pub(super) fn unit(&self) -> Moving<T> {
        let across = normal(self.turn);
        let inward = scaled(-(self.rate * self.rate), self.turn);
        Moving {
            at: self.turn,
            rate: scaled(self.rate, across),
            acceleration: sum(scaled(self.acceleration, across), inward),
        }
    }
}
