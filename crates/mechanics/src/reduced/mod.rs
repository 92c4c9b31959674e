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

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{
    ByParameter, Dry, Friction, Gait, LANES, Lanes, Number, Parameter, Robot, Shape, Trig,
    Velocity, dot, droll_rows_dphi, dskid_rows_dphi, roll_rows, skid_rows,
};

use super::Problem;

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
    /// A part of its second harmonic, rad: in phase or in quadrature (0, 1).
    Second(usize, usize),
}

impl Variable {
    /// Whether half a period later a motion that is its own mirror image changes by the opposite.
    pub(crate) fn is_odd(self) -> bool {
        matches!(self, Self::Gait(_, OFFSET) | Self::Second(..))
    }
}

/// Numbers of a joint's command: offset, amplitude, phase.
const OFFSET: usize = 0;
pub(super) const NUMBERS: usize = 3;
/// Parts of its second harmonic, in phase and in quadrature.
pub(super) const PARTS: usize = 2;

/// Derivatives with respect to the numbers of a joint's command, then to the parts of its second
/// harmonic.
pub(super) type BySlopes<T> = [T; NUMBERS + PARTS];

/// Derivatives of the metrics, or of another quantity; zero for what the motion does not depend on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Derivatives<T = GaitMetrics> {
    /// Per unit of each parameter.
    pub parameters: ByParameter<T>,
    /// Per rad/s of omega.
    pub omega: T,
    /// Per radian of offset, amplitude and phase of each commanded joint; NaN where the motion
    /// exists for this gait alone.
    pub gait: [[T; NUMBERS]; 2],
    /// Per radian of the second harmonic's part in phase and that in quadrature, of commands that have
    /// one; zero of others.
    pub second: [[T; PARTS]; 2],
}

impl<T: Copy> Derivatives<T> {
    /// The same with respect to everything.
    pub(crate) const fn splat(value: T) -> Self {
        Self {
            parameters: ByParameter::splat(value),
            omega: value,
            gait: [[value; NUMBERS]; 2],
            second: [[value; PARTS]; 2],
        }
    }

    pub(super) fn set(&mut self, variable: Variable, derivative: T) {
        match variable {
            Variable::Parameter(parameter) => self.parameters[parameter] = derivative,
            Variable::Gait(joint, number) => self.gait[joint][number] = derivative,
            Variable::Second(joint, part) => self.second[joint][part] = derivative,
        }
    }

    /// Fills in the derivatives with respect to the sums of the wheels' resistances, whose
    /// proportions stay when they change; `weighted` adds three derivatives with these weights.
    pub(super) fn set_sums(&mut self, robot: &Robot, weighted: impl Fn([f64; 3], [T; 3]) -> T) {
        for sum in Parameter::ALL.into_iter().filter(|of| of.is_sum()) {
            let quantity = sum.quantity();
            let of_wheels = quantity.of_each().map(|parameter| self.parameters[parameter]);
            self.parameters[sum] = weighted(quantity.shares(robot), of_wheels);
        }
    }
}

impl Derivatives<f64> {
    /// With those by omega and by the wheels' sums, once the derivatives by single parameters and the gait's numbers are there. A
    /// quantity that goes with a power of velocities has that power times its value in `powered`, what goes with none 0.
    pub(super) fn completed(mut self, problem: &Problem, powered: f64) -> Self {
        let parts = problem.parts_of_omega().map(|(of, part)| part * self.parameters[of]);
        self.omega = powered / problem.omega_rad_s + parts.sum::<f64>();
        self.set_sums(&problem.robot, |shares, of| (0..3).map(|i| shares[i] * of[i]).sum());
        self
    }
}

/// Most parameters that a motion of one kind can depend on: all of friction, and both joints' commands.
pub(super) const MOST_PARAMETERS: usize = Dry::SKID.len() + Dry::ROLL.len() + 2 * (NUMBERS + PARTS);

/// Equations of motion `0 = residual(t, y, y')` with `N` states.
pub(super) trait Reduced<const N: usize>: Clone {
    /// Variables that the motion can depend on: the robot's, the commanded joints', those of their
    /// second harmonics.
    const PARAMETERS: usize = Self::OF_ROBOT + (NUMBERS + PARTS) * Self::COMMANDED;

    /// Those of the robot among them.
    const OF_ROBOT: usize;

    /// The same with those of the commanded joints but for second harmonics.
    const OF_FIRST: usize = Self::OF_ROBOT + NUMBERS * Self::COMMANDED;

    /// How many joints are commanded.
    const COMMANDED: usize;

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

    /// The parameter of the robot in a column, counted from 0 to [`Reduced::OF_ROBOT`].
    fn parameter(&self, column: usize) -> Parameter;

    /// The variable of a column, counted from 0 to [`Reduced::PARAMETERS`].
    fn variable(&self, column: usize) -> Variable {
        let joint = |count: usize| match self.problem().gait.passive_joint() {
            Some(passive) => 1 - passive,
            None => count,
        };
        match (column.checked_sub(Self::OF_ROBOT), column.checked_sub(Self::OF_FIRST)) {
            (None, _) => Variable::Parameter(self.parameter(column)),
            (Some(number), None) => Variable::Gait(joint(number / NUMBERS), number % NUMBERS),
            (_, Some(part)) => Variable::Second(joint(part / PARTS), part % PARTS),
        }
    }

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
    ) -> [BySlopes<T>; 2];

    /// See [`friction_power`].
    fn friction_power<T: Number>(&self, state: &KinematicState<T>, trig: &Trig<T>) -> T;

    /// See [`friction_power_gradient`].
    fn friction_power_gradient<T: Number>(
        &self,
        state: &KinematicState<T>,
        trig: &Trig<T>,
    ) -> KinematicState<T>;

    /// Adds the derivatives of the power that friction takes with respect to the robot's variables, times a `weight`, to
    /// their columns.
    fn add_friction_power_slopes<T: Number>(
        &self,
        state: &KinematicState<T>,
        trig: &Trig<T>,
        weight: T,
        columns: &mut [T; MOST_PARAMETERS],
    );

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
            Variable::Second(joint, _) => {
                self.gait.joints[joint].is_some_and(|of| of.second.is_some())
            }
        }
    }

    /// How much of its own derivative every parameter adds to that with respect to omega: per radian of
    /// phase the motion depends on viscous coefficients and the speeds of dry friction over omega and on stiffness
    /// and dry friction over its square.
    pub(super) fn parts_of_omega(&self) -> impl Iterator<Item = (Parameter, f64)> {
        let part = |of: Parameter| -of.power_of_omega() * of.of(&self.robot) / self.omega_rad_s;
        let all = Parameter::ALL.into_iter().filter(|of| !of.is_sum());
        all.map(move |of| (of, part(of))).filter(|(_, part)| *part != 0.0)
    }

    /// Whether the mirror image of the motion follows half a period later.
    pub fn is_mirrored(&self) -> bool {
        let rests_straight = self.robot.rest_angle_rad == 0.0;
        self.gait.is_symmetric() && (self.gait.passive_joint().is_none() || rests_straight)
    }
}

/// The power that friction takes, at the wheels and in the `passive` joint.
#[inline(always)]
pub(super) fn friction_power<T: Number, F: Friction>(
    robot: &Robot,
    passive: Option<usize>,
    KinematicState { velocity, .. }: &KinematicState<T>,
    trig: &Trig<T>,
) -> T {
    let (skid, roll) = (skid_rows(robot, trig), roll_rows(robot, trig));
    let mut power = match passive {
        Some(p) => T::of(robot.damping_nm_s_rad) * velocity[3 + p] * velocity[3 + p],
        None => T::of(0.0),
    };
    for wheel in 0..3 {
        let (across, along) = (dot(&skid[wheel], velocity), dot(&roll[wheel], velocity));
        power +=
            F::skid(robot, wheel, across)[0] * across + F::roll(robot, wheel, along)[0] * along;
    }
    power
}

/// Gradient of the power that friction takes, at the wheels and in the `passive` joint, with respect to
/// angles and velocities.
#[inline(always)]
pub(super) fn friction_power_gradient<T: Number, F: Friction>(
    robot: &Robot,
    passive: Option<usize>,
    KinematicState { velocity, .. }: &KinematicState<T>,
    trig: &Trig<T>,
) -> KinematicState<T> {
    let zero = T::of(0.0);
    let mut gradient = KinematicState { phi_rad: [zero; 2], velocity: [zero; 5] };
    let mut add = |wheel: usize, row: &[T; 5], drows_dphi: &[[T; 5]; 2], by_speed: T| {
        for i in 0..5 {
            gradient.velocity[i] += by_speed * row[i];
        }
        if let Some(joint) = wheel.checked_sub(1) {
            gradient.phi_rad[joint] += by_speed * dot(&drows_dphi[joint], velocity);
        }
    };
    let (skid, dskid) = (skid_rows(robot, trig), dskid_rows_dphi(robot, trig));
    let (roll, droll) = (roll_rows(robot, trig), droll_rows_dphi(robot, trig));
    for wheel in 0..3 {
        let (across, along) = (dot(&skid[wheel], velocity), dot(&roll[wheel], velocity));
        let [force, slope] = F::skid(robot, wheel, across);
        add(wheel, &skid[wheel], &dskid, force + slope * across);
        let [force, slope] = F::roll(robot, wheel, along);
        add(wheel, &roll[wheel], &droll, force + slope * along);
    }
    if let Some(p) = passive {
        gradient.velocity[3 + p] += T::of(2.0 * robot.damping_nm_s_rad) * velocity[3 + p];
    }
    gradient
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
    /// See [`Gait::waves`](trilink_robot::Gait::waves).
    waves: [[T; 3]; 2],
    /// See [`Gait::double_turn`](trilink_robot::Gait::double_turn).
    double_turn: [T; 2],
    shape: Shape<T>,
    trig: Trig<T>,
}

impl<T: Number> CommandNode<T> {
    #[inline(always)]
    pub(crate) fn new(problem: &Problem, phase_rad: T) -> Self {
        let Problem { gait, omega_rad_s, .. } = problem;
        let waves = gait.waves(phase_rad, *omega_rad_s);
        let double_turn = gait.double_turn(phase_rad);
        let shape = gait.shape(&waves, double_turn, *omega_rad_s);
        Self { waves, double_turn, shape, trig: Trig::new(shape.phi_rad) }
    }

    /// Derivatives of a joint's angle, rate and acceleration with respect to each number of its
    /// command.
    #[inline(always)]
    fn slopes(&self, joint: usize, problem: &Problem) -> [[T; 3]; NUMBERS] {
        let Problem { gait, omega_rad_s, .. } = problem;
        let amplitude = T::of(gait.joints[joint].map_or(0.0, |joint| joint.amplitude_rad));
        let [_, rate, acceleration] = self.waves[joint].map(|wave| amplitude * wave);
        let (omega, period) = (T::of(*omega_rad_s), T::of(1.0 / omega_rad_s));
        let by_phase = [rate * period, acceleration * period, -(omega * rate)];
        [[T::of(1.0), T::of(0.0), T::of(0.0)], self.waves[joint], by_phase]
    }

    /// The same with respect to the parts of its second harmonic.
    #[inline(always)]
    fn second_slopes(&self, problem: &Problem) -> [[T; 3]; PARTS] {
        Gait::second_waves(self.double_turn, problem.omega_rad_s)
    }

    /// Gradient with respect to these numbers, as far as they act on the joints' own angles and
    /// rates alone.
    #[inline(always)]
    pub(crate) fn gait_gradient(
        &self,
        gradient: &KinematicState<T>,
        problem: &Problem,
    ) -> [BySlopes<T>; 2] {
        let mut by_number = [[T::of(0.0); NUMBERS + PARTS]; 2];
        for joint in 0..2 {
            let along = |[phi, rate, _]: [T; 3]| {
                gradient.phi_rad[joint] * phi + gradient.velocity[3 + joint] * rate
            };
            let slopes = self.slopes(joint, problem);
            for number in 0..NUMBERS {
                by_number[joint][number] = along(slopes[number]);
            }
            if problem.gait.has_second() {
                let slopes = self.second_slopes(problem);
                for part in 0..PARTS {
                    by_number[joint][NUMBERS + part] = along(slopes[part]);
                }
            }
        }
        by_number
    }
}
