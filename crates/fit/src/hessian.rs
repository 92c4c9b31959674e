//! Second-order model of the residuals, and the step that minimises their sum.
//!
//! If fewer residuals are zero at the minimum than there are parameters, steps computed from the slopes alone zigzag
//! along a valley. The slopes are evaluated at every step anyway, and their changes yield approximate second
//! derivatives: one Hessian per residual, changed by the smallest update that agrees with the latest change in slope
//! (Powell's symmetric Broyden update, PSB).
//!
//! Reference: J. E. Dennis and R. B. Schnabel, *Numerical Methods for Unconstrained Optimization
//! and Nonlinear Equations*, SIAM 1996, section 9.1.

use std::sync::Arc;

use nalgebra::DVector;

use super::least_absolute::{Residual, dot, minimise, sum};

/// Approximate Hessian of each residual, in row-major order; empty before the first update.
#[derive(Debug, Clone, Default)]
pub(super) struct Hessians(Vec<Vec<f64>>);

/// Maximum number of iterations in the search for the change in the parameters that minimises a weighted sum of
/// absolute deviations. The deviations are approximated to second order in this change, and each iteration linearises
/// them about the change found so far. Further iterations would gain little.
const MAX_ITERATIONS: usize = 20;
/// Decrease of the sum of absolute deviations expected from another iteration, as a fraction of the decrease achieved
/// so far, below which the search for the best step ends.
const MIN_DECREASE: f64 = 1e-3;

impl Hessians {
    /// Updates the Hessians from the residuals at both ends of a step (symmetric Broyden update).
    pub(crate) fn update(&mut self, from: &[Residual], to: &[Residual], step: &[f64]) {
        let square = dot(step, step);
        if from.len() != to.len() || square == 0.0 {
            // Residuals are missing where the model has no periodic solution.
            return;
        }
        let count = step.len();
        if self.0.len() != from.len() {
            self.0 = vec![vec![0.0; count * count]; from.len()];
        }
        for (hessian, (from, to)) in self.0.iter_mut().zip(from.iter().zip(to)) {
            let error: Vec<f64> = (0..count)
                .map(|i| to.slope[i] - from.slope[i] - dot(&hessian[i * count..][..count], step))
                .collect();
            let twice = dot(&error, step) / square;
            for i in 0..count {
                for j in 0..count {
                    let both = error[i] * step[j] + step[i] * error[j];
                    hessian[i * count + j] += (both - twice * step[i] * step[j]) / square;
                }
            }
        }
    }

    /// Returns the step within `limits` that minimises the sum of the weighted absolute deviations of the residuals,
    /// taken to second order with these Hessians, and the decrease in that sum; the parameter at index `held` is not
    /// moved.
    pub(crate) fn best_step(
        &self,
        residuals: &[Residual],
        limits: &[[f64; 2]],
        held: Option<usize>,
    ) -> (DVector<f64>, f64) {
        if self.0.len() != residuals.len() {
            return best_linear_step(residuals, limits, held);
        }
        let origin = DVector::zeros(limits.len());
        let initial_cost = sum(residuals, &origin);
        let mut step = origin.clone();
        let mut here = residuals.to_vec();
        let mut cost = initial_cost;
        let mut radius = f64::INFINITY;
        for _ in 0..MAX_ITERATIONS {
            let remaining = limits.iter().zip(step.iter()).map(|(&[low, high], step)| {
                [(low - step).clamp(-radius, 0.0), (high - step).clamp(0.0, radius)]
            });
            let change = minimise(&here, &remaining.collect::<Vec<_>>(), held);
            let expected = cost - sum(&here, &change);
            if expected <= MIN_DECREASE * (initial_cost - cost) {
                break;
            }
            let next = &step + &change;
            let there = self.residuals_after(residuals, next.as_slice());
            let next_cost = sum(&there, &origin);
            let error = next_cost - (cost - expected);
            if error > 0.75 * expected {
                radius = 0.3 * change.amax();
            }
            if next_cost < cost {
                (step, here, cost) = (next, there, next_cost);
            }
            // The possible decrease is about as large as the change due to the second derivatives.
            if error.abs() <= MIN_DECREASE * (initial_cost - cost) {
                break;
            }
        }
        if cost < initial_cost {
            return (step, initial_cost - cost);
        }
        // If no decrease is found, the Hessians are wrong, unless the slopes alone predict no decrease either.
        best_linear_step(residuals, limits, held)
    }

    /// Returns the residuals after a step, with second-order terms.
    fn residuals_after(&self, residuals: &[Residual], step: &[f64]) -> Vec<Residual> {
        let count = step.len();
        let pairs = residuals.iter().zip(&self.0);
        pairs
            .map(|(residual, hessian)| {
                let change: Vec<f64> =
                    (0..count).map(|i| dot(&hessian[i * count..][..count], step)).collect();
                let slope = residual.slope.iter().zip(&change);
                Residual {
                    deviations: Arc::clone(&residual.deviations),
                    value: residual.value + dot(&residual.slope, step) + 0.5 * dot(&change, step),
                    slope: slope.map(|(slope, change)| slope + change).collect(),
                }
            })
            .collect()
    }
}

/// Returns the step within `limits` that minimises the sum of the weighted absolute deviations of the linearised
/// residuals, and the decrease in that sum; the parameter at index `held` is not moved.
fn best_linear_step(
    residuals: &[Residual],
    limits: &[[f64; 2]],
    held: Option<usize>,
) -> (DVector<f64>, f64) {
    let step = minimise(residuals, limits, held);
    let initial_cost = sum(residuals, &DVector::zeros(limits.len()));
    let expected = initial_cost - sum(residuals, &step);
    (step, expected)
}
