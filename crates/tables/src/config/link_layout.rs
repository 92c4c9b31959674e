//! Layout of a link in the configuration: three numbers for a marker, six for a rigid body.
//!
//! ```toml
//! M1 = [110.0, 35.0, 62.0]                        # marker: x, y, z, mm
//! middle = [20.0, 0.0, 55.0, 0.0, 0.0, 90.0]      # rigid body: x, y, z, mm; roll, pitch, yaw, degrees
//! ```
//!
//! The frame of a body results from that of the link by a translation to x, y, z and rotations about z (yaw), then about
//! the new y (pitch), then about the new x (roll).

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serializer};
use trilink_base::body;

/// Maximum deviation of four points from those of a rigid body, mm.
const TOLERANCE_MM: f64 = 1e-6;

/// Numbers of an entry: position of a marker, mm; or position of the origin of a rigid body, mm, and its roll, pitch and
/// yaw, rad.
enum Numbers {
    Marker([f64; 3]),
    Body([f64; 3], [f64; 3]),
}

impl<'de> Deserialize<'de> for Numbers {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct List;
        const NEEDED: &str = "a list of length 3 (x, y, z of a marker, mm) or 6 (x, y, z, mm, and roll, pitch, yaw, \
                              degrees, of a rigid body)";
        impl<'de> Visitor<'de> for List {
            type Value = Numbers;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str(NEEDED)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Numbers, A::Error> {
                let mut numbers = Vec::new();
                while let Some(number) = list.next_element::<f64>()? {
                    numbers.push(number);
                }
                match numbers[..] {
                    [x, y, z] => Ok(Numbers::Marker([x, y, z])),
                    [x, y, z, roll_deg, pitch_deg, yaw_deg] => Ok(Numbers::Body(
                        [x, y, z],
                        [roll_deg, pitch_deg, yaw_deg].map(f64::to_radians),
                    )),
                    _ => Err(A::Error::custom(format!(
                        "found a list of length {}, needed {NEEDED}",
                        numbers.len()
                    ))),
                }
            }
        }
        deserializer.deserialize_seq(List)
    }
}

/// Replaces rigid bodies by their points.
pub(super) fn deserialize<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<BTreeMap<String, [f64; 3]>, D::Error> {
    let written = BTreeMap::<String, Numbers>::deserialize(deserializer)?;
    let mut positions_mm = BTreeMap::new();
    for (label, numbers) in written {
        match numbers {
            Numbers::Marker(position_mm) => drop(positions_mm.insert(label, position_mm)),
            Numbers::Body(origin_mm, [roll, pitch, yaw]) => {
                let axes = body::turned([(2, yaw), (1, pitch), (0, roll)]);
                let points = body::points(origin_mm, &axes).into_iter().enumerate();
                positions_mm
                    .extend(points.map(|(i, position)| (body::point_label(&label, i), position)));
            }
        }
    }
    Ok(positions_mm)
}

/// Writes the points of a rigid body as its pose.
pub(super) fn serialize<S: Serializer>(
    layout: &BTreeMap<String, [f64; 3]>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(collapsed(layout))
}

/// Returns the name and the six numbers of the rigid body of which a label is a point; `None` if it is not or if the
/// points of the layout are not those of a rigid body.
fn body_of<'l>(layout: &BTreeMap<String, [f64; 3]>, label: &'l str) -> Option<(&'l str, Vec<f64>)> {
    let (name, _) = body::of_point(label)?;
    let points = (0..body::POINTS).map(|i| layout.get(&body::point_label(name, i)).copied());
    let points: [[f64; 3]; body::POINTS] = points.collect::<Option<Vec<_>>>()?.try_into().ok()?;
    let (origin_mm, axes) = body::pose(&points);
    let [roll, pitch, yaw] = body::roll_pitch_yaw(&axes);
    let rebuilt = body::points(origin_mm, &body::turned([(2, yaw), (1, pitch), (0, roll)]));
    let mut pairs = rebuilt.as_flattened().iter().zip(points.as_flattened());
    let is_rigid = pairs.all(|(a, b)| (a - b).abs() < TOLERANCE_MM);
    let angles_deg = [roll, pitch, yaw].map(f64::to_degrees);
    is_rigid.then(|| (name, [origin_mm, angles_deg].concat()))
}

/// Returns the entries of a link's layout as they are written: markers by three numbers, rigid bodies by six.
fn collapsed(layout: &BTreeMap<String, [f64; 3]>) -> Vec<(&str, Vec<f64>)> {
    let mut entries: Vec<(&str, Vec<f64>)> = Vec::new();
    for (label, position_mm) in layout {
        match body_of(layout, label) {
            Some((name, numbers)) => {
                if body::of_point(label).is_some_and(|(_, point)| point == 0) {
                    // Rounding errors of the points are far below these digits.
                    let rounded = numbers.iter().map(|x| (x * 1e9).round() / 1e9 + 0.0);
                    entries.push((name, rounded.collect()));
                }
            }
            None => entries.push((label, position_mm.to_vec())),
        }
    }
    entries
}

#[cfg(test)]
mod tests {
    use super::super::{Config, Markers};

    #[test]
    fn rigid_bodies_are_read_as_points_and_written_as_poses() {
        let text = "[link0]\nmiddle = [20.5, -1.25, 55.0, 1.5, -2.0, 90.0]\n[link1]\nF1 = [1.0, 2.0, 3.0]\n[link2]\n";
        let markers: Markers = toml::from_str(text).unwrap();
        assert_eq!(markers.link0.len(), 4);
        let centre = |axis: usize| markers.link0.values().map(|p| p[axis]).sum::<f64>() / 4.0;
        assert!((centre(0) - 20.5).abs() < 1e-12 && (centre(1) + 1.25).abs() < 1e-12);
        let written = toml::to_string(&markers).unwrap();
        assert!(written.contains("middle = [20.5, -1.25, 55.0, 1.5, -2.0, 90.0]"), "{written}");
        assert_eq!(toml::from_str::<Markers>(&written).unwrap(), markers);
        let error = toml::from_str::<Markers>(&text.replace(", 90.0", "")).unwrap_err();
        assert!(
            error.message().contains("found a list of length 5, needed a list of length 3"),
            "{error}"
        );
        // A layout without bodies is written as it was.
        let config = Config::default().markers;
        let written = toml::to_string(&config).unwrap();
        assert_eq!(toml::from_str::<Markers>(&written).unwrap(), config);
    }
}
