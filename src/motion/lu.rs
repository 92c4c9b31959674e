//! Dense elimination for the small systems of one element, in place and without allocation.

/// Factors the `n x n` row-major `matrix` with row pivoting and solves for the `columns`
/// right-hand sides in the row-major `rhs`. `matrix` keeps the factors, `pivots` the row
/// exchanges. Returns `false` if the matrix is singular.
#[inline(always)]
pub(super) fn factor_and_solve(
    n: usize,
    columns: usize,
    matrix: &mut [f64],
    rhs: &mut [f64],
) -> bool {
    debug_assert!(matrix.len() == n * n && rhs.len() == n * columns);
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
        if pivot != k {
            swap_rows(matrix, n, k, pivot);
            swap_rows(rhs, columns, k, pivot);
        }
        let inverse = 1.0 / matrix[k * n + k];
        let (upper, lower) = matrix.split_at_mut((k + 1) * n);
        let pivot_row = &upper[k * n + k + 1..];
        let (rhs_upper, rhs_lower) = rhs.split_at_mut((k + 1) * columns);
        let rhs_row = &rhs_upper[k * columns..];
        for (row, right) in lower.chunks_exact_mut(n).zip(rhs_lower.chunks_exact_mut(columns)) {
            let factor = row[k] * inverse;
            if factor == 0.0 {
                continue;
            }
            for (entry, above) in row[k + 1..].iter_mut().zip(pivot_row) {
                *entry -= factor * above;
            }
            for (entry, above) in right.iter_mut().zip(rhs_row) {
                *entry -= factor * above;
            }
        }
    }
    for k in (0..n).rev() {
        let (upper, lower) = rhs.split_at_mut((k + 1) * columns);
        let right = &mut upper[k * columns..];
        let row = &matrix[k * n..(k + 1) * n];
        for (factor, below) in row[k + 1..].iter().zip(lower.chunks_exact(columns)) {
            for (entry, x) in right.iter_mut().zip(below) {
                *entry -= factor * x;
            }
        }
        let inverse = 1.0 / row[k];
        for entry in right.iter_mut() {
            *entry *= inverse;
        }
    }
    true
}

fn swap_rows(matrix: &mut [f64], width: usize, i: usize, j: usize) {
    let (upper, lower) = matrix.split_at_mut(j * width);
    upper[i * width..(i + 1) * width].swap_with_slice(&mut lower[..width]);
}

#[cfg(test)]
mod tests {
    use super::factor_and_solve;

    #[test]
    fn a_system_that_needs_pivoting_is_solved() {
        let mut matrix = [0.0, 2.0, 1.0, 1.0, 0.0, 3.0, 4.0, 1.0, 0.0];
        let mut rhs = [7.0, 10.0, 6.0];
        assert!(factor_and_solve(3, 1, &mut matrix, &mut rhs));
        for (x, known) in rhs.iter().zip([1.0, 2.0, 3.0]) {
            assert!((x - known).abs() < 1e-14, "{rhs:?}");
        }
    }

    #[test]
    fn a_singular_system_is_refused() {
        let mut matrix = [1.0, 2.0, 2.0, 4.0];
        assert!(!factor_and_solve(2, 1, &mut matrix, &mut [1.0, 1.0]));
    }
}
