//! Eq. 7 in link 0's frame with its Jacobian.
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

use super::geometry::{dot, roll_rows, roll_turns, skid_rows, skid_turns};
use super::{Robot, Trig, Velocity};

/// The left-hand side of eq. 7, `M q'' + B + G - F_d`, and its derivatives.
///
/// The derivative with respect to the accelerations is [`super::mass_matrix`].
#[derive(Debug, Clone, Copy)]
pub struct Balance {
    /// Generalised forces (N, N, N m, N m, N m) along [`Velocity`].
    pub value: [f64; 5],
    /// `by_velocity[i][j]`: derivative of row i with respect to velocity j.
    pub by_velocity: [[f64; 5]; 5],
    /// `by_phi[j][i]`: derivative of row i with respect to joint angle j.
    pub by_phi: [[f64; 5]; 2],
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
    let mut value = project(robot, trig, forces);
    value[2] += i0 * dr + i1 * dr1 + i2 * dr2;
    value[3] -= i1 * dr1;
    value[4] += i2 * dr2;

    // Columns of the Jacobian: how the three accelerations change with each velocity.
    let (g1, g2) = (2.0 * b * r1, 2.0 * b * r2);
    let by_column = [
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
    let mut by_velocity = [[0.0; 5]; 5];
    for (i, row) in by_velocity.iter_mut().enumerate() {
        for (entry, column) in row.iter_mut().zip(&by_column) {
            *entry = column[i];
        }
    }

    // The side links' accelerations turn with their joints, and so do the arms b.
    let f1 = [m1 * (turn1 * s1 + b * dr1 * c1), m1 * (turn1 * c1 - b * dr1 * s1)];
    let f2 = [m2 * (-turn2 * s2 + b * dr2 * c2), m2 * (turn2 * c2 + b * dr2 * s2)];
    let mut by_phi = [
        project(robot, trig, [[0.0; 2], f1, [0.0; 2]]),
        project(robot, trig, [[0.0; 2], [0.0; 2], f2]),
    ];
    let arm1 = m1 * b * (c1 * a1[0] - s1 * a1[1]);
    let arm2 = m2 * b * (c2 * a2[0] + s2 * a2[1]);
    by_phi[0][2] += arm1;
    by_phi[0][3] -= arm1;
    by_phi[1][2] += arm2;
    by_phi[1][4] += arm2;

    let skid = skid_rows(robot, trig);
    let roll = roll_rows(robot, trig);
    for i in 0..3 {
        add_friction(&mut value, &mut by_velocity, robot.skid_kg_s[i], &skid[i], velocity);
        add_friction(&mut value, &mut by_velocity, robot.roll_kg_s[i], &roll[i], velocity);
    }
    // Only the rows of the side wheels turn, each with its own joint.
    let (skid_turns, roll_turns) = (skid_turns(robot, trig), roll_turns(robot, trig));
    for j in 0..2 {
        let (c_skid, c_roll) = (robot.skid_kg_s[j + 1], robot.roll_kg_s[j + 1]);
        add_turned_friction(&mut by_phi[j], c_skid, &skid[j + 1], &skid_turns[j], velocity);
        add_turned_friction(&mut by_phi[j], c_roll, &roll[j + 1], &roll_turns[j], velocity);
    }

    if let Some(joint) = passive {
        let row = 3 + joint;
        value[row] += robot.stiffness_nm_rad * (phi_rad[joint] - robot.rest_angle_rad)
            + robot.damping_nm_s_rad * velocity[row];
        by_velocity[row][row] += robot.damping_nm_s_rad;
        by_phi[joint][row] += robot.stiffness_nm_rad;
    }
    Balance { value, by_velocity, by_phi }
}

/// Adds `c row (row . velocity)` and its derivative with respect to the velocity.
#[inline(always)]
fn add_friction(
    value: &mut [f64; 5],
    by_velocity: &mut [[f64; 5]; 5],
    c_kg_s: f64,
    row: &[f64; 5],
    velocity: &Velocity,
) {
    let force = c_kg_s * dot(row, velocity);
    for i in 0..5 {
        value[i] += force * row[i];
        for j in 0..5 {
            by_velocity[i][j] += c_kg_s * row[i] * row[j];
        }
    }
}

/// Adds the derivative of `c row (row . velocity)` when `row` changes by `turn`.
#[inline(always)]
fn add_turned_friction(
    by_phi: &mut [f64; 5],
    c_kg_s: f64,
    row: &[f64; 5],
    turn: &[f64; 5],
    velocity: &Velocity,
) {
    let (along, across) = (c_kg_s * dot(row, velocity), c_kg_s * dot(turn, velocity));
    for i in 0..5 {
        by_phi[i] += along * turn[i] + across * row[i];
    }
}
