//! Wheels that skid.

use std::marker::PhantomData;

use trilink_robot::{
    Balance, Friction, Number, Parameter, Quantity, Trig, dforce_dphi, dot, force_balance,
    roll_rows, skid_rows,
};

use super::harmonic::HarmonicMotion;
use super::{
    BySlopes, CommandNode, KinematicState, MOST_PARAMETERS, Reduced, Residual, friction_power,
    friction_power_gradient,
};
use crate::Problem;

/// Wheels that skid. With both joints commanded (`N` = 3) the states are `u, v, theta'`; with
/// joint `passive` (0 or 1) on its spring (`N` = 5) `phi_p', phi_p` follow them.
#[derive(Debug, Clone)]
pub(crate) struct Skid<const N: usize, F> {
    problem: Problem,
    /// Of no meaning where both joints are commanded.
    passive: usize,
    friction: PhantomData<F>,
}

impl<const N: usize, F: Friction> Skid<N, F> {
    pub(crate) fn new(problem: Problem, passive: usize) -> Self {
        Self { problem, passive, friction: PhantomData }
    }

    const IS_PASSIVE: bool = N == 5;
    /// Parameters of the wheels.
    const OF_WHEELS: usize = F::SKID.len() + F::ROLL.len();
    /// Rows of eq. 7 among the equations.
    const ROWS: usize = if Self::IS_PASSIVE { 4 } else { 3 };

    #[inline(always)]
    fn passive(&self) -> Option<usize> {
        Self::IS_PASSIVE.then_some(self.passive)
    }

    /// The row of eq. 7 that is equation `i`: the body's three, then the passive joint's.
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
        let (robot, passive) = (&self.problem.robot, self.passive());
        let KinematicState { phi_rad, velocity } = self.kinematics(node, y);
        let acceleration = self.acceleration(node, y, dy);
        let balance =
            force_balance::<T, F>(robot, passive, phi_rad, trig, &velocity, &acceleration);
        let zero = T::of(0.0);
        let mut residual = Residual {
            value: [zero; N],
            state_jacobian: [[zero; N]; N],
            rate_jacobian: [[zero; N]; N],
        };
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
    const OF_ROBOT: usize = Self::OF_WHEELS + if Self::IS_PASSIVE { 2 } else { 0 };
    const COMMANDED: usize = if Self::IS_PASSIVE { 1 } else { 2 };
    const SKIDS: bool = true;
    const IS_LINEAR: bool = F::IS_LINEAR;
    const INTEGRATED: bool = Self::IS_PASSIVE;
    const HAS_ANGLE: bool = Self::IS_PASSIVE;

    type Node<T: Number> = CommandNode<T>;

    fn softened(&self, factor: f64) -> Option<Self> {
        (!F::IS_LINEAR).then(|| Self::new(self.problem.softened(factor), self.passive))
    }

    fn resisted(&self, factor: f64) -> Self {
        Self::new(self.problem.resisted(factor), self.passive)
    }

    fn problem(&self) -> &Problem {
        &self.problem
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

    fn parameter(&self, column: usize) -> Parameter {
        const JOINT: [Parameter; 2] = [Quantity::Stiffness.one(), Quantity::Damping.one()];
        match column.checked_sub(Self::OF_WHEELS) {
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
        jacobian: &mut [[T; MOST_PARAMETERS]],
    ) -> Residual<N, T> {
        let robot = &self.problem.robot;
        let trig = self.trig(node, y);
        let (residual, balance) = self.equations(node, &trig, y, dy);
        let (velocity, acceleration) =
            (self.kinematics(node, y).velocity, self.acceleration(node, y, dy));
        let (skid, roll) = (skid_rows(robot, &trig), roll_rows(robot, &trig));
        for wheel in 0..3 {
            let (across, along) = (dot(&skid[wheel], &velocity), dot(&roll[wheel], &velocity));
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
        let mut columns = Self::OF_ROBOT..parameters.min(Self::OF_FIRST);
        let mut of_second = Self::OF_FIRST..parameters;
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
            if parameters > Self::OF_FIRST {
                let slopes = node.second_slopes(&self.problem).into_iter();
                slopes.zip(of_second.by_ref()).for_each(|(slopes, column)| set(slopes, column));
            }
        }
        if Self::IS_PASSIVE {
            let [stiffness, damping] = [Self::OF_WHEELS, Self::OF_WHEELS + 1];
            jacobian[3][stiffness] = y[4] - T::of(robot.rest_angle_rad);
            jacobian[3][damping] = y[3];
        }
        residual
    }

    #[inline(always)]
    fn kinematics<T: Number>(&self, node: &CommandNode<T>, y: &[T; N]) -> KinematicState<T> {
        let (mut phi_rad, [w1, w2]) = (node.shape.phi_rad, node.shape.rate_rad_s);
        let mut velocity = [y[0], y[1], y[2], w1, w2];
        if let Some(p) = self.passive() {
            (velocity[3 + p], phi_rad[p]) = (y[3], y[4]);
        }
        KinematicState { phi_rad, velocity }
    }

    #[inline(always)]
    fn trig<T: Number>(&self, node: &CommandNode<T>, y: &[T; N]) -> Trig<T> {
        let mut trig = node.trig;
        if let Some(p) = self.passive() {
            (trig.s[p], trig.c[p]) = y[4].sin_cos();
        }
        trig
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
        gradient: &KinematicState<T>,
    ) -> [T; N] {
        let mut by_state = [T::of(0.0); N];
        for i in 0..Self::ROWS {
            by_state[i] = gradient.velocity[self.row(i)];
        }
        if let Some(p) = self.passive() {
            by_state[4] = gradient.phi_rad[p];
        }
        by_state
    }

    #[inline(always)]
    fn gait_gradient<T: Number>(
        &self,
        node: &CommandNode<T>,
        _y: &[T; N],
        _trig: &Trig<T>,
        gradient: &KinematicState<T>,
    ) -> [BySlopes<T>; 2] {
        node.gait_gradient(gradient, &self.problem)
    }

    #[inline(always)]
    fn friction_power<T: Number>(&self, state: &KinematicState<T>, trig: &Trig<T>) -> T {
        friction_power::<T, F>(&self.problem.robot, self.passive(), state, trig)
    }

    #[inline(always)]
    fn friction_power_gradient<T: Number>(
        &self,
        state: &KinematicState<T>,
        trig: &Trig<T>,
    ) -> KinematicState<T> {
        friction_power_gradient::<T, F>(&self.problem.robot, self.passive(), state, trig)
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
        let (skid, roll) = (skid_rows(robot, trig), roll_rows(robot, trig));
        for wheel in 0..3 {
            let (across, along) = (dot(&skid[wheel], velocity), dot(&roll[wheel], velocity));
            F::skid_slopes(robot, wheel, across, |column, slope| {
                columns[column] += weight * across * slope;
            });
            F::roll_slopes(robot, wheel, along, |column, slope| {
                columns[F::SKID.len() + column] += weight * along * slope;
            });
        }
        if let Some(p) = self.passive() {
            columns[Self::OF_WHEELS + 1] += weight * velocity[3 + p] * velocity[3 + p];
        }
    }

    fn half_period_signs(&self) -> Option<[f64; N]> {
        let signs = || std::array::from_fn(|i| if i == 0 { 1.0 } else { -1.0 });
        self.problem.is_mirrored().then(signs)
    }

    fn at_rest(&self) -> [f64; N] {
        std::array::from_fn(|i| if i == 4 { self.problem.robot.rest_angle_rad } else { 0.0 })
    }
}
