//! The table that `simulate --trajectory` writes.

use std::path::Path;

use trilink_fit::simulate::{Answer, Setup};

use crate::cli::Failure;
use crate::cli::rows_file::RowsFile;

/// Where motions over time go.
pub(super) struct File<'p>(RowsFile<'p>);

impl<'p> File<'p> {
    pub(super) fn new(path: &'p Path) -> Result<Self, Failure> {
        Ok(Self(RowsFile::new(path, "--trajectory")?))
    }

    /// Writes one steady cycle of every answer, or the transient from rest and one cycle more.
    /// Gives a sentence on what is in the file.
    pub(super) fn write(
        &self,
        solved: &[(&Setup, Answer)],
        from_rest: bool,
        samples: usize,
    ) -> Result<String, Failure> {
        let mut rows = Vec::new();
        let (mut absent, mut unbounded) = (0, 0);
        let mut input = blake3::Hasher::new();
        for (setup, answer) in solved {
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
        self.0.write(&rows, &input.finalize())?;
        let mut message = format!("{}: {} moments", self.0.path.display(), rows.len());
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
}
