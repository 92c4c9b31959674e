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
//! phi1', phi2')`; the wheels add their [`Friction`] along each skid and each roll
//! row (eq. 14 and 15 where it is viscous), the passive joint its spring and damper (eq. 11). The
//! rows sum to the generalised force that actuators and constraints must supply: zero for `u, v, r`
//! of a skidding robot and for its passive joint. Nothing depends on position or heading.

use super::kinematics::{Trig, Velocity, droll_rows_dphi, dskid_rows_dphi, roll_rows, skid_rows};
use super::{Friction, Number, Robot};

/// Forces of the ground, torques and power at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactForces {
    /// Force of the ground on each wheel across it, N: the constraint force Lambda (eq. 8) where
    /// the wheels cannot skid, else friction (eq. 15). NaN where Lambda is unbounded.
    pub lateral_n: [f64; 3],
    /// Friction along each wheel (eq. 14), N.
    pub roll_n: [f64; 3],
    /// Torque of the actuators, or of spring and damper at the passive joint (eq. 11), N m. NaN
    /// where Lambda is unbounded.
    pub torque_nm: [f64; 2],
    /// Power of the actuators, W; bounded where Lambda is not.
    pub power_w: f64,
    /// Power that friction takes, at the wheels and in the passive joint, W.
    pub loss_w: f64,
}

/// The left-hand side of eq. 7, `M q'' + B + G - F_d`, and its derivatives; for those with respect
/// to the joint angles see [`dforce_dphi`].
#[derive(Debug, Clone, Copy)]
pub struct Balance<T = f64> {
    /// Generalised forces (N, N, N m, N m, N m) along [`Velocity`].
    pub force: [T; 5],
    /// [`mass_matrix`]: the derivative with respect to the accelerations.
    pub mass: [[T; 5]; 5],
    /// `dforce_dvelocity[i][j]`: derivative of force i with respect to velocity j.
    pub dforce_dvelocity: [[T; 5]; 5],
}

/// `M` of eq. 7 in link 0's frame: kg, kg m and kg m^2, rows and columns as [`Velocity`].
#[inline(always)]
pub fn mass_matrix<T: Number>(robot: &Robot, trig: &Trig<T>) -> [[T; 5]; 5] {
    let (h, b) = (robot.h_m, robot.b_m);
    let [m0, m1, m2] = robot.mass_kg;
    let [i0, i1, i2] = robot.inertia_kg_m2;
    let (j1, j2) = (m1 * b * b + i1, m2 * b * b + i2);
    let middle = T::of(i0 + (m1 + m2) * h * h + j1 + j2);
    let (total, h, mb1, mb2) = (T::of(m0 + m1 + m2), T::of(h), T::of(m1 * b), T::of(m2 * b));
    let (j1, j2, uneven, zero) = (T::of(j1), T::of(j2), h * T::of(m1 - m2), T::of(0.0));
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

/// A side link: it points ahead (`sign` 1, joint 0) or back (-1, joint 1).
struct SideLink<'a, T> {
    robot: &'a Robot,
    joint: usize,
    sign: T,
    sin: T,
    cos: T,
    /// Its turning rate and what that changes by.
    turning: T,
    dturning: T,
}

impl<'a, T: Number> SideLink<'a, T> {
    #[inline(always)]
    fn new(
        robot: &'a Robot,
        joint: usize,
        trig: &Trig<T>,
        velocity: &Velocity<T>,
        acceleration: &[T; 5],
    ) -> Self {
        let sign = T::of(if joint == 0 { 1.0 } else { -1.0 });
        let turning = velocity[2] - sign * velocity[3 + joint];
        let dturning = acceleration[2] - sign * acceleration[3 + joint];
        let (sin, cos) = (trig.s[joint], trig.c[joint]);
        Self { robot, joint, sign, sin, cos, turning, dturning }
    }

    #[inline(always)]
    fn mass(&self) -> T {
        T::of(self.robot.mass_kg[1 + self.joint])
    }

    /// The accelerations of its centre of mass by its own turning: towards the joint, and across.
    #[inline(always)]
    fn swing(&self) -> [T; 2] {
        let b = T::of(self.robot.b_m);
        [b * self.turning * self.turning, b * self.dturning]
    }

    /// The acceleration of its centre of mass, given that of link 0's.
    #[inline(always)]
    fn acceleration(&self, [ax, ay]: [T; 2], turning: T, dturning: T) -> [T; 2] {
        let (h, [inward, across]) = (T::of(self.robot.h_m), self.swing());
        [
            ax - self.sign * (h * turning * turning + inward * self.cos) + across * self.sin,
            ay + self.sign * (h * dturning + across * self.cos) + inward * self.sin,
        ]
    }

    /// Projects a force on its centre of mass on the five velocities.
    #[inline(always)]
    fn project(&self, [fx, fy]: [T; 2]) -> [T; 5] {
        let (h, b) = (T::of(self.robot.h_m), T::of(self.robot.b_m));
        let torque = b * (self.sin * fx + self.sign * self.cos * fy);
        self.on_joint([fx, fy, self.sign * h * fy + torque], -(self.sign * torque))
    }

    /// Forces on the body and on its own joint.
    #[inline(always)]
    fn on_joint(&self, [fx, fy, torque]: [T; 3], own: T) -> [T; 5] {
        let zero = T::of(0.0);
        if self.joint == 0 { [fx, fy, torque, own, zero] } else { [fx, fy, torque, zero, own] }
    }

    /// The part of the centre of mass's force, per turning rate, that its own turning makes.
    #[inline(always)]
    fn gyration(&self) -> [T; 2] {
        let twice = T::of(2.0) * self.mass() * T::of(self.robot.b_m) * self.turning;
        [twice * self.cos, -(self.sign * twice * self.sin)]
    }
}

/// The acceleration of link 0's centre along its own axes, m/s^2.
#[inline(always)]
fn acceleration_of_middle<T: Number>(velocity: &Velocity<T>, acceleration: &[T; 5]) -> [T; 2] {
    let [u, v, r, ..] = *velocity;
    [acceleration[0] - r * v, acceleration[1] + r * u]
}

/// Evaluates eq. 7 at angles `phi_rad` (with their `trig`), `velocity` and `acceleration`
/// (time derivatives of the five velocities); `passive` is the index of the joint on a spring.
#[inline(always)]
pub fn force_balance<T: Number, F: Friction>(
    robot: &Robot,
    passive: Option<usize>,
    phi_rad: [T; 2],
    trig: &Trig<T>,
    velocity: &Velocity<T>,
    acceleration: &[T; 5],
) -> Balance<T> {
    let mass = mass_matrix(robot, trig);
    let (m0, inertia) = (T::of(robot.mass_kg[0]), |link: usize| T::of(robot.inertia_kg_m2[link]));
    let ([u, v, r, ..], dr) = (*velocity, acceleration[2]);
    let middle = acceleration_of_middle(velocity, acceleration);
    let link = |joint| SideLink::new(robot, joint, trig, velocity, acceleration);
    let (front, rear) = (link(0), link(1));
    let moved = |link: &SideLink<T>| {
        let [ax, ay] = link.acceleration(middle, r, dr);
        link.project([link.mass() * ax, link.mass() * ay])
    };
    let (by_front, by_rear) = (moved(&front), moved(&rear));
    let (spin1, spin2) = (inertia(1) * front.dturning, inertia(2) * rear.dturning);
    let mut force = [
        by_front[0] + by_rear[0] + m0 * middle[0],
        by_front[1] + by_rear[1] + m0 * middle[1],
        by_front[2] + by_rear[2] + inertia(0) * dr + spin1 + spin2,
        by_front[3] - spin1,
        by_rear[4] + spin2,
    ];

    // The frame's turning accelerates every mass alike; the side links' own turning adds to that.
    let turned = |link: &SideLink<T>| {
        let [gx, gy] = link.gyration();
        let centre = T::of(2.0) * link.mass() * T::of(robot.h_m) * r;
        link.project([-(link.sign * (centre + gx)), -(link.sign * gy)])
    };
    let (by_front, by_rear) = (turned(&front), turned(&rear));
    let (by_joint1, by_joint2) = (front.project(front.gyration()), rear.project(rear.gyration()));
    let mut dforce_dvelocity = [[T::of(0.0); 5]; 5];
    for i in 0..5 {
        let [by_ax, by_ay, ..] = mass[i];
        let turning = by_ay * u - by_ax * v + by_front[i] + by_rear[i];
        dforce_dvelocity[i] = [by_ay * r, -(by_ax * r), turning, by_joint1[i], by_joint2[i]];
    }

    let (skid, roll) = (skid_rows(robot, trig), roll_rows(robot, trig));
    let across = |wheel| move |speed| F::skid(robot, wheel, speed);
    let along = |wheel| move |speed| F::roll(robot, wheel, speed);
    let mut add = (&mut force, &mut dforce_dvelocity);
    add_friction(&mut add, across(0), &skid[0], [1], velocity);
    add_friction(&mut add, along(0), &roll[0], [0], velocity);
    add_friction(&mut add, across(1), &skid[1], [0, 1, 2, 3], velocity);
    add_friction(&mut add, across(2), &skid[2], [0, 1, 2, 4], velocity);
    add_friction(&mut add, along(1), &roll[1], [0, 1, 2], velocity);
    add_friction(&mut add, along(2), &roll[2], [0, 1, 2], velocity);

    if let Some(joint) = passive {
        let row = 3 + joint;
        let [stiffness, damping, rest] =
            [robot.stiffness_nm_rad, robot.damping_nm_s_rad, robot.rest_angle_rad].map(T::of);
        force[row] += stiffness * (phi_rad[joint] - rest) + damping * velocity[row];
        dforce_dvelocity[row][row] += damping;
    }
    Balance { force, mass, dforce_dvelocity }
}

/// Derivative of eq. 7's left-hand side, see [`force_balance`], with respect to a joint's angle.
#[inline(always)]
pub fn dforce_dphi<T: Number, F: Friction>(
    robot: &Robot,
    passive: Option<usize>,
    joint: usize,
    trig: &Trig<T>,
    velocity: &Velocity<T>,
    acceleration: &[T; 5],
) -> [T; 5] {
    let link = SideLink::new(robot, joint, trig, velocity, acceleration);
    let SideLink { sign, sin, cos, .. } = link;
    // The side link's acceleration turns with its joint, and so does the arm b.
    let [inward, across] = link.swing();
    let mass = link.mass();
    let along = mass * (across * cos + sign * inward * sin);
    let aside = mass * (inward * cos - sign * across * sin);
    let middle = acceleration_of_middle(velocity, acceleration);
    let [ax, ay] = link.acceleration(middle, velocity[2], acceleration[2]);
    let arm = mass * T::of(robot.b_m) * (cos * ax - sign * sin * ay);
    let mut turned = link.project([along, aside]);
    turned[2] += arm;
    turned[3 + joint] -= sign * arm;
    // Only the rows of its own wheel turn.
    let across = |speed| F::skid(robot, joint + 1, speed);
    let along = |speed| F::roll(robot, joint + 1, speed);
    let (skid, dskid) = (skid_rows(robot, trig)[joint + 1], dskid_rows_dphi(robot, trig)[joint]);
    let (roll, droll) = (roll_rows(robot, trig)[joint + 1], droll_rows_dphi(robot, trig)[joint]);
    turn_friction(&mut turned, across, [&skid, &dskid], [0, 1, 2, 3 + joint], velocity);
    turn_friction(&mut turned, along, [&roll, &droll], [0, 1, 2], velocity);
    if passive == Some(joint) {
        turned[3 + joint] += T::of(robot.stiffness_nm_rad);
    }
    turned
}

/// Adds `row resistance(row . velocity)` and its derivative with respect to the velocity, where the
/// row has these `entries` alone.
#[inline(always)]
fn add_friction<T: Number, const K: usize>(
    (force, dforce_dvelocity): &mut (&mut [T; 5], &mut [[T; 5]; 5]),
    resistance: impl Fn(T) -> [T; 2],
    row: &[T; 5],
    entries: [usize; K],
    velocity: &Velocity<T>,
) {
    let [resistance, slope] = resistance(speed(row, entries, velocity));
    for i in entries {
        force[i] += row[i] * resistance;
        let slope = slope * row[i];
        for j in entries {
            dforce_dvelocity[i][j] += slope * row[j];
        }
    }
}

/// Adds the derivative of `row resistance(row . velocity)` when `row` changes by `turn`.
#[inline(always)]
fn turn_friction<T: Number, const K: usize>(
    dforce_dphi: &mut [T; 5],
    resistance: impl Fn(T) -> [T; 2],
    [row, turn]: [&[T; 5]; 2],
    entries: [usize; K],
    velocity: &Velocity<T>,
) {
    let [resistance, slope] = resistance(speed(row, entries, velocity));
    let turned = slope * speed(turn, entries, velocity);
    for i in entries {
        dforce_dphi[i] += resistance * turn[i] + turned * row[i];
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
