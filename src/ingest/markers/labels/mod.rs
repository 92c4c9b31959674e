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
mod outlier;
#[cfg(test)]
mod tests;

pub use outlier::{LinkFit, Outlier};

use super::layout::LinkMarker;
use crate::stats::median_high;
use crate::vicon::MarkerFile;
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

/// Finds the rows in which a marker of the link is mislabelled, and corrects them: `fits` are those
/// of all its markers in every row of the file.
pub fn correct_labels(file: &MarkerFile, markers: &[LinkMarker], fits: &mut [LinkFit]) {
    let residuals = fits.iter().filter_map(|fit| Some(fit.pose?.residual_mm));
    let median_mm = median_high(residuals.collect());
    if median_mm.is_nan() {
        return;
    }
    let tolerance_mm = (MEDIANS * median_mm).clamp(TOLERANCE_MM.0, TOLERANCE_MM.1);
    let link = LinkMarkers { file, markers, tolerance_mm, usual_mm: USUAL_MEDIANS * median_mm };
    let mut unsure = Vec::new();
    for (row, fit) in fits.iter_mut().enumerate() {
        let Some(pose) = fit.pose else { continue };
        let is_settled = match pose.residual_mm <= tolerance_mm {
            true => fit.seen >= 3,
            false => link.explain(row, fit),
        };
        if !is_settled {
            unsure.push(row);
        }
    }
    link.settle_by_motion(fits, &unsure);
}
