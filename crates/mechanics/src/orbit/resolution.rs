//! Discretisation error of the collocation elements, and mesh selection.

use trilink_robot::{LANES, Lanes, Number};

use super::PeriodicOrbit;
use super::newton::{largest_lane, largest_ratio};
use crate::element::weighted;
use crate::mesh::{MAX_ELEMENTS, accumulate_lanes};
use crate::radau::{RADAU, STAGES};
use crate::reduced::Reduced;

/// Fraction of the tolerated error that is allotted to discretisation.
const ERROR_SHARE: f64 = 0.5;

impl<const N: usize, R: Reduced<N>> PeriodicOrbit<N, R> {
    /// Returns an order-of-magnitude estimate of the relative discretisation error at the ends of the elements: the
    /// largest among the errors in the joint angles and in the velocities in the world frame.
    ///
    /// The error of an element's polynomial is about as large as its highest Legendre coefficient. At the element's
    /// end, where the collocation rule has nearly twice the order, the error is only as large as a coefficient four
    /// degrees higher, which is extrapolated from the decay of the coefficients over the last two degrees.
    pub(super) fn discretisation_error(&mut self, model: &R) -> f64 {
        let mut largest = [[Lanes::default(); N]; 3];
        let [lowest, _, highest] = &RADAU.spectrum;
        let state = model.kinematics(&model.node(0.0), &self.mesh.states.start);
        let [u, v, _] = R::body(&state);
        let mut start = model.tracked(&state, [u, v]);
        let mut values = [[Lanes::default(); STAGES]; N];
        self.tails.clear();
        for (pack, leg) in self.path.legs.iter().enumerate() {
            let [x_rates, y_rates] = leg.rates;
            for j in 0..STAGES {
                let tracked = model.tracked(&leg.states[j], [x_rates[j], y_rates[j]]);
                (0..N).for_each(|i| values[i][j] = tracked[i]);
            }
            let count = self.mesh.elements_of(pack).len();
            let [fraction, _] = self.mesh.weights(pack);
            let [tails, lower, sizes] = &mut largest;
            let mut pack_tails = [Lanes::default(); N];
            for i in 0..N {
                let end = values[i][STAGES - 1];
                let from = accumulate_lanes(&mut start[i], count, |_, lane| end.lane(lane));
                let tail = coefficient(highest, from, &values[i]);
                let low = coefficient(lowest, from, &values[i]);
                if model.is_linear() {
                    tails[i] = tails[i].fast_max(tail.abs());
                    lower[i] = lower[i].fast_max(low.abs());
                } else {
                    // Metrics are integrals, so an element's error is weighted with its length.
                    tails[i] += tail.abs() * fraction;
                    lower[i] += low.abs() * fraction;
                    pack_tails[i] = tail;
                }
                values[i].iter().for_each(|value| sizes[i] = sizes[i].fast_max(value.abs()));
            }
            if !model.is_linear() {
                self.tails.push(pack_tails);
            }
        }
        let [mut tails, mut lower, sizes] = largest.map(|largest| largest.map(largest_lane));
        if !model.is_linear() {
            [tails, lower, _] = largest.map(|sums| sums.map(sum_of_lanes));
        }
        let errors: [f64; N] = std::array::from_fn(|i| {
            let decay = if tails[i] < lower[i] { tails[i] / lower[i] } else { 1.0 };
            tails[i] * decay * decay
        });
        if !model.is_linear() {
            self.roughness.clear();
            for k in 0..self.mesh.count {
                let tails = self.tails[k / LANES].map(|tail| tail.lane(k % LANES).abs());
                self.roughness.push(largest_ratio(&tails, &sizes));
            }
        }
        largest_ratio(&errors, &sizes)
    }

    /// Chooses the bounds of `count` elements so that their discretisation errors are about equal, as
    /// estimated from the elements between the previous bounds.
    ///
    /// Reference: U. Ascher, R. Mattheij, R. Russell, *Numerical Solution of Boundary Value Problems
    /// for Ordinary Differential Equations*, SIAM 1995, section 9.2.
    pub(super) fn equidistribute(&mut self, count: usize) {
        /// Minimum density of elements, relative to the mean density.
        const MIN_DENSITY: f64 = 0.2;
        let Self { roughness, bounds_before: before, mesh, .. } = self;
        // Required density of elements, smoothed over neighbouring elements.
        roughness.iter_mut().for_each(|error| *error = error.powf(1.0 / STAGES as f64));
        let length = |k: usize| before[k + 1] - before[k];
        let density = |k: usize| roughness[k] / length(k);
        let near = |k: usize| {
            let next = [k.checked_sub(1), (k + 1 < roughness.len()).then_some(k + 1)];
            next.into_iter().flatten().fold(density(k), |largest, k| largest.max(0.5 * density(k)))
        };
        let mean: f64 = roughness.iter().sum();
        let weight = |k: usize| length(k) * (near(k) + MIN_DENSITY * mean);
        let sum: f64 = (0..roughness.len()).map(weight).sum();
        mesh.bounds.clear();
        mesh.bounds.reserve(MAX_ELEMENTS + 1);
        mesh.bounds.push(0.0);
        let mut passed = 0.0;
        for k in 0..roughness.len() {
            let weight = weight(k) / sum * count as f64;
            while passed + weight >= mesh.bounds.len() as f64 && mesh.bounds.len() < count {
                let position = (mesh.bounds.len() as f64 - passed) / weight;
                mesh.bounds.push(before[k] + length(k) * position);
            }
            passed += weight;
        }
        mesh.bounds.push(1.0);
    }

    /// Returns the ratio of the discretisation error to the error allowed for the given `accuracy` of the metrics. The
    /// ratio includes the accumulation of the elements' errors in motions whose disturbances decay slowly.
    pub(super) fn error_ratio(&mut self, model: &R, accuracy: f64) -> f64 {
        self.path.follow(model, &self.mesh);
        let sizes = self.sizes();
        let accumulated = std::array::from_fn(|i| {
            (0..N).map(|m| self.monodromy_closure[(i, m)].abs() * sizes[m]).sum::<f64>()
        });
        let growth = largest_ratio(&accumulated, &sizes);
        self.discretisation_error(model) * growth.max(1.0) / (ERROR_SHARE * accuracy)
    }
}

/// Returns a Legendre coefficient (see [`Radau::spectrum`](crate::radau::Radau::spectrum)) of the polynomial through the
/// value at an element's start and those at its stages.
#[inline(always)]
fn coefficient(weights: &[f64; STAGES + 1], start: Lanes, stages: &[Lanes; STAGES]) -> Lanes {
    let [coefficient] = weighted(weights, &[start], &stages.map(|value| [value]));
    coefficient
}

/// Returns the sum over the lanes.
pub(crate) fn sum_of_lanes(lanes: Lanes) -> f64 {
    lanes.to_array().into_iter().sum()
}
