//! JSON data of a replay for the page's script, with all motion data as integers.

use std::borrow::Cow;

use serde::Serialize;
use serde_json::{Value, json};
use trilink_base::text::escape_controls;

use super::body::{self, Lengths};
use super::{Coordinates, Direction, Mark, Marker, Motion, Replay};

/// Number of steps per SI unit (m, rad, s); values are stored as whole numbers of steps.
pub(super) const PER_UNIT: f64 = 1e4;
/// Number of steps per millimetre (see [`PER_UNIT`]).
pub(super) const PER_MM: f64 = 1e-3 * PER_UNIT;

/// Rounds a value in SI units to a whole number of steps (see [`PER_UNIT`]); returns `None` if the value is unknown or
/// implausibly large.
pub(super) fn whole(value: f64) -> Option<i64> {
    let value = (PER_UNIT * value).round();
    (value.abs() < 1e12).then_some(value as i64)
}

/// Returns the difference between each value and the last known value before it (0 for the first), in steps (see
/// [`PER_UNIT`]); `None` for unknown values.
fn differences(values: impl Iterator<Item = f64>) -> Vec<Option<i64>> {
    let mut last = 0;
    values
        .map(|value| {
            let value = whole(value)?;
            Some(value - std::mem::replace(&mut last, value))
        })
        .collect()
}

/// Content of the JSON data from which the script of a page animates a replay.
#[derive(Serialize)]
struct Numbers<'r> {
    per_unit: f64,
    #[serde(flatten)]
    lengths: Lengths,
    time: Vec<Option<i64>>,
    motions: Vec<Value>,
    quantities: Vec<Value>,
    /// Link, position (in units of 0.1 mm) and label of each marker.
    markers: Vec<(usize, [i64; 2], Cow<'r, str>)>,
    /// First frame, last frame, marker index, and a flag that is 1 if the marker was corrected and 0 if it is missing.
    marks: Vec<(usize, usize, usize, u8)>,
    /// Number, start (s) and period (s) of the first cycle; `None` if there are no cycles.
    cycles: Option<(i64, f64, f64)>,
}

/// Returns the replay as JSON that can be embedded in a page. `arrows` contains, for each quantity, the arrow length
/// (m) per SI unit of the quantity, or `None` if no arrow is drawn.
pub(super) fn json(replay: &Replay, arrows: &[Option<f64>]) -> String {
    let motion = |motion: &Motion| {
        let of = |value: &dyn Fn(&Coordinates) -> f64| {
            differences(motion.poses.iter().map(|pose| pose.as_ref().map_or(f64::NAN, value)))
        };
        let joints = 0..replay.robot.joints.len();
        json!({
            "name": motion.name,
            "x": of(&|(pose, _)| pose.x_m),
            "y": of(&|(pose, _)| pose.y_m),
            "theta": of(&|(pose, _)| pose.theta_rad),
            "phi": joints.map(|joint| of(&|(_, phi_rad)| phi_rad[joint])).collect::<Vec<_>>(),
        })
    };
    fn marker(Marker { link, label, position_mm }: &Marker) -> (usize, [i64; 2], Cow<'_, str>) {
        (*link, position_mm.map(|mm| (PER_MM * mm).round() as i64), escape_controls(label))
    }
    let numbers = Numbers {
        per_unit: PER_UNIT,
        lengths: body::lengths(&replay.robot),
        time: differences(replay.time_s.iter().copied()),
        motions: replay.motions.iter().map(motion).collect(),
        quantities: replay
            .quantities
            .iter()
            .zip(arrows)
            .map(|(quantity, arrow)| {
                let values =
                    quantity.values.iter().map(|values| differences(values.iter().copied()));
                json!({
                    "name": quantity.name,
                    "unit": quantity.unit,
                    "units": quantity.units,
                    "decimals": quantity.decimals,
                    "values": values.collect::<Vec<_>>(),
                    "across": quantity.arrow == Some(Direction::Across),
                            "arrow": arrow,
                })
            })
            .collect(),
        markers: replay.markers.iter().map(marker).collect(),
        marks: replay
            .marks
            .iter()
            .map(|Mark { frames: [from, to], marker, is_corrected }| {
                (*from, *to, *marker, u8::from(*is_corrected))
            })
            .collect(),
        cycles: replay.cycles.map(|cycles| (cycles.number, cycles.start_s, cycles.period_s)),
    };
    // Escaping `<` prevents the JSON from ending the script element that contains it.
    serde_json::to_string(&numbers).unwrap_or_default().replace('<', "\\u003c")
}
