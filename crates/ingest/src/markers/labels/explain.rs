//! What may have happened to a link's markers in one row, judged by that row alone.

use trilink_mocap::Recording;

use super::{LinkFit, Outlier, seen};
use crate::markers::layout::LinkMarker;
use crate::markers::rigid::{self, LinkPose};

/// Explanations that put no marker farther apart than this are one, mm.
const SAME_MM: f64 = 2.0;

/// An explanation of what was seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Explanation {
    pub outlier: Outlier,
    pub pose: LinkPose,
    /// Markers whose position it explains.
    pub explained: usize,
}

/// A link's markers and which residuals are noise.
pub(super) struct LinkMarkers<'a> {
    pub file: &'a Recording,
    pub markers: &'a [LinkMarker],
    pub tolerance_mm: f64,
    pub usual_mm: f64,
}

impl LinkMarkers<'_> {
    /// Explains a row by its markers alone; whether three markers or more agree on it.
    pub(super) fn explain(&self, row: usize, fit: &mut LinkFit) -> bool {
        let found = self.explanations(row);
        let most = found.iter().map(|found| found.explained).max().unwrap_or(0);
        let mut best = found.iter().filter(|found| found.explained == most);
        let single = best.next().filter(|first| {
            best.all(|other| self.distance_mm(&first.pose, &other.pose) <= SAME_MM)
        });
        if let Some(single) = single {
            fit.set(Some(single.pose), single.outlier);
            return most >= 3;
        }
        // A layout that fits no frame is found by the check of residuals; only what is unusual is
        // thrown out.
        let is_usual = fit.pose().is_some_and(|pose| pose.residual_mm <= self.usual_mm);
        if !is_usual {
            fit.set(None, Outlier::Ambiguous);
        }
        is_usual
    }

    /// All explanations of a row within the tolerance, those of the same kind by increasing
    /// residual.
    pub(super) fn explanations(&self, row: usize) -> Vec<Explanation> {
        let (indices, pairs): (Vec<usize>, Vec<_>) =
            seen(self.file.row_mm(row), self.markers).unzip();
        let n = pairs.len();
        let mut found = Vec::new();
        let mut offer = |outlier, explained, pose: Option<LinkPose>| {
            let pose = pose.filter(|pose| pose.residual_mm <= self.tolerance_mm);
            found.extend(pose.map(|pose| Explanation { outlier, pose, explained }));
        };
        let all = pairs.iter().copied();
        offer(Outlier::None, n, rigid::fit(all.clone()));
        for a in 0..n {
            for b in a + 1..n {
                let mut swapped = pairs.clone();
                (swapped[a].1, swapped[b].1) = (pairs[b].1, pairs[a].1);
                let pose = rigid::fit(swapped.iter().copied());
                offer(Outlier::Swapped(indices[a] as u16, indices[b] as u16), n, pose);
            }
        }
        if n >= 3 {
            for (left_out, marker) in indices.iter().enumerate() {
                let rest = all.clone().enumerate().filter(|(i, _)| *i != left_out);
                let pose = rigid::fit(rest.map(|(_, pair)| pair));
                offer(Outlier::Jumped(*marker as u16), n - 1, pose);
            }
        }
        found.sort_by(|a, b| {
            b.explained.cmp(&a.explained).then(a.pose.residual_mm.total_cmp(&b.pose.residual_mm))
        });
        found
    }

    /// How far two poses put one of the link's markers apart at most, mm.
    pub(super) fn distance_mm(&self, one: &LinkPose, other: &LinkPose) -> f64 {
        let apart = |marker: &LinkMarker| {
            let [a, b] = [one, other].map(|pose| pose.at(marker.local_position_mm));
            (a[0] - b[0]).hypot(a[1] - b[1])
        };
        self.markers.iter().map(apart).fold(0.0, f64::max)
    }
}
