//! Where the robot goes: position and heading from the velocities in its own frame.

use super::radau::{RADAU, STAGES};
use super::reduced::KinematicState;
use crate::robot::{Pose, rotated};

/// Poses at the stages of an element that starts at `from`; the last is its end.
pub(super) fn integrate_poses(
    from: Pose,
    states: &[KinematicState; STAGES],
    duration_s: f64,
) -> [Pose; STAGES] {
    let integrate = &RADAU.integrate;
    let sum = |j: usize, rates: &[f64; STAGES]| -> f64 {
        duration_s * integrate[j].iter().zip(rates).map(|(w, rate)| w * rate).sum::<f64>()
    };
    let turning = states.map(|state| state.velocity[2]);
    let headings: [f64; STAGES] = std::array::from_fn(|j| from.theta_rad + sum(j, &turning));
    let (mut x_rates, mut y_rates) = ([0.0; STAGES], [0.0; STAGES]);
    for j in 0..STAGES {
        let [u, v, ..] = states[j].velocity;
        [x_rates[j], y_rates[j]] = rotated(headings[j], [u, v]);
    }
    std::array::from_fn(|j| Pose {
        x_m: from.x_m + sum(j, &x_rates),
        y_m: from.y_m + sum(j, &y_rates),
        theta_rad: headings[j],
    })
}
