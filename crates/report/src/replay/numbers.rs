//! A replay as whole numbers, for the page's script.

use std::borrow::Cow;

use serde::Serialize;
use serde_json::{Value, json};
use trilink_base::text::harmless;

use super::{Coordinates, Direction, Mark, Marker, Motion, Quantity, Replay};

/// Whole numbers in an SI unit: a metre, a radian, a second.
pub(super) const PER_UNIT: f64 = 1e4;
/// Whole numbers in a millimetre.
pub(super) const PER_MM: f64 = 1e-3 * PER_UNIT;

/// The nearest whole number; none for what is not known or is no motion of a robot.
pub(super) fn whole(value: f64) -> Option<i64> {
    let value = (PER_UNIT * value).round();
    (value.abs() < 1e12).then_some(value as i64)
}

/// Every whole number less the last one that is known.
fn differences(values: impl Iterator<Item = f64>) -> Vec<Option<i64>> {
    let mut last = 0;
    let difference = |value: f64| {
        let value = whole(value)?;
        Some(value - std::mem::replace(&mut last, value))
    };
    values.map(difference).collect()
}

#[derive(Serialize)]
struct Numbers<'r> {
    per_unit: f64,
    half: Option<i64>,
    side: Option<i64>,
    time: Vec<Option<i64>>,
    motions: Vec<Value>,
    quantities: Vec<Value>,
    /// Link, place and label.
    markers: Vec<(usize, [i64; 2], Cow<'r, str>)>,
    /// First and last frame, marker, and whether it was corrected.
    marks: Vec<(usize, usize, usize, u8)>,
    /// Number of a cycle, its start and its length, s.
    cycles: Option<(i64, f64, f64)>,
}

/// As JSON that can stand in a page.
pub(super) fn json(replay: &Replay, arrows: &[Option<f64>]) -> String {
    let motion = |motion: &Motion| {
        let of = |value: fn(&Coordinates) -> f64| {
            differences(motion.poses.iter().map(|pose| pose.as_ref().map_or(f64::NAN, value)))
        };
        json!({
            "name": motion.name,
            "x": of(|(pose, _)| pose.x_m),
            "y": of(|(pose, _)| pose.y_m),
            "theta": of(|(pose, _)| pose.theta_rad),
            "phi": [of(|(_, phi_rad)| phi_rad[0]), of(|(_, phi_rad)| phi_rad[1])],
        })
    };
    let quantity = |(quantity, arrow): (&Quantity, &Option<f64>)| {
        let values = quantity.values.iter().map(|values| differences(values.iter().copied()));
        json!({
            "name": quantity.name,
            "unit": quantity.unit,
            "units": quantity.units,
            "decimals": quantity.decimals,
            "values": values.collect::<Vec<_>>(),
            "across": quantity.arrow == Some(Direction::Across),
            // Length of an arrow over the value, both as whole numbers.
            "arrow": arrow,
        })
    };
    fn marker(Marker { link, label, position_mm }: &Marker) -> (usize, [i64; 2], Cow<'_, str>) {
        (*link, position_mm.map(|mm| (PER_MM * mm).round() as i64), harmless(label))
    }
    let mark = |Mark { frames: [from, to], marker, is_corrected }: &Mark| {
        (*from, *to, *marker, u8::from(*is_corrected))
    };
    let numbers = Numbers {
        per_unit: PER_UNIT,
        half: whole(replay.robot.h_m),
        side: whole(replay.robot.l_m),
        time: differences(replay.time_s.iter().copied()),
        motions: replay.motions.iter().map(motion).collect(),
        quantities: replay.quantities.iter().zip(arrows).map(quantity).collect(),
        markers: replay.markers.iter().map(marker).collect(),
        marks: replay.marks.iter().map(mark).collect(),
        cycles: replay.cycles.map(|cycles| (cycles.number, cycles.start_s, cycles.period_s)),
    };
    // Nothing can end the element that it stands in.
    serde_json::to_string(&numbers).unwrap_or_default().replace('<', "\\u003c")
}
