//! Builds a trial's tables.

use trilink_base::body;
use trilink_tables::{
    Clock, Coordinates, FrameTexts, Frames as _, LABELS_APART, Numbered, PoseFrames, Table,
};

use super::markers::labels::{Outlier, bit};
use super::poses::Tracked;

/// Builds the table for the file `poses/<trial>.parquet`, given the labels of each link's markers.
pub(super) fn poses(
    trial: &str,
    tracked: Tracked,
    coordinates: Coordinates,
    labels_of: &[Vec<String>],
    rate_hz: f64,
) -> Table {
    let Tracked { first_frame, seen, filled, residual_mm, fill, outlier, unseen, .. } = tracked;
    // For a long recording these series take up hundreds of megabytes.
    drop((seen, filled));
    let links = labels_of.iter().zip(&unseen);
    let unseen = links.map(|(names, markers)| labels(names, markers.iter().copied())).collect();
    let links = labels_of.iter().zip(&outlier);
    let corrected = links
        .map(|(names, found)| labels(names, found.iter().map(|found| found.markers())))
        .collect();
    let faults = outlier.into_iter().map(|found| found.into_iter().map(Outlier::fault).collect());
    let outlier = faults.collect();
    let (residual_mm, fill) = (Numbered(residual_mm), Numbered(fill));
    let clock = Clock::new(first_frame, coordinates.frames(), rate_hz);
    PoseFrames { clock, coordinates, residual_mm, fill, outlier, unseen, corrected }
        .into_table(trial)
}

/// Returns, for each set of a link's markers in `markers`, the text that names them and the rigid bodies. Each bit of a set stands for the
/// marker with that index in the layout.
fn labels(names: &[String], markers: impl Iterator<Item = u64>) -> FrameTexts {
    FrameTexts::new(markers, |bits| {
        let labels = (0..).zip(names);
        let named = labels.filter(|(index, _)| bits & bit(*index) != 0);
        let mut named: Vec<&str> = named.map(|(_, label)| body::name(label)).collect();
        named.dedup();
        named.join(LABELS_APART)
    })
}
