//! Frames in which a marker of a link is where it cannot be: one that has jumped to something
//! else, or two whose labels are swapped.
//!
//! Three markers of a link or more check each other. If they do not lie as the layout says, an
//! explanation is looked for, in this order: two of the labels are swapped (which explains all
//! the markers), or one marker has jumped (which explains all but it). Two markers that agree
//! on their distance do not check each other: they may be swapped, or one of them may have
//! moved about the other. Such frames are compared with where the link was shortly before or
//! after, and so are those with several explanations. What that does not settle is ambiguous:
//! the frame's pose of the link is thrown out, and a gap left.

mod explain;
mod follow;
mod outlier;
#[cfg(test)]
mod tests;

pub use outlier::{LinkFit, Outlier};

use super::layout::LinkMarker;
use crate::stats::median_high;
use crate::vicon::MarkerFile;
use explain::Link;

/// A residual of this many times the link's median residual is no noise. Of three markers with
/// normal noise, one frame in ten million has such a residual.
const MEDIANS: f64 = 5.0;
/// What counts as noise at least, and at most, whatever the median says, mm: markers that agree
/// better than the first are sound, and labels that are swapped in all frames lie above the
/// second.
const TOLERANCE_MM: (f64, f64) = (0.8, 5.0);
/// A residual below this many medians is how the link always looks: it is the layout that is
/// wrong, not the frame.
const USUAL_MEDIANS: f64 = 2.0;

/// Finds the rows in which a marker of the link is wrong, and mends them: `fits` are those of
/// all its markers in every row of the file.
pub fn mend(file: &MarkerFile, markers: &[LinkMarker], fits: &mut [LinkFit]) {
    let Some(median_mm) = median_residual(fits) else { return };
    let tolerance_mm = (MEDIANS * median_mm).clamp(TOLERANCE_MM.0, TOLERANCE_MM.1);
    let link = Link { file, markers, tolerance_mm, usual_mm: USUAL_MEDIANS * median_mm };
    let mut unsure = Vec::new();
    for (row, fit) in fits.iter_mut().enumerate() {
        let Some(pose) = fit.pose else { continue };
        if pose.residual_mm <= tolerance_mm {
            if fit.seen < 3 {
                unsure.push(row);
            }
        } else if !link.explain(row, fit) {
            unsure.push(row);
        }
    }
    if !unsure.is_empty() {
        link.follow(fits, &unsure);
    }
}

fn median_residual(fits: &[LinkFit]) -> Option<f64> {
    let residuals = fits.iter().filter_map(|fit| fit.pose).map(|pose| pose.residual_mm);
    Some(median_high(residuals.collect())).filter(|median| !median.is_nan())
}
