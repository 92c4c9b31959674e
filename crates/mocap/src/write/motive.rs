//! Writes CSV files as OptiTrack Motive exports markers; `crate::motive` describes the layout.

use std::fmt::Write as _;

use super::time_s;
use crate::Recording;

/// Encodes the recording of a trial in m with six decimals and y up; cells are empty where a marker is occluded.
pub(super) fn bytes(trial: &str, recording: &Recording) -> Vec<u8> {
    let Recording { frames, labels, .. } = recording;
    let rows = frames.len();
    let rate_hz = recording.rate_hz.map(|rate_hz| format!("{rate_hz:.6}")).unwrap_or_default();
    let mut text = format!(
        "Format Version,1.23,Take Name,{trial},Capture Frame Rate,{rate_hz},Export Frame Rate,{rate_hz},Total \
         Frames in Take,{rows},Total Exported Frames,{rows},Rotation Type,Quaternion,Length Units,Meters,Coordinate \
         Space,Global\r\n\r\n"
    );
    let mut row = |first: &str, cells: &dyn Fn(&str, usize) -> String| {
        text.push_str(first);
        for (marker, label) in labels.iter().enumerate() {
            text.push_str(&cells(label, marker).repeat(3));
        }
        text.push_str("\r\n");
    };
    row(",", &|_, _| ",Marker".to_owned());
    row(",", &|label, _| format!(",{label}"));
    row(",", &|_, marker| format!(",{}", marker + 1));
    row(",", &|_, _| ",Position".to_owned());
    text.push_str("Frame,Time (Seconds)");
    text.push_str(&",X,Y,Z".repeat(labels.len()));
    text.push_str("\r\n");
    for (row, frame) in frames.iter().enumerate() {
        write!(text, "{frame},{:.6}", time_s(recording, row)).expect("memory");
        for [x, y, z] in recording.row_mm(row) {
            // Motive has y up; a cyclic permutation keeps the axes right-handed.
            for x in [y, z, x] {
                text.push(',');
                if x.is_finite() {
                    write!(text, "{:.6}", 1e-3 * x).expect("memory");
                }
            }
        }
        text.push_str("\r\n");
    }
    text.into_bytes()
}
