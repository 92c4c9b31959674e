//! The models' equations in the few states that matter.
//!
//! The motion does not depend on where the robot is or where it points, so only velocities
//! in link 0's frame and the passive joint's angle are states:
//!
//! | robot | skidding wheels | wheels that cannot skid |
//! |---|---|---|
//! | both joints commanded | `u, v, theta'` | none: eq. 3 gives the motion |
//! | one joint passive | `u, v, theta', phi_p', phi_p` | `s, phi_p` |

mod kinematic_skid;
mod passive_no_skid;
mod passive_skid;

pub(super) use kinematic_skid::KinematicSkid;
pub(super) use passive_no_skid::PassiveNoSkid;
pub(super) use passive_skid::PassiveSkid;

use crate::metrics::GaitMetrics;
use crate::robot::{ByParameter, Family, Gait, Parameter, Robot, Shape, Trig, Velocity, dot};

/// Value of the equations of motion and their derivatives at one moment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Residual<const N: usize> {
    pub value: [f64; N],
    /// `by_state[i][j]`: derivative of equation i with respect to state j.
    pub by_state: [[f64; N]; N],
    /// The same with respect to the time derivative of state j.
    pub by_rate: [[f64; N]; N],
}

/// What the robot does at one moment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moment {
    pub phi_rad: [f64; 2],
    pub velocity: Velocity,
}

/// What a motion can be differentiated by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Variable {
    Parameter(Parameter),
    /// Amplitude of a commanded joint (0 or 1), rad.
    Amplitude(usize),
}

/// Derivatives of the metrics; zero for what the motion does not depend on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Derivatives {
    /// Per unit of each parameter.
    pub parameters: ByParameter<GaitMetrics>,
    /// Per radian of each commanded joint's amplitude.
    pub amplitudes: [GaitMetrics; 2],
}

impl Derivatives {
    pub(super) const NONE: Self = Self {
        parameters: ByParameter::splat(GaitMetrics::NONE),
        amplitudes: [GaitMetrics::NONE; 2],
    };

    pub(super) fn set(&mut self, variable: Variable, derivative: GaitMetrics) {
        match variable {
            Variable::Parameter(parameter) => self.parameters[parameter] = derivative,
            Variable::Amplitude(joint) => self.amplitudes[joint] = derivative,
        }
    }
}

/// Most parameters that a motion of one kind can depend on.
pub(super) const MOST_PARAMETERS: usize = 9;

/// Derivatives of each equation with respect to the variables of [`Reduced::variable`].
pub(super) type ByParameters<const N: usize> = [[f64; MOST_PARAMETERS]; N];

/// Equations of motion `0 = residual(t, y, y')` with `N` states.
pub(super) trait Reduced<const N: usize> {
    /// Parameters that the motion can depend on.
    const PARAMETERS: usize;

    /// Whether the wheels can skid.
    const SKIDS: bool;

    /// Whether the last state is the integral of the one before it; its own equation is then
    /// not among the residuals.
    const INTEGRATED: bool;

    /// Whether the last state is an angle; all others are velocities.
    const HAS_ANGLE: bool;

    /// What the command prescribes at one moment, computed once per solution.
    type Node: Copy + std::fmt::Debug;

    /// The command at phase `omega t`.
    fn node(&self, phase_rad: f64) -> Self::Node;

    /// The equations at state `y` with time derivative `dy`.
    fn residual(&self, node: &Self::Node, y: &[f64; N], dy: &[f64; N]) -> Residual<N>;

    /// The variable of a column, counted from 0 to [`Reduced::PARAMETERS`].
    fn variable(&self, column: usize) -> Variable;

    /// The equations, and in `by` their derivatives with respect to the parameters.
    fn sensitivity(
        &self,
        node: &Self::Node,
        y: &[f64; N],
        dy: &[f64; N],
        by: &mut ByParameters<N>,
    ) -> Residual<N>;

    /// Angles and velocities of the whole robot in state `y`.
    fn moment(&self, node: &Self::Node, y: &[f64; N]) -> Moment;

    /// Time derivatives of the moment's velocities.
    fn acceleration(&self, node: &Self::Node, y: &[f64; N], dy: &[f64; N]) -> [f64; 5];

    /// Gradient with respect to the states of a quantity with this gradient with respect to
    /// the moment.
    fn by_state(&self, node: &Self::Node, y: &[f64; N], by_moment: &Moment) -> [f64; N];

    /// The same with respect to the joints' amplitudes when the states stay.
    fn by_amplitude(&self, node: &Self::Node, y: &[f64; N], by_moment: &Moment) -> [f64; 2];

    /// Signs of the states half a period later, if the commands have changed theirs.
    fn half_period_signs(&self) -> Option<[f64; N]>;

    /// The state of a robot at rest at phase 0. The commanded joints start with their
    /// command's rate: from the first moment they follow it.
    fn at_rest(&self) -> [f64; N];
}

/// A robot under a gait at one frequency.
#[derive(Debug, Clone)]
pub(super) struct Driven {
    pub robot: Robot,
    pub gait: Gait,
    pub omega_rad_s: f64,
    /// Whether the wheels can skid at all.
    pub model_skids: bool,
    /// Whether the wheels resist rolling.
    pub model_rolls: bool,
}

impl Driven {
    /// Whether eq. 3 gives the motion: both joints are commanded and the wheels cannot skid.
    pub fn is_determined(&self) -> bool {
        !self.model_skids && self.gait.passive_joint().is_none()
    }

    /// Whether the motion can depend on a variable.
    pub fn knows(&self, variable: Variable) -> bool {
        let passive = self.gait.passive_joint();
        match variable {
            Variable::Amplitude(joint) => passive != Some(joint),
            Variable::Parameter(parameter) => match parameter.family() {
                Family::Skid => self.model_skids,
                Family::Roll => self.model_rolls,
                Family::Joint => passive.is_some(),
            },
        }
    }

    /// Whether the mirror image of the motion follows half a period later.
    fn is_mirrored(&self) -> bool {
        let rests_straight = self.robot.rest_angle_rad == 0.0;
        self.gait.is_symmetric() && (self.gait.passive_joint().is_none() || rests_straight)
    }
}

/// Derivatives of eq. 7's left-hand side with respect to the coefficients along `rows`.
#[inline(always)]
fn by_coefficients(rows: &[[f64; 5]; 3], velocity: &Velocity) -> [[f64; 5]; 3] {
    rows.map(|row| {
        let along = dot(&row, velocity);
        row.map(|entry| entry * along)
    })
}

/// What the command prescribes at one moment; the entries of a passive joint are zero.
#[derive(Debug, Clone, Copy)]
pub(super) struct CommandNode {
    /// See [`Gait::waves`].
    waves: [[f64; 3]; 2],
    shape: Shape,
    trig: Trig,
}

impl CommandNode {
    fn new(driven: &Driven, phase_rad: f64) -> Self {
        let waves = driven.gait.waves(phase_rad, driven.omega_rad_s);
        let shape = driven.gait.shape(&waves);
        Self { waves, shape, trig: Trig::new(shape.phi_rad) }
    }

    /// Gradient with respect to the amplitudes of a quantity that depends on the joints only
    /// by their own angles and rates.
    fn by_amplitude(&self, by_moment: &Moment) -> [f64; 2] {
        std::array::from_fn(|a| {
            let [phi, rate, _] = self.waves[a];
            by_moment.phi_rad[a] * phi + by_moment.velocity[3 + a] * rate
        })
    }
}
