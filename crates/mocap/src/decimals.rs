//! Detects numbers that lost their decimal point: a spreadsheet with decimal commas mistakes the point in `-276.716`
//! for a thousands separator, but not the point in `603.46`.

use super::{FileProblem, Recording};

/// Factor by which numbers without their decimal point are too large: a point followed by exactly three digits is
/// mistaken for a thousands separator.
const FACTOR: f64 = 1000.0;
/// Relative tolerance within which a coordinate divided by [`FACTOR`] counts as equal to the same coordinate in another
/// frame.
const SAME: f64 = 0.05;
/// Absolute tolerance within which a coordinate divided by [`FACTOR`] counts as equal to the same coordinate in another
/// frame, mm.
const SAME_MM: f64 = 2.0;
/// Minimum magnitude of a number that can be recognised as lacking its decimal point, mm.
const MIN_MM: f64 = 10.0 * FACTOR;
/// Minimum number of apparently missing decimal points at which chance is ruled out as their cause.
const MIN_FOUND: usize = 3;

/// Returns an error if some numbers in a file lost their decimal points.
pub(super) fn check(file: &Recording) -> Result<(), FileProblem> {
    if !file.positions_mm.as_flattened().iter().any(|x| x.abs() >= MIN_MM) {
        return Ok(());
    }
    let axes = 3 * file.labels.len();
    // Last number and the row in which it occurs, for each axis.
    let mut last: Vec<(f64, usize)> = vec![(f64::NAN, 0); axes];
    let mut found = 0;
    // Example from the first affected axis, so that similar files give the same message.
    let mut example: Option<(usize, usize, f64, (f64, usize))> = None;
    for row in 0..file.frames.len() {
        let numbers = file.row_mm(row).as_flattened();
        for (axis, (&number, last)) in numbers.iter().zip(&mut last).enumerate() {
            if number.is_nan() {
                continue;
            }
            if is_lost(number, last.0) || is_lost(last.0, number) {
                found += 1;
                if example.is_none_or(|(other, ..)| axis < other) {
                    example = Some((axis, row, number, *last));
                }
            }
            *last = (number, row);
        }
    }
    let Some((axis, row, number, (before, row_before))) = example.filter(|_| found >= MIN_FOUND)
    else {
        return Ok(());
    };
    let name = ["X", "Y", "Z"][axis % 3];
    let label = &file.labels[axis / 3];
    let frames = &file.frames;
    let found = format!(
        "numbers that lost their decimal point: {label} {name} is {before} in frame {} and {number} in \
         frame {}",
        frames[row_before], frames[row]
    );
    let needed = "the numbers as they were exported: a spreadsheet with decimal commas took the points for thousands \
                  separators; export the file again, and if you open it in a spreadsheet, import all cells as text";
    Err(FileProblem::new(found, needed))
}

/// Returns whether `number` is an integer that, divided by [`FACTOR`], approximately equals `other`, so that `number`
/// may lack its decimal point.
#[inline]
fn is_lost(number: f64, other: f64) -> bool {
    number.abs() >= MIN_MM && number.fract() == 0.0 && {
        let meant = number / FACTOR;
        (meant - other).abs() < SAME_MM.max(SAME * meant.abs())
    }
}
