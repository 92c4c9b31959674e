//! Poses of the links as a camera system computes them: each link is a rigid body, fitted to its recorded markers.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use trilink_base::body::{self, Axes, POINTS};
use trilink_mocap::Recording;
use trilink_tables::config::{MarkerLayout, Markers};

/// Minimum number of markers that determine a pose.
pub(super) const MIN_MARKERS: usize = 3;

/// Frame of a rigid body in the frame of its link.
struct Placement {
    name: String,
    origin_mm: [f64; 3],
    axes: Axes,
}

impl Placement {
    /// Returns the placement of the body of a link with the given name and markers: that in the layout or, if the link
    /// has markers only, the centroid of the markers and the axes of the link, as camera systems choose by default.
    fn new(link: &str, markers: &BTreeMap<String, [f64; 3]>) -> Self {
        let of_body = |name: &str| {
            let points = (0..POINTS).map(|i| markers.get(&body::point_label(name, i)).copied());
            points.collect::<Option<Vec<_>>>()?.try_into().ok()
        };
        let configured = markers.keys().find_map(|label| {
            let (name, _) = body::of_point(label)?;
            Some((name.to_owned(), body::pose(&of_body(name)?)))
        });
        if let Some((name, (origin_mm, axes))) = configured {
            return Self { name, origin_mm, axes };
        }
        let count = markers.len().max(1) as f64;
        let sum = |axis: usize| markers.values().map(|position| position[axis]).sum::<f64>();
        Self {
            name: link.to_owned(),
            origin_mm: [0, 1, 2].map(|axis| sum(axis) / count),
            axes: body::turned([(0, 0.0), (1, 0.0), (2, 0.0)]),
        }
    }

    fn points(&self) -> [[f64; 3]; POINTS] {
        body::points(self.origin_mm, &self.axes)
    }

    fn labels(&self) -> impl Iterator<Item = String> {
        (0..POINTS).map(|point| body::point_label(&self.name, point))
    }
}

/// Returns the layout in which each link is the rigid body that [`tracked`] gives it.
pub fn body_layout(layout: &Markers) -> Markers {
    let named = MarkerLayout::from(layout);
    let [link0, link1, link2] = [0, 1, 2].map(|link| {
        let placement = Placement::new(named.name(link), layout.links()[link]);
        placement.labels().zip(placement.points()).collect()
    });
    Markers { link0, link1, link2 }
}

/// Replaces the markers of a recording, which are those of the layout in its order, by the rigid bodies of the links
/// that have markers. A body is not tracked in frames with fewer than [`MIN_MARKERS`] of its markers.
pub(super) fn tracked(recording: &Recording, layout: &MarkerLayout) -> Recording {
    let links = layout.links().into_iter().enumerate().filter(|(_, link)| !link.is_empty());
    let links: Vec<(usize, &BTreeMap<String, [f64; 3]>)> = links.collect();
    let placements = links.iter().map(|(link, own)| Placement::new(layout.name(*link), own));
    let placements: Vec<Placement> = placements.collect();
    let markers = links.iter().map(|(_, link)| link.values().map(|x| Vector3::from(*x)).collect());
    let markers: Vec<Vec<Vector3<f64>>> = markers.collect();
    let points = placements.iter().map(|placement| placement.points().map(Vector3::from));
    let points: Vec<[Vector3<f64>; POINTS]> = points.collect();
    let mut positions_mm = Vec::with_capacity(links.len() * POINTS * recording.frames.len());
    for row in 0..recording.frames.len() {
        let mut rest = recording.row_mm(row);
        for (markers, points) in markers.iter().zip(&points) {
            let (own, others) = rest.split_at(markers.len());
            rest = others;
            let pairs = markers.iter().zip(own).filter(|(_, [x, ..])| !x.is_nan());
            let pairs: Vec<_> = pairs.map(|(p, q)| (*p, Vector3::from(*q))).collect();
            let fitted = (pairs.len() >= MIN_MARKERS).then(|| registered(&pairs, points));
            positions_mm.extend(fitted.unwrap_or([[f64::NAN; 3]; POINTS]));
        }
    }
    let labels = placements.iter().flat_map(Placement::labels).collect();
    Recording::new(recording.rate_hz, recording.frames.clone(), labels, positions_mm)
}

/// Maps points by the rotation and translation that map the first positions of the pairs as closely as possible to the
/// second (Kabsch 1976).
fn registered(
    pairs: &[(Vector3<f64>, Vector3<f64>)],
    points: &[Vector3<f64>; POINTS],
) -> [[f64; 3]; POINTS] {
    let count = pairs.len() as f64;
    let local = pairs.iter().map(|(p, _)| p).sum::<Vector3<f64>>() / count;
    let seen = pairs.iter().map(|(_, q)| q).sum::<Vector3<f64>>() / count;
    let products = pairs.iter().map(|(p, q)| (q - seen) * (p - local).transpose());
    let svd = products.sum::<Matrix3<f64>>().svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return [[f64::NAN; 3]; POINTS] };
    let mut turn = u * v_t;
    if turn.determinant() < 0.0 {
        // The singular values are sorted; the axis of the smallest is reflected.
        turn = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0)) * v_t;
    }
    points.map(|point| (turn * (point - local) + seen).into())
}
