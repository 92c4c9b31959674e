//! The discretisation error of the elements.

use super::PeriodicOrbit;
use super::newton::{keep_largest, largest_lane, largest_ratio};
use crate::motion::element::{Stages, weighted};
use crate::motion::mesh::in_turn;
use crate::motion::radau::{RADAU, STAGES};
use crate::motion::reduced::{KinematicState, Reduced};
use crate::robot::{Lanes, Number};

/// Part of the accuracy that the discretisation error may take.
const SHARE: f64 = 0.5;

impl<const N: usize, R: Reduced<N>> PeriodicOrbit<N, R> {
    /// Relative error at the elements' ends on the path at hand, in the order of magnitude, of the velocities, in the
    /// world's frame, and angles.
    ///
    /// The elements' polynomials miss about as much as their highest coefficient, the ends, where
    /// the rule is of nearly twice the order, only what comes four degrees later; the fall of the
    /// spectrum over the last two degrees tells how little that is.
    pub(super) fn discretisation_error(&self, model: &R) -> f64 {
        let mut largest = [[Lanes::default(); 7]; 3];
        let [lowest, _, highest] = &RADAU.spectrum;
        let state = model.kinematics(&model.node(0.0), &self.mesh.states.start);
        let [u, v, ..] = state.velocity;
        let mut start = world_values(&state, [u, v]);
        for (pack, leg) in self.path.legs.iter().enumerate() {
            let [x_rates, y_rates] = leg.rates;
            let values: Stages<7, Lanes> =
                std::array::from_fn(|j| world_values(&leg.states[j], [x_rates[j], y_rates[j]]));
            let (count, ends) = (self.mesh.elements_of(pack).len(), &values[STAGES - 1]);
            let starts = std::array::from_fn(|i| {
                in_turn(&mut start[i], count, |_, lane| ends[i].lane(lane))
            });
            let [tails, lower, sizes] = &mut largest;
            keep_largest(tails, &weighted(highest, &starts, &values));
            keep_largest(lower, &weighted(lowest, &starts, &values));
            values.iter().for_each(|values| keep_largest(sizes, values));
        }
        let [tails, lower, sizes] = largest.map(|largest| largest.map(largest_lane));
        let errors: [f64; 7] = std::array::from_fn(|i| {
            let fall = if tails[i] < lower[i] { tails[i] / lower[i] } else { 1.0 };
            tails[i] * fall * fall
        });
        largest_ratio(&errors, &sizes)
    }

    /// The error over that at which the metrics are right to `accuracy`. Where a disturbance dies
    /// out slowly, the elements' errors add up.
    pub(super) fn error_ratio(&mut self, model: &R, accuracy: f64) -> f64 {
        self.path.follow(model, &self.mesh);
        let sizes = self.sizes();
        let row =
            |i: usize| (0..N).map(|m| self.monodromy_closure[(i, m)].abs() * sizes[m]).sum::<f64>();
        let growth = largest_ratio(&std::array::from_fn(row), &sizes);
        self.discretisation_error(model) * growth.max(1.0) / (SHARE * accuracy)
    }
}

/// Angles and velocities of a robot that moves as fast along the world's axes.
#[inline(always)]
fn world_values<T: Number>(state: &KinematicState<T>, [x_rate, y_rate]: [T; 2]) -> [T; 7] {
    let [phi1, phi2] = state.phi_rad;
    let [_, _, r, w1, w2] = state.velocity;
    [phi1, phi2, x_rate, y_rate, r, w1, w2]
}
