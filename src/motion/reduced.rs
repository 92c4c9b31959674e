//! The models' equations in the few states that matter.
//!
//! The motion does not depend on where the robot is or where it points, so only velocities
//! in link 0's frame and the passive joint's angle are states:
//!
//! | robot | skidding wheels | wheels that cannot skid |
//! |---|---|---|
//! | both joints commanded | `u, v, theta'` | none: eq. 3 gives the motion |
//! | one joint passive | `u, v, theta', phi_p', phi_p` | `s, phi_p` |

use crate::robot::{
    Balance, Gait, Robot, Shape, Trig, Velocity, dot, force_balance, mass_matrix, roll_rows,
    skid_rows,
};

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
pub enum Parameter {
    /// Skid resistance of a wheel, kg/s.
    Skid(usize),
    /// Roll resistance of a wheel, kg/s.
    Roll(usize),
    /// Stiffness of the passive joint, N m/rad.
    Stiffness,
    /// Damping of the passive joint, N m s/rad.
    Damping,
    /// Amplitude of a commanded joint (0 or 1), rad.
    Amplitude(usize),
}

impl Parameter {
    /// Every parameter.
    pub const ALL: [Self; 10] = [
        Self::Skid(0),
        Self::Skid(1),
        Self::Skid(2),
        Self::Roll(0),
        Self::Roll(1),
        Self::Roll(2),
        Self::Stiffness,
        Self::Damping,
        Self::Amplitude(0),
        Self::Amplitude(1),
    ];

    /// Its place in [`Parameter::ALL`].
    pub fn place(self) -> usize {
        match self {
            Self::Skid(wheel) => wheel,
            Self::Roll(wheel) => 3 + wheel,
            Self::Stiffness => 6,
            Self::Damping => 7,
            Self::Amplitude(joint) => 8 + joint,
        }
    }
}

/// Most parameters that a motion of one kind can depend on.
pub(super) const MOST_PARAMETERS: usize = 9;

/// Derivatives of each equation with respect to the parameters of [`Reduced::parameter`].
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

    /// The parameter of a column, counted from 0 to [`Reduced::PARAMETERS`].
    fn parameter(&self, column: usize) -> Parameter;

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

    /// Whether the motion can depend on a parameter.
    pub fn knows(&self, parameter: Parameter) -> bool {
        let passive = self.gait.passive_joint();
        match parameter {
            Parameter::Skid(_) => self.model_skids,
            Parameter::Roll(_) => self.model_rolls,
            Parameter::Stiffness | Parameter::Damping => passive.is_some(),
            Parameter::Amplitude(joint) => passive != Some(joint),
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

/// Both joints commanded, wheels that skid. States `u, v, theta'`.
#[derive(Debug, Clone)]
pub(super) struct KinematicSkid(pub Driven);

impl KinematicSkid {
    #[inline(always)]
    fn equations(
        &self,
        node: &CommandNode,
        y: &[f64; 3],
        dy: &[f64; 3],
    ) -> (Residual<3>, Balance, [[f64; 5]; 5]) {
        let velocity = self.moment(node, y).velocity;
        let acceleration = self.acceleration(node, y, dy);
        let (robot, trig) = (&self.0.robot, &node.trig);
        let balance =
            force_balance(robot, None, node.shape.phi_rad, trig, &velocity, &acceleration);
        let mass = mass_matrix(robot, trig);
        let body = |full: &[[f64; 5]; 5]| -> [[f64; 3]; 3] {
            std::array::from_fn(|i| std::array::from_fn(|j| full[i][j]))
        };
        let residual = Residual {
            value: std::array::from_fn(|i| balance.value[i]),
            by_state: body(&balance.by_velocity),
            by_rate: body(&mass),
        };
        (residual, balance, mass)
    }
}

impl Reduced<3> for KinematicSkid {
    const PARAMETERS: usize = 8;
    const SKIDS: bool = true;
    const INTEGRATED: bool = false;
    const HAS_ANGLE: bool = false;

    type Node = CommandNode;

    fn node(&self, phase_rad: f64) -> CommandNode {
        CommandNode::new(&self.0, phase_rad)
    }

    #[inline(always)]
    fn residual(&self, node: &CommandNode, y: &[f64; 3], dy: &[f64; 3]) -> Residual<3> {
        self.equations(node, y, dy).0
    }

    fn parameter(&self, column: usize) -> Parameter {
        match column {
            0..3 => Parameter::Skid(column),
            3..6 => Parameter::Roll(column - 3),
            _ => Parameter::Amplitude(column - 6),
        }
    }

    #[inline(always)]
    fn sensitivity(
        &self,
        node: &CommandNode,
        y: &[f64; 3],
        dy: &[f64; 3],
        by: &mut ByParameters<3>,
    ) -> Residual<3> {
        let (residual, balance, mass) = self.equations(node, y, dy);
        let velocity = self.moment(node, y).velocity;
        let by_skid = by_coefficients(&skid_rows(&self.0.robot, &node.trig), &velocity);
        let by_roll = by_coefficients(&roll_rows(&self.0.robot, &node.trig), &velocity);
        for (i, by) in by.iter_mut().enumerate() {
            for wheel in 0..3 {
                by[wheel] = by_skid[wheel][i];
                by[3 + wheel] = by_roll[wheel][i];
            }
            for (a, [phi, rate, acceleration]) in node.waves.into_iter().enumerate() {
                by[6 + a] = balance.by_phi[a][i] * phi
                    + balance.by_velocity[i][3 + a] * rate
                    + mass[i][3 + a] * acceleration;
            }
        }
        residual
    }

    #[inline(always)]
    fn moment(&self, node: &CommandNode, y: &[f64; 3]) -> Moment {
        let [w1, w2] = node.shape.rate_rad_s;
        Moment { phi_rad: node.shape.phi_rad, velocity: [y[0], y[1], y[2], w1, w2] }
    }

    #[inline(always)]
    fn acceleration(&self, node: &CommandNode, _y: &[f64; 3], dy: &[f64; 3]) -> [f64; 5] {
        let [a1, a2] = node.shape.acceleration_rad_s2;
        [dy[0], dy[1], dy[2], a1, a2]
    }

    #[inline(always)]
    fn by_state(&self, _node: &CommandNode, _y: &[f64; 3], by_moment: &Moment) -> [f64; 3] {
        let [u, v, r, ..] = by_moment.velocity;
        [u, v, r]
    }

    #[inline(always)]
    fn by_amplitude(&self, node: &CommandNode, _y: &[f64; 3], by_moment: &Moment) -> [f64; 2] {
        node.by_amplitude(by_moment)
    }

    fn half_period_signs(&self) -> Option<[f64; 3]> {
        self.0.is_mirrored().then_some([1.0, -1.0, -1.0])
    }

    fn at_rest(&self) -> [f64; 3] {
        [0.0; 3]
    }
}

/// Joint `passive` (0 or 1) on its spring, wheels that skid. States
/// `u, v, theta', phi_p', phi_p`.
#[derive(Debug, Clone)]
pub(super) struct PassiveSkid {
    pub driven: Driven,
    pub passive: usize,
}

impl PassiveSkid {
    /// Equations 0, 1, 2 and that of the passive joint.
    fn rows(&self) -> [usize; 4] {
        [0, 1, 2, 3 + self.passive]
    }

    fn trig(&self, node: &CommandNode, phi_rad: f64) -> Trig {
        let mut trig = node.trig;
        (trig.s[self.passive], trig.c[self.passive]) = phi_rad.sin_cos();
        trig
    }

    #[inline(always)]
    fn equations(
        &self,
        node: &CommandNode,
        trig: &Trig,
        y: &[f64; 5],
        dy: &[f64; 5],
    ) -> (Residual<5>, Balance, [[f64; 5]; 5]) {
        let (p, robot) = (self.passive, &self.driven.robot);
        let Moment { phi_rad, velocity } = self.moment(node, y);
        let acceleration = self.acceleration(node, y, dy);
        let balance = force_balance(robot, Some(p), phi_rad, trig, &velocity, &acceleration);
        let mass = mass_matrix(robot, trig);
        let rows = self.rows();
        let mut residual =
            Residual { value: [0.0; 5], by_state: [[0.0; 5]; 5], by_rate: [[0.0; 5]; 5] };
        for (i, &row) in rows.iter().enumerate() {
            residual.value[i] = balance.value[row];
            for (j, &column) in rows.iter().enumerate() {
                residual.by_state[i][j] = balance.by_velocity[row][column];
                residual.by_rate[i][j] = mass[row][column];
            }
            residual.by_state[i][4] = balance.by_phi[p][row];
        }
        (residual, balance, mass)
    }
}

impl Reduced<5> for PassiveSkid {
    const PARAMETERS: usize = 9;
    const SKIDS: bool = true;
    const INTEGRATED: bool = true;
    const HAS_ANGLE: bool = true;

    type Node = CommandNode;

    fn node(&self, phase_rad: f64) -> CommandNode {
        CommandNode::new(&self.driven, phase_rad)
    }

    #[inline(always)]
    fn residual(&self, node: &CommandNode, y: &[f64; 5], dy: &[f64; 5]) -> Residual<5> {
        self.equations(node, &self.trig(node, y[4]), y, dy).0
    }

    fn parameter(&self, column: usize) -> Parameter {
        match column {
            0..3 => Parameter::Skid(column),
            3..6 => Parameter::Roll(column - 3),
            6 => Parameter::Stiffness,
            7 => Parameter::Damping,
            _ => Parameter::Amplitude(1 - self.passive),
        }
    }

    #[inline(always)]
    fn sensitivity(
        &self,
        node: &CommandNode,
        y: &[f64; 5],
        dy: &[f64; 5],
        by: &mut ByParameters<5>,
    ) -> Residual<5> {
        let (a, robot) = (1 - self.passive, &self.driven.robot);
        let trig = self.trig(node, y[4]);
        let (residual, balance, mass) = self.equations(node, &trig, y, dy);
        let velocity = self.moment(node, y).velocity;
        let by_skid = by_coefficients(&skid_rows(robot, &trig), &velocity);
        let by_roll = by_coefficients(&roll_rows(robot, &trig), &velocity);
        let [phi, rate, acceleration] = node.waves[a];
        for (by, row) in by.iter_mut().zip(self.rows()) {
            for wheel in 0..3 {
                by[wheel] = by_skid[wheel][row];
                by[3 + wheel] = by_roll[wheel][row];
            }
            (by[6], by[7]) = (0.0, 0.0);
            by[8] = balance.by_phi[a][row] * phi
                + balance.by_velocity[row][3 + a] * rate
                + mass[row][3 + a] * acceleration;
        }
        (by[3][6], by[3][7]) = (y[4] - robot.rest_angle_rad, y[3]);
        residual
    }

    #[inline(always)]
    fn moment(&self, node: &CommandNode, y: &[f64; 5]) -> Moment {
        let p = self.passive;
        let mut phi_rad = node.shape.phi_rad;
        phi_rad[p] = y[4];
        let mut velocity = [y[0], y[1], y[2], 0.0, 0.0];
        velocity[3 + p] = y[3];
        velocity[4 - p] = node.shape.rate_rad_s[1 - p];
        Moment { phi_rad, velocity }
    }

    #[inline(always)]
    fn acceleration(&self, node: &CommandNode, _y: &[f64; 5], dy: &[f64; 5]) -> [f64; 5] {
        let mut acceleration = [dy[0], dy[1], dy[2], 0.0, 0.0];
        acceleration[3 + self.passive] = dy[3];
        acceleration[4 - self.passive] = node.shape.acceleration_rad_s2[1 - self.passive];
        acceleration
    }

    #[inline(always)]
    fn by_state(&self, _node: &CommandNode, _y: &[f64; 5], by_moment: &Moment) -> [f64; 5] {
        let [u, v, r, ..] = by_moment.velocity;
        [u, v, r, by_moment.velocity[3 + self.passive], by_moment.phi_rad[self.passive]]
    }

    #[inline(always)]
    fn by_amplitude(&self, node: &CommandNode, _y: &[f64; 5], by_moment: &Moment) -> [f64; 2] {
        node.by_amplitude(by_moment)
    }

    fn half_period_signs(&self) -> Option<[f64; 5]> {
        self.driven.is_mirrored().then_some([1.0, -1.0, -1.0, -1.0, -1.0])
    }

    fn at_rest(&self) -> [f64; 5] {
        [0.0, 0.0, 0.0, 0.0, self.driven.robot.rest_angle_rad]
    }
}

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
pub(super) struct PassiveNoSkid {
    pub driven: Driven,
    pub passive: usize,
}

/// What the command prescribes: the null direction and the particular solution.
#[derive(Debug, Clone, Copy)]
pub(super) struct ConstrainedNode {
    command: CommandNode,
    frame: Frame,
}

/// `(u, theta')` along the null direction and of the particular solution, and their time
/// derivatives.
#[derive(Debug, Clone, Copy)]
struct Frame {
    null: [f64; 2],
    null_rate: [f64; 2],
    particular: [f64; 2],
    particular_rate: [f64; 2],
}

impl Frame {
    fn velocities(&self, s: f64) -> [f64; 2] {
        std::array::from_fn(|i| s * self.null[i] + self.particular[i])
    }

    fn accelerations(&self, s: f64, ds: f64) -> [f64; 2] {
        std::array::from_fn(|i| ds * self.null[i] + s * self.null_rate[i] + self.particular_rate[i])
    }
}

/// Sign with which a side link's wheel feels its joint.
fn joint_sign(joint: usize) -> f64 {
    if joint == 0 { 1.0 } else { -1.0 }
}

/// The wheel of the passive link, which gives `phi_p'` from `(u, theta')`.
struct PassiveWheel {
    sin: f64,
    cos: f64,
    arm_m: f64,
    h_m: f64,
    /// `sigma_p / l`.
    per_m: f64,
}

impl PassiveWheel {
    /// `phi_p'`.
    fn rate(&self, [u, r]: [f64; 2]) -> f64 {
        self.per_m * (self.sin * u + self.arm_m * r)
    }

    /// How `phi_p'` changes with `phi_p`.
    fn rate_by_phi(&self, [u, r]: [f64; 2]) -> f64 {
        self.per_m * (self.cos * u - self.h_m * self.sin * r)
    }

    /// And how that changes with `phi_p`.
    fn rate_by_phi_phi(&self, [u, r]: [f64; 2]) -> f64 {
        self.per_m * (-self.sin * u - self.h_m * self.cos * r)
    }
}

/// The projected equations of one moment and what they are made of.
struct Projected {
    residual: Residual<2>,
    balance: Balance,
    mass: [[f64; 5]; 5],
    trig: Trig,
    moment: Moment,
    wheel: PassiveWheel,
    /// `(u, theta')`.
    velocities: [f64; 2],
    /// The null direction along `u`, `theta'` and `phi_p'`.
    null: [f64; 3],
}

impl PassiveNoSkid {
    /// Rows of eq. 7 that the null direction has parts along.
    fn rows(&self) -> [usize; 3] {
        [0, 2, 3 + self.passive]
    }

    fn wheel(&self, phi: f64) -> PassiveWheel {
        let (h_m, l_m) = (self.driven.robot.h_m, self.driven.robot.l_m);
        let (sin, cos) = phi.sin_cos();
        PassiveWheel {
            sin,
            cos,
            arm_m: l_m + h_m * cos,
            h_m,
            per_m: joint_sign(self.passive) / l_m,
        }
    }

    #[inline(always)]
    fn equations(&self, node: &ConstrainedNode, y: &[f64; 2], dy: &[f64; 2]) -> Projected {
        let (p, robot, frame) = (self.passive, &self.driven.robot, &node.frame);
        let wheel = self.wheel(y[1]);
        let mut trig = node.command.trig;
        (trig.s[p], trig.c[p]) = (wheel.sin, wheel.cos);
        let velocities = frame.velocities(y[0]);
        let accelerations = frame.accelerations(y[0], dy[0]);
        let (n_p, n_p_by_phi) = (wheel.rate(frame.null), wheel.rate_by_phi(frame.null));
        let (w, w_by_phi) = (wheel.rate(velocities), wheel.rate_by_phi(velocities));
        let dw_by_s = n_p_by_phi * w + w_by_phi * n_p + wheel.rate(frame.null_rate);
        let dw_by_phi = wheel.rate_by_phi_phi(velocities) * w
            + w_by_phi * w_by_phi
            + wheel.rate_by_phi(accelerations);

        let moment = self.moment(node, y);
        let acceleration = self.acceleration(node, y, dy);
        let Moment { phi_rad, velocity } = moment;
        let balance = force_balance(robot, Some(p), phi_rad, &trig, &velocity, &acceleration);
        let mass = mass_matrix(robot, &trig);

        let rows = self.rows();
        let null = [frame.null[0], frame.null[1], n_p];
        // Derivative of the projected balance when velocities and accelerations change.
        let project = |by: [f64; 3], rate_by: [f64; 3]| -> f64 {
            let mut sum = 0.0;
            for (n, &row) in null.iter().zip(&rows) {
                for (k, &column) in rows.iter().enumerate() {
                    sum += n
                        * (balance.by_velocity[row][column] * by[k]
                            + mass[row][column] * rate_by[k]);
                }
            }
            sum
        };
        let value = null.iter().zip(&rows).map(|(n, &row)| n * balance.value[row]).sum();
        let by_s = project(null, [frame.null_rate[0], frame.null_rate[1], dw_by_s]);
        let turned: f64 = null.iter().zip(&rows).map(|(n, &row)| n * balance.by_phi[p][row]).sum();
        let by_phi = project([0.0, 0.0, w_by_phi], [0.0, 0.0, dw_by_phi])
            + turned
            + n_p_by_phi * balance.value[3 + p];
        let residual = Residual {
            value: [value, dy[1] - w],
            by_state: [[by_s, by_phi], [-n_p, -w_by_phi]],
            by_rate: [[project([0.0; 3], null), 0.0], [0.0, 1.0]],
        };
        Projected { residual, balance, mass, trig, moment, wheel, velocities, null }
    }

    /// How the frame changes with the commanded joint's amplitude.
    #[inline(always)]
    fn frame_by_amplitude(&self, node: &ConstrainedNode) -> Frame {
        let (h, l) = (self.driven.robot.h_m, self.driven.robot.l_m);
        let a = 1 - self.passive;
        let sign = joint_sign(a) * l;
        let command = &node.command;
        let (sin, cos) = (command.trig.s[a], command.trig.c[a]);
        let (rate, acceleration) =
            (command.shape.rate_rad_s[a], command.shape.acceleration_rad_s2[a]);
        let [dphi, drate, dacceleration] = command.waves[a];
        let arm = l + h * cos;
        let (arm_rate, sin_rate) = (-h * sin * rate, cos * rate);
        let (dsin, darm) = (cos * dphi, -h * sin * dphi);
        let darm_rate = -h * (cos * dphi * rate + sin * drate);
        let dsin_rate = -sin * dphi * rate + cos * drate;
        let norm = sin * sin * l * l + arm * arm;
        let norm_rate = 2.0 * (sin * sin_rate * l * l + arm * arm_rate);
        let dnorm = 2.0 * (l * l * sin * dsin + arm * darm);
        let dnorm_rate =
            2.0 * (l * l * (dsin * sin_rate + sin * dsin_rate) + darm * arm_rate + arm * darm_rate);
        let q = sign * rate / norm;
        let q_rate = sign * acceleration / norm - q * norm_rate / norm;
        let dq = (sign * drate - q * dnorm) / norm;
        let dq_rate =
            (sign * dacceleration - dq * norm_rate - q * dnorm_rate - q_rate * dnorm) / norm;
        Frame {
            null: [darm, -dsin],
            null_rate: [darm_rate, -dsin_rate],
            particular: [l * l * (dsin * q + sin * dq), darm * q + arm * dq],
            particular_rate: [
                l * l * (dsin_rate * q + sin_rate * dq + dsin * q_rate + sin * dq_rate),
                darm_rate * q + arm_rate * dq + darm * q_rate + arm * dq_rate,
            ],
        }
    }
}

impl Reduced<2> for PassiveNoSkid {
    const PARAMETERS: usize = 6;
    const SKIDS: bool = false;
    const INTEGRATED: bool = false;
    const HAS_ANGLE: bool = true;

    type Node = ConstrainedNode;

    fn node(&self, phase_rad: f64) -> ConstrainedNode {
        let command = CommandNode::new(&self.driven, phase_rad);
        let (h, l) = (self.driven.robot.h_m, self.driven.robot.l_m);
        let a = 1 - self.passive;
        let (sin, cos) = (command.trig.s[a], command.trig.c[a]);
        let (rate, acceleration) =
            (command.shape.rate_rad_s[a], command.shape.acceleration_rad_s2[a]);
        let (arm, arm_rate, sin_rate) = (l + h * cos, -h * sin * rate, cos * rate);
        // The shortest particular solution, rotation counted as speed at the distance l.
        let norm = sin * sin * l * l + arm * arm;
        let norm_rate = 2.0 * (sin * sin_rate * l * l + arm * arm_rate);
        let q = joint_sign(a) * l * rate / norm;
        let q_rate = joint_sign(a) * l * acceleration / norm - q * norm_rate / norm;
        let frame = Frame {
            null: [arm, -sin],
            null_rate: [arm_rate, -sin_rate],
            particular: [l * l * sin * q, arm * q],
            particular_rate: [l * l * (sin_rate * q + sin * q_rate), arm_rate * q + arm * q_rate],
        };
        ConstrainedNode { command, frame }
    }

    #[inline(always)]
    fn residual(&self, node: &ConstrainedNode, y: &[f64; 2], dy: &[f64; 2]) -> Residual<2> {
        self.equations(node, y, dy).residual
    }

    fn parameter(&self, column: usize) -> Parameter {
        match column {
            0..3 => Parameter::Roll(column),
            3 => Parameter::Stiffness,
            4 => Parameter::Damping,
            _ => Parameter::Amplitude(1 - self.passive),
        }
    }

    #[inline(always)]
    fn sensitivity(
        &self,
        node: &ConstrainedNode,
        y: &[f64; 2],
        dy: &[f64; 2],
        by: &mut ByParameters<2>,
    ) -> Residual<2> {
        let (p, a, robot) = (self.passive, 1 - self.passive, &self.driven.robot);
        let Projected { residual, balance, mass, trig, moment, wheel, velocities, null } =
            self.equations(node, y, dy);
        let rows = self.rows();
        let along = |force: &[f64; 5]| -> f64 {
            null.iter().zip(&rows).map(|(n, &row)| n * force[row]).sum()
        };
        let by_roll = by_coefficients(&roll_rows(robot, &trig), &moment.velocity);
        for wheel in 0..3 {
            by[0][wheel] = along(&by_roll[wheel]);
        }
        by[0][3] = null[2] * (y[1] - robot.rest_angle_rad);
        by[0][4] = null[2] * moment.velocity[3 + p];

        // The frame of the constraints turns with the commanded joint.
        let frame = self.frame_by_amplitude(node);
        let (dvelocities, daccelerations) =
            (frame.velocities(y[0]), frame.accelerations(y[0], dy[0]));
        let (w, dw) = (wheel.rate(velocities), wheel.rate(dvelocities));
        let rate_by_phi = wheel.rate_by_phi(velocities);
        let [phi, rate, acceleration] = node.command.waves[a];
        let mut velocity = [dvelocities[0], 0.0, dvelocities[1], 0.0, 0.0];
        let mut rates = [daccelerations[0], 0.0, daccelerations[1], 0.0, 0.0];
        (velocity[3 + p], velocity[3 + a]) = (dw, rate);
        rates[3 + p] =
            wheel.rate_by_phi(dvelocities) * w + rate_by_phi * dw + wheel.rate(daccelerations);
        rates[3 + a] = acceleration;
        let dnull = [frame.null[0], frame.null[1], wheel.rate(frame.null)];
        let mut sum = 0.0;
        for ((n, dn), &row) in null.iter().zip(&dnull).zip(&rows) {
            let force = dot(&balance.by_velocity[row], &velocity)
                + dot(&mass[row], &rates)
                + balance.by_phi[a][row] * phi;
            sum += n * force + dn * balance.value[row];
        }
        by[0][5] = sum;
        by[1] = [0.0; MOST_PARAMETERS];
        by[1][5] = -dw;
        residual
    }

    #[inline(always)]
    fn acceleration(&self, node: &ConstrainedNode, y: &[f64; 2], dy: &[f64; 2]) -> [f64; 5] {
        let (p, wheel) = (self.passive, self.wheel(y[1]));
        let velocities = node.frame.velocities(y[0]);
        let [du, dr] = node.frame.accelerations(y[0], dy[0]);
        let mut acceleration = [du, 0.0, dr, 0.0, 0.0];
        acceleration[3 + p] =
            wheel.rate_by_phi(velocities) * wheel.rate(velocities) + wheel.rate([du, dr]);
        acceleration[4 - p] = node.command.shape.acceleration_rad_s2[1 - p];
        acceleration
    }

    #[inline(always)]
    fn by_state(&self, node: &ConstrainedNode, y: &[f64; 2], by_moment: &Moment) -> [f64; 2] {
        let (p, wheel, frame) = (self.passive, self.wheel(y[1]), &node.frame);
        let [u, _, r, ..] = by_moment.velocity;
        let by_w = by_moment.velocity[3 + p];
        let by_s = u * frame.null[0] + r * frame.null[1] + by_w * wheel.rate(frame.null);
        let by_phi = by_moment.phi_rad[p] + by_w * wheel.rate_by_phi(frame.velocities(y[0]));
        [by_s, by_phi]
    }

    #[inline(always)]
    fn by_amplitude(&self, node: &ConstrainedNode, y: &[f64; 2], by_moment: &Moment) -> [f64; 2] {
        let (p, a, wheel) = (self.passive, 1 - self.passive, self.wheel(y[1]));
        let velocities = self.frame_by_amplitude(node).velocities(y[0]);
        let [u, _, r, ..] = by_moment.velocity;
        let mut by = node.command.by_amplitude(by_moment);
        by[a] += u * velocities[0]
            + r * velocities[1]
            + by_moment.velocity[3 + p] * wheel.rate(velocities);
        by
    }

    #[inline(always)]
    fn moment(&self, node: &ConstrainedNode, y: &[f64; 2]) -> Moment {
        let p = self.passive;
        let [u, r] = node.frame.velocities(y[0]);
        let mut phi_rad = node.command.shape.phi_rad;
        phi_rad[p] = y[1];
        let mut velocity = [u, 0.0, r, 0.0, 0.0];
        velocity[3 + p] = self.wheel(y[1]).rate([u, r]);
        velocity[4 - p] = node.command.shape.rate_rad_s[1 - p];
        Moment { phi_rad, velocity }
    }

    fn half_period_signs(&self) -> Option<[f64; 2]> {
        self.driven.is_mirrored().then_some([1.0, -1.0])
    }

    fn at_rest(&self) -> [f64; 2] {
        [0.0, self.driven.robot.rest_angle_rad]
    }
}
