//! The objective's terms to second order, and the step that minimises them.
//!
//! Where fewer terms than there are parameters are zero at the minimum, steps that know the
//! slopes alone zigzag along a valley. The slopes are evaluated at every step anyway, and how they
//! change tells the second derivatives of each term: these are moved by the least that agrees with
//! the last change (Powell's symmetric Broyden update).
//!
//! Reference: J. E. Dennis and R. B. Schnabel, *Numerical Methods for Unconstrained Optimization
//! and Nonlinear Equations*, SIAM 1996, section 9.1.

use nalgebra::DVector;

use super::absolute::{Term, sum};
use super::search::linear_step;

/// Second derivatives of each term by the parameters, row by row; empty if nothing is known.
#[derive(Debug, Clone, Default)]
pub(super) struct Curvature {
    by_term: Vec<Vec<f64>>,
}

/// Steps on the way to the best one; those that are too many cost little.
const MOST_STEPS: usize = 20;
/// Part of the fall so far below which what is left is not worth another step.
const ENOUGH: f64 = 1e-3;

impl Curvature {
    /// Learns from terms that have become others by a step.
    pub fn learn(&mut self, from: &[Term], to: &[Term], step: &[f64]) {
        let square: f64 = step.iter().map(|part| part * part).sum();
        if from.len() != to.len() || square == 0.0 {
            // Where a motion does not exist its terms are missing.
            return;
        }
        let count = step.len();
        if self.by_term.len() != from.len() {
            self.by_term = vec![vec![0.0; count * count]; from.len()];
        }
        for (by, (from, to)) in self.by_term.iter_mut().zip(from.iter().zip(to)) {
            let missed: Vec<f64> = (0..count)
                .map(|i| to.slope[i] - from.slope[i] - along(&by[i * count..][..count], step))
                .collect();
            let twice = along(&missed, step) / square;
            for i in 0..count {
                for j in 0..count {
                    let both = missed[i] * step[j] + step[i] * missed[j];
                    by[i * count + j] += (both - twice * step[i] * step[j]) / square;
                }
            }
        }
    }

    /// The step within `limits` that minimises the terms, and how far they fall; that of a held
    /// parameter is 0.
    pub fn best_step(
        &self,
        terms: &[Term],
        limits: &[[f64; 2]],
        held: Option<usize>,
    ) -> (DVector<f64>, f64) {
        let nothing = DVector::zeros(limits.len());
        let began = sum(terms, &nothing);
        let by_slopes = || {
            let step = linear_step(terms, limits, held);
            let expected = began - sum(terms, &step);
            (step, expected)
        };
        if self.by_term.len() != terms.len() {
            return by_slopes();
        }
        let (mut step, mut here, mut cost) = (nothing.clone(), terms.to_vec(), began);
        let mut region = f64::INFINITY;
        for _ in 0..MOST_STEPS {
            let left = |(&[low, high], step): (&[f64; 2], &f64)| {
                [(low - step).clamp(-region, 0.0), (high - step).clamp(0.0, region)]
            };
            let limits: Vec<[f64; 2]> = limits.iter().zip(step.iter()).map(left).collect();
            let change = linear_step(&here, &limits, held);
            let expected = cost - sum(&here, &change);
            if expected <= ENOUGH * (began - cost) {
                break;
            }
            let next = &step + &change;
            let there = self.terms_after(terms, next.as_slice());
            let found = sum(&there, &nothing);
            let missed = found - (cost - expected);
            if missed > 0.75 * expected {
                region = 0.3 * change.amax();
            }
            if found < cost {
                (step, here, cost) = (next, there, found);
            }
            // What is left is about what the terms' curvature has changed.
            if missed.abs() <= ENOUGH * (began - cost) {
                break;
            }
        }
        // Where the curvature lets nothing fall it is wrong, or the slopes say the same.
        if cost < began { (step, began - cost) } else { by_slopes() }
    }

    /// What the terms become by a step.
    fn terms_after(&self, terms: &[Term], step: &[f64]) -> Vec<Term> {
        let count = step.len();
        let after = |(term, by): (&Term, &Vec<f64>)| {
            let change: Vec<f64> =
                (0..count).map(|i| along(&by[i * count..][..count], step)).collect();
            let slope = term.slope.iter().zip(&change).map(|(slope, change)| slope + change);
            Term {
                weight: term.weight,
                value: term.value + along(&term.slope, step) + 0.5 * along(&change, step),
                slope: slope.collect(),
            }
        };
        terms.iter().zip(&self.by_term).map(after).collect()
    }
}

fn along(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
