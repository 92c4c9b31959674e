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

use super::kinematics::{Trig, Velocity, droll_rows_dphi, dskid_rows_dphi, roll_rows, skid_rows};
use super::{Number, Robot};

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
#[derive(Debug, Clone, Copy)]
pub struct Balance<T = f64> {
    /// Generalised forces (N, N, N m, N m, N m) along [`Velocity`].
    pub force: [T; 5],
    /// [`mass_matrix`]: the derivative with respect to the accelerations.
    pub mass: [[T; 5]; 5],
    /// `dforce_dvelocity[i][j]`: derivative of force i with respect to velocity j.
    pub dforce_dvelocity: [[T; 5]; 5],
    /// `dforce_dphi[j][i]`: derivative of force i with respect to joint angle j.
    pub dforce_dphi: [[T; 5]; 2],
}

/// `M` of eq. 7 in link 0's frame: kg, kg m and kg m^2, rows and columns as [`Velocity`].
#[inline(always)]
pub fn mass_matrix<T: Number>(robot: &Robot, trig: &Trig<T>) -> [[T; 5]; 5] {
    let (h, b) = (robot.h_m, robot.b_m);
    let [m0, m1, m2] = robot.mass_kg;
    let [i0, i1, i2] = robot.inertia_kg_m2;
    let (j1, j2) = (m1 * b * b + i1, m2 * b * b + i2);
    let middle = T::of(i0 + (m1 + m2) * h * h + j1 + j2);
    let (total, h, [mb1, mb2]) = (T::of(m0 + m1 + m2), T::of(h), [m1 * b, m2 * b].map(T::of));
    let ([j1, j2], uneven, zero) = ([j1, j2].map(T::of), h * T::of(m1 - m2), T::of(0.0));
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    let (u_1, v_1) = (-(mb1 * s1), -(mb1 * c1));
    let (u_2, v_2) = (mb2 * s2, -(mb2 * c2));
    let (p1, p2) = (j1 - h * v_1, j2 - h * v_2);
    let u_r = u_2 - u_1;
    let v_r = uneven + v_2 - v_1;
    let r_r = middle - T::of(2.0) * h * (v_1 + v_2);
    [
        [total, zero, u_r, u_1, u_2],
        [zero, total, v_r, v_1, v_2],
        [u_r, v_r, r_r, -p1, p2],
        [u_1, v_1, -p1, j1, zero],
        [u_2, v_2, p2, zero, j2],
    ]
}

/// Projects a force on the centre of mass of the side link at `joint` on the five velocities.
#[inline(always)]
fn project<T: Number>(robot: &Robot, trig: &Trig<T>, joint: usize, [fx, fy]: [T; 2]) -> [T; 5] {
    let (h, b, zero) = (T::of(robot.h_m), T::of(robot.b_m), T::of(0.0));
    let (s, c) = (trig.s[joint], trig.c[joint]);
    if joint == 0 {
        let torque = b * (s * fx + c * fy);
        [fx, fy, h * fy + torque, -torque, zero]
    } else {
        let torque = b * (s * fx - c * fy);
        [fx, fy, torque - h * fy, zero, torque]
    }
}

/// Evaluates eq. 7 at angles `phi_rad` (with their `trig`), `velocity` and `acceleration`
/// (time derivatives of the five velocities); `passive` is the index of the joint on a spring.
#[inline(always)]
pub fn force_balance<T: Number>(
    robot: &Robot,
    passive: Option<usize>,
    phi_rad: [T; 2],
    trig: &Trig<T>,
    velocity: &Velocity<T>,
    acceleration: &[T; 5],
) -> Balance<T> {
    let mass = mass_matrix(robot, trig);
    let (h, b) = (T::of(robot.h_m), T::of(robot.b_m));
    let [m0, m1, m2] = robot.mass_kg.map(T::of);
    let [i0, i1, i2] = robot.inertia_kg_m2.map(T::of);
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    let [u, v, r, w1, w2] = *velocity;
    let [du, dv, dr, dw1, dw2] = *acceleration;
    let (r1, r2, dr1, dr2) = (r - w1, r + w2, dr - dw1, dr + dw2);
    let project = |joint: usize, force: [T; 2]| project(robot, trig, joint, force);

    let (ax, ay) = (du - r * v, dv + r * u);
    let (turn1, turn2, swing1, swing2) = (b * r1 * r1, b * r2 * r2, b * dr1, b * dr2);
    let a1 = [ax - h * r * r + swing1 * s1 - turn1 * c1, ay + h * dr + swing1 * c1 + turn1 * s1];
    let a2 = [ax + h * r * r + swing2 * s2 + turn2 * c2, ay - h * dr - swing2 * c2 + turn2 * s2];
    let front = project(0, a1.map(|a| m1 * a));
    let rear = project(1, a2.map(|a| m2 * a));
    let (spin1, spin2) = (i1 * dr1, i2 * dr2);
    let mut force = [
        front[0] + rear[0] + m0 * ax,
        front[1] + rear[1] + m0 * ay,
        front[2] + rear[2] + i0 * dr + spin1 + spin2,
        front[3] - spin1,
        rear[4] + spin2,
    ];

    // The frame's turning accelerates every mass alike; the side links' own turning adds to that.
    let (g1, g2) = (T::of(2.0) * m1 * b * r1, T::of(2.0) * m2 * b * r2);
    let (g1, g2) = ([g1 * c1, -(g1 * s1)], [g2 * c2, g2 * s2]);
    let (centre1, centre2) = (T::of(2.0) * m1 * h * r, T::of(2.0) * m2 * h * r);
    let front = project(0, [-centre1 - g1[0], -g1[1]]);
    let rear = project(1, [centre2 + g2[0], g2[1]]);
    let (front_joint, rear_joint) = (project(0, g1), project(1, g2));
    let mut dforce_dvelocity = std::array::from_fn(|i| {
        let [by_ax, by_ay, ..] = mass[i];
        let turning = by_ay * u - by_ax * v + front[i] + rear[i];
        [by_ay * r, -(by_ax * r), turning, front_joint[i], rear_joint[i]]
    });

    // The side links' accelerations turn with their joints, and so do the arms b.
    let f1 = [m1 * (turn1 * s1 + swing1 * c1), m1 * (turn1 * c1 - swing1 * s1)];
    let f2 = [m2 * (swing2 * c2 - turn2 * s2), m2 * (turn2 * c2 + swing2 * s2)];
    let mut dforce_dphi = [project(0, f1), project(1, f2)];
    let arm1 = m1 * b * (c1 * a1[0] - s1 * a1[1]);
    let arm2 = m2 * b * (c2 * a2[0] + s2 * a2[1]);
    dforce_dphi[0][2] += arm1;
    dforce_dphi[0][3] -= arm1;
    dforce_dphi[1][2] += arm2;
    dforce_dphi[1][4] += arm2;

    let (skid, roll) = (skid_rows(robot, trig), roll_rows(robot, trig));
    let (c_skid, c_roll) = (robot.skid_kg_s.map(T::of), robot.roll_kg_s.map(T::of));
    let mut add = (&mut force, &mut dforce_dvelocity);
    add_friction(&mut add, c_skid[0], &skid[0], [1], velocity);
    add_friction(&mut add, c_roll[0], &roll[0], [0], velocity);
    // Only the rows of the side wheels turn, each with its own joint.
    let (dskid, droll) = (dskid_rows_dphi(robot, trig), droll_rows_dphi(robot, trig));
    for j in 0..2 {
        let (c_skid, c_roll) = (c_skid[j + 1], c_roll[j + 1]);
        add_friction(&mut add, c_skid, &skid[j + 1], [0, 1, 2, 3 + j], velocity);
        add_friction(&mut add, c_roll, &roll[j + 1], [0, 1, 2], velocity);
        let turned = &mut dforce_dphi[j];
        turn_friction(turned, c_skid, [&skid[j + 1], &dskid[j]], [0, 1, 2, 3 + j], velocity);
        turn_friction(turned, c_roll, [&roll[j + 1], &droll[j]], [0, 1, 2], velocity);
    }

    if let Some(joint) = passive {
        let row = 3 + joint;
        let [stiffness, damping, rest] =
            [robot.stiffness_nm_rad, robot.damping_nm_s_rad, robot.rest_angle_rad].map(T::of);
        force[row] += stiffness * (phi_rad[joint] - rest) + damping * velocity[row];
        dforce_dvelocity[row][row] += damping;
        dforce_dphi[joint][row] += stiffness;
    }
    Balance { force, mass, dforce_dvelocity, dforce_dphi }
}

/// Adds `c row (row . velocity)` and its derivative with respect to the velocity, where the row has
/// these `entries` alone.
#[inline(always)]
fn add_friction<T: Number, const K: usize>(
    (force, dforce_dvelocity): &mut (&mut [T; 5], &mut [[T; 5]; 5]),
    c_kg_s: T,
    row: &[T; 5],
    entries: [usize; K],
    velocity: &Velocity<T>,
) {
    let speed = speed(row, entries, velocity);
    for i in entries {
        let resistance = c_kg_s * row[i];
        force[i] += resistance * speed;
        for j in entries {
            dforce_dvelocity[i][j] += resistance * row[j];
        }
    }
}

/// Adds the derivative of `c row (row . velocity)` when `row` changes by `turn`.
#[inline(always)]
fn turn_friction<T: Number, const K: usize>(
    dforce_dphi: &mut [T; 5],
    c_kg_s: T,
    [row, turn]: [&[T; 5]; 2],
    entries: [usize; K],
    velocity: &Velocity<T>,
) {
    let (along, across) =
        (c_kg_s * speed(row, entries, velocity), c_kg_s * speed(turn, entries, velocity));
    for i in entries {
        dforce_dphi[i] += along * turn[i] + across * row[i];
    }
}

/// The velocity along a row that has these entries alone.
#[inline(always)]
fn speed<T: Number, const K: usize>(
    row: &[T; 5],
    entries: [usize; K],
    velocity: &Velocity<T>,
) -> T {
    entries.iter().fold(T::of(0.0), |sum, &i| sum + row[i] * velocity[i])
}
