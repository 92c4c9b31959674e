//! Motion of the kinematic robot on no-skid wheels: quadrature of eq. 3.
//!
//! By Cramer's rule the body velocities of eq. 3 are `N(phi, phi') / det W_b(phi)`. Where the gait crosses
//! `det W_b = 0` they stay bounded only if the numerator vanishes too, which is condition (5), or (6) where
//! `phi1 = phi2`; the quotient then has a limit. For a gait that crosses it without meeting the condition, no
//! motion exists.

use std::f64::consts::TAU;
use std::marker::PhantomData;

use trilink_robot::metrics::{GaitMetrics, padded};
use trilink_robot::{
    Friction, Gait, JointCommand, Number, Parameter, Pose, Robot, Trig, dot, roll_rows,
};

use super::element::integrate_path;
use super::forces::contact_forces;
use super::method::Method;
use super::orbit::Effort;
use super::radau::{RADAU, STAGES};
use super::reduced::{
    COMMAND_SIZE, CommandNode, Derivatives, HARMONIC_SIZE, KinematicState, Variable,
    friction_power_gradient, joints_rad,
};
use super::trajectory::Sample;
use super::transient::{Frames, Posture};
use super::{MotionError, Problem, Result};

/// Initial number of quadrature elements. Odd numbers keep the ends of the elements away from the simple
/// fractions of a period at which gaits tend to cross singular shapes (`det W_b = 0`).
const INITIAL_ELEMENTS: usize = 9;
/// Maximum number of elements of the quadrature.
const MAX_ELEMENTS: usize = 4000;
/// Smallest tolerance for the relative change in a quadrature's result when the number of elements is
/// doubled. The error with the doubled number is 2^9 times smaller than the change.
const MIN_TOLERANCE: f64 = 1e-11;
/// Largest tolerance for the relative change in a quadrature's result when the number of elements is doubled.
const MAX_TOLERANCE: f64 = 1e-7;
/// Number of samples per cycle from which the magnitudes of the numerators and the denominator `det W_b` of
/// the body velocities (eq. 3 of the paper) are estimated.
const SAMPLES: usize = 16;
/// Resolution in phase at which crossings of singular shapes (`det W_b = 0`) are searched for.
const RESOLUTION_RAD: f64 = TAU / 720.0;
/// Maximum relative size of the numerators of the body velocities at a singular shape (`det W_b = 0`) for the
/// velocities to count as bounded there (condition (5) of the paper).
const CROSSING: f64 = 1e-9;
/// Relative size of the denominator `det W_b` of the body velocities (eq. 3 of the paper) below which the
/// velocities are interpolated from neighbouring phases.
const NEAR_SINGULAR: f64 = 1e-4;

/// Solution method, by quadrature, for motions that the no-skid constraints alone determine (eq. 3 of the
/// paper).
pub(super) struct Quadrature<'a, F> {
    problem: &'a Problem,
    joints: [JointCommand; 2],
    /// Analysis of the gait of the last solution.
    analysis: &'a mut GaitAnalysis,
    friction: PhantomData<F>,
}

/// Properties of a gait that are determined while its motion is solved.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct GaitAnalysis {
    /// Number of elements of the quadrature.
    elements: usize,
    /// Largest magnitude over the cycle of `det W_b`, the denominator of the body velocities (eq. 3 of the
    /// paper), m.
    det_scale_m: f64,
    /// For each variable of the commands, whether a motion still exists if that variable changes slightly.
    persists: [bool; GAIT_VARIABLES],
}

impl<F: Friction> Method for Quadrature<'_, F> {
    fn solve(&mut self, _is_warm: bool, accuracy: f64) -> Result<(GaitMetrics, Effort)> {
        let Problem { robot, omega_rad_s, .. } = self.problem;
        let eq3 = Eq3::new(robot, self.joints)?;
        let tolerance = accuracy.clamp(MIN_TOLERANCE, MAX_TOLERANCE);
        let (end, error, elements) = refine(
            INITIAL_ELEMENTS,
            tolerance,
            |count| eq3.cycle(count),
            |before, after| {
                let d_m = after.x_m.hypot(after.y_m);
                let moved = (after.x_m - before.x_m).hypot(after.y_m - before.y_m)
                    / d_m.max(robot.skid_length_m());
                moved.max((after.theta_rad - before.theta_rad).abs())
            },
        );
        if error > tolerance {
            return Err(MotionError::Unresolved { error });
        }
        *self.analysis = GaitAnalysis { elements, ..eq3.analysis };
        let d_m = end.x_m.hypot(end.y_m);
        let metrics = GaitMetrics {
            d_m,
            v_m_s: d_m * omega_rad_s / TAU,
            sigma: padded(&[0.0; 3]),
            alpha_rad: padded(&[self.joints[0].half_range_rad()]),
            dtheta_rad: end.theta_rad,
        };
        Ok((metrics, Effort { elements, ..Effort::default() }))
    }

    fn derivatives(&mut self, wanted: Option<&[Parameter]>) -> Result<Derivatives> {
        let mut derivatives = Derivatives::splat(GaitMetrics::NONE);
        if wanted.is_none() {
            let robot = &self.problem.robot;
            let joints = self.joints;
            let analysis = *self.analysis;
            let eq3 = Eq3 { robot, joints, analysis };
            let (end, slopes) = if eq3.has_second() {
                eq3.cycle_slopes::<ALL_COLUMNS>(analysis.elements)
            } else {
                eq3.cycle_slopes::<FIRST_HARMONIC_COLUMNS>(analysis.elements)
            };
            let half_range_slopes = self.joints[0].half_range_slopes();
            let d_m = end.x_m.hypot(end.y_m);
            derivatives.omega.v_m_s = d_m / TAU;
            for (i, [x, y, dtheta_rad]) in slopes.into_iter().enumerate() {
                let variable = variable(i);
                if !self.problem.depends_on(variable) {
                    continue;
                }
                // The gradient of a zero distance is undefined and taken as zero.
                let slope_m = if d_m > 0.0 { (end.x_m * x + end.y_m * y) / d_m } else { 0.0 };
                let alpha1_rad = match variable {
                    Variable::Gait(0, number) => half_range_slopes[number],
                    Variable::Second(0, part) => half_range_slopes[COMMAND_SIZE + part],
                    _ => 0.0,
                };
                let derivative = if analysis.persists[i] {
                    GaitMetrics {
                        d_m: slope_m,
                        v_m_s: slope_m * self.problem.omega_rad_s / TAU,
                        alpha_rad: padded(&[alpha1_rad]),
                        dtheta_rad,
                        ..GaitMetrics::NONE
                    }
                } else {
                    GaitMetrics::MISSING
                };
                derivatives.set(variable, derivative);
            }
        }
        Ok(derivatives)
    }

    fn work_and_loss_j(&self) -> Result<[f64; 2]> {
        let problem = self.problem;
        let eq3 = Eq3::new(&problem.robot, self.joints)?;
        // Integrals of the power, the dissipation and the absolute power.
        let sums = |count: usize| {
            let length = TAU / count as f64;
            let mut sums = [0.0; 3];
            for k in 0..count {
                for (node, weight) in RADAU.nodes.iter().zip(RADAU.integrate[STAGES - 1]) {
                    let (state, acceleration) = eq3.state(problem, length * (k as f64 + node));
                    let forces = contact_forces::<F>(problem, &state, &acceleration);
                    let weight = weight * length / problem.omega_rad_s;
                    sums[0] += weight * forces.power_w;
                    sums[1] += weight * forces.loss_w;
                    sums[2] += weight * forces.power_w.abs();
                }
            }
            sums
        };
        let ([work_j, loss_j, _], ..) =
            refine(2 * INITIAL_ELEMENTS + 1, MIN_TOLERANCE, sums, |before, after| {
                (0..2).map(|i| (after[i] - before[i]).abs()).fold(0.0, f64::max) / after[2]
            });
        Ok([work_j, loss_j])
    }

    fn loss_j(&mut self) -> Result<f64> {
        Ok(self.work_and_loss_j()?[1])
    }

    fn distance_and_work_derivatives(&mut self) -> Result<[Derivatives<f64>; 2]> {
        let derivatives = self.derivatives(None)?;
        let mut distance = Derivatives::splat(0.0);
        distance.gait = derivatives.gait.map(|slopes| slopes.map(|metrics| metrics.d_m));
        distance.second = derivatives.second.map(|slopes| slopes.map(|metrics| metrics.d_m));
        let work = if self.problem.gait.has_second() {
            self.work_derivatives::<ALL_COLUMNS>()?
        } else {
            self.work_derivatives::<FIRST_HARMONIC_COLUMNS>()?
        };
        Ok([distance, work])
    }

    fn cycle(&self, samples: usize) -> Result<Vec<Sample>> {
        self.cycles_from_rest(1, samples)
    }

    fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<Sample>> {
        self.samples(TAU / samples as f64, 1 + cycles * samples)
    }

    /// Returns the coordinates `(x, y, theta, phi1, phi2)`, m and rad, in every frame. Friction and the tolerance are
    /// ignored, because the no-skid constraints alone determine the motion (eq. 3 of the paper).
    fn transient(&self, frames: &Frames, _: f64) -> Result<Vec<Posture>> {
        let samples = self.samples(self.problem.omega_rad_s / frames.rate_hz, frames.count())?;
        Ok(samples
            .iter()
            .map(|Sample { pose, phi_rad, .. }| (*pose, joints_rad(*phi_rad)))
            .collect())
    }
}

impl<'a, F: Friction> Quadrature<'a, F> {
    pub(super) fn new(
        problem: &'a Problem,
        joints: [JointCommand; 2],
        analysis: &'a mut GaitAnalysis,
    ) -> Self {
        Self { problem, joints, analysis, friction: PhantomData }
    }

    /// Returns the derivatives of the work of the actuators over a cycle, J per unit of each variable. Those with
    /// respect to gait variables beyond the first `K` columns (see [`ALL_COLUMNS`]) stay zero.
    fn work_derivatives<const K: usize>(&self) -> Result<Derivatives<f64>> {
        let problem = self.problem;
        let joints = self.joints;
        let analysis = *self.analysis;
        let Problem { robot, gait, omega_rad_s, .. } = problem;
        let eq3 = Eq3 { robot, joints, analysis };
        let mut derivatives = Derivatives::splat(0.0);
        let mut gait_slopes = [0.0; GAIT_VARIABLES];
        let length = TAU / analysis.elements as f64;
        for k in 0..analysis.elements {
            for (node, weight) in RADAU.nodes.iter().zip(RADAU.integrate[STAGES - 1]) {
                let phase = length * (k as f64 + node);
                let weight = weight * length / omega_rad_s;
                let (state, _) = eq3.state(problem, phase);
                let trig = Trig::new(state.phi_rad);
                let power = friction_power_gradient::<f64, F>(robot, None, &state);
                let command_gradient =
                    CommandNode::new(problem, phase).gait_gradient(&power, problem);
                let velocities = eq3.velocities::<K>(phase);
                for (i, [u, turning]) in velocities[2..].iter().enumerate() {
                    let direct = match variable(i) {
                        Variable::Gait(joint, number) => command_gradient[joint][number],
                        Variable::Second(joint, part) => {
                            command_gradient[joint][COMMAND_SIZE + part]
                        }
                        Variable::Parameter(_) => 0.0,
                    };
                    let body_power = power.velocity[0] * u + power.velocity[2] * turning;
                    gait_slopes[i] += weight * (omega_rad_s * body_power + direct);
                }
                for (wheel, row) in roll_rows(robot, &trig).iter().enumerate() {
                    let along = dot(row, &state.velocity);
                    F::roll_slopes(robot, wheel, along, |column, slope| {
                        let parameter = F::ROLL[column];
                        if problem.laws.is_relevant(parameter, gait) {
                            derivatives.parameters[parameter] += weight * along * slope;
                        }
                    });
                }
            }
        }
        for (i, slope) in gait_slopes.into_iter().enumerate().take(K - 2) {
            if problem.depends_on(variable(i)) {
                derivatives.set(variable(i), if analysis.persists[i] { slope } else { f64::NAN });
            }
        }
        let [_, loss_j] = self.work_and_loss_j()?;
        Ok(derivatives.with_omega_and_sums(problem, 2.0 * loss_j))
    }

    /// Returns `count` samples at regular intervals of phase (rad), the first at phase 0.
    fn samples(&self, interval: f64, count: usize) -> Result<Vec<Sample>> {
        /// Maximum length of the quadrature elements between samples, rad.
        const MAX_LENGTH_RAD: f64 = TAU / 90.0;
        let problem = self.problem;
        let eq3 = Eq3::new(&problem.robot, self.joints)?;
        let elements = (interval / MAX_LENGTH_RAD).ceil();
        let length = interval / elements;
        let mut pose = Pose::default();
        let mut samples = Vec::with_capacity(count);
        for i in 0..count {
            let phase = interval * i as f64;
            let (state, acceleration) = eq3.state(problem, phase);
            let time_s = phase / problem.omega_rad_s;
            samples.push(Sample::new::<F>(problem, time_s, pose, &state, &acceleration));
            for k in 0..elements as usize {
                pose = eq3.advance(pose, phase + length * k as f64, length);
            }
        }
        Ok(samples)
    }
}

/// Repeats a quadrature with doubled numbers of elements, starting from `count`, until the relative `change`
/// in its result is at most `tolerance` or [`MAX_ELEMENTS`] is reached. Returns the result, the last change,
/// and the number of elements.
fn refine<T>(
    mut count: usize,
    tolerance: f64,
    quadrature: impl Fn(usize) -> T,
    change: impl Fn(&T, &T) -> f64,
) -> (T, f64, usize) {
    let mut before = quadrature(count);
    loop {
        count = 2 * count + 1;
        let after = quadrature(count);
        let change = change(&before, &after);
        if change <= tolerance || count >= MAX_ELEMENTS {
            return (after, change, count);
        }
        before = after;
    }
}

/// Number of variables of both joints' commands: first the offset, amplitude and phase of each, then the
/// components of their second harmonics.
const GAIT_VARIABLES: usize = 2 * (COMMAND_SIZE + HARMONIC_SIZE);

/// Number of columns that describe a quantity: its value, its derivative with respect to the phase, and its
/// derivatives with respect to the [`GAIT_VARIABLES`].
const ALL_COLUMNS: usize = 2 + GAIT_VARIABLES;

/// Number of columns (see [`ALL_COLUMNS`]) for a gait without second harmonics.
const FIRST_HARMONIC_COLUMNS: usize = 2 + 2 * COMMAND_SIZE;

/// Returns an upper bound on the derivative of a command with respect to the phase (its rate divided by
/// omega), rad.
fn max_rate_rad(command: &JointCommand) -> f64 {
    command.amplitude_rad.abs() + 2.0 * command.second().amplitude_rad()
}

/// Returns the gait variable with the given index (see [`GAIT_VARIABLES`]).
fn variable(index: usize) -> Variable {
    match index.checked_sub(2 * COMMAND_SIZE) {
        None => Variable::Gait(index / COMMAND_SIZE, index % COMMAND_SIZE),
        Some(part) => Variable::Second(part / HARMONIC_SIZE, part % HARMONIC_SIZE),
    }
}

/// Body velocities of a robot that cannot skid, under one gait (eq. 3 of the paper), with the phase in place
/// of time.
struct Eq3<'a> {
    robot: &'a Robot,
    joints: [JointCommand; 2],
    analysis: GaitAnalysis,
}

impl<'a> Eq3<'a> {
    /// Creates the equations for a gait of both joints, and examines all singular shapes (`det W_b = 0`) that the gait
    /// crosses.
    ///
    /// # Errors
    /// Returns an error if the body velocities are unbounded at a singular shape that the gait crosses (condition (5)
    /// of the paper is not met), or if all shapes of the gait are singular.
    fn new(robot: &'a Robot, joints: [JointCommand; 2]) -> Result<Self> {
        let analysis = GaitAnalysis { persists: [true; GAIT_VARIABLES], ..GaitAnalysis::default() };
        let mut eq3 = Self { robot, joints, analysis };
        let [front_m, rear_m] = robot.reach_m();
        let reach_m = front_m.max(rear_m);
        let mut scale = 0.0_f64;
        for i in 0..SAMPLES {
            let [columns] = eq3.columns(TAU * i as f64 / SAMPLES as f64);
            scale = scale.max(eq3.size(&columns));
            eq3.analysis.det_scale_m = eq3.analysis.det_scale_m.max(columns[2].abs());
        }
        if eq3.analysis.det_scale_m <= 1e-12 * reach_m {
            return Err(MotionError::Singular { phase_rad: 0.0 });
        }
        // The determinant cannot change sign within a step limited by the maximum rate.
        let max_rate_m = reach_m * joints.iter().map(max_rate_rad).sum::<f64>();
        let mut phase = 0.0;
        let mut before = eq3.det(0.0);
        let mut persists = eq3.analysis.persists;
        while phase < TAU {
            let next = phase + (before.abs() / max_rate_m).max(RESOLUTION_RAD);
            let after = eq3.det(next);
            if before == 0.0 || before * after < 0.0 {
                let crossing = eq3.crossing(phase, next, after > 0.0);
                let [columns, slopes, gait @ ..] = eq3.columns::<ALL_COLUMNS>(crossing);
                if eq3.size(&columns) > CROSSING * scale {
                    return Err(MotionError::Singular { phase_rad: crossing });
                }
                // The crossing moves when the gait changes; the numerators must remain zero at the moved
                // crossing.
                for (persists, slopes_of_variable) in persists.iter_mut().zip(gait) {
                    let moved = slopes_of_variable[2] / slopes[2];
                    let left = std::array::from_fn(|i| slopes_of_variable[i] - moved * slopes[i]);
                    *persists &= eq3.size(&left) <= CROSSING * scale;
                }
            }
            phase = next;
            before = after;
        }
        Ok(Self { analysis: GaitAnalysis { persists, ..eq3.analysis }, ..eq3 })
    }

    /// Returns the phase of the singular shape (zero of `det W_b`) between the phases `low` and `high`, by
    /// Newton's method safeguarded by bisection. `rises` states whether `det W_b` increases through zero.
    fn crossing(&self, mut low: f64, mut high: f64, rises: bool) -> f64 {
        const MAX_STEPS: usize = 60;
        let mut phase = low;
        for _ in 0..MAX_STEPS {
            let [[.., det], [.., slope]] = self.columns(phase);
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

    /// Returns the numerators of the forward velocity `u` (m^2) and turning rate `theta'` (m) of link 0, per radian of
    /// phase, and their common denominator `det W_b` (m), for the first `K` columns (see [`ALL_COLUMNS`]). The lateral
    /// velocity of link 0 is zero.
    ///
    /// With `r = theta'`, `s_i = sin phi_i` and `a_i = l + h cos phi_i`, the no-skid constraints (eq. 1 of the paper)
    /// are `s1 u + a1 r = l phi1'` and `-s2 u - a2 r = l phi2'`, where `h` and `l` are the distances from a joint to
    /// the wheels of link 0 and of the side link.
    #[inline(always)]
    fn columns<const K: usize>(&self, phase: f64) -> [[f64; 3]; K] {
        let [joint1, joint2] = &self.joints;
        let [wave1, wave2] =
            f64::both_sin_cos([phase + joint1.phase_rad, phase + joint2.phase_rad]);
        // Derivatives of each joint's angle and rate with respect to its offset, amplitude and phase.
        let changes: [[[f64; 2]; COMMAND_SIZE]; 2] = [(joint1, wave1), (joint2, wave2)].map(
            |(&JointCommand { amplitude_rad, .. }, wave)| {
                let (sin, cos) = wave;
                [[1.0, 0.0], [cos, -sin], [-amplitude_rad * sin, -amplitude_rad * cos]]
            },
        );
        let mut phi1 = joint1.offset_rad + joint1.amplitude_rad * wave1.1;
        let mut phi2 = joint2.offset_rad + joint2.amplitude_rad * wave2.1;
        // Rate and acceleration of each joint.
        let [[.., mut front], [.., mut rear]] = changes;
        let mut second_waves = [[0.0; 3]; HARMONIC_SIZE];
        if self.has_second() {
            let (sin, cos) = (2.0 * phase).sin_cos();
            second_waves = Gait::second_waves([sin, cos], 1.0);
            let [[added1, rate1, turn1], [added2, rate2, turn2]] = self.joints.map(|joint| {
                let second = joint.second();
                let [in_phase, quadrature] = second_waves;
                [0, 1, 2].map(|k| {
                    second.in_phase_rad * in_phase[k] + second.quadrature_rad * quadrature[k]
                })
            });
            phi1 += added1;
            phi2 += added2;
            front = [front[0] + rate1, front[1] + turn1];
            rear = [rear[0] + rate2, rear[1] + turn2];
        }
        let w1 = front[0];
        let w2 = rear[0];
        let Trig { s: [s1, s2], c: [c1, c2] } = Trig::new([phi1, phi2]);
        let [h1, h2] = self.robot.h_m;
        let [l1, l2] = self.robot.l_m;
        let a1 = l1 + h1 * c1;
        let a2 = l2 + h2 * c2;
        let dcolumns_drate = [[-l1 * a2, l1 * s2, 0.0], [-l2 * a1, l2 * s1, 0.0]];
        let [[u1, turn1, _], [u2, turn2, _]] = dcolumns_drate;
        let value = [u1 * w1 + u2 * w2, turn1 * w1 + turn2 * w2, s2 * a1 - s1 * a2];
        let dcolumns_dangle = [
            [l2 * h1 * s1 * w2, l2 * c1 * w2, -h1 * s1 * s2 - c1 * a2],
            [l1 * h2 * s2 * w1, l1 * c2 * w1, h2 * s1 * s2 + c2 * a1],
        ];
        let along = |joint: usize, [angle, rate]: [f64; 2]| -> [f64; 3] {
            std::array::from_fn(|i| {
                dcolumns_dangle[joint][i] * angle + dcolumns_drate[joint][i] * rate
            })
        };
        let mut all = [value; K];
        for (k, part) in all.iter_mut().enumerate().skip(1) {
            *part = match k {
                1 => {
                    let front = along(0, front);
                    let rear = along(1, rear);
                    std::array::from_fn(|i| front[i] + rear[i])
                }
                2..FIRST_HARMONIC_COLUMNS => along(
                    (k - 2) / COMMAND_SIZE,
                    changes[(k - 2) / COMMAND_SIZE][(k - 2) % COMMAND_SIZE],
                ),
                _ => {
                    let [angle, rate, _] =
                        second_waves[(k - FIRST_HARMONIC_COLUMNS) % HARMONIC_SIZE];
                    along((k - FIRST_HARMONIC_COLUMNS) / HARMONIC_SIZE, [angle, rate])
                }
            };
        }
        all
    }

    #[inline(always)]
    fn det(&self, phase: f64) -> f64 {
        self.columns::<1>(phase)[0][2]
    }

    fn size(&self, numerators: &[f64; 3]) -> f64 {
        numerators[0].abs().max(numerators[1].abs() * self.robot.skid_length_m())
    }

    /// Returns the forward velocity `u` and turning rate `theta'` of link 0 per radian of phase, for the first `K`
    /// columns (see [`ALL_COLUMNS`]). Near singular shapes (`det W_b = 0`), these smooth functions of the phase are
    /// interpolated to fourth order from both sides.
    #[inline(always)]
    fn velocities<const K: usize>(&self, phase: f64) -> [[f64; 2]; K] {
        const OFFSET_RAD: f64 = 2e-3;
        let quotients = |phase: f64| -> ([[f64; 2]; K], f64) {
            let columns = self.columns::<K>(phase);
            let det = columns[0][2];
            let value: [f64; 2] = std::array::from_fn(|i| columns[0][i] / det);
            let quotients = std::array::from_fn(|k| {
                if k == 0 {
                    return value;
                }
                std::array::from_fn(|i| (columns[k][i] - value[i] * columns[k][2]) / det)
            });
            (quotients, det)
        };
        let (value, det) = quotients(phase);
        if det.abs() > NEAR_SINGULAR * self.analysis.det_scale_m {
            return value;
        }
        let [far_left, left, right, far_right] =
            [-2.0, -1.0, 1.0, 2.0].map(|steps| quotients(phase + steps * OFFSET_RAD).0);
        std::array::from_fn(|k| {
            [0, 1].map(|i| {
                (4.0 * (left[k][i] + right[k][i]) - far_left[k][i] - far_right[k][i]) / 6.0
            })
        })
    }

    /// Returns the joint angles and velocities at a phase, and the time derivatives of the velocities.
    fn state(&self, problem: &Problem, phase: f64) -> (KinematicState, [f64; 5]) {
        let omega = problem.omega_rad_s;
        let shape = problem.gait.at(phase, omega);
        let [[u, r], [du, dr]] = self.velocities(phase);
        let [u, r] = [u, r].map(|rate| rate * omega);
        let [du, dr] = [du, dr].map(|rate| rate * omega * omega);
        let [w1, w2] = shape.rate_rad_s;
        let [a1, a2] = shape.acceleration_rad_s2;
        let trig = Trig::new(shape.phi_rad);
        let velocity = [u, 0.0, r, w1, w2];
        let state = KinematicState { phi_rad: shape.phi_rad, trig, velocity };
        (state, [du, 0.0, dr, a1, a2])
    }

    /// Returns the pose after one cycle from phase 0, by quadrature over `count` elements.
    fn cycle(&self, count: usize) -> Pose {
        let length = TAU / count as f64;
        (0..count).fold(Pose::default(), |pose, k| self.advance(pose, length * k as f64, length))
    }

    /// Returns the pose after a quadrature element of the given length (rad of phase) that starts at the given pose and
    /// phase.
    fn advance(&self, pose: Pose, phase: f64, length: f64) -> Pose {
        let mut velocities = [[0.0; 2]; STAGES];
        for (velocity, node) in velocities.iter_mut().zip(RADAU.nodes) {
            [*velocity] = self.velocities(phase + length * node);
        }
        let ([.., end], _) = path(pose, &velocities, length);
        end
    }

    /// Returns the pose after one cycle and its derivatives (x, y, theta) with respect to the first `K - 2`
    /// of the [`GAIT_VARIABLES`]; the other derivatives stay zero.
    fn cycle_slopes<const K: usize>(&self, count: usize) -> (Pose, [[f64; 3]; GAIT_VARIABLES]) {
        let length = TAU / count as f64;
        let integrate = &RADAU.integrate;
        let mut pose = Pose::default();
        let mut slopes = [[0.0; 3]; GAIT_VARIABLES];
        for k in 0..count {
            let velocities =
                RADAU.nodes.map(|node| self.velocities::<K>(length * (k as f64 + node)));
            let values = velocities.map(|columns| columns[0]);
            let (poses, directions) = path(pose, &values, length);
            pose = poses[STAGES - 1];
            for (i, [x, y, theta]) in slopes.iter_mut().enumerate().take(K - 2) {
                let turned: [f64; STAGES] = std::array::from_fn(|j| {
                    let sum = (0..STAGES).map(|l| integrate[j][l] * velocities[l][2 + i][1]);
                    *theta + length * sum.sum::<f64>()
                });
                for j in 0..STAGES {
                    let weight = length * integrate[STAGES - 1][j];
                    let along = velocities[j][2 + i][0];
                    let across = values[j][0] * turned[j];
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

/// Returns the poses at the stages of an element, and the sine and cosine of their headings, given the pose at the
/// element's start, the velocities `(u, theta')` per radian of phase at the stages, and the element's length (rad).
fn path(
    from: Pose,
    velocities: &[[f64; 2]; STAGES],
    length: f64,
) -> ([Pose; STAGES], [(f64, f64); STAGES]) {
    integrate_path(from, &velocities.map(|[u, r]| [u, 0.0, r]), length)
}
