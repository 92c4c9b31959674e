//! The pose of a link from those of its markers that the cameras saw.

use crate::robot::in_world;

/// Two markers nearer than this, mm, hardly determine the heading.
const LEAST_SPREAD_MM: f64 = 5.0;

/// Where a link is in the plane of the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkPose {
    /// Wheel axle, mm.
    pub origin_mm: [f64; 2],
    /// Heading, rad, in (-pi, pi].
    pub theta_rad: f64,
    /// RMS distance of the markers from where the pose puts them, mm.
    pub residual_mm: f64,
    pub moments: MarkerMoments,
}

/// The markers that a pose rests on: enough to compute how much worse another pose explains
/// them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MarkerMoments {
    pub markers: f64,
    /// Their centroid in the link's frame, mm.
    pub centre_mm: [f64; 2],
    /// How hard it is to turn the link about that centroid: turning it by an angle adds twice
    /// this, times one minus the angle's cosine, to the sum of squares, mm^2.
    pub turning_mm2: f64,
}

impl LinkPose {
    /// Where the pose puts a point of the link's frame, mm.
    pub fn at(&self, local_position_mm: [f64; 2]) -> [f64; 2] {
        in_world(self.origin_mm, self.theta_rad, local_position_mm)
    }
}

/// Rotation and translation that bring `local_mm` (in the link's frame) nearest to `seen_mm`
/// (in the world), in the sense of least squares; `None` if the markers do not give a heading.
///
/// In the plane this has a closed form: about the two centroids, the rotation's tangent is
/// the sum of cross products over the sum of dot products.
pub fn fit(pairs: impl Iterator<Item = ([f64; 2], [f64; 2])> + Clone) -> Option<LinkPose> {
    let (mut count, mut local, mut seen) = (0.0, [0.0; 2], [0.0; 2]);
    for (p, q) in pairs.clone() {
        count += 1.0;
        for axis in 0..2 {
            local[axis] += p[axis];
            seen[axis] += q[axis];
        }
    }
    if count < 2.0 || !is_spread(pairs.clone()) {
        return None;
    }
    let (local, seen) = (local.map(|sum| sum / count), seen.map(|sum| sum / count));
    let (mut along, mut across) = (0.0, 0.0);
    for (p, q) in pairs.clone() {
        let (p, q) = ([p[0] - local[0], p[1] - local[1]], [q[0] - seen[0], q[1] - seen[1]]);
        along += p[0] * q[0] + p[1] * q[1];
        across += p[0] * q[1] - p[1] * q[0];
    }
    let theta_rad = across.atan2(along);
    let turning_mm2 = (along * along + across * across).sqrt();
    // Markers that were all seen in one point give no heading.
    if turning_mm2 == 0.0 {
        return None;
    }
    let (sin, cos) = (across / turning_mm2, along / turning_mm2);
    let turned = |p: [f64; 2]| [cos * p[0] - sin * p[1], sin * p[0] + cos * p[1]];
    let centre = turned(local);
    let origin_mm = [seen[0] - centre[0], seen[1] - centre[1]];
    let squares: f64 = pairs
        .map(|(p, q)| {
            let p = turned(p);
            (p[0] + origin_mm[0] - q[0]).powi(2) + (p[1] + origin_mm[1] - q[1]).powi(2)
        })
        .sum();
    Some(LinkPose {
        origin_mm,
        theta_rad,
        residual_mm: (squares / count).sqrt(),
        moments: MarkerMoments { markers: count, centre_mm: local, turning_mm2 },
    })
}

/// Whether any two of the markers lie far enough apart.
fn is_spread(pairs: impl Iterator<Item = ([f64; 2], [f64; 2])> + Clone) -> bool {
    pairs.clone().enumerate().any(|(i, (a, _))| {
        pairs.clone().skip(i + 1).any(|(b, _)| {
            let [x, y] = [a[0] - b[0], a[1] - b[1]];
            x * x + y * y >= LEAST_SPREAD_MM * LEAST_SPREAD_MM
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    #[test]
    fn any_two_or_more_markers_of_a_link_give_its_pose() {
        let markers = Config::default().markers;
        let (origin, theta) = ([1234.5, -678.9], 2.5_f64);
        let (sin, cos) = theta.sin_cos();
        for layout in markers.links() {
            let pairs: Vec<_> = layout
                .values()
                .map(|&[x, y, _]| {
                    let world = [origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y];
                    ([x, y], world)
                })
                .collect();
            for subset in 0_u32..1 << pairs.len() {
                let seen = pairs.iter().enumerate().filter(|(i, _)| subset >> i & 1 == 1);
                let pose = fit(seen.map(|(_, pair)| *pair));
                if subset.count_ones() < 2 {
                    assert_eq!(pose, None);
                    continue;
                }
                let pose = pose.unwrap();
                assert!((pose.theta_rad - theta).abs() < 1e-13);
                assert!((pose.origin_mm[0] - origin[0]).abs() < 1e-10);
                assert!((pose.origin_mm[1] - origin[1]).abs() < 1e-10);
                assert!(pose.residual_mm < 1e-10);
            }
        }
    }

    #[test]
    fn the_residual_is_the_rms_misfit() {
        // Two markers 2 mm too far apart: each is 1 mm off, whatever the pose.
        let pairs = [([-10.0, 0.0], [-11.0, 0.0]), ([10.0, 0.0], [11.0, 0.0])];
        let pose = fit(pairs.into_iter()).unwrap();
        assert!((pose.residual_mm - 1.0).abs() < 1e-12);
        assert_eq!((pose.origin_mm, pose.theta_rad), ([0.0, 0.0], 0.0));
    }

    #[test]
    fn markers_that_almost_coincide_give_no_heading() {
        let pairs = [([0.0, 0.0], [0.0, 0.0]), ([4.0, 0.0], [4.0, 0.0])];
        assert_eq!(fit(pairs.into_iter()), None);
        let pairs = [([-50.0, 0.0], [7.0, 7.0]), ([40.0, 0.0], [7.0, 7.0])];
        assert_eq!(fit(pairs.into_iter()), None);
    }
}
