//! Turns recordings of systems that export with y or z up, and do not state which, so that z points up.

use super::Recording;

/// Approximate number of rows from which the ranges of motion are estimated.
const ROWS: usize = 512;
/// Fraction of the positions at either end of a range that is left out as outlying.
const OUTLYING: f64 = 0.05;
/// Minimum ratio of the horizontal to the vertical range of motion at which the vertical axis is certain.
const MIN_RATIO: f64 = 2.0;

/// Turns a recording so that z points up. The axis along which the markers move less, y or z, pointed up; if they move
/// alike along both, it was `usual` (the index of an axis), with a note.
pub(super) fn turn_z_up(file: &mut Recording, usual: usize) {
    let [y_mm, z_mm] = [1, 2].map(|axis| largest_range_mm(file, axis));
    let up = if MIN_RATIO * y_mm < z_mm {
        1
    } else if MIN_RATIO * z_mm < y_mm {
        2
    } else {
        let used = ["x", "y", "z"][usual];
        file.doubts.push(format!(
            "vertical axis: found none (the markers move {y_mm:.1} mm along y and {z_mm:.1} mm along z), used {used}"
        ));
        usual
    };
    if up < 2 {
        file.turn_up(up);
    }
}

/// Returns the largest range of motion of a marker along an axis, mm; 0 if no marker is visible. Most markers may be at
/// rest, as when a single link of a robot swings.
fn largest_range_mm(file: &Recording, axis: usize) -> f64 {
    let stride = (file.frames.len() / ROWS).max(1);
    let ranges = (0..file.labels.len()).filter_map(|marker| {
        let along = (0..file.frames.len()).step_by(stride);
        let along = along.map(|row| file.position_mm(row, marker)[axis]);
        let mut seen: Vec<f64> = along.filter(|x| !x.is_nan()).collect();
        seen.sort_unstable_by(f64::total_cmp);
        let outlying = (OUTLYING * seen.len() as f64) as usize;
        Some(seen.get(seen.len().checked_sub(1 + outlying)?)? - seen.get(outlying)?)
    });
    ranges.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_marker_that_swings_horizontally_shows_the_vertical_axis() {
        let positions_mm = (0..100).flat_map(|frame| {
            let swing = 30.0 * (0.3 * f64::from(frame)).sin();
            let still = [0.2, 1.0 + 0.01 * f64::from(frame % 7), 62.0];
            [still, [10.0, 62.0, swing], still]
        });
        let labels = ["M1", "F1", "M2"].map(String::from).to_vec();
        let mut file =
            Recording::new(None, (0..100).collect(), labels, positions_mm.collect::<Vec<_>>());
        turn_z_up(&mut file, 2);
        assert_eq!((&file.position_mm(0, 1), &file.doubts[..]), (&[0.0, 10.0, 62.0], &[][..]));
    }
}
