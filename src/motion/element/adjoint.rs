//! Gradients of quantities of an element with respect to its start and the parameters.
//!
//! A quantity that is linear in the changes of the unknowns, with a weight for each, changes by
//! `weights . A^-1 (start_jacobian start - slopes parameters)`. The transposed system is solved for
//! the weights, once for each quantity, which are fewer than starts and parameters.

use super::{Element, Linearisation, assemble, unknowns};
use crate::motion::lu;
use crate::motion::radau::{RADAU, STAGES};
use crate::motion::reduced::{MOST_PARAMETERS, Reduced};
use crate::robot::Number;

impl<T: Number> Linearisation<T> {
    /// Linearises the elements of `pack` with respect to their start and the first `parameters` of
    /// the model's, too, and factors them. What comes of a singular system is not finite.
    #[inline(always)]
    pub fn linearise_all<const N: usize, R: Reduced<N>>(
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
            slopes.fill(none);
            model.sensitivity(&element.nodes[j], &element.stages[j], dy, parameters, slopes)
        });
        lu::factor(per_stage, matrix);
    }

    /// Solves the transposed system of `pack`, see [`Linearisation::linearise_all`], in place for
    /// the weights of `C` quantities, which are zero before a `first` stage; gives the derivatives
    /// of each with respect to the elements' start.
    #[inline(always)]
    pub fn solve_adjoint<const N: usize, R: Reduced<N>, const C: usize>(
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

    /// The same for the states at the elements' end, the weights of which are written to `rows`.
    #[inline(always)]
    pub fn solve_adjoint_of_end<const N: usize, R: Reduced<N>>(
        &self,
        pack: usize,
        duration_s: f64,
        rows: &mut [[T; N]],
    ) -> [[T; N]; N] {
        let per_stage = unknowns::<N, R>();
        rows.fill([T::of(0.0); N]);
        for i in 0..per_stage {
            rows[(STAGES - 1) * per_stage + i][i] = T::of(1.0);
        }
        if !R::INTEGRATED {
            return self.solve_adjoint::<N, R, N>(pack, STAGES - 1, rows);
        }
        // The last state is its start plus the integral of the one before it.
        for (l, weight) in RADAU.integrate[STAGES - 1].iter().enumerate() {
            rows[l * per_stage + N - 2][N - 1] = T::of(duration_s * weight);
        }
        let mut by_start = self.solve_adjoint::<N, R, N>(pack, 0, rows);
        by_start[N - 1][N - 1] += T::of(1.0);
        by_start
    }

    /// Subtracts from `sum` the derivatives of the residuals of `pack` with respect to the first
    /// `parameters`, each residual times its entry of an adjoint solution.
    #[inline(always)]
    pub fn add_by_parameters<const N: usize, R: Reduced<N>>(
        &self,
        pack: usize,
        parameters: usize,
        adjoint: impl Fn(usize) -> T,
        sum: &mut [T; MOST_PARAMETERS],
    ) {
        let size = unknowns::<N, R>() * STAGES;
        for (row, slopes) in self.slopes[pack * size..][..size].iter().enumerate() {
            let weight = adjoint(row);
            for column in 0..parameters {
                sum[column] -= weight * slopes[column];
            }
        }
    }
}
