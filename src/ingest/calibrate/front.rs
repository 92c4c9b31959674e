//! Which of the two side links is the front one.
//!
//! Seen from behind, the front joint's angle is minus the rear one's and the other way round. So
//! the two ways to name the links differ in which joint does what, and in which of them is ahead:
//! the one that the commanded gait fits better is right. The direction in which the robot moves
//! does not decide: some gaits drive it backwards.

use nalgebra::{Complex, ComplexField};

use super::shape::Body;
use crate::robot::Gait;
use crate::stats::wrap;

/// How far the measured frequency may be from the commanded one, and the steps in which it is
/// looked for.
const SEARCH: f64 = 0.04;
const STEPS: i32 = 16;

/// Whether the third body is in front, if the bodies' joints follow a commanded gait of
/// `step_rad` per frame.
pub(super) fn is_last_in_front(
    bodies: &[Body; 3],
    frames: &[i64],
    gait: &Gait,
    step_rad: f64,
) -> bool {
    let command = gait.joints.map(|command| {
        command.map(|command| Complex::from_polar(command.amplitude_rad, command.phase_rad))
    });
    let misfit = |found: [Complex<f64>; 2]| {
        let pairs = || found.iter().zip(&command).filter_map(|(found, c)| Some((*found, (*c)?)));
        let product: Complex<f64> = pairs().map(|(found, c)| found * c.conj()).sum();
        let clock = Complex::from_polar(1.0, product.argument());
        pairs().map(|(found, c)| (found - c * clock).norm_sqr()).sum::<f64>()
    };
    let second = angle(&bodies[0], &bodies[1], frames);
    let third = angle(&bodies[2], &bodies[0], frames);
    let least = |found: &dyn Fn([Complex<f64>; 2]) -> [Complex<f64>; 2]| {
        (-STEPS..=STEPS)
            .map(|i| step_rad * (1.0 + SEARCH * f64::from(i) / f64::from(STEPS)))
            .map(|step_rad| misfit(found([&second, &third].map(|phi| harmonic(phi, step_rad)))))
            .fold(f64::INFINITY, f64::min)
    };
    least(&|[second, third]| [-third, -second]) < least(&|found| found)
}

/// Frame and angle of one body less that of another, where both have a pose, without jumps.
fn angle(minuend: &Body, subtrahend: &Body, frames: &[i64]) -> Vec<(f64, f64)> {
    let poses = minuend.fits.iter().zip(&subtrahend.fits).zip(frames);
    let mut previous = None;
    poses
        .filter_map(|((a, b), &frame)| {
            let turn = a.pose?.theta_rad - b.pose?.theta_rad;
            let turn = previous.map_or(turn, |previous: f64| previous + wrap(turn - previous));
            previous = Some(turn);
            Some((frame as f64, turn))
        })
        .collect()
}

/// Amplitude and phase of the harmonic of a step per frame.
fn harmonic(angle: &[(f64, f64)], step_rad: f64) -> Complex<f64> {
    let count = angle.len() as f64;
    let mean = angle.iter().map(|(_, angle)| angle).sum::<f64>() / count;
    let sum: Complex<f64> = angle
        .iter()
        .map(|(frame, angle)| Complex::from_polar(angle - mean, -step_rad * frame))
        .sum();
    sum * (2.0 / count)
}
