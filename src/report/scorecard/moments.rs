//! What happens within a steady cycle: forces, crossings of `phi1 = phi2`, phases.

use serde::Deserialize;

use super::paper::Paper;
use crate::motion::{FORCES_ACCURACY, REFERENCE_ACCURACY, Sample, Solver};
use crate::robot::Parameter;
use crate::stats::wrap;

/// Samples of a cycle, and how many of them there are to one of the coarse ones. Neither meets the
/// crossings of the symmetric gait at an eighth and five eighths of the period: both miss them by
/// half a step.
const FINE: usize = 1100;
const REFINED: usize = 11;
/// Samples in which crossings and phases are looked for.
const SAMPLES: usize = 180;

/// What may grow without bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Grown {
    /// Of the ground on a wheel, across it.
    Force,
    /// `x'`, `y'` and `h theta'`.
    Velocity,
}

fn cycle(paper: &Paper<'_>, motion: &str, omega_rad_s: f64, samples: usize) -> Option<Vec<Sample>> {
    let mut solver = Solver::default();
    solver.solve(&paper.problem(motion, omega_rad_s)?, FORCES_ACCURACY).ok()?;
    solver.cycle(samples).ok()
}

/// The largest value seen in all samples over that in every eleventh: 1 for what is bounded and
/// resolved, 11 for what has a pole.
pub fn growth(paper: &Paper<'_>, motion: &str, omega_rad_s: f64, of: Grown) -> Option<f64> {
    let h_m = paper.problem(motion, omega_rad_s)?.robot.h_m;
    let samples = cycle(paper, motion, omega_rad_s, FINE)?;
    let largest = |step: usize| {
        let sizes = samples.iter().step_by(step).map(|sample| {
            let [x, y, turning, ..] = sample.rates;
            let values = match of {
                Grown::Force => sample.forces.lateral_n,
                Grown::Velocity => [x, y, h_m * turning],
            };
            // A force that is not a number is one that has no bound.
            let sizes =
                values.map(|value| if value.is_nan() { f64::INFINITY } else { value.abs() });
            sizes.into_iter().fold(0.0, f64::max)
        });
        sizes.fold(0.0, f64::max)
    };
    Some(largest(1) / largest(REFINED))
}

/// Joint angles and rates where `phi1 = phi2` is crossed in a cycle.
fn crossings(samples: &[Sample]) -> Vec<[f64; 2]> {
    let apart = |sample: &Sample| sample.phi_rad[0] - sample.phi_rad[1];
    let pairs = samples
        .windows(2)
        .filter(|pair| apart(&pair[0]) == 0.0 || apart(&pair[0]) * apart(&pair[1]) < 0.0);
    pairs
        .map(|pair| {
            let (from, to) = (apart(&pair[0]), apart(&pair[1]));
            let part = from / (from - to);
            std::array::from_fn(|joint| {
                let [from, to] = [pair[0].rates[3 + joint], pair[1].rates[3 + joint]];
                from + part * (to - from)
            })
        })
        .collect()
}

/// How often a cycle crosses `phi1 = phi2`.
pub fn count_crossings(paper: &Paper<'_>, motion: &str, omega_rad_s: f64) -> Option<f64> {
    Some(crossings(&cycle(paper, motion, omega_rad_s, SAMPLES)?).len() as f64)
}

/// Largest `|phi1' + phi2'|` over `|phi1'| + |phi2'|` at the crossings (eq. 6); `None` if there
/// are none.
pub fn crossing_rates(paper: &Paper<'_>, motion: &str, omega_rad_s: f64) -> Option<f64> {
    let crossings = crossings(&cycle(paper, motion, omega_rad_s, SAMPLES)?);
    let off = crossings.iter().map(|[w1, w2]| (w1 + w2).abs() / (w1.abs() + w2.abs()));
    off.max_by(f64::total_cmp)
}

/// Phase of the first harmonic of phi1 after that of phi2, degrees from -180 to 180.
pub fn lag_deg(paper: &Paper<'_>, motion: &str, omega_rad_s: f64) -> Option<f64> {
    let samples = cycle(paper, motion, omega_rad_s, SAMPLES)?;
    let phase = |joint: usize| {
        let (mut cosine, mut sine) = (0.0, 0.0);
        for sample in &samples[..SAMPLES] {
            let (sin, cos) = (omega_rad_s * sample.time_s).sin_cos();
            cosine += sample.phi_rad[joint] * cos;
            sine += sample.phi_rad[joint] * sin;
        }
        sine.atan2(cosine)
    };
    Some(wrapped_deg(phase(1) - phase(0)))
}

/// An angle (rad) in degrees from -180 to 180.
pub fn wrapped_deg(angle_rad: f64) -> f64 {
    wrap(angle_rad).to_degrees()
}

/// Work of the actuators less what friction takes, over that work.
pub fn energy_gap(paper: &Paper<'_>, motion: &str, omega_rad_s: f64) -> Option<f64> {
    let mut solver = Solver::default();
    solver.solve(&paper.problem(motion, omega_rad_s)?, REFERENCE_ACCURACY).ok()?;
    let [work, loss] = solver.work_and_loss_j().ok()?;
    Some((work - loss).abs() / work)
}

/// Number of coefficients of dissipation that the steady motion depends on.
pub fn coefficients(paper: &Paper<'_>, motion: &str, omega_rad_s: f64) -> Option<f64> {
    let mut solver = Solver::default();
    solver.solve(&paper.problem(motion, omega_rad_s)?, REFERENCE_ACCURACY).ok()?;
    let derivatives = solver.derivatives().ok()?.parameters;
    let moved = derivatives.iter().filter(|(parameter, derivative)| {
        !matches!(parameter, Parameter::RollSum | Parameter::Stiffness)
            && derivative.to_array().iter().any(|by| *by != 0.0)
    });
    Some(moved.count() as f64)
}
