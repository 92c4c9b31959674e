//! Least absolute deviations (L1 regression): the exact minimum of a sum of absolute deviations of affine functions
//! within a box.
//!
//! Each affine function deviates from many values, which are the breakpoints of one convex, piecewise linear function
//! ([`Deviations`]). The minimum is at a vertex: a point where as many affine functions as there are variables are at a
//! breakpoint. From each vertex the descent follows the edge of steepest descent up to the weighted median of the
//! breakpoints along it. The equivalent linear program has two rows per breakpoint; a general-purpose solver would need
//! more time for it than solving the model for a whole campaign takes.
//!
//! Reference: P. Bloomfield and W. L. Steiger, *Least Absolute Deviations*, Birkhaeuser 1983,
//! chapter 7.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::deviations::Deviations;

/// Affine function of the variables, with the weighted sum of its absolute deviations from given values (breakpoints).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Residual {
    pub value: f64,
    pub slope: Vec<f64>,
    pub deviations: Arc<Deviations>,
}

impl Residual {
    /// Creates the residual of the linear function with the given slope (zero at the origin), with the weighted
    /// absolute deviation from a single value, `breakpoint`.
    pub(crate) fn single(breakpoint: f64, weight: f64, slope: Vec<f64>) -> Self {
        let deviations = Arc::new(Deviations::new(vec![(breakpoint, weight)]));
        Self { value: 0.0, slope, deviations }
    }

    pub(crate) fn at(&self, x: &DVector<f64>) -> f64 {
        self.value + self.along(x)
    }

    fn along(&self, direction: &DVector<f64>) -> f64 {
        dot(&self.slope, direction.as_slice())
    }
}

/// Returns the sum of the weighted absolute deviations of all residuals at `x`.
pub(super) fn sum(residuals: &[Residual], x: &DVector<f64>) -> f64 {
    residuals.iter().map(|residual| residual.deviations.value(residual.at(x))).sum()
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Member of the basis of a vertex: the index of a residual whose value is at one of its breakpoints, and the index of
/// this breakpoint.
#[derive(Clone, Copy)]
struct Tight {
    residual: usize,
    breakpoint: usize,
}

/// Returns the `x` within `bounds` that minimises [`sum`]. The bounds must contain 0; the variable at index `held`
/// stays at 0.
pub(super) fn minimise(
    residuals: &[Residual],
    bounds: &[[f64; 2]],
    held: Option<usize>,
) -> DVector<f64> {
    const MAX_EDGES: usize = 500;
    let count = bounds.len();
    // Each variable has two barriers, whose slopes cancel between the bounds and outweigh everything outside. The first
    // vertex is the origin, where each variable is tight at a breakpoint of zero weight.
    let slopes = residuals.iter().map(|residual| {
        let slope = residual.slope.iter().map(|slope| slope.abs()).sum::<f64>();
        residual.deviations.total_weight() * slope
    });
    let weight = 1e3 * slopes.sum::<f64>() + 1.0;
    let walls: Vec<Residual> = bounds
        .iter()
        .enumerate()
        .map(|(i, bounds)| {
            let [low, high] = if held == Some(i) { [0.0; 2] } else { *bounds };
            let walls = vec![(low, weight), (0.0, 0.0), (high, weight)];
            let slope = (0..count).map(|j| if i == j { 1.0 } else { 0.0 }).collect();
            Residual { value: 0.0, slope, deviations: Arc::new(Deviations::new(walls)) }
        })
        .collect();
    let all: Vec<&Residual> = residuals.iter().chain(&walls).collect();
    let mut basis: Vec<Tight> = walls
        .iter()
        .enumerate()
        .map(|(i, wall)| Tight {
            residual: residuals.len() + i,
            breakpoint: wall.deviations.count_below(0.0),
        })
        .collect();
    let mut x = DVector::zeros(count);
    for _ in 0..MAX_EDGES {
        let rows = DMatrix::from_fn(count, count, |i, j| all[basis[i].residual].slope[j]);
        let Some(edges) = rows.try_inverse() else { break };
        let Some((leaves, sign)) = steepest(&all, &basis, &edges, &x) else { break };
        let direction = edges.column(leaves) * sign;
        let crossings = Crossing::all(&all, &basis, leaves, sign, &x, &direction);
        let Some((enters, length)) = lowest(crossings) else { break };
        x += &direction * length;
        basis[leaves] = enters;
    }
    if let Some(held) = held {
        x[held] = 0.0;
    }
    x
}

/// Returns the index within the basis of the residual that leaves the basis in the direction of steepest descent, and
/// the sign of that residual's change; `None` at the minimum.
fn steepest(
    all: &[&Residual],
    basis: &[Tight],
    edges: &DMatrix<f64>,
    x: &DVector<f64>,
) -> Option<(usize, f64)> {
    let mut slope = DVector::<f64>::zeros(basis.len());
    let mut size = 0.0_f64;
    for (k, residual) in all.iter().enumerate() {
        let deviations = &residual.deviations;
        // A tight residual has the slope at its own breakpoint; other breakpoints at the same value do not count.
        let signed = match basis.iter().find(|tight| tight.residual == k) {
            Some(Tight { breakpoint, .. }) => {
                deviations.slope_above(*breakpoint) + deviations.weight(*breakpoint)
            }
            None => deviations.slope_above(deviations.count_up_to(residual.at(x))),
        };
        for (sum, a) in slope.iter_mut().zip(&residual.slope) {
            *sum += signed * a;
            size = size.max((signed * a).abs());
        }
    }
    let mut best: Option<(usize, f64, f64)> = None;
    for (leaves, tight) in basis.iter().enumerate() {
        let along = slope.dot(&edges.column(leaves));
        // Leaving a breakpoint adds the weight of that breakpoint to the slope.
        let fall = along.abs() - all[tight.residual].deviations.weight(tight.breakpoint);
        let rounding = 1e-12 * size * edges.column(leaves).amax();
        if fall > rounding && best.is_none_or(|(_, _, most)| fall > most) {
            best = Some((leaves, -along.signum(), fall));
        }
    }
    best.map(|(leaves, sign, _)| (leaves, sign))
}

/// Breakpoints of one residual along a direction.
struct Crossing<'r> {
    residual: usize,
    deviations: &'r Deviations,
    value: f64,
    along: f64,
    /// Index of the first breakpoint at which the descent may still end; `high` is the end of the range (exclusive).
    low: usize,
    high: usize,
    /// Number of breakpoints below the residual at the step length under consideration.
    count: usize,
}

impl<'r> Crossing<'r> {
    /// Returns the crossings of all residuals that change along a direction. The residual of `basis[leaves]` leaves its
    /// breakpoint upwards or downwards according to `sign`.
    fn all(
        all: &[&'r Residual],
        basis: &[Tight],
        leaves: usize,
        sign: f64,
        x: &DVector<f64>,
        direction: &DVector<f64>,
    ) -> Vec<Self> {
        let mut crossings = Vec::with_capacity(all.len());
        for (index, residual) in all.iter().enumerate() {
            let deviations = &*residual.deviations;
            let is_leaving = basis[leaves].residual == index;
            let is_tight = !is_leaving && basis.iter().any(|tight| tight.residual == index);
            let (value, along) = if is_leaving {
                (deviations.breakpoint(basis[leaves].breakpoint), sign)
            } else {
                (residual.at(x), residual.along(direction))
            };
            if is_tight || along == 0.0 {
                continue;
            }
            let [low, high] = if along > 0.0 {
                [deviations.count_up_to(value), deviations.len()]
            } else {
                [0, deviations.count_below(value)]
            };
            crossings.push(Self {
                residual: index,
                deviations,
                value,
                along,
                low,
                high,
                count: low,
            });
        }
        crossings
    }

    /// Returns the step length at which the residual reaches a breakpoint.
    fn distance(&self, breakpoint: usize) -> f64 {
        (self.deviations.breakpoint(breakpoint) - self.value) / self.along
    }

    /// Returns the number of breakpoints below the residual after a step of the given length; a breakpoint that the
    /// residual just reaches counts as below if the residual increases.
    fn count_after(&self, length: f64) -> usize {
        let value = self.value + self.along * length;
        let open = self.deviations.breakpoints(self.low..self.high);
        let is_below = |of: &f64| if self.along > 0.0 { *of <= value } else { *of < value };
        self.low + open.partition_point(is_below)
    }

    /// Returns the slope of this residual's deviations per unit of step length while `count` breakpoints are below the
    /// residual.
    fn slope(&self, count: usize) -> f64 {
        self.along * self.deviations.slope_above(count)
    }
}

/// Returns the first breakpoint along the direction beyond which the sum of the deviations does not decrease, with its
/// step length; `None` if there is none. The search bisects all remaining breakpoints at the step length of one of
/// them: the middle breakpoint of the residual with the most remaining ones.
fn lowest(mut crossings: Vec<Crossing>) -> Option<(Tight, f64)> {
    let mut found = None;
    let mut settled = 0.0;
    loop {
        // Residuals without remaining breakpoints have a constant slope.
        crossings.retain(|crossing| {
            let is_open = crossing.low < crossing.high;
            settled += if is_open { 0.0 } else { crossing.slope(crossing.low) };
            is_open
        });
        let widest = crossings.iter().max_by_key(|crossing| crossing.high - crossing.low);
        let Some(widest) = widest else { return found };
        let breakpoint = widest.low.midpoint(widest.high);
        let residual = widest.residual;
        let length = widest.distance(breakpoint);
        let mut slope = settled;
        for crossing in &mut crossings {
            // This breakpoint counts as passed, regardless of rounding errors in its distance.
            crossing.count = if crossing.residual == residual {
                breakpoint + usize::from(crossing.along > 0.0)
            } else {
                crossing.count_after(length)
            };
            slope += crossing.slope(crossing.count);
        }
        let rises = slope >= 0.0;
        if rises {
            found = Some((Tight { residual, breakpoint }, length));
        }
        for crossing in &mut crossings {
            let is_upward = crossing.along > 0.0;
            let mut count = crossing.count;
            if rises && crossing.residual == residual {
                // This breakpoint is a candidate; an earlier one may still be the first.
                count = if is_upward { breakpoint } else { breakpoint + 1 };
            }
            if rises == is_upward {
                crossing.high = count;
            } else {
                crossing.low = count;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn residual(weight: f64, value: f64, slope: Vec<f64>) -> Residual {
        Residual { value, slope, deviations: Arc::new(Deviations::of_values(&[0.0], weight)) }
    }

    #[test]
    fn the_minimum_in_one_variable_is_the_weighted_median() {
        let residual = |weight: f64, zero: f64| residual(weight, -zero, vec![1.0]);
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
                .map(|(weight, value, slope)| residual(weight, value, slope))
                .collect();
            let bounds = [[-1.0, 0.5], [-0.2, 1.0], [0.0, 1.0]];
            let x = minimise(&residuals, &bounds, None);
            for (x, [low, high]) in x.iter().zip(bounds) {
                prop_assert!((low - 1e-9..=high + 1e-9).contains(x), "{x}");
            }
            // The sum is convex, so that a minimum among neighbouring points is the global minimum.
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
