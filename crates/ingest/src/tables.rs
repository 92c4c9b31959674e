//! Tables of one trial.

use std::collections::BTreeMap;

use trilink_tables::config::Markers;
use trilink_tables::{
    Clock, Coordinates, FrameTexts, Frames as _, LABELS_APART, PoseFrames, Table,
};

use super::markers::labels::{Outlier, bit};
use super::poses::Tracked;

/// `poses/<trial>.parquet`.
pub(super) fn poses(
    trial: &str,
    tracked: Tracked,
    coordinates: Coordinates,
    markers: &Markers,
    rate_hz: f64,
) -> Table {
    let Tracked { first_frame, seen, filled, residual_mm, fill, outlier, unseen, .. } = tracked;
    // Of a long recording they are hundreds of megabytes.
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

/// Labels of a link's markers, each a bit by its index in the layout.
fn labels(layout: &BTreeMap<String, [f64; 3]>, markers: impl Iterator<Item = u64>) -> FrameTexts {
    FrameTexts::of(markers, |bits| {
        let labels = (0..).zip(layout.keys());
        let named = labels.filter(|(index, _)| bits & bit(*index) != 0);
        named.map(|(_, label)| label.as_str()).collect::<Vec<_>>().join(LABELS_APART)
    })
}
