//! Label correction: frames in which a marker of a link is where it cannot be, one that has jumped
//! to something else (a ghost marker), or two whose labels are swapped.
//!
//! Three markers of a link or more check each other. If they do not lie as in the layout, an
//! explanation is looked for, in this order: two of the labels are swapped (which explains all
//! the markers), or one marker has jumped (which explains all but it). Two markers that agree
//! on their distance do not check each other: they may be swapped, or one of them may have
//! moved about the other. Such frames are compared with where the link was shortly before or
//! after, and so are those with several explanations. What that does not settle is ambiguous:
//! the frame's pose of the link is thrown out, and a gap left.

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

/// A residual of this many times the link's median residual is no noise. Of three markers with
/// normal noise, one frame in ten million has such a residual.
const MEDIANS: f64 = 5.0;
/// What counts as noise at least, and at most, whatever the median is, mm: markers that agree
/// better than the first are sound, and labels that are swapped in all frames lie above the
/// second.
const TOLERANCE_MM: (f64, f64) = (0.8, 5.0);
/// A residual below this many medians is how the link always looks: it is the layout that is
/// wrong, not the frame.
const USUAL_MEDIANS: f64 = 2.0;

/// What was wrong with the markers of a link in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outlier {
    None,
    /// One marker is left out, by its index in the link's layout.
    Jumped(u16),
    /// Two labels are swapped back, by their indices in the link's layout.
    Swapped(u16, u16),
    /// The markers contradict each other or the link's motion, and it is not clear which is wrong.
    Ambiguous,
}

impl Outlier {
    /// Its kind.
    pub fn fault(self) -> LabelFault {
        match self {
            Self::None => LabelFault::None,
            Self::Jumped(_) => LabelFault::Jumped,
            Self::Swapped(..) => LabelFault::Swapped,
            Self::Ambiguous => LabelFault::Ambiguous,
        }
    }

    /// The markers that are left out or swapped back: a bit for each by its index in the layout.
    pub fn markers(self) -> u64 {
        match self {
            Self::None | Self::Ambiguous => 0,
            Self::Jumped(index) => bit(index),
            Self::Swapped(one, other) => bit(one) | bit(other),
        }
    }
}

/// A marker in a set of them: a bit, by its index in the link's layout.
pub(crate) fn bit(index: u16) -> u64 {
    1_u64.checked_shl(index.into()).unwrap_or_default()
}

/// One link in one row of the file. Of a long recording there are millions, so what a
/// [`LinkPose`] has beside its pose is kept as the set of its markers.
#[derive(Debug, Clone, Copy)]
pub struct LinkFit {
    is_posed: bool,
    /// Without meaning where there is no pose, as what follows.
    origin_mm: [f64; 2],
    theta_rad: f64,
    residual_mm: f64,
    centre_mm: [f64; 2],
    turning_mm2: f64,
    /// The markers that were seen: a bit for each by its index in the link's layout.
    pub seen: u64,
    outlier: Outlier,
}

impl LinkFit {
    /// The fit of all of the link's markers that were seen in a row.
    pub fn of(positions_mm: &[[f64; 3]], markers: &[LinkMarker]) -> Self {
        let seen = seen(positions_mm, markers);
        let pose = rigid::fit(seen.clone().map(|(_, pair)| pair));
        Self::new(seen.map(|(index, _)| bit(index as u16)).sum(), pose, Outlier::None)
    }

    /// Of the markers `seen`; the pose is of those that are not left out.
    pub fn new(seen: u64, pose: Option<LinkPose>, outlier: Outlier) -> Self {
        let is_posed = pose.is_some();
        let LinkPose { origin_mm, theta_rad, residual_mm, moments } = pose.unwrap_or_default();
        let MarkerMoments { centre_mm, turning_mm2, .. } = moments;
        Self { is_posed, origin_mm, theta_rad, residual_mm, centre_mm, turning_mm2, seen, outlier }
    }

    /// Missing if the markers that were seen give none.
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

    /// Whether there is a pose.
    pub(crate) fn is_posed(&self) -> bool {
        self.is_posed
    }

    /// Whether there is a pose and nothing was wrong.
    pub(crate) fn is_sound(&self) -> bool {
        self.is_posed && self.outlier == Outlier::None
    }

    /// Gives it another pose, and what is wrong with its markers.
    pub fn set(&mut self, pose: Option<LinkPose>, outlier: Outlier) {
        *self = Self::new(self.seen, pose, outlier);
    }
}

/// Index of every marker of a link that was seen in a row, with its positions in the link's own
/// frame and in the cameras'.
fn seen(
    positions_mm: &[[f64; 3]],
    markers: &[LinkMarker],
) -> impl Iterator<Item = (usize, ([f64; 2], [f64; 2]))> + Clone {
    markers.iter().enumerate().filter_map(|(i, marker)| {
        let [x, y, _] = positions_mm[marker.column];
        (!x.is_nan()).then_some((i, (marker.local_position_mm, [x, y])))
    })
}

/// Finds the rows in which a marker of the link is mislabelled, and corrects them: `fits` are those
/// of all its markers in every row of the file.
pub(crate) fn correct_labels(file: &Recording, markers: &[LinkMarker], fits: &mut [LinkFit]) {
    let residuals = fits.iter().filter_map(|fit| Some(fit.pose()?.residual_mm));
    let median_mm = median_high(residuals.collect());
    if median_mm.is_nan() {
        return;
    }
    let tolerance_mm = (MEDIANS * median_mm).clamp(TOLERANCE_MM.0, TOLERANCE_MM.1);
    let link = LinkMarkers { file, markers, tolerance_mm, usual_mm: USUAL_MEDIANS * median_mm };
    let mut unsure = Vec::new();
    for (row, fit) in fits.iter_mut().enumerate() {
        let Some(pose) = fit.pose() else { continue };
        let is_settled = match pose.residual_mm <= tolerance_mm {
            true => fit.seen.count_ones() >= 3,
            false => link.explain(row, fit),
        };
        if !is_settled {
            unsure.push(row);
        }
    }
    link.settle_by_motion(fits, &unsure);
}
