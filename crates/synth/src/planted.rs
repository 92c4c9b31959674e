//! What is planted, and the motion that follows from it.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, LogNormal};
use trilink_mechanics::{MotionError, Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Dry, Friction as _, Gait, Parameter, Quantity, Robot};

/// The paper's fitted skid coefficients (Tables I and II) by campaign, kg/s.
const FITTED_SKID_KG_S: [(&str, [f64; 3]); 3] = [
    ("kinematic-skewed", [74.5, 91.0, 95.0]),
    ("kinematic-symmetric", [104.0, 34.0, 45.0]),
    ("semi-passive-symmetric", [420.0, 200.0, 70.0]),
];
/// Planted coefficients differ from the paper's by at most this part.
const SPREAD: f64 = 0.1;
/// The servos' amplitudes differ from the command by this part, one joint's upwards and the
/// other's downwards, so that the gait's area is about the commanded one.
const AMPLITUDE_ERROR: std::ops::Range<f64> = 0.015..0.03;
/// The servos' offsets differ from the command by at most this, rad.
const OFFSET_ERROR_RAD: f64 = 0.015;
/// Steady cycles in a trial.
const STEADY_CYCLES: usize = 9;
/// What is left of the transient when the steady cycles begin.
const TRANSIENT_LEFT: f64 = 3e-4;
/// A trial has at least this many cycles of transient.
const LEAST_TRANSIENT_CYCLES: usize = 2;

/// The robot with planted skid coefficients and the gait that its servos reach.
pub(super) fn planted(
    campaign: &str,
    robot: &Robot,
    mut gait: Gait,
    random: &mut ChaCha8Rng,
) -> (Robot, Gait) {
    let fitted = FITTED_SKID_KG_S.iter().find(|(name, _)| *name == campaign);
    let expected = fitted.map_or(robot.skid_kg_s, |(_, skid_kg_s)| *skid_kg_s);
    let skid_kg_s = expected.map(|c| c * part(random));
    let mut sign = if random.random::<bool>() { 1.0 } else { -1.0 };
    for joint in gait.joints.iter_mut().flatten() {
        joint.amplitude_rad *= 1.0 + sign * random.random_range(AMPLITUDE_ERROR);
        joint.offset_rad += random.random_range(-OFFSET_ERROR_RAD..OFFSET_ERROR_RAD);
        sign = -sign;
    }
    (Robot { skid_kg_s, ..robot.clone() }, gait)
}

/// The robot with coefficients of its own: what resists skidding, dry and viscous.
pub(super) fn floor(mut robot: Robot, random: &mut ChaCha8Rng) -> Robot {
    let parts = robot.skid_kg_s.map(|_| [(); 2].map(|()| part(random)));
    for (of, wheel) in resistances_to_skidding() {
        let [viscous, dry] = parts[wheel];
        let part = if of.quantity() == Quantity::Skid { viscous } else { dry };
        let value = part * of.of(&robot);
        of.set(&mut robot, value);
    }
    robot
}

/// What resists skidding, with the wheels that it is of.
pub(super) fn resistances_to_skidding() -> impl Iterator<Item = (Parameter, usize)> {
    let resists = |of: &&Parameter| of.quantity().definition().is_resistance;
    Dry::SKID.iter().filter(resists).filter_map(|of| Some((*of, of.wheel_or_link()?)))
}

/// By how much a planted coefficient differs from the expected one.
fn part(random: &mut ChaCha8Rng) -> f64 {
    random.random_range(1.0 - SPREAD..1.0 + SPREAD)
}

/// The least number of frames of a trial.
pub(super) fn least_frames(omega_rad_s: f64, rate_hz: f64) -> f64 {
    let cycles = (LEAST_TRANSIENT_CYCLES + STEADY_CYCLES) as f64 + 0.5;
    cycles * std::f64::consts::TAU / omega_rad_s * rate_hz
}

/// The motion from rest until [`STEADY_CYCLES`] are over: `(x, y, theta, phi1, phi2)` of every
/// frame, m and rad, and the metrics of the steady motion that is reached; there may be others.
/// Friction varies from cycle to cycle by a relative standard deviation; the metrics are those of its
/// mean.
pub(super) fn from_rest(
    problem: &Problem,
    variation: f64,
    random: &ChaCha8Rng,
    rate_hz: f64,
) -> Result<(Vec<[f64; 5]>, GaitMetrics), MotionError> {
    let steady = Solver::default().settle(problem, REFERENCE_ACCURACY)?.motion;
    let decay = steady.floquet.unwrap_or(0.0).clamp(1e-12, 0.99);
    let transient = (TRANSIENT_LEFT.ln() / decay.ln()).ceil() as usize;
    // Half a cycle more: the recording does not end with a cycle.
    let cycles = (transient.max(LEAST_TRANSIENT_CYCLES) + STEADY_CYCLES) as f64 + 0.5;
    let duration_s = cycles * std::f64::consts::TAU / problem.omega_rad_s;
    let mut random = random.clone();
    let friction = friction(variation, cycles.ceil() as usize, &mut random);
    let coordinates = problem.varied_transient(&friction, duration_s, rate_hz, 1e-8)?;
    Ok((coordinates, steady.metrics))
}

/// Friction of each cycle as a part of its mean; of none where it does not vary.
fn friction(variation: f64, cycles: usize, random: &mut ChaCha8Rng) -> Vec<f64> {
    // Of the logarithm: factors of mean 1 that are above 0.
    let spread = variation.mul_add(variation, 1.0).ln().sqrt();
    match LogNormal::new(-0.5 * spread * spread, spread) {
        Ok(factors) if spread > 0.0 => (0..cycles).map(|_| factors.sample(random)).collect(),
        _ => Vec::new(),
    }
}
