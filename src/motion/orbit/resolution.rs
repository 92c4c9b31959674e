//! The discretisation error of the elements.

use super::PeriodicOrbit;
use super::newton::largest_ratio;
use crate::motion::element::{Stages, integrate_path, spectrum};
use crate::motion::radau::{RADAU, STAGES};
use crate::motion::reduced::{KinematicState, Reduced};
use crate::robot::Pose;

/// Part of the accuracy that the discretisation error may take.
const SHARE: f64 = 0.5;

impl<const N: usize, R: Reduced<N>> PeriodicOrbit<N, R> {
    /// Relative error at the elements' ends, in the order of magnitude, of the velocities, in the
    /// world's frame, and angles.
    ///
    /// The elements' polynomials miss about as much as their highest coefficient, the ends, where
    /// the rule is of nearly twice the order, only what comes four degrees later; the fall of the
    /// spectrum over the last two degrees tells how little that is.
    pub(super) fn discretisation_error(&self, model: &R) -> f64 {
        let (mut tails, mut lower) = ([0.0_f64; 7], [0.0_f64; 7]);
        let mut sizes = [0.0_f64; 7];
        let [lowest, _, highest] = &RADAU.spectrum;
        let state = model.kinematics(&model.node(0.0), &self.mesh.states.start);
        let [u, v, ..] = state.velocity;
        let (mut start, mut pose) = (world_values(&state, [u, v]), Pose::default());
        for element in self.mesh.elements() {
            let states = element.kinematics(model);
            let (poses, [x_rates, y_rates]) = integrate_path(pose, &states, element.duration_s);
            pose = poses[STAGES - 1];
            let values: Stages<7> =
                std::array::from_fn(|j| world_values(&states[j], [x_rates[j], y_rates[j]]));
            let found = spectrum(highest, &start, &values);
            let found_lower = spectrum(lowest, &start, &values);
            for i in 0..7 {
                tails[i] = tails[i].max(found[i]);
                lower[i] = lower[i].max(found_lower[i]);
                sizes[i] = values.iter().fold(sizes[i], |size, value| size.max(value[i].abs()));
            }
            start = values[STAGES - 1];
        }
        let errors: [f64; 7] = std::array::from_fn(|i| {
            let fall = if tails[i] < lower[i] { tails[i] / lower[i] } else { 1.0 };
            tails[i] * fall * fall
        });
        largest_ratio(&errors, &sizes)
    }

    /// The error over that at which the metrics are right to `accuracy`. Where a disturbance dies
    /// out slowly, the elements' errors add up.
    pub(super) fn error_ratio(&self, model: &R, accuracy: f64) -> f64 {
        let sizes = self.sizes();
        let row =
            |i: usize| (0..N).map(|m| self.monodromy_closure[(i, m)].abs() * sizes[m]).sum::<f64>();
        let growth = largest_ratio(&std::array::from_fn(row), &sizes);
        self.discretisation_error(model) * growth.max(1.0) / (SHARE * accuracy)
    }
}

/// Angles and velocities of a robot that moves as fast along the world's axes.
fn world_values(state: &KinematicState, [x_rate, y_rate]: [f64; 2]) -> [f64; 7] {
    let [phi1, phi2] = state.phi_rad;
    let [_, _, r, w1, w2] = state.velocity;
    [phi1, phi2, x_rate, y_rate, r, w1, w2]
}
