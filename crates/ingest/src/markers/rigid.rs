//! The pose of a link from those of its markers that the cameras saw.

use nalgebra::{UnitComplex, Vector2};
use trilink_robot::in_world;

/// Two markers nearer than this, mm, hardly determine the heading.
const LEAST_SPREAD_MM: f64 = 5.0;

/// Where a link is in the plane of the floor.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
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
    let pairs = pairs.map(|(p, q)| (Vector2::from(p), Vector2::from(q)));
    let (mut count, mut local, mut seen) = (0.0, Vector2::zeros(), Vector2::zeros());
    for (p, q) in pairs.clone() {
        count += 1.0;
        local += p;
        seen += q;
    }
    if count < 2.0 || !is_spread(pairs.clone().map(|(p, _)| p)) {
        return None;
    }
    local /= count;
    seen /= count;
    let (mut along, mut across) = (0.0, 0.0);
    for (p, q) in pairs.clone() {
        let (p, q) = (p - local, q - seen);
        along += p.dot(&q);
        across += p.perp(&q);
    }
    let theta_rad = across.atan2(along);
    let turning_mm2 = (along * along + across * across).sqrt();
    // Markers that were all seen in one point give no heading.
    if turning_mm2 == 0.0 {
        return None;
    }
    let turn = UnitComplex::from_cos_sin_unchecked(along / turning_mm2, across / turning_mm2);
    let origin_mm = seen - turn * local;
    let squares: f64 = pairs.map(|(p, q)| (turn * p + origin_mm - q).norm_squared()).sum();
    Some(LinkPose {
        origin_mm: origin_mm.into(),
        theta_rad,
        residual_mm: (squares / count).sqrt(),
        moments: MarkerMoments { markers: count, centre_mm: local.into(), turning_mm2 },
    })
}

/// Whether any two of the markers lie far enough apart.
fn is_spread(mut markers: impl Iterator<Item = Vector2<f64>> + Clone) -> bool {
    let least_mm2 = LEAST_SPREAD_MM * LEAST_SPREAD_MM;
    while let Some(a) = markers.next() {
        if markers.clone().any(|b| (a - b).norm_squared() >= least_mm2) {
            return true;
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use trilink_tables::config::Config;

    use super::*;

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
