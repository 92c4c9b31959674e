//! Forces on the robot: wheel forces, joint torques and power (eq. 8 to 10, 14, 15).

use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use trilink_robot::{ContactForces, Friction, dot, force_balance, roll_rows, skid_rows};

use super::Problem;
use super::reduced::KinematicState;

/// Ratio of the smallest to the largest singular value below which the no-skid constraints count as
/// dependent.
const SINGULAR: f64 = 1e-6;
/// Maximum number of iterations of the singular value decomposition, which would not end for numbers that are not
/// finite.
const MAX_ITERATIONS: usize = 1000;

/// Returns the forces and the power at one time, given the state and the time derivatives of the velocities.
///
/// The left-hand side of the equations of motion (eq. 7 of the paper) equals what actuators and constraints
/// supply, `E tau + W^T Lambda`. The rows of the body and of the passive joint have no actuator and determine
/// the constraint forces `Lambda`: three equations for the kinematic robot, which fail at singular shapes;
/// four consistent equations for the semi-passive robot, solved by least squares.
pub(super) fn contact_forces<F: Friction>(
    problem: &Problem,
    state: &KinematicState,
    acceleration: &[f64; 5],
) -> ContactForces {
    let robot = &problem.robot;
    let passive = problem.gait.passive_joint();
    let KinematicState { phi_rad, trig, velocity } = state;
    let supplied =
        force_balance::<f64, F>(robot, passive, *phi_rad, trig, velocity, acceleration).force;
    let skid = skid_rows(robot, trig);
    let roll = roll_rows(robot, trig);
    let skid_m_s = skid.map(|row| dot(&row, velocity));
    let roll_m_s = roll.map(|row| dot(&row, velocity));

    let skid_n: [f64; 3] =
        std::array::from_fn(|i| F::skid(&robot.wheel_friction(i), skid_m_s[i])[0]);
    let roll_n: [f64; 3] =
        std::array::from_fn(|i| F::roll(&robot.wheel_friction(i), roll_m_s[i])[0]);
    let lateral_n = if problem.laws.skids() {
        skid_n.map(|force| -force)
    } else {
        constraint_forces(passive, &skid, &supplied).unwrap_or([f64::NAN; 3])
    };
    let torque_nm = std::array::from_fn(|joint| {
        let row = 3 + joint;
        if passive == Some(joint) {
            let stretched = phi_rad[joint] - robot.rest_angle_rad;
            return -robot.stiffness_nm_rad * stretched - robot.damping_nm_s_rad * velocity[row];
        }
        if problem.laws.skids() {
            return supplied[row];
        }
        supplied[row] - (0..3).map(|i| skid[i][row] * lateral_n[i]).sum::<f64>()
    });
    let power_w = if problem.is_determined() {
        // Constraints do no work, so the supplied power is that of the actuators.
        dot(&supplied, velocity)
    } else {
        let actuated = (0..2).filter(|joint| passive != Some(*joint));
        actuated.map(|joint| torque_nm[joint] * velocity[3 + joint]).sum()
    };
    let wheels: f64 = (0..3).map(|i| skid_n[i] * skid_m_s[i] + roll_n[i] * roll_m_s[i]).sum();
    let joint = passive.map_or(0.0, |p| robot.damping_nm_s_rad * velocity[3 + p].powi(2));
    ContactForces {
        lateral_n,
        roll_n: roll_n.map(|force| -force),
        torque_nm,
        power_w,
        loss_w: wheels + joint,
    }
}

/// Solves for the constraint forces Lambda on the wheels, N, from those equations of motion (eq. 7 of the
/// paper) that have no actuator; their left-hand sides are in `supplied`. `None` if Lambda is unbounded.
fn constraint_forces(
    passive: Option<usize>,
    skid_rows: &[[f64; 5]; 3],
    supplied: &[f64; 5],
) -> Option<[f64; 3]> {
    // One column for each wheel; rows with an actuator stay zero.
    let mut columns = SMatrix::<f64, 4, 3>::zeros();
    let mut right = SVector::<f64, 4>::zeros();
    let rows = [Some(0), Some(1), Some(2), passive.map(|p| 3 + p)];
    for (equation, row) in rows.into_iter().enumerate() {
        if let Some(row) = row {
            right[equation] = supplied[row];
            (0..3).for_each(|i| columns[(equation, i)] = skid_rows[i][row]);
        }
    }
    let decomposed = columns.try_svd(true, true, 5.0 * f64::EPSILON, MAX_ITERATIONS)?;
    let singular = &decomposed.singular_values;
    if singular.min() <= SINGULAR * singular.max() {
        return None;
    }
    let lambda = decomposed.solve(&right, 0.0).ok()?;
    lambda.iter().all(|force| force.is_finite()).then_some([lambda[0], lambda[1], lambda[2]])
}

/// Solves a linear system by least squares. `None` if its columns are dependent.
pub(super) fn least_squares(columns: DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let decomposed = columns.try_svd(true, true, 5.0 * f64::EPSILON, MAX_ITERATIONS)?;
    let singular = &decomposed.singular_values;
    if singular.min() <= SINGULAR * singular.max() {
        return None;
    }
    let solution = decomposed.solve(right, 0.0).ok()?;
    solution.iter().all(|force| force.is_finite()).then_some(solution)
}
