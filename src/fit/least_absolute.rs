//! Least absolute deviations (L1 regression): the minimum of a weighted sum of absolute values of
//! affine functions in a box, exactly.
//!
//! The minimum is at a vertex, where as many of the functions as there are variables are zero.
//! From vertex to vertex the descent follows the edge with the steepest fall, to the weighted
//! median of the breakpoints on it. A linear program with two rows per residual has the same
//! solution; a general solver takes longer for it than all motions of a campaign take.
//!
//! Reference: P. Bloomfield and W. L. Steiger, *Least Absolute Deviations*, Birkhaeuser 1983,
//! chapter 7.

use nalgebra::{DMatrix, DVector};

/// An affine function of the variables; it contributes `weight |slope . x + value|`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Residual {
    pub weight: f64,
    pub value: f64,
    pub slope: Vec<f64>,
}

impl Residual {
    pub fn at(&self, x: &DVector<f64>) -> f64 {
        self.value + self.along(x)
    }

    fn along(&self, direction: &DVector<f64>) -> f64 {
        dot(&self.slope, direction.as_slice())
    }
}

/// The weighted sum of the residuals' absolute values at `x`.
pub(super) fn sum(residuals: &[Residual], x: &DVector<f64>) -> f64 {
    residuals.iter().map(|residual| residual.weight * residual.at(x).abs()).sum()
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The `x` with the smallest [`sum`] and with every `x[i]` within `bounds[i]`, which must
/// hold 0; a `held` variable stays there.
pub(super) fn minimise(
    residuals: &[Residual],
    bounds: &[[f64; 2]],
    held: Option<usize>,
) -> DVector<f64> {
    if let Some(held) = held {
        let (mut others, mut residuals) = (bounds.to_vec(), residuals.to_vec());
        others.remove(held);
        for residual in &mut residuals {
            residual.slope.remove(held);
        }
        return minimise(&residuals, &others, None).insert_row(held, 0.0);
    }
    const MAX_EDGES: usize = 500;
    let count = bounds.len();
    let slopes = residuals.iter().flat_map(|each| each.slope.iter().map(|a| a * each.weight));
    let total: f64 = slopes.map(f64::abs).sum();
    let mut all = residuals.to_vec();
    // Two walls whose slopes cancel in between and outweigh everything outside.
    let unit = |i: usize| (0..count).map(|j| if i == j { 1.0 } else { 0.0 }).collect::<Vec<_>>();
    for (i, bounds) in bounds.iter().enumerate() {
        let weight = 1e3 * total + 1.0;
        all.extend(bounds.map(|bound| Residual { weight, value: -bound, slope: unit(i) }));
    }
    // The first vertex is the origin, held by residuals without weight.
    let first = all.len();
    all.extend((0..count).map(|i| Residual { weight: 0.0, value: 0.0, slope: unit(i) }));
    let mut basis: Vec<usize> = (first..first + count).collect();
    let mut x = DVector::zeros(count);
    for _ in 0..MAX_EDGES {
        let rows = DMatrix::from_fn(count, count, |i, j| all[basis[i]].slope[j]);
        let Some(edges) = rows.try_inverse() else { return x };
        let Some((leaves, sign)) = steepest(&all, &basis, &edges, &x) else { return x };
        let direction = edges.column(leaves) * sign;
        let next = breakpoint(&all, &basis, leaves, &x, &direction);
        let Some((enters, length)) = next else { return x };
        x += &direction * length;
        basis[leaves] = enters;
    }
    x
}

/// Which residual of the basis to leave, and to which side, for the steepest fall; `None` at the
/// minimum.
fn steepest(
    all: &[Residual],
    basis: &[usize],
    edges: &DMatrix<f64>,
    x: &DVector<f64>,
) -> Option<(usize, f64)> {
    let mut slope = DVector::<f64>::zeros(basis.len());
    let mut size = 0.0_f64;
    for (_, residual) in all.iter().enumerate().filter(|(k, _)| !basis.contains(k)) {
        let signed = residual.weight * residual.at(x).signum();
        for (sum, a) in slope.iter_mut().zip(&residual.slope) {
            *sum += signed * a;
            size = size.max((signed * a).abs());
        }
    }
    let mut best: Option<(usize, f64, f64)> = None;
    for (leaves, &k) in basis.iter().enumerate() {
        let along = slope.dot(&edges.column(leaves));
        // Leaving a residual costs its own weight.
        let fall = along.abs() - all[k].weight;
        let rounding = 1e-12 * size * edges.column(leaves).amax();
        if fall > rounding && best.is_none_or(|(_, _, most)| fall > most) {
            best = Some((leaves, -along.signum(), fall));
        }
    }
    best.map(|(leaves, sign, _)| (leaves, sign))
}

/// The residual whose breakpoint ends the fall along a direction, and its distance.
fn breakpoint(
    all: &[Residual],
    basis: &[usize],
    leaves: usize,
    x: &DVector<f64>,
    direction: &DVector<f64>,
) -> Option<(usize, f64)> {
    let mut slope = all[basis[leaves]].weight;
    let mut breakpoints = Vec::new();
    for (k, residual) in all.iter().enumerate().filter(|(k, _)| !basis.contains(k)) {
        let (value, along) = (residual.at(x), residual.along(direction));
        slope += residual.weight * value.signum() * along;
        let distance = -value / along;
        if distance > 0.0 && distance.is_finite() {
            breakpoints.push((distance, 2.0 * residual.weight * along.abs(), k));
        }
    }
    breakpoints.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
    for (distance, change, k) in breakpoints {
        slope += change;
        if slope >= 0.0 {
            return Some((k, distance));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn one_variable_s_minimum_is_the_weighted_median() {
        let residual = |weight: f64, zero: f64| Residual { weight, value: -zero, slope: vec![1.0] };
        let residuals =
            [residual(1.0, 5.0), residual(1.0, -2.0), residual(3.0, 1.0), residual(1.5, 2.0)];
        assert_eq!(minimise(&residuals, &[[-10.0, 10.0]], None)[0], 1.0);
        assert_eq!(minimise(&residuals, &[[-10.0, 0.5]], None)[0], 0.5);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        #[test]
        fn no_neighbour_is_lower(
            residuals in prop::collection::vec(
                (0.0..3.0, -2.0..2.0, prop::collection::vec(-2.0..2.0, 3)),
                1..40,
            ),
            tries in prop::collection::vec(prop::collection::vec(-1.0..1.0, 3), 50),
        ) {
            let residuals: Vec<Residual> = residuals
                .into_iter()
                .map(|(weight, value, slope)| Residual { weight, value, slope })
                .collect();
            let bounds = [[-1.0, 0.5], [-0.2, 1.0], [0.0, 1.0]];
            let x = minimise(&residuals, &bounds, None);
            for (x, [low, high]) in x.iter().zip(bounds) {
                prop_assert!((low - 1e-9..=high + 1e-9).contains(x), "{x}");
            }
            // Convex: what is lowest among its neighbours is lowest of all.
            let lowest = sum(&residuals, &x);
            for other in tries {
                for size in [1.0, 0.1, 1e-3] {
                    let other = DVector::from_fn(3, |i, _| -> f64 {
                        f64::clamp(x[i] + size * other[i], bounds[i][0], bounds[i][1])
                    });
                    prop_assert!(sum(&residuals, &other) >= lowest - 1e-9 * (1.0 + lowest));
                }
            }
        }
    }
}
