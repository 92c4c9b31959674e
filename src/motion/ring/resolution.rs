//! How much of the motion the elements miss.

use super::Ring;
use super::newton::largest_ratio;
use crate::motion::element::{Stages, lower_tail, tail};
use crate::motion::path::advance;
use crate::motion::radau::STAGES;
use crate::motion::reduced::{Moment, Reduced};
use crate::robot::{Pose, rotated};

/// Part of the accuracy that the elements may miss.
const MISSED: f64 = 0.5;

impl<const N: usize, R: Reduced<N>> Ring<N, R> {
    /// Relative size, in the order of magnitude, of what the ends of the elements miss of the
    /// velocities, in the world's frame, and angles.
    ///
    /// The elements' polynomials miss about as much as their highest coefficient, the ends, where
    /// the rule is of nearly twice the order, only what comes four degrees later; the fall of the
    /// spectrum over the last two degrees tells how little that is.
    pub(super) fn missed(&self, model: &R) -> f64 {
        let (mut tails, mut lower) = ([0.0_f64; 7], [0.0_f64; 7]);
        let mut sizes = [0.0_f64; 7];
        let moment = model.moment(&model.node(0.0), &self.now.start);
        let (mut start, mut pose) = (in_the_world(&moment, 0.0), Pose::default());
        for (nodes, stages) in self.nodes.chunks_exact(STAGES).zip(&self.now.elements) {
            let moments = std::array::from_fn(|j| model.moment(&nodes[j], &stages[j]));
            let poses = advance(pose, &moments, self.element_s);
            pose = poses[STAGES - 1];
            let values: Stages<7> =
                std::array::from_fn(|j| in_the_world(&moments[j], poses[j].theta_rad));
            let (found, found_lower) = (tail(&start, &values), lower_tail(&start, &values));
            for i in 0..7 {
                tails[i] = tails[i].max(found[i]);
                lower[i] = lower[i].max(found_lower[i]);
                sizes[i] = values.iter().fold(sizes[i], |size, value| size.max(value[i].abs()));
            }
            start = values[STAGES - 1];
        }
        let missed: [f64; 7] = std::array::from_fn(|i| {
            let fall = if tails[i] < lower[i] { tails[i] / lower[i] } else { 1.0 };
            tails[i] * fall * fall
        });
        largest_ratio(&missed, &sizes)
    }

    /// What is missed as a part of that at which the metrics are right to `accuracy`. Where a
    /// disturbance dies out slowly, the elements' errors add up.
    pub(super) fn missed_part(&self, model: &R, accuracy: f64) -> f64 {
        let sizes = self.sizes();
        let row = |i: usize| (0..N).map(|m| self.closing[(i, m)].abs() * sizes[m]).sum::<f64>();
        let growth = largest_ratio(&std::array::from_fn(row), &sizes);
        self.missed(model) * growth.max(1.0) / (MISSED * accuracy)
    }
}

/// Angles and velocities of a moment at a heading, the velocity along the world's axes.
fn in_the_world(moment: &Moment, theta_rad: f64) -> [f64; 7] {
    let [phi1, phi2] = moment.phi_rad;
    let [u, v, r, w1, w2] = moment.velocity;
    let [x_rate, y_rate] = rotated(theta_rad, [u, v]);
    [phi1, phi2, x_rate, y_rate, r, w1, w2]
}
