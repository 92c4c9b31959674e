//! Numbers that lost their decimal point: a spreadsheet with decimal commas takes the point of
//! `-276.716` for one of thousands, and leaves that of `603.46`.

use super::{FileProblem, Recording};

/// Digits that stand after a point that is taken for one of thousands: three.
const FACTOR: f64 = 1000.0;
/// Tolerances, relative and in mm, within which a number equals [`FACTOR`] times that of another
/// frame.
const SAME: f64 = 0.05;
const SAME_MM: f64 = 2.0;
/// Numbers below this are told from others by chance, mm.
const MIN_MM: f64 = 10.0 * FACTOR;
/// Such numbers that are no chance.
const MIN_FOUND: usize = 3;

/// Refuses a file whose numbers lost their decimal points here and there.
pub(super) fn check(file: &Recording) -> Result<(), FileProblem> {
    if !file.positions_mm.as_flattened().iter().any(|x| x.abs() >= MIN_MM) {
        return Ok(());
    }
    let axes = 3 * file.labels.len();
    // Of each axis the last number and its row.
    let mut last: Vec<(f64, usize)> = vec![(f64::NAN, 0); axes];
    let mut found = 0;
    // Of the first axis that has one, so that files of one kind say the same.
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
    let (label, frames) = (&file.labels[axis / 3], &file.frames);
    let found = format!(
        "numbers that lost their decimal point: {label} {name} is {before} in frame {} and {number} in \
         frame {}",
        frames[row_before], frames[row]
    );
    let needed = "them as exported: a spreadsheet with decimal commas took the points for thousands; \
                  export the file again, and open it only with the cells imported as text";
    Err(FileProblem::new(found, needed))
}

/// Whether a whole number is another one without its decimal point.
#[inline]
fn is_lost(number: f64, other: f64) -> bool {
    number.abs() >= MIN_MM && number.fract() == 0.0 && {
        let meant = number / FACTOR;
        (meant - other).abs() < SAME_MM.max(SAME * meant.abs())
    }
}
