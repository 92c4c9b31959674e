//! Steps of a figure of merit over many runs: from which run on it has another level.
//!
//! A step has to be more than the tolerance of comparisons, and more than runs scatter about
//! their level: medians of few runs before and after, by the median of the differences between
//! neighbours (a robust two-sample shift, as Hodges and Lehmann, Annals of Mathematical Statistics
//! 34, 1963, estimate it, over a moving window). One run that is off is no step while there are
//! later ones that are not; the last run is taken as it is.

use trilink_statistics::{MAD_TO_DEVIATION, median};

/// Runs on either side of which the levels are taken.
const WINDOW: usize = 8;
/// Differences between neighbours that the scatter is taken from: at most, and at least for it to
/// be known.
const MOST_DIFFERENCES: usize = 40;
const FEWEST_DIFFERENCES: usize = 5;
/// A shift of this many of its own deviations is more than scatter.
const DEVIATIONS: f64 = 5.0;
/// Deviation of the median of normal deviates, to that of their mean.
const MEDIAN_DEVIATION: f64 = 1.2533;

/// A change of level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    /// The first value of the new level.
    pub index: usize,
    pub before: f64,
    pub after: f64,
}

/// All steps of the values, of which `limit` gives what a value may differ by from another level.
pub(super) fn steps(values: &[f64], limit: impl Fn(usize, f64) -> Option<f64>) -> Vec<Step> {
    let differences: Vec<f64> = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    let (mut found, mut start, mut index) = (Vec::new(), 0, 1);
    while index < values.len() {
        let is_step = |at: usize| {
            let shift = Shift::new(values, start, at);
            let noise = DEVIATIONS * shift.deviation(scatter(&differences, at));
            // Where the scatter is not known, the tolerance alone decides.
            limit(at, shift.before).is_some_and(|limit| shift.size() > limit)
                && (noise.is_nan() || shift.size() > noise)
        };
        if !is_step(index) {
            index += 1;
            continue;
        }
        // The windows of the runs before see it, too, as soon as they have more of the new level
        // than of the old: it is where two levels fit best.
        let last = values.len().min(index + WINDOW / 2 + 1);
        let end = (index..last).find(|at| !is_step(*at)).unwrap_or(last);
        let range = start.max(index.saturating_sub(WINDOW))..values.len().min(end + WINDOW / 2);
        let misfit = |at: usize| {
            [&values[range.start..at], &values[at..range.end]].map(distance).iter().sum::<f64>()
        };
        let best = (index..end).min_by(|a, b| misfit(*a).total_cmp(&misfit(*b))).unwrap_or(index);
        let Shift { before, after, .. } = Shift::new(values, start, best);
        found.push(Step { index: best, before, after });
        (start, index) = (best, best + 1);
    }
    found
}

/// Levels before and after a value.
struct Shift {
    before: f64,
    after: f64,
    counts: [usize; 2],
}

impl Shift {
    /// At `at`, of values from `start` on.
    fn new(values: &[f64], start: usize, at: usize) -> Self {
        let before = &values[start.max(at.saturating_sub(WINDOW))..at];
        let mut after = values[at..values.len().min(at + WINDOW)].to_vec();
        let counts = [before.len(), after.len()];
        let before = median(before.to_vec());
        // Of two in the middle the one that is nearer to the level before.
        after.sort_unstable_by(f64::total_cmp);
        let middle = [after[(after.len() - 1) / 2], after[after.len() / 2]];
        let [low, high] = middle.map(|level| (level - before).abs());
        Self { before, after: middle[usize::from(high < low)], counts }
    }

    fn size(&self) -> f64 {
        (self.after - self.before).abs()
    }

    /// Of the size, where values have a deviation.
    fn deviation(&self, scatter: f64) -> f64 {
        let of_median = |count: usize| match count {
            1 | 2 => 1.0 / count as f64,
            count => MEDIAN_DEVIATION.powi(2) / count as f64,
        };
        scatter * self.counts.map(of_median).iter().sum::<f64>().sqrt()
    }
}

/// Deviation of values from their level around `at`, whose own difference from the value before
/// does not count; NaN where there are too few.
fn scatter(differences: &[f64], at: usize) -> f64 {
    let from = (at.saturating_sub(1 + MOST_DIFFERENCES / 2))
        .min(differences.len().saturating_sub(MOST_DIFFERENCES));
    let to = differences.len().min(from + MOST_DIFFERENCES);
    let others = (from..to).filter(|i| i + 1 != at).map(|i| differences[i]);
    let others: Vec<f64> = others.filter(|difference| difference.is_finite()).collect();
    match others.len() < FEWEST_DIFFERENCES {
        true => f64::NAN,
        false => MAD_TO_DEVIATION * median(others) / 2.0_f64.sqrt(),
    }
}

/// Sum of the distances from the median.
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

    /// So many runs of deviation 1 and level 100, with the level changed by each step.
    fn runs(seed: u64, count: usize, steps: &[(usize, f64)]) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let normal = Normal::new(100.0, 1.0).unwrap();
        let level =
            |i: usize| steps.iter().filter(|(at, _)| *at <= i).map(|(_, by)| by).sum::<f64>();
        (0..count).map(|i| normal.sample(&mut random) + level(i)).collect()
    }

    fn at(values: &[f64], limit: f64) -> Vec<usize> {
        steps(values, |_, _| Some(limit)).iter().map(|step| step.index).collect()
    }

    #[test]
    fn a_planted_step_is_found_at_its_run() {
        let seeds = 0..500;
        let found = |count, steps: &[(usize, f64)]| {
            let indices: Vec<usize> = steps.iter().map(|(at, _)| *at).collect();
            seeds.clone().filter(|seed| at(&runs(*seed, count, steps), 6.0) == indices).count()
        };
        for (what, count, steps, least) in [
            ("in the middle", 30, &[(12, 10.0)][..], 495),
            ("down", 30, &[(12, -10.0)], 495),
            ("early", 30, &[(2, 10.0)], 480),
            ("tonight", 30, &[(29, 12.0)], 480),
            ("two of them", 60, &[(15, 10.0), (40, -10.0)], 490),
            ("two near each other", 60, &[(15, 12.0), (20, 12.0)], 470),
            ("among a thousand", 1000, &[(700, 10.0)], 480),
        ] {
            let right = found(count, steps);
            println!("{what}: {right} of 500");
            assert!(right >= least, "{what}: {right}");
        }
    }

    #[test]
    fn without_a_step_none_is_named() {
        // Noise that the tolerance takes, and noise that is more than the tolerance expects.
        for (limit, count, most) in [(8.5, 30, 0), (3.0, 30, 10), (0.0, 30, 25), (0.0, 1000, 50)] {
            let wrong = (0..1000).filter(|seed| !at(&runs(*seed, count, &[]), limit).is_empty());
            let wrong = wrong.count();
            println!("limit {limit}, {count} runs: {wrong} of 1000");
            assert!(wrong <= most, "{limit} {count}: {wrong}");
        }
    }

    #[test]
    fn one_run_that_is_off_is_no_step_once_there_are_others() {
        let mut values = runs(1, 30, &[]);
        values[14] += 50.0;
        assert!(at(&values, 6.0).is_empty());
        assert_eq!(at(&values[..15], 6.0), [14], "tonight it is taken as it is");
        // Values that do not scatter, and few.
        assert_eq!(at(&[1.0, 1.0, 1.0, 2.0, 2.0], 0.5), [3]);
        assert!(at(&[1.0, 1.0, 1.0, 1.4, 1.4], 0.5).is_empty());
        assert_eq!(at(&[1.0, 2.0], 0.5), [1]);
        for few in [&[][..], &[1.0], &[f64::NAN, 1.0]] {
            assert!(at(few, 0.5).is_empty());
        }
        assert!(steps(&values, |_, _| None).is_empty(), "nothing is said without a tolerance");
    }
}
