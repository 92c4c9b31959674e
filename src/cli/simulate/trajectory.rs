//! Table of `simulate --trajectory`.

use std::path::Path;

use trilink_fit::simulate::{Answer, Setup, trajectories};

use crate::cli::Failure;
use crate::cli::results::write_table;

/// Writes one steady-state cycle of every answer, all for the robot of a setup, or, with `from_rest`, the transient from
/// rest and one further cycle. Each cycle has `samples` rows. Returns a message about the content of the file.
pub(super) fn write(
    path: &Path,
    setup: &Setup,
    answers: &[Answer],
    from_rest: bool,
    samples: usize,
) -> Result<String, Failure> {
    let mut cycles = Vec::new();
    let mut input = String::new();
    for answer in answers {
        let problem = answer.setup.problem(answer.omega_rad_s);
        input += &format!("{problem:?} {from_rest} {samples}");
        if let Ok(cycle) = answer.setup.trajectory(answer, from_rest, samples) {
            cycles.push((answer, cycle));
        }
    }
    let unbounded = cycles.iter().flat_map(|(_, cycle)| cycle).filter(|sample| {
        let wheels = sample.lateral_n.iter().zip(&sample.roll_m_s);
        wheels.into_iter().any(|(force, velocity)| force.is_nan() && !velocity.is_nan())
    });
    let (unbounded, absent) = (unbounded.count(), answers.len() - cycles.len());
    let table = trajectories(&setup.robot, &cycles);
    let mut message = format!("{}: {} samples", path.display(), table.len());
    write_table(path, table, &input)?;
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
