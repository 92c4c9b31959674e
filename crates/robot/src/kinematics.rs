//! Forward kinematics (eq. 1): where the links are and how fast their wheels roll and skid.
//!
//! With `c_i = cos phi_i`, `s_i = sin phi_i`, in link 0's frame the links point along
//! `t0 = (1, 0)`, `t1 = (c1, -s1)`, `t2 = (c2, s2)` and the wheels are mounted across
//! `n0 = (0, 1)`, `n1 = (s1, c1)`, `n2 = (-s2, c2)`. Turning these rows by `theta` gives `W`.

use std::ops::Mul;

use super::{Number, Robot};

/// Velocities in link 0's frame: `(u, v, theta', phi1', phi2')` with `u` along the
/// link (m/s), `v` across it to the left (m/s), and angular rates in rad/s.
///
/// `u = x' cos(theta) + y' sin(theta)`, `v = -x' sin(theta) + y' cos(theta)`.
pub type Velocity<T = f64> = [T; 5];

/// Origin (the wheel's axle) and heading of a link in the plane.
///
/// The heading counts whole turns, which those of nalgebra's `Isometry2` do not.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose {
    pub x_m: f64,
    pub y_m: f64,
    pub theta_rad: f64,
}

impl Pose {
    /// The pose moved along its own heading.
    #[inline]
    pub fn ahead(self, length_m: f64) -> Self {
        let (sin, cos) = self.theta_rad.sin_cos();
        Self { x_m: self.x_m + length_m * cos, y_m: self.y_m + length_m * sin, ..self }
    }

    /// The pose turned to the left about its own origin.
    #[inline]
    pub fn turned(self, angle_rad: f64) -> Self {
        Self { theta_rad: self.theta_rad + angle_rad, ..self }
    }

    /// The mirror image in the x axis.
    #[inline]
    pub fn mirrored(self) -> Self {
        Self { x_m: self.x_m, y_m: -self.y_m, theta_rad: -self.theta_rad }
    }
}

/// Composition: a pose given in the frame of another one.
impl Mul for Pose {
    type Output = Self;

    // Positions turn, headings add.
    #[allow(clippy::suspicious_arithmetic_impl)]
    #[inline]
    fn mul(self, local: Self) -> Self {
        let origin = [self.x_m, self.y_m];
        let [x_m, y_m] = in_world(origin, self.theta_rad, [local.x_m, local.y_m]);
        Self { x_m, y_m, theta_rad: self.theta_rad + local.theta_rad }
    }
}

/// A vector after a turn to the left.
#[inline(always)]
pub fn rotated(angle_rad: f64, [x, y]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = angle_rad.sin_cos();
    [cos * x - sin * y, sin * x + cos * y]
}

/// The world's coordinates of a point in a frame with this origin and heading, all in one unit.
#[inline(always)]
pub fn in_world(origin: [f64; 2], theta_rad: f64, [x, y]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = theta_rad.sin_cos();
    [origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y]
}

impl Robot {
    /// Poses of links 0, 1, 2 with link 0 at `middle`: `r1 = r0 + h t0 + l t1` along
    /// `theta - phi1`, `r2 = r0 - h t0 - l t2` along `theta + phi2`.
    #[inline]
    pub fn link_poses(&self, middle: Pose, [phi1, phi2]: [f64; 2]) -> [Pose; 3] {
        let (front, rear) = (middle.ahead(self.h_m), middle.ahead(-self.h_m));
        [middle, front.turned(-phi1).ahead(self.l_m), rear.turned(phi2).ahead(-self.l_m)]
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

/// Rows that give the wheels' skid velocities `v_perp` from [`Velocity`] (eq. 1), m/s.
#[inline(always)]
pub fn skid_rows<T: Number>(robot: &Robot, trig: &Trig<T>) -> [[T; 5]; 3] {
    let (h, l, zero) = (T::of(robot.h_m), T::of(robot.l_m), T::of(0.0));
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    let middle = [zero, T::of(1.0), zero, zero, zero];
    [middle, [s1, c1, l + h * c1, -l, zero], [-s2, c2, -l - h * c2, zero, -l]]
}

/// Derivatives of the skid rows of wheels 1 and 2 with respect to their own joints' angles.
#[inline(always)]
pub fn dskid_rows_dphi<T: Number>(robot: &Robot, trig: &Trig<T>) -> [[T; 5]; 2] {
    let (h, zero) = (T::of(robot.h_m), T::of(0.0));
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    [[c1, -s1, -h * s1, zero, zero], [-c2, -s2, h * s2, zero, zero]]
}

/// Rows that give the wheels' roll velocities `v_par` from [`Velocity`], m/s.
#[inline(always)]
pub fn roll_rows<T: Number>(robot: &Robot, trig: &Trig<T>) -> [[T; 5]; 3] {
    let (h, zero) = (T::of(robot.h_m), T::of(0.0));
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    let middle = [T::of(1.0), zero, zero, zero, zero];
    [middle, [c1, -s1, -h * s1, zero, zero], [c2, s2, -h * s2, zero, zero]]
}

/// Derivatives of the roll rows of wheels 1 and 2 with respect to their own joints' angles.
#[inline(always)]
pub fn droll_rows_dphi<T: Number>(robot: &Robot, trig: &Trig<T>) -> [[T; 5]; 2] {
    let (h, zero) = (T::of(robot.h_m), T::of(0.0));
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    [[-s1, -c1, -h * c1, zero, zero], [-s2, c2, -h * c2, zero, zero]]
}

/// Product of a row with a velocity.
#[inline(always)]
pub fn dot<T: Number>(row: &[T; 5], velocity: &Velocity<T>) -> T {
    row.iter().zip(velocity).fold(T::of(0.0), |sum, (a, b)| sum + *a * *b)
}

/// `det W_b`, m.
///
/// The sign is the opposite of eq. 4's, as working eq. 1 out shows; only the zeros matter.
/// Likewise `det A = +det(W_b)^2` where the paper has a minus.
#[inline]
pub fn det_wb(robot: &Robot, trig: &Trig) -> f64 {
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    robot.h_m * (s1 * c2 - c1 * s2) + robot.l_m * (s1 - s2)
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
        let (from, local) = (
            Pose { x_m: 1.0, y_m: 2.0, theta_rad: FRAC_PI_2 },
            Pose { x_m: 0.3, y_m: -0.1, theta_rad: 7.0 },
        );
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
        let robot = Robot { h_m: 2.0, l_m: 1.0, ..Robot::kinematic() };
        // Both joints a right angle: the front link to the right, the rear one to the left.
        let [middle, front, rear] = robot.link_poses(Pose::default(), [FRAC_PI_2; 2]);
        assert_eq!(middle, Pose::default());
        assert!(is_near(front, Pose { x_m: 2.0, y_m: -1.0, theta_rad: -FRAC_PI_2 }));
        assert!(is_near(rear, Pose { x_m: -2.0, y_m: -1.0, theta_rad: FRAC_PI_2 }));
    }

    #[test]
    fn the_wheels_roll_and_skid_as_their_links_move() {
        const STEP: f64 = 1e-6;
        let (robot, phi, velocity) = (Robot::kinematic(), [0.4, -0.7], [0.3, -0.2, 0.9, 1.3, -0.6]);
        let [u, v, turning, w1, w2] = velocity;
        let at = |t: f64| {
            let middle = Pose { x_m: t * u, y_m: t * v, theta_rad: t * turning };
            robot.link_poses(middle, [phi[0] + t * w1, phi[1] + t * w2])
        };
        let (before, now, after) = (at(-STEP), at(0.0), at(STEP));
        let trig = Trig::new(phi);
        for i in 0..3 {
            let moved = [after[i].x_m - before[i].x_m, after[i].y_m - before[i].y_m];
            let [roll, skid] = rotated(-now[i].theta_rad, moved.map(|x| x / (2.0 * STEP)));
            assert!((roll - dot(&roll_rows(&robot, &trig)[i], &velocity)).abs() < 1e-9);
            assert!((skid - dot(&skid_rows(&robot, &trig)[i], &velocity)).abs() < 1e-9);
        }
    }
}
