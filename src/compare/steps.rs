//! Detection of steps (changes of level) in a figure of merit over many runs.
//!
//! A step must exceed the tolerance of comparisons and the scatter of runs about their level. Levels are medians over a
//! moving window before and after a run, and the scatter is estimated from the median difference between neighbours: a
//! robust two-sample shift estimate in the spirit of Hodges and Lehmann, Annals of Mathematical Statistics 34, 1963. A
//! single outlier is not a step if later runs return to the old level; the last run is judged as it is.

use trilink_statistics::{MAD_TO_DEVIATION, median, median_high};

/// Maximum number of values before and after an index from which the level on each side is computed.
const WINDOW: usize = 8;
/// Maximum number of differences between neighbouring runs from which the scatter is estimated.
const MAX_DIFFERENCES: usize = 40;
/// Minimum number of differences between neighbouring runs that are needed to estimate the scatter.
const MIN_DIFFERENCES: usize = 5;
/// Minimum change in level that counts as a step, in standard deviations of this change.
const MIN_DEVIATIONS: f64 = 5.0;
/// Standard deviation of the median relative to that of the mean, for many normal deviates.
const MEDIAN_DEVIATION: f64 = 1.2533;

/// Lasting change in the level of a figure of merit over the history of runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    /// Index of the first value of the new level.
    pub index: usize,
    pub before: f64,
    pub after: f64,
}

/// Finds all steps (lasting changes of level) in a series of values. `limit` returns the tolerance for the change at an
/// index from a former level; if it returns `None`, there is no step at the index.
pub(super) fn find_steps(values: &[f64], limit: impl Fn(usize, f64) -> Option<f64>) -> Vec<Step> {
    let differences: Vec<f64> = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    let mut steps = Vec::new();
    let mut start = 0;
    let mut index = 1;
    while index < values.len() {
        let is_step = |at: usize| {
            let shift = Shift::new(values, start, at);
            let noise = MIN_DEVIATIONS * shift.deviation(scatter(&differences, at));
            // If the scatter is unknown (NaN), the tolerance alone decides.
            limit(at, shift.before).is_some_and(|limit| shift.size() > limit)
                && (noise.is_nan() || shift.size() > noise)
        };
        if !is_step(index) {
            index += 1;
            continue;
        }
        // A step is detected as soon as its window has more values of the new level than of the old one. Among all
        // indices that detect the step, the step is where two constant levels fit best.
        let last = values.len().min(index + WINDOW / 2 + 1);
        let end = (index..last).find(|at| !is_step(*at)).unwrap_or(last);
        let range = start.max(index.saturating_sub(WINDOW))..values.len().min(end + WINDOW / 2);
        let misfit = |at: usize| {
            [&values[range.start..at], &values[at..range.end]].map(distance).iter().sum::<f64>()
        };
        let best = (index..end).min_by(|a, b| misfit(*a).total_cmp(&misfit(*b))).unwrap_or(index);
        let Shift { before, after, .. } = Shift::new(values, start, best);
        steps.push(Step { index: best, before, after });
        start = best;
        index = best + 1;
    }
    steps
}

/// Levels (medians) of the values before and after an index.
struct Shift {
    before: f64,
    after: f64,
    /// Numbers of values before and after the index.
    counts: [usize; 2],
}

impl Shift {
    /// Computes the levels before and after the index `at`; values before the index `start` are ignored.
    fn new(values: &[f64], start: usize, at: usize) -> Self {
        let before = &values[start.max(at.saturating_sub(WINDOW))..at];
        let mut after = values[at..values.len().min(at + WINDOW)].to_vec();
        let counts = [before.len(), after.len()];
        // Levels are values that a run had.
        let before = median_high(before.to_vec());
        // Of the two middle values, use the one nearer to the former level.
        after.sort_unstable_by(f64::total_cmp);
        let middle = [after[(after.len() - 1) / 2], after[after.len() / 2]];
        let [low, high] = middle.map(|level| (level - before).abs());
        Self { before, after: middle[usize::from(high < low)], counts }
    }

    fn size(&self) -> f64 {
        (self.after - self.before).abs()
    }

    /// Returns the standard deviation of the difference between the two levels, if single values have the standard
    /// deviation `scatter`.
    fn deviation(&self, scatter: f64) -> f64 {
        let variances = self.counts.map(|count| match count {
            1 | 2 => 1.0 / count as f64,
            count => MEDIAN_DEVIATION.powi(2) / count as f64,
        });
        scatter * variances.iter().sum::<f64>().sqrt()
    }
}

/// Estimates the standard deviation of values about their level from `differences`, the absolute differences between
/// neighbouring values. Uses those near the index `at`, except the one between the values at `at - 1` and `at`; returns
/// NaN if there are too few.
fn scatter(differences: &[f64], at: usize) -> f64 {
    let from = (at.saturating_sub(1 + MAX_DIFFERENCES / 2))
        .min(differences.len().saturating_sub(MAX_DIFFERENCES));
    let to = differences.len().min(from + MAX_DIFFERENCES);
    let others = (from..to).filter(|i| i + 1 != at).map(|i| differences[i]);
    let others: Vec<f64> = others.filter(|difference| difference.is_finite()).collect();
    if others.len() < MIN_DIFFERENCES {
        f64::NAN
    } else {
        MAD_TO_DEVIATION * median(others) / 2.0_f64.sqrt()
    }
}

/// Returns the sum of the absolute deviations of the values from their median.
fn distance(values: &[f64]) -> f64 {
    let level = median(values.to_vec());
    values.iter().map(|value| (value - level).abs()).sum()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal};

    use super::*;

    /// Generates `count` normally distributed values with standard deviation 1 about a level of 100. Each step (index,
    /// change) shifts the level from its index on.
    fn runs(seed: u64, count: usize, steps: &[(usize, f64)]) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let normal = Normal::new(100.0, 1.0).unwrap();
        let level =
            |i: usize| steps.iter().filter(|(at, _)| *at <= i).map(|(_, by)| by).sum::<f64>();
        (0..count).map(|i| normal.sample(&mut random) + level(i)).collect()
    }

    fn indices(values: &[f64], limit: f64) -> Vec<usize> {
        find_steps(values, |_, _| Some(limit)).iter().map(|step| step.index).collect()
    }

    #[test]
    fn a_planted_step_is_found_at_its_run() {
        let seeds = 0..500;
        let found = |count, steps: &[(usize, f64)]| {
            let planted: Vec<usize> = steps.iter().map(|(at, _)| *at).collect();
            seeds.clone().filter(|seed| indices(&runs(*seed, count, steps), 6.0) == planted).count()
        };
        for (name, count, steps, min_right) in [
            ("in the middle", 30, &[(12, 10.0)][..], 495),
            ("down", 30, &[(12, -10.0)], 495),
            ("early", 30, &[(2, 10.0)], 480),
            ("in the last run", 30, &[(29, 12.0)], 480),
            ("two of them", 60, &[(15, 10.0), (40, -10.0)], 490),
            ("two near each other", 60, &[(15, 12.0), (20, 12.0)], 470),
            ("among a thousand", 1000, &[(700, 10.0)], 480),
        ] {
            let right = found(count, steps);
            println!("{name}: {right} of 500");
            assert!(right >= min_right, "{name}: {right}");
        }
    }

    #[test]
    fn noise_alone_is_no_step() {
        // Noise within the tolerance, then noise beyond the tolerance.
        for (limit, count, max_wrong) in
            [(8.5, 30, 0), (3.0, 30, 10), (0.0, 30, 25), (0.0, 1000, 50)]
        {
            let wrong =
                (0..1000).filter(|seed| !indices(&runs(*seed, count, &[]), limit).is_empty());
            let wrong = wrong.count();
            println!("limit {limit}, {count} runs: {wrong} of 1000");
            assert!(wrong <= max_wrong, "{limit} {count}: {wrong}");
        }
    }

    #[test]
    fn a_single_outlier_is_no_step_once_later_runs_return() {
        let mut values = runs(1, 30, &[]);
        values[14] += 50.0;
        assert!(indices(&values, 6.0).is_empty());
        assert_eq!(indices(&values[..15], 6.0), [14], "an outlier in the last run is a step");
        // Few values, without scatter.
        assert_eq!(indices(&[1.0, 1.0, 1.0, 2.0, 2.0], 0.5), [3]);
        assert!(indices(&[1.0, 1.0, 1.0, 1.4, 1.4], 0.5).is_empty());
        assert_eq!(indices(&[1.0, 2.0], 0.5), [1]);
        for few in [&[][..], &[1.0], &[f64::NAN, 1.0]] {
            assert!(indices(few, 0.5).is_empty());
        }
        assert!(
            find_steps(&values, |_, _| None).is_empty(),
            "there is no step without a tolerance"
        );
    }
}
