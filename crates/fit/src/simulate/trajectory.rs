//! Time series of simulated motions.

use trilink_mechanics::{FORCES_ACCURACY, MotionError, Problem, Sample, Solver};
use trilink_robot::AnyRobot;
use trilink_tables::{Column, Columns, Table};

use super::Answer;
use super::answer::solve_motion;

/// Number of cycles to simulate from rest if the motion does not reach a steady state.
const UNSETTLED_CYCLES: usize = 50;

/// Samples a motion: one steady-state cycle, or, if `from_rest`, all cycles from rest up to the steady state and one
/// more.
pub(super) fn sample_motion(
    problem: &Problem,
    answer: &Answer,
    from_rest: bool,
    samples: usize,
) -> Result<Vec<Sample>, MotionError> {
    if from_rest {
        let cycles = answer.cycles_to_settle.map_or(UNSETTLED_CYCLES, |cycles| cycles + 1);
        problem.cycles_from_rest(cycles, samples)
    } else {
        steady_cycle(problem, samples)
    }
}

fn steady_cycle(problem: &Problem, samples: usize) -> Result<Vec<Sample>, MotionError> {
    let mut solver = Solver::default();
    if solver.solve(problem, FORCES_ACCURACY).is_err() {
        // The least smooth solutions cannot reach the higher accuracy.
        (solver, _) = solve_motion(problem, false)?;
    }
    solver.cycle(samples)
}

/// Returns the table of samples of answers for a robot, one row per sample: among its columns are those for each link, by
/// number, and for each joint, from 1.
pub fn trajectories(robot: &AnyRobot, cycles: &[(&Answer, Vec<Sample>)]) -> Table {
    type Number = fn(&Sample) -> f64;
    type Each = fn(&Sample) -> &Vec<f64>;
    let all = || cycles.iter().flat_map(|(answer, of)| of.iter().map(move |of| (*answer, of)));
    let columns = &mut Vec::new();
    add(columns, "model", all().map(|(answer, _)| answer.model));
    add(columns, "omega_rad_s", all().map(|(answer, _)| answer.omega_rad_s));
    let extrapolated = |answer: &Answer| answer.extrapolation.as_ref()?.extrapolated;
    add(columns, "extrapolated", all().map(|(answer, _)| extrapolated(answer)));
    let numbers = |columns: &mut Vec<Column>, names: &[(&str, Number)]| {
        for (name, value) in names {
            add(columns, name, all().map(|(_, of)| value(of)));
        }
    };
    let each = |columns: &mut Vec<Column>, [stem, unit]: [&str; 2], first: usize, of: Each| {
        // Joints are numbered from 1, and links from 0.
        for i in first..=robot.joints() {
            let values = all().map(|(_, sample)| of(sample)[i - first]);
            add(columns, &format!("{stem}{i}{unit}"), values);
        }
    };
    numbers(
        columns,
        &[
            ("time_s", |of| of.time_s),
            ("x_m", |of| of.pose.x_m),
            ("y_m", |of| of.pose.y_m),
            ("theta_rad", |of| of.pose.theta_rad),
        ],
    );
    each(columns, ["phi", "_rad"], 1, |of| &of.phi_rad);
    numbers(
        columns,
        &[
            ("x_rate_m_s", |of| of.pose_rates[0]),
            ("y_rate_m_s", |of| of.pose_rates[1]),
            ("theta_rate_rad_s", |of| of.pose_rates[2]),
        ],
    );
    each(columns, ["phi", "_rate_rad_s"], 1, |of| &of.phi_rate_rad_s);
    each(columns, ["roll", "_m_s"], 0, |of| &of.roll_m_s);
    each(columns, ["skid", "_m_s"], 0, |of| &of.skid_m_s);
    each(columns, ["lateral", "_n"], 0, |of| &of.lateral_n);
    each(columns, ["roll", "_n"], 0, |of| &of.roll_n);
    each(columns, ["torque", "_nm"], 1, |of| &of.torque_nm);
    numbers(columns, &[("power_w", |of| of.power_w), ("loss_w", |of| of.loss_w)]);
    Table::new(std::mem::take(columns))
}

/// Appends a column.
fn add<T: Columns>(columns: &mut Vec<Column>, name: &str, values: impl Iterator<Item = T>) {
    T::write_all(values.collect(), name, columns);
}
