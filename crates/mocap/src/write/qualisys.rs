//! Writes TSV files as Qualisys Track Manager exports 3D data; `crate::qualisys` describes the layout.

use std::fmt::Write as _;

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
