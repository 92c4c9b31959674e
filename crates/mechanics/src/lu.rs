//! In-place LU factorisation of the small linear systems of one collocation element, without allocation.
//!
//! A system has one block of equations per stage, with a few unknowns each. The number of unknowns is a
//! compile-time constant, which makes this faster than a general library. Neither rows nor blocks are
//! permuted: the collocation rule is coercive and masses and friction are positive, so the pivots are
//! positive for elements that are short enough to be accurate; equations with constraints come in an order in which pivots
//! are large. If a pivot vanishes, the results are not finite.
//!
//! Reference: E. Hairer and G. Wanner, *Solving Ordinary Differential Equations II*, 2nd ed.,
//! Springer 1996, section IV.14.

use trilink_robot::Number;

use super::radau::STAGES;

/// Coupling of the unknowns of one stage to the equations of another stage; row-major.
type Block<const P: usize, T> = [[T; P]; P];

/// Factors in place a row-major matrix of row-major blocks with `per_stage` equations each; the diagonal
/// blocks are replaced by the inverses of the pivot blocks.
#[inline(always)]
pub(super) fn factor<T: Number>(per_stage: usize, blocks: &mut [T]) {
    match per_stage {
        2 => factor_blocks::<2, T>(blocks),
        3 => factor_blocks::<3, T>(blocks),
        4 => factor_blocks::<4, T>(blocks),
        5 => factor_blocks::<5, T>(blocks),
        6 => factor_blocks::<6, T>(blocks),
        7 => factor_blocks::<7, T>(blocks),
        8 => factor_blocks::<8, T>(blocks),
        9 => factor_blocks::<9, T>(blocks),
        10 => factor_blocks::<10, T>(blocks),
        _ => unreachable!("no model has this number of unknowns"),
    }
}

/// Solves in place, for `columns` right-hand sides, a system whose matrix was factored by [`factor`].
#[inline(always)]
pub(super) fn solve<T: Number>(per_stage: usize, columns: usize, factors: &[T], rhs: &mut [T]) {
    match per_stage {
        2 => solve_blocks::<2, T>(columns, factors, rhs),
        3 => solve_blocks::<3, T>(columns, factors, rhs),
        4 => solve_blocks::<4, T>(columns, factors, rhs),
        5 => solve_blocks::<5, T>(columns, factors, rhs),
        6 => solve_blocks::<6, T>(columns, factors, rhs),
        7 => solve_blocks::<7, T>(columns, factors, rhs),
        8 => solve_blocks::<8, T>(columns, factors, rhs),
        9 => solve_blocks::<9, T>(columns, factors, rhs),
        10 => solve_blocks::<10, T>(columns, factors, rhs),
        _ => unreachable!("no model has this number of unknowns"),
    }
}

/// Solves in place, for `C` right-hand sides that are zero before stage `first`, the transpose of a system
/// whose matrix was factored by [`factor`].
#[inline(always)]
pub(super) fn solve_transposed<T: Number, const C: usize>(
    per_stage: usize,
    first: usize,
    factors: &[T],
    rhs: &mut [[T; C]],
) {
    match per_stage {
        2 => solve_transposed_blocks::<2, C, T>(first, factors, rhs),
        3 => solve_transposed_blocks::<3, C, T>(first, factors, rhs),
        4 => solve_transposed_blocks::<4, C, T>(first, factors, rhs),
        5 => solve_transposed_blocks::<5, C, T>(first, factors, rhs),
        6 => solve_transposed_blocks::<6, C, T>(first, factors, rhs),
        7 => solve_transposed_blocks::<7, C, T>(first, factors, rhs),
        8 => solve_transposed_blocks::<8, C, T>(first, factors, rhs),
        9 => solve_transposed_blocks::<9, C, T>(first, factors, rhs),
        10 => solve_transposed_blocks::<10, C, T>(first, factors, rhs),
        _ => unreachable!("no model has this number of unknowns"),
    }
}

#[inline(always)]
fn factor_blocks<const P: usize, T: Number>(blocks: &mut [T]) {
    let blocks = blocks.as_chunks_mut::<P>().0.as_chunks_mut::<P>().0;
    for k in 0..STAGES {
        let inverse = inverse(blocks[k * STAGES + k]);
        blocks[k * STAGES + k] = inverse;
        for j in k + 1..STAGES {
            let mut factor = [[T::splat(0.0); P]; P];
            add_product(&mut factor, &blocks[j * STAGES + k], &inverse);
            blocks[j * STAGES + k] = factor;
            let factor = factor.map(|row| row.map(|entry| -entry));
            for l in k + 1..STAGES {
                let above = blocks[k * STAGES + l];
                add_product(&mut blocks[j * STAGES + l], &factor, &above);
            }
        }
    }
}

#[inline(always)]
fn solve_blocks<const P: usize, T: Number>(columns: usize, factors: &[T], rhs: &mut [T]) {
    let factors = factors.as_chunks::<P>().0.as_chunks::<P>().0;
    let width = P * columns;
    for k in 1..STAGES {
        let (solved, rest) = rhs.split_at_mut(k * width);
        for (l, above) in solved.chunks_exact(width).enumerate() {
            subtract(columns, &factors[k * STAGES + l], above, &mut rest[..width]);
        }
    }
    for k in (0..STAGES).rev() {
        let (rest, solved) = rhs.split_at_mut((k + 1) * width);
        let right = &mut rest[k * width..];
        for (l, below) in (k + 1..STAGES).zip(solved.chunks_exact(width)) {
            subtract(columns, &factors[k * STAGES + l], below, right);
        }
        let inverse = &factors[k * STAGES + k];
        for column in 0..columns {
            let entries: [T; P] = std::array::from_fn(|i| right[i * columns + column]);
            for i in 0..P {
                right[i * columns + column] = dot(&inverse[i], &entries);
            }
        }
    }
}

#[inline(always)]
fn solve_transposed_blocks<const P: usize, const C: usize, T: Number>(
    first: usize,
    factors: &[T],
    rhs: &mut [[T; C]],
) {
    let factors = factors.as_chunks::<P>().0.as_chunks::<P>().0;
    let rhs = rhs.as_chunks_mut::<P>().0;
    for k in first..STAGES {
        let (solved, rest) = rhs.split_at_mut(k);
        for l in first..k {
            subtract_transposed(&factors[l * STAGES + k], &solved[l], &mut rest[0]);
        }
        let inverse = &factors[k * STAGES + k];
        let entries = rest[0];
        for i in 0..P {
            for column in 0..C {
                let first = inverse[0][i] * entries[0][column];
                rest[0][i][column] =
                    (1..P).fold(first, |sum, m| sum + inverse[m][i] * entries[m][column]);
            }
        }
    }
    for k in (0..STAGES - 1).rev() {
        let (rest, solved) = rhs.split_at_mut(k + 1);
        for (j, below) in (k + 1..STAGES).zip(solved) {
            subtract_transposed(&factors[j * STAGES + k], below, &mut rest[k]);
        }
    }
}

/// Computes `right -= factor^T x` for every column.
#[inline(always)]
fn subtract_transposed<const P: usize, const C: usize, T: Number>(
    factor: &Block<P, T>,
    x: &[[T; C]; P],
    right: &mut [[T; C]; P],
) {
    for column in 0..C {
        let entries: [T; P] = std::array::from_fn(|m| x[m][column]);
        for i in 0..P {
            let first = factor[0][i] * entries[0];
            right[i][column] -= (1..P).fold(first, |sum, m| sum + factor[m][i] * entries[m]);
        }
    }
}

/// Computes `sum += left right`.
#[inline(always)]
fn add_product<const P: usize, T: Number>(
    sum: &mut Block<P, T>,
    left: &Block<P, T>,
    right: &Block<P, T>,
) {
    for i in 0..P {
        for k in 0..P {
            for m in 0..P {
                sum[i][m] += left[i][k] * right[k][m];
            }
        }
    }
}

/// Computes `right -= factor x` for every column.
#[inline(always)]
fn subtract<const P: usize, T: Number>(
    columns: usize,
    factor: &Block<P, T>,
    x: &[T],
    right: &mut [T],
) {
    for i in 0..P {
        for column in 0..columns {
            let entries = std::array::from_fn(|k| x[k * columns + column]);
            right[i * columns + column] -= dot(&factor[i], &entries);
        }
    }
}

#[inline(always)]
fn dot<const P: usize, T: Number>(row: &[T; P], column: &[T; P]) -> T {
    (1..P).fold(row[0] * column[0], |sum, k| sum + row[k] * column[k])
}

/// Inverts a block by Gauss-Jordan elimination.
#[inline(always)]
fn inverse<const P: usize, T: Number>(mut block: Block<P, T>) -> Block<P, T> {
    for k in 0..P {
        let pivot = T::splat(1.0) / block[k][k];
        block[k][k] = T::splat(1.0);
        for m in 0..P {
            block[k][m] = block[k][m] * pivot;
        }
        let pivot_row = block[k];
        for i in (0..P).filter(|i| *i != k) {
            let factor = block[i][k];
            block[i][k] = T::splat(0.0);
            for m in 0..P {
                block[i][m] -= factor * pivot_row[m];
            }
        }
    }
    block
}

#[cfg(test)]
mod tests {
    use super::{STAGES, factor, solve, solve_transposed};

    /// Returns a block matrix with two equations per stage and the given entries, and its number of rows.
    fn matrix(entry: impl Fn(usize, usize) -> f64) -> (Vec<f64>, usize) {
        let n = 2 * STAGES;
        let mut blocks = vec![0.0; n * n];
        for row in 0..n {
            for column in 0..n {
                let block = row / 2 * STAGES + column / 2;
                blocks[4 * block + 2 * (row % 2) + column % 2] = entry(row, column);
            }
        }
        (blocks, n)
    }

    /// Returns an entry of a nonsingular test matrix.
    fn entry(row: usize, column: usize) -> f64 {
        if row == column { 3.0 } else { 1.0 / (row as f64 + 2.0 * column as f64 + 1.0) }
    }

    #[test]
    fn a_system_is_solved_for_every_right_hand_side() {
        let known = |row: usize, side: usize| row as f64 - 4.0 * side as f64;
        let (mut blocks, n) = matrix(entry);
        let right = |row: usize, side: usize| -> f64 {
            (0..n).map(|column| entry(row, column) * known(column, side)).sum()
        };
        let mut rhs: Vec<f64> = (0..n).flat_map(|row| [right(row, 0), right(row, 1)]).collect();
        factor(2, &mut blocks);
        solve(2, 2, &blocks, &mut rhs);
        for (i, x) in rhs.iter().enumerate() {
            assert!((x - known(i / 2, i % 2)).abs() < 1e-13, "{rhs:?}");
        }
    }

    #[test]
    fn a_transposed_system_is_solved_from_the_first_nonzero_stage() {
        let (mut blocks, n) = matrix(entry);
        factor(2, &mut blocks);
        for first in 0..STAGES {
            let right =
                |row: usize, side: usize| if row < 2 * first { 0.0 } else { (row + side) as f64 };
            let mut rhs: Vec<[f64; 2]> = (0..n).map(|row| [right(row, 0), right(row, 1)]).collect();
            solve_transposed(2, first, &blocks, &mut rhs);
            for column in 0..n {
                for side in 0..2 {
                    let sum: f64 = (0..n).map(|row| entry(row, column) * rhs[row][side]).sum();
                    assert!((sum - right(column, side)).abs() < 1e-12, "{first}: {rhs:?}");
                }
            }
        }
    }

    #[test]
    fn a_singular_system_has_no_finite_solution() {
        let (mut blocks, n) = matrix(|_, _| 1.0);
        let mut rhs = vec![1.0; n];
        factor(2, &mut blocks);
        solve(2, 1, &blocks, &mut rhs);
        assert!(rhs.iter().all(|x| !x.is_finite()), "{rhs:?}");
    }
}
