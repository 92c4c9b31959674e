//! Writes the `Trajectories` section of a CSV export.

use std::io::Write;

use crate::Recording;

/// Encodes a recording as Nexus 2 exports its `Trajectories` to CSV: six significant digits, mm, and empty cells where
/// a marker is occluded.
pub fn csv_bytes(markers: &Recording) -> Vec<u8> {
    let mut export = Vec::with_capacity(markers.positions_mm.len() * 28);
    header(&mut export, markers);
    for (row, frame) in markers.frames.iter().enumerate() {
        write!(export, "{frame},0").expect("memory");
        for position in markers.row_mm(row) {
            if position[0].is_nan() {
                export.extend_from_slice(b",,,");
                continue;
            }
            for x in position {
                export.push(b',');
                push_six_digits(&mut export, *x);
            }
        }
        export.extend_from_slice(b"\r\n");
    }
    export
}

/// Appends the header rows: title, rate (empty if unknown), labels, axes and units.
fn header(export: &mut Vec<u8>, markers: &Recording) {
    let mut labels = String::from(",,");
    let mut axes = String::from("Frame,Sub Frame");
    let mut units = String::from(",");
    for label in &markers.labels {
        labels += &format!("{label},,,");
        axes += ",X,Y,Z";
        units += ",mm,mm,mm";
    }
    let rate_hz = markers.rate_hz.map(|rate_hz| rate_hz.to_string()).unwrap_or_default();
    let lines = format!("Trajectories\r\n{rate_hz}\r\n{labels}\r\n{axes}\r\n{units}\r\n");
    export.extend_from_slice(lines.as_bytes());
}

/// Appends a number as formatted by `%g` in C: six significant digits, no trailing zeros.
fn push_six_digits(export: &mut Vec<u8>, x: f64) {
    let begin = export.len();
    write!(export, "{x:.5e}").expect("memory");
    let rounded: f64 = fast_float2::parse(&export[begin..]).expect("a number");
    export.truncate(begin);
    // Camera systems write coordinates below a hundredth of a micrometre as zero.
    let seen = if rounded.abs() < 1e-5 { 0.0 } else { rounded };
    write!(export, "{seen}").expect("memory");
}

#[cfg(test)]
mod tests {
    use super::push_six_digits;

    #[test]
    fn numbers_are_written_as_nexus_writes_them() {
        for (x, text) in [
            (1234.5678, "1234.57"),
            (-276.862, "-276.862"),
            (9.9999996, "10"),
            (0.001234567, "0.00123457"),
            (100.0, "100"),
            (0.0, "0"),
            (-1e-7, "0"),
        ] {
            let mut export = Vec::new();
            push_six_digits(&mut export, x);
            assert_eq!(String::from_utf8(export).unwrap(), text);
        }
    }
}
