//! Rigid bodies as points: a pose is stored as the positions of four points of the body, so that whatever processes
//! markers also processes poses.
//!
//! The points are the corners of a regular tetrahedron about the origin of the body's frame. They represent the pose
//! completely, and its noise equally well for every orientation of the frame: the second moments of the corners are the
//! same along all axes, so that a position with the standard deviation `s` along each axis and a rotation with the
//! standard deviation `s / (sqrt(2) c)` about each axis, where `c` is [`OFFSET_MM`], correspond to independent noise of
//! the standard deviation `2 s` in every coordinate of the points.

/// Number of points of a rigid body.
pub const POINTS: usize = 4;
/// Absolute value of each coordinate of a point in the frame of its body, mm. The points are 61 mm from the origin, about
/// as far as markers are on a link of 10 to 20 cm.
pub const OFFSET_MM: f64 = 35.0;
/// Separates the name of a body from the number of a point.
const SEPARATOR: char = '@';

/// Rotation as the images of the axes x, y, z: the columns of the rotation matrix.
pub type Axes = [[f64; 3]; 3];

/// Returns the label of a point (0 to 3) of a body, such as `middle@1`.
pub fn point_label(body: &str, point: usize) -> String {
    format!("{body}{SEPARATOR}{}", point + 1)
}

/// Returns the name of the body and the index of the point (0 to 3) for which a label stands; `None` if it is the label
/// of a marker.
pub fn of_point(label: &str) -> Option<(&str, usize)> {
    let (body, number) = label.rsplit_once(SEPARATOR)?;
    let point = ["1", "2", "3", "4"].iter().position(|known| *known == number)?;
    (!body.is_empty()).then_some((body, point))
}

/// Returns the name of the rigid body to which the point with this label belongs, or the label of a marker as it is.
pub fn name(label: &str) -> &str {
    of_point(label).map_or(label, |(body, _)| body)
}

/// Returns the positions of a body's points, mm, given the position of its origin, mm, and the axes of its frame.
pub fn points(origin_mm: [f64; 3], axes: &Axes) -> [[f64; 3]; POINTS] {
    let corner = |signs: [f64; 3]| {
        [0, 1, 2].map(|i| {
            let offset = signs[0] * axes[0][i] + signs[1] * axes[1][i] + signs[2] * axes[2][i];
            origin_mm[i] + OFFSET_MM * offset
        })
    };
    [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(corner)
}

/// Returns the pose of which these are the points: the position of the origin, mm, and the axes. The inverse of
/// [`points`].
pub fn pose(points: &[[f64; 3]; POINTS]) -> ([f64; 3], Axes) {
    let [p, x, y, z] = points;
    let origin_mm = [0, 1, 2].map(|i| 0.25 * (p[i] + x[i] + y[i] + z[i]));
    let axis =
        |own: &[f64; 3]| [0, 1, 2].map(|i| (0.5 * (p[i] + own[i]) - origin_mm[i]) / OFFSET_MM);
    (origin_mm, [axis(x), axis(y), axis(z)])
}

/// Returns the axes after rotations about the axes of the body: `turns` lists the axis (0, 1, 2) and the angle, rad, of
/// each, in the order in which they are applied, each about the axis in its new direction (intrinsic rotations).
pub fn turned(turns: [(usize, f64); 3]) -> Axes {
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for (axis, angle_rad) in turns {
        let (sin, cos) = angle_rad.sin_cos();
        let [from, to] = [axes[(axis + 1) % 3], axes[(axis + 2) % 3]];
        axes[(axis + 1) % 3] = [0, 1, 2].map(|i| cos * from[i] + sin * to[i]);
        axes[(axis + 2) % 3] = [0, 1, 2].map(|i| cos * to[i] - sin * from[i]);
    }
    axes
}

/// Returns roll, pitch and yaw, rad: the rotations about z, then the new y, then the new x (by yaw, pitch and roll)
/// that give these axes.
pub fn roll_pitch_yaw(axes: &Axes) -> [f64; 3] {
    let [x, y, z] = axes;
    [y[2].atan2(z[2]), (-x[2]).atan2(x[0].hypot(x[1])), x[1].atan2(x[0])]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_is_that_of_its_points() {
        for angles in [[0.3, -0.4, 2.5], [3.0, 0.2, -1.0], [0.0; 3]] {
            let [roll, pitch, yaw] = angles;
            let axes = turned([(2, yaw), (1, pitch), (0, roll)]);
            let (origin_mm, found) = pose(&points([10.0, -250.0, 55.5], &axes));
            for (found, expected) in found.as_flattened().iter().zip(axes.as_flattened()) {
                assert!((found - expected).abs() < 1e-14);
            }
            for (found, expected) in origin_mm.iter().zip([10.0, -250.0, 55.5]) {
                assert!((found - expected).abs() < 1e-12);
            }
            for (found, expected) in roll_pitch_yaw(&found).iter().zip(angles) {
                assert!((found - expected).abs() < 1e-13);
            }
        }
        // A quarter of a turn to the left, then a nose-up rotation about the new y.
        let [x, y, _] = turned([(2, 0.5 * std::f64::consts::PI), (1, -0.1), (0, 0.0)]);
        assert!(x[1] > 0.99 && x[2] > 0.09 && y[0] < -0.99);
    }

    #[test]
    fn labels_of_points_name_their_body() {
        assert_eq!(point_label("Snake:middle", 0), "Snake:middle@1");
        assert_eq!(of_point("Snake:middle@4"), Some(("Snake:middle", 3)));
        for marker in ["middle", "middle@5", "a@b", "@1", "M@12"] {
            assert_eq!((of_point(marker), name(marker)), (None, marker));
        }
    }
}
