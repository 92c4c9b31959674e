//! The table that `simulate --trajectory` writes.

use std::path::Path;

use super::answer::Answer;
use crate::cli::Failure;
use crate::motion::{FORCES_ACCURACY, MotionError, Problem, REFERENCE_ACCURACY, Sample, Solver};
use crate::store::{Columns, Provenance, TrajectoryRow};

/// Cycles that are written of a motion which does not settle.
const UNSETTLED_CYCLES: usize = 50;

/// Writes one steady cycle of every problem, or the transient from rest and one cycle more.
/// Gives a sentence on what is in the file.
pub(super) fn write<'a>(
    path: &Path,
    problems: impl Iterator<Item = (Problem, &'a Answer<'a>)>,
    from_rest: bool,
    samples: usize,
) -> Result<String, Failure> {
    let mut rows = Vec::new();
    let (mut absent, mut unbounded) = (0, 0);
    let mut input = blake3::Hasher::new();
    for (problem, answer) in problems {
        input.update(format!("{problem:?} {from_rest} {samples}").as_bytes());
        match of(&problem, answer, from_rest, samples) {
            Ok(found) => {
                unbounded += found.iter().filter(|s| s.forces.lateral_n[0].is_nan()).count();
                rows.extend(found.iter().map(|sample| row(problem.omega_rad_s, sample)));
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

fn of(
    problem: &Problem,
    answer: &Answer,
    from_rest: bool,
    samples: usize,
) -> Result<Vec<Sample>, MotionError> {
    if from_rest {
        let cycles = answer.cycles_to_settle.map_or(UNSETTLED_CYCLES, |cycles| cycles + 1);
        return problem.cycles_from_rest(cycles, samples);
    }
    let mut solver = Solver::default();
    // The roughest motions cannot be had to the higher accuracy.
    let fine = solver.solve(problem, FORCES_ACCURACY);
    fine.or_else(|_| solver.solve(problem, REFERENCE_ACCURACY))?;
    solver.cycle(samples)
}

fn row(omega_rad_s: f64, sample: &Sample) -> TrajectoryRow {
    let [x_rate_m_s, y_rate_m_s, theta_rate_rad_s, phi_rate_rad_s @ ..] = sample.rates;
    TrajectoryRow {
        omega_rad_s,
        time_s: sample.time_s,
        x_m: sample.pose.x_m,
        y_m: sample.pose.y_m,
        theta_rad: sample.pose.theta_rad,
        phi_rad: sample.phi_rad,
        x_rate_m_s,
        y_rate_m_s,
        theta_rate_rad_s,
        phi_rate_rad_s,
        roll_m_s: sample.roll_m_s,
        skid_m_s: sample.skid_m_s,
        forces: sample.forces,
    }
}
