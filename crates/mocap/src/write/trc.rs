//! Writes TRC files; `crate::trc` describes the layout.

use std::fmt::Write as _;

use super::time_s;
use crate::Recording;

/// Encodes the recording of a trial as TRC, in mm with four decimals; cells are empty where a marker is occluded.
pub fn trc_bytes(trial: &str, recording: &Recording) -> Vec<u8> {
    let Recording { frames, labels, .. } = recording;
    let [rows, markers] = [frames.len(), labels.len()];
    let rate_hz = recording.rate_hz.map(|rate_hz| rate_hz.to_string()).unwrap_or_default();
    let first = frames.first().copied().unwrap_or(1);
    let mut text = format!(
        "PathFileType\t4\t(X/Y/Z)\t{trial}.trc\n\
         DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n\
         {rate_hz}\t{rate_hz}\t{rows}\t{markers}\tmm\t{rate_hz}\t{first}\t{rows}\nFrame#\tTime\t"
    );
    // Every line ends with a tab: OpenSim recognises a missing last cell only if a tab follows it.
    labels.iter().for_each(|label| text.extend([label, "\t\t\t"]));
    text.push_str("\n\t\t");
    for nth in 1..=markers {
        write!(text, "X{nth}\tY{nth}\tZ{nth}\t").expect("memory");
    }
    text.push_str("\n\n");
    for (row, frame) in frames.iter().enumerate() {
        write!(text, "{frame}\t{:.6}\t", time_s(recording, row)).expect("memory");
        for x in recording.row_mm(row).as_flattened() {
            if x.is_finite() {
                write!(text, "{x:.4}").expect("memory");
            }
            text.push('\t');
        }
        text.push('\n');
    }
    text.into_bytes()
}
