//! The weighted sum of absolute deviations from many values, as one function.

use std::ops::Range;

/// The convex, piecewise linear function `sum of weight |x - breakpoint|`. Its value and slope
/// take a binary search, however many breakpoints there are.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Deviations {
    /// Ascending; equal ones are one.
    breakpoints: Vec<f64>,
    weights: Vec<f64>,
    /// Sums over the breakpoints before each, and over all: of the weights, and of the weights
    /// times the distance from the first breakpoint.
    weights_before: Vec<f64>,
    moments_before: Vec<f64>,
}

impl Deviations {
    /// Of breakpoints and their weights.
    pub(crate) fn new(mut of: Vec<(f64, f64)>) -> Self {
        of.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let count = of.len();
        let mut all = Self {
            breakpoints: Vec::with_capacity(count),
            weights: Vec::with_capacity(count),
            weights_before: Vec::with_capacity(count + 1),
            moments_before: Vec::with_capacity(count + 1),
        };
        for (breakpoint, weight) in of {
            match (all.breakpoints.last(), all.weights.last_mut()) {
                (Some(last), Some(sum)) if *last == breakpoint => *sum += weight,
                _ => {
                    all.breakpoints.push(breakpoint);
                    all.weights.push(weight);
                }
            }
        }
        let (mut weights, mut moments) = (0.0, 0.0);
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

    /// The same times a factor.
    pub(crate) fn times(&self, factor: f64) -> Self {
        let scaled = |of: &[f64]| of.iter().map(|value| factor * value).collect();
        Self {
            breakpoints: self.breakpoints.clone(),
            weights: scaled(&self.weights),
            weights_before: scaled(&self.weights_before),
            moments_before: scaled(&self.moments_before),
        }
    }

    /// Of values that have one weight in common.
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

    /// Sum of all weights.
    pub(crate) fn total_weight(&self) -> f64 {
        self.weights_before[self.len()]
    }

    /// How many breakpoints are below a value, or not above it.
    pub(crate) fn count_below(&self, x: f64) -> usize {
        self.breakpoints.partition_point(|breakpoint| *breakpoint < x)
    }

    pub(crate) fn count_up_to(&self, x: f64) -> usize {
        self.breakpoints.partition_point(|breakpoint| *breakpoint <= x)
    }

    pub(crate) fn value(&self, x: f64) -> f64 {
        let (Some(first), below) = (self.breakpoints.first(), self.count_below(x)) else {
            return 0.0;
        };
        let moments = self.moments_before[self.len()] - 2.0 * self.moments_before[below];
        (x - first) * self.slope_above(below) + moments
    }

    /// Slope between breakpoint `count - 1` and breakpoint `count`.
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
            mut of in prop::collection::vec((-2.0..2.0, 0.0..3.0), 1..40),
            x in -3.0..3.0,
        ) {
            // Some breakpoints meet.
            let again: Vec<(f64, f64)> = of.iter().step_by(3).copied().collect();
            of.extend(again);
            let sum = |x: f64| of.iter().map(|(b, weight)| weight * (x - b).abs()).sum::<f64>();
            let all = Deviations::new(of.clone());
            prop_assert!((all.value(x) - sum(x)).abs() <= 1e-13 * (1.0 + sum(x)));
            let signed = of.iter().map(|(b, weight)| if *b <= x { *weight } else { -weight });
            let slope = all.slope_above(all.count_up_to(x));
            prop_assert!((slope - signed.sum::<f64>()).abs() <= 1e-12);
            prop_assert!(all.len() <= of.len() - of.len() / 4);
        }
    }

    #[test]
    fn copies_weigh_as_much_as_they_are() {
        let (one, copies) = ([0.3, 0.1, 0.7], [0.3, 0.1, 0.7].repeat(24));
        let (one, copies) =
            (Deviations::of_values(&one, 24.0), Deviations::of_values(&copies, 1.0));
        assert_eq!((one.breakpoints, one.weights), (copies.breakpoints, copies.weights));
        assert_eq!(Deviations::default().value(1.0), 0.0);
    }
}
