//! Adjoint gradients of quantities on a collocation element with respect to the state at its start and to the
//! parameters.
//!
//! A quantity that depends linearly on the changes in the unknowns, with given weights, changes by `weights .
//! A^-1 (start_jacobian start - slopes parameters)`. The transposed system is solved once per quantity,
//! because quantities are fewer than starts and parameters.

use trilink_robot::Number;

use super::{Element, Linearisation, Stages, assemble};
use crate::lu;
use crate::radau::{RADAU, STAGES};
use crate::reduced::{MAX_PARAMETERS, Reduced, ThreeLink};

/// Maximum number of unknowns of a collocation element.
const MAX_UNKNOWNS: usize = 4 * STAGES;

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

    /// Linearises the elements in pack `pack` (one per SIMD lane of `T`) with respect to their unknowns, the
    /// states at their starts and the first `parameters` variables of the model, and factors them. The
    /// results of a singular system are not finite.
    #[inline(always)]
    pub(crate) fn linearise_all<const N: usize, R: ThreeLink<N>>(
        &mut self,
        pack: usize,
        model: &R,
        element: &Element<N, R, T>,
        parameters: usize,
    ) {
        let per_stage = R::UNKNOWNS;
        let size = per_stage * STAGES;
        let none = [T::splat(0.0); MAX_PARAMETERS];
        self.slopes.resize(self.slopes.len().max((pack + 1) * size), none);
        let matrix = &mut self.factors[pack * size * size..][..size * size];
        let start_jacobian = &mut self.transfer[pack * size * N..][..size * N];
        let slopes = &mut self.slopes[pack * size..][..size];
        assemble(element, matrix, start_jacobian, |j, dy| {
            let slopes = &mut slopes[j * per_stage..][..per_stage];
            slopes.iter_mut().for_each(|row| row[..parameters].fill(T::splat(0.0)));
            model.sensitivity(&element.nodes[j], &element.stages[j], dy, parameters, slopes)
        });
        lu::factor(per_stage, matrix);
    }

    /// Solves the transposed system of the elements in pack `pack` (one per SIMD lane; see
    /// [`Linearisation::linearise_all`]) in place. The right-hand sides `rows` are the weights of the
    /// unknowns in `C` quantities and must be zero before stage `first`. Returns the derivatives of each
    /// quantity with respect to the states at the elements' starts.
    #[inline(always)]
    pub(crate) fn solve_adjoint<const N: usize, R: ThreeLink<N>, const C: usize>(
        &self,
        pack: usize,
        first: usize,
        rows: &mut [[T; C]],
    ) -> [[T; N]; C] {
        let per_stage = R::UNKNOWNS;
        let size = per_stage * STAGES;
        let factors = &self.factors[pack * size * size..][..size * size];
        let start_jacobian = self.transfer[pack * size * N..][..size * N].as_chunks::<N>().0;
        lu::solve_transposed(per_stage, first, factors, rows);
        let mut start_gradients = [[T::splat(0.0); N]; C];
        for (row, jacobian) in rows.iter().zip(start_jacobian) {
            for q in 0..C {
                for m in 0..N {
                    start_gradients[q][m] += row[q] * jacobian[m];
                }
            }
        }
        start_gradients
    }

    /// Solves the transposed system of the elements in pack `pack` (one per SIMD lane; see
    /// [`Linearisation::linearise_all`]) for the states at the elements' ends and stores the adjoint
    /// solutions in `rows`. Returns the derivatives of the states at the ends with respect to those at the
    /// elements' starts.
    #[inline(always)]
    pub(crate) fn solve_adjoint_of_end<const N: usize, R: ThreeLink<N>>(
        &self,
        pack: usize,
        duration_s: T,
        rows: &mut [[T; N]],
    ) -> [[T; N]; N] {
        let per_stage = R::UNKNOWNS;
        rows.fill([T::splat(0.0); N]);
        for i in 0..per_stage {
            rows[(STAGES - 1) * per_stage + i][i] = T::splat(1.0);
        }
        let mut start_gradients = self.solve_adjoint::<N, R, N>(pack, STAGES - 1, rows);
        if R::INTEGRATED {
            let last;
            (last, start_gradients[N - 1]) = self.solve_adjoint_of_last::<N, R>(pack, duration_s);
            rows.iter_mut().zip(last).for_each(|(row, [last])| row[N - 1] = last);
        }
        start_gradients
    }

    /// Solves the transposed system of the elements in pack `pack` (one per SIMD lane; see
    /// [`Linearisation::linearise_all`]) for only the last state variable at the elements' ends. Returns the
    /// adjoint solution and the derivatives of that variable with respect to the states at the elements'
    /// starts.
    #[inline(always)]
    pub(crate) fn solve_adjoint_of_last<const N: usize, R: ThreeLink<N>>(
        &self,
        pack: usize,
        duration_s: T,
    ) -> ([[T; 1]; MAX_UNKNOWNS], [T; N]) {
        let per_stage = R::UNKNOWNS;
        let mut rows = [[T::splat(0.0)]; MAX_UNKNOWNS];
        let own = &mut rows[..per_stage * STAGES];
        if !R::INTEGRATED {
            own[STAGES * per_stage - 1] = [T::splat(1.0)];
            let [start_gradients] = self.solve_adjoint::<N, R, 1>(pack, STAGES - 1, own);
            return (rows, start_gradients);
        }
        // The last state is its value at the start plus the integral of the preceding state.
        for (l, weight) in RADAU.integrate[STAGES - 1].iter().enumerate() {
            own[l * per_stage + N - 2] = [duration_s * T::splat(*weight)];
        }
        let [mut start_gradients] = self.solve_adjoint::<N, R, 1>(pack, 0, own);
        start_gradients[N - 1] += T::splat(1.0);
        (rows, start_gradients)
    }

    /// Subtracts from `sums` the derivatives of the residuals of the elements in pack `pack` with respect to
    /// the first `parameters` variables of the model, weighted by the adjoint solutions of `C` quantities.
    #[inline(always)]
    pub(crate) fn subtract_parameter_gradients<const N: usize, R: ThreeLink<N>, const C: usize>(
        &self,
        pack: usize,
        parameters: usize,
        adjoint: &[[T; C]],
        sums: &mut [[T; MAX_PARAMETERS]; C],
    ) {
        let size = R::UNKNOWNS * STAGES;
        let slopes = &self.slopes[pack * size..][..size];
        for column in 0..parameters {
            let mut sum = [T::splat(0.0); C];
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
