//! Forward kinematics (eq. 1): poses of the links, and roll and skid velocities of their wheels.
//!
//! With `c_i = cos phi_i` and `s_i = sin phi_i`, in the frame of link 0 the links point along `t0 = (1, 0)`,
//! `t1 = (c1, -s1)`, `t2 = (c2, s2)`, and the axles of the wheels point along `n0 = (0, 1)`, `n1 = (s1,
//! c1)`, `n2 = (-s2, c2)`. Rotating these rows by `theta` gives `W`.

use std::ops::Mul;

use super::{Number, Robot};

/// Velocities in the frame of link 0: `(u, v, theta', phi1', phi2')` with `u` along the link (m/s), `v`
/// across it to the left (m/s), and angular rates in rad/s.
///
/// `u = x' cos(theta) + y' sin(theta)`, `v = -x' sin(theta) + y' cos(theta)`.
pub type Velocity<T = f64> = [T; 5];

/// Pose of a link in the plane: the position of its origin (the wheel's axle) and its heading.
///
/// The heading is unwrapped: it counts whole turns, unlike the rotation of nalgebra's `Isometry2`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose {
    pub x_m: f64,
    pub y_m: f64,
    pub theta_rad: f64,
}

impl Pose {
    /// Returns the pose translated along its own heading.
    #[inline]
    pub fn ahead(self, length_m: f64) -> Self {
        let (sin, cos) = self.theta_rad.sin_cos();
        Self { x_m: self.x_m + length_m * cos, y_m: self.y_m + length_m * sin, ..self }
    }

    /// Returns the pose rotated counterclockwise about its own origin.
    #[inline]
    pub fn turned(self, angle_rad: f64) -> Self {
        Self { theta_rad: self.theta_rad + angle_rad, ..self }
    }

    /// Returns the mirror image of the pose in the x axis.
    #[inline]
    pub fn mirrored(self) -> Self {
        Self { x_m: self.x_m, y_m: -self.y_m, theta_rad: -self.theta_rad }
    }
}

/// Composes two poses: the right-hand pose is given in the frame of the left-hand one.
impl Mul for Pose {
    type Output = Self;

    // Positions rotate and headings add.
    #[allow(clippy::suspicious_arithmetic_impl)]
    #[inline]
    fn mul(self, local: Self) -> Self {
        let origin = [self.x_m, self.y_m];
        let [x_m, y_m] = in_world(origin, self.theta_rad, [local.x_m, local.y_m]);
        Self { x_m, y_m, theta_rad: self.theta_rad + local.theta_rad }
    }
}

/// Rotates a vector counterclockwise.
#[inline(always)]
pub fn rotated(angle_rad: f64, [x, y]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = angle_rad.sin_cos();
    [cos * x - sin * y, sin * x + cos * y]
}

/// Transforms a point from the frame with the given origin and heading to world coordinates; all lengths must
/// be in the same unit.
#[inline(always)]
pub fn in_world(origin: [f64; 2], theta_rad: f64, [x, y]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = theta_rad.sin_cos();
    [origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y]
}

impl Robot {
    /// Returns the poses of links 0, 1, 2 given the pose of link 0: `r1 = r0 + h1 t0 + l1 t1` along `theta -
    /// phi1`, `r2 = r0 - h2 t0 - l2 t2` along `theta + phi2`.
    #[inline]
    pub fn link_poses(&self, middle: Pose, [phi1, phi2]: [f64; 2]) -> [Pose; 3] {
        let [front, rear] = self.joints(middle);
        [middle, front.turned(-phi1).ahead(self.l_m[0]), rear.turned(phi2).ahead(-self.l_m[1])]
    }

    /// Returns the poses of joints 1 and 2, both with the heading of link 0, given the pose of link 0.
    #[inline]
    pub fn joints(&self, middle: Pose) -> [Pose; 2] {
        [middle.ahead(self.h_m[0]), middle.ahead(-self.h_m[1])]
    }
}

/// Sines and cosines of the joint angles.
#[derive(Debug, Clone, Copy)]
pub struct Trig<T = f64> {
    pub s: [T; 2],
    pub c: [T; 2],
}

impl<T: Number> Trig<T> {
    #[inline(always)]
    pub fn new(phi_rad: [T; 2]) -> Self {
        let [(s1, c1), (s2, c2)] = T::both_sin_cos(phi_rad);
        Self { s: [s1, s2], c: [c1, c2] }
    }
}

/// Returns, for each wheel, the row whose dot product with [`Velocity`] is the skid velocity `v_perp` (eq. 1
/// of the paper), m/s.
#[inline(always)]
pub fn skid_rows<T: Number>(robot: &Robot, trig: &Trig<T>) -> [[T; 5]; 3] {
    let [[h1, h2], [l1, l2]] = [robot.h_m, robot.l_m].map(|lengths| lengths.map(T::splat));
    let zero = T::splat(0.0);
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    let middle = [zero, T::splat(1.0), zero, zero, zero];
    [middle, [s1, c1, l1 + h1 * c1, -l1, zero], [-s2, c2, -l2 - h2 * c2, zero, -l2]]
}

/// Returns the derivatives of the rows of wheels 1 and 2 (see [`skid_rows`]), each with respect to the angle
/// of the wheel's own joint.
#[inline(always)]
pub fn dskid_rows_dphi<T: Number>(robot: &Robot, trig: &Trig<T>) -> [[T; 5]; 2] {
    let [h1, h2] = robot.h_m.map(T::splat);
    let zero = T::splat(0.0);
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    [[c1, -s1, -h1 * s1, zero, zero], [-c2, -s2, h2 * s2, zero, zero]]
}

/// Returns, for each wheel, the row whose dot product with [`Velocity`] is the roll velocity `v_par`, m/s.
#[inline(always)]
pub fn roll_rows<T: Number>(robot: &Robot, trig: &Trig<T>) -> [[T; 5]; 3] {
    let [h1, h2] = robot.h_m.map(T::splat);
    let zero = T::splat(0.0);
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    let middle = [T::splat(1.0), zero, zero, zero, zero];
    [middle, [c1, -s1, -h1 * s1, zero, zero], [c2, s2, -h2 * s2, zero, zero]]
}

/// Returns the derivatives of the rows of wheels 1 and 2 (see [`roll_rows`]), each with respect to the angle
/// of the wheel's own joint.
#[inline(always)]
pub fn droll_rows_dphi<T: Number>(robot: &Robot, trig: &Trig<T>) -> [[T; 5]; 2] {
    let [h1, h2] = robot.h_m.map(T::splat);
    let zero = T::splat(0.0);
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    [[-s1, -c1, -h1 * c1, zero, zero], [-s2, c2, -h2 * c2, zero, zero]]
}

/// Returns the dot product of a row (see [`skid_rows`], [`roll_rows`]) and a velocity.
#[inline(always)]
pub fn dot<T: Number>(row: &[T; 5], velocity: &Velocity<T>) -> T {
    row.iter().zip(velocity).fold(T::splat(0.0), |sum, (a, b)| sum + *a * *b)
}

/// Returns the determinant `det W_b` of the constraint matrix of the body velocities (eq. 4 of the paper), m.
///
/// The sign is opposite to that printed in eq. 4, as follows from evaluating eq. 1 of the paper; only the
/// zeros matter. Similarly, the matrix `A` in eq. 10 of the paper has, for the kinematic robot, the
/// determinant `+det(W_b)^2` instead of the printed `-det(W_b)^2`.
#[inline]
pub fn det_wb(robot: &Robot, trig: &Trig) -> f64 {
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    let [h1, h2] = robot.h_m;
    let [l1, l2] = robot.l_m;
    s1 * (l2 + h2 * c2) - s2 * (l1 + h1 * c1)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    fn is_near(a: Pose, b: Pose) -> bool {
        let theta_rad = a.theta_rad - b.theta_rad;
        (a.x_m - b.x_m).abs().max((a.y_m - b.y_m).abs()).max(theta_rad.abs()) < 1e-14
    }

    #[test]
    fn poses_are_composed_in_the_first_ones_frame() {
        let from = Pose { x_m: 1.0, y_m: 2.0, theta_rad: FRAC_PI_2 };
        let local = Pose { x_m: 0.3, y_m: -0.1, theta_rad: 7.0 };
        let known = Pose { x_m: 1.1, y_m: 2.3, theta_rad: 7.0 + FRAC_PI_2 };
        assert!(is_near(from * local, known));
        assert!(is_near(from * Pose::default().ahead(0.3), from.ahead(0.3)));
        assert!(is_near((from * local).mirrored(), from.mirrored() * local.mirrored()));
        let [x_m, y_m] = rotated(-FRAC_PI_2, [0.3, -0.1]);
        assert!(is_near(
            Pose { x_m, y_m, theta_rad: 0.0 },
            Pose { x_m: -0.1, y_m: -0.3, theta_rad: 0.0 }
        ));
    }

    #[test]
    fn the_links_of_a_bent_robot_are_where_eq_1_has_them() {
        let robot = Robot { h_m: [2.0, 3.0], l_m: [1.0, 0.5], ..Robot::kinematic() };
        // Both joints are at a right angle: the front link points to the right, the rear one to the left.
        let [middle, front, rear] = robot.link_poses(Pose::default(), [FRAC_PI_2; 2]);
        assert_eq!(middle, Pose::default());
        assert!(is_near(front, Pose { x_m: 2.0, y_m: -1.0, theta_rad: -FRAC_PI_2 }));
        assert!(is_near(rear, Pose { x_m: -3.0, y_m: -0.5, theta_rad: FRAC_PI_2 }));
    }

    #[test]
    fn the_wheels_roll_and_skid_as_their_links_move() {
        const STEP: f64 = 1e-6;
        let phi = [0.4, -0.7];
        let velocity = [0.3, -0.2, 0.9, 1.3, -0.6];
        let robot = Robot { h_m: [0.1, 0.2], l_m: [0.15, 0.07], ..Robot::kinematic() };
        let [u, v, turning, w1, w2] = velocity;
        let at = |t: f64| {
            let middle = Pose { x_m: t * u, y_m: t * v, theta_rad: t * turning };
            robot.link_poses(middle, [phi[0] + t * w1, phi[1] + t * w2])
        };
        let before = at(-STEP);
        let now = at(0.0);
        let after = at(STEP);
        let trig = Trig::new(phi);
        for i in 0..3 {
            let moved = [after[i].x_m - before[i].x_m, after[i].y_m - before[i].y_m];
            let [roll, skid] = rotated(-now[i].theta_rad, moved.map(|x| x / (2.0 * STEP)));
            assert!((roll - dot(&roll_rows(&robot, &trig)[i], &velocity)).abs() < 1e-9);
            assert!((skid - dot(&skid_rows(&robot, &trig)[i], &velocity)).abs() < 1e-9);
        }
    }
}
