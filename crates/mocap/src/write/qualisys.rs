//! Writes TSV files as Qualisys Track Manager exports 3D and 6D data; `crate::qualisys` describes the layout.

use std::fmt::Write as _;

use trilink_base::body;

use super::time_s;
use crate::Recording;

/// Encodes a recording in mm with three decimals, with the header and the columns of frame and time; cells are empty
/// where a marker is occluded.
pub(super) fn bytes(recording: &Recording) -> Vec<u8> {
    let Recording { frames, labels, .. } = recording;
    let [rows, markers] = [frames.len(), labels.len()];
    let rate_hz = recording.rate_hz.map(|rate_hz| rate_hz.to_string()).unwrap_or_default();
    let mut text = format!(
        "NO_OF_FRAMES\t{rows}\nNO_OF_CAMERAS\t8\nNO_OF_MARKERS\t{markers}\nFREQUENCY\t{rate_hz}\nNO_OF_ANALOG\t0\n\
         ANALOG_FREQUENCY\t0\nDESCRIPTION\t--\nDATA_INCLUDED\t3D\nMARKER_NAMES\t{}\nFrame\tTime",
        labels.join("\t")
    );
    for label in labels {
        for axis in ["X", "Y", "Z"] {
            write!(text, "\t{label} {axis}").expect("memory");
        }
    }
    text.push('\n');
    for (row, frame) in frames.iter().enumerate() {
        write!(text, "{frame}\t{:.5}", time_s(recording, row)).expect("memory");
        for x in recording.row_mm(row).as_flattened() {
            text.push('\t');
            if x.is_finite() {
                write!(text, "{x:.3}").expect("memory");
            }
        }
        text.push('\n');
    }
    text.into_bytes()
}

/// Encodes the rigid bodies of a recording as 6D data: mm with three decimals, degrees and the rotation matrix with five
/// decimals; all numbers are 0 where a body was not tracked.
pub(super) fn body_bytes(recording: &Recording) -> Vec<u8> {
    let Recording { frames, labels, .. } = recording;
    let bodies = recording.bodies();
    let names: Vec<&str> = bodies.iter().map(|first| body::name(&labels[*first])).collect();
    let rate_hz = recording.rate_hz.map(|rate_hz| rate_hz.to_string()).unwrap_or_default();
    let mut text = format!(
        "NO_OF_FRAMES\t{}\nNO_OF_CAMERAS\t8\nNO_OF_BODIES\t{}\nFREQUENCY\t{rate_hz}\nNO_OF_ANALOG\t0\n\
         ANALOG_FREQUENCY\t0\nDESCRIPTION\t--\nDATA_INCLUDED\t6D\nBODY_NAMES\t{}\nFrame\tTime",
        frames.len(),
        bodies.len(),
        names.join("\t")
    );
    for name in names {
        write!(text, "\t{name} X\tY\tZ\tRoll\tPitch\tYaw\tResidual").expect("memory");
        (0..9).for_each(|i| write!(text, "\tRot[{i}]").expect("memory"));
    }
    text.push('\n');
    for (row, frame) in frames.iter().enumerate() {
        write!(text, "{frame}\t{:.5}", time_s(recording, row)).expect("memory");
        for &first in &bodies {
            let (origin_mm, axes) = recording.pose(row, first);
            let is_tracked = !origin_mm[0].is_nan();
            let or_zero = |x: f64| if is_tracked { x } else { 0.0 };
            let [roll, pitch, yaw] = body::roll_pitch_yaw(&axes).map(f64::to_degrees);
            for x in origin_mm.into_iter().chain([roll, pitch, yaw, 0.0]).map(or_zero) {
                write!(text, "\t{x:.3}").expect("memory");
            }
            for x in axes.as_flattened().iter().copied().map(or_zero) {
                write!(text, "\t{x:.5}").expect("memory");
            }
        }
        text.push('\n');
    }
    text.into_bytes()
}
