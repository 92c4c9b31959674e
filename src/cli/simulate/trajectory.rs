//! The table that `simulate --trajectory` writes.

use std::path::Path;

use crate::cli::Failure;
use crate::simulate::{Answer, Setup};
use crate::store::{Columns, Provenance, TrajectoryRow};

/// Writes one steady cycle of every problem, or the transient from rest and one cycle more.
/// Gives a sentence on what is in the file.
pub(super) fn write(
    path: &Path,
    setup: &Setup,
    answers: &[Answer],
    from_rest: bool,
    samples: usize,
) -> Result<String, Failure> {
    let mut rows = Vec::new();
    let (mut absent, mut unbounded) = (0, 0);
    let mut input = blake3::Hasher::new();
    for answer in answers {
        let problem = setup.problem(answer.omega_rad_s);
        input.update(format!("{problem:?} {from_rest} {samples}").as_bytes());
        match setup.trajectory(answer, from_rest, samples) {
            Ok(found) => {
                unbounded += found.iter().filter(|s| s.forces.lateral_n[0].is_nan()).count();
                rows.extend(found);
            }
            Err(_) => absent += 1,
        }
    }
    let provenance = Provenance { input: input.finalize().to_hex().to_string() };
    TrajectoryRow::to_table(&rows).write(path, &provenance)?;
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
