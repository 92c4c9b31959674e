//! The residuals to second order, and the step that minimises them.
//!
//! Where fewer residuals than there are parameters are zero at the minimum, steps by the slopes
//! alone zigzag along a valley. The slopes are evaluated at every step anyway, and their change
//! determines approximate second derivatives: a Hessian per residual, moved by the least that
//! agrees with the last change (Powell's symmetric Broyden update, PSB).
//!
//! Reference: J. E. Dennis and R. B. Schnabel, *Numerical Methods for Unconstrained Optimization
//! and Nonlinear Equations*, SIAM 1996, section 9.1.

use std::sync::Arc;

use nalgebra::DVector;

use super::least_absolute::{Residual, dot, minimise, sum};

/// Approximate Hessian of each residual, row by row; empty before the first update.
#[derive(Debug, Clone, Default)]
pub(super) struct Hessians(Vec<Vec<f64>>);

/// Linear steps on the way to the best one; those that are too many cost little.
const MAX_STEPS: usize = 20;
/// Part of the fall so far below which what is left is not worth another step.
const ENOUGH: f64 = 1e-3;

impl Hessians {
    /// The symmetric Broyden update by the residuals at both ends of a step.
    pub(crate) fn update(&mut self, from: &[Residual], to: &[Residual], step: &[f64]) {
        let square = dot(step, step);
        if from.len() != to.len() || square == 0.0 {
            // Where a motion does not exist its residuals are missing.
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

    /// The step within `limits` that minimises the residuals, and how far their sum falls; a held
    /// parameter does not move.
    pub(crate) fn best_step(
        &self,
        residuals: &[Residual],
        limits: &[[f64; 2]],
        held: Option<usize>,
    ) -> (DVector<f64>, f64) {
        let origin = DVector::zeros(limits.len());
        let began = sum(residuals, &origin);
        let linear = || {
            let step = minimise(residuals, limits, held);
            let expected = began - sum(residuals, &step);
            (step, expected)
        };
        if self.0.len() != residuals.len() {
            return linear();
        }
        let (mut step, mut here, mut cost) = (origin.clone(), residuals.to_vec(), began);
        let mut radius = f64::INFINITY;
        for _ in 0..MAX_STEPS {
            let left = |(&[low, high], step): (&[f64; 2], &f64)| {
                [(low - step).clamp(-radius, 0.0), (high - step).clamp(0.0, radius)]
            };
            let limits: Vec<[f64; 2]> = limits.iter().zip(step.iter()).map(left).collect();
            let change = minimise(&here, &limits, held);
            let expected = cost - sum(&here, &change);
            if expected <= ENOUGH * (began - cost) {
                break;
            }
            let next = &step + &change;
            let there = self.residuals_after(residuals, next.as_slice());
            let found = sum(&there, &origin);
            let error = found - (cost - expected);
            if error > 0.75 * expected {
                radius = 0.3 * change.amax();
            }
            if found < cost {
                (step, here, cost) = (next, there, found);
            }
            // What is left is about what the second derivatives have changed.
            if error.abs() <= ENOUGH * (began - cost) {
                break;
            }
        }
        // Hessians that let nothing fall are wrong, or the slopes predict no fall either.
        if cost < began { (step, began - cost) } else { linear() }
    }

    /// The residuals after a step, to second order.
    fn residuals_after(&self, residuals: &[Residual], step: &[f64]) -> Vec<Residual> {
        let count = step.len();
        let after = |(residual, hessian): (&Residual, &Vec<f64>)| {
            let change: Vec<f64> =
                (0..count).map(|i| dot(&hessian[i * count..][..count], step)).collect();
            let slope = residual.slope.iter().zip(&change).map(|(slope, change)| slope + change);
            Residual {
                deviations: Arc::clone(&residual.deviations),
                value: residual.value + dot(&residual.slope, step) + 0.5 * dot(&change, step),
                slope: slope.collect(),
            }
        };
        residuals.iter().zip(&self.0).map(after).collect()
    }
}
