//! Draws true coefficients of chains and computes their motions.

use std::f64::consts::TAU;

use rand_chacha::ChaCha8Rng;
use trilink_mechanics::{ChainProblem, ChainSample, MotionError, REFERENCE_ACCURACY};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Chain, Joint, Pose, WheelFriction, rotated};

use super::planted::{add_servo_errors, random_factor, recorded_cycles};

/// Number of samples per cycle from which the frames of a recording are interpolated. With cubic interpolation the
/// error of the fifth harmonic is 8e-7 of its amplitude.
const SAMPLES: usize = 240;

/// Draws a campaign's true skid coefficients and the errors of the servos; returns the chain with both.
pub(super) fn planted(mut chain: Chain, random: &mut ChaCha8Rng) -> Chain {
    change_friction(&mut chain, |_, friction| friction.skid_kg_s *= random_factor(random));
    with_servo_errors(chain, random)
}

/// Draws the true viscous and dry skid coefficients of a robot from `of_robot`, and the errors of the servos from
/// `random`; returns the chain with both.
pub(super) fn planted_dry(
    mut chain: Chain,
    of_robot: &mut ChaCha8Rng,
    random: &mut ChaCha8Rng,
) -> Chain {
    change_friction(&mut chain, |_, friction| {
        let [viscous, dry] = [(); 2].map(|()| random_factor(of_robot));
        friction.skid_kg_s *= viscous;
        for force_n in
            [&mut friction.skid_dry_n, &mut friction.skid_static_n, &mut friction.skid_power_n]
        {
            *force_n *= dry;
        }
    });
    with_servo_errors(chain, random)
}

fn with_servo_errors(mut chain: Chain, random: &mut ChaCha8Rng) -> Chain {
    let driven = chain.joints.iter_mut().filter_map(|joint| match joint {
        Joint::Driven(command) => Some(command),
        Joint::Free(_) => None,
    });
    add_servo_errors(driven, random);
    chain
}

/// Changes the friction of each wheel by a function of the number of its link.
pub(super) fn change_friction(
    chain: &mut Chain,
    mut change: impl FnMut(usize, &mut WheelFriction),
) {
    for (number, place) in chain.numbering().into_iter().enumerate() {
        if let Some(wheel) = &mut chain.links[place].wheel {
            change(number, &mut wheel.friction);
        }
    }
}

/// Pose of the reference link and joint angles, rad, in a frame.
pub(super) type Frame = (Pose, Vec<f64>);

/// Simulates the motion from rest through the transient and several steady-state cycles. Returns the motion in every
/// frame and the metrics of the attractor reached from rest.
///
/// # Errors
/// Returns an error if the model has no periodic solution, or if the motion cannot be integrated.
pub(super) fn from_rest(
    problem: &ChainProblem,
    rate_hz: f64,
) -> Result<(Vec<Frame>, GaitMetrics), MotionError> {
    let steady = problem.settle(REFERENCE_ACCURACY)?.motion;
    let cycles = recorded_cycles(steady.floquet);
    let samples = problem.cycles_from_rest(cycles.ceil() as usize, SAMPLES)?;
    let samples_per_frame = SAMPLES as f64 * problem.omega_rad_s / (TAU * rate_hz);
    let frames = (SAMPLES as f64 * cycles / samples_per_frame) as usize + 1;
    let frames = (0..frames).map(|frame| interpolated(&samples, samples_per_frame * frame as f64));
    Ok((frames.collect(), steady.metrics.by_number(&problem.chain)))
}

/// Interpolates the motion at a fractional index by cubic Hermite splines.
fn interpolated(samples: &[ChainSample], index: f64) -> Frame {
    let first = (index as usize).min(samples.len() - 2);
    let [a, b] = [&samples[first], &samples[first + 1]];
    let t = index - first as f64;
    let step_s = b.time_s - a.time_s;
    let [h_a, h_b] = [(1.0 + 2.0 * t) * (1.0 - t).powi(2), t * t * (3.0 - 2.0 * t)];
    let [slope_a, slope_b] = [t * (1.0 - t).powi(2) * step_s, t * t * (t - 1.0) * step_s];
    let between = |[value_a, value_b]: [f64; 2], [rate_a, rate_b]: [f64; 2]| {
        h_a * value_a + h_b * value_b + slope_a * rate_a + slope_b * rate_b
    };
    let velocity = |sample: &ChainSample| {
        let [along, across, _] = sample.body;
        rotated(sample.pose.theta_rad, [along, across])
    };
    let [velocity_a, velocity_b] = [velocity(a), velocity(b)];
    let pose = Pose {
        x_m: between([a.pose.x_m, b.pose.x_m], [velocity_a[0], velocity_b[0]]),
        y_m: between([a.pose.y_m, b.pose.y_m], [velocity_a[1], velocity_b[1]]),
        theta_rad: between([a.pose.theta_rad, b.pose.theta_rad], [a.body[2], b.body[2]]),
    };
    let phi_rad = (0..a.phi_rad.len()).map(|joint| {
        between(
            [a.phi_rad[joint], b.phi_rad[joint]],
            [a.phi_rate_rad_s[joint], b.phi_rate_rad_s[joint]],
        )
    });
    (pose, phi_rad.collect())
}

/// Returns the poses of the links by number in a frame.
pub(super) fn link_poses(chain: &Chain, (pose, phi_rad): &Frame) -> Vec<Pose> {
    let poses = chain.link_poses(*pose, phi_rad);
    chain.numbering().into_iter().map(|place| poses[place]).collect()
}
