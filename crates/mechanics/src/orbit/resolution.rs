//! The discretisation error of the elements.

use trilink_robot::{LANES, Lanes, Number};

use super::PeriodicOrbit;
use super::newton::{keep_largest, largest_lane, largest_ratio};
use crate::element::{Stages, weighted};
use crate::mesh::{MOST_ELEMENTS, in_turn};
use crate::radau::{RADAU, STAGES};
use crate::reduced::{KinematicState, Reduced};

/// Part of the accuracy that the discretisation error may take.
const SHARE: f64 = 0.5;

impl<const N: usize, R: Reduced<N>> PeriodicOrbit<N, R> {
    /// Relative error at the elements' ends on the path at hand, in the order of magnitude, of the velocities, in the
    /// world's frame, and angles.
    ///
    /// The elements' polynomials miss about as much as their highest coefficient, the ends, where
    /// the rule is of nearly twice the order, only what comes four degrees later; the fall of the
    /// spectrum over the last two degrees tells how little that is.
    pub(super) fn discretisation_error(&mut self, model: &R) -> f64 {
        let mut largest = [[Lanes::default(); 7]; 3];
        let [lowest, _, highest] = &RADAU.spectrum;
        let state = model.kinematics(&model.node(0.0), &self.mesh.states.start);
        let [u, v, ..] = state.velocity;
        let mut start = world_values(&state, [u, v]);
        self.tails.clear();
        for (pack, leg) in self.path.legs.iter().enumerate() {
            let [x_rates, y_rates] = leg.rates;
            let values: Stages<7, Lanes> =
                std::array::from_fn(|j| world_values(&leg.states[j], [x_rates[j], y_rates[j]]));
            let (count, ends) = (self.mesh.elements_of(pack).len(), &values[STAGES - 1]);
            let starts = std::array::from_fn(|i| {
                in_turn(&mut start[i], count, |_, lane| ends[i].lane(lane))
            });
            let [tails, lower, sizes] = &mut largest;
            let (own_tails, own_lower) =
                (weighted(highest, &starts, &values), weighted(lowest, &starts, &values));
            if R::IS_LINEAR {
                keep_largest(tails, &own_tails);
                keep_largest(lower, &own_lower);
            } else {
                // Metrics are integrals: what little is missed in a short element counts little.
                let [part, _] = self.mesh.weights(pack);
                add_sizes(tails, &own_tails, part);
                add_sizes(lower, &own_lower, part);
                self.tails.push(own_tails);
            }
            values.iter().for_each(|values| keep_largest(sizes, values));
        }
        let [mut tails, mut lower, sizes] = largest.map(|largest| largest.map(largest_lane));
        if !R::IS_LINEAR {
            let [all_tails, all_lower, _] = largest.map(|sums| sums.map(sum_of_lanes));
            (tails, lower) = (all_tails, all_lower);
        }
        let errors: [f64; 7] = std::array::from_fn(|i| {
            let fall = if tails[i] < lower[i] { tails[i] / lower[i] } else { 1.0 };
            tails[i] * fall * fall
        });
        if !R::IS_LINEAR {
            self.roughness.clear();
            for k in 0..self.mesh.count {
                let tails = self.tails[k / LANES].map(|tail| tail.lane(k % LANES).abs());
                self.roughness.push(largest_ratio(&tails, &sizes));
            }
        }
        largest_ratio(&errors, &sizes)
    }

    /// Lays the bounds of `count` elements so that their polynomials miss about equally much, as far as
    /// those of the elements between the bounds before tell.
    ///
    /// Reference: U. Ascher, R. Mattheij, R. Russell, *Numerical Solution of Boundary Value Problems
    /// for Ordinary Differential Equations*, SIAM 1995, section 9.2.
    pub(super) fn equidistribute(&mut self, count: usize) {
        /// The least density of elements over the mean one.
        const LEAST: f64 = 0.2;
        let Self { roughness, bounds_before: before, mesh, .. } = self;
        // How many elements each one should have been, with those next to a rough one.
        roughness.iter_mut().for_each(|miss| *miss = miss.powf(1.0 / STAGES as f64));
        let length = |k: usize| before[k + 1] - before[k];
        let density = |k: usize| roughness[k] / length(k);
        let near = |k: usize| {
            let next = [k.checked_sub(1), (k + 1 < roughness.len()).then_some(k + 1)];
            next.into_iter().flatten().fold(density(k), |most, k| most.max(0.5 * density(k)))
        };
        let mean: f64 = roughness.iter().sum();
        let weight = |k: usize| length(k) * (near(k) + LEAST * mean);
        let sum: f64 = (0..roughness.len()).map(weight).sum();
        mesh.bounds.clear();
        mesh.bounds.reserve(MOST_ELEMENTS + 1);
        mesh.bounds.push(0.0);
        let mut passed = 0.0;
        for k in 0..roughness.len() {
            let weight = weight(k) / sum * count as f64;
            while passed + weight >= mesh.bounds.len() as f64 && mesh.bounds.len() < count {
                let fraction = (mesh.bounds.len() as f64 - passed) / weight;
                mesh.bounds.push(before[k] + length(k) * fraction);
            }
            passed += weight;
        }
        mesh.bounds.push(1.0);
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

/// Adds the sizes of `values`, each times `part`.
#[inline(always)]
fn add_sizes<const K: usize>(sums: &mut [Lanes; K], values: &[Lanes; K], part: Lanes) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value.abs() * part);
}

fn sum_of_lanes(lanes: Lanes) -> f64 {
    lanes.to_array().into_iter().sum()
}

/// Angles and velocities of a robot that moves as fast along the world's axes.
#[inline(always)]
fn world_values<T: Number>(state: &KinematicState<T>, [x_rate, y_rate]: [T; 2]) -> [T; 7] {
    let [phi1, phi2] = state.phi_rad;
    let [_, _, r, w1, w2] = state.velocity;
    [phi1, phi2, x_rate, y_rate, r, w1, w2]
}
