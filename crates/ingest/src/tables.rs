//! Builds a trial's tables.

use std::collections::BTreeMap;

use trilink_base::body;
use trilink_tables::config::Markers;
use trilink_tables::{
    Clock, Coordinates, FrameTexts, Frames as _, LABELS_APART, PoseFrames, Table,
};

use super::markers::labels::{Outlier, bit};
use super::poses::Tracked;

/// Builds the table for the file `poses/<trial>.parquet`.
pub(super) fn poses(
    trial: &str,
    tracked: Tracked,
    coordinates: Coordinates,
    markers: &Markers,
    rate_hz: f64,
) -> Table {
    let Tracked { first_frame, seen, filled, residual_mm, fill, outlier, unseen, .. } = tracked;
    // For a long recording these series take up hundreds of megabytes.
    drop((seen, filled));
    let layouts = markers.links();
    let unseen = [0, 1, 2].map(|link| labels(layouts[link], unseen[link].iter().copied()));
    let corrected = [0, 1, 2]
        .map(|link| labels(layouts[link], outlier[link].iter().map(|found| found.markers())));
    let outlier = outlier.map(|found| found.into_iter().map(Outlier::fault).collect());
    let clock = Clock::new(first_frame, coordinates.frames(), rate_hz);
    PoseFrames { clock, coordinates, residual_mm, fill, outlier, unseen, corrected }
        .into_table(trial)
}

/// Returns, for each set of a link's markers in `markers`, the text that names them and the rigid bodies. Each bit of a set stands for the
/// marker with that index in the layout.
fn labels(layout: &BTreeMap<String, [f64; 3]>, markers: impl Iterator<Item = u64>) -> FrameTexts {
    FrameTexts::new(markers, |bits| {
        let labels = (0..).zip(layout.keys());
        let named = labels.filter(|(index, _)| bits & bit(*index) != 0);
        let mut named: Vec<&str> = named.map(|(_, label)| body::name(label)).collect();
        named.dedup();
        named.join(LABELS_APART)
    })
}
