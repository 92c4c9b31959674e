//! Detection of files in which an axis other than z points up.

use trilink_ingest::axis_up_message;
use trilink_mocap::Recording;
use trilink_statistics::{mean, median, quantiles_low};

use super::clusters;

/// Maximum range of the markers' motion along an axis that may be vertical, mm.
const MAX_VERTICAL_RANGE_MM: f64 = 15.0;
/// Minimum range of the markers' motion along z that excludes z as the vertical axis, mm; a robot on the floor stays
/// below it.
const MIN_Z_RANGE_MM: f64 = 50.0;

/// Vertical axis of a marker file, if it is x or y instead of z.
pub(super) struct VerticalAxis {
    /// Whether the file shows the robot's links in the plane perpendicular to the axis; if so, the axis is certainly
    /// vertical.
    pub shows_links: bool,
    /// Sentence about the axis and what to do about it.
    pub sentence: String,
}

impl VerticalAxis {
    /// Detects a vertical axis other than z; returns `None` if z may be vertical.
    pub(super) fn detect(file: &Recording) -> Option<Self> {
        let level_axes =
            [0, 1].into_iter().filter(|axis| range_mm(file, *axis) < MAX_VERTICAL_RANGE_MM);
        let [axis] = level_axes.collect::<Vec<_>>()[..] else {
            return None;
        };
        if range_mm(file, 2).is_nan() || range_mm(file, 2) < MIN_Z_RANGE_MM {
            return None;
        }
        let mut turned = file.clone();
        turned.turn_up(axis);
        // In a wrong plane, two groups of markers may seem to have a joint by chance.
        let links =
            clusters::links(&turned).ok().map(|links| links.len()).filter(|count| *count > 2);
        let height = mean(positions(&turned, 2));
        let sign = if height < 0.0 { "-" } else { "" };
        let name = ["x", "y"][axis];
        let motion = match links {
            Some(3) => "the other two coordinates show three moving links",
            Some(_) => "the other two coordinates show moving links",
            None => "the z coordinates rise and fall",
        };
        let shows_links = links.is_some();
        Some(Self { shows_links, sentence: axis_up_message(&format!("{sign}{name}"), motion) })
    }
}

/// Returns the coordinates of all markers in all frames along an axis, mm.
fn positions(file: &Recording, axis: usize) -> impl Iterator<Item = f64> {
    let rows = (0..file.frames.len()).flat_map(|row| file.row_mm(row));
    rows.map(move |position| position[axis]).filter(|x| !x.is_nan())
}

/// Returns the range of motion along an axis, as the median over all markers, mm.
fn range_mm(file: &Recording, axis: usize) -> f64 {
    let ranges = (0..file.labels.len()).map(|marker| {
        let along = (0..file.frames.len()).map(|row| file.position_mm(row, marker)[axis]);
        let [low, high] = quantiles_low(along.filter(|x| !x.is_nan()).collect(), [0.02, 0.98]);
        high - low
    });
    median(ranges.filter(|range| !range.is_nan()).collect())
}
