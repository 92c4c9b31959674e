//! Interface between equations of motion and the methods that solve them.

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{LANES, Lanes, MAX_JOINTS, MAX_LINKS, Number, Pose};

use super::cycle::Cycle;
use super::sample::Sample;

/// Residual of the equations of motion and its derivatives at one time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Residual<const N: usize, T = f64> {
    pub value: [T; N],
    /// `state_jacobian[i][j]`: derivative of equation i with respect to state j.
    pub state_jacobian: [[T; N]; N],
    /// `rate_jacobian[i][j]`: derivative of equation i with respect to the time derivative of state j.
    pub rate_jacobian: [[T; N]; N],
}

impl<const N: usize, T: Number> Residual<N, T> {
    #[inline(always)]
    pub(super) fn zero() -> Self {
        let zero = T::splat(0.0);
        let jacobian = [[zero; N]; N];
        Self { value: [zero; N], state_jacobian: jacobian, rate_jacobian: jacobian }
    }
}

/// Maximum number of states: those of a chain of eight links whose joints are all free.
pub(super) const MAX_STATES: usize = 17;

/// Equations of motion `0 = residual(t, y, y')` with `N` states. The last [`Reduced::ANGLES`] states are the angles of the
/// free joints, and as many states before them are their rates; all others are velocities. The residual does not contain
/// that the rates are the time derivatives of the angles: the collocation integrates them.
pub(super) trait Reduced<const N: usize>: Clone {
    /// Number of states that are angles.
    const ANGLES: usize;

    /// Number of unknowns per stage of a collocation element.
    const UNKNOWNS: usize = N - Self::ANGLES;

    /// Joint commands at one time, with the quantities that depend on them alone; computed once per solution.
    type Node<T: Number>: Copy + std::fmt::Debug;

    /// Joint angles and velocities of the robot at one time.
    type State<T: Number>: Copy + std::fmt::Debug;

    /// Returns whether the wheels can skid.
    fn skids(&self) -> bool;

    /// Returns whether every friction force is proportional to the wheel's velocity in the direction of the force.
    fn is_linear(&self) -> bool;

    fn omega_rad_s(&self) -> f64;

    /// Returns the speed `l omega` by which skid velocities are divided in the skid ratio (eq. 20 of the paper), m/s.
    fn skid_scale_m_s(&self) -> f64;

    /// Returns the transition speed of dry friction, m/s.
    fn transition_m_s(&self) -> f64;

    /// Returns the equations with the transition speed of dry friction multiplied by `factor`; `None` if
    /// there is no dry friction.
    fn with_transition_scaled(&self, factor: f64) -> Option<Self>;

    /// Returns the equations with all friction of the wheels multiplied by `factor`.
    fn with_friction_scaled(&self, factor: f64) -> Self;

    /// Returns an initial guess for the states of the steady-state motion as a function of the phase.
    fn guess(&self) -> impl Fn(f64) -> [f64; N];

    /// Returns the joint commands at the phase `omega t` (`phase_rad`).
    fn node<T: Number>(&self, phase_rad: T) -> Self::Node<T>;

    /// Returns the state nearest to `y` that meets the constraints at a phase.
    fn consistent(&self, phase_rad: f64, y: [f64; N]) -> [f64; N];

    /// Evaluates the equations at state `y` with time derivative `dy`.
    fn residual<T: Number>(&self, node: &Self::Node<T>, y: &[T; N], dy: &[T; N]) -> Residual<N, T>;

    /// Evaluates only the value of [`Reduced::residual`].
    fn value<T: Number>(&self, node: &Self::Node<T>, y: &[T; N], dy: &[T; N]) -> [T; N];

    /// Returns the joint angles and velocities of the robot in state `y`.
    fn kinematics<T: Number>(&self, node: &Self::Node<T>, y: &[T; N]) -> Self::State<T>;

    /// Returns the velocities of the reference link along and across itself (m/s) and its turning rate (rad/s).
    fn body<T: Number>(state: &Self::State<T>) -> [T; 3];

    /// Returns the quantities whose polynomials show the discretisation error, given the velocities of the reference
    /// link along the world axes.
    fn tracked<T: Number>(&self, state: &Self::State<T>, rates: [T; 2]) -> [T; N];

    /// Returns the number of wheels.
    fn wheels(&self) -> usize;

    /// Returns the skid velocities of the wheels, m/s, followed by zeros.
    fn skid_m_s<T: Number>(&self, node: &Self::Node<T>, state: &Self::State<T>) -> [T; MAX_LINKS];

    /// Returns the angle (rad) and the rate (rad/s) of a free joint, given its index among the free joints.
    fn free_joint<T: Number>(state: &Self::State<T>, index: usize) -> [T; 2];

    /// Returns the angles of all joints from front to rear, rad, followed by zeros.
    fn joints_rad(&self, phase_rad: f64, state: &Self::State<f64>) -> [f64; MAX_JOINTS];

    /// Returns the power dissipated by friction, drag and damping, W.
    fn loss_w<T: Number>(&self, node: &Self::Node<T>, state: &Self::State<T>) -> T;

    /// Returns the power of the actuators and the power dissipated, W, given the time derivatives `dy` of the states.
    fn power_and_loss_w(&self, phase_rad: Lanes, y: &[Lanes; N], dy: &[Lanes; N]) -> [Lanes; 2];

    /// Returns the sample of a motion at one time, given the time derivatives `dy` of the states.
    fn sample(&self, time_s: f64, pose: Pose, y: &[f64; N], dy: &[f64; N]) -> Sample;

    /// Returns the time derivatives of the states at a phase, for which the equations of motion are a linear system;
    /// NaN if the system is singular.
    fn rates(&self, phase_rad: f64, node: &Self::Node<f64>, y: &[f64; N]) -> [f64; N];

    /// Returns, for each state, the factor (1 or -1) by which it is multiplied after half a period of a motion with
    /// half-period symmetry; `None` if the motion cannot have this symmetry.
    fn half_period_signs(&self) -> Option<[f64; N]>;

    /// Returns the metrics of the robot, given the measurements on a cycle of its motion.
    fn gait_metrics(&self, cycle: &Cycle) -> GaitMetrics;

    /// Returns the state at phase 0 of a motion that starts from rest; only the commanded joints already
    /// move, at their commanded rates.
    fn at_rest(&self) -> [f64; N];
}

/// Packs arrays into SIMD vectors, one array per lane.
#[inline(always)]
pub(super) fn lanes<const K: usize>(arrays: [&[f64; K]; LANES]) -> [Lanes; K] {
    let mut packed = [Lanes::default(); K];
    for i in 0..K {
        packed[i] = Lanes::new(arrays.map(|array| array[i]));
    }
    packed
}
