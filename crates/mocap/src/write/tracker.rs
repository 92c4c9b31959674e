//! Writes the `Objects` section of a CSV export of Vicon Tracker; `crate::header` describes the layout.

use std::fmt::Write as _;

use trilink_base::body;

use crate::Recording;
use crate::rotation::vector_rad;

/// Encodes the rigid bodies of a recording as rotation vectors, rad, and positions, mm, with six decimals; cells are
/// empty where a body was not tracked.
pub(super) fn bytes(recording: &Recording) -> Vec<u8> {
    let bodies = recording.bodies();
    let rate_hz = recording.rate_hz.map(|rate_hz| rate_hz.to_string()).unwrap_or_default();
    let mut text = format!("Objects\r\n{rate_hz}\r\n,");
    for first in &bodies {
        let name = body::name(&recording.labels[*first]);
        write!(text, ",{name},,,,,").expect("memory");
    }
    text.push_str("\r\nFrame,Sub Frame");
    text.push_str(&",RX,RY,RZ,TX,TY,TZ".repeat(bodies.len()));
    text.push_str("\r\n,");
    text.push_str(&",rad,rad,rad,mm,mm,mm".repeat(bodies.len()));
    text.push_str("\r\n");
    for (row, frame) in recording.frames.iter().enumerate() {
        write!(text, "{frame},0").expect("memory");
        for &first in &bodies {
            let (origin_mm, axes) = recording.pose(row, first);
            for x in vector_rad(&axes).into_iter().chain(origin_mm) {
                text.push(',');
                if x.is_finite() {
                    write!(text, "{x:.6}").expect("memory");
                }
            }
        }
        text.push_str("\r\n");
    }
    text.into_bytes()
}
