//! Equations of motion with one passive joint and no-skid wheels.

use std::marker::PhantomData;

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{
    Balance, Friction, LANES, Lanes, MAX_JOINTS, MAX_LINKS, Number, Parameter, Pose, Quantity,
    Robot, Trig, dforce_dphi, dot, force_balance, roll_rows, skid_rows,
};

use super::harmonic::{HarmonicMotion, joint_sign};
use super::{
    COMMAND_SIZE, CommandGradient, CommandNode, Gradient, KinematicState, MAX_PARAMETERS,
    MAX_TRACKED, Reduced, Residual, ThreeLink, friction_power, friction_power_gradient, joints_rad,
    lanes, of_three_links,
};
use crate::Problem;
use crate::cycle::Cycle;
use crate::forces::contact_forces;
use crate::trajectory::Sample;

/// Equations of motion with no-skid wheels and with joint `passive` (index 0 or 1) on its spring. The states
/// are the factor `s` of the null direction defined below, and the passive joint's angle `phi_p`.
///
/// Link 0 moves at `u` along and `v` across its heading `theta`; the constraint of its wheel is `v = 0`.
/// Joints are at the distance `h` from wheel 0 and `l` from the wheels of their side links. With `sigma = 1`
/// for joint 1 and `-1` for joint 2, the constraints of the wheels of the commanded link a and of the passive
/// link p are
///
/// ```text
/// sin(phi_a) u + (l_a + h_a cos phi_a) theta' = sigma_a l_a phi_a'
/// l_p phi_p' = sigma_p (sin(phi_p) u + (l_p + h_p cos phi_p) theta')
/// ```
///
/// The first has the solutions `(u, theta') = s n + e` with the null direction `n = (l_a + h_a cos phi_a,
/// -sin phi_a)`, which never vanishes, and a particular solution `e`; the second gives `phi_p'`. Neither
/// involves the matrix `W_b` of eq. 4 of the paper, so the joint angles at which `det W_b = 0` are regular
/// here. The equations of motion (eq. 7 of the paper) contain no constraint forces after projection on the
/// null direction of all velocities, whose components along `u`, `v`, `theta'` and `phi_p'` are `(n_u, 0,
/// n_r, n_p)`.
#[derive(Debug, Clone)]
pub(crate) struct PassiveNoSkid<F> {
    problem: Problem,
    passive: usize,
    friction: PhantomData<F>,
}

/// Joint command at one time, with the null direction and the particular solution of the commanded link's
/// wheel constraint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ConstrainedNode<T = f64> {
    command: CommandNode<T>,
    constraint: Constraint<T>,
    frame: Frame<T>,
}

/// Null direction and particular solution `(u, theta')` of the commanded link's wheel constraint, and their
/// time derivatives.
#[derive(Debug, Clone, Copy)]
struct Frame<T = f64> {
    null: [T; 2],
    null_rate: [T; 2],
    particular: [T; 2],
    particular_rate: [T; 2],
}

impl<T: Number> Frame<T> {
    #[inline(always)]
    fn velocities(&self, s: T) -> [T; 2] {
        std::array::from_fn(|i| s * self.null[i] + self.particular[i])
    }

    #[inline(always)]
    fn accelerations(&self, s: T, ds: T) -> [T; 2] {
        std::array::from_fn(|i| ds * self.null[i] + s * self.null_rate[i] + self.particular_rate[i])
    }
}

/// Solutions of the commanded link's wheel constraint as functions of that link's joint angle, with their
/// first two derivatives.
#[derive(Debug, Clone, Copy)]
struct Constraint<T> {
    /// Null direction `(u, theta')` and its first two derivatives with respect to the commanded joint's
    /// angle.
    null: [[T; 2]; 3],
    /// Particular solution `(u, theta')` per unit of the commanded joint's rate, and its first two
    /// derivatives with respect to that joint's angle.
    particular: [[T; 2]; 3],
    /// Commanded joint rate, rad/s.
    rate: T,
    /// Commanded joint acceleration, rad/s^2.
    acceleration: T,
}

impl<T: Number> Constraint<T> {
    #[inline(always)]
    fn frame(&self) -> Frame<T> {
        let Self { null, particular: [e, de, _], rate, acceleration } = self;
        Frame {
            null: null[0],
            null_rate: null[1].map(|entry| entry * *rate),
            particular: e.map(|entry| entry * *rate),
            particular_rate: [0, 1].map(|i| de[i] * *rate * *rate + e[i] * *acceleration),
        }
    }

    /// Returns the change in the null direction and in the particular solution for given changes in the
    /// commanded joint's angle, rate and acceleration.
    #[inline(always)]
    fn frame_change(&self, [dphi, drate, dacceleration]: [T; 3]) -> Frame<T> {
        let Self { null, particular: [e, de, d2e], rate, acceleration } = self;
        let turned = *rate * dphi;
        Frame {
            null: null[1].map(|entry| entry * dphi),
            null_rate: [0, 1].map(|i| null[2][i] * turned + null[1][i] * drate),
            particular: [0, 1].map(|i| de[i] * turned + e[i] * drate),
            particular_rate: [0, 1].map(|i| {
                d2e[i] * *rate * turned
                    + de[i] * (*acceleration * dphi + T::splat(2.0) * *rate * drate)
                    + e[i] * dacceleration
            }),
        }
    }
}

/// Wheel constraint of the passive link, which determines `phi_p'` from `(u, theta')`.
struct PassiveWheel<T> {
    sin: T,
    cos: T,
    arm_m: T,
    h_m: T,
    /// Sign of the passive joint (see [`joint_sign`]) divided by the length of its side link, 1/m.
    per_m: T,
}

impl<T: Number> PassiveWheel<T> {
    /// Returns the passive joint's rate `phi_p'`, rad/s.
    #[inline(always)]
    fn rate(&self, [u, r]: [T; 2]) -> T {
        self.per_m * (self.sin * u + self.arm_m * r)
    }

    /// Returns the derivative of the passive joint's rate `phi_p'` with respect to its angle `phi_p`.
    #[inline(always)]
    fn drate_dphi(&self, [u, r]: [T; 2]) -> T {
        self.per_m * (self.cos * u - self.h_m * self.sin * r)
    }

    /// Returns the second derivative of the passive joint's rate `phi_p'` with respect to its angle `phi_p`.
    #[inline(always)]
    fn d2rate_dphi2(&self, [u, r]: [T; 2]) -> T {
        -(self.per_m * (self.sin * u + self.h_m * self.cos * r))
    }
}

/// Equations of motion at one time, projected on the null direction of the wheel constraints, with
/// intermediate results.
struct Projected<T> {
    residual: Residual<2, T>,
    balance: Balance<T>,
    trig: Trig<T>,
    state: KinematicState<T>,
    wheel: PassiveWheel<T>,
    /// Velocities `(u, theta')`.
    velocities: [T; 2],
    /// Components of the null direction along `u`, `theta'` and `phi_p'`.
    null: [T; 3],
}

impl<F: Friction> PassiveNoSkid<F> {
    #[inline(always)]
    fn trig<T: Number>(&self, node: &ConstrainedNode<T>, y: &[T; 2]) -> Trig<T> {
        let p = self.passive;
        let mut trig = node.command.trig;
        (trig.s[p], trig.c[p]) = y[1].sin_cos();
        trig
    }

    pub(crate) fn new(problem: Problem, passive: usize) -> Self {
        Self { problem, passive, friction: PhantomData }
    }

    /// Returns the indices of the velocities along which the null direction has components: `u`, `theta'` and
    /// `phi_p'`. They are also the indices of the equations of motion (rows of eq. 7 of the paper) to be
    /// projected.
    fn rows(&self) -> [usize; 3] {
        [0, 2, 3 + self.passive]
    }

    #[inline(always)]
    fn wheel<T: Number>(&self, trig: &Trig<T>) -> PassiveWheel<T> {
        let p = self.passive;
        let robot = &self.problem.robot;
        let h_m = T::splat(robot.h_m[p]);
        let l_m = robot.l_m[p];
        let sin = trig.s[p];
        let cos = trig.c[p];
        let arm_m = T::splat(l_m) + h_m * cos;
        let per_m = T::splat(joint_sign(p) / l_m);
        PassiveWheel { sin, cos, arm_m, h_m, per_m }
    }

    #[inline(always)]
    fn equations<T: Number>(
        &self,
        node: &ConstrainedNode<T>,
        y: &[T; 2],
        dy: &[T; 2],
    ) -> Projected<T> {
        let p = self.passive;
        let robot = &self.problem.robot;
        let frame = &node.frame;
        let trig = self.trig(node, y);
        let wheel = self.wheel(&trig);
        let velocities = frame.velocities(y[0]);
        let accelerations = frame.accelerations(y[0], dy[0]);
        let n_p = wheel.rate(frame.null);
        let dn_p_dphi = wheel.drate_dphi(frame.null);
        let w = wheel.rate(velocities);
        let dw_dphi = wheel.drate_dphi(velocities);
        let dw_rate_ds = dn_p_dphi * w + dw_dphi * n_p + wheel.rate(frame.null_rate);
        let dw_rate_dphi = wheel.d2rate_dphi2(velocities) * w
            + dw_dphi * dw_dphi
            + wheel.drate_dphi(accelerations);

        let state = self.kinematics(node, y);
        let acceleration = self.acceleration(node, y, dy);
        let KinematicState { phi_rad, velocity, .. } = state;
        let balance =
            force_balance::<T, F>(robot, Some(p), phi_rad, &trig, &velocity, &acceleration);
        let turned = dforce_dphi::<T, F>(robot, Some(p), p, &trig, &velocity, &acceleration);

        let rows = self.rows();
        let null = [frame.null[0], frame.null[1], n_p];
        let zero = T::splat(0.0);
        let one = T::splat(1.0);
        let projected =
            |row: &dyn Fn(usize) -> T| (0..3).fold(zero, |sum, k| sum + null[k] * row(rows[k]));
        // Derivative of the projected force balance for given changes in velocities and accelerations.
        let along = |velocity: [T; 3], rate: [T; 3]| -> T {
            projected(&|row| {
                (0..3).fold(zero, |sum, k| {
                    let dforce_dvelocity = &balance.dforce_dvelocity[row];
                    let mass = &balance.mass[row];
                    sum + dforce_dvelocity[rows[k]] * velocity[k] + mass[rows[k]] * rate[k]
                })
            })
        };
        let value = projected(&|row| balance.force[row]);
        let dvalue_ds = along(null, [frame.null_rate[0], frame.null_rate[1], dw_rate_ds]);
        let dvalue_dphi = along([zero, zero, dw_dphi], [zero, zero, dw_rate_dphi])
            + projected(&|row| turned[row])
            + dn_p_dphi * balance.force[3 + p];
        let residual = Residual {
            value: [value, dy[1] - w],
            state_jacobian: [[dvalue_ds, dvalue_dphi], [-n_p, -dw_dphi]],
            rate_jacobian: [[along([zero; 3], null), zero], [zero, one]],
        };
        Projected { residual, balance, trig, state, wheel, velocities, null }
    }

    /// Returns the solutions of the commanded link's wheel constraint.
    #[inline(always)]
    fn constraint<T: Number>(&self, command: &CommandNode<T>) -> Constraint<T> {
        let a = 1 - self.passive;
        let sin = command.trig.s[a];
        let cos = command.trig.c[a];
        let robot = &self.problem.robot;
        let h = T::splat(robot.h_m[a]);
        let l = T::splat(robot.l_m[a]);
        let two = T::splat(2.0);
        let arm = l + h * cos;
        // Minimum-norm particular solution, with rotation weighted by the length l.
        let norm = l * l * sin * sin + arm * arm;
        let turn = l * l * cos - h * arm;
        let dnorm = two * sin * turn;
        let d2norm = two * (cos * turn + (h * h - l * l) * sin * sin);
        let lever = T::splat(joint_sign(a)) * l;
        let per_norm = T::splat(1.0) / norm;
        let direction =
            [[l * l * sin, arm], [l * l * cos, -(h * sin)], [-(l * l * sin), -(h * cos)]];
        let [value, slope, curve] = direction.map(|entries| entries.map(|entry| lever * entry));
        let particular: [T; 2] = std::array::from_fn(|i| value[i] * per_norm);
        let dparticular: [T; 2] =
            std::array::from_fn(|i| (slope[i] - particular[i] * dnorm) * per_norm);
        let d2particular = std::array::from_fn(|i| {
            (curve[i] - two * dparticular[i] * dnorm - particular[i] * d2norm) * per_norm
        });
        Constraint {
            null: [[arm, -sin], [-(h * sin), -cos], [-(h * cos), sin]],
            particular: [particular, dparticular, d2particular],
            rate: command.shape.rate_rad_s[a],
            acceleration: command.shape.acceleration_rad_s2[a],
        }
    }
}

impl<F: Friction> Reduced<2> for PassiveNoSkid<F> {
    of_three_links!(2);

    const INTEGRATED: bool = false;
    const ANGLES: usize = 1;
    type Node<T: Number> = ConstrainedNode<T>;

    fn with_transition_scaled(&self, factor: f64) -> Option<Self> {
        (!F::IS_LINEAR)
            .then(|| Self::new(self.problem.with_transition_scaled(factor), self.passive))
    }

    fn with_friction_scaled(&self, factor: f64) -> Self {
        Self::new(self.problem.with_friction_scaled(factor), self.passive)
    }

    fn guess(&self) -> impl Fn(f64) -> [f64; 2] {
        let Problem { robot, .. } = &self.problem;
        let rest = self.at_rest();
        let arm_m = robot.reach_m()[1 - self.passive];
        let motion = HarmonicMotion::find(&self.problem, self.passive);
        move |phase_rad| {
            motion.as_ref().map_or(rest, |motion| {
                let [phi_rad, ..] = motion.at(phase_rad);
                [motion.speed_m_s / arm_m, rest[1] + phi_rad]
            })
        }
    }

    #[inline(always)]
    fn node<T: Number>(&self, phase_rad: T) -> ConstrainedNode<T> {
        let command = CommandNode::new(&self.problem, phase_rad);
        let constraint = self.constraint(&command);
        ConstrainedNode { command, constraint, frame: constraint.frame() }
    }

    #[inline(always)]
    fn residual<T: Number>(
        &self,
        node: &ConstrainedNode<T>,
        y: &[T; 2],
        dy: &[T; 2],
    ) -> Residual<2, T> {
        self.equations(node, y, dy).residual
    }

    #[inline(always)]
    fn kinematics<T: Number>(&self, node: &ConstrainedNode<T>, y: &[T; 2]) -> KinematicState<T> {
        let p = self.passive;
        let [u, r] = node.frame.velocities(y[0]);
        let mut phi_rad = node.command.shape.phi_rad;
        phi_rad[p] = y[1];
        let zero = T::splat(0.0);
        let mut velocity = [u, zero, r, zero, zero];
        let trig = self.trig(node, y);
        velocity[3 + p] = self.wheel(&trig).rate([u, r]);
        velocity[4 - p] = node.command.shape.rate_rad_s[1 - p];
        KinematicState { phi_rad, trig, velocity }
    }

    fn half_period_signs(&self) -> Option<[f64; 2]> {
        self.problem.is_mirrored().then_some([1.0, -1.0])
    }

    fn joints_rad(&self, _: f64, state: &Self::State<f64>) -> [f64; MAX_JOINTS] {
        joints_rad(Self::of(state).phi_rad)
    }

    fn gait_metrics(&self, cycle: &Cycle<2>) -> GaitMetrics {
        cycle.gait_metrics(&self.problem)
    }

    fn at_rest(&self) -> [f64; 2] {
        [0.0, self.problem.robot.rest_angle_rad]
    }
}

impl<F: Friction> ThreeLink<2> for PassiveNoSkid<F> {
    const ROBOT_VARIABLES: usize = F::ROLL.len() + 2;
    const COMMANDED: usize = 1;
    const SKIDS: bool = false;

    fn of<T: Number>(state: &KinematicState<T>) -> &KinematicState<T> {
        state
    }

    fn problem(&self) -> &Problem {
        &self.problem
    }

    fn parameter(&self, column: usize) -> Parameter {
        match column.checked_sub(F::ROLL.len()) {
            None => F::ROLL[column],
            Some(0) => Quantity::Stiffness.one(),
            Some(_) => Quantity::Damping.one(),
        }
    }

    #[inline(always)]
    fn sensitivity<T: Number>(
        &self,
        node: &ConstrainedNode<T>,
        y: &[T; 2],
        dy: &[T; 2],
        parameters: usize,
        jacobian: &mut [[T; MAX_PARAMETERS]],
    ) -> Residual<2, T> {
        let p = self.passive;
        let a = 1 - self.passive;
        let robot = &self.problem.robot;
        let Projected { residual, balance, trig, state, wheel, velocities, null } =
            self.equations(node, y, dy);
        let rows = self.rows();
        let zero = T::splat(0.0);
        let along = |force: &[T; 5]| -> T {
            null.iter().zip(&rows).fold(zero, |sum, (n, &row)| sum + *n * force[row])
        };
        for (wheel, row) in roll_rows(robot, &trig).iter().enumerate() {
            F::roll_slopes(robot, wheel, dot(row, &state.velocity), |column, slope| {
                jacobian[0][column] += along(row) * slope;
            });
        }
        let [stiffness, damping] = [F::ROLL.len(), F::ROLL.len() + 1];
        jacobian[0][stiffness] = null[2] * (y[1] - T::splat(robot.rest_angle_rad));
        jacobian[0][damping] = null[2] * state.velocity[3 + p];
        if parameters <= Self::ROBOT_VARIABLES {
            return residual;
        }
        // The frame of the constraints rotates with the commanded joint.
        let w = wheel.rate(velocities);
        let drate_dphi = wheel.drate_dphi(velocities);
        let acceleration = self.acceleration(node, y, dy);
        let turned = dforce_dphi::<T, F>(robot, Some(p), a, &trig, &state.velocity, &acceleration);
        let mut set = |slopes: [T; 3], column: usize| {
            let frame = node.constraint.frame_change(slopes);
            let dvelocities = frame.velocities(y[0]);
            let daccelerations = frame.accelerations(y[0], dy[0]);
            let dw = wheel.rate(dvelocities);
            let [phi, rate, acceleration] = slopes;
            let mut velocity = [dvelocities[0], zero, dvelocities[1], zero, zero];
            let mut rates = [daccelerations[0], zero, daccelerations[1], zero, zero];
            velocity[3 + p] = dw;
            velocity[3 + a] = rate;
            rates[3 + p] =
                wheel.drate_dphi(dvelocities) * w + drate_dphi * dw + wheel.rate(daccelerations);
            rates[3 + a] = acceleration;
            let dnull = [frame.null[0], frame.null[1], wheel.rate(frame.null)];
            let mut sum = zero;
            for ((n, dn), &row) in null.iter().zip(&dnull).zip(&rows) {
                let force = dot(&balance.dforce_dvelocity[row], &velocity)
                    + dot(&balance.mass[row], &rates)
                    + turned[row] * phi;
                sum += *n * force + *dn * balance.force[row];
            }
            jacobian[0][column] = sum;
            jacobian[1][column] = -dw;
        };
        for (number, slopes) in node.command.slopes(a, &self.problem).into_iter().enumerate() {
            set(slopes, Self::ROBOT_VARIABLES + number);
        }
        if parameters > Self::FIRST_HARMONIC_VARIABLES {
            for (part, slopes) in node.command.second_slopes(&self.problem).into_iter().enumerate()
            {
                set(slopes, Self::FIRST_HARMONIC_VARIABLES + part);
            }
        }
        residual
    }

    #[inline(always)]
    fn acceleration<T: Number>(
        &self,
        node: &ConstrainedNode<T>,
        y: &[T; 2],
        dy: &[T; 2],
    ) -> [T; 5] {
        let p = self.passive;
        let wheel = self.wheel(&self.trig(node, y));
        let velocities = node.frame.velocities(y[0]);
        let [du, dr] = node.frame.accelerations(y[0], dy[0]);
        let zero = T::splat(0.0);
        let mut acceleration = [du, zero, dr, zero, zero];
        acceleration[3 + p] =
            wheel.drate_dphi(velocities) * wheel.rate(velocities) + wheel.rate([du, dr]);
        acceleration[4 - p] = node.command.shape.acceleration_rad_s2[1 - p];
        acceleration
    }

    #[inline(always)]
    fn state_gradient<T: Number>(
        &self,
        node: &ConstrainedNode<T>,
        y: &[T; 2],
        trig: &Trig<T>,
        gradient: &Gradient<T>,
    ) -> [T; 2] {
        let p = self.passive;
        let wheel = self.wheel(trig);
        let frame = &node.frame;
        let [u, _, r, ..] = gradient.velocity;
        let dw = gradient.velocity[3 + p];
        let ds = u * frame.null[0] + r * frame.null[1] + dw * wheel.rate(frame.null);
        let dphi = gradient.phi_rad[p] + dw * wheel.drate_dphi(frame.velocities(y[0]));
        [ds, dphi]
    }

    #[inline(always)]
    fn gait_gradient<T: Number>(
        &self,
        node: &ConstrainedNode<T>,
        y: &[T; 2],
        trig: &Trig<T>,
        gradient: &Gradient<T>,
    ) -> [CommandGradient<T>; 2] {
        let p = self.passive;
        let a = 1 - self.passive;
        let wheel = self.wheel(trig);
        let [u, _, r, ..] = gradient.velocity;
        let mut gradients = node.command.gait_gradient(gradient, &self.problem);
        let mut add = |number: usize, slopes: [T; 3]| {
            let velocities = node.constraint.frame_change(slopes).velocities(y[0]);
            gradients[a][number] += u * velocities[0]
                + r * velocities[1]
                + gradient.velocity[3 + p] * wheel.rate(velocities);
        };
        for (number, slopes) in node.command.slopes(a, &self.problem).into_iter().enumerate() {
            add(number, slopes);
        }
        if self.problem.gait.has_second() {
            for (part, slopes) in node.command.second_slopes(&self.problem).into_iter().enumerate()
            {
                add(COMMAND_SIZE + part, slopes);
            }
        }
        gradients
    }

    #[inline(always)]
    fn friction_power_gradient<T: Number>(&self, state: &KinematicState<T>) -> Gradient<T> {
        friction_power_gradient::<T, F>(&self.problem.robot, Some(self.passive), state)
    }

    #[inline(always)]
    fn add_friction_power_slopes<T: Number>(
        &self,
        state: &KinematicState<T>,
        weight: T,
        columns: &mut [T; MAX_PARAMETERS],
    ) {
        let robot = &self.problem.robot;
        let velocity = &state.velocity;
        for (wheel, row) in roll_rows(robot, &state.trig).iter().enumerate() {
            let along = dot(row, velocity);
            F::roll_slopes(robot, wheel, along, |column, slope| {
                columns[column] += weight * along * slope;
            });
        }
        let rate = velocity[3 + self.passive];
        columns[F::ROLL.len() + 1] += weight * rate * rate;
    }
}
