//! Least absolute deviations: the minimum of a weighted sum of absolute values of affine
//! functions in a box, exactly.
//!
//! The minimum is at a vertex, where as many of the functions as there are variables are zero.
//! From vertex to vertex the descent goes along the edge that falls most, to the weighted median
//! of the kinks on it. A linear program with two rows per term says the same; a general solver
//! takes longer for it than the motions of a whole campaign take to solve for.
//!
//! Reference: P. Bloomfield and W. L. Steiger, *Least Absolute Deviations*, Birkhaeuser 1983,
//! chapter 7.

use nalgebra::{DMatrix, DVector};

/// One term `weight |slope . x + value|`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Term {
    pub weight: f64,
    pub value: f64,
    pub slope: Vec<f64>,
}

impl Term {
    fn at(&self, x: &DVector<f64>) -> f64 {
        self.value + self.along(x)
    }

    fn along(&self, direction: &DVector<f64>) -> f64 {
        self.slope.iter().zip(direction.iter()).map(|(a, b)| a * b).sum()
    }
}

/// Sum of the terms at `x`.
pub(super) fn sum(terms: &[Term], x: &DVector<f64>) -> f64 {
    terms.iter().map(|term| term.weight * term.at(x).abs()).sum()
}

/// The `x` with the smallest sum of `terms` and with every `x[i]` within `bounds[i]`, which must
/// hold 0.
pub(super) fn minimise(terms: &[Term], bounds: &[[f64; 2]]) -> DVector<f64> {
    const MOST_EDGES: usize = 500;
    let count = bounds.len();
    let total: f64 =
        terms.iter().flat_map(|term| term.slope.iter().map(|a| (a * term.weight).abs())).sum();
    let mut all = terms.to_vec();
    // Two walls whose slopes cancel in between and outweigh everything outside.
    let unit = |i: usize| (0..count).map(|j| if i == j { 1.0 } else { 0.0 }).collect::<Vec<_>>();
    for (i, bounds) in bounds.iter().enumerate() {
        let wall = |bound: &f64| Term { weight: 1e3 * total + 1.0, value: -bound, slope: unit(i) };
        all.extend(bounds.iter().map(wall));
    }
    // The first vertex is the origin, held by terms that weigh nothing.
    let first = all.len();
    all.extend((0..count).map(|i| Term { weight: 0.0, value: 0.0, slope: unit(i) }));
    let mut basis: Vec<usize> = (first..first + count).collect();
    let mut x = DVector::zeros(count);
    for _ in 0..MOST_EDGES {
        let rows = DMatrix::from_fn(count, count, |i, j| all[basis[i]].slope[j]);
        let Some(edges) = rows.try_inverse() else { return x };
        let Some((leaves, sign)) = steepest(&all, &basis, &edges, &x) else { return x };
        let direction = edges.column(leaves) * sign;
        let Some((enters, length)) = kink(&all, &basis, leaves, &x, &direction) else { return x };
        x += &direction * length;
        basis[leaves] = enters;
    }
    x
}

/// Which term of the basis to leave, and to which side, for the steepest fall; `None` at the
/// minimum.
fn steepest(
    all: &[Term],
    basis: &[usize],
    edges: &DMatrix<f64>,
    x: &DVector<f64>,
) -> Option<(usize, f64)> {
    let mut slope = DVector::<f64>::zeros(basis.len());
    let mut size = 0.0_f64;
    for (k, term) in all.iter().enumerate() {
        if !basis.contains(&k) {
            let signed = term.weight * term.at(x).signum();
            for (sum, a) in slope.iter_mut().zip(&term.slope) {
                *sum += signed * a;
                size = size.max((signed * a).abs());
            }
        }
    }
    let mut best: Option<(usize, f64, f64)> = None;
    for (leaves, &k) in basis.iter().enumerate() {
        let along = slope.dot(&edges.column(leaves));
        // Leaving the term costs its own weight.
        let fall = along.abs() - all[k].weight;
        let rounding = 1e-12 * size * edges.column(leaves).amax();
        if fall > rounding && best.is_none_or(|(_, _, most)| fall > most) {
            best = Some((leaves, -along.signum(), fall));
        }
    }
    best.map(|(leaves, sign, _)| (leaves, sign))
}

/// The term whose kink ends the fall along a direction, and how far away it is.
fn kink(
    all: &[Term],
    basis: &[usize],
    leaves: usize,
    x: &DVector<f64>,
    direction: &DVector<f64>,
) -> Option<(usize, f64)> {
    let mut slope = all[basis[leaves]].weight;
    let mut kinks = Vec::new();
    for (k, term) in all.iter().enumerate() {
        if basis.contains(&k) {
            continue;
        }
        let (value, along) = (term.at(x), term.along(direction));
        slope += term.weight * value.signum() * along;
        let distance = -value / along;
        if distance > 0.0 && distance.is_finite() {
            kinks.push((distance, 2.0 * term.weight * along.abs(), k));
        }
    }
    kinks.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
    for (distance, bend, k) in kinks {
        slope += bend;
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
        let term = |weight: f64, place: f64| Term { weight, value: -place, slope: vec![1.0] };
        let terms = [term(1.0, 5.0), term(1.0, -2.0), term(3.0, 1.0), term(1.5, 2.0)];
        assert_eq!(minimise(&terms, &[[-10.0, 10.0]])[0], 1.0);
        assert_eq!(minimise(&terms, &[[-10.0, 0.5]])[0], 0.5);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        #[test]
        fn no_neighbour_is_lower(
            terms in prop::collection::vec(
                (0.0..3.0, -2.0..2.0, prop::collection::vec(-2.0..2.0, 3)),
                1..40,
            ),
            tries in prop::collection::vec(prop::collection::vec(-1.0..1.0, 3), 50),
        ) {
            let terms: Vec<Term> = terms
                .into_iter()
                .map(|(weight, value, slope)| Term { weight, value, slope })
                .collect();
            let bounds = [[-1.0, 0.5], [-0.2, 1.0], [0.0, 1.0]];
            let x = minimise(&terms, &bounds);
            for (x, [low, high]) in x.iter().zip(bounds) {
                prop_assert!((low - 1e-9..=high + 1e-9).contains(x), "{x}");
            }
            // Convex: what is lowest among its neighbours is lowest of all.
            let lowest = sum(&terms, &x);
            for other in tries {
                for size in [1.0, 0.1, 1e-3] {
                    let other = DVector::from_fn(3, |i, _| -> f64 {
                        f64::clamp(x[i] + size * other[i], bounds[i][0], bounds[i][1])
                    });
                    prop_assert!(sum(&terms, &other) >= lowest - 1e-9 * (1.0 + lowest));
                }
            }
        }
    }
}
