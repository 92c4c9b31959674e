//! Conversion of the rotations of rigid bodies, as files state them, to the axes of the bodies and back.

use trilink_base::body::{Axes, turned};

/// Maximum deviation of the squared length of a unit quaternion or of an axis from 1, and of the product of two axes
/// from 0: numbers are rounded to three digits or more.
const MAX_DEVIATION: f64 = 0.02;

/// How the columns of a rigid body state its rotation; angles are multiplied by `unit_rad`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Rotation {
    /// Unit quaternion w, x, y, z.
    Quaternion,
    /// Direction of the rotation axis times the angle.
    Vector { unit_rad: f64 },
    /// Angles of intrinsic rotations about the axes (0, 1, 2) in `order`, in that order.
    Euler { order: [u8; 3], unit_rad: f64 },
    /// Images of the axes x, y, z: the columns of the rotation matrix.
    Matrix,
}

impl Rotation {
    /// Returns the number of components.
    pub(super) fn components(self) -> usize {
        match self {
            Self::Quaternion => 4,
            Self::Vector { .. } | Self::Euler { .. } => 3,
            Self::Matrix => 9,
        }
    }

    /// Returns the axes of the body; `None` if the components are not those of a rotation.
    pub(super) fn axes(self, components: &[f64; 9]) -> Option<Axes> {
        let [a, b, c, d, ..] = *components;
        match self {
            Self::Quaternion => {
                let square = a * a + b * b + c * c + d * d;
                ((square - 1.0).abs() < MAX_DEVIATION).then(|| of_quaternion([a, b, c, d]))
            }
            Self::Vector { unit_rad } => {
                let [x, y, z] = [a, b, c].map(|x| 0.5 * unit_rad * x);
                let half_rad = (x * x + y * y + z * z).sqrt();
                let scale = if half_rad > 0.0 { half_rad.sin() / half_rad } else { 1.0 };
                Some(of_quaternion([half_rad.cos(), scale * x, scale * y, scale * z]))
            }
            Self::Euler { order, unit_rad } => Some(turned(std::array::from_fn(|i| {
                (usize::from(order[i]), unit_rad * components[i])
            }))),
            Self::Matrix => {
                let [x, y, z] =
                    std::array::from_fn(|i| std::array::from_fn(|j| components[3 * i + j]));
                let products = [dot(x, x) - 1.0, dot(y, y) - 1.0, dot(x, y)];
                let is_right_handed = dot(cross(x, y), z) > 0.0;
                let is_rotation = products.iter().all(|product| product.abs() < MAX_DEVIATION);
                (is_rotation && is_right_handed).then(|| orthonormal(x, y))
            }
        }
    }
}

/// Returns the unit quaternion w, x, y, z with a positive largest component of a rotation.
pub(super) fn quaternion(axes: &Axes) -> [f64; 4] {
    let [x, y, z] = axes;
    // Squares of the components, times four (Shepperd 1978): the largest is used to find the others.
    let squares = [
        1.0 + x[0] + y[1] + z[2],
        1.0 + x[0] - y[1] - z[2],
        1.0 - x[0] + y[1] - z[2],
        1.0 - x[0] - y[1] + z[2],
    ];
    let largest = (0..4).max_by(|&i, &j| squares[i].total_cmp(&squares[j])).unwrap_or(0);
    let [wx, wy, wz] = [y[2] - z[1], z[0] - x[2], x[1] - y[0]];
    let [xy, xz, yz] = [x[1] + y[0], x[2] + z[0], y[2] + z[1]];
    let products = match largest {
        0 => [squares[0], wx, wy, wz],
        1 => [wx, squares[1], xy, xz],
        2 => [wy, xy, squares[2], yz],
        _ => [wz, xz, yz, squares[3]],
    };
    products.map(|product| 0.5 * product / squares[largest].sqrt())
}

/// Returns the rotation vector of a rotation, rad.
pub(super) fn vector_rad(axes: &Axes) -> [f64; 3] {
    let [w, x, y, z] = quaternion(axes);
    let sin = (x * x + y * y + z * z).sqrt();
    let angle_rad = 2.0 * sin.atan2(w);
    let scale = if sin > 0.0 { angle_rad / sin } else { 2.0 };
    [x, y, z].map(|component| scale * component)
}

fn of_quaternion(quaternion: [f64; 4]) -> Axes {
    let norm = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [w, x, y, z] = quaternion.map(|component| component / norm);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)],
        [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)],
        [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Returns orthonormal axes from approximately orthonormal directions of x and y.
fn orthonormal(x: [f64; 3], y: [f64; 3]) -> Axes {
    let unit = |v: [f64; 3]| v.map(|component| component / dot(v, v).sqrt());
    // Half of the angle by which x and y deviate from orthogonality is attributed to each.
    let half = 0.5 * dot(x, y);
    let x_unit = unit([0, 1, 2].map(|i| x[i] - half * y[i]));
    let z = unit(cross(x_unit, y));
    [x_unit, cross(z, x_unit), z]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_representation_gives_the_same_axes() {
        for [roll, pitch, yaw] in [[0.1, -0.2, 0.3], [0.0, 0.0, 3.1], [-2.9, 0.4, -1.2], [0.0; 3]] {
            let axes = turned([(2, yaw), (1, pitch), (0, roll)]);
            let mut components = [[f64::NAN; 9]; 4];
            components[0][..4].copy_from_slice(&quaternion(&axes));
            components[1][..3].copy_from_slice(&vector_rad(&axes).map(f64::to_degrees));
            components[2][..3].copy_from_slice(&[yaw, pitch, roll]);
            components[3] = std::array::from_fn(|i| axes[i / 3][i % 3]);
            let rotations = [
                Rotation::Quaternion,
                Rotation::Vector { unit_rad: 1_f64.to_radians() },
                Rotation::Euler { order: [2, 1, 0], unit_rad: 1.0 },
                Rotation::Matrix,
            ];
            for (rotation, components) in rotations.into_iter().zip(components) {
                let found = rotation.axes(&components).unwrap();
                for (found, expected) in found.as_flattened().iter().zip(axes.as_flattened()) {
                    assert!((found - expected).abs() < 1e-12, "{rotation:?}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn numbers_that_are_no_rotation_are_refused() {
        let mut components = [0.0; 9];
        assert_eq!(Rotation::Quaternion.axes(&components), None);
        components[..4].copy_from_slice(&[1.0, 0.0, 0.5, 0.0]);
        assert_eq!(Rotation::Quaternion.axes(&components), None);
        let mirrored = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0];
        assert_eq!(Rotation::Matrix.axes(&mirrored), None);
    }
}
