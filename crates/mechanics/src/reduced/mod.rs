//! Equations of motion of the models in minimal states.
//!
//! The motion does not depend on the position or heading of the robot, so the states are only velocities in
//! the frame of link 0 and the passive joint's angle:
//!
//! | robot | skidding wheels | wheels that cannot skid |
//! |---|---|---|
//! | both joints commanded | `u, v, theta'` | none: eq. 3 determines the motion |
//! | one joint passive | `u, v, theta', phi_p', phi_p` | `s, phi_p` |

mod harmonic;
mod passive_no_skid;
mod skid;

pub(super) use passive_no_skid::PassiveNoSkid;
pub(super) use skid::Skid;

use nalgebra::{SMatrix, SVector};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{
    ByParameter, Dry, Friction, Gait, LANES, Lanes, MAX_JOINTS, MAX_LINKS, Number, Parameter, Pose,
    Robot, Shape, Trig, Velocity, dot, droll_rows_dphi, dskid_rows_dphi, roll_rows, skid_rows,
};

use super::Problem;
use super::cycle::Cycle;
use super::trajectory::Sample;

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

/// Joint angles and velocities of the three-link robot at one time.
#[derive(Debug, Clone, Copy)]
pub(super) struct KinematicState<T = f64> {
    pub phi_rad: [T; 2],
    pub trig: Trig<T>,
    pub velocity: Velocity<T>,
}

/// Gradient of a quantity with respect to the joint angles and velocities of the three-link robot.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Gradient<T = f64> {
    pub phi_rad: [T; 2],
    pub velocity: Velocity<T>,
}

/// Variable with respect to which the metrics of a motion can be differentiated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Variable {
    Parameter(Parameter),
    /// Variable of a joint's command, rad: the joint's index (0 or 1), then the index of the variable (0 offset, 1
    /// amplitude, 2 phase).
    Gait(usize, usize),
    /// Component of the second harmonic of a joint's command, rad: the joint's index (0 or 1), then the index of the
    /// component (0 in phase, 1 in quadrature).
    Second(usize, usize),
}

impl Variable {
    /// Returns whether the effect of this variable on a motion with half-period symmetry has the opposite
    /// sign half a period later.
    pub(crate) fn is_odd(self) -> bool {
        matches!(self, Self::Gait(_, OFFSET) | Self::Second(..))
    }
}

/// Index of the offset in a joint's command.
const OFFSET: usize = 0;
/// Number of variables of a joint's command: offset, amplitude, phase.
pub(super) const COMMAND_SIZE: usize = 3;
/// Number of components of a joint's second harmonic: in phase and in quadrature.
pub(super) const HARMONIC_SIZE: usize = 2;

/// Derivatives with respect to a joint's offset, amplitude and phase, then with respect to the components of
/// its second harmonic.
pub(super) type CommandGradient<T> = [T; COMMAND_SIZE + HARMONIC_SIZE];

/// Derivatives of the metrics, or of another quantity, with respect to all variables; zero for variables on
/// which the motion does not depend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Derivatives<T = GaitMetrics> {
    /// Derivatives with respect to each parameter, per unit of the parameter.
    pub parameters: ByParameter<T, { Parameter::ALL.len() }>,
    /// Derivative with respect to the frequency omega, per rad/s.
    pub omega: T,
    /// Derivatives with respect to offset, amplitude and phase of each commanded joint, per radian; NaN if no
    /// motion exists for neighbouring gaits.
    pub gait: [[T; COMMAND_SIZE]; 2],
    /// Derivatives with respect to the in-phase and quadrature components of each joint's second harmonic,
    /// per radian; zero for a command without a second harmonic.
    pub second: [[T; HARMONIC_SIZE]; 2],
}

impl<T: Copy> Derivatives<T> {
    /// Creates derivatives that have the same value for all variables.
    pub(crate) const fn splat(value: T) -> Self {
        Self {
            parameters: ByParameter::splat(value),
            omega: value,
            gait: [[value; COMMAND_SIZE]; 2],
            second: [[value; HARMONIC_SIZE]; 2],
        }
    }

    pub(super) fn set(&mut self, variable: Variable, derivative: T) {
        match variable {
            Variable::Parameter(parameter) => self.parameters[parameter] = derivative,
            Variable::Gait(joint, number) => self.gait[joint][number] = derivative,
            Variable::Second(joint, part) => self.second[joint][part] = derivative,
        }
    }

    /// Sets the derivatives with respect to each coefficient's sum over the three wheels. They are computed from the
    /// derivatives with respect to the coefficients of the single wheels, whose proportions are held fixed. `weighted`
    /// multiplies three derivatives by the given weights and returns the sum.
    pub(super) fn set_sums(&mut self, robot: &Robot, weighted: impl Fn([f64; 3], [T; 3]) -> T) {
        for sum in Parameter::ALL.into_iter().filter(|parameter| parameter.is_sum()) {
            let quantity = sum.quantity();
            let of_wheels = quantity.of_each().map(|parameter| self.parameters[parameter]);
            self.parameters[sum] = weighted(quantity.shares(robot), of_wheels);
        }
    }
}

impl Derivatives<f64> {
    /// Adds the derivatives of a quantity with respect to omega and to the sums of coefficients over the wheels,
    /// computed from those with respect to single parameters. `scaled` is the quantity times n if the quantity is
    /// proportional to omega^n for a given motion per radian of phase (n = 0 for a distance, 2 for a work).
    pub(super) fn with_omega_and_sums(mut self, problem: &Problem, scaled: f64) -> Self {
        let terms =
            problem.omega_scaling().map(|(parameter, factor)| factor * self.parameters[parameter]);
        self.omega = scaled / problem.omega_rad_s + terms.sum::<f64>();
        self.set_sums(&problem.robot, |shares, slopes| (0..3).map(|i| shares[i] * slopes[i]).sum());
        self
    }
}

/// Maximum number of variables on which a motion can depend: all friction parameters and the commands of both
/// joints.
pub(super) const MAX_PARAMETERS: usize =
    Dry::SKID.len() + Dry::ROLL.len() + 2 * (COMMAND_SIZE + HARMONIC_SIZE);

/// Maximum number of states: those of a chain of eight links whose joints are all free.
pub(super) const MAX_STATES: usize = 17;
/// Maximum number of quantities whose polynomials show the discretisation error; see [`Reduced::tracked`].
pub(super) const MAX_TRACKED: usize = MAX_STATES;

/// Equations of motion `0 = residual(t, y, y')` with `N` states. The last [`Reduced::ANGLES`] states are the angles of
/// the free joints; all others are velocities.
pub(super) trait Reduced<const N: usize>: Clone {
    /// Number of states that are angles.
    const ANGLES: usize;

    /// Whether the angles are the time integrals of as many states before them; if so, [`Reduced::residual`] omits the
    /// equations that relate these states.
    const INTEGRATED: bool;

    /// Number of unknowns per stage of a collocation element.
    const UNKNOWNS: usize = if Self::INTEGRATED { N - Self::ANGLES } else { N };

    /// Number of quantities that [`Reduced::tracked`] returns; the others are zero.
    const TRACKED: usize;

    /// Joint commands at one time, with the quantities that depend on them alone; computed once per solution.
    type Node<T: Number>: Copy + std::fmt::Debug;

    /// Joint angles and velocities of the robot at one time.
    type State<T: Number>: Copy + std::fmt::Debug;

    /// State of the robot and the forces on it at one time, for the caller.
    type Sample;

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
    fn with_transition_scaled(&self, factor: f64) -> Option<Self>
    where
        Self: Sized;

    /// Returns the equations with all friction of the wheels multiplied by `factor`.
    fn with_friction_scaled(&self, factor: f64) -> Self;

    /// Returns an initial guess for the states of the steady-state motion as a function of the phase. By
    /// default, the robot is at rest.
    fn guess(&self) -> impl Fn(f64) -> [f64; N] {
        let rest = self.at_rest();
        move |_| rest
    }

    /// Returns the joint commands at the phase `omega t` (`phase_rad`).
    fn node<T: Number>(&self, phase_rad: T) -> Self::Node<T>;

    /// Evaluates the equations at state `y` with time derivative `dy`.
    fn residual<T: Number>(&self, node: &Self::Node<T>, y: &[T; N], dy: &[T; N]) -> Residual<N, T>;

    /// Evaluates only the value of [`Reduced::residual`].
    #[inline(always)]
    fn value<T: Number>(&self, node: &Self::Node<T>, y: &[T; N], dy: &[T; N]) -> [T; N] {
        self.residual(node, y, dy).value
    }

    /// Returns the joint angles and velocities of the robot in state `y`.
    fn kinematics<T: Number>(&self, node: &Self::Node<T>, y: &[T; N]) -> Self::State<T>;

    /// Returns the velocities of the reference link along and across itself (m/s) and its turning rate (rad/s).
    fn body<T: Number>(state: &Self::State<T>) -> [T; 3];

    /// Returns the quantities whose polynomials show the discretisation error, given the velocities of the reference
    /// link along the world axes.
    fn tracked<T: Number>(&self, state: &Self::State<T>, rates: [T; 2]) -> [T; MAX_TRACKED];

    /// Returns the number of wheels.
    fn wheels(&self) -> usize;

    /// Returns the skid velocities of the wheels, m/s, followed by zeros.
    fn skid_m_s<T: Number>(&self, node: &Self::Node<T>, state: &Self::State<T>) -> [T; MAX_LINKS];

    /// Returns the number of free joints whose range of motion is a metric; they come first among the free joints.
    fn measured_joints(&self) -> usize;

    /// Returns the angle (rad) and the rate (rad/s) of a free joint, given its index among the free joints.
    fn free_joint<T: Number>(state: &Self::State<T>, index: usize) -> [T; 2];

    /// Returns the angles of all joints from front to rear, rad, followed by zeros.
    fn joints_rad(&self, phase_rad: f64, state: &Self::State<f64>) -> [f64; MAX_JOINTS];

    /// Returns the power dissipated by friction and damping, W.
    fn loss_w<T: Number>(&self, node: &Self::Node<T>, state: &Self::State<T>) -> T;

    /// Returns the power of the actuators and the power dissipated, W, given the time derivatives `dy` of the states.
    fn power_and_loss_w(&self, phase_rad: Lanes, y: &[Lanes; N], dy: &[Lanes; N]) -> [Lanes; 2];

    /// Returns the sample of a motion at one time, given the time derivatives `dy` of the states.
    fn sample(
        &self,
        time_s: f64,
        pose: Pose,
        node: &Self::Node<f64>,
        y: &[f64; N],
        dy: &[f64; N],
    ) -> Self::Sample;

    /// Returns the time derivatives of the states at a phase, for which the equations of motion are a linear system;
    /// NaN if the system is singular.
    fn rates(&self, _: f64, node: &Self::Node<f64>, y: &[f64; N]) -> [f64; N] {
        let residual = self.residual(node, y, &[0.0; N]);
        let mut matrix = SMatrix::<f64, N, N>::from_fn(|i, j| residual.rate_jacobian[i][j]);
        let mut right = SVector::<f64, N>::from_fn(|i, _| -residual.value[i]);
        for angle in Self::UNKNOWNS..N {
            matrix[(angle, angle)] = 1.0;
            right[angle] = y[angle - Self::ANGLES];
        }
        matrix.try_inverse().map_or([f64::NAN; N], |inverse| (inverse * right).into())
    }

    /// Returns, for each state, the factor (1 or -1) by which it is multiplied after half a period of a motion with
    /// half-period symmetry; `None` if the motion cannot have this symmetry.
    fn half_period_signs(&self) -> Option<[f64; N]>;

    /// Returns the metrics of the robot, given the measurements on a cycle of its motion.
    fn gait_metrics(&self, cycle: &Cycle<N>) -> GaitMetrics;

    /// Returns the state at phase 0 of a motion that starts from rest; only the commanded joints already
    /// move, at their commanded rates.
    fn at_rest(&self) -> [f64; N];
}

/// Equations of motion of the three-link robot, with derivatives with respect to its parameters and commands.
pub(super) trait ThreeLink<const N: usize>: Reduced<N, Sample = Sample> {
    /// Number of variables on which the motion can depend: robot parameters, and variables of the commanded joints,
    /// including second harmonics.
    const PARAMETERS: usize =
        Self::ROBOT_VARIABLES + (COMMAND_SIZE + HARMONIC_SIZE) * Self::COMMANDED;

    /// Number of robot parameters on which the motion can depend.
    const ROBOT_VARIABLES: usize;

    /// Number of variables on which the motion can depend if no command has a second harmonic.
    const FIRST_HARMONIC_VARIABLES: usize = Self::ROBOT_VARIABLES + COMMAND_SIZE * Self::COMMANDED;

    /// Number of commanded joints.
    const COMMANDED: usize;

    /// Whether the wheels can skid.
    const SKIDS: bool;

    /// Returns the problem that the equations describe.
    fn problem(&self) -> &Problem;

    /// Returns the joint angles and velocities.
    fn of<T: Number>(state: &Self::State<T>) -> &KinematicState<T>;

    /// Returns the robot parameter with respect to which a column contains derivatives; `column` must be below
    /// [`ThreeLink::ROBOT_VARIABLES`].
    fn parameter(&self, column: usize) -> Parameter;

    /// Returns the variable with respect to which a column contains derivatives; `column` must be below
    /// [`ThreeLink::PARAMETERS`].
    fn variable(&self, column: usize) -> Variable {
        if column < Self::ROBOT_VARIABLES {
            return Variable::Parameter(self.parameter(column));
        }
        // The only commanded joint, if one is passive.
        let commanded = self.problem().gait.passive_joint().map(|passive| 1 - passive);
        if let Some(index) = column.checked_sub(Self::FIRST_HARMONIC_VARIABLES) {
            let joint = commanded.unwrap_or(index / HARMONIC_SIZE);
            return Variable::Second(joint, index % HARMONIC_SIZE);
        }
        let index = column - Self::ROBOT_VARIABLES;
        Variable::Gait(commanded.unwrap_or(index / COMMAND_SIZE), index % COMMAND_SIZE)
    }

    /// Evaluates the residual of the equations, and writes its derivatives with respect to the first
    /// `parameters` variables (see [`ThreeLink::variable`]) to `jacobian`, which has one row per equation and
    /// must contain zeros.
    fn sensitivity<T: Number>(
        &self,
        node: &Self::Node<T>,
        y: &[T; N],
        dy: &[T; N],
        parameters: usize,
        jacobian: &mut [[T; MAX_PARAMETERS]],
    ) -> Residual<N, T>;

    /// Returns the time derivatives of the robot's velocities.
    fn acceleration<T: Number>(&self, node: &Self::Node<T>, y: &[T; N], dy: &[T; N]) -> [T; 5];

    /// Converts a gradient with respect to joint angles and velocities to a gradient with respect to the
    /// states.
    fn state_gradient<T: Number>(
        &self,
        node: &Self::Node<T>,
        y: &[T; N],
        trig: &Trig<T>,
        gradient: &Gradient<T>,
    ) -> [T; N];

    /// Converts a gradient with respect to joint angles and velocities to a gradient with respect to the
    /// joints' commands, with the states held fixed.
    fn gait_gradient<T: Number>(
        &self,
        node: &Self::Node<T>,
        y: &[T; N],
        trig: &Trig<T>,
        gradient: &Gradient<T>,
    ) -> [CommandGradient<T>; 2];

    /// Returns the gradient of the power dissipated by friction with respect to joint angles and velocities
    /// (see [`friction_power_gradient`]).
    fn friction_power_gradient<T: Number>(&self, state: &KinematicState<T>) -> Gradient<T>;

    /// Adds to each column the derivative of the power dissipated by friction with respect to that column's
    /// robot parameter, times `weight`.
    fn add_friction_power_slopes<T: Number>(
        &self,
        state: &KinematicState<T>,
        weight: T,
        columns: &mut [T; MAX_PARAMETERS],
    );
}

/// Implements what the equations of motion of the three-link robot have in common.
macro_rules! of_three_links {
    ($states:expr) => {
        const TRACKED: usize = 7;

        type State<T: Number> = KinematicState<T>;
        type Sample = Sample;

        #[inline(always)]
        fn skids(&self) -> bool {
            Self::SKIDS
        }

        #[inline(always)]
        fn is_linear(&self) -> bool {
            F::IS_LINEAR
        }

        fn omega_rad_s(&self) -> f64 {
            self.problem.omega_rad_s
        }

        fn skid_scale_m_s(&self) -> f64 {
            self.problem.skid_scale_m_s()
        }

        fn transition_m_s(&self) -> f64 {
            self.problem.robot.transition_m_s
        }

        #[inline(always)]
        fn body<T: Number>(state: &KinematicState<T>) -> [T; 3] {
            let [u, v, r, ..] = state.velocity;
            [u, v, r]
        }

        #[inline(always)]
        fn tracked<T: Number>(
            &self,
            state: &KinematicState<T>,
            [x_rate, y_rate]: [T; 2],
        ) -> [T; MAX_TRACKED] {
            let [phi1, phi2] = state.phi_rad;
            let [_, _, r, w1, w2] = state.velocity;
            let mut tracked = [T::splat(0.0); MAX_TRACKED];
            tracked[..Self::TRACKED].copy_from_slice(&[phi1, phi2, x_rate, y_rate, r, w1, w2]);
            tracked
        }

        fn wheels(&self) -> usize {
            Robot::LINKS
        }

        #[inline(always)]
        fn skid_m_s<T: Number>(
            &self,
            _: &Self::Node<T>,
            state: &KinematicState<T>,
        ) -> [T; MAX_LINKS] {
            let mut skid_m_s = [T::splat(0.0); MAX_LINKS];
            let rows = skid_rows(&self.problem.robot, &state.trig);
            (0..Robot::LINKS).for_each(|i| skid_m_s[i] = dot(&rows[i], &state.velocity));
            skid_m_s
        }

        fn measured_joints(&self) -> usize {
            usize::from(self.problem.gait.joints[0].is_none())
        }

        #[inline(always)]
        fn free_joint<T: Number>(state: &KinematicState<T>, _: usize) -> [T; 2] {
            [state.phi_rad[0], state.velocity[3]]
        }

        #[inline(always)]
        fn loss_w<T: Number>(&self, _: &Self::Node<T>, state: &KinematicState<T>) -> T {
            friction_power::<T, F>(&self.problem.robot, self.problem.gait.passive_joint(), state)
        }

        fn power_and_loss_w(
            &self,
            phase_rad: Lanes,
            y: &[Lanes; $states],
            dy: &[Lanes; $states],
        ) -> [Lanes; 2] {
            let of_lanes: [[f64; 2]; LANES] = std::array::from_fn(|lane| {
                let [y, dy] = [y, dy].map(|states| states.map(|state| state.lane(lane)));
                let node = self.node(phase_rad.lane(lane));
                let acceleration = self.acceleration(&node, &y, &dy);
                let state = self.kinematics(&node, &y);
                let forces = contact_forces::<F>(&self.problem, &state, &acceleration);
                [forces.power_w, forces.loss_w]
            });
            lanes(of_lanes.each_ref())
        }

        fn sample(
            &self,
            time_s: f64,
            pose: Pose,
            node: &Self::Node<f64>,
            y: &[f64; $states],
            dy: &[f64; $states],
        ) -> Sample {
            let acceleration = self.acceleration(node, y, dy);
            let state = self.kinematics(node, y);
            Sample::new::<F>(&self.problem, time_s, pose, &state, &acceleration)
        }
    };
}
use of_three_links;

impl Problem {
    /// Returns whether the motion can depend on a variable.
    pub(super) fn depends_on(&self, variable: Variable) -> bool {
        match variable {
            Variable::Parameter(parameter) => self.laws.is_relevant(parameter, &self.gait),
            Variable::Gait(joint, _) => self.gait.passive_joint() != Some(joint),
            Variable::Second(joint, _) => {
                self.gait.joints[joint].is_some_and(|command| command.second.is_some())
            }
        }
    }

    /// Returns robot parameters with factors. The sum of the factors times the derivatives with respect to these
    /// parameters is the derivative with respect to omega of the motion per radian of phase, which depends only on
    /// viscous coefficients and characteristic speeds over omega and on stiffness and dry friction over omega squared.
    pub(super) fn omega_scaling(&self) -> impl Iterator<Item = (Parameter, f64)> {
        let single = Parameter::ALL.into_iter().filter(|parameter| !parameter.is_sum());
        single
            .map(|parameter| {
                let value = parameter.value_in(&self.robot);
                (parameter, -parameter.power_of_omega() * value / self.omega_rad_s)
            })
            .filter(|(_, factor)| *factor != 0.0)
    }

    /// Returns the speed `l omega` by which skid velocities are divided in the skid ratio (eq. 20 of the paper), m/s.
    pub(super) fn skid_scale_m_s(&self) -> f64 {
        self.robot.skid_length_m() * self.omega_rad_s
    }

    /// Returns whether the equations have half-period symmetry: the mirror image of a motion, shifted by half
    /// a period, is also a motion.
    pub fn is_mirrored(&self) -> bool {
        let rests_straight = self.robot.rest_angle_rad == 0.0;
        self.gait.is_symmetric() && (self.gait.passive_joint().is_none() || rests_straight)
    }
}

/// Returns the angles of the joints of three links, followed by zeros.
pub(super) fn joints_rad(phi_rad: [f64; 2]) -> [f64; MAX_JOINTS] {
    std::array::from_fn(|joint| phi_rad.get(joint).copied().unwrap_or(0.0))
}

/// Returns the power dissipated at the wheels and, if there is one, in the `passive` joint, W.
#[inline(always)]
pub(super) fn friction_power<T: Number, F: Friction>(
    robot: &Robot,
    passive: Option<usize>,
    KinematicState { velocity, trig, .. }: &KinematicState<T>,
) -> T {
    let skid = skid_rows(robot, trig);
    let roll = roll_rows(robot, trig);
    let mut power = match passive {
        Some(p) => T::splat(robot.damping_nm_s_rad) * velocity[3 + p] * velocity[3 + p],
        None => T::splat(0.0),
    };
    for wheel in 0..3 {
        let across = dot(&skid[wheel], velocity);
        let along = dot(&roll[wheel], velocity);
        power += F::skid(&robot.wheel_friction(wheel), across)[0] * across
            + F::roll(&robot.wheel_friction(wheel), along)[0] * along;
    }
    power
}

/// Returns the gradient, with respect to joint angles and velocities, of the power dissipated at the wheels
/// and in the `passive` joint.
#[inline(always)]
pub(super) fn friction_power_gradient<T: Number, F: Friction>(
    robot: &Robot,
    passive: Option<usize>,
    KinematicState { velocity, trig, .. }: &KinematicState<T>,
) -> Gradient<T> {
    let zero = T::splat(0.0);
    let mut gradient = Gradient { phi_rad: [zero; 2], velocity: [zero; 5] };
    let mut add = |wheel: usize, row: &[T; 5], drows_dphi: &[[T; 5]; 2], dpower_dspeed: T| {
        for i in 0..5 {
            gradient.velocity[i] += dpower_dspeed * row[i];
        }
        if let Some(joint) = wheel.checked_sub(1) {
            gradient.phi_rad[joint] += dpower_dspeed * dot(&drows_dphi[joint], velocity);
        }
    };
    let skid = skid_rows(robot, trig);
    let dskid = dskid_rows_dphi(robot, trig);
    let roll = roll_rows(robot, trig);
    let droll = droll_rows_dphi(robot, trig);
    for wheel in 0..3 {
        let across = dot(&skid[wheel], velocity);
        let along = dot(&roll[wheel], velocity);
        let [force, slope] = F::skid(&robot.wheel_friction(wheel), across);
        add(wheel, &skid[wheel], &dskid, force + slope * across);
        let [force, slope] = F::roll(&robot.wheel_friction(wheel), along);
        add(wheel, &roll[wheel], &droll, force + slope * along);
    }
    if let Some(p) = passive {
        gradient.velocity[3 + p] += T::splat(2.0 * robot.damping_nm_s_rad) * velocity[3 + p];
    }
    gradient
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

/// Joint commands at one time; the entries of a passive joint are zero.
#[derive(Debug, Clone, Copy)]
pub(super) struct CommandNode<T = f64> {
    /// Angle (relative to the offset), rate and acceleration of each joint's first harmonic, per radian of
    /// its amplitude; see [`Gait::waves`](trilink_robot::Gait::waves).
    waves: [[T; 3]; 2],
    /// Sine and cosine of twice the phase; zero if no command has a second harmonic.
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

    /// Returns the derivatives of a joint's commanded angle, rate and acceleration with respect to its
    /// offset, amplitude and phase.
    #[inline(always)]
    fn slopes(&self, joint: usize, problem: &Problem) -> [[T; 3]; COMMAND_SIZE] {
        let Problem { gait, omega_rad_s, .. } = problem;
        let amplitude = T::splat(gait.joints[joint].map_or(0.0, |joint| joint.amplitude_rad));
        let [_, rate, acceleration] = self.waves[joint].map(|wave| amplitude * wave);
        let omega = T::splat(*omega_rad_s);
        let period = T::splat(1.0 / omega_rad_s);
        let dphase = [rate * period, acceleration * period, -(omega * rate)];
        [[T::splat(1.0), T::splat(0.0), T::splat(0.0)], self.waves[joint], dphase]
    }

    /// Returns the derivatives of a joint's commanded angle, rate and acceleration with respect to the
    /// components of its second harmonic.
    #[inline(always)]
    fn second_slopes(&self, problem: &Problem) -> [[T; 3]; HARMONIC_SIZE] {
        Gait::second_waves(self.double_turn, problem.omega_rad_s)
    }

    /// Converts a gradient with respect to joint angles and rates to a gradient with respect to the joints'
    /// commands; other velocities are held fixed.
    #[inline(always)]
    pub(crate) fn gait_gradient(
        &self,
        gradient: &Gradient<T>,
        problem: &Problem,
    ) -> [CommandGradient<T>; 2] {
        let mut command_gradient = [[T::splat(0.0); COMMAND_SIZE + HARMONIC_SIZE]; 2];
        for joint in 0..2 {
            let [dphi, drate] = [gradient.phi_rad[joint], gradient.velocity[3 + joint]];
            let slopes = self.slopes(joint, problem);
            for i in 0..COMMAND_SIZE {
                let [phi, rate, _] = slopes[i];
                command_gradient[joint][i] = dphi * phi + drate * rate;
            }
            if problem.gait.has_second() {
                let slopes = self.second_slopes(problem);
                for i in 0..HARMONIC_SIZE {
                    let [phi, rate, _] = slopes[i];
                    command_gradient[joint][COMMAND_SIZE + i] = dphi * phi + drate * rate;
                }
            }
        }
        command_gradient
    }
}
