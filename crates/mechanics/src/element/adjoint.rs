//! Adjoint solutions on collocation elements.

use trilink_robot::Number;

use super::{Linearisation, Stages};
use crate::lu;
use crate::radau::{RADAU, STAGES};
use crate::reduced::Reduced;

/// Converts weights of the angles at the stages, if the model defines them as integrals of their rates, to weights of
/// these rates and of the angles at the element's start, which are returned; the other entries are zero.
#[inline(always)]
pub(crate) fn fold_angles<const N: usize, R: Reduced<N>, T: Number>(
    weights: &mut Stages<N, T>,
    duration_s: T,
) -> [T; N] {
    let mut start = [T::splat(0.0); N];
    for angle in R::UNKNOWNS..N {
        for j in 0..STAGES {
            let weight = weights[j][angle];
            start[angle] += weight;
            for l in 0..STAGES {
                weights[l][angle - R::ANGLES] +=
                    T::splat(RADAU.integrate[j][l]) * duration_s * weight;
            }
        }
    }
    start
}

impl<T: Number> Linearisation<T> {
    /// Adds to `start` the derivatives of a quantity with the given weights of the unknowns with respect to the states at
    /// the starts of the elements in pack `pack` (one per SIMD lane).
    #[inline(always)]
    pub(crate) fn add_start_gradient<const N: usize, R: Reduced<N>>(
        &self,
        pack: usize,
        weights: &Stages<N, T>,
        start: &mut [T; N],
    ) {
        let (transfer, _) = self.solutions::<N, R>(pack);
        let unknowns = weights.iter().flat_map(|stage| &stage[..R::UNKNOWNS]);
        for (weight, transfer) in unknowns.zip(transfer.as_chunks::<N>().0) {
            (0..N).for_each(|m| start[m] += *weight * transfer[m]);
        }
    }

    /// Solves the transposed systems of the elements in pack `pack` (one per SIMD lane) in place. The right-hand sides
    /// `rows` are the weights of the unknowns in `B` quantities, without those of the states at the ends of the elements:
    /// the derivatives of the quantities with respect to these are given.
    #[inline(always)]
    pub(crate) fn adjoint_factors<const N: usize, R: Reduced<N>, const B: usize>(
        &self,
        pack: usize,
        duration_s: T,
        ends: &[[T; N]; B],
        rows: &mut [[T; B]],
    ) {
        let per_stage = R::UNKNOWNS;
        let size = per_stage * STAGES;
        for q in 0..B {
            for i in 0..per_stage {
                rows[(STAGES - 1) * per_stage + i][q] += ends[q][i];
            }
            for angle in R::UNKNOWNS..N {
                for (l, weight) in RADAU.integrate[STAGES - 1].iter().enumerate() {
                    rows[l * per_stage + angle - R::ANGLES][q] +=
                        duration_s * T::splat(*weight) * ends[q][angle];
                }
            }
        }
        let factors = &self.factors[pack * size * size..][..size * size];
        lu::solve_transposed(per_stage, 0, factors, rows);
    }
}
