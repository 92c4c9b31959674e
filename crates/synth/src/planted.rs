//! Draws true coefficients for the synthetic trials and computes the resulting motions.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, LogNormal};
use trilink_mechanics::{MotionError, Posture, Problem, REFERENCE_ACCURACY};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Gait, JointCommand, Parameter, Quantity, Robot};

/// Skid coefficients fitted in the paper (Tables I and II), by campaign, kg/s.
const FITTED_SKID_KG_S: [(&str, [f64; 3]); 3] = [
    ("kinematic-skewed", [74.5, 91.0, 95.0]),
    ("kinematic-symmetric", [104.0, 34.0, 45.0]),
    ("semi-passive-symmetric", [420.0, 200.0, 70.0]),
];
/// Maximum relative deviation of a true coefficient from its expected value, which is either the value fitted in the
/// paper or the configured value.
const SPREAD: f64 = 0.1;
/// Relative amplitude errors of the servos. They have opposite signs in neighbouring joints, so that the area that the gait
/// encloses in shape space is close to the commanded one.
const AMPLITUDE_ERROR: std::ops::Range<f64> = 0.015..0.03;
/// Maximum offset error of the servos, rad.
const OFFSET_ERROR_RAD: f64 = 0.015;
/// Number of steady-state cycles recorded in each trial.
const STEADY_CYCLES: usize = 9;
/// Relative size of the transient that remains when the steady-state cycles begin.
const TRANSIENT_LEFT: f64 = 3e-4;
/// Minimum number of transient cycles in a trial.
const MIN_TRANSIENT_CYCLES: usize = 2;

/// Draws a campaign's true skid coefficients and servo errors; returns the robot with these coefficients, and the gait
/// with these errors in amplitude and offset.
pub(super) fn planted(
    campaign: &str,
    robot: &Robot,
    mut gait: Gait,
    random: &mut ChaCha8Rng,
) -> (Robot, Gait) {
    let fitted = FITTED_SKID_KG_S.iter().find(|(name, _)| *name == campaign);
    let expected = fitted.map_or(robot.skid_kg_s, |(_, skid_kg_s)| *skid_kg_s);
    let skid_kg_s = expected.map(|c| c * random_factor(random));
    add_servo_errors(gait.joints.iter_mut().flatten(), random);
    (Robot { skid_kg_s, ..robot.clone() }, gait)
}

/// Adds random errors to the amplitudes and offsets of the commands of driven joints.
pub(super) fn add_servo_errors<'j>(
    joints: impl Iterator<Item = &'j mut JointCommand>,
    random: &mut ChaCha8Rng,
) {
    let mut sign = if random.random::<bool>() { 1.0 } else { -1.0 };
    for joint in joints {
        joint.amplitude_rad *= 1.0 + sign * random.random_range(AMPLITUDE_ERROR);
        joint.offset_rad += random.random_range(-OFFSET_ERROR_RAD..OFFSET_ERROR_RAD);
        sign = -sign;
    }
}

/// Varies the viscous and dry skid resistances of a robot at random.
pub(super) fn vary_coefficients(mut robot: Robot, random: &mut ChaCha8Rng) -> Robot {
    let factors = robot.skid_kg_s.map(|_| [(); 2].map(|()| random_factor(random)));
    for (parameter, wheel) in skid_resistances() {
        let [viscous, dry] = factors[wheel];
        let factor = if parameter.quantity() == Quantity::Skid { viscous } else { dry };
        let value = factor * parameter.value_in(&robot);
        parameter.set(&mut robot, value);
    }
    robot
}

/// Iterates over the parameters of skid resistance, each with the index of its wheel.
pub(super) fn skid_resistances() -> impl Iterator<Item = (Parameter, usize)> {
    let quantities = [Quantity::Skid, Quantity::SkidDry, Quantity::SkidStatic, Quantity::SkidPower];
    quantities.into_iter().flat_map(|quantity| quantity.of_each().into_iter().zip(0..))
}

/// Draws the ratio of a true coefficient to its expected value.
pub(super) fn random_factor(random: &mut ChaCha8Rng) -> f64 {
    random.random_range(1.0 - SPREAD..1.0 + SPREAD)
}

/// Returns the minimum number of frames in a trial at a given frequency.
pub(super) fn min_frames(omega_rad_s: f64, rate_hz: f64) -> f64 {
    let cycles = (MIN_TRANSIENT_CYCLES + STEADY_CYCLES) as f64 + 0.5;
    cycles * std::f64::consts::TAU / omega_rad_s * rate_hz
}

/// Simulates the motion from rest through the transient and [`STEADY_CYCLES`] steady-state cycles. Returns the motion in
/// every frame and the metrics of the attractor reached from rest. `variation` is the relative standard deviation of
/// friction from cycle to cycle; the metrics are computed for the mean friction.
///
/// # Errors
/// Returns an error if the model has no periodic solution, or if the motion cannot be integrated.
pub(super) fn from_rest(
    problem: &Problem,
    variation: f64,
    random: &ChaCha8Rng,
    rate_hz: f64,
) -> Result<(Vec<Posture>, GaitMetrics), MotionError> {
    let steady = problem.settle(REFERENCE_ACCURACY)?.motion;
    let cycles = recorded_cycles(steady.floquet);
    let duration_s = cycles * std::f64::consts::TAU / problem.omega_rad_s;
    let mut random = random.clone();
    let friction = friction(variation, cycles.ceil() as usize, &mut random);
    let frames = problem.varied_transient(&friction, duration_s, rate_hz, 1e-8)?;
    Ok((frames, steady.metrics))
}

/// Returns the number of recorded cycles, given the modulus of the largest Floquet multiplier.
fn recorded_cycles(floquet: Option<f64>) -> f64 {
    let decay = floquet.unwrap_or(0.0).clamp(1e-12, 0.99);
    let transient = (TRANSIENT_LEFT.ln() / decay.ln()).ceil() as usize;
    // A recording does not end exactly at the end of a cycle.
    (transient.max(MIN_TRANSIENT_CYCLES) + STEADY_CYCLES) as f64 + 0.5
}

/// Draws the friction of each cycle relative to its mean; empty if `variation` is zero.
fn friction(variation: f64, cycles: usize, random: &mut ChaCha8Rng) -> Vec<f64> {
    // Standard deviation of the logarithm that gives positive factors with mean 1.
    let spread = variation.mul_add(variation, 1.0).ln().sqrt();
    match LogNormal::new(-0.5 * spread * spread, spread) {
        Ok(factors) if spread > 0.0 => (0..cycles).map(|_| factors.sample(random)).collect(),
        _ => Vec::new(),
    }
}
