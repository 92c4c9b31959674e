//! Equations of motion of a chain: ordinary differential equations in minimal states or, where wheels cannot skid, a
//! system with algebraic equations of index 1.

use std::marker::PhantomData;

use nalgebra::{DMatrix, DVector};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Chain, Friction, Joint, Lanes, Link, MAX_JOINTS, MAX_LINKS, Number, Pose};

use super::balance::{Node, Posture, System};
use super::cluster::Clusters;
use super::constraint::{Constraints, Equation};
use super::determined::Determined;
use super::forces::{power_and_loss_w, sample};
use super::links::Motion;
use super::response::Response;
use super::wave::Wave;
use super::{ChainProblem, metrics_of};
use crate::cycle::Cycle;
use crate::reduced::{Reduced, Residual};
use crate::{Result, Sample};

/// Equations of motion. The states are the velocities along and across the reference link and its turning rate, then
/// the rates and then the angles of the free joints, in the order of the clusters: `N` = 2 `C` + 1 states for `C`
/// clusters and `D` = `C` + 2 velocities. Where the wheels cannot skid, constraints replace some of the equations of
/// motion.
#[derive(Debug, Clone)]
pub(super) struct Model<const N: usize, const C: usize, const D: usize, F> {
    pub problem: ChainProblem,
    pub system: System,
    pub wheels: Wheels<D>,
    /// Commands of the joints from front to rear, or the angles at which their springs are relaxed.
    commands: [Wave; MAX_JOINTS],
    friction: PhantomData<F>,
}

/// What the wheels may do.
#[derive(Debug, Clone)]
pub(super) enum Wheels<const D: usize> {
    Skid,
    /// They cannot skid; constraints replace some of the equations of motion.
    Roll(Constraints<D>),
    /// They cannot skid, and constraints and commands determine the motion.
    Determined(Determined),
}

impl<const N: usize, const C: usize, const D: usize, F: Friction> Model<N, C, D, F> {
    /// Creates the equations for a problem whose unused coefficients are zero.
    ///
    /// # Errors
    /// Returns an error if the constraints of the wheels depend on each other, or if velocities are unbounded at a
    /// phase.
    pub(super) fn new(problem: ChainProblem) -> Result<Self> {
        let mut model = Self::with_wheels(problem, Wheels::Skid);
        let problem = &model.problem;
        if problem.is_determined() {
            model.wheels = Wheels::Determined(Determined::new(&model.system, &problem.chain)?);
        } else if !problem.laws.skids() {
            model.wheels = Wheels::Roll(Constraints::new::<C>(problem)?);
        }
        Ok(model)
    }

    /// Returns the equations for another problem as [`Model::new`] does, with the singular shapes known from these
    /// equations if the motion that the constraints determine is the same.
    ///
    /// # Errors
    /// Returns an error as [`Model::new`] does.
    pub(super) fn renewed(&self, problem: ChainProblem) -> Result<Self> {
        match &self.wheels {
            Wheels::Determined(_)
                if problem.is_determined()
                    && has_same_constraints(&self.problem.chain, &problem.chain) =>
            {
                Ok(self.with_problem(problem))
            }
            _ => Self::new(problem),
        }
    }

    fn with_wheels(problem: ChainProblem, wheels: Wheels<D>) -> Self {
        const { assert!(N == 2 * C + 1 && D == C + 2) };
        let is_linear = F::is_linear(problem.laws);
        let clusters = Clusters::new(&problem.chain, problem.omega_rad_s, is_linear);
        let mut commands = [Wave::default(); MAX_JOINTS];
        for (command, joint) in commands.iter_mut().zip(&problem.chain.joints) {
            *command = Wave::new(joint.command());
        }
        Self { problem, system: System::new(clusters), wheels, commands, friction: PhantomData }
    }

    pub(super) fn constraints(&self) -> Option<&Constraints<D>> {
        match &self.wheels {
            Wheels::Roll(constraints) => Some(constraints),
            Wheels::Skid | Wheels::Determined(_) => None,
        }
    }

    /// Returns the row of the residual that is the equation of motion along the reference link or, where wheels cannot
    /// skid, along the first direction in which the chain can move; `None` if it cannot.
    pub(super) fn forward_row(&self) -> Option<usize> {
        match &self.wheels {
            Wheels::Skid => Some(0),
            Wheels::Roll(constraints) => constraints.row_of_motion(),
            Wheels::Determined(_) => None,
        }
    }

    /// Returns the same equations for another problem, whose chain has the same joints and wheels. The directions of motion
    /// that complete the constraints of wheels remain those of this problem's mean shape.
    pub(super) fn with_problem(&self, problem: ChainProblem) -> Self {
        Self::with_wheels(problem, self.wheels.clone())
    }

    /// Evaluates the residual, with its derivatives if `SLOPES`; `residual` must be zero.
    #[inline(always)]
    fn equations<T: Number, const SLOPES: bool>(
        &self,
        node: &Node<T, C>,
        y: &[T; N],
        dy: &[T; N],
        residual: &mut Residual<N, T>,
    ) {
        if let Wheels::Determined(_) = &self.wheels {
            for i in 0..3 {
                residual.value[i] = y[i] - node.determined[i];
                residual.state_jacobian[i][i] = T::splat(1.0);
            }
            return;
        }
        let posture = self.kinematics(node, y);
        let acceleration: [T; D] = std::array::from_fn(|i| dy[i]);
        let balance = self.system.balance::<T, F, C, D, SLOPES>(node, &posture, &acceleration);
        if let Wheels::Roll(constraints) = &self.wheels {
            constraints.apply::<T, N, C, SLOPES>(&self.system, node, &posture, &balance, residual);
            return;
        }
        residual.value[..D].copy_from_slice(&balance.force);
        for i in if SLOPES { 0..D } else { 0..0 } {
            residual.state_jacobian[i][..D].copy_from_slice(&balance.dforce_dvelocity[i]);
            residual.rate_jacobian[i][..D].copy_from_slice(&balance.mass[i]);
            for c in 1..C {
                residual.state_jacobian[i][D + c - 1] = balance.dforce_dphi[c][i];
            }
        }
    }

    /// Returns the response to the commands: if the wheels can skid, first as if they could not, where such a motion
    /// exists; otherwise that of these equations.
    fn response(&self) -> Option<Response<N>> {
        let constraints = match &self.wheels {
            Wheels::Skid if self.system.wheels.len() <= D => {
                Constraints::new::<C>(&self.problem).ok()
            }
            _ => None,
        };
        let as_rolling = constraints.and_then(|constraints| {
            Response::find(&Self { wheels: Wheels::Roll(constraints), ..self.clone() })
        });
        as_rolling.or_else(|| Response::find(self))
    }

    #[inline(always)]
    fn angles<T: Number>(y: &[T; N]) -> [T; C] {
        std::array::from_fn(|c| if c == 0 { T::splat(0.0) } else { y[D + c - 1] })
    }

    /// Returns the motion of the chain in state `y`, given the time derivatives `dy` of the states.
    pub(super) fn motion<T: Number>(&self, phase_rad: T, y: &[T; N], dy: &[T; N]) -> Motion<T> {
        let (sin, cos) = phase_rad.sin_cos();
        let mut joints = [[T::splat(0.0); 3]; MAX_JOINTS];
        for (j, joint) in self.problem.chain.joints.iter().enumerate() {
            if matches!(joint, Joint::Driven(_)) {
                joints[j] = self.commands[j].at([sin, cos], self.problem.omega_rad_s);
            }
        }
        for c in 1..C {
            joints[self.system.clusters.all[c].joint] = [y[D + c - 1], y[2 + c], dy[2 + c]];
        }
        Motion { phase_rad, body: [y[0], y[1], y[2]], dbody: [dy[0], dy[1], dy[2]], joints }
    }
}

/// Returns whether the constraints of wheels that cannot skid, and the commands, are the same in two chains.
fn has_same_constraints(one: &Chain, other: &Chain) -> bool {
    let of = |link: &Link| {
        let wheel = link.wheel.map(|wheel| (wheel.place_m, wheel.steer_rad));
        (link.front_joint_m, link.rear_joint_m, wheel)
    };
    one.joints == other.joints
        && one.reference == other.reference
        && one.links.iter().map(of).eq(other.links.iter().map(of))
}

impl<const N: usize, const C: usize, const D: usize, F: Friction> Reduced<N> for Model<N, C, D, F> {
    const ANGLES: usize = C - 1;

    type Node<T: Number> = Node<T, C>;
    type State<T: Number> = Posture<T, C>;

    fn skids(&self) -> bool {
        matches!(self.wheels, Wheels::Skid)
    }

    fn is_linear(&self) -> bool {
        F::is_linear(self.problem.laws)
    }

    fn omega_rad_s(&self) -> f64 {
        self.problem.omega_rad_s
    }

    fn skid_scale_m_s(&self) -> f64 {
        self.problem.chain.skid_length_m * self.problem.omega_rad_s
    }

    fn transition_m_s(&self) -> f64 {
        let wheels = self.system.wheels.iter().map(|(_, _, friction)| friction.transition_m_s);
        wheels.fold(f64::INFINITY, f64::min)
    }

    fn with_transition_scaled(&self, factor: f64) -> Option<Self> {
        (!self.is_linear()).then(|| self.with_problem(self.problem.with_transition_scaled(factor)))
    }

    fn with_friction_scaled(&self, factor: f64) -> Self {
        self.with_problem(self.problem.with_friction_scaled(factor))
    }

    fn guess(&self) -> impl Fn(f64) -> [f64; N] {
        let rest = self.at_rest();
        let response = (C > 1).then(|| self.response()).flatten();
        move |phase_rad| {
            let state = response.as_ref().map_or(rest, |response| response.at(phase_rad));
            self.consistent(phase_rad, state)
        }
    }

    #[inline(always)]
    fn node<T: Number>(&self, phase_rad: T) -> Node<T, C> {
        let mut node = self.system.node(phase_rad);
        if let Wheels::Determined(determined) = &self.wheels {
            node.determined = determined.velocities(&self.system, phase_rad);
        }
        node
    }

    fn consistent(&self, phase_rad: f64, mut y: [f64; N]) -> [f64; N] {
        match &self.wheels {
            Wheels::Skid => {}
            Wheels::Determined(determined) => {
                y[..3].copy_from_slice(&determined.velocities(&self.system, phase_rad));
            }
            Wheels::Roll(constraints) => {
                let node = self.node(phase_rad);
                let zero = [0.0; C];
                let at_rest = self.system.posture(&node.clusters, [0.0; 3], Self::angles(&y), zero);
                let own = std::array::from_fn(|i| y[i]);
                let velocities = constraints.consistent(&self.system, &node, &at_rest, &own);
                y[..D].copy_from_slice(&velocities);
            }
        }
        y
    }

    // Not inlined, because the equations are long and there are many.
    #[inline(never)]
    fn residual<T: Number>(&self, node: &Node<T, C>, y: &[T; N], dy: &[T; N]) -> Residual<N, T> {
        let mut residual = Residual::zero();
        self.equations::<T, true>(node, y, dy, &mut residual);
        residual
    }

    #[inline(never)]
    fn value<T: Number>(&self, node: &Node<T, C>, y: &[T; N], dy: &[T; N]) -> [T; N] {
        let mut residual = Residual::zero();
        self.equations::<T, false>(node, y, dy, &mut residual);
        residual.value
    }

    #[inline(always)]
    fn kinematics<T: Number>(&self, node: &Node<T, C>, y: &[T; N]) -> Posture<T, C> {
        let rates = std::array::from_fn(|c| if c == 0 { T::splat(0.0) } else { y[2 + c] });
        self.system.posture(&node.clusters, [y[0], y[1], y[2]], Self::angles(y), rates)
    }

    #[inline(always)]
    fn body<T: Number>(state: &Posture<T, C>) -> [T; 3] {
        let [u, v] = state.velocity[0];
        [u, v, state.rate[0]]
    }

    #[inline(always)]
    fn tracked<T: Number>(&self, state: &Posture<T, C>, [x_rate, y_rate]: [T; 2]) -> [T; N] {
        let mut tracked = [T::splat(0.0); N];
        tracked[..3].copy_from_slice(&[x_rate, y_rate, state.rate[0]]);
        for c in 1..C {
            tracked[2 + c] = state.joint_rate[c];
            tracked[1 + C + c] = state.phi_rad[c];
        }
        tracked
    }

    fn wheels(&self) -> usize {
        self.system.wheels.len()
    }

    #[inline(always)]
    fn skid_m_s<T: Number>(&self, node: &Node<T, C>, state: &Posture<T, C>) -> [T; MAX_LINKS] {
        let mut skid_m_s = [T::splat(0.0); MAX_LINKS];
        for (i, (cluster, ..)) in self.system.wheels.iter().enumerate() {
            skid_m_s[i] = self.system.wheel(state, &node.wheels[i], *cluster).skid_m_s;
        }
        skid_m_s
    }

    #[inline(always)]
    fn free_joint<T: Number>(state: &Posture<T, C>, index: usize) -> [T; 2] {
        [state.phi_rad[1 + index], state.joint_rate[1 + index]]
    }

    #[inline(always)]
    fn loss_w<T: Number>(&self, node: &Node<T, C>, state: &Posture<T, C>) -> T {
        self.system.loss_w::<T, F, C>(node, state)
    }

    fn power_and_loss_w(&self, phase_rad: Lanes, y: &[Lanes; N], dy: &[Lanes; N]) -> [Lanes; 2] {
        power_and_loss_w::<Lanes, F>(&self.problem, &self.motion(phase_rad, y, dy))
    }

    fn sample(&self, time_s: f64, pose: Pose, y: &[f64; N], dy: &[f64; N]) -> Sample {
        let motion = self.motion(self.problem.omega_rad_s * time_s, y, dy);
        sample::<F>(&self.problem, &motion, time_s, pose)
    }

    /// Where the wheels cannot skid, the constraints are differentiated with respect to time by central differences.
    fn rates(&self, phase_rad: f64, node: &Node<f64, C>, y: &[f64; N]) -> [f64; N] {
        const STEP_RAD: f64 = 1e-5;
        if let Wheels::Determined(determined) = &self.wheels {
            return determined.rates(&self.system, phase_rad);
        }
        let residual = self.residual(node, y, &[0.0; N]);
        let mut matrix = DMatrix::from_fn(D, D, |i, j| residual.rate_jacobian[i][j]);
        let mut right = DVector::from_fn(D, |i, _| -residual.value[i]);
        if let Some(constraints) = self.constraints() {
            let step_s = STEP_RAD / self.problem.omega_rad_s;
            let [before, after] = [-1.0, 1.0].map(|sign| {
                let mut moved = *y;
                for c in 1..C {
                    moved[D + c - 1] += sign * step_s * y[2 + c];
                }
                let node = self.node(phase_rad + sign * STEP_RAD);
                self.skid_m_s(&node, &self.kinematics(&node, &moved))
            });
            for row in 0..D {
                if let Equation::Constraint(i) = constraints.equation(row) {
                    right[row] = (before[i] - after[i]) / (2.0 * step_s);
                    (0..D).for_each(|j| matrix[(row, j)] = residual.state_jacobian[row][j]);
                }
            }
        }
        let rates = matrix.lu().solve(&right);
        std::array::from_fn(|i| match (i.checked_sub(D), &rates) {
            (Some(angle), _) => y[3 + angle],
            (None, Some(rates)) => rates[i],
            (None, None) => f64::NAN,
        })
    }

    fn half_period_signs(&self) -> Option<[f64; N]> {
        let signs = std::array::from_fn(|i| if i == 0 { 1.0 } else { -1.0 });
        self.problem.chain.is_mirrored().then_some(signs)
    }

    fn joints_rad(&self, phase_rad: f64, state: &Posture<f64, C>) -> [f64; MAX_JOINTS] {
        let mut joints_rad = [0.0; MAX_JOINTS];
        for (angle_rad, joint) in joints_rad.iter_mut().zip(&self.problem.chain.joints) {
            if let Joint::Driven(command) = joint {
                *angle_rad = command.derivative(0, phase_rad);
            }
        }
        for c in 1..C {
            joints_rad[self.system.clusters.all[c].joint] = state.phi_rad[c];
        }
        joints_rad
    }

    fn gait_metrics(&self, cycle: &Cycle) -> GaitMetrics {
        metrics_of(self, cycle)
    }

    fn at_rest(&self) -> [f64; N] {
        let mut state = [0.0; N];
        for c in 1..C {
            let joint = self.system.clusters.all[c].joint;
            state[D + c - 1] = self.problem.chain.rest_angle_rad(joint);
        }
        self.consistent(0.0, state)
    }
}
