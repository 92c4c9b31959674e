//! Table of `simulate --trajectory`.

use std::path::Path;

use trilink_fit::simulate::{Answer, Setup};

use crate::cli::Failure;
use crate::cli::results::write_rows;

/// Writes one steady-state cycle of every solution or, with `from_rest`, the transient from rest and one further cycle.
/// Each cycle has `samples` rows. Returns a message about the content of the file.
pub(super) fn write(
    path: &Path,
    solved: &[(&Setup, Answer)],
    from_rest: bool,
    samples: usize,
) -> Result<String, Failure> {
    let mut rows = Vec::new();
    let mut absent = 0;
    let mut unbounded = 0;
    let mut input = String::new();
    for (setup, answer) in solved {
        let problem = setup.problem(answer.omega_rad_s);
        input += &format!("{problem:?} {from_rest} {samples}");
        match setup.trajectory(answer, from_rest, samples) {
            Ok(found) => {
                unbounded += found.iter().filter(|s| s.lateral_n[0].is_nan()).count();
                rows.extend(found);
            }
            Err(_) => absent += 1,
        }
    }
    write_rows(path, &rows, &input)?;
    let mut message = format!("{}: {} samples", path.display(), rows.len());
    if absent > 0 {
        message += &format!(
            "; no motion was found at {absent} frequencies, so the file has no rows for them"
        );
    }
    if unbounded > 0 {
        message += &format!(
            "; in {unbounded} of the samples, the shape is singular (det W_b = 0), so the constraint forces are \
             unbounded and left empty"
        );
    }
    Ok(message)
}
