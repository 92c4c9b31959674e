//! The kinematic robot on wheels that cannot skid: quadrature of eq. 3.
//!
//! By Cramer's rule the body velocities of eq. 3 are `N(phi, phi') / det W_b(phi)`. Where the
//! gait crosses `det W_b = 0` they stay bounded only if the numerator vanishes too, which is
//! condition (5), or (6) where `phi1 = phi2`; then the quotient has a limit. A gait that
//! crosses without meeting it has no motion.

use std::f64::consts::TAU;

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{
    Dry, Friction, Gait, JointCommand, Number, Parameter, Pose, Robot, Trig, dot, roll_rows,
};

use super::element::integrate_path;
use super::forces::contact_forces;
use super::method::Method;
use super::orbit::Effort;
use super::radau::{RADAU, STAGES};
use super::reduced::{
    CommandNode, Derivatives, KinematicState, NUMBERS, PARTS, Variable, friction_power_gradient,
};
use super::trajectory::Sample;
use super::transient::Frames;
use super::{MotionError, Problem, Result};

/// Elements of the quadrature at first and at most. Odd numbers keep the elements' ends off
/// the simple fractions of a period at which gaits tend to cross `det W_b = 0`.
const ELEMENTS: usize = 9;
const MOST_ELEMENTS: usize = 4000;
/// Relative change of a cycle on doubling the elements that is accepted at least and at most. That
/// of twice the elements is 2^9 times as accurate as this says.
const ACCURACY: f64 = 1e-11;
const LEAST_ACCURACY: f64 = 1e-7;
/// Samples of a cycle that tell how large numerators and determinant are.
const SAMPLES: usize = 16;
/// Distance of crossings that are told apart.
const RESOLUTION_RAD: f64 = TAU / 720.0;
/// Part of a typical numerator that may be left at a crossing that meets condition (5).
const CROSSING: f64 = 1e-9;
/// Part of a typical determinant below which the quotient is taken from its neighbourhood.
const NEAR: f64 = 1e-4;

/// For motions that eq. 3 gives.
pub(super) struct Quadrature<'a> {
    pub problem: &'a Problem,
    pub joints: [JointCommand; 2],
    /// Of the last solution.
    pub known: &'a mut Known,
}

/// What is known of a gait once its motion has been found.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Known {
    /// Elements of the quadrature.
    elements: usize,
    /// Largest `det W_b` of the cycle, m.
    det_scale_m: f64,
    /// Whether gaits that differ in a number of a command have a motion, too.
    lasts: [bool; GAIT],
}

impl Method for Quadrature<'_> {
    fn solve(&mut self, _is_warm: bool, accuracy: f64) -> Result<(GaitMetrics, Effort)> {
        let Problem { robot, omega_rad_s, .. } = self.problem;
        let eq3 = Eq3::new(robot, self.joints)?;
        let change = |before: &Pose, after: &Pose| {
            let d_m = after.x_m.hypot(after.y_m);
            let moved = (after.x_m - before.x_m).hypot(after.y_m - before.y_m) / d_m.max(robot.l_m);
            moved.max((after.theta_rad - before.theta_rad).abs())
        };
        let accuracy = accuracy.clamp(ACCURACY, LEAST_ACCURACY);
        let (end, error, elements) = refined(ELEMENTS, accuracy, |count| eq3.cycle(count), change);
        if error > accuracy {
            return Err(MotionError::Unresolved { error });
        }
        *self.known = Known { elements, ..eq3.known };
        let d_m = end.x_m.hypot(end.y_m);
        let metrics = GaitMetrics {
            d_m,
            v_m_s: d_m * omega_rad_s / TAU,
            sigma: [0.0; 3],
            alpha1_rad: self.joints[0].half_range_rad(),
            dtheta_rad: end.theta_rad,
        };
        Ok((metrics, Effort { elements, ..Effort::default() }))
    }

    fn derivatives(&mut self, wanted: Option<&[Parameter]>) -> Result<Derivatives> {
        let mut derivatives = Derivatives::splat(GaitMetrics::NONE);
        if wanted.is_none() {
            let (robot, joints, known) = (&self.problem.robot, self.joints, *self.known);
            let eq3 = Eq3 { robot, joints, known };
            let (end, slopes) = match eq3.has_second() {
                true => eq3.cycle_slopes::<ALL>(known.elements),
                false => eq3.cycle_slopes::<OF_FIRST>(known.elements),
            };
            let of_range = self.joints[0].half_range_slopes();
            let d_m = end.x_m.hypot(end.y_m);
            derivatives.omega.v_m_s = d_m / TAU;
            for (i, [x, y, dtheta_rad]) in slopes.into_iter().enumerate() {
                let variable = variable(i);
                if !self.problem.knows(variable) {
                    continue;
                }
                // A distance of nothing has no gradient.
                let slope_m = if d_m > 0.0 { (end.x_m * x + end.y_m * y) / d_m } else { 0.0 };
                let alpha1_rad = match variable {
                    Variable::Gait(0, number) => of_range[number],
                    Variable::Second(0, part) => of_range[NUMBERS + part],
                    _ => 0.0,
                };
                let derivative = match known.lasts[i] {
                    true => GaitMetrics {
                        d_m: slope_m,
                        v_m_s: slope_m * self.problem.omega_rad_s / TAU,
                        alpha1_rad,
                        dtheta_rad,
                        ..GaitMetrics::NONE
                    },
                    false => GaitMetrics::MISSING,
                };
                derivatives.set(variable, derivative);
            }
        }
        Ok(derivatives)
    }

    fn work_and_loss_j(&self) -> Result<[f64; 2]> {
        let problem = self.problem;
        let eq3 = Eq3::new(&problem.robot, self.joints)?;
        // The two, and the power without its sign.
        let sums = |count: usize| {
            let length = TAU / count as f64;
            let mut sums = [0.0; 3];
            for k in 0..count {
                for (node, weight) in RADAU.nodes.iter().zip(RADAU.integrate[STAGES - 1]) {
                    let (state, acceleration) = eq3.state(problem, length * (k as f64 + node));
                    let forces = contact_forces(problem, &state, &acceleration);
                    let weight = weight * length / problem.omega_rad_s;
                    sums[0] += weight * forces.power_w;
                    sums[1] += weight * forces.loss_w;
                    sums[2] += weight * forces.power_w.abs();
                }
            }
            sums
        };
        let change = |before: &[f64; 3], after: &[f64; 3]| {
            (0..2).map(|i| (after[i] - before[i]).abs()).fold(0.0, f64::max) / after[2]
        };
        let ([work_j, loss_j, _], ..) = refined(2 * ELEMENTS + 1, ACCURACY, sums, change);
        Ok([work_j, loss_j])
    }

    fn loss_j(&mut self) -> Result<f64> {
        Ok(self.work_and_loss_j()?[1])
    }

    fn distance_and_work_derivatives(&mut self) -> Result<[Derivatives<f64>; 2]> {
        let of_metrics = self.derivatives(None)?;
        let mut distance = Derivatives::splat(0.0);
        distance.gait = of_metrics.gait.map(|of| of.map(|metrics| metrics.d_m));
        distance.second = of_metrics.second.map(|of| of.map(|metrics| metrics.d_m));
        let work = match self.problem.gait.has_second() {
            false => self.work_derivatives::<OF_FIRST>()?,
            true => self.work_derivatives::<ALL>()?,
        };
        Ok([distance, work])
    }

    fn cycle(&self, samples: usize) -> Result<Vec<Sample>> {
        self.cycles_from_rest(1, samples)
    }

    fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<Sample>> {
        self.samples(TAU / samples as f64, 1 + cycles * samples)
    }

    /// Such a motion knows no friction.
    fn transient(&self, frames: &Frames, _: f64) -> Result<Vec<[f64; 5]>> {
        let samples = self.samples(self.problem.omega_rad_s / frames.rate_hz, frames.count())?;
        let coordinates = |Sample { pose, phi_rad: [phi1, phi2], .. }: &Sample| {
            [pose.x_m, pose.y_m, pose.theta_rad, *phi1, *phi2]
        };
        Ok(samples.iter().map(coordinates).collect())
    }
}

impl Quadrature<'_> {
    /// Derivatives of the work over a cycle, J, by the first `K` of [`ALL`].
    fn work_derivatives<const K: usize>(&self) -> Result<Derivatives<f64>> {
        let (problem, joints, known) = (self.problem, self.joints, *self.known);
        let Problem { robot, gait, omega_rad_s, .. } = problem;
        let eq3 = Eq3 { robot, joints, known };
        let mut derivatives = Derivatives::splat(0.0);
        let mut by_gait = [0.0; GAIT];
        let length = TAU / known.elements as f64;
        for k in 0..known.elements {
            for (node, weight) in RADAU.nodes.iter().zip(RADAU.integrate[STAGES - 1]) {
                let (phase, weight) = (length * (k as f64 + node), weight * length / omega_rad_s);
                let (state, _) = eq3.state(problem, phase);
                let trig = Trig::new(state.phi_rad);
                let power = friction_power_gradient::<f64, Dry>(robot, None, &state, &trig);
                let by_command = CommandNode::new(problem, phase).gait_gradient(&power, problem);
                let velocities = eq3.velocities::<K>(phase);
                for (i, [u, turning]) in velocities[2..].iter().enumerate() {
                    let own = match variable(i) {
                        Variable::Gait(joint, number) => by_command[joint][number],
                        Variable::Second(joint, part) => by_command[joint][NUMBERS + part],
                        Variable::Parameter(_) => 0.0,
                    };
                    let by_body = power.velocity[0] * u + power.velocity[2] * turning;
                    by_gait[i] += weight * (omega_rad_s * by_body + own);
                }
                for (wheel, row) in roll_rows(robot, &trig).iter().enumerate() {
                    let along = dot(row, &state.velocity);
                    Dry::roll_slopes(robot, wheel, along, |column, slope| {
                        let parameter = Dry::ROLL[column];
                        if problem.laws.know(parameter, gait) {
                            derivatives.parameters[parameter] += weight * along * slope;
                        }
                    });
                }
            }
        }
        for (i, by_number) in by_gait.into_iter().enumerate().take(K - 2) {
            if problem.knows(variable(i)) {
                derivatives.set(variable(i), if known.lasts[i] { by_number } else { f64::NAN });
            }
        }
        let [_, loss_j] = self.work_and_loss_j()?;
        Ok(derivatives.completed(problem, 2.0 * loss_j))
    }

    /// So many samples at this interval of phase, the first at phase 0.
    fn samples(&self, interval: f64, count: usize) -> Result<Vec<Sample>> {
        /// Elements of the quadrature between samples reach at most this far.
        const LONGEST_RAD: f64 = TAU / 90.0;
        let problem = self.problem;
        let eq3 = Eq3::new(&problem.robot, self.joints)?;
        let elements = (interval / LONGEST_RAD).ceil();
        let length = interval / elements;
        let mut pose = Pose::default();
        let sample = |i: usize| {
            let phase = interval * i as f64;
            let (state, acceleration) = eq3.state(problem, phase);
            let time_s = phase / problem.omega_rad_s;
            let sample = Sample::new(problem, time_s, pose, &state, &acceleration);
            for k in 0..elements as usize {
                pose = eq3.advance(pose, phase + length * k as f64, length);
            }
            sample
        };
        Ok((0..count).map(sample).collect())
    }
}

/// A quadrature with ever more elements than `count` until its relative `change` is below the
/// `accuracy`, and the last change, which is larger only where [`MOST_ELEMENTS`] are too few; and
/// how many there are.
fn refined<T>(
    mut count: usize,
    accuracy: f64,
    quadrature: impl Fn(usize) -> T,
    change: impl Fn(&T, &T) -> f64,
) -> (T, f64, usize) {
    let mut before = quadrature(count);
    loop {
        count = 2 * count + 1;
        let after = quadrature(count);
        let change = change(&before, &after);
        if change <= accuracy || count >= MOST_ELEMENTS {
            return (after, change, count);
        }
        before = after;
    }
}

/// The numbers of both joints' commands, one after the other, then the parts of their second
/// harmonics.
const GAIT: usize = 2 * (NUMBERS + PARTS);

/// A value, its derivative with respect to the phase, and those with respect to [`GAIT`].
const ALL: usize = 2 + GAIT;

/// Those of them that a gait without second harmonics has.
const OF_FIRST: usize = 2 + 2 * NUMBERS;

/// No command's rate per omega is more.
fn fastest_rad(of: &JointCommand) -> f64 {
    of.amplitude_rad.abs() + 2.0 * of.second().amplitude_rad()
}

/// What a number of [`GAIT`] is.
fn variable(number: usize) -> Variable {
    match number.checked_sub(2 * NUMBERS) {
        None => Variable::Gait(number / NUMBERS, number % NUMBERS),
        Some(part) => Variable::Second(part / PARTS, part % PARTS),
    }
}

/// Eq. 3 with time measured as phase.
struct Eq3<'a> {
    robot: &'a Robot,
    joints: [JointCommand; 2],
    known: Known,
}

impl<'a> Eq3<'a> {
    /// # Errors
    /// The gait crosses `det W_b = 0` without meeting condition (5).
    fn new(robot: &'a Robot, joints: [JointCommand; 2]) -> Result<Self> {
        let known = Known { lasts: [true; GAIT], ..Known::default() };
        let mut eq3 = Self { robot, joints, known };
        let mut scale = 0.0_f64;
        for i in 0..SAMPLES {
            let [parts] = eq3.parts(TAU * i as f64 / SAMPLES as f64);
            scale = scale.max(eq3.size(&parts));
            eq3.known.det_scale_m = eq3.known.det_scale_m.max(parts[2].abs());
        }
        if eq3.known.det_scale_m <= 1e-12 * (robot.h_m + robot.l_m) {
            return Err(MotionError::Singular { phase_rad: 0.0 });
        }
        // No farther than this can it change its sign.
        let fastest_m = (robot.h_m + robot.l_m) * joints.iter().map(fastest_rad).sum::<f64>();
        let (mut phase, mut before) = (0.0, eq3.det(0.0));
        let mut lasts = eq3.known.lasts;
        while phase < TAU {
            let next = phase + (before.abs() / fastest_m).max(RESOLUTION_RAD);
            let after = eq3.det(next);
            if before == 0.0 || before * after < 0.0 {
                let crossing = eq3.crossing(phase, next, after > 0.0);
                let [parts, slopes, gait @ ..] = eq3.parts::<ALL>(crossing);
                if eq3.size(&parts) > CROSSING * scale {
                    return Err(MotionError::Singular { phase_rad: crossing });
                }
                // The crossing moves with the gait; the numerators have to stay zero there.
                for (lasts, by_number) in lasts.iter_mut().zip(gait) {
                    let moved = by_number[2] / slopes[2];
                    let left = std::array::from_fn(|i| by_number[i] - moved * slopes[i]);
                    *lasts &= eq3.size(&left) <= CROSSING * scale;
                }
            }
            (phase, before) = (next, after);
        }
        Ok(Self { known: Known { lasts, ..eq3.known }, ..eq3 })
    }

    /// Where `det W_b` is zero between two phases, at the second of which it is positive or not:
    /// Newton's method, halved where it leaves them.
    fn crossing(&self, mut low: f64, mut high: f64, rises: bool) -> f64 {
        const MOST_STEPS: usize = 60;
        let mut phase = low;
        for _ in 0..MOST_STEPS {
            let [[.., det], [.., slope]] = self.parts(phase);
            if det == 0.0 {
                break;
            }
            if (det > 0.0) == rises {
                high = phase;
            } else {
                low = phase;
            }
            let next = phase - det / slope;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            if (next - phase).abs() <= f64::EPSILON * high {
                break;
            }
            phase = next;
        }
        phase
    }

    fn has_second(&self) -> bool {
        self.joints.iter().any(|joint| joint.second.is_some())
    }

    /// Numerators of `u` (m^2) and `theta'` (m) and their denominator `det W_b` (m), the first `K`
    /// of [`ALL`]; `v = 0`.
    ///
    /// From eq. 1, with `a_i = l + h cos phi_i`: `s1 u + a1 r = l phi1'` and
    /// `-s2 u - a2 r = l phi2'`.
    #[inline(always)]
    fn parts<const K: usize>(&self, phase: f64) -> [[f64; 3]; K] {
        let [joint1, joint2] = &self.joints;
        let [wave1, wave2] =
            f64::both_sin_cos([phase + joint1.phase_rad, phase + joint2.phase_rad]);
        // Derivatives of each joint's angle and rate with respect to the numbers of its command.
        let change = |&JointCommand { amplitude_rad, .. }: &JointCommand,
                      (sin, cos): (f64, f64)| {
            [[1.0, 0.0], [cos, -sin], [-amplitude_rad * sin, -amplitude_rad * cos]]
        };
        let changes: [[[f64; 2]; NUMBERS]; 2] = [change(joint1, wave1), change(joint2, wave2)];
        let mut phi1 = joint1.offset_rad + joint1.amplitude_rad * wave1.1;
        let mut phi2 = joint2.offset_rad + joint2.amplitude_rad * wave2.1;
        // Rate and acceleration of each joint.
        let [[.., mut front], [.., mut rear]] = changes;
        let mut of_second = [[0.0; 3]; PARTS];
        if self.has_second() {
            let (sin, cos) = (2.0 * phase).sin_cos();
            of_second = Gait::second_waves([sin, cos], 1.0);
            let [[added1, rate1, turn1], [added2, rate2, turn2]] = self.joints.map(|joint| {
                let of = joint.second();
                let [in_phase, quadrature] = of_second;
                [0, 1, 2].map(|k| of.in_phase_rad * in_phase[k] + of.quadrature_rad * quadrature[k])
            });
            (phi1, front) = (phi1 + added1, [front[0] + rate1, front[1] + turn1]);
            (phi2, rear) = (phi2 + added2, [rear[0] + rate2, rear[1] + turn2]);
        }
        let (w1, w2) = (front[0], rear[0]);
        let Trig { s: [s1, s2], c: [c1, c2] } = Trig::new([phi1, phi2]);
        let (h, l) = (self.robot.h_m, self.robot.l_m);
        let (a1, a2) = (l + h * c1, l + h * c2);
        let value = [-l * (a2 * w1 + a1 * w2), l * (s2 * w1 + s1 * w2), s2 * a1 - s1 * a2];
        let by_angle = [
            [l * h * s1 * w2, l * c1 * w2, -h * s1 * s2 - c1 * a2],
            [l * h * s2 * w1, l * c2 * w1, h * s1 * s2 + c2 * a1],
        ];
        let by_rate = [[-l * a2, l * s2, 0.0], [-l * a1, l * s1, 0.0]];
        let along = |joint: usize, [angle, rate]: [f64; 2]| -> [f64; 3] {
            std::array::from_fn(|i| by_angle[joint][i] * angle + by_rate[joint][i] * rate)
        };
        let mut all = [value; K];
        for (k, part) in all.iter_mut().enumerate().skip(1) {
            *part = match k {
                1 => {
                    let (front, rear) = (along(0, front), along(1, rear));
                    std::array::from_fn(|i| front[i] + rear[i])
                }
                2..OF_FIRST => {
                    along((k - 2) / NUMBERS, changes[(k - 2) / NUMBERS][(k - 2) % NUMBERS])
                }
                _ => {
                    let [angle, rate, _] = of_second[(k - OF_FIRST) % PARTS];
                    along((k - OF_FIRST) / PARTS, [angle, rate])
                }
            };
        }
        all
    }

    #[inline(always)]
    fn det(&self, phase: f64) -> f64 {
        self.parts::<1>(phase)[0][2]
    }

    fn size(&self, numerators: &[f64; 3]) -> f64 {
        numerators[0].abs().max(numerators[1].abs() * self.robot.l_m)
    }

    /// `u` and `theta'` per radian of phase, the first `K` of [`ALL`]. Near `det W_b = 0` the
    /// quotients, which are smooth, are taken from both sides, to fourth order.
    #[inline(always)]
    fn velocities<const K: usize>(&self, phase: f64) -> [[f64; 2]; K] {
        const ASIDE: f64 = 2e-3;
        let quotients = |phase: f64| -> ([[f64; 2]; K], f64) {
            let parts = self.parts::<K>(phase);
            let det = parts[0][2];
            let value: [f64; 2] = std::array::from_fn(|i| parts[0][i] / det);
            let derivative =
                |part: [f64; 3]| std::array::from_fn(|i| (part[i] - value[i] * part[2]) / det);
            (std::array::from_fn(|k| if k == 0 { value } else { derivative(parts[k]) }), det)
        };
        let (value, det) = quotients(phase);
        if det.abs() > NEAR * self.known.det_scale_m {
            return value;
        }
        let [far_left, left, right, far_right] =
            [-2.0, -1.0, 1.0, 2.0].map(|steps| quotients(phase + steps * ASIDE).0);
        std::array::from_fn(|k| {
            [0, 1].map(|i| {
                (4.0 * (left[k][i] + right[k][i]) - far_left[k][i] - far_right[k][i]) / 6.0
            })
        })
    }

    /// Angles and velocities at a phase, and the time derivatives of the velocities.
    fn state(&self, problem: &Problem, phase: f64) -> (KinematicState, [f64; 5]) {
        let omega = problem.omega_rad_s;
        let shape = problem.gait.at(phase, omega);
        let [[u, r], [du, dr]] = self.velocities(phase);
        let ([u, r], [du, dr]) =
            ([u, r].map(|rate| rate * omega), [du, dr].map(|rate| rate * omega * omega));
        let ([w1, w2], [a1, a2]) = (shape.rate_rad_s, shape.acceleration_rad_s2);
        let state = KinematicState { phi_rad: shape.phi_rad, velocity: [u, 0.0, r, w1, w2] };
        (state, [du, 0.0, dr, a1, a2])
    }

    /// The pose after one cycle that starts at phase 0.
    fn cycle(&self, count: usize) -> Pose {
        let length = TAU / count as f64;
        (0..count).fold(Pose::default(), |pose, k| self.advance(pose, length * k as f64, length))
    }

    /// The pose after an element that starts at a phase.
    fn advance(&self, pose: Pose, phase: f64, length: f64) -> Pose {
        let mut velocities = [[0.0; 2]; STAGES];
        for (velocity, node) in velocities.iter_mut().zip(RADAU.nodes) {
            [*velocity] = self.velocities(phase + length * node);
        }
        let ([.., end], _) = path(pose, &velocities, length);
        end
    }

    /// The pose after one cycle and its derivatives (x, y, theta) with respect to the first `K - 2` of
    /// [`GAIT`]; the others are left zero.
    fn cycle_slopes<const K: usize>(&self, count: usize) -> (Pose, [[f64; 3]; GAIT]) {
        let (length, integrate) = (TAU / count as f64, &RADAU.integrate);
        let (mut pose, mut slopes) = (Pose::default(), [[0.0; 3]; GAIT]);
        for k in 0..count {
            let velocities =
                RADAU.nodes.map(|node| self.velocities::<K>(length * (k as f64 + node)));
            let values = velocities.map(|of| of[0]);
            let (poses, directions) = path(pose, &values, length);
            pose = poses[STAGES - 1];
            for (i, [x, y, theta]) in slopes.iter_mut().enumerate().take(K - 2) {
                let turned: [f64; STAGES] = std::array::from_fn(|j| {
                    let sum = (0..STAGES).map(|l| integrate[j][l] * velocities[l][2 + i][1]);
                    *theta + length * sum.sum::<f64>()
                });
                for j in 0..STAGES {
                    let weight = length * integrate[STAGES - 1][j];
                    let (along, across) = (velocities[j][2 + i][0], values[j][0] * turned[j]);
                    let (sin, cos) = directions[j];
                    *x += weight * (cos * along - sin * across);
                    *y += weight * (sin * along + cos * across);
                }
                *theta = turned[STAGES - 1];
            }
        }
        (pose, slopes)
    }
}

/// Poses at the stages of an element with these velocities `(u, theta')` there, and sine and cosine
/// of their headings.
fn path(
    from: Pose,
    velocities: &[[f64; 2]; STAGES],
    length: f64,
) -> ([Pose; STAGES], [(f64, f64); STAGES]) {
    let state =
        |[u, r]: [f64; 2]| KinematicState { phi_rad: [0.0; 2], velocity: [u, 0.0, r, 0.0, 0.0] };
    integrate_path(from, &velocities.map(state), length)
}
