//! Dense elimination for the small systems of one element, in place and without allocation.
//!
//! The sizes are known when the callers are compiled and small (8 to 20), which lets these
//! loops beat a general library; matrices are row-major slices.

/// Factors the `n x n` `matrix` with row pivoting; `pivots[k]` is the row exchanged with row
/// `k`. Returns `false` if the matrix is singular.
#[inline(always)]
pub(super) fn factor(n: usize, matrix: &mut [f64], pivots: &mut [usize]) -> bool {
    for k in 0..n {
        let mut pivot = k;
        let mut largest = matrix[k * n + k].abs();
        for i in k + 1..n {
            let size = matrix[i * n + k].abs();
            if size > largest {
                (pivot, largest) = (i, size);
            }
        }
        if largest == 0.0 || !largest.is_finite() {
            return false;
        }
        pivots[k] = pivot;
        if pivot != k {
            swap_rows(matrix, n, k, pivot);
        }
        let inverse = 1.0 / matrix[k * n + k];
        let (upper, lower) = matrix.split_at_mut((k + 1) * n);
        let pivot_row = &upper[k * n + k + 1..];
        for row in lower.chunks_exact_mut(n) {
            let factor = row[k] * inverse;
            row[k] = factor;
            for (entry, above) in row[k + 1..].iter_mut().zip(pivot_row) {
                *entry -= factor * above;
            }
        }
    }
    true
}

/// Solves for `columns` right-hand sides in place.
#[inline(always)]
pub(super) fn solve(n: usize, columns: usize, factors: &[f64], pivots: &[usize], rhs: &mut [f64]) {
    for k in 0..n {
        if pivots[k] != k {
            swap_rows(rhs, columns, k, pivots[k]);
        }
    }
    for k in 1..n {
        let (solved, rest) = rhs.split_at_mut(k * columns);
        let right = &mut rest[..columns];
        for (factor, above) in factors[k * n..k * n + k].iter().zip(solved.chunks_exact(columns)) {
            for (entry, x) in right.iter_mut().zip(above) {
                *entry -= factor * x;
            }
        }
    }
    for k in (0..n).rev() {
        let (rest, solved) = rhs.split_at_mut((k + 1) * columns);
        let right = &mut rest[k * columns..];
        let row = &factors[k * n..(k + 1) * n];
        for (factor, below) in row[k + 1..].iter().zip(solved.chunks_exact(columns)) {
            for (entry, x) in right.iter_mut().zip(below) {
                *entry -= factor * x;
            }
        }
        let inverse = 1.0 / row[k];
        for entry in right.iter_mut() {
            *entry *= inverse;
        }
    }
}

#[inline(always)]
fn swap_rows(matrix: &mut [f64], width: usize, i: usize, j: usize) {
    let (upper, lower) = matrix.split_at_mut(j * width);
    upper[i * width..(i + 1) * width].swap_with_slice(&mut lower[..width]);
}

#[cfg(test)]
mod tests {
    use super::{factor, solve};

    #[test]
    fn a_system_that_needs_pivoting_is_solved() {
        let mut matrix = [0.0, 2.0, 1.0, 1.0, 0.0, 3.0, 4.0, 1.0, 0.0];
        let mut pivots = [0; 3];
        assert!(factor(3, &mut matrix, &mut pivots));
        // Two right-hand sides, with the solutions (1, 2, 3) and (-1, 0, 2).
        let mut rhs = [7.0, 2.0, 10.0, 5.0, 6.0, -4.0];
        solve(3, 2, &matrix, &pivots, &mut rhs);
        for (x, known) in rhs.iter().zip([1.0, -1.0, 2.0, 0.0, 3.0, 2.0]) {
            assert!((x - known).abs() < 1e-14, "{rhs:?}");
        }
    }

    #[test]
    fn a_singular_system_is_refused() {
        assert!(!factor(2, &mut [1.0, 2.0, 2.0, 4.0], &mut [0; 2]));
    }
}
