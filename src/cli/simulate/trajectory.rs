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
    let mut absent = Vec::new();
    let mut input = String::new();
    for answer in answers {
        let problem = answer.setup.problem(answer.omega_rad_s);
        input += &format!("{problem:?} {from_rest} {samples}");
        match answer.setup.trajectory(answer, from_rest, samples) {
            Ok(cycle) => cycles.push((answer, cycle)),
            Err(error) => absent.push((answer.omega_rad_s, error)),
        }
    }
    let unbounded = cycles.iter().flat_map(|(_, cycle)| cycle).filter(|sample| {
        let wheels = sample.lateral_n.iter().zip(&sample.roll_m_s);
        wheels.into_iter().any(|(force, velocity)| force.is_nan() && !velocity.is_nan())
    });
    let unbounded = unbounded.count();
    let table = trajectories(&setup.robot, &cycles);
    let mut message = format!("{}: {} samples", path.display(), table.len());
    write_table(path, table, &input)?;
    if let Some((omega_rad_s, error)) = absent.first() {
        let motion = if from_rest { "motion from rest" } else { "steady motion" };
        message += &format!(
            "; the file has no rows for {} of {} frequencies, at which no {motion} was found (at {omega_rad_s} rad/s: \
             {error})",
            absent.len(),
            answers.len()
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
