//! Wheels, masses and energies in link 0's frame.
//!
//! With `c_i = cos phi_i`, `s_i = sin phi_i`, the links point along `t0 = (1, 0)`,
//! `t1 = (c1, -s1)`, `t2 = (c2, s2)` and the wheels are mounted across
//! `n0 = (0, 1)`, `n1 = (s1, c1)`, `n2 = (-s2, c2)`. Turning these rows by `theta`
//! gives `W` of eq. 1; `M` and `B` of eq. 7 follow in the same way.

use super::{Robot, Velocity};

/// Sines and cosines of the joint angles.
#[derive(Debug, Clone, Copy)]
pub struct Trig {
    pub s: [f64; 2],
    pub c: [f64; 2],
}

impl Trig {
    pub fn new(phi_rad: [f64; 2]) -> Self {
        let [(s1, c1), (s2, c2)] = phi_rad.map(f64::sin_cos);
        Self { s: [s1, s2], c: [c1, c2] }
    }
}

/// Rows that give the wheels' skid velocities `v_perp` from [`Velocity`] (eq. 1), m/s.
#[inline(always)]
pub fn skid_rows(robot: &Robot, trig: &Trig) -> [[f64; 5]; 3] {
    let (h, l) = (robot.h_m, robot.l_m);
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    [[0.0, 1.0, 0.0, 0.0, 0.0], [s1, c1, l + h * c1, -l, 0.0], [-s2, c2, -l - h * c2, 0.0, -l]]
}

/// How the skid rows of wheels 1 and 2 change with their own joints' angles, per radian.
#[inline(always)]
pub fn skid_turns(robot: &Robot, trig: &Trig) -> [[f64; 5]; 2] {
    let h = robot.h_m;
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    [[c1, -s1, -h * s1, 0.0, 0.0], [-c2, -s2, h * s2, 0.0, 0.0]]
}

/// How the roll rows of wheels 1 and 2 change with their own joints' angles, per radian.
#[inline(always)]
pub fn roll_turns(robot: &Robot, trig: &Trig) -> [[f64; 5]; 2] {
    let h = robot.h_m;
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    [[-s1, -c1, -h * c1, 0.0, 0.0], [-s2, c2, -h * c2, 0.0, 0.0]]
}

/// Rows that give the wheels' roll velocities `v_par` from [`Velocity`], m/s.
#[inline(always)]
pub fn roll_rows(robot: &Robot, trig: &Trig) -> [[f64; 5]; 3] {
    let h = robot.h_m;
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    [[1.0, 0.0, 0.0, 0.0, 0.0], [c1, -s1, -h * s1, 0.0, 0.0], [c2, s2, -h * s2, 0.0, 0.0]]
}

/// `det W_b`, m.
///
/// The sign is the opposite of eq. 4's, as working eq. 1 out shows; only the zeros matter.
/// Likewise `det A = +det(W_b)^2` where the paper has a minus.
pub fn det_wb(robot: &Robot, trig: &Trig) -> f64 {
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    robot.h_m * (s1 * c2 - c1 * s2) + robot.l_m * (s1 - s2)
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

/// `B` of eq. 7 in link 0's frame (including the turning of that frame), N and N m.
///
/// These are the d'Alembert forces of the three centres of mass when no velocity in link
/// 0's frame changes: `-r v` and `r u` from the turning frame, and the centripetal
/// accelerations of the joints (radius h) and of the centres of mass about them (radius b).
#[inline(always)]
pub fn velocity_terms(robot: &Robot, trig: &Trig, velocity: &Velocity) -> [f64; 5] {
    let (h, b) = (robot.h_m, robot.b_m);
    let [m0, m1, m2] = robot.mass_kg;
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    let [u, v, r, w1, w2] = *velocity;
    let (spin1, spin2) = ((r - w1) * (r - w1), (r + w2) * (r + w2));
    let (ax, ay, joint) = (-r * v, r * u, h * r * r);
    let (a1x, a1y) = (ax - joint - b * spin1 * c1, ay + b * spin1 * s1);
    let (a2x, a2y) = (ax + joint + b * spin2 * c2, ay + b * spin2 * s2);
    let torque1 = m1 * b * (s1 * a1x + c1 * a1y);
    let torque2 = m2 * b * (s2 * a2x - c2 * a2y);
    [
        m0 * ax + m1 * a1x + m2 * a2x,
        m0 * ay + m1 * a1y + m2 * a2y,
        h * (m1 * a1y - m2 * a2y) + torque1 + torque2,
        -torque1,
        torque2,
    ]
}

/// Kinetic energy, J.
pub fn kinetic_energy(robot: &Robot, trig: &Trig, velocity: &Velocity) -> f64 {
    let mass = mass_matrix(robot, trig);
    0.5 * mass.iter().zip(velocity).map(|(row, rate)| rate * dot(row, velocity)).sum::<f64>()
}

/// Product of a row with a velocity.
#[inline(always)]
pub fn dot(row: &[f64; 5], velocity: &Velocity) -> f64 {
    row.iter().zip(velocity).map(|(a, b)| a * b).sum()
}
