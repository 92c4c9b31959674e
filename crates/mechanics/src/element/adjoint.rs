//! Gradients of quantities of an element with respect to its start and the parameters.
//!
//! A quantity that is linear in the changes of the unknowns, with a weight for each, changes by
//! `weights . A^-1 (start_jacobian start - slopes parameters)`. The transposed system is solved for
//! the weights, once for each quantity, which are fewer than starts and parameters.

use trilink_robot::Number;

use super::{Element, Linearisation, assemble, unknowns};
use crate::lu;
use crate::radau::{RADAU, STAGES};
use crate::reduced::{MOST_PARAMETERS, Reduced};

/// Most unknowns of an element.
const MOST_UNKNOWNS: usize = 4 * STAGES;

impl<T: Number> Linearisation<T> {
    /// Linearises the elements of `pack` with respect to their start and the first `parameters` of
    /// the model's, too, and factors them. What comes of a singular system is not finite.
    #[inline(always)]
    pub(crate) fn linearise_all<const N: usize, R: Reduced<N>>(
        &mut self,
        pack: usize,
        model: &R,
        element: &Element<N, R, T>,
        parameters: usize,
    ) {
        let per_stage = unknowns::<N, R>();
        let size = per_stage * STAGES;
        let none = [T::of(0.0); MOST_PARAMETERS];
        self.slopes.resize(self.slopes.len().max((pack + 1) * size), none);
        let matrix = &mut self.factors[pack * size * size..][..size * size];
        let start_jacobian = &mut self.transfer[pack * size * N..][..size * N];
        let slopes = &mut self.slopes[pack * size..][..size];
        assemble(element, matrix, start_jacobian, |j, dy| {
            let slopes = &mut slopes[j * per_stage..][..per_stage];
            slopes.iter_mut().for_each(|row| row[..parameters].fill(T::of(0.0)));
            model.sensitivity(&element.nodes[j], &element.stages[j], dy, parameters, slopes)
        });
        lu::factor(per_stage, matrix);
    }

    /// Solves the transposed system of `pack`, see [`Linearisation::linearise_all`], in place for
    /// the weights of `C` quantities, which are zero before a `first` stage; gives the derivatives
    /// of each with respect to the elements' start.
    #[inline(always)]
    pub(crate) fn solve_adjoint<const N: usize, R: Reduced<N>, const C: usize>(
        &self,
        pack: usize,
        first: usize,
        rows: &mut [[T; C]],
    ) -> [[T; N]; C] {
        let per_stage = unknowns::<N, R>();
        let size = per_stage * STAGES;
        let factors = &self.factors[pack * size * size..][..size * size];
        let start_jacobian = self.transfer[pack * size * N..][..size * N].as_chunks::<N>().0;
        lu::solve_transposed(per_stage, first, factors, rows);
        let mut by_start = [[T::of(0.0); N]; C];
        for (row, jacobian) in rows.iter().zip(start_jacobian) {
            for q in 0..C {
                for m in 0..N {
                    by_start[q][m] += row[q] * jacobian[m];
                }
            }
        }
        by_start
    }

    /// The same for the states at the elements' end; their adjoint solutions are left in `rows`.
    #[inline(always)]
    pub(crate) fn solve_adjoint_of_end<const N: usize, R: Reduced<N>>(
        &self,
        pack: usize,
        duration_s: T,
        rows: &mut [[T; N]],
    ) -> [[T; N]; N] {
        let per_stage = unknowns::<N, R>();
        rows.fill([T::of(0.0); N]);
        for i in 0..per_stage {
            rows[(STAGES - 1) * per_stage + i][i] = T::of(1.0);
        }
        let mut by_start = self.solve_adjoint::<N, R, N>(pack, STAGES - 1, rows);
        if R::INTEGRATED {
            let last;
            (last, by_start[N - 1]) = self.solve_adjoint_of_last::<N, R>(pack, duration_s);
            rows.iter_mut().zip(last).for_each(|(row, [last])| row[N - 1] = last);
        }
        by_start
    }

    /// The same for the last state at the elements' end alone.
    #[inline(always)]
    pub(crate) fn solve_adjoint_of_last<const N: usize, R: Reduced<N>>(
        &self,
        pack: usize,
        duration_s: T,
    ) -> ([[T; 1]; MOST_UNKNOWNS], [T; N]) {
        let per_stage = unknowns::<N, R>();
        let mut rows = [[T::of(0.0)]; MOST_UNKNOWNS];
        let own = &mut rows[..per_stage * STAGES];
        if !R::INTEGRATED {
            own[STAGES * per_stage - 1] = [T::of(1.0)];
            let [by_start] = self.solve_adjoint::<N, R, 1>(pack, STAGES - 1, own);
            return (rows, by_start);
        }
        // It is its start plus the integral of the one before it.
        for (l, weight) in RADAU.integrate[STAGES - 1].iter().enumerate() {
            own[l * per_stage + N - 2] = [duration_s * T::of(*weight)];
        }
        let [mut by_start] = self.solve_adjoint::<N, R, 1>(pack, 0, own);
        by_start[N - 1] += T::of(1.0);
        (rows, by_start)
    }

    /// Subtracts from `sums` the derivatives of the residuals of `pack` with respect to the first
    /// `parameters`, each residual times its entry of the adjoint solutions of `C` quantities.
    #[inline(always)]
    pub(crate) fn add_by_parameters<const N: usize, R: Reduced<N>, const C: usize>(
        &self,
        pack: usize,
        parameters: usize,
        adjoint: &[[T; C]],
        sums: &mut [[T; MOST_PARAMETERS]; C],
    ) {
        let size = unknowns::<N, R>() * STAGES;
        let slopes = &self.slopes[pack * size..][..size];
        for column in 0..parameters {
            let mut sum = [T::of(0.0); C];
            for (slopes, adjoint) in slopes.iter().zip(adjoint) {
                for q in 0..C {
                    sum[q] += adjoint[q] * slopes[column];
                }
            }
            for q in 0..C {
                sums[q][column] -= sum[q];
            }
        }
    }
}
