//! Label correction: detects and corrects frames in which a marker of a link has jumped (a ghost marker) or two
//! labels of a link are swapped.
//!
//! Three or more markers on a link check each other. If they contradict the layout, explanations are tried in this
//! order: two labels are swapped (which explains all markers), or one marker has jumped (which explains all the
//! others). Two markers at the correct distance do not check each other: they may be swapped, or one may have moved in
//! a circle around the other. Such frames, and frames with several explanations, are compared with the link's poses
//! shortly before or after. Frames that remain undecided are ambiguous: the link's pose is rejected, which leaves a
//! gap.

mod explain;
mod motion;
#[cfg(test)]
mod tests;

use trilink_mocap::Recording;
use trilink_statistics::median_high;
use trilink_tables::LabelFault;

use super::layout::LinkMarker;
use super::rigid::{self, LinkPose, MarkerMoments};
use explain::LinkMarkers;

/// Residual of a pose, as a multiple of the link's median residual, above which it is not attributed to noise. With
/// normally distributed noise, the residual of three markers exceeds it in one frame out of ten million.
const NOISE_MEDIANS: f64 = 5.0;
/// Lower and upper bound of the residual tolerated as noise, mm. A residual below the lower bound means that the labels
/// are correct; labels that are swapped in all frames leave a residual above the upper bound.
const TOLERANCE_MM: (f64, f64) = (0.8, 5.0);
/// Residual, as a multiple of the link's median residual, up to which it is attributed to an inaccurate layout rather
/// than to a fault in the frame.
const USUAL_MEDIANS: f64 = 2.0;

/// Label fault of a link in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outlier {
    None,
    /// A marker has jumped and is left out; it is given by its index in the link's layout.
    Jumped(u16),
    /// Two labels were swapped and have been swapped back; the markers are given by their indices in the link's layout.
    Swapped(u16, u16),
    /// The markers contradict each other or the link's motion, and the wrong one cannot be identified.
    Ambiguous,
}

impl Outlier {
    /// Returns the kind of label fault.
    pub fn fault(self) -> LabelFault {
        match self {
            Self::None => LabelFault::None,
            Self::Jumped(_) => LabelFault::Jumped,
            Self::Swapped(..) => LabelFault::Swapped,
            Self::Ambiguous => LabelFault::Ambiguous,
        }
    }

    /// Returns the set of markers that are left out or swapped back. Each bit stands for the marker with that index in
    /// the link's layout.
    pub fn markers(self) -> u64 {
        match self {
            Self::None | Self::Ambiguous => 0,
            Self::Jumped(index) => bit(index),
            Self::Swapped(one, other) => bit(one) | bit(other),
        }
    }
}

/// Returns the bit that represents a marker, given its index in the link's layout, in a set of markers.
pub(crate) fn bit(index: u16) -> u64 {
    1_u64.checked_shl(index.into()).unwrap_or_default()
}

/// Pose of one link in one row of the file. A long recording has millions of these, so, to save memory, the marker
/// count of a [`LinkPose`] is not stored but computed from the set of its markers.
#[derive(Debug, Clone, Copy)]
pub struct LinkFit {
    is_posed: bool,
    /// Position of the pose's origin, mm; all pose fields are meaningless if `is_posed` is false.
    origin_mm: [f64; 2],
    theta_rad: f64,
    residual_mm: f64,
    centre_mm: [f64; 2],
    turning_mm2: f64,
    /// Set of visible markers. Each bit stands for the marker with that index in the link's layout.
    pub seen: u64,
    outlier: Outlier,
}

impl LinkFit {
    /// Fits the pose to all visible markers of the link in a row, given the positions of all markers in that row.
    pub fn from_row(positions_mm: &[[f64; 3]], markers: &[LinkMarker]) -> Self {
        let seen = seen(positions_mm, markers);
        let pose = rigid::fit(seen.clone().map(|(_, pair)| pair));
        Self::new(seen.map(|(index, _)| bit(index as u16)).sum(), pose, Outlier::None)
    }

    /// Creates a fit from the set `seen` of visible markers (one bit per marker), their label fault, and the pose
    /// fitted to the markers that are not left out; `None` if that pose is undetermined or rejected.
    pub fn new(seen: u64, pose: Option<LinkPose>, outlier: Outlier) -> Self {
        let is_posed = pose.is_some();
        let LinkPose { origin_mm, theta_rad, residual_mm, moments } = pose.unwrap_or_default();
        let MarkerMoments { centre_mm, turning_mm2, .. } = moments;
        Self { is_posed, origin_mm, theta_rad, residual_mm, centre_mm, turning_mm2, seen, outlier }
    }

    /// Returns the pose; `None` if the visible markers do not determine it, or if it was rejected because they are
    /// ambiguous.
    pub fn pose(&self) -> Option<LinkPose> {
        let left_out = match self.outlier {
            Outlier::Jumped(index) => bit(index),
            _ => 0,
        };
        let markers = f64::from((self.seen & !left_out).count_ones());
        let Self { origin_mm, theta_rad, residual_mm, centre_mm, turning_mm2, .. } = *self;
        let moments = MarkerMoments { markers, centre_mm, turning_mm2 };
        self.is_posed.then_some(LinkPose { origin_mm, theta_rad, residual_mm, moments })
    }

    pub fn outlier(&self) -> Outlier {
        self.outlier
    }

    /// Returns whether the link has a pose in this row.
    pub(crate) fn is_posed(&self) -> bool {
        self.is_posed
    }

    /// Returns whether there is a pose and the markers have no fault.
    pub(crate) fn is_sound(&self) -> bool {
        self.is_posed && self.outlier == Outlier::None
    }

    /// Replaces the label fault and the pose, which `None` removes.
    pub fn set(&mut self, pose: Option<LinkPose>, outlier: Outlier) {
        *self = Self::new(self.seen, pose, outlier);
    }
}

/// Iterates over the visible markers of a link in a row: index, position in the link frame and position in the camera
/// frame, mm.
fn seen(
    positions_mm: &[[f64; 3]],
    markers: &[LinkMarker],
) -> impl Iterator<Item = (usize, ([f64; 2], [f64; 2]))> + Clone {
    markers.iter().enumerate().filter_map(|(i, marker)| {
        let [x, y, _] = positions_mm[marker.column];
        (!x.is_nan()).then_some((i, (marker.local_position_mm, [x, y])))
    })
}

/// Finds and corrects the rows in which one of a link's `markers` is mislabelled. `fits` must contain, for every row of
/// the file, the fit to all visible markers of the link; the corrected fits replace them.
pub(crate) fn correct_labels(file: &Recording, markers: &[LinkMarker], fits: &mut [LinkFit]) {
    let residuals = fits.iter().filter_map(|fit| Some(fit.pose()?.residual_mm));
    let median_mm = median_high(residuals.collect());
    if median_mm.is_nan() {
        return;
    }
    let tolerance_mm = (NOISE_MEDIANS * median_mm).clamp(TOLERANCE_MM.0, TOLERANCE_MM.1);
    let link = LinkMarkers { file, markers, tolerance_mm, usual_mm: USUAL_MEDIANS * median_mm };
    let mut unsure = Vec::new();
    for (row, fit) in fits.iter_mut().enumerate() {
        let Some(pose) = fit.pose() else { continue };
        let is_settled = if pose.residual_mm <= tolerance_mm {
            fit.seen.count_ones() >= 3
        } else {
            link.explain(row, fit)
        };
        if !is_settled {
            unsure.push(row);
        }
    }
    link.settle_by_motion(fits, &unsure);
}
