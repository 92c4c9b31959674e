//! The kinematic robot on wheels that cannot skid: quadrature of eq. 3.
//!
//! By Cramer's rule the body velocities of eq. 3 are `N(phi, phi') / det W_b(phi)`. Where the
//! gait crosses `det W_b = 0` they stay bounded only if the numerator vanishes too, which is
//! condition (5), or (6) where `phi1 = phi2`; then the quotient has a limit. A gait that
//! crosses without meeting it has no motion.

use std::f64::consts::TAU;

use super::element::integrate_poses;
use super::forces::contact_forces;
use super::method::Method;
use super::orbit::Effort;
use super::radau::{RADAU, STAGES, bisect};
use super::reduced::{Derivatives, KinematicState};
use super::trajectory::Sample;
use super::{MotionError, Problem, Result};
use crate::metrics::GaitMetrics;
use crate::robot::{JointCommand, Parameter, Pose, Robot, Trig};

/// Elements of the quadrature at first and at most. Odd numbers keep the elements' ends off
/// the simple fractions of a period at which gaits tend to cross `det W_b = 0`.
const ELEMENTS: usize = 9;
const MOST_ELEMENTS: usize = 4000;
/// Relative change of a cycle on doubling the elements that is accepted.
const ACCURACY: f64 = 1e-11;
/// Samples of a cycle in which crossings are looked for.
const SAMPLES: usize = 720;
/// Part of a typical numerator that may be left at a crossing that meets condition (5).
const CROSSING: f64 = 1e-9;
/// Part of a typical determinant below which the quotient is taken from its neighbourhood.
const NEAR: f64 = 1e-4;

/// For motions that eq. 3 gives.
pub(super) struct Quadrature<'p> {
    pub problem: &'p Problem,
    pub joints: [JointCommand; 2],
}

impl Quadrature<'_> {
    /// Metrics of one cycle. They do not depend on the frequency, but for the speed.
    fn metrics(&self, joints: [JointCommand; 2]) -> Result<(GaitMetrics, Effort)> {
        let robot = &self.problem.robot;
        let eq3 = Eq3::new(robot, joints)?;
        let change = |before: &Pose, after: &Pose| {
            let d_m = after.x_m.hypot(after.y_m);
            let moved = (after.x_m - before.x_m).hypot(after.y_m - before.y_m) / d_m.max(robot.l_m);
            moved.max((after.theta_rad - before.theta_rad).abs())
        };
        let (end, error, elements) = refined(ELEMENTS, |count| eq3.cycle(count), change);
        if error > ACCURACY {
            return Err(MotionError::Unresolved { error });
        }
        let d_m = end.x_m.hypot(end.y_m);
        let metrics = GaitMetrics {
            d_m,
            v_m_s: d_m * self.problem.omega_rad_s / TAU,
            sigma: [0.0; 3],
            alpha1_rad: joints[0].amplitude_rad.abs(),
            dtheta_rad: end.theta_rad,
        };
        Ok((metrics, Effort { elements, ..Effort::default() }))
    }

    /// Derivative of the metrics with respect to a number of a joint's command, by Richardson's
    /// extrapolation of central differences: the quadrature has more digits than it needs.
    ///
    /// # Errors
    /// A slightly different gait has no motion: one that depends on condition (5) being met has no
    /// derivative.
    fn gait_derivative(&self, joint: usize, number: usize) -> Result<GaitMetrics> {
        const STEP_RAD: f64 = 2e-3;
        let difference = |step: f64| -> Result<[f64; 7]> {
            let at = |step: f64| {
                let mut joints = self.joints;
                let JointCommand { offset_rad, amplitude_rad, phase_rad } = &mut joints[joint];
                *[offset_rad, amplitude_rad, phase_rad][number] += step;
                Ok(self.metrics(joints)?.0.to_array())
            };
            let (low, high) = (at(-step)?, at(step)?);
            Ok(std::array::from_fn(|i| (high[i] - low[i]) / (2.0 * step)))
        };
        let (coarse, fine) = (difference(STEP_RAD)?, difference(0.5 * STEP_RAD)?);
        Ok(GaitMetrics::from_array(std::array::from_fn(|i| (4.0 * fine[i] - coarse[i]) / 3.0)))
    }
}

impl Method for Quadrature<'_> {
    fn solve(&mut self, _is_warm: bool, _accuracy: f64) -> Result<(GaitMetrics, Effort)> {
        self.metrics(self.joints)
    }

    fn derivatives(&mut self, wanted: Option<&[Parameter]>) -> Result<Derivatives> {
        let mut derivatives = Derivatives::NONE;
        if wanted.is_none() {
            let (metrics, _) = self.metrics(self.joints)?;
            derivatives.omega.v_m_s = metrics.d_m / TAU;
            for (joint, numbers) in derivatives.gait.iter_mut().enumerate() {
                for (number, derivative) in numbers.iter_mut().enumerate() {
                    let found = self.gait_derivative(joint, number);
                    *derivative = found.unwrap_or(GaitMetrics::MISSING);
                }
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
        let ([work_j, loss_j, _], ..) = refined(2 * ELEMENTS + 1, sums, change);
        Ok([work_j, loss_j])
    }

    fn cycle(&self, samples: usize) -> Result<Vec<Sample>> {
        self.cycles_from_rest(1, samples)
    }

    fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<Sample>> {
        /// Elements of the quadrature between samples reach at most this far.
        const LONGEST_RAD: f64 = TAU / 90.0;
        let problem = self.problem;
        let eq3 = Eq3::new(&problem.robot, self.joints)?;
        let interval = TAU / samples as f64;
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
        Ok((0..=cycles * samples).map(sample).collect())
    }
}

/// A quadrature with ever more elements than `count` until its relative `change` is below [`ACCURACY`], and the
/// last change, which is larger only where [`MOST_ELEMENTS`] are too few; and how many there are.
fn refined<T>(
    mut count: usize,
    quadrature: impl Fn(usize) -> T,
    change: impl Fn(&T, &T) -> f64,
) -> (T, f64, usize) {
    let mut before = quadrature(count);
    loop {
        count = 2 * count + 1;
        let after = quadrature(count);
        let change = change(&before, &after);
        if change <= ACCURACY || count >= MOST_ELEMENTS {
            return (after, change, count);
        }
        before = after;
    }
}

/// Eq. 3 with time measured as phase.
struct Eq3<'a> {
    robot: &'a Robot,
    joints: [JointCommand; 2],
    /// Largest `det W_b` of the cycle, m.
    det_scale_m: f64,
}

impl<'a> Eq3<'a> {
    /// # Errors
    /// The gait crosses `det W_b = 0` without meeting condition (5).
    fn new(robot: &'a Robot, joints: [JointCommand; 2]) -> Result<Self> {
        let mut eq3 = Self { robot, joints, det_scale_m: 0.0 };
        let phase = |i: usize| TAU * i as f64 / SAMPLES as f64;
        let mut scale = 0.0_f64;
        for i in 0..SAMPLES {
            let [(numerators, det), _] = eq3.parts(phase(i));
            scale = scale.max(eq3.size(numerators));
            eq3.det_scale_m = eq3.det_scale_m.max(det.abs());
        }
        if eq3.det_scale_m <= 1e-12 * (robot.h_m + robot.l_m) {
            return Err(MotionError::Singular { phase_rad: 0.0 });
        }
        let det = |phase: f64| eq3.parts(phase)[0].1;
        for i in 0..SAMPLES {
            let (low, high) = (phase(i), phase(i + 1));
            if det(low) == 0.0 || det(low) * det(high) < 0.0 {
                let crossing = if det(low) == 0.0 { low } else { bisect(det, low, high, 60) };
                if eq3.size(eq3.parts(crossing)[0].0) > CROSSING * scale {
                    return Err(MotionError::Singular { phase_rad: crossing });
                }
            }
        }
        Ok(eq3)
    }

    /// Numerators of `u` (m^2) and `theta'` (m) and their denominator `det W_b` (m), and their
    /// derivatives with respect to the phase; `v = 0`.
    ///
    /// From eq. 1, with `a_i = l + h cos phi_i`: `s1 u + a1 r = l phi1'` and
    /// `-s2 u - a2 r = l phi2'`.
    fn parts(&self, phase: f64) -> [([f64; 2], f64); 2] {
        let [[phi1, w1, dw1], [phi2, w2, dw2]] = self.joints.map(|joint| joint.at(phase));
        let Trig { s: [s1, s2], c: [c1, c2] } = Trig::new([phi1, phi2]);
        let (h, l) = (self.robot.h_m, self.robot.l_m);
        let (a1, a2) = (l + h * c1, l + h * c2);
        let (da1, da2) = (-h * s1 * w1, -h * s2 * w2);
        let du = -l * (da2 * w1 + a2 * dw1 + da1 * w2 + a1 * dw2);
        let dr = l * (c2 * w2 * w1 + s2 * dw1 + c1 * w1 * w2 + s1 * dw2);
        let ddet = c2 * w2 * a1 + s2 * da1 - c1 * w1 * a2 - s1 * da2;
        let numerators = [-l * (a2 * w1 + a1 * w2), l * (s2 * w1 + s1 * w2)];
        [(numerators, s2 * a1 - s1 * a2), ([du, dr], ddet)]
    }

    fn size(&self, numerators: [f64; 2]) -> f64 {
        numerators[0].abs().max(numerators[1].abs() * self.robot.l_m)
    }

    /// `u` and `theta'` per radian of phase, and their derivatives with respect to the phase. Near
    /// `det W_b = 0` the quotients, which are smooth, are taken from both sides, to fourth order.
    fn velocities(&self, phase: f64) -> [[f64; 2]; 2] {
        const ASIDE: f64 = 2e-3;
        let quotients = |phase: f64| {
            let [(numerators, det), (slopes, det_slope)] = self.parts(phase);
            let quotients = numerators.map(|numerator| numerator / det);
            let slope = |i: usize| (slopes[i] - quotients[i] * det_slope) / det;
            ([quotients, [0, 1].map(slope)], det)
        };
        let (value, det) = quotients(phase);
        if det.abs() > NEAR * self.det_scale_m {
            return value;
        }
        let [far_left, left, right, far_right] =
            [-2.0, -1.0, 1.0, 2.0].map(|steps| quotients(phase + steps * ASIDE).0);
        [0, 1].map(|k| {
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
        let states = RADAU.nodes.map(|node| {
            let [[u, r], _] = self.velocities(phase + length * node);
            KinematicState { phi_rad: [0.0; 2], velocity: [u, 0.0, r, 0.0, 0.0] }
        });
        let [.., end] = integrate_poses(pose, &states, length);
        end
    }
}
