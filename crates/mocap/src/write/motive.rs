//! Writes CSV files as OptiTrack Motive exports markers or rigid bodies; `crate::motive` describes the layout.

use std::fmt::Write as _;

use trilink_base::body;

use super::time_s;
use crate::Recording;
use crate::rotation::quaternion;

/// Column of the table: type, name, what it contains, and axis.
type Column<'n> = [&'n str; 4];

/// Encodes the markers of a trial in m with six decimals and y up; cells are empty where a marker is occluded.
pub(super) fn bytes(trial: &str, recording: &Recording) -> Vec<u8> {
    let columns = recording
        .labels
        .iter()
        .flat_map(|label| ["X", "Y", "Z"].map(|axis| ["Marker", label.as_str(), "Position", axis]));
    let mut text = header(trial, recording, &columns.collect::<Vec<_>>());
    for row in 0..recording.frames.len() {
        let positions = recording.row_mm(row).iter().flat_map(|position| y_up(*position));
        push_row(&mut text, recording, row, positions.map(|mm| 1e-3 * mm));
    }
    text.into_bytes()
}

/// Encodes the rigid bodies of a trial as quaternions and positions in m, with six decimals and y up; cells are empty
/// where a body was not tracked.
pub(super) fn body_bytes(trial: &str, recording: &Recording) -> Vec<u8> {
    let bodies = recording.bodies();
    let columns = bodies.iter().flat_map(|first| {
        let name = body::name(&recording.labels[*first]);
        let turn = ["X", "Y", "Z", "W"].map(|axis| ["Rigid Body", name, "Rotation", axis]);
        let place = ["X", "Y", "Z"].map(|axis| ["Rigid Body", name, "Position", axis]);
        turn.into_iter().chain(place)
    });
    let mut text = header(trial, recording, &columns.collect::<Vec<_>>());
    for row in 0..recording.frames.len() {
        let poses = bodies.iter().flat_map(|&first| {
            let (origin_mm, [x, y, z]) = recording.pose(row, first);
            let [w, i, j, k] = quaternion(&[y, z, x].map(y_up));
            let [x, y, z] = y_up(origin_mm).map(|mm| 1e-3 * mm);
            [i, j, k, w, x, y, z]
        });
        push_row(&mut text, recording, row, poses);
    }
    text.into_bytes()
}

/// Turns coordinates from z up to y up; a cyclic permutation keeps the axes right-handed.
fn y_up([x, y, z]: [f64; 3]) -> [f64; 3] {
    [y, z, x]
}

fn header(trial: &str, recording: &Recording, columns: &[Column]) -> String {
    let rows = recording.frames.len();
    let rate_hz = recording.rate_hz.map(|rate_hz| format!("{rate_hz:.6}")).unwrap_or_default();
    let mut text = format!(
        "Format Version,1.23,Take Name,{trial},Capture Frame Rate,{rate_hz},Export Frame Rate,{rate_hz},Total \
         Frames in Take,{rows},Total Exported Frames,{rows},Rotation Type,Quaternion,Length Units,Meters,Coordinate \
         Space,Global\r\n\r\n"
    );
    let mut names: Vec<&str> = columns.iter().map(|[_, name, ..]| *name).collect();
    names.dedup();
    let number = |name: &str| 1 + names.iter().position(|other| *other == name).unwrap_or(0);
    let mut row = |first: &str, cell: &dyn Fn(&Column) -> String| {
        text.push_str(first);
        columns.iter().for_each(|column| text.extend([",", &cell(column)]));
        text.push_str("\r\n");
    };
    row(",", &|[kind, ..]| (*kind).to_owned());
    row(",", &|[_, name, ..]| (*name).to_owned());
    row(",", &|[_, name, ..]| number(name).to_string());
    row(",", &|[_, _, what, _]| (*what).to_owned());
    row("Frame,Time (Seconds)", &|[.., axis]| (*axis).to_owned());
    text
}

/// Appends the frame number, the time and the given numbers of a row.
fn push_row(
    text: &mut String,
    recording: &Recording,
    row: usize,
    numbers: impl Iterator<Item = f64>,
) {
    write!(text, "{},{:.6}", recording.frames[row], time_s(recording, row)).expect("memory");
    for x in numbers {
        text.push(',');
        if x.is_finite() {
            write!(text, "{x:.6}").expect("memory");
        }
    }
    text.push_str("\r\n");
}
