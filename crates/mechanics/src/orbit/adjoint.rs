//! Derivatives of quantities of a periodic motion by the adjoint method.
//!
//! A quantity has given derivatives (weights) with respect to the states at the stages of the elements. Its derivatives
//! with respect to the state at an element's start follow from those with respect to the state at its end, recursively
//! from the last element to the first; periodicity leaves an `N x N` system for the derivatives at the end of the last
//! element. One transposed system per element then gives the factors (adjoint solution) of the residuals: a change in
//! the residuals changes the quantity by minus the sum of its products with these factors.
//!
//! Reference: Y. Cao, S. Li, L. Petzold and R. Serban, "Adjoint sensitivity analysis for differential-algebraic
//! equations", SIAM J. Sci. Comput. 24 (2003) 1076-1089; here for the discretised equations.

use nalgebra::{SMatrix, SVector};
use trilink_robot::{LANES, Lanes};

use super::PeriodicOrbit;
use crate::Result;
use crate::element::{Stages, fold_angles};
use crate::mesh::renew;
use crate::radau::STAGES;
use crate::reduced::Reduced;

/// Derivatives of a quantity with respect to the states at the starts of up to two elements, given by their indices.
pub(crate) type OfElements<const N: usize> = [Option<(usize, [f64; N])>; 2];

/// Adjoint solutions for `B` quantities, and their weights; the buffers are reused.
#[derive(Debug, Clone)]
pub(crate) struct Adjoint<const N: usize, const B: usize> {
    /// Derivatives with respect to the states at the stages: entry `pack * B + quantity` for each pack of elements and
    /// quantity. [`PeriodicOrbit::solve_adjoint`] overwrites them.
    pub weights: Vec<Stages<N, Lanes>>,
    /// For each quantity, derivatives with respect to the states at the starts of single elements, in addition to the
    /// weights.
    pub starts: [OfElements<N>; B],
    /// For each quantity, whether it changes its sign under the half-period symmetry.
    pub is_odd: [bool; B],
    /// For each pack of elements, stage and unknown, the factors of the residuals.
    factors: Vec<[Lanes; B]>,
    /// For each pack of elements and quantity, the derivatives with respect to the states at the elements' starts and,
    /// later, at their ends.
    bounds: Vec<[[f64; LANES]; N]>,
}

impl<const N: usize, const B: usize> Default for Adjoint<N, B> {
    fn default() -> Self {
        Self {
            weights: Vec::new(),
            starts: [[None; 2]; B],
            is_odd: [false; B],
            factors: Vec::new(),
            bounds: Vec::new(),
        }
    }
}

impl<const N: usize, const B: usize> Adjoint<N, B> {
    /// Sets the weights to zero for `packs` packs of elements.
    pub(crate) fn clear(&mut self, packs: usize) {
        renew(&mut self.weights, packs * B);
        self.weights.resize(packs * B, [[Lanes::default(); N]; STAGES]);
        self.starts = [[None; 2]; B];
        self.is_odd = [false; B];
    }

    /// Returns the factors of the residuals at a stage of the elements in a pack, by unknown and quantity.
    pub(crate) fn factors<R: Reduced<N>>(&self, pack: usize, stage: usize) -> &[[Lanes; B]] {
        &self.factors[(pack * STAGES + stage) * R::UNKNOWNS..][..R::UNKNOWNS]
    }
}

impl<const N: usize, R: Reduced<N>> PeriodicOrbit<N, R> {
    /// Solves for the adjoint solutions of quantities with the given weights, from the last linearisation
    /// ([`PeriodicOrbit::linearise`]).
    ///
    /// # Errors
    /// Returns an error if the cyclic linear system of the periodic orbit is singular.
    pub(crate) fn solve_adjoint<const B: usize>(&self, adjoint: &mut Adjoint<N, B>) -> Result<()> {
        let Self { mesh, linearisation, .. } = self;
        let size = R::UNKNOWNS * STAGES;
        let Adjoint { weights, starts, is_odd, factors, bounds } = adjoint;
        factors.resize(mesh.packs() * size, [Lanes::default(); B]);
        renew(bounds, mesh.packs() * B);
        for pack in 0..mesh.packs() {
            let own = &mut factors[pack * size..][..size];
            for q in 0..B {
                let weights = &mut weights[pack * B + q];
                let mut start = fold_angles::<N, R, Lanes>(weights, mesh.durations_s[pack]);
                for (row, factors) in own.iter_mut().enumerate() {
                    factors[q] = weights[row / R::UNKNOWNS][row % R::UNKNOWNS];
                }
                linearisation.add_start_gradient::<N, R>(pack, weights, &mut start);
                bounds.push(start.map(|gradient| gradient.to_array()));
            }
        }
        let back = |rows: &mut [[f64; N]; B], bounds: &[[[f64; LANES]; N]], k: usize| {
            let transfer = &self.transfers[k];
            for (q, row) in rows.iter_mut().enumerate() {
                let own = &bounds[k / LANES * B + q];
                let mut start: [f64; N] = std::array::from_fn(|m| own[m][k % LANES]);
                for i in 0..N {
                    (0..N).for_each(|m| start[m] += row[i] * transfer[i][m]);
                }
                for (_, slopes) in starts[q].iter().flatten().filter(|(at, _)| *at == k) {
                    (0..N).for_each(|m| start[m] += slopes[m]);
                }
                *row = start;
            }
        };
        let mut rows = [[0.0; N]; B];
        (0..mesh.count).rev().for_each(|k| back(&mut rows, bounds, k));
        let odd = is_odd.contains(&true).then(|| self.odd_closure()).transpose()?;
        for (q, row) in rows.iter_mut().enumerate() {
            let (closure, sign) = match odd.filter(|_| is_odd[q]) {
                Some(closure) => (closure, -1.0),
                None => (self.monodromy_closure, 1.0),
            };
            let start = closure.tr_mul(&SVector::<f64, N>::from(*row));
            *row = std::array::from_fn(|i| sign * mesh.signs[i] * start[i]);
        }
        if rows.iter().flatten().any(|entry| !entry.is_finite()) {
            return Err(self.not_converged());
        }
        for k in (0..mesh.count).rev() {
            let ends = rows;
            back(&mut rows, bounds, k);
            for (own, end) in bounds[k / LANES * B..][..B].iter_mut().zip(&ends) {
                (0..N).for_each(|i| own[i][k % LANES] = end[i]);
            }
        }
        for pack in 0..mesh.packs() {
            let used = mesh.elements_of(pack).len();
            let ends: [[Lanes; N]; B] = std::array::from_fn(|q| {
                bounds[pack * B + q].map(|mut lanes| {
                    lanes[used..].fill(0.0);
                    Lanes::new(lanes)
                })
            });
            let own = &mut factors[pack * size..][..size];
            linearisation.adjoint_factors::<N, R, B>(pack, mesh.durations_s[pack], &ends, own);
        }
        Ok(())
    }

    /// Returns `(I + M)^-1`, with the monodromy matrix M.
    fn odd_closure(&self) -> Result<SMatrix<f64, N, N>> {
        let closed = SMatrix::<f64, N, N>::identity() + self.monodromy();
        closed.try_inverse().ok_or(self.not_converged())
    }
}
