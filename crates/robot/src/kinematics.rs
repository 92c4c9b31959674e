//! Poses, and those of the links of a robot of three links (eq. 1).

use std::ops::Mul;

use super::Robot;

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
}
