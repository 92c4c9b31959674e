//! Eq. 7 in link 0's frame with its Jacobian, and its mass matrix.
//!
//! # Derivation
//!
//! Each centre of mass has, in link 0's frame, the acceleration
//!
//! ```text
//! a0 = (u' - r v,            v' + r u)                                   with r = theta'
//! a1 = a0 + h (-r^2,  r') + b r1' n1 - b r1^2 t1                         with r1 = r - phi1'
//! a2 = a0 + h ( r^2, -r') - b r2' n2 + b r2^2 t2                         with r2 = r + phi2'
//! ```
//!
//! d'Alembert's principle projects `m_i a_i` and `I_i r_i'` on the five velocities `(u, v, r,
//! phi1', phi2')`; the wheels add `c^S v_perp` along each skid row and `c^R v_par` along each
//! roll row (eq. 14 and 15), the passive joint its spring and damper (eq. 11). The rows sum
//! to the generalised force that actuators and constraints must supply: zero for `u, v, r`
//! of a skidding robot and for its passive joint. Nothing depends on position or heading.

use super::Robot;
use super::kinematics::{
    Trig, Velocity, dot, droll_rows_dphi, dskid_rows_dphi, roll_rows, skid_rows,
};

/// Forces of the ground, torques and power at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactForces {
    /// Force of the ground on each wheel across it, N: the constraint force Lambda (eq. 8) where
    /// the wheels cannot skid, else skid resistance (eq. 15). NaN where Lambda is unbounded.
    pub lateral_n: [f64; 3],
    /// Roll resistance at each wheel (eq. 14), N.
    pub roll_n: [f64; 3],
    /// Torque of the actuators, or of spring and damper at the passive joint (eq. 11), N m. NaN
    /// where Lambda is unbounded.
    pub torque_nm: [f64; 2],
    /// Power of the actuators, W; bounded where Lambda is not.
    pub power_w: f64,
    /// Power that friction takes, at the wheels and in the passive joint, W.
    pub loss_w: f64,
}

/// The left-hand side of eq. 7, `M q'' + B + G - F_d`, and its derivatives.
///
/// The derivative with respect to the accelerations is [`mass_matrix`].
#[derive(Debug, Clone, Copy)]
pub struct Balance {
    /// Generalised forces (N, N, N m, N m, N m) along [`Velocity`].
    pub force: [f64; 5],
    /// `dforce_dvelocity[i][j]`: derivative of force i with respect to velocity j.
    pub dforce_dvelocity: [[f64; 5]; 5],
    /// `dforce_dphi[j][i]`: derivative of force i with respect to joint angle j.
    pub dforce_dphi: [[f64; 5]; 2],
}

/// `M` of eq. 7 in link 0's frame: kg, kg m and kg m^2, rows and columns as [`Velocity`].
#[inline(always)]
pub fn mass_matrix(robot: &Robot, trig: &Trig) -> [[f64; 5]; 5] {
    let (h, b) = (robot.h_m, robot.b_m);
    let [m0, m1, m2] = robot.mass_kg;
    let [i0, i1, i2] = robot.inertia_kg_m2;
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    let total = m0 + m1 + m2;
    let (j1, j2) = (m1 * b * b + i1, m2 * b * b + i2);
    let (p1, p2) = (m1 * h * b * c1 + j1, m2 * h * b * c2 + j2);
    let u_r = b * (m1 * s1 + m2 * s2);
    let v_r = m1 * (h + b * c1) - m2 * (h + b * c2);
    let r_r = i0 + (m1 + m2) * h * h + 2.0 * h * b * (m1 * c1 + m2 * c2) + j1 + j2;
    let (u_1, v_1) = (-m1 * b * s1, -m1 * b * c1);
    let (u_2, v_2) = (m2 * b * s2, -m2 * b * c2);
    [
        [total, 0.0, u_r, u_1, u_2],
        [0.0, total, v_r, v_1, v_2],
        [u_r, v_r, r_r, -p1, p2],
        [u_1, v_1, -p1, j1, 0.0],
        [u_2, v_2, p2, 0.0, j2],
    ]
}

/// Projects forces on the three centres of mass on the five velocities.
#[inline(always)]
fn project(robot: &Robot, trig: &Trig, forces: [[f64; 2]; 3]) -> [f64; 5] {
    let (h, b) = (robot.h_m, robot.b_m);
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    let [f0, f1, f2] = forces;
    let torque1 = b * (s1 * f1[0] + c1 * f1[1]);
    let torque2 = b * (s2 * f2[0] - c2 * f2[1]);
    [
        f0[0] + f1[0] + f2[0],
        f0[1] + f1[1] + f2[1],
        h * (f1[1] - f2[1]) + torque1 + torque2,
        -torque1,
        torque2,
    ]
}

/// Evaluates eq. 7 at angles `phi_rad` (with their `trig`), `velocity` and `acceleration`
/// (time derivatives of the five velocities); `passive` is the index of the joint on a spring.
#[inline(always)]
pub fn force_balance(
    robot: &Robot,
    passive: Option<usize>,
    phi_rad: [f64; 2],
    trig: &Trig,
    velocity: &Velocity,
    acceleration: &[f64; 5],
) -> Balance {
    let (h, b) = (robot.h_m, robot.b_m);
    let [m0, m1, m2] = robot.mass_kg;
    let [i0, i1, i2] = robot.inertia_kg_m2;
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    let [u, v, r, w1, w2] = *velocity;
    let [du, dv, dr, dw1, dw2] = *acceleration;
    let (r1, r2, dr1, dr2) = (r - w1, r + w2, dr - dw1, dr + dw2);

    let (ax, ay) = (du - r * v, dv + r * u);
    let (turn1, turn2) = (b * r1 * r1, b * r2 * r2);
    let a1 = [ax - h * r * r + b * dr1 * s1 - turn1 * c1, ay + h * dr + b * dr1 * c1 + turn1 * s1];
    let a2 = [ax + h * r * r + b * dr2 * s2 + turn2 * c2, ay - h * dr - b * dr2 * c2 + turn2 * s2];
    let forces = [[m0 * ax, m0 * ay], [m1 * a1[0], m1 * a1[1]], [m2 * a2[0], m2 * a2[1]]];
    let mut force = project(robot, trig, forces);
    force[2] += i0 * dr + i1 * dr1 + i2 * dr2;
    force[3] -= i1 * dr1;
    force[4] += i2 * dr2;

    // Columns of the Jacobian: how the three accelerations change with each velocity.
    let (g1, g2) = (2.0 * b * r1, 2.0 * b * r2);
    let columns = [
        project(robot, trig, [[0.0, m0 * r], [0.0, m1 * r], [0.0, m2 * r]]),
        project(robot, trig, [[-m0 * r, 0.0], [-m1 * r, 0.0], [-m2 * r, 0.0]]),
        project(
            robot,
            trig,
            [
                [-m0 * v, m0 * u],
                [m1 * (-v - 2.0 * h * r - g1 * c1), m1 * (u + g1 * s1)],
                [m2 * (-v + 2.0 * h * r + g2 * c2), m2 * (u + g2 * s2)],
            ],
        ),
        project(robot, trig, [[0.0; 2], [m1 * g1 * c1, -m1 * g1 * s1], [0.0; 2]]),
        project(robot, trig, [[0.0; 2], [0.0; 2], [m2 * g2 * c2, m2 * g2 * s2]]),
    ];
    let mut dforce_dvelocity = [[0.0; 5]; 5];
    for (i, row) in dforce_dvelocity.iter_mut().enumerate() {
        for (entry, column) in row.iter_mut().zip(&columns) {
            *entry = column[i];
        }
    }

    // The side links' accelerations turn with their joints, and so do the arms b.
    let f1 = [m1 * (turn1 * s1 + b * dr1 * c1), m1 * (turn1 * c1 - b * dr1 * s1)];
    let f2 = [m2 * (-turn2 * s2 + b * dr2 * c2), m2 * (turn2 * c2 + b * dr2 * s2)];
    let mut dforce_dphi = [
        project(robot, trig, [[0.0; 2], f1, [0.0; 2]]),
        project(robot, trig, [[0.0; 2], [0.0; 2], f2]),
    ];
    let arm1 = m1 * b * (c1 * a1[0] - s1 * a1[1]);
    let arm2 = m2 * b * (c2 * a2[0] + s2 * a2[1]);
    dforce_dphi[0][2] += arm1;
    dforce_dphi[0][3] -= arm1;
    dforce_dphi[1][2] += arm2;
    dforce_dphi[1][4] += arm2;

    let skid = skid_rows(robot, trig);
    let roll = roll_rows(robot, trig);
    for i in 0..3 {
        add_friction(&mut force, &mut dforce_dvelocity, robot.skid_kg_s[i], &skid[i], velocity);
        add_friction(&mut force, &mut dforce_dvelocity, robot.roll_kg_s[i], &roll[i], velocity);
    }
    // Only the rows of the side wheels turn, each with its own joint.
    let (dskid, droll) = (dskid_rows_dphi(robot, trig), droll_rows_dphi(robot, trig));
    for j in 0..2 {
        let (c_skid, c_roll) = (robot.skid_kg_s[j + 1], robot.roll_kg_s[j + 1]);
        add_friction_gradient(&mut dforce_dphi[j], c_skid, &skid[j + 1], &dskid[j], velocity);
        add_friction_gradient(&mut dforce_dphi[j], c_roll, &roll[j + 1], &droll[j], velocity);
    }

    if let Some(joint) = passive {
        let row = 3 + joint;
        force[row] += robot.stiffness_nm_rad * (phi_rad[joint] - robot.rest_angle_rad)
            + robot.damping_nm_s_rad * velocity[row];
        dforce_dvelocity[row][row] += robot.damping_nm_s_rad;
        dforce_dphi[joint][row] += robot.stiffness_nm_rad;
    }
    Balance { force, dforce_dvelocity, dforce_dphi }
}

/// Adds `c row (row . velocity)` and its derivative with respect to the velocity.
#[inline(always)]
fn add_friction(
    force: &mut [f64; 5],
    dforce_dvelocity: &mut [[f64; 5]; 5],
    c_kg_s: f64,
    row: &[f64; 5],
    velocity: &Velocity,
) {
    let along = c_kg_s * dot(row, velocity);
    for i in 0..5 {
        force[i] += along * row[i];
        for j in 0..5 {
            dforce_dvelocity[i][j] += c_kg_s * row[i] * row[j];
        }
    }
}

/// Adds the derivative of `c row (row . velocity)` when `row` changes by `turn`.
#[inline(always)]
fn add_friction_gradient(
    dforce_dphi: &mut [f64; 5],
    c_kg_s: f64,
    row: &[f64; 5],
    turn: &[f64; 5],
    velocity: &Velocity,
) {
    let (along, across) = (c_kg_s * dot(row, velocity), c_kg_s * dot(turn, velocity));
    for i in 0..5 {
        dforce_dphi[i] += along * turn[i] + across * row[i];
    }
}
