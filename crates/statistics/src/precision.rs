//! Precision of a measurement method: repeatability and reproducibility standard deviations.
//!
//! Values are measured at several levels of a quantity, on several days. As in ISO 5725-2, with days in place of
//! laboratories (intermediate precision in the terms of ISO 5725-3), a value is the sum of the general mean of its
//! level, a random deviation of the day (one-way random effects) and a random deviation of the single value. All
//! deviations are relative to the general mean of the level, and the sums of squares of all levels are pooled.
//!
//! References: ISO 5725-2:2019, clause 7; F. E. Satterthwaite, *An approximate distribution of estimates of variance
//! components*, Biometrics Bulletin 2 (1946) 110.

use std::collections::{BTreeMap, BTreeSet};

use super::mean;

/// Relative standard deviation with its degrees of freedom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelativeDeviation {
    pub deviation: f64,
    pub degrees_of_freedom: f64,
}

/// Repeatability and reproducibility of a measurement method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Precision {
    /// Standard deviation of values of one day; `None` if no level was measured twice on a day.
    pub repeatability: Option<RelativeDeviation>,
    /// Standard deviation of values of different days, which includes the repeatability; `None` if no level was
    /// measured on two days.
    pub reproducibility: Option<RelativeDeviation>,
}

/// Sum of squares with its degrees of freedom.
#[derive(Debug, Clone, Copy, Default)]
struct Squares {
    sum: f64,
    degrees_of_freedom: f64,
}

impl Squares {
    /// Returns the mean square; `None` without degrees of freedom.
    fn mean(self) -> Option<f64> {
        (self.degrees_of_freedom > 0.0).then(|| self.sum / self.degrees_of_freedom)
    }
}

impl Precision {
    /// Estimates the precision from the values of each level, each with the index of its day. Levels whose mean is not
    /// above zero are left out, because they have no relative deviations.
    ///
    /// The deviation of a day may be common to all levels. The variance between days therefore has only as many degrees
    /// of freedom as there are differences between days, however many levels there are.
    pub fn new(levels: &[Vec<(usize, f64)>]) -> Self {
        let mut within = Squares::default();
        let mut between = Squares::default();
        // Sum over the levels of the effective number of values per day times the degrees of freedom between days.
        let mut weight = 0.0;
        let mut days_by_level = Vec::new();
        for level in levels {
            let general_mean = mean(level.iter().map(|(_, value)| *value));
            if general_mean.is_nan() || general_mean <= 0.0 {
                continue;
            }
            let mut by_day: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
            for (day, value) in level {
                by_day.entry(*day).or_default().push(value / general_mean - 1.0);
            }
            for values in by_day.values() {
                let day_mean = mean(values.iter().copied());
                within.sum += values.iter().map(|value| (value - day_mean).powi(2)).sum::<f64>();
                within.degrees_of_freedom += values.len() as f64 - 1.0;
                between.sum += values.len() as f64 * day_mean.powi(2);
            }
            between.degrees_of_freedom += by_day.len() as f64 - 1.0;
            let count = level.len() as f64;
            let squares: f64 = by_day.values().map(|values| (values.len() as f64).powi(2)).sum();
            weight += count - squares / count;
            days_by_level.push(by_day.into_keys().collect());
        }
        let repeatability = within.mean().map(|variance| RelativeDeviation {
            deviation: variance.sqrt(),
            degrees_of_freedom: within.degrees_of_freedom,
        });
        let reproducibility = between.mean().map(|mean_square| {
            let per_day = weight / between.degrees_of_freedom;
            let of_days = differences(days_by_level).min(between.degrees_of_freedom);
            let variance = within.mean().unwrap_or(0.0);
            if mean_square <= variance {
                // The estimated variance between days is not positive and set to zero.
                return RelativeDeviation {
                    deviation: variance.sqrt(),
                    degrees_of_freedom: within.degrees_of_freedom,
                };
            }
            let parts = [mean_square / per_day, (1.0 - 1.0 / per_day) * variance];
            let total: f64 = parts.iter().sum();
            let mut uncertainty = parts[0].powi(2) / of_days;
            if parts[1] > 0.0 {
                uncertainty += parts[1].powi(2) / within.degrees_of_freedom;
            }
            RelativeDeviation {
                deviation: total.sqrt(),
                degrees_of_freedom: total.powi(2) / uncertainty,
            }
        });
        Self { repeatability, reproducibility }
    }
}

/// Returns the number of independent differences between days, given the days of each level: the number of days, less
/// one for each group of days that share no level with other days.
fn differences(days_by_level: Vec<BTreeSet<usize>>) -> f64 {
    let mut groups: Vec<BTreeSet<usize>> = Vec::new();
    for mut group in days_by_level {
        groups.retain(|other| {
            let is_separate = other.is_disjoint(&group);
            if !is_separate {
                group.extend(other);
            }
            is_separate
        });
        groups.push(group);
    }
    groups.iter().map(|group| group.len() as f64 - 1.0).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: Option<RelativeDeviation>, deviation: f64, freedom: f64) {
        let found = found.expect("a deviation");
        assert!((found.deviation / deviation - 1.0).abs() < 1e-9, "{found:?} {deviation}");
        assert!((found.degrees_of_freedom / freedom - 1.0).abs() < 1e-9, "{found:?} {freedom}");
    }

    /// Balanced design of ISO 5725-2: mean squares by hand, for 100 (1 + x) with x in per cent below.
    #[test]
    fn a_balanced_level_has_the_variances_of_the_analysis_of_variance() {
        // Day means 1, -1 and 0 %; within the days +-1, +-2 and +-3 %.
        let values = [(0, 102.0), (0, 100.0), (1, 101.0), (1, 97.0), (2, 103.0), (2, 97.0)];
        let found = Precision::new(&[values.to_vec()]);
        // Mean squares: within (2 + 8 + 18) / 3, between (2 + 2 + 0) / 2, in per cent squared.
        close(found.repeatability, (28.0_f64 / 3.0).sqrt() / 100.0, 3.0);
        // The variance between the days would be negative.
        close(found.reproducibility, (28.0_f64 / 3.0).sqrt() / 100.0, 3.0);

        let values = [(0, 105.0), (0, 103.0), (1, 97.0), (1, 95.0), (2, 101.0), (2, 99.0)];
        let found = Precision::new(&[values.to_vec()]);
        // Within: 6 / 3 = 2; between: 2 (16 + 16) / 2 = 32; s_L^2 = (32 - 2) / 2 = 15.
        close(found.repeatability, 2.0_f64.sqrt() / 100.0, 3.0);
        close(found.reproducibility, 17.0_f64.sqrt() / 100.0, 289.0 / (256.0 / 2.0 + 1.0 / 3.0));
    }

    #[test]
    fn an_unbalanced_level_has_the_effective_number_of_repeats_of_iso_5725() {
        // n = 3, 1, 2: n_0 = (6 - 14 / 6) / 2 = 11 / 6.
        let values = [(0, 104.0), (0, 106.0), (0, 105.0), (1, 92.0), (2, 97.0), (2, 96.0)].to_vec();
        let found = Precision::new(&[values]);
        // Mean 100; day means 105, 92 and 96.5. Within: (1 + 1 + 0.5) / 3; between: (75 + 64 + 24.5) / 2.
        let within = 2.5 / 3.0;
        let between = 163.5 / 2.0;
        close(found.repeatability, f64::sqrt(within) / 100.0, 3.0);
        let deviation = f64::sqrt((between - within) / (11.0 / 6.0) + within) / 100.0;
        let found = found.reproducibility.expect("a deviation");
        assert!((found.deviation / deviation - 1.0).abs() < 1e-9, "{found:?} {deviation}");
    }

    #[test]
    fn what_the_design_does_not_determine_is_missing() {
        let of = |levels: &[Vec<(usize, f64)>]| {
            let Precision { repeatability, reproducibility } = Precision::new(levels);
            [repeatability.is_some(), reproducibility.is_some()]
        };
        assert_eq!(of(&[]), [false; 2]);
        assert_eq!(of(&[vec![(0, 1.0)], vec![(1, 2.0)]]), [false; 2]);
        assert_eq!(of(&[vec![(0, 1.0), (0, 1.1)], vec![(1, 2.0)]]), [true, false]);
        assert_eq!(of(&[vec![(0, 1.0), (1, 1.1)]]), [false, true]);
        assert_eq!(of(&[vec![(0, -1.0), (1, 1.0)], vec![(0, f64::NAN), (0, 1.0)]]), [false; 2]);
        // Without repeats, the days differ by both deviations together.
        close(Precision::new(&[vec![(0, 99.0), (1, 101.0)]]).reproducibility, 2e-4_f64.sqrt(), 1.0);
    }

    #[test]
    fn days_that_share_no_level_are_not_compared() {
        let days = |levels: &[&[usize]]| {
            differences(levels.iter().map(|days| days.iter().copied().collect()).collect())
        };
        assert_eq!(days(&[&[0, 1], &[0, 1], &[0, 1]]), 1.0);
        assert_eq!(days(&[&[0, 1], &[2, 3], &[4]]), 2.0);
        assert_eq!(days(&[&[0, 1], &[2, 3], &[1, 2]]), 3.0);
    }

    /// Draws 4000 campaigns of 4 days with 5 levels, each measured 3 times: deviations of 4 % between days, common to
    /// all levels, and of 2 % between trials. The variance estimates scatter as their degrees of freedom say.
    #[test]
    fn variances_are_unbiased_and_scatter_as_their_degrees_of_freedom_say() {
        let mut state = 12_345_u64;
        // Sum of twelve uniform numbers of a linear congruential generator, less 6.
        let mut normal = || {
            let uniforms = (0..12).map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            });
            uniforms.sum::<f64>() - 6.0
        };
        let mut found = [Vec::new(), Vec::new()];
        for _ in 0..4000 {
            let days: Vec<f64> = (0..4).map(|_| 0.04 * normal()).collect();
            let levels: Vec<Vec<(usize, f64)>> = (1..=5)
                .map(|level| {
                    let days = days.iter().enumerate();
                    let values = days.flat_map(|(day, of_day)| [(day, *of_day); 3]);
                    let values = values.map(|(day, of_day)| {
                        (day, f64::from(level) * (1.0 + of_day + 0.02 * normal()))
                    });
                    values.collect()
                })
                .collect();
            let Precision { repeatability, reproducibility } = Precision::new(&levels);
            let both = [repeatability, reproducibility].map(|of| of.expect("a deviation"));
            for (all, of) in found.iter_mut().zip(both) {
                all.push(of.deviation.powi(2));
            }
        }
        for (variances, [truth, freedom]) in found.iter().zip([[4e-4, 40.0], [2e-3, 4.0]]) {
            let average = mean(variances.iter().copied());
            let scatter = mean(variances.iter().map(|of| (of - average).powi(2)));
            let found_freedom = 2.0 * average.powi(2) / scatter;
            println!("{average:.3e} of {truth:.3e}, {found_freedom:.2} of {freedom:.2}");
            assert!((average / truth - 1.0).abs() < 0.03, "{average:e} {truth:e}");
            assert!((found_freedom / freedom - 1.0).abs() < 0.15, "{found_freedom} {freedom}");
        }
    }
}
