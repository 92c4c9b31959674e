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
    Gait, Robot, Shape, Trig, Velocity, dot, force_balance, mass_matrix, roll_rows, skid_rows,
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
}

/// Equations of motion `0 = residual(t, y, y')` with `N` states.
pub(super) trait Reduced<const N: usize> {
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

    /// Derivative of the residual with respect to a parameter.
    fn residual_by(
        &self,
        node: &Self::Node,
        y: &[f64; N],
        dy: &[f64; N],
        parameter: Parameter,
    ) -> [f64; N];

    /// Angles and velocities of the whole robot in state `y`.
    fn moment(&self, node: &Self::Node, y: &[f64; N]) -> Moment;

    /// Time derivatives of the moment's velocities.
    fn acceleration(&self, node: &Self::Node, y: &[f64; N], dy: &[f64; N]) -> [f64; 5];

    /// Change of the moment when the state changes by `step` and `parameter` by 1.
    fn moment_by(
        &self,
        node: &Self::Node,
        y: &[f64; N],
        step: &[f64; N],
        parameter: Parameter,
    ) -> Moment;

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
    fn shape(&self, phase_rad: f64) -> Shape {
        self.gait.at(phase_rad, self.omega_rad_s)
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

    /// What eq. 7's left-hand side changes by when commanded joint `a`'s amplitude does, and the
    /// change of its angle and rate.
    fn amplitude_by(
        &self,
        passive: Option<usize>,
        moment: &Moment,
        acceleration: &[f64; 5],
        shape: &Shape,
        a: usize,
    ) -> [f64; 5] {
        let trig = Trig::new(moment.phi_rad);
        let robot = &self.robot;
        let velocity = &moment.velocity;
        let balance = force_balance(robot, passive, moment.phi_rad, &trig, velocity, acceleration);
        let mass = mass_matrix(robot, &trig);
        let [phi, rate, acceleration] = self.wave(shape, a);
        std::array::from_fn(|i| {
            balance.by_phi[a][i] * phi
                + balance.by_velocity[i][3 + a] * rate
                + mass[i][3 + a] * acceleration
        })
    }

    /// Angle, rate and acceleration of a commanded joint per radian of its amplitude; zero for
    /// a passive joint.
    fn wave(&self, shape: &Shape, a: usize) -> [f64; 3] {
        self.gait.joints[a].map_or([0.0; 3], |joint| {
            [shape.phi_rad[a] - joint.offset_rad, shape.rate_rad_s[a], shape.acceleration_rad_s2[a]]
                .map(|part| part / joint.amplitude_rad)
        })
    }

    /// Adds what a commanded joint's amplitude changes of a moment.
    fn add_wave(&self, moment: &mut Moment, shape: &Shape, parameter: Parameter) {
        if let Parameter::Amplitude(a) = parameter {
            let [phi, rate, _] = self.wave(shape, a);
            moment.phi_rad[a] += phi;
            moment.velocity[3 + a] += rate;
        }
    }

    /// Whether the mirror image of the motion follows half a period later.
    fn is_mirrored(&self) -> bool {
        let rests_straight = self.robot.rest_angle_rad == 0.0;
        self.gait.is_symmetric() && (self.gait.passive_joint().is_none() || rests_straight)
    }
}

/// Derivative of eq. 7's left-hand side with respect to a coefficient.
fn balance_by(
    robot: &Robot,
    passive: Option<usize>,
    moment: &Moment,
    parameter: Parameter,
) -> [f64; 5] {
    let trig = Trig::new(moment.phi_rad);
    let along = |row: [f64; 5]| {
        let velocity = dot(&row, &moment.velocity);
        row.map(|entry| entry * velocity)
    };
    let mut by = [0.0; 5];
    match (parameter, passive) {
        (Parameter::Skid(wheel), _) => return along(skid_rows(robot, &trig)[wheel]),
        (Parameter::Roll(wheel), _) => return along(roll_rows(robot, &trig)[wheel]),
        (Parameter::Stiffness, Some(p)) => by[3 + p] = moment.phi_rad[p] - robot.rest_angle_rad,
        (Parameter::Damping, Some(p)) => by[3 + p] = moment.velocity[3 + p],
        _ => {}
    }
    by
}

/// Both joints commanded, wheels that skid. States `u, v, theta'`.
#[derive(Debug, Clone)]
pub(super) struct KinematicSkid(pub Driven);

impl Reduced<3> for KinematicSkid {
    const INTEGRATED: bool = false;
    const HAS_ANGLE: bool = false;

    type Node = (Shape, Trig);

    fn node(&self, phase_rad: f64) -> Self::Node {
        let shape = self.0.shape(phase_rad);
        (shape, Trig::new(shape.phi_rad))
    }

    #[inline(always)]
    fn residual(&self, node: &Self::Node, y: &[f64; 3], dy: &[f64; 3]) -> Residual<3> {
        let (shape, trig) = node;
        let velocity = self.moment(node, y).velocity;
        let acceleration = self.acceleration(node, y, dy);
        let robot = &self.0.robot;
        let balance = force_balance(robot, None, shape.phi_rad, trig, &velocity, &acceleration);
        let mass = mass_matrix(robot, trig);
        let body = |full: &[[f64; 5]; 5]| -> [[f64; 3]; 3] {
            std::array::from_fn(|i| std::array::from_fn(|j| full[i][j]))
        };
        Residual {
            value: std::array::from_fn(|i| balance.value[i]),
            by_state: body(&balance.by_velocity),
            by_rate: body(&mass),
        }
    }

    fn residual_by(
        &self,
        node: &Self::Node,
        y: &[f64; 3],
        dy: &[f64; 3],
        parameter: Parameter,
    ) -> [f64; 3] {
        let moment = self.moment(node, y);
        let by = match parameter {
            Parameter::Amplitude(a) => {
                let acceleration = self.acceleration(node, y, dy);
                self.0.amplitude_by(None, &moment, &acceleration, &node.0, a)
            }
            coefficient => balance_by(&self.0.robot, None, &moment, coefficient),
        };
        [by[0], by[1], by[2]]
    }

    fn moment(&self, node: &Self::Node, y: &[f64; 3]) -> Moment {
        let [w1, w2] = node.0.rate_rad_s;
        Moment { phi_rad: node.0.phi_rad, velocity: [y[0], y[1], y[2], w1, w2] }
    }

    fn acceleration(&self, node: &Self::Node, _y: &[f64; 3], dy: &[f64; 3]) -> [f64; 5] {
        let [a1, a2] = node.0.acceleration_rad_s2;
        [dy[0], dy[1], dy[2], a1, a2]
    }

    fn moment_by(
        &self,
        node: &Self::Node,
        _y: &[f64; 3],
        step: &[f64; 3],
        parameter: Parameter,
    ) -> Moment {
        let velocity = [step[0], step[1], step[2], 0.0, 0.0];
        let mut moment = Moment { phi_rad: [0.0; 2], velocity };
        self.0.add_wave(&mut moment, &node.0, parameter);
        moment
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

impl Reduced<5> for PassiveSkid {
    const INTEGRATED: bool = true;
    const HAS_ANGLE: bool = true;

    /// The entries of the passive joint are zero.
    type Node = (Shape, Trig);

    fn node(&self, phase_rad: f64) -> Self::Node {
        let shape = self.driven.shape(phase_rad);
        (shape, Trig::new(shape.phi_rad))
    }

    #[inline(always)]
    fn residual(&self, node: &Self::Node, y: &[f64; 5], dy: &[f64; 5]) -> Residual<5> {
        let (p, robot) = (self.passive, &self.driven.robot);
        let Moment { phi_rad, velocity } = self.moment(node, y);
        let mut trig = node.1;
        (trig.s[p], trig.c[p]) = y[4].sin_cos();
        let acceleration = self.acceleration(node, y, dy);
        let balance = force_balance(robot, Some(p), phi_rad, &trig, &velocity, &acceleration);
        let mass = mass_matrix(robot, &trig);

        let rows = [0, 1, 2, 3 + p];
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
        residual
    }

    fn residual_by(
        &self,
        node: &Self::Node,
        y: &[f64; 5],
        dy: &[f64; 5],
        parameter: Parameter,
    ) -> [f64; 5] {
        let (p, moment) = (self.passive, self.moment(node, y));
        let by = match parameter {
            Parameter::Amplitude(a) => {
                let acceleration = self.acceleration(node, y, dy);
                self.driven.amplitude_by(Some(p), &moment, &acceleration, &node.0, a)
            }
            coefficient => balance_by(&self.driven.robot, Some(p), &moment, coefficient),
        };
        [by[0], by[1], by[2], by[3 + p], 0.0]
    }

    fn moment(&self, node: &Self::Node, y: &[f64; 5]) -> Moment {
        let p = self.passive;
        let mut phi_rad = node.0.phi_rad;
        phi_rad[p] = y[4];
        let mut velocity = [y[0], y[1], y[2], 0.0, 0.0];
        velocity[3 + p] = y[3];
        velocity[4 - p] = node.0.rate_rad_s[1 - p];
        Moment { phi_rad, velocity }
    }

    fn acceleration(&self, node: &Self::Node, _y: &[f64; 5], dy: &[f64; 5]) -> [f64; 5] {
        let mut acceleration = [dy[0], dy[1], dy[2], 0.0, 0.0];
        acceleration[3 + self.passive] = dy[3];
        acceleration[4 - self.passive] = node.0.acceleration_rad_s2[1 - self.passive];
        acceleration
    }

    fn moment_by(
        &self,
        node: &Self::Node,
        _y: &[f64; 5],
        step: &[f64; 5],
        parameter: Parameter,
    ) -> Moment {
        let mut moment =
            Moment { phi_rad: [0.0; 2], velocity: [step[0], step[1], step[2], 0.0, 0.0] };
        moment.phi_rad[self.passive] = step[4];
        moment.velocity[3 + self.passive] = step[3];
        self.driven.add_wave(&mut moment, &node.0, parameter);
        moment
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
    phase_rad: f64,
    shape: Shape,
    trig: Trig,
    /// `(u, theta')` along the null direction, and its time derivative.
    null: [f64; 2],
    null_rate: [f64; 2],
    /// `(u, theta')` of the particular solution, and its time derivative.
    particular: [f64; 2],
    particular_rate: [f64; 2],
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

impl PassiveNoSkid {
    fn velocities(&self, node: &ConstrainedNode, s: f64) -> [f64; 2] {
        std::array::from_fn(|i| s * node.null[i] + node.particular[i])
    }

    fn accelerations(&self, node: &ConstrainedNode, s: f64, ds: f64) -> [f64; 2] {
        std::array::from_fn(|i| ds * node.null[i] + s * node.null_rate[i] + node.particular_rate[i])
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
}

impl PassiveNoSkid {
    /// Central difference of `of` at the same phase under a gait whose commanded amplitude is
    /// changed by `step`, up and down.
    fn by_amplitude<const M: usize>(
        &self,
        node: &ConstrainedNode,
        a: usize,
        of: impl Fn(&Self, &ConstrainedNode, f64) -> [f64; M],
    ) -> [f64; M] {
        const STEP_RAD: f64 = 1e-5;
        let at = |step: f64| {
            let mut changed = Self { driven: self.driven.clone(), passive: self.passive };
            if let Some(joint) = &mut changed.driven.gait.joints[a] {
                joint.amplitude_rad += step;
            }
            of(&changed, &changed.node(node.phase_rad), step)
        };
        let (low, high) = (at(-STEP_RAD), at(STEP_RAD));
        std::array::from_fn(|i| (high[i] - low[i]) / (2.0 * STEP_RAD))
    }
}

impl Reduced<2> for PassiveNoSkid {
    const INTEGRATED: bool = false;
    const HAS_ANGLE: bool = true;

    type Node = ConstrainedNode;

    fn node(&self, phase_rad: f64) -> ConstrainedNode {
        let shape = self.driven.shape(phase_rad);
        let trig = Trig::new(shape.phi_rad);
        let (h, l) = (self.driven.robot.h_m, self.driven.robot.l_m);
        let a = 1 - self.passive;
        let (sin, cos) = (trig.s[a], trig.c[a]);
        let (rate, acceleration) = (shape.rate_rad_s[a], shape.acceleration_rad_s2[a]);
        let (arm, arm_rate, sin_rate) = (l + h * cos, -h * sin * rate, cos * rate);
        // The shortest particular solution, rotation counted as speed at the distance l.
        let norm = sin * sin * l * l + arm * arm;
        let norm_rate = 2.0 * (sin * sin_rate * l * l + arm * arm_rate);
        let q = joint_sign(a) * l * rate / norm;
        let q_rate = joint_sign(a) * l * acceleration / norm - q * norm_rate / norm;
        ConstrainedNode {
            phase_rad,
            shape,
            trig,
            null: [arm, -sin],
            null_rate: [arm_rate, -sin_rate],
            particular: [l * l * sin * q, arm * q],
            particular_rate: [l * l * (sin_rate * q + sin * q_rate), arm_rate * q + arm * q_rate],
        }
    }

    #[inline(always)]
    fn residual(&self, node: &ConstrainedNode, y: &[f64; 2], dy: &[f64; 2]) -> Residual<2> {
        let (p, robot) = (self.passive, &self.driven.robot);
        let wheel = self.wheel(y[1]);
        let mut trig = node.trig;
        (trig.s[p], trig.c[p]) = (wheel.sin, wheel.cos);
        let velocities = self.velocities(node, y[0]);
        let accelerations = self.accelerations(node, y[0], dy[0]);
        let (n_p, n_p_by_phi) = (wheel.rate(node.null), wheel.rate_by_phi(node.null));
        let (w, w_by_phi) = (wheel.rate(velocities), wheel.rate_by_phi(velocities));
        let dw_by_s = n_p_by_phi * w + w_by_phi * n_p + wheel.rate(node.null_rate);
        let dw_by_phi = wheel.rate_by_phi_phi(velocities) * w
            + w_by_phi * w_by_phi
            + wheel.rate_by_phi(accelerations);

        let Moment { phi_rad, velocity } = self.moment(node, y);
        let acceleration = self.acceleration(node, y, dy);
        let balance = force_balance(robot, Some(p), phi_rad, &trig, &velocity, &acceleration);
        let mass = mass_matrix(robot, &trig);

        let rows = [0, 2, 3 + p];
        let null = [node.null[0], node.null[1], n_p];
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
        let by_s = project(null, [node.null_rate[0], node.null_rate[1], dw_by_s]);
        let turned: f64 = null.iter().zip(&rows).map(|(n, &row)| n * balance.by_phi[p][row]).sum();
        let by_phi = project([0.0, 0.0, w_by_phi], [0.0, 0.0, dw_by_phi])
            + turned
            + n_p_by_phi * balance.value[3 + p];
        Residual {
            value: [value, dy[1] - w],
            by_state: [[by_s, by_phi], [-n_p, -w_by_phi]],
            by_rate: [[project([0.0; 3], null), 0.0], [0.0, 1.0]],
        }
    }

    fn residual_by(
        &self,
        node: &ConstrainedNode,
        y: &[f64; 2],
        dy: &[f64; 2],
        parameter: Parameter,
    ) -> [f64; 2] {
        if let Parameter::Amplitude(a) = parameter {
            let value = |model: &Self, node: &ConstrainedNode, _| model.residual(node, y, dy).value;
            return self.by_amplitude(node, a, value);
        }
        let p = self.passive;
        let moment = self.moment(node, y);
        let by = balance_by(&self.driven.robot, Some(p), &moment, parameter);
        let [n_u, n_r] = node.null;
        let n_p = self.wheel(y[1]).rate(node.null);
        [n_u * by[0] + n_r * by[2] + n_p * by[3 + p], 0.0]
    }

    fn acceleration(&self, node: &ConstrainedNode, y: &[f64; 2], dy: &[f64; 2]) -> [f64; 5] {
        let (p, wheel) = (self.passive, self.wheel(y[1]));
        let velocities = self.velocities(node, y[0]);
        let [du, dr] = self.accelerations(node, y[0], dy[0]);
        let mut acceleration = [du, 0.0, dr, 0.0, 0.0];
        acceleration[3 + p] =
            wheel.rate_by_phi(velocities) * wheel.rate(velocities) + wheel.rate([du, dr]);
        acceleration[4 - p] = node.shape.acceleration_rad_s2[1 - p];
        acceleration
    }

    fn moment_by(
        &self,
        node: &ConstrainedNode,
        y: &[f64; 2],
        step: &[f64; 2],
        parameter: Parameter,
    ) -> Moment {
        // The state goes along with the amplitude, or alone.
        let a = match parameter {
            Parameter::Amplitude(a) => a,
            _ => self.passive,
        };
        let all = self.by_amplitude(node, a, |model, node, part| {
            let moved = [y[0] + part * step[0], y[1] + part * step[1]];
            let Moment { phi_rad: [phi1, phi2], velocity: [u, v, r, w1, w2] } =
                model.moment(node, &moved);
            [phi1, phi2, u, v, r, w1, w2]
        });
        let [phi1, phi2, u, v, r, w1, w2] = all;
        Moment { phi_rad: [phi1, phi2], velocity: [u, v, r, w1, w2] }
    }

    fn moment(&self, node: &ConstrainedNode, y: &[f64; 2]) -> Moment {
        let p = self.passive;
        let [u, r] = self.velocities(node, y[0]);
        let mut phi_rad = node.shape.phi_rad;
        phi_rad[p] = y[1];
        let mut velocity = [u, 0.0, r, 0.0, 0.0];
        velocity[3 + p] = self.wheel(y[1]).rate([u, r]);
        velocity[4 - p] = node.shape.rate_rad_s[1 - p];
        Moment { phi_rad, velocity }
    }

    fn half_period_signs(&self) -> Option<[f64; 2]> {
        self.driven.is_mirrored().then_some([1.0, -1.0])
    }

    fn at_rest(&self) -> [f64; 2] {
        [0.0, self.driven.robot.rest_angle_rad]
    }
}
