//! Equation of motion (eq. 7) in the frame of link 0: force balance, its Jacobian, and the mass matrix.
//!
//! # Derivation
//!
//! In the frame of link 0 the centres of mass have the accelerations
//!
//! ```text
//! a0 = (u' - r v,            v' + r u)                                   with r = theta'
//! a1 = a0 + h1 (-r^2,  r') + b1 r1' n1 - b1 r1^2 t1                         with r1 = r - phi1'
//! a2 = a0 + h2 ( r^2, -r') - b2 r2' n2 + b2 r2^2 t2                         with r2 = r + phi2'
//! ```
//!
//! d'Alembert's principle projects `m_i a_i` and `I_i r_i'` onto the five velocities `(u, v, r, phi1',
//! phi2')`; the wheels add their [`Friction`] along each skid and each roll row (viscous: eq. 14 and 15),
//! and the passive joint its spring and damper (eq. 11). The rows sum to the generalised force that
//! actuators and constraints must supply: zero for `u, v, r` of a skidding robot and for its passive joint.
//! The balance does not depend on position or heading.

use super::kinematics::{Trig, Velocity, droll_rows_dphi, dskid_rows_dphi, roll_rows, skid_rows};
use super::{Friction, Number, Robot};

/// Contact forces, joint torques and power at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactForces {
    /// Lateral contact force on each wheel, N: the constraint force Lambda (eq. 8 of the paper) where the
    /// wheels cannot skid, otherwise friction (eq. 15 of the paper). NaN where Lambda is unbounded.
    pub lateral_n: [f64; 3],
    /// Rolling friction force on each wheel (eq. 14 of the paper), N.
    pub roll_n: [f64; 3],
    /// Joint torques, N m: those of the actuators or, at a passive joint, of the spring and damper (eq. 11 of
    /// the paper). NaN where the constraint forces on the wheels are unbounded.
    pub torque_nm: [f64; 2],
    /// Power of the actuators, W; bounded even where the constraint forces on the wheels are not.
    pub power_w: f64,
    /// Power dissipated at the wheels and in the passive joint, W.
    pub loss_w: f64,
}

/// Left-hand side of the equation of motion, `M q'' + B + G - F_d` (eq. 7 of the paper), and its derivatives
/// with respect to accelerations and velocities; [`dforce_dphi`] returns those with respect to the joint
/// angles.
#[derive(Debug, Clone, Copy)]
pub struct Balance<T = f64> {
    /// Generalised forces conjugate to the components of [`Velocity`] (N, N, N m, N m, N m).
    pub force: [T; 5],
    /// Derivative of the forces with respect to the accelerations: the [`mass_matrix`].
    pub mass: [[T; 5]; 5],
    /// `dforce_dvelocity[i][j]`: derivative of force i with respect to velocity j.
    pub dforce_dvelocity: [[T; 5]; 5],
}

/// Returns the mass matrix `M` of the equation of motion (eq. 7 of the paper) in the frame of link 0, in kg,
/// kg m and kg m^2; rows and columns are in the order of [`Velocity`].
#[inline(always)]
pub fn mass_matrix<T: Number>(robot: &Robot, trig: &Trig<T>) -> [[T; 5]; 5] {
    let [h1, h2] = robot.h_m;
    let [b1, b2] = robot.b_m;
    let [m0, m1, m2] = robot.mass_kg;
    let [j1, j2] = [1, 2].map(|link| robot.inertia_about_joint_kg_m2(link));
    let middle = robot.inertia_kg_m2[0] + m1 * h1 * h1 + m2 * h2 * h2 + j1 + j2;
    let [total, mb1, mb2, uneven] =
        [m0 + m1 + m2, m1 * b1, m2 * b2, m1 * h1 - m2 * h2].map(T::splat);
    let [middle, h1, h2, j1, j2, zero] = [middle, h1, h2, j1, j2, 0.0].map(T::splat);
    let Trig { s: [s1, s2], c: [c1, c2] } = *trig;
    let u_1 = -(mb1 * s1);
    let v_1 = -(mb1 * c1);
    let u_2 = mb2 * s2;
    let v_2 = -(mb2 * c2);
    let p1 = j1 - h1 * v_1;
    let p2 = j2 - h2 * v_2;
    let u_r = u_2 - u_1;
    let v_r = uneven + v_2 - v_1;
    let r_r = middle - T::splat(2.0) * (h1 * v_1 + h2 * v_2);
    [
        [total, zero, u_r, u_1, u_2],
        [zero, total, v_r, v_1, v_2],
        [u_r, v_r, r_r, -p1, p2],
        [u_1, v_1, -p1, j1, zero],
        [u_2, v_2, p2, zero, j2],
    ]
}

/// Side link: the front one points forward (joint index 0, `sign` 1), the rear one backward (joint index 1,
/// `sign` -1).
struct SideLink<'a, T> {
    robot: &'a Robot,
    joint: usize,
    sign: T,
    sin: T,
    cos: T,
    /// Turning rate of the side link, rad/s.
    turning: T,
    /// Angular acceleration of the side link, rad/s^2.
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
        let sign = T::splat(if joint == 0 { 1.0 } else { -1.0 });
        let turning = velocity[2] - sign * velocity[3 + joint];
        let dturning = acceleration[2] - sign * acceleration[3 + joint];
        let sin = trig.s[joint];
        let cos = trig.c[joint];
        Self { robot, joint, sign, sin, cos, turning, dturning }
    }

    #[inline(always)]
    fn mass(&self) -> T {
        T::splat(self.robot.mass_kg[1 + self.joint])
    }

    #[inline(always)]
    fn h_m(&self) -> T {
        T::splat(self.robot.h_m[self.joint])
    }

    #[inline(always)]
    fn b_m(&self) -> T {
        T::splat(self.robot.b_m[self.joint])
    }

    /// Returns the centripetal and tangential accelerations of the side link's centre of mass relative to the
    /// joint.
    #[inline(always)]
    fn swing(&self) -> [T; 2] {
        let b = self.b_m();
        [b * self.turning * self.turning, b * self.dturning]
    }

    /// Returns the acceleration of the side link's centre of mass, given that of link 0's origin and the
    /// turning rate and angular acceleration of link 0.
    #[inline(always)]
    fn acceleration(&self, [ax, ay]: [T; 2], turning: T, dturning: T) -> [T; 2] {
        let h = self.h_m();
        let [inward, across] = self.swing();
        [
            ax - self.sign * (h * turning * turning + inward * self.cos) + across * self.sin,
            ay + self.sign * (h * dturning + across * self.cos) + inward * self.sin,
        ]
    }

    /// Returns the generalised inertial force of the side link's mass, given the acceleration `middle` of
    /// link 0's origin, the turning rate `r` of link 0, and the angular acceleration `dr` of link 0.
    #[inline(always)]
    fn inertial_force(&self, middle: [T; 2], r: T, dr: T) -> [T; 5] {
        let [ax, ay] = self.acceleration(middle, r, dr);
        self.project([self.mass() * ax, self.mass() * ay])
    }

    /// Returns the derivative of the side link's generalised inertial force with respect to the turning rate
    /// of link 0, without the terms due to the acceleration of link 0's origin.
    #[inline(always)]
    fn dinertial_force_dr(&self, r: T) -> [T; 5] {
        let [gx, gy] = self.gyration();
        let centre = T::splat(2.0) * self.mass() * self.h_m() * r;
        self.project([-(self.sign * (centre + gx)), -(self.sign * gy)])
    }

    /// Projects a force on the side link's centre of mass onto the five velocities.
    #[inline(always)]
    fn project(&self, [fx, fy]: [T; 2]) -> [T; 5] {
        let h = self.h_m();
        let b = self.b_m();
        let torque = b * (self.sin * fx + self.sign * self.cos * fy);
        self.generalised([fx, fy, self.sign * h * fy + torque], -(self.sign * torque))
    }

    /// Returns the generalised force with the components `[fx, fy, torque]` along the three velocities of
    /// link 0 and `own` along the rate of the side link's joint.
    #[inline(always)]
    fn generalised(&self, [fx, fy, torque]: [T; 3], own: T) -> [T; 5] {
        let zero = T::splat(0.0);
        if self.joint == 0 { [fx, fy, torque, own, zero] } else { [fx, fy, torque, zero, own] }
    }

    /// Returns the derivative of the inertial force on the side link's centre of mass with respect to the
    /// side link's turning rate.
    #[inline(always)]
    fn gyration(&self) -> [T; 2] {
        let twice = T::splat(2.0) * self.mass() * self.b_m() * self.turning;
        [twice * self.cos, -(self.sign * twice * self.sin)]
    }
}

/// Returns the acceleration of link 0's origin along its own axes, m/s^2.
#[inline(always)]
fn middle_acceleration<T: Number>(velocity: &Velocity<T>, acceleration: &[T; 5]) -> [T; 2] {
    let [u, v, r, ..] = *velocity;
    [acceleration[0] - r * v, acceleration[1] + r * u]
}

/// Evaluates the left-hand side of the equation of motion (eq. 7 of the paper) and its derivatives at joint
/// angles `phi_rad` (with their sines and cosines `trig`), `velocity` and `acceleration` (the time
/// derivatives of the five velocities); `passive` is the index of the spring-loaded joint, if there is one.
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
    let m0 = T::splat(robot.mass_kg[0]);
    let [inertia0, inertia1, inertia2] = robot.inertia_kg_m2.map(T::splat);
    let [u, v, r, ..] = *velocity;
    let dr = acceleration[2];
    let middle = middle_acceleration(velocity, acceleration);
    let front = SideLink::new(robot, 0, trig, velocity, acceleration);
    let rear = SideLink::new(robot, 1, trig, velocity, acceleration);
    let front_force = front.inertial_force(middle, r, dr);
    let rear_force = rear.inertial_force(middle, r, dr);
    let spin1 = inertia1 * front.dturning;
    let spin2 = inertia2 * rear.dturning;
    let mut force = [
        front_force[0] + rear_force[0] + m0 * middle[0],
        front_force[1] + rear_force[1] + m0 * middle[1],
        front_force[2] + rear_force[2] + inertia0 * dr + spin1 + spin2,
        front_force[3] - spin1,
        rear_force[4] + spin2,
    ];

    // The rotation of the frame accelerates all masses alike; the rotation of the side links adds to that.
    let front_slopes = front.dinertial_force_dr(r);
    let rear_slopes = rear.dinertial_force_dr(r);
    let joint1_slopes = front.project(front.gyration());
    let joint2_slopes = rear.project(rear.gyration());
    let mut dforce_dvelocity = [[T::splat(0.0); 5]; 5];
    for i in 0..5 {
        let [mass_u, mass_v, ..] = mass[i];
        let turning = mass_v * u - mass_u * v + front_slopes[i] + rear_slopes[i];
        dforce_dvelocity[i] =
            [mass_v * r, -(mass_u * r), turning, joint1_slopes[i], joint2_slopes[i]];
    }

    let skid = skid_rows(robot, trig);
    let roll = roll_rows(robot, trig);
    let mut sums = (&mut force, &mut dforce_dvelocity);
    add_friction(&mut sums, |v| F::skid(&robot.wheel_friction(0), v), &skid[0], [1], velocity);
    add_friction(&mut sums, |v| F::roll(&robot.wheel_friction(0), v), &roll[0], [0], velocity);
    add_friction(
        &mut sums,
        |v| F::skid(&robot.wheel_friction(1), v),
        &skid[1],
        [0, 1, 2, 3],
        velocity,
    );
    add_friction(
        &mut sums,
        |v| F::skid(&robot.wheel_friction(2), v),
        &skid[2],
        [0, 1, 2, 4],
        velocity,
    );
    add_friction(
        &mut sums,
        |v| F::roll(&robot.wheel_friction(1), v),
        &roll[1],
        [0, 1, 2],
        velocity,
    );
    add_friction(
        &mut sums,
        |v| F::roll(&robot.wheel_friction(2), v),
        &roll[2],
        [0, 1, 2],
        velocity,
    );

    if let Some(joint) = passive {
        let row = 3 + joint;
        let [stiffness, damping, rest] =
            [robot.stiffness_nm_rad, robot.damping_nm_s_rad, robot.rest_angle_rad].map(T::splat);
        force[row] += stiffness * (phi_rad[joint] - rest) + damping * velocity[row];
        dforce_dvelocity[row][row] += damping;
    }
    Balance { force, mass, dforce_dvelocity }
}

/// Returns the derivative of the left-hand side of the equation of motion (see [`force_balance`]) with
/// respect to the angle of `joint` (0 or 1).
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
    // The side link's acceleration and its lever arm b rotate with its joint.
    let [inward, across] = link.swing();
    let mass = link.mass();
    let along = mass * (across * cos + sign * inward * sin);
    let aside = mass * (inward * cos - sign * across * sin);
    let middle = middle_acceleration(velocity, acceleration);
    let [ax, ay] = link.acceleration(middle, velocity[2], acceleration[2]);
    let arm = mass * link.b_m() * (cos * ax - sign * sin * ay);
    let mut turned = link.project([along, aside]);
    turned[2] += arm;
    turned[3 + joint] -= sign * arm;
    // Only the rows of the side link's own wheel depend on its joint's angle.
    let wheel = joint + 1;
    let skid = skid_rows(robot, trig)[wheel];
    let dskid = dskid_rows_dphi(robot, trig)[joint];
    let roll = roll_rows(robot, trig)[wheel];
    let droll = droll_rows_dphi(robot, trig)[joint];
    let entries = [0, 1, 2, 3 + joint];
    turn_friction(
        &mut turned,
        |v| F::skid(&robot.wheel_friction(wheel), v),
        [&skid, &dskid],
        entries,
        velocity,
    );
    turn_friction(
        &mut turned,
        |v| F::roll(&robot.wheel_friction(wheel), v),
        [&roll, &droll],
        [0, 1, 2],
        velocity,
    );
    if passive == Some(joint) {
        turned[3 + joint] += T::splat(robot.stiffness_nm_rad);
    }
    turned
}

/// Adds to the balance the friction force `row * resistance(row . velocity)` and its derivative with respect
/// to the velocity (`.` is the dot product). Only the given `entries` of the row may be nonzero.
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

/// Adds to `dforce_dphi` the derivative of the friction force `row * resistance(row . velocity)` with respect
/// to a joint angle, where `turn` is the derivative of `row` (`.` is the dot product). Only the given
/// `entries` of `row` and `turn` may be nonzero.
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

/// Returns the dot product of a row and a velocity, summed over the given entries of the row; the others must
/// be zero.
#[inline(always)]
fn speed<T: Number, const K: usize>(
    row: &[T; 5],
    entries: [usize; K],
    velocity: &Velocity<T>,
) -> T {
    entries.iter().fold(T::splat(0.0), |sum, &i| sum + row[i] * velocity[i])
}
