//! Weighted sum of absolute deviations from many values, stored as a single convex function.

use std::ops::Range;

/// Convex, piecewise linear function `sum of weight |x - breakpoint|`. A binary search among the breakpoints gives its
/// value and slope.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Deviations {
    /// Breakpoints in ascending order; equal ones are merged.
    breakpoints: Vec<f64>,
    weights: Vec<f64>,
    /// Cumulative sums of the weights: over the breakpoints before each index, then over all breakpoints.
    weights_before: Vec<f64>,
    /// Cumulative sums of weight times distance from the first breakpoint, at the same indices as `weights_before`.
    moments_before: Vec<f64>,
}

impl Deviations {
    /// Builds the sum of weighted absolute deviations from the given pairs of breakpoint and weight.
    pub(crate) fn new(mut points: Vec<(f64, f64)>) -> Self {
        points.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let count = points.len();
        let mut all = Self {
            breakpoints: Vec::with_capacity(count),
            weights: Vec::with_capacity(count),
            weights_before: Vec::with_capacity(count + 1),
            moments_before: Vec::with_capacity(count + 1),
        };
        for (breakpoint, weight) in points {
            match (all.breakpoints.last(), all.weights.last_mut()) {
                (Some(last), Some(sum)) if *last == breakpoint => *sum += weight,
                _ => {
                    all.breakpoints.push(breakpoint);
                    all.weights.push(weight);
                }
            }
        }
        let mut weights = 0.0;
        let mut moments = 0.0;
        for (breakpoint, weight) in all.breakpoints.iter().zip(&all.weights) {
            all.weights_before.push(weights);
            all.moments_before.push(moments);
            weights += weight;
            moments += weight * (breakpoint - all.breakpoints[0]);
        }
        all.weights_before.push(weights);
        all.moments_before.push(moments);
        all
    }

    /// Returns the sum of weighted absolute deviations with all weights multiplied by a factor.
    pub(crate) fn times(&self, factor: f64) -> Self {
        let scaled = |of: &[f64]| of.iter().map(|value| factor * value).collect();
        Self {
            breakpoints: self.breakpoints.clone(),
            weights: scaled(&self.weights),
            weights_before: scaled(&self.weights_before),
            moments_before: scaled(&self.moments_before),
        }
    }

    /// Builds the sum of weighted absolute deviations from `values`, which all have the given weight.
    #[cfg(test)]
    pub(crate) fn of_values(values: &[f64], weight: f64) -> Self {
        Self::new(values.iter().map(|value| (*value, weight)).collect())
    }

    pub(crate) fn len(&self) -> usize {
        self.breakpoints.len()
    }

    pub(crate) fn breakpoint(&self, index: usize) -> f64 {
        self.breakpoints[index]
    }

    pub(crate) fn breakpoints(&self, of: Range<usize>) -> &[f64] {
        &self.breakpoints[of]
    }

    pub(crate) fn weight(&self, index: usize) -> f64 {
        self.weights[index]
    }

    /// Returns the sum of all weights.
    pub(crate) fn total_weight(&self) -> f64 {
        self.weights_before[self.len()]
    }

    /// Counts the breakpoints below a value.
    pub(crate) fn count_below(&self, x: f64) -> usize {
        self.breakpoints.partition_point(|breakpoint| *breakpoint < x)
    }

    /// Counts the breakpoints up to and including a value.
    pub(crate) fn count_up_to(&self, x: f64) -> usize {
        self.breakpoints.partition_point(|breakpoint| *breakpoint <= x)
    }

    pub(crate) fn value(&self, x: f64) -> f64 {
        let Some(first) = self.breakpoints.first() else { return 0.0 };
        let below = self.count_below(x);
        let moments = self.moments_before[self.len()] - 2.0 * self.moments_before[below];
        (x - first) * self.slope_above(below) + moments
    }

    /// Returns the slope of the sum of weighted deviations between the first `count` breakpoints and the next one.
    pub(crate) fn slope_above(&self, count: usize) -> f64 {
        2.0 * self.weights_before[count] - self.total_weight()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

        #[test]
        fn value_and_slope_are_those_of_the_sum(
            mut points in prop::collection::vec((-2.0..2.0, 0.0..3.0), 1..40),
            x in -3.0..3.0,
        ) {
            // Input with some equal breakpoints.
            let again: Vec<(f64, f64)> = points.iter().step_by(3).copied().collect();
            points.extend(again);
            let sum = |x: f64| points.iter().map(|(b, weight)| weight * (x - b).abs()).sum::<f64>();
            let all = Deviations::new(points.clone());
            prop_assert!((all.value(x) - sum(x)).abs() <= 1e-13 * (1.0 + sum(x)));
            let signed = points.iter().map(|(b, weight)| if *b <= x { *weight } else { -weight });
            let slope = all.slope_above(all.count_up_to(x));
            prop_assert!((slope - signed.sum::<f64>()).abs() <= 1e-12);
            prop_assert!(all.len() <= points.len() - points.len() / 4);
        }
    }

    #[test]
    fn repeated_values_add_their_weights() {
        let one = Deviations::of_values(&[0.3, 0.1, 0.7], 24.0);
        let copies = Deviations::of_values(&[0.3, 0.1, 0.7].repeat(24), 1.0);
        assert_eq!((one.breakpoints, one.weights), (copies.breakpoints, copies.weights));
        assert_eq!(Deviations::default().value(1.0), 0.0);
    }
}
