//! Equations of motion with skidding wheels.

use std::marker::PhantomData;

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{
    Balance, Friction, LANES, Lanes, MAX_JOINTS, MAX_LINKS, Number, Parameter, Pose, Quantity,
    Robot, Trig, dforce_dphi, dot, force_balance, roll_rows, skid_rows,
};

use super::harmonic::HarmonicMotion;
use super::{
    CommandGradient, CommandNode, Gradient, KinematicState, MAX_PARAMETERS, MAX_TRACKED, Reduced,
    Residual, ThreeLink, friction_power, friction_power_gradient, joints_rad, lanes,
    of_three_links,
};
use crate::Problem;
use crate::cycle::Cycle;
use crate::forces::contact_forces;
use crate::trajectory::Sample;

/// Equations of motion with skidding wheels. The states are the velocities `u` along and `v` across link 0 and
/// its turning rate `theta'` (`N` = 3). If joint `passive` (index 0 or 1) is on its spring, that joint's rate
/// `phi_p'` and angle `phi_p` are two further states (`N` = 5).
#[derive(Debug, Clone)]
pub(crate) struct Skid<const N: usize, F> {
    problem: Problem,
    /// Index of the passive joint; unused if both joints are commanded.
    passive: usize,
    friction: PhantomData<F>,
}

impl<const N: usize, F: Friction> Skid<N, F> {
    #[inline(always)]
    fn trig<T: Number>(&self, node: &CommandNode<T>, y: &[T; N]) -> Trig<T> {
        let mut trig = node.trig;
        if let Some(p) = self.passive() {
            (trig.s[p], trig.c[p]) = y[4].sin_cos();
        }
        trig
    }

    pub(crate) fn new(problem: Problem, passive: usize) -> Self {
        Self { problem, passive, friction: PhantomData }
    }

    const IS_PASSIVE: bool = N == 5;
    /// Number of friction parameters of the wheels.
    const WHEEL_PARAMETERS: usize = F::SKID.len() + F::ROLL.len();
    /// Number of residual equations, all of which are equations of motion (rows of eq. 7 of the paper).
    const ROWS: usize = if Self::IS_PASSIVE { 4 } else { 3 };

    #[inline(always)]
    fn passive(&self) -> Option<usize> {
        Self::IS_PASSIVE.then_some(self.passive)
    }

    /// Returns the index of the equation of motion (row of eq. 7 of the paper) that is residual equation `i`: first the
    /// three equations of link 0, then that of the passive joint.
    #[inline(always)]
    fn row(&self, i: usize) -> usize {
        if i < 3 { i } else { 3 + self.passive }
    }

    #[inline(always)]
    fn equations<T: Number>(
        &self,
        node: &CommandNode<T>,
        trig: &Trig<T>,
        y: &[T; N],
        dy: &[T; N],
    ) -> (Residual<N, T>, Balance<T>) {
        let robot = &self.problem.robot;
        let passive = self.passive();
        let KinematicState { phi_rad, velocity, .. } = self.kinematics(node, y);
        let acceleration = self.acceleration(node, y, dy);
        let balance =
            force_balance::<T, F>(robot, passive, phi_rad, trig, &velocity, &acceleration);
        let mut residual = Residual::zero();
        for i in 0..Self::ROWS {
            let row = self.row(i);
            residual.value[i] = balance.force[row];
            for j in 0..Self::ROWS {
                let column = self.row(j);
                residual.state_jacobian[i][j] = balance.dforce_dvelocity[row][column];
                residual.rate_jacobian[i][j] = balance.mass[row][column];
            }
        }
        if let Some(p) = passive {
            let turned = dforce_dphi::<T, F>(robot, passive, p, trig, &velocity, &acceleration);
            for i in 0..Self::ROWS {
                residual.state_jacobian[i][4] = turned[self.row(i)];
            }
        }
        (residual, balance)
    }
}

impl<const N: usize, F: Friction> Reduced<N> for Skid<N, F> {
    of_three_links!(N);

    const INTEGRATED: bool = Self::IS_PASSIVE;
    const ANGLES: usize = Self::IS_PASSIVE as usize;
    type Node<T: Number> = CommandNode<T>;

    fn with_transition_scaled(&self, factor: f64) -> Option<Self> {
        (!F::IS_LINEAR)
            .then(|| Self::new(self.problem.with_transition_scaled(factor), self.passive))
    }

    fn with_friction_scaled(&self, factor: f64) -> Self {
        Self::new(self.problem.with_friction_scaled(factor), self.passive)
    }

    fn guess(&self) -> impl Fn(f64) -> [f64; N] {
        let rest = self.at_rest();
        let motion = self.passive().and_then(|p| HarmonicMotion::find(&self.problem, p));
        move |phase_rad| {
            motion.as_ref().map_or(rest, |motion| {
                let [phi_rad, rate_rad_s, turning_rad_s] = motion.at(phase_rad);
                let state = [motion.speed_m_s, 0.0, turning_rad_s, rate_rad_s, phi_rad];
                std::array::from_fn(|i| rest[i] + state[i])
            })
        }
    }

    #[inline(always)]
    fn node<T: Number>(&self, phase_rad: T) -> CommandNode<T> {
        CommandNode::new(&self.problem, phase_rad)
    }

    #[inline(always)]
    fn residual<T: Number>(
        &self,
        node: &CommandNode<T>,
        y: &[T; N],
        dy: &[T; N],
    ) -> Residual<N, T> {
        self.equations(node, &self.trig(node, y), y, dy).0
    }

    #[inline(always)]
    fn kinematics<T: Number>(&self, node: &CommandNode<T>, y: &[T; N]) -> KinematicState<T> {
        let mut phi_rad = node.shape.phi_rad;
        let trig = self.trig(node, y);
        let [w1, w2] = node.shape.rate_rad_s;
        let mut velocity = [y[0], y[1], y[2], w1, w2];
        if let Some(p) = self.passive() {
            velocity[3 + p] = y[3];
            phi_rad[p] = y[4];
        }
        KinematicState { phi_rad, trig, velocity }
    }

    fn half_period_signs(&self) -> Option<[f64; N]> {
        let signs = std::array::from_fn(|i| if i == 0 { 1.0 } else { -1.0 });
        self.problem.is_mirrored().then_some(signs)
    }

    fn joints_rad(&self, _: f64, state: &Self::State<f64>) -> [f64; MAX_JOINTS] {
        joints_rad(Self::of(state).phi_rad)
    }

    fn gait_metrics(&self, cycle: &Cycle<N>) -> GaitMetrics {
        cycle.gait_metrics(&self.problem)
    }

    fn at_rest(&self) -> [f64; N] {
        std::array::from_fn(|i| if i == 4 { self.problem.robot.rest_angle_rad } else { 0.0 })
    }
}

impl<const N: usize, F: Friction> ThreeLink<N> for Skid<N, F> {
    const ROBOT_VARIABLES: usize = Self::WHEEL_PARAMETERS + if Self::IS_PASSIVE { 2 } else { 0 };
    const COMMANDED: usize = if Self::IS_PASSIVE { 1 } else { 2 };
    const SKIDS: bool = true;

    fn of<T: Number>(state: &KinematicState<T>) -> &KinematicState<T> {
        state
    }

    fn problem(&self) -> &Problem {
        &self.problem
    }

    fn parameter(&self, column: usize) -> Parameter {
        const JOINT: [Parameter; 2] = [Quantity::Stiffness.one(), Quantity::Damping.one()];
        match column.checked_sub(Self::WHEEL_PARAMETERS) {
            Some(number) => JOINT[number],
            None => F::SKID.get(column).copied().unwrap_or_else(|| F::ROLL[column - F::SKID.len()]),
        }
    }

    #[inline(always)]
    fn sensitivity<T: Number>(
        &self,
        node: &CommandNode<T>,
        y: &[T; N],
        dy: &[T; N],
        parameters: usize,
        jacobian: &mut [[T; MAX_PARAMETERS]],
    ) -> Residual<N, T> {
        let robot = &self.problem.robot;
        let trig = self.trig(node, y);
        let (residual, balance) = self.equations(node, &trig, y, dy);
        let velocity = self.kinematics(node, y).velocity;
        let acceleration = self.acceleration(node, y, dy);
        let skid = skid_rows(robot, &trig);
        let roll = roll_rows(robot, &trig);
        for wheel in 0..3 {
            let across = dot(&skid[wheel], &velocity);
            let along = dot(&roll[wheel], &velocity);
            F::skid_slopes(robot, wheel, across, |column, slope| {
                for i in 0..Self::ROWS {
                    jacobian[i][column] += skid[wheel][self.row(i)] * slope;
                }
            });
            F::roll_slopes(robot, wheel, along, |column, slope| {
                for i in 0..Self::ROWS {
                    jacobian[i][F::SKID.len() + column] += roll[wheel][self.row(i)] * slope;
                }
            });
        }
        let mut columns = Self::ROBOT_VARIABLES..parameters.min(Self::FIRST_HARMONIC_VARIABLES);
        let mut of_second = Self::FIRST_HARMONIC_VARIABLES..parameters;
        for joint in (0..2).filter(|joint| self.passive() != Some(*joint)) {
            let turned = dforce_dphi::<T, F>(robot, None, joint, &trig, &velocity, &acceleration);
            let mut set = |[phi, rate, acceleration]: [T; 3], column: usize| {
                for i in 0..Self::ROWS {
                    let row = self.row(i);
                    jacobian[i][column] = turned[row] * phi
                        + balance.dforce_dvelocity[row][3 + joint] * rate
                        + balance.mass[row][3 + joint] * acceleration;
                }
            };
            let slopes = node.slopes(joint, &self.problem).into_iter();
            slopes.zip(columns.by_ref()).for_each(|(slopes, column)| set(slopes, column));
            if parameters > Self::FIRST_HARMONIC_VARIABLES {
                let slopes = node.second_slopes(&self.problem).into_iter();
                slopes.zip(of_second.by_ref()).for_each(|(slopes, column)| set(slopes, column));
            }
        }
        if Self::IS_PASSIVE {
            let [stiffness, damping] = [Self::WHEEL_PARAMETERS, Self::WHEEL_PARAMETERS + 1];
            jacobian[3][stiffness] = y[4] - T::splat(robot.rest_angle_rad);
            jacobian[3][damping] = y[3];
        }
        residual
    }

    #[inline(always)]
    fn acceleration<T: Number>(&self, node: &CommandNode<T>, _y: &[T; N], dy: &[T; N]) -> [T; 5] {
        let [a1, a2] = node.shape.acceleration_rad_s2;
        let mut acceleration = [dy[0], dy[1], dy[2], a1, a2];
        if let Some(p) = self.passive() {
            acceleration[3 + p] = dy[3];
        }
        acceleration
    }

    #[inline(always)]
    fn state_gradient<T: Number>(
        &self,
        _node: &CommandNode<T>,
        _y: &[T; N],
        _trig: &Trig<T>,
        gradient: &Gradient<T>,
    ) -> [T; N] {
        let mut state_gradient = [T::splat(0.0); N];
        for i in 0..Self::ROWS {
            state_gradient[i] = gradient.velocity[self.row(i)];
        }
        if let Some(p) = self.passive() {
            state_gradient[4] = gradient.phi_rad[p];
        }
        state_gradient
    }

    #[inline(always)]
    fn gait_gradient<T: Number>(
        &self,
        node: &CommandNode<T>,
        _y: &[T; N],
        _trig: &Trig<T>,
        gradient: &Gradient<T>,
    ) -> [CommandGradient<T>; 2] {
        node.gait_gradient(gradient, &self.problem)
    }

    #[inline(always)]
    fn friction_power_gradient<T: Number>(&self, state: &KinematicState<T>) -> Gradient<T> {
        friction_power_gradient::<T, F>(&self.problem.robot, self.passive(), state)
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
        let skid = skid_rows(robot, &state.trig);
        let roll = roll_rows(robot, &state.trig);
        for wheel in 0..3 {
            let across = dot(&skid[wheel], velocity);
            let along = dot(&roll[wheel], velocity);
            F::skid_slopes(robot, wheel, across, |column, slope| {
                columns[column] += weight * across * slope;
            });
            F::roll_slopes(robot, wheel, along, |column, slope| {
                columns[F::SKID.len() + column] += weight * along * slope;
            });
        }
        if let Some(p) = self.passive() {
            columns[Self::WHEEL_PARAMETERS + 1] += weight * velocity[3 + p] * velocity[3 + p];
        }
    }
}
