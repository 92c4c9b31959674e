//! One joint on its spring, wheels that cannot skid.

use std::marker::PhantomData;

use trilink_robot::{
    Balance, Friction, Number, Parameter, Quantity, Trig, dforce_dphi, dot, force_balance,
    roll_rows,
};

use super::harmonic::{HarmonicMotion, joint_sign};
use super::{
    BySlopes, CommandNode, KinematicState, MOST_PARAMETERS, NUMBERS, Reduced, Residual,
    friction_power, friction_power_gradient,
};
use crate::Problem;

/// Joint `passive` (0 or 1) on its spring, wheels that cannot skid. States `s, phi_p`.
///
/// Wheel 0 leaves `v = 0`. With `sigma = 1` for joint 1 and `-1` for joint 2, the wheel of the
/// commanded link a and that of the passive link p leave
///
/// ```text
/// sin(phi_a) u + (l + h cos phi_a) theta' = sigma_a l phi_a'
/// l phi_p' = sigma_p (sin(phi_p) u + (l + h cos phi_p) theta')
/// ```
///
/// The first has the solutions `(u, theta') = s n + e` with the null direction
/// `n = (l + h cos phi_a, -sin phi_a)`, which is never zero, and a particular solution `e`;
/// the second gives `phi_p'`. Neither needs `det W_b`, so nothing happens where it is zero.
/// Eq. 7 projected on the null direction `(n_u, 0, n_r, n_p)` is free of constraint forces.
#[derive(Debug, Clone)]
pub(crate) struct PassiveNoSkid<F> {
    problem: Problem,
    passive: usize,
    friction: PhantomData<F>,
}

/// What the command prescribes: the null direction and the particular solution.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ConstrainedNode<T = f64> {
    command: CommandNode<T>,
    constraint: Constraint<T>,
    frame: Frame<T>,
}

/// `(u, theta')` along the null direction and of the particular solution, and their time
/// derivatives.
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

/// What the wheel of the commanded link leaves, as functions of that joint's angle with their first
/// two derivatives.
#[derive(Debug, Clone, Copy)]
struct Constraint<T> {
    /// `(u, theta')` along the null direction.
    null: [[T; 2]; 3],
    /// Of the particular solution, per unit of the commanded rate.
    particular: [[T; 2]; 3],
    /// The commanded rate and acceleration.
    rate: T,
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

    /// Change of the frame with the commanded joint's angle, rate and acceleration.
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
                    + de[i] * (*acceleration * dphi + T::of(2.0) * *rate * drate)
                    + e[i] * dacceleration
            }),
        }
    }
}

/// The wheel of the passive link, which gives `phi_p'` from `(u, theta')`.
struct PassiveWheel<T> {
    sin: T,
    cos: T,
    arm_m: T,
    h_m: T,
    /// `sigma_p / l`.
    per_m: T,
}

impl<T: Number> PassiveWheel<T> {
    /// `phi_p'`.
    #[inline(always)]
    fn rate(&self, [u, r]: [T; 2]) -> T {
        self.per_m * (self.sin * u + self.arm_m * r)
    }

    /// Derivative of `phi_p'` with respect to `phi_p`.
    #[inline(always)]
    fn drate_dphi(&self, [u, r]: [T; 2]) -> T {
        self.per_m * (self.cos * u - self.h_m * self.sin * r)
    }

    /// The second derivative.
    #[inline(always)]
    fn d2rate_dphi2(&self, [u, r]: [T; 2]) -> T {
        -(self.per_m * (self.sin * u + self.h_m * self.cos * r))
    }
}

/// The projected equations of one state and what they are made of.
struct Projected<T> {
    residual: Residual<2, T>,
    balance: Balance<T>,
    trig: Trig<T>,
    state: KinematicState<T>,
    wheel: PassiveWheel<T>,
    /// `(u, theta')`.
    velocities: [T; 2],
    /// The null direction along `u`, `theta'` and `phi_p'`.
    null: [T; 3],
}

impl<F: Friction> PassiveNoSkid<F> {
    pub(crate) fn new(problem: Problem, passive: usize) -> Self {
        Self { problem, passive, friction: PhantomData }
    }

    /// Rows of eq. 7 that the null direction has parts along.
    fn rows(&self) -> [usize; 3] {
        [0, 2, 3 + self.passive]
    }

    #[inline(always)]
    fn wheel<T: Number>(&self, trig: &Trig<T>) -> PassiveWheel<T> {
        let (h_m, l_m) = (T::of(self.problem.robot.h_m), self.problem.robot.l_m);
        let (sin, cos) = (trig.s[self.passive], trig.c[self.passive]);
        let (arm_m, per_m) = (T::of(l_m) + h_m * cos, T::of(joint_sign(self.passive) / l_m));
        PassiveWheel { sin, cos, arm_m, h_m, per_m }
    }

    #[inline(always)]
    fn equations<T: Number>(
        &self,
        node: &ConstrainedNode<T>,
        y: &[T; 2],
        dy: &[T; 2],
    ) -> Projected<T> {
        let (p, robot, frame) = (self.passive, &self.problem.robot, &node.frame);
        let trig = self.trig(node, y);
        let wheel = self.wheel(&trig);
        let velocities = frame.velocities(y[0]);
        let accelerations = frame.accelerations(y[0], dy[0]);
        let (n_p, dn_p_dphi) = (wheel.rate(frame.null), wheel.drate_dphi(frame.null));
        let (w, dw_dphi) = (wheel.rate(velocities), wheel.drate_dphi(velocities));
        let dw_rate_ds = dn_p_dphi * w + dw_dphi * n_p + wheel.rate(frame.null_rate);
        let dw_rate_dphi = wheel.d2rate_dphi2(velocities) * w
            + dw_dphi * dw_dphi
            + wheel.drate_dphi(accelerations);

        let state = self.kinematics(node, y);
        let acceleration = self.acceleration(node, y, dy);
        let KinematicState { phi_rad, velocity } = state;
        let balance =
            force_balance::<T, F>(robot, Some(p), phi_rad, &trig, &velocity, &acceleration);
        let turned = dforce_dphi::<T, F>(robot, Some(p), p, &trig, &velocity, &acceleration);

        let rows = self.rows();
        let null = [frame.null[0], frame.null[1], n_p];
        let (zero, one) = (T::of(0.0), T::of(1.0));
        let projected =
            |of: &dyn Fn(usize) -> T| (0..3).fold(zero, |sum, k| sum + null[k] * of(rows[k]));
        // Derivative of the projected balance when velocities and accelerations change.
        let along = |velocity: [T; 3], rate: [T; 3]| -> T {
            projected(&|row| {
                (0..3).fold(zero, |sum, k| {
                    let (by_velocity, mass) = (&balance.dforce_dvelocity[row], &balance.mass[row]);
                    sum + by_velocity[rows[k]] * velocity[k] + mass[rows[k]] * rate[k]
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

    /// What the wheel of the commanded link leaves.
    #[inline(always)]
    fn constraint<T: Number>(&self, command: &CommandNode<T>) -> Constraint<T> {
        let a = 1 - self.passive;
        let (sin, cos) = (command.trig.s[a], command.trig.c[a]);
        let (h, l, two) =
            (T::of(self.problem.robot.h_m), T::of(self.problem.robot.l_m), T::of(2.0));
        let arm = l + h * cos;
        // The shortest particular solution, rotation counted as speed at the distance l.
        let norm = l * l * sin * sin + arm * arm;
        let turn = l * l * cos - h * arm;
        let (dnorm, d2norm) = (two * sin * turn, two * (cos * turn + (h * h - l * l) * sin * sin));
        let (lever, per_norm) = (T::of(joint_sign(a)) * l, T::of(1.0) / norm);
        let direction =
            [[l * l * sin, arm], [l * l * cos, -(h * sin)], [-(l * l * sin), -(h * cos)]];
        let [value, slope, curve] = direction.map(|of| of.map(|entry| lever * entry));
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
    const OF_ROBOT: usize = F::ROLL.len() + 2;
    const COMMANDED: usize = 1;
    const SKIDS: bool = false;
    const IS_LINEAR: bool = F::IS_LINEAR;
    const INTEGRATED: bool = false;
    const HAS_ANGLE: bool = true;

    type Node<T: Number> = ConstrainedNode<T>;

    fn softened(&self, factor: f64) -> Option<Self> {
        (!F::IS_LINEAR).then(|| Self::new(self.problem.softened(factor), self.passive))
    }

    fn resisted(&self, factor: f64) -> Self {
        Self::new(self.problem.resisted(factor), self.passive)
    }

    fn problem(&self) -> &Problem {
        &self.problem
    }

    fn guess(&self) -> impl Fn(f64) -> [f64; 2] {
        let Problem { robot, .. } = &self.problem;
        let (rest, arm_m) = (self.at_rest(), robot.h_m + robot.l_m);
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
        jacobian: &mut [[T; MOST_PARAMETERS]],
    ) -> Residual<2, T> {
        let (p, a, robot) = (self.passive, 1 - self.passive, &self.problem.robot);
        let Projected { residual, balance, trig, state, wheel, velocities, null } =
            self.equations(node, y, dy);
        let rows = self.rows();
        let zero = T::of(0.0);
        let along = |force: &[T; 5]| -> T {
            null.iter().zip(&rows).fold(zero, |sum, (n, &row)| sum + *n * force[row])
        };
        for (wheel, row) in roll_rows(robot, &trig).iter().enumerate() {
            F::roll_slopes(robot, wheel, dot(row, &state.velocity), |column, slope| {
                jacobian[0][column] += along(row) * slope;
            });
        }
        let [stiffness, damping] = [F::ROLL.len(), F::ROLL.len() + 1];
        jacobian[0][stiffness] = null[2] * (y[1] - T::of(robot.rest_angle_rad));
        jacobian[0][damping] = null[2] * state.velocity[3 + p];
        if parameters <= Self::OF_ROBOT {
            return residual;
        }
        // The frame of the constraints turns with the commanded joint.
        let (w, drate_dphi) = (wheel.rate(velocities), wheel.drate_dphi(velocities));
        let acceleration = self.acceleration(node, y, dy);
        let turned = dforce_dphi::<T, F>(robot, Some(p), a, &trig, &state.velocity, &acceleration);
        let mut set = |slopes: [T; 3], column: usize| {
            let frame = node.constraint.frame_change(slopes);
            let (dvelocities, daccelerations) =
                (frame.velocities(y[0]), frame.accelerations(y[0], dy[0]));
            let dw = wheel.rate(dvelocities);
            let [phi, rate, acceleration] = slopes;
            let mut velocity = [dvelocities[0], zero, dvelocities[1], zero, zero];
            let mut rates = [daccelerations[0], zero, daccelerations[1], zero, zero];
            (velocity[3 + p], velocity[3 + a]) = (dw, rate);
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
            (jacobian[0][column], jacobian[1][column]) = (sum, -dw);
        };
        for (number, slopes) in node.command.slopes(a, &self.problem).into_iter().enumerate() {
            set(slopes, Self::OF_ROBOT + number);
        }
        if parameters > Self::OF_FIRST {
            for (part, slopes) in node.command.second_slopes(&self.problem).into_iter().enumerate()
            {
                set(slopes, Self::OF_FIRST + part);
            }
        }
        residual
    }

    #[inline(always)]
    fn trig<T: Number>(&self, node: &ConstrainedNode<T>, y: &[T; 2]) -> Trig<T> {
        let (p, mut trig) = (self.passive, node.command.trig);
        (trig.s[p], trig.c[p]) = y[1].sin_cos();
        trig
    }

    #[inline(always)]
    fn acceleration<T: Number>(
        &self,
        node: &ConstrainedNode<T>,
        y: &[T; 2],
        dy: &[T; 2],
    ) -> [T; 5] {
        let (p, wheel) = (self.passive, self.wheel(&self.trig(node, y)));
        let velocities = node.frame.velocities(y[0]);
        let [du, dr] = node.frame.accelerations(y[0], dy[0]);
        let zero = T::of(0.0);
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
        gradient: &KinematicState<T>,
    ) -> [T; 2] {
        let (p, wheel, frame) = (self.passive, self.wheel(trig), &node.frame);
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
        gradient: &KinematicState<T>,
    ) -> [BySlopes<T>; 2] {
        let (p, a, wheel) = (self.passive, 1 - self.passive, self.wheel(trig));
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
                add(NUMBERS + part, slopes);
            }
        }
        gradients
    }

    #[inline(always)]
    fn kinematics<T: Number>(&self, node: &ConstrainedNode<T>, y: &[T; 2]) -> KinematicState<T> {
        let p = self.passive;
        let [u, r] = node.frame.velocities(y[0]);
        let mut phi_rad = node.command.shape.phi_rad;
        phi_rad[p] = y[1];
        let zero = T::of(0.0);
        let mut velocity = [u, zero, r, zero, zero];
        velocity[3 + p] = self.wheel(&self.trig(node, y)).rate([u, r]);
        velocity[4 - p] = node.command.shape.rate_rad_s[1 - p];
        KinematicState { phi_rad, velocity }
    }

    #[inline(always)]
    fn friction_power<T: Number>(&self, state: &KinematicState<T>, trig: &Trig<T>) -> T {
        friction_power::<T, F>(&self.problem.robot, Some(self.passive), state, trig)
    }

    #[inline(always)]
    fn friction_power_gradient<T: Number>(
        &self,
        state: &KinematicState<T>,
        trig: &Trig<T>,
    ) -> KinematicState<T> {
        friction_power_gradient::<T, F>(&self.problem.robot, Some(self.passive), state, trig)
    }

    #[inline(always)]
    fn add_friction_power_slopes<T: Number>(
        &self,
        state: &KinematicState<T>,
        trig: &Trig<T>,
        weight: T,
        columns: &mut [T; MOST_PARAMETERS],
    ) {
        let (robot, velocity) = (&self.problem.robot, &state.velocity);
        for (wheel, row) in roll_rows(robot, trig).iter().enumerate() {
            let along = dot(row, velocity);
            F::roll_slopes(robot, wheel, along, |column, slope| {
                columns[column] += weight * along * slope;
            });
        }
        let rate = velocity[3 + self.passive];
        columns[F::ROLL.len() + 1] += weight * rate * rate;
    }

    fn half_period_signs(&self) -> Option<[f64; 2]> {
        self.problem.is_mirrored().then_some([1.0, -1.0])
    }

    fn at_rest(&self) -> [f64; 2] {
        [0.0, self.problem.robot.rest_angle_rad]
    }
}
