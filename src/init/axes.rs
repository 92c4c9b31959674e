//! Files in which another axis than z points up.

use trilink_ingest::other_axis_up;
use trilink_mocap::Recording;
use trilink_statistics::{mean, median, quantiles_low};

use super::clusters;

/// Along the axis that points up markers stay this level, mm.
const LEVEL_MM: f64 = 15.0;
/// More than markers of a robot on the floor rise and fall, mm.
const RISE_MM: f64 = 50.0;

/// Another axis than z that points up.
pub(super) struct Upwards {
    /// Whether the robot's links are seen across that axis, so that it is beyond doubt.
    pub shows_links: bool,
    /// What it is, and what to do.
    pub sentence: String,
}

impl Upwards {
    /// `None` if z may point up.
    pub(super) fn of(file: &Recording) -> Option<Self> {
        let is_level = |axis: &usize| ranges_mm(file, *axis) < LEVEL_MM;
        let [axis] = [0, 1].into_iter().filter(is_level).collect::<Vec<_>>()[..] else {
            return None;
        };
        if ranges_mm(file, 2).is_nan() || ranges_mm(file, 2) < RISE_MM {
            return None;
        }
        let mut turned = file.clone();
        turned.turn_up(axis);
        let shows_links = clusters::links(&turned).is_ok();
        let height = mean(positions(&turned, 2));
        let (sign, name) = (if height < 0.0 { "-" } else { "" }, ["x", "y"][axis]);
        let across = match shows_links {
            true => "move as three links across it",
            false => "rise and fall along z",
        };
        Some(Self { shows_links, sentence: other_axis_up(&format!("{sign}{name}"), across) })
    }
}

fn positions(file: &Recording, axis: usize) -> impl Iterator<Item = f64> {
    let rows = (0..file.frames.len()).flat_map(|row| file.row_mm(row));
    rows.map(move |position| position[axis]).filter(|x| !x.is_nan())
}

/// Median over the markers of how far each moves along an axis, mm.
fn ranges_mm(file: &Recording, axis: usize) -> f64 {
    let range = |marker: usize| {
        let along = (0..file.frames.len()).map(|row| file.position_mm(row, marker)[axis]);
        let [low, high] = quantiles_low(along.filter(|x| !x.is_nan()).collect(), [0.02, 0.98]);
        high - low
    };
    median((0..file.labels.len()).map(range).filter(|range| !range.is_nan()).collect())
}
