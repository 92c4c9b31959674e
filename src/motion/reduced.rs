//! The models' equations in the few states that matter.
//!
//! The motion does not depend on where the robot is or where it points, so only velocities
//! in link 0's frame and the passive joint's angle are states:
//!
//! | robot | skidding wheels | wheels that cannot skid |
//! |---|---|---|
//! | both joints commanded | `u, v, theta'` | none (eq. 3, see [`super::kinematic`]) |
//! | one joint passive | `u, v, theta', phi_p', phi_p` | `s, phi_p` |

use crate::robot::{Gait, Robot, Shape, Trig, Velocity, force_balance, mass_matrix};

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

/// Equations of motion `0 = residual(t, y, y')` with `N` states.
pub(super) trait Reduced<const N: usize> {
    /// What the command prescribes at one moment, computed once per solution.
    type Node: Copy;

    /// The command at phase `omega t`.
    fn node(&self, phase_rad: f64) -> Self::Node;

    /// The equations at state `y` with time derivative `dy`.
    fn residual(&self, node: &Self::Node, y: &[f64; N], dy: &[f64; N]) -> Residual<N>;

    /// Angles and velocities of the whole robot in state `y`.
    fn moment(&self, node: &Self::Node, y: &[f64; N]) -> Moment;

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
}

impl Driven {
    fn shape(&self, phase_rad: f64) -> Shape {
        self.gait.at(phase_rad, self.omega_rad_s)
    }

    /// Whether the mirror image of the motion follows half a period later.
    fn is_mirrored(&self) -> bool {
        let rests_straight = self.robot.rest_angle_rad == 0.0;
        self.gait.is_symmetric() && (self.gait.passive_joint().is_none() || rests_straight)
    }
}

/// Both joints commanded, wheels that skid. States `u, v, theta'`.
pub(super) struct KinematicSkid(pub Driven);

impl Reduced<3> for KinematicSkid {
    type Node = (Shape, Trig);

    fn node(&self, phase_rad: f64) -> Self::Node {
        let shape = self.0.shape(phase_rad);
        (shape, Trig::new(shape.phi_rad))
    }

    #[inline(always)]
    fn residual(&self, node: &Self::Node, y: &[f64; 3], dy: &[f64; 3]) -> Residual<3> {
        let (shape, trig) = node;
        let velocity = [y[0], y[1], y[2], shape.rate_rad_s[0], shape.rate_rad_s[1]];
        let [a1, a2] = shape.acceleration_rad_s2;
        let acceleration = [dy[0], dy[1], dy[2], a1, a2];
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

    fn moment(&self, node: &Self::Node, y: &[f64; 3]) -> Moment {
        let [w1, w2] = node.0.rate_rad_s;
        Moment { phi_rad: node.0.phi_rad, velocity: [y[0], y[1], y[2], w1, w2] }
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
pub(super) struct PassiveSkid {
    pub driven: Driven,
    pub passive: usize,
}

impl Reduced<5> for PassiveSkid {
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
        let mut acceleration = [dy[0], dy[1], dy[2], 0.0, 0.0];
        acceleration[3 + p] = dy[3];
        acceleration[4 - p] = node.0.acceleration_rad_s2[1 - p];
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
        residual.value[4] = dy[4] - y[3];
        residual.by_state[4][3] = -1.0;
        residual.by_rate[4][4] = 1.0;
        residual
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
pub(super) struct PassiveNoSkid {
    pub driven: Driven,
    pub passive: usize,
}

/// What the command prescribes: the null direction and the particular solution.
#[derive(Debug, Clone, Copy)]
pub(super) struct ConstrainedNode {
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

impl PassiveNoSkid {
    fn velocities(&self, node: &ConstrainedNode, s: f64) -> [f64; 2] {
        [s * node.null[0] + node.particular[0], s * node.null[1] + node.particular[1]]
    }
}

impl Reduced<2> for PassiveNoSkid {
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
        let (h, l, sign) = (robot.h_m, robot.l_m, joint_sign(p));
        let (s, phi) = (y[0], y[1]);
        let mut trig = node.trig;
        (trig.s[p], trig.c[p]) = phi.sin_cos();
        let (sin, arm) = (trig.s[p], l + h * trig.c[p]);
        let (cos, h_sin) = (trig.c[p], h * sin);
        // phi_p' of a motion (u, theta'), and how it changes with phi_p.
        let wheel = |[u, r]: [f64; 2]| sign * (sin * u + arm * r) / l;
        let wheel_by_phi = |[u, r]: [f64; 2]| sign * (cos * u - h_sin * r) / l;

        let [u, r] = self.velocities(node, s);
        let accelerate =
            |i: usize| dy[0] * node.null[i] + s * node.null_rate[i] + node.particular_rate[i];
        let (du, dr) = (accelerate(0), accelerate(1));
        let (n_p, n_p_by_phi) = (wheel(node.null), wheel_by_phi(node.null));
        let (w, w_by_phi) = (wheel([u, r]), wheel_by_phi([u, r]));
        let w_by_phi_phi = sign * (-sin * u - h * cos * r) / l;
        let dw = w_by_phi * w + wheel([du, dr]);
        let dw_by_s = n_p_by_phi * w + w_by_phi * n_p + wheel(node.null_rate);
        let dw_by_phi = w_by_phi_phi * w + w_by_phi * w_by_phi + wheel_by_phi([du, dr]);

        let (mut velocity, mut acceleration) = ([u, 0.0, r, 0.0, 0.0], [du, 0.0, dr, 0.0, 0.0]);
        velocity[3 + p] = w;
        velocity[4 - p] = node.shape.rate_rad_s[1 - p];
        acceleration[3 + p] = dw;
        acceleration[4 - p] = node.shape.acceleration_rad_s2[1 - p];
        let mut phi_rad = node.shape.phi_rad;
        phi_rad[p] = phi;
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

    fn moment(&self, node: &ConstrainedNode, y: &[f64; 2]) -> Moment {
        let (p, robot) = (self.passive, &self.driven.robot);
        let [u, r] = self.velocities(node, y[0]);
        let (sin, cos) = y[1].sin_cos();
        let arm = robot.l_m + robot.h_m * cos;
        let mut phi_rad = node.shape.phi_rad;
        phi_rad[p] = y[1];
        let mut velocity = [u, 0.0, r, 0.0, 0.0];
        velocity[3 + p] = joint_sign(p) * (sin * u + arm * r) / robot.l_m;
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
