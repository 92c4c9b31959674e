//! The table that `simulate --trajectory` writes.

use std::path::Path;

use trilink_fit::simulate::{Answer, Setup};

use crate::cli::Failure;
use crate::cli::results::write_rows;

/// Writes one steady cycle of every answer, or the transient from rest and one cycle more. Gives a sentence on what
/// is in the file.
pub(super) fn write(
    path: &Path,
    solved: &[(&Setup, Answer)],
    from_rest: bool,
    samples: usize,
) -> Result<String, Failure> {
    let mut rows = Vec::new();
    let (mut absent, mut unbounded, mut input) = (0, 0, String::new());
    for (setup, answer) in solved {
        let problem = setup.problem(answer.omega_rad_s);
        input += &format!("{problem:?} {from_rest} {samples}");
        match setup.trajectory(answer, from_rest, samples) {
            Ok(found) => {
                unbounded += found.iter().filter(|s| s.forces.lateral_n[0].is_nan()).count();
                rows.extend(found);
            }
            Err(_) => absent += 1,
        }
    }
    write_rows(path, &rows, &input)?;
    let mut message = format!("{}: {} moments", path.display(), rows.len());
    if absent > 0 {
        message += &format!("; {absent} frequencies have no motion and no rows");
    }
    if unbounded > 0 {
        message += &format!(
            "; at {unbounded} of them the shape is singular (det W_b = 0) and the constraint \
             forces are unbounded: left empty"
        );
    }
    Ok(message)
}
