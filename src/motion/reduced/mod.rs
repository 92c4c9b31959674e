//! The models' equations in the few states that matter.
//!
//! The motion does not depend on where the robot is or where it points, so only velocities
//! in link 0's frame and the passive joint's angle are states:
//!
//! | robot | skidding wheels | wheels that cannot skid |
//! |---|---|---|
//! | both joints commanded | `u, v, theta'` | none: eq. 3 gives the motion |
//! | one joint passive | `u, v, theta', phi_p', phi_p` | `s, phi_p` |

mod harmonic;
mod passive_no_skid;
mod skid;

pub(super) use passive_no_skid::PassiveNoSkid;
pub(super) use skid::Skid;

use super::Problem;
use crate::metrics::GaitMetrics;
use crate::robot::{ByParameter, LANES, Lanes, Number, Parameter, Shape, Trig, Velocity};

/// The equations of motion and their derivatives at one time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Residual<const N: usize, T = f64> {
    pub value: [T; N],
    /// `state_jacobian[i][j]`: derivative of equation i with respect to state j.
    pub state_jacobian: [[T; N]; N],
    /// The same with respect to the time derivative of state j.
    pub rate_jacobian: [[T; N]; N],
}

/// Joint angles and velocities of the whole robot at one time, or a gradient with respect to them.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct KinematicState<T = f64> {
    pub phi_rad: [T; 2],
    pub velocity: Velocity<T>,
}

/// What a motion can be differentiated by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Variable {
    Parameter(Parameter),
    /// A number of a commanded joint (0 or 1), rad: its offset, amplitude or phase (0, 1, 2).
    Gait(usize, usize),
}

/// Numbers of a joint's command: offset, amplitude, phase.
pub(super) const OFFSET: usize = 0;
pub(super) const AMPLITUDE: usize = 1;
pub(super) const NUMBERS: usize = 3;

/// Derivatives of the metrics; zero for what the motion does not depend on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Derivatives {
    /// Per unit of each parameter.
    pub parameters: ByParameter<GaitMetrics>,
    /// Per rad/s of omega.
    pub omega: GaitMetrics,
    /// Per radian of offset, amplitude and phase of each commanded joint; NaN where the motion
    /// exists for this gait alone.
    pub gait: [[GaitMetrics; NUMBERS]; 2],
}

impl Derivatives {
    pub(super) const NONE: Self = Self {
        parameters: ByParameter::splat(GaitMetrics::NONE),
        omega: GaitMetrics::NONE,
        gait: [[GaitMetrics::NONE; NUMBERS]; 2],
    };

    pub(super) fn set(&mut self, variable: Variable, derivative: GaitMetrics) {
        match variable {
            Variable::Parameter(parameter) => self.parameters[parameter] = derivative,
            Variable::Gait(joint, number) => self.gait[joint][number] = derivative,
        }
    }
}

/// Most parameters that a motion of one kind can depend on.
pub(super) const MOST_PARAMETERS: usize = 23;

/// Equations of motion `0 = residual(t, y, y')` with `N` states.
pub(super) trait Reduced<const N: usize>: Clone {
    /// Variables that the motion can depend on: the robot's, the commanded joints'.
    const PARAMETERS: usize;

    /// Those of the robot among them.
    const OF_ROBOT: usize;

    /// Whether the wheels can skid.
    const SKIDS: bool;

    /// Whether friction is in proportion to velocities.
    const IS_LINEAR: bool;

    /// Whether the last state is the integral of the one before it; its own equation is then
    /// not among the residuals.
    const INTEGRATED: bool;

    /// Whether the last state is an angle; all others are velocities.
    const HAS_ANGLE: bool;

    /// What the command prescribes at one time, computed once per solution.
    type Node<T: Number>: Copy + std::fmt::Debug;

    /// The same with a transition of dry friction that is so much wider; `None` where there is none.
    fn softened(&self, factor: f64) -> Option<Self>
    where
        Self: Sized;

    /// The same with all friction of the wheels times a factor.
    fn resisted(&self, factor: f64) -> Self;

    /// What the equations are of.
    fn problem(&self) -> &Problem;

    /// States near the steady motion's by phase, from which Newton's method starts; at rest where
    /// nothing better is known.
    fn guess(&self) -> impl Fn(f64) -> [f64; N] {
        let rest = self.at_rest();
        move |_| rest
    }

    /// The command at phase `omega t`.
    fn node<T: Number>(&self, phase_rad: T) -> Self::Node<T>;

    /// The equations at state `y` with time derivative `dy`.
    fn residual<T: Number>(&self, node: &Self::Node<T>, y: &[T; N], dy: &[T; N]) -> Residual<N, T>;

    /// The variable of a column, counted from 0 to [`Reduced::PARAMETERS`].
    fn variable(&self, column: usize) -> Variable;

    /// The equations and the derivatives of each with respect to the first `parameters` of the
    /// variables of [`Reduced::variable`].
    fn sensitivity<T: Number>(
        &self,
        node: &Self::Node<T>,
        y: &[T; N],
        dy: &[T; N],
        parameters: usize,
        jacobian: &mut [[T; MOST_PARAMETERS]],
    ) -> Residual<N, T>;

    /// Angles and velocities of the whole robot in state `y`.
    fn kinematics<T: Number>(&self, node: &Self::Node<T>, y: &[T; N]) -> KinematicState<T>;

    /// Sines and cosines of the joint angles.
    fn trig<T: Number>(&self, node: &Self::Node<T>, y: &[T; N]) -> Trig<T>;

    /// Time derivatives of the robot's velocities.
    fn acceleration<T: Number>(&self, node: &Self::Node<T>, y: &[T; N], dy: &[T; N]) -> [T; 5];

    /// Gradient with respect to the states, from that with respect to angles and velocities.
    fn state_gradient<T: Number>(
        &self,
        node: &Self::Node<T>,
        y: &[T; N],
        trig: &Trig<T>,
        gradient: &KinematicState<T>,
    ) -> [T; N];

    /// The same with respect to the numbers of the joints' commands when the states stay.
    fn gait_gradient<T: Number>(
        &self,
        node: &Self::Node<T>,
        y: &[T; N],
        trig: &Trig<T>,
        gradient: &KinematicState<T>,
    ) -> [[T; NUMBERS]; 2];

    /// Signs of the states half a period later, if the commands have changed theirs.
    fn half_period_signs(&self) -> Option<[f64; N]>;

    /// The state of a robot at rest at phase 0. The commanded joints start with their
    /// command's rate.
    fn at_rest(&self) -> [f64; N];
}

impl Problem {
    /// Whether the motion can depend on a variable.
    pub(super) fn knows(&self, variable: Variable) -> bool {
        match variable {
            Variable::Parameter(parameter) => self.laws.know(parameter, &self.gait),
            Variable::Gait(joint, _) => self.gait.passive_joint() != Some(joint),
        }
    }

    /// Whether the mirror image of the motion follows half a period later.
    fn is_mirrored(&self) -> bool {
        let rests_straight = self.robot.rest_angle_rad == 0.0;
        self.gait.is_symmetric() && (self.gait.passive_joint().is_none() || rests_straight)
    }
}

/// Arrays side by side, one in each lane.
#[inline(always)]
pub(super) fn lanes<const K: usize>(arrays: [&[f64; K]; LANES]) -> [Lanes; K] {
    let mut packed = [Lanes::default(); K];
    for i in 0..K {
        packed[i] = Lanes::new(arrays.map(|array| array[i]));
    }
    packed
}

/// What the command prescribes at one time; the entries of a passive joint are zero.
#[derive(Debug, Clone, Copy)]
pub(super) struct CommandNode<T = f64> {
    /// See [`Gait::waves`](crate::robot::Gait::waves).
    waves: [[T; 3]; 2],
    shape: Shape<T>,
    trig: Trig<T>,
}

impl<T: Number> CommandNode<T> {
    #[inline(always)]
    fn new(problem: &Problem, phase_rad: T) -> Self {
        let waves = problem.gait.waves(phase_rad, problem.omega_rad_s);
        let shape = problem.gait.shape(&waves);
        Self { waves, shape, trig: Trig::new(shape.phi_rad) }
    }

    /// Derivatives of a joint's angle, rate and acceleration with respect to each number of its
    /// command.
    #[inline(always)]
    fn slopes(&self, joint: usize, omega_rad_s: f64) -> [[T; 3]; NUMBERS] {
        let Shape { rate_rad_s, acceleration_rad_s2, .. } = &self.shape;
        let (rate, acceleration) = (rate_rad_s[joint], acceleration_rad_s2[joint]);
        let (omega, period) = (T::of(omega_rad_s), T::of(1.0 / omega_rad_s));
        let by_phase = [rate * period, acceleration * period, -(omega * rate)];
        [[T::of(1.0), T::of(0.0), T::of(0.0)], self.waves[joint], by_phase]
    }

    /// Gradient with respect to these numbers, as far as they act on the joints' own angles and
    /// rates alone.
    #[inline(always)]
    fn gait_gradient(&self, gradient: &KinematicState<T>, omega_rad_s: f64) -> [[T; NUMBERS]; 2] {
        let mut by_number = [[T::of(0.0); NUMBERS]; 2];
        for joint in 0..2 {
            let slopes = self.slopes(joint, omega_rad_s);
            for number in 0..NUMBERS {
                let [phi, rate, _] = slopes[number];
                by_number[joint][number] =
                    gradient.phi_rad[joint] * phi + gradient.velocity[3 + joint] * rate;
            }
        }
        by_number
    }
}
