//! Least absolute deviations (L1 regression): the minimum of a sum of absolute deviations of affine
//! functions in a box, exactly.
//!
//! Every affine function deviates from many values, the breakpoints of one convex, piecewise
//! linear function ([`Deviations`]). The minimum is at a vertex, where as many of the affine
//! functions as there are variables are at a breakpoint. From vertex to vertex the descent follows
//! the edge with the steepest fall, to the weighted median of the breakpoints on it. A linear
//! program with two rows per breakpoint has the same solution; a general solver takes longer for
//! it than all motions of a campaign take.
//!
//! Reference: P. Bloomfield and W. L. Steiger, *Least Absolute Deviations*, Birkhaeuser 1983,
//! chapter 7.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::deviations::Deviations;

/// An affine function of the variables; it contributes its deviations.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Residual {
    pub value: f64,
    pub slope: Vec<f64>,
    pub deviations: Arc<Deviations>,
}

impl Residual {
    /// A linear function that deviates from one value.
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

/// The sum of the residuals' deviations at `x`.
pub(super) fn sum(residuals: &[Residual], x: &DVector<f64>) -> f64 {
    residuals.iter().map(|residual| residual.deviations.value(residual.at(x))).sum()
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// A residual that a vertex has at one of its breakpoints.
#[derive(Clone, Copy)]
struct Tight {
    residual: usize,
    breakpoint: usize,
}

/// The `x` with the smallest [`sum`] and with every `x[i]` within `bounds[i]`, which must
/// hold 0; a `held` variable stays there.
pub(super) fn minimise(
    residuals: &[Residual],
    bounds: &[[f64; 2]],
    held: Option<usize>,
) -> DVector<f64> {
    const MAX_EDGES: usize = 500;
    let count = bounds.len();
    let steepest_of = |residual: &Residual| {
        let slopes = residual.slope.iter().map(|slope| slope.abs()).sum::<f64>();
        residual.deviations.total_weight() * slopes
    };
    // Two walls whose slopes cancel in between and outweigh everything outside; the first vertex
    // is the origin, held by breakpoints without weight.
    let weight = 1e3 * residuals.iter().map(steepest_of).sum::<f64>() + 1.0;
    let wall = |(i, bounds): (usize, &[f64; 2])| {
        let [low, high] = if held == Some(i) { [0.0; 2] } else { *bounds };
        let walls = vec![(low, weight), (0.0, 0.0), (high, weight)];
        let slope = (0..count).map(|j| if i == j { 1.0 } else { 0.0 }).collect();
        Residual { value: 0.0, slope, deviations: Arc::new(Deviations::new(walls)) }
    };
    let walls: Vec<Residual> = bounds.iter().enumerate().map(wall).collect();
    let all: Vec<&Residual> = residuals.iter().chain(&walls).collect();
    let at_origin = |(i, wall): (usize, &Residual)| Tight {
        residual: residuals.len() + i,
        breakpoint: wall.deviations.count_below(0.0),
    };
    let mut basis: Vec<Tight> = walls.iter().enumerate().map(at_origin).collect();
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

/// Which residual of the basis to leave, and to which side, for the steepest fall; `None` at the
/// minimum.
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
        // What is tight turns with its own breakpoint, the others of it do not.
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
        // Leaving a breakpoint costs its own weight.
        let fall = along.abs() - all[tight.residual].deviations.weight(tight.breakpoint);
        let rounding = 1e-12 * size * edges.column(leaves).amax();
        if fall > rounding && best.is_none_or(|(_, _, most)| fall > most) {
            best = Some((leaves, -along.signum(), fall));
        }
    }
    best.map(|(leaves, sign, _)| (leaves, sign))
}

/// The breakpoints of one residual that lie on a direction.
struct Crossing<'r> {
    residual: usize,
    deviations: &'r Deviations,
    value: f64,
    along: f64,
    /// Breakpoints below those that may end the fall, and below those that do not.
    low: usize,
    high: usize,
    /// Of those that it is above at the length in question.
    count: usize,
}

impl<'r> Crossing<'r> {
    /// Those of all residuals that change along a direction, on which the `leaves`-th of the basis
    /// goes up or down (`sign`).
    fn all(
        all: &[&'r Residual],
        basis: &[Tight],
        leaves: usize,
        sign: f64,
        x: &DVector<f64>,
        direction: &DVector<f64>,
    ) -> Vec<Self> {
        let crossing = |(residual, of): (usize, &&'r Residual)| {
            let deviations = &*of.deviations;
            let is_leaving = basis[leaves].residual == residual;
            let (value, along) = match is_leaving {
                true => (deviations.breakpoint(basis[leaves].breakpoint), sign),
                false => (of.at(x), of.along(direction)),
            };
            let is_tight = !is_leaving && basis.iter().any(|tight| tight.residual == residual);
            let [low, high] = match along > 0.0 {
                true => [deviations.count_up_to(value), deviations.len()],
                false => [0, deviations.count_below(value)],
            };
            let crossing = Self { residual, deviations, value, along, low, high, count: low };
            (!is_tight && along != 0.0).then_some(crossing)
        };
        all.iter().enumerate().filter_map(crossing).collect()
    }

    fn distance(&self, breakpoint: usize) -> f64 {
        (self.deviations.breakpoint(breakpoint) - self.value) / self.along
    }

    /// How many breakpoints the residual is above after a length: all up to it where it rises,
    /// the rest where it falls.
    fn count_after(&self, length: f64) -> usize {
        let value = self.value + self.along * length;
        let open = self.deviations.breakpoints(self.low..self.high);
        let is_below = |of: &f64| if self.along > 0.0 { *of <= value } else { *of < value };
        self.low + open.partition_point(is_below)
    }

    /// Slope along the direction above so many breakpoints.
    fn slope(&self, count: usize) -> f64 {
        self.along * self.deviations.slope_above(count)
    }
}

/// The first breakpoint after which the sum does not fall any more, and its distance: of those
/// that are left the middle one of the residual that has most of them tells which half of all to
/// go on with.
fn lowest(mut crossings: Vec<Crossing>) -> Option<(Tight, f64)> {
    let (mut found, mut settled) = (None, 0.0);
    loop {
        // What has no breakpoint left has one slope.
        crossings.retain(|crossing| {
            let is_open = crossing.low < crossing.high;
            settled += if is_open { 0.0 } else { crossing.slope(crossing.low) };
            is_open
        });
        let widest = crossings.iter().max_by_key(|crossing| crossing.high - crossing.low);
        let Some(widest) = widest else { return found };
        let breakpoint = widest.low.midpoint(widest.high);
        let (residual, length) = (widest.residual, widest.distance(breakpoint));
        let mut slope = settled;
        for crossing in &mut crossings {
            // The end itself is passed, whatever its distance is rounded to.
            crossing.count = match crossing.residual == residual {
                true => breakpoint + usize::from(crossing.along > 0.0),
                false => crossing.count_after(length),
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
                // This one is found; what is before it may be, too.
                count = if is_upward { breakpoint } else { breakpoint + 1 };
            }
            match rises == is_upward {
                true => crossing.high = count,
                false => crossing.low = count,
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
    fn one_variable_s_minimum_is_the_weighted_median() {
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
