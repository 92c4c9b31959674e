//! Time series of simulated motions.

use trilink_mechanics::{
    FORCES_ACCURACY, MotionError, Problem, REFERENCE_ACCURACY, Sample, Solver,
};
use trilink_tables::TrajectoryRow;

use super::Answer;

/// Number of cycles to simulate from rest if the motion does not reach a steady state.
pub(super) const UNSETTLED_CYCLES: usize = 50;

/// Samples a motion: one steady-state cycle, or, if `from_rest`, all cycles from rest up to the steady state and one
/// more.
pub(super) fn sample_motion(
    problem: &Problem,
    answer: &Answer,
    from_rest: bool,
    samples: usize,
) -> Result<Vec<TrajectoryRow>, MotionError> {
    let samples = if from_rest {
        let cycles = answer.cycles_to_settle.map_or(UNSETTLED_CYCLES, |cycles| cycles + 1);
        problem.cycles_from_rest(cycles, samples)
    } else {
        steady_cycle(problem, samples)
    };
    Ok(samples?.iter().map(|sample| row(answer, sample)).collect())
}

fn steady_cycle(problem: &Problem, samples: usize) -> Result<Vec<Sample>, MotionError> {
    let mut solver = Solver::default();
    // The least smooth solutions cannot reach the higher accuracy.
    let fine = solver.solve(problem, FORCES_ACCURACY);
    fine.or_else(|_| solver.solve(problem, REFERENCE_ACCURACY))?;
    solver.cycle(samples)
}

fn row(answer: &Answer, sample: &Sample) -> TrajectoryRow {
    let [x_rate_m_s, y_rate_m_s, theta_rate_rad_s] = sample.pose_rates;
    TrajectoryRow {
        model: answer.model,
        omega_rad_s: answer.omega_rad_s,
        extrapolated: answer.extrapolation.as_ref().and_then(|of| of.extrapolated),
        time_s: sample.time_s,
        x_m: sample.pose.x_m,
        y_m: sample.pose.y_m,
        theta_rad: sample.pose.theta_rad,
        phi_rad: each(&sample.phi_rad),
        x_rate_m_s,
        y_rate_m_s,
        theta_rate_rad_s,
        phi_rate_rad_s: each(&sample.phi_rate_rad_s),
        roll_m_s: each(&sample.roll_m_s),
        skid_m_s: each(&sample.skid_m_s),
        lateral_n: each(&sample.lateral_n),
        roll_n: each(&sample.roll_n),
        torque_nm: each(&sample.torque_nm),
        power_w: sample.power_w,
        loss_w: sample.loss_w,
    }
}

/// Returns the values of the joints or wheels of a robot of three links.
fn each<const COUNT: usize>(values: &[f64]) -> [f64; COUNT] {
    std::array::from_fn(|i| values[i])
}
