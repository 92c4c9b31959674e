//! Rigid registration: estimates the pose of a link from its visible markers.

use nalgebra::{UnitComplex, Vector2};
use trilink_robot::in_world;

/// Minimum distance between two markers for them to determine the heading, mm.
const MIN_SPREAD_MM: f64 = 5.0;

/// Pose of a link in the floor plane.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LinkPose {
    /// Position of the wheel axle, mm.
    pub origin_mm: [f64; 2],
    /// Heading, rad, in (-pi, pi].
    pub theta_rad: f64,
    /// RMS distance between the markers' recorded positions and those that the pose predicts, mm.
    pub residual_mm: f64,
    pub moments: MarkerMoments,
}

/// Moments of the markers to which a pose was fitted. They suffice to compute how much worse any other pose fits these
/// markers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MarkerMoments {
    pub markers: f64,
    /// Centroid of the markers in the link frame, mm.
    pub centre_mm: [f64; 2],
    /// Rotational stiffness of the fit about the centroid, mm^2: rotating the pose by an angle increases the sum of the
    /// squared marker residuals by twice this value times one minus the cosine of the angle.
    pub turning_mm2: f64,
}

impl LinkPose {
    /// Returns the position, mm, to which the pose maps a point of the link frame.
    pub fn at(&self, local_position_mm: [f64; 2]) -> [f64; 2] {
        in_world(self.origin_mm, self.theta_rad, local_position_mm)
    }
}

/// Fits the rotation and translation that map the first positions of the pairs (in the link frame, mm) as closely as
/// possible, in the least-squares sense, to the second positions (in the world frame, mm). `None` if the markers do not
/// determine a heading.
///
/// In the plane the solution has a closed form: with positions relative to the two centroids, the tangent of the
/// rotation angle is the sum of cross products divided by the sum of dot products.
pub fn fit(pairs: impl Iterator<Item = ([f64; 2], [f64; 2])> + Clone) -> Option<LinkPose> {
    let pairs = pairs.map(|(p, q)| (Vector2::from(p), Vector2::from(q)));
    let mut count = 0.0;
    let mut local = Vector2::zeros();
    let mut seen = Vector2::zeros();
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
    let mut along = 0.0;
    let mut across = 0.0;
    for (p, q) in pairs.clone() {
        let p = p - local;
        let q = q - seen;
        along += p.dot(&q);
        across += p.perp(&q);
    }
    let theta_rad = across.atan2(along);
    let turning_mm2 = (along * along + across * across).sqrt();
    // Coinciding markers determine no heading.
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

/// Returns whether at least two of the markers are far enough apart to determine the heading.
fn is_spread(mut markers: impl Iterator<Item = Vector2<f64>> + Clone) -> bool {
    let min_mm2 = MIN_SPREAD_MM * MIN_SPREAD_MM;
    while let Some(a) = markers.next() {
        if markers.clone().any(|b| (a - b).norm_squared() >= min_mm2) {
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
        let origin = [1234.5, -678.9];
        let theta = 2.5_f64;
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
        // Two markers that are 2 mm too far apart: each has a residual of 1 mm, whatever the pose.
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
