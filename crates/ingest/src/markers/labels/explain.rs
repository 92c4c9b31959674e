//! Finds explanations for the marker positions of a link in one row, using that row alone.

use trilink_mocap::Recording;

use super::{LinkFit, Outlier, seen};
use crate::markers::layout::LinkMarker;
use crate::markers::rigid::{self, LinkPose};

/// Maximum distance, mm, between the positions of any marker under two explanations that count as the same explanation.
const SAME_MM: f64 = 2.0;

/// Explanation of the positions of a link's markers in a row: the link's pose and a label fault.
#[derive(Debug, Clone, Copy)]
pub(super) struct Explanation {
    pub outlier: Outlier,
    pub pose: LinkPose,
    /// Number of markers whose positions the explanation accounts for.
    pub explained: usize,
}

/// Markers of a link in a file, and the residuals expected of them.
pub(super) struct LinkMarkers<'a> {
    pub file: &'a Recording,
    pub markers: &'a [LinkMarker],
    /// Maximum residual that is attributed to noise, mm.
    pub tolerance_mm: f64,
    /// Maximum residual that is attributed to an inaccurate layout rather than to a fault in the frame, mm.
    pub usual_mm: f64,
}

impl LinkMarkers<'_> {
    /// Sets `fit` to the single best explanation of a row, using that row's markers alone; without one, rejects the
    /// pose as ambiguous if its residual exceeds `usual_mm`. Returns whether the row is decided: at least three markers
    /// agree on the best explanation or, without one, the residual is within `usual_mm`.
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
        // A layout that fits no frame is reported by the residual check; here only exceptional frames are rejected.
        let is_usual = fit.pose().is_some_and(|pose| pose.residual_mm <= self.usual_mm);
        if !is_usual {
            fit.set(None, Outlier::Ambiguous);
        }
        is_usual
    }

    /// Lists the explanations of a row whose residuals are within the tolerance, sorted by the number of markers
    /// explained (descending), then by residual (ascending).
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
                swapped[a].1 = pairs[b].1;
                swapped[b].1 = pairs[a].1;
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

    /// Returns the largest distance between the positions of the same marker under two poses of the link, mm.
    pub(super) fn distance_mm(&self, one: &LinkPose, other: &LinkPose) -> f64 {
        let distances = self.markers.iter().map(|marker| {
            let [a, b] = [one, other].map(|pose| pose.at(marker.local_position_mm));
            (a[0] - b[0]).hypot(a[1] - b[1])
        });
        distances.fold(0.0, f64::max)
    }
}
