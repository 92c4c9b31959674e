//! The kinematic robot on wheels that cannot skid: quadrature of eq. 3.
//!
//! By Cramer's rule the body velocities of eq. 3 are `N(phi, phi') / det W_b(phi)`. Where the
//! gait crosses `det W_b = 0` they stay bounded only if the numerator vanishes too, which is
//! condition (5), or (6) where `phi1 = phi2`; then the quotient has a limit. A gait that
//! crosses without meeting it has no motion.

use std::f64::consts::TAU;

use super::MotionError;
use super::forces::actions;
use super::path::{Pose, advance};
use super::radau::{RADAU, STAGES};
use super::reduced::{Driven, Moment};
use super::trajectory::Sample;
use crate::metrics::GaitMetrics;
use crate::robot::{JointCommand, Robot, Trig};

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
const NEAR: f64 = 1e-6;

/// Metrics of one cycle. They do not depend on the frequency, but for the speed.
pub(super) fn solve(
    robot: &Robot,
    joints: [JointCommand; 2],
    omega_rad_s: f64,
) -> Result<GaitMetrics, MotionError> {
    let eq3 = Eq3::new(robot, joints)?;
    let mut count = ELEMENTS;
    let mut before = eq3.cycle(count);
    loop {
        count = 2 * count + 1;
        let after = eq3.cycle(count);
        let d_m = after.x_m.hypot(after.y_m);
        let change = (after.x_m - before.x_m).hypot(after.y_m - before.y_m) / d_m.max(robot.l_m);
        let turn = (after.theta_rad - before.theta_rad).abs();
        if change.max(turn) <= ACCURACY {
            return Ok(GaitMetrics {
                d_m,
                v_m_s: d_m * omega_rad_s / TAU,
                sigma: [0.0; 3],
                alpha1_rad: joints[0].amplitude_rad.abs(),
                dtheta_rad: after.theta_rad,
            });
        }
        if count >= MOST_ELEMENTS {
            return Err(MotionError::Unresolved { missed: change.max(turn) });
        }
        before = after;
    }
}

/// Derivative of the metrics by the amplitude of a joint, by Richardson's extrapolation of
/// central differences: the quadrature has more digits than it needs.
///
/// # Errors
/// A gait with a slightly different amplitude has no motion: one that depends on condition (5)
/// being met has no derivative.
pub(super) fn by_amplitude(
    robot: &Robot,
    joints: [JointCommand; 2],
    omega_rad_s: f64,
    joint: usize,
) -> Result<GaitMetrics, MotionError> {
    const STEP_RAD: f64 = 2e-3;
    let difference = |step: f64| -> Result<[f64; 7], MotionError> {
        let at = |step: f64| {
            let mut changed = joints;
            changed[joint].amplitude_rad += step;
            Ok(solve(robot, changed, omega_rad_s)?.to_array())
        };
        let (low, high) = (at(-step)?, at(step)?);
        Ok(std::array::from_fn(|i| (high[i] - low[i]) / (2.0 * step)))
    };
    let (coarse, fine) = (difference(STEP_RAD)?, difference(0.5 * STEP_RAD)?);
    Ok(GaitMetrics::from_array(std::array::from_fn(|i| (4.0 * fine[i] - coarse[i]) / 3.0)))
}

/// Samples of `cycles` cycles, `count` a cycle and one at the end.
///
/// # Errors
/// As [`solve`].
pub(super) fn samples(
    driven: &Driven,
    joints: [JointCommand; 2],
    cycles: usize,
    count: usize,
) -> Result<Vec<Sample>, MotionError> {
    /// Elements of the quadrature between samples reach at most this far.
    const LONGEST_RAD: f64 = TAU / 90.0;
    let eq3 = Eq3::new(&driven.robot, joints)?;
    let interval = TAU / count as f64;
    let elements = (interval / LONGEST_RAD).ceil();
    let mut pose = Pose::default();
    let mut samples = Vec::with_capacity(cycles * count + 1);
    for i in 0..=cycles * count {
        let phase = interval * i as f64;
        let (moment, acceleration) = eq3.moment(driven, phase);
        let time_s = phase / driven.omega_rad_s;
        samples.push(Sample::new(driven, time_s, pose, &moment, &acceleration));
        let length = interval / elements;
        for k in 0..elements as usize {
            pose = eq3.advance(pose, phase + length * k as f64, length);
        }
    }
    Ok(samples)
}

/// Work of the actuators and what friction takes over a cycle, J.
///
/// # Errors
/// As [`solve`].
pub(super) fn work_and_loss_j(
    driven: &Driven,
    joints: [JointCommand; 2],
) -> Result<[f64; 2], MotionError> {
    const ELEMENTS: usize = 101;
    let eq3 = Eq3::new(&driven.robot, joints)?;
    let length = TAU / ELEMENTS as f64;
    let (mut work, mut loss) = (0.0, 0.0);
    for k in 0..ELEMENTS {
        for (node, weight) in RADAU.nodes.iter().zip(RADAU.integrate[STAGES - 1]) {
            let (moment, acceleration) = eq3.moment(driven, length * (k as f64 + node));
            let actions = actions(driven, &moment, &acceleration);
            let weight = weight * length / driven.omega_rad_s;
            work += weight * actions.power_w;
            loss += weight * actions.loss_w;
        }
    }
    Ok([work, loss])
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
    fn new(robot: &'a Robot, joints: [JointCommand; 2]) -> Result<Self, MotionError> {
        let mut eq3 = Self { robot, joints, det_scale_m: 0.0 };
        let phase = |i: usize| TAU * i as f64 / SAMPLES as f64;
        let mut scale = 0.0_f64;
        for i in 0..SAMPLES {
            let (numerators, det) = eq3.parts(phase(i));
            scale = scale.max(eq3.size(numerators));
            eq3.det_scale_m = eq3.det_scale_m.max(det.abs());
        }
        if eq3.det_scale_m <= 1e-12 * (robot.h_m + robot.l_m) {
            return Err(MotionError::Singular { phase_rad: 0.0 });
        }
        let det = |phase: f64| eq3.parts(phase).1;
        for i in 0..SAMPLES {
            let (low, high) = (phase(i), phase(i + 1));
            if det(low) == 0.0 || det(low) * det(high) < 0.0 {
                let crossing = bisect(det, low, high);
                if eq3.size(eq3.parts(crossing).0) > CROSSING * scale {
                    return Err(MotionError::Singular { phase_rad: crossing });
                }
            }
        }
        Ok(eq3)
    }

    /// Numerators of `u` (m^2) and `theta'` (m) and their denominator `det W_b` (m); `v = 0`.
    ///
    /// From eq. 1, with `a_i = l + h cos phi_i`: `s1 u + a1 r = l phi1'` and
    /// `-s2 u - a2 r = l phi2'`.
    fn parts(&self, phase: f64) -> ([f64; 2], f64) {
        let [[phi1, w1, _], [phi2, w2, _]] = self.joints.map(|joint| joint.at(phase));
        let Trig { s: [s1, s2], c: [c1, c2] } = Trig::new([phi1, phi2]);
        let (h, l) = (self.robot.h_m, self.robot.l_m);
        let (a1, a2) = (l + h * c1, l + h * c2);
        ([-l * (a2 * w1 + a1 * w2), l * (s2 * w1 + s1 * w2)], s2 * a1 - s1 * a2)
    }

    fn size(&self, numerators: [f64; 2]) -> f64 {
        numerators[0].abs().max(numerators[1].abs() * self.robot.l_m)
    }

    /// `u` and `theta'` per radian of phase.
    fn velocities(&self, phase: f64) -> [f64; 2] {
        let (numerators, det) = self.parts(phase);
        if det.abs() > NEAR * self.det_scale_m {
            return numerators.map(|numerator| numerator / det);
        }
        // The quotient is smooth: its value from both sides, to fourth order.
        const ASIDE: f64 = 1e-3;
        let at = |steps: f64| {
            let (numerators, det) = self.parts(phase + steps * ASIDE);
            numerators.map(|numerator| numerator / det)
        };
        let (far_left, left, right, far_right) = (at(-2.0), at(-1.0), at(1.0), at(2.0));
        std::array::from_fn(|i| (4.0 * (left[i] + right[i]) - far_left[i] - far_right[i]) / 6.0)
    }

    /// The pose after one cycle that starts at phase 0.
    fn cycle(&self, count: usize) -> Pose {
        let length = TAU / count as f64;
        (0..count).fold(Pose::default(), |pose, k| self.advance(pose, length * k as f64, length))
    }

    /// The pose after an element that starts at a phase.
    fn advance(&self, pose: Pose, phase: f64, length: f64) -> Pose {
        let moments = RADAU.nodes.map(|node| {
            let [u, r] = self.velocities(phase + length * node);
            Moment { phi_rad: [0.0; 2], velocity: [u, 0.0, r, 0.0, 0.0] }
        });
        let [.., end] = advance(pose, &moments, length);
        end
    }

    /// Angles and velocities at a phase, and the time derivatives of the velocities.
    fn moment(&self, driven: &Driven, phase: f64) -> (Moment, [f64; 5]) {
        /// Central differences of sixth order: their error is that of rounding.
        const STEP: f64 = 0.01;
        const WEIGHTS: [f64; 3] = [45.0 / 60.0, -9.0 / 60.0, 1.0 / 60.0];
        let omega = driven.omega_rad_s;
        let shape = driven.gait.at(phase, omega);
        let [u, r] = self.velocities(phase).map(|rate| rate * omega);
        let ([w1, w2], [a1, a2]) = (shape.rate_rad_s, shape.acceleration_rad_s2);
        let mut by_phase = [0.0; 2];
        for (k, weight) in WEIGHTS.iter().enumerate() {
            let step = STEP * (k + 1) as f64;
            let (after, before) = (self.velocities(phase + step), self.velocities(phase - step));
            (0..2).for_each(|i| by_phase[i] += weight * (after[i] - before[i]) / STEP);
        }
        let [du, dr] = by_phase.map(|slope| slope * omega * omega);
        let moment = Moment { phi_rad: shape.phi_rad, velocity: [u, 0.0, r, w1, w2] };
        (moment, [du, 0.0, dr, a1, a2])
    }
}

/// A zero of `function` between two points of different signs.
fn bisect(function: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    if function(low) == 0.0 {
        return low;
    }
    let rising = function(high) > 0.0;
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if (function(middle) > 0.0) == rising {
            high = middle;
        } else {
            low = middle;
        }
    }
    0.5 * (low + high)
}
