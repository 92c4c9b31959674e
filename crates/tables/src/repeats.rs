//! Finds trials that are unlike their repeats, that is, unlike the other trials of the same campaign, day and
//! frequency.

use std::collections::BTreeMap;

use trilink_robot::metrics::Metric;
use trilink_statistics::median;

use crate::TrialRow;

/// Relative difference below which frequencies count as equal.
pub const SAME_FREQUENCY: f64 = 0.005;
/// Number of robust standard deviations from the median of the repeats beyond which a trial is unlike them. In 1 to 4 %
/// of the campaigns in which trials only scatter, at least one trial is beyond it in some metric.
pub const MAX_DEVIATIONS: f64 = 6.0;
/// Minimum number of repeats, not counting the first trial at each frequency of each day, from which the scatter is
/// estimated.
const MIN_REPEATS: usize = 6;
/// Minimum number of differences between repeats from which the scatter is estimated.
const MIN_DIFFERENCES: usize = 3;
/// Standard deviation of a normal distribution over the median of the absolute differences of pairs of its values.
const SHAMOS: f64 = 1.0483;
/// Minimum relative standard deviation of repeats.
const MIN_SCATTER: f64 = 1e-4;

/// Trial whose metric deviates from the median of its repeats.
#[derive(Debug, Clone, PartialEq)]
pub struct UnlikeRepeats {
    /// Index of the trial.
    pub index: usize,
    pub metric: Metric,
    /// Median of the metric over the trial and its repeats, in the unit of the metric.
    pub median: f64,
    /// Number of trials over which the median is taken.
    pub trials: usize,
    /// Deviation of the metric's logarithm from the median, in robust standard deviations.
    pub deviations: f64,
}

impl UnlikeRepeats {
    /// Returns the trials that are unlike their repeats, each with the metric that deviates most. The logarithm of each
    /// metric is compared with its median over the trials of the same campaign, day and frequency (robust z score of
    /// Iglewicz and Hoaglin 1993). The standard deviation is that of all repeats of the campaign, from the median of
    /// their absolute pairwise differences (Shamos estimator; Bickel and Lehmann 1979), or the trial's own standard
    /// error if that is larger. If a frequency has only two trials and they disagree, both are returned.
    pub fn find(trials: &[TrialRow]) -> Vec<Self> {
        let mut campaigns: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (index, trial) in trials.iter().enumerate() {
            if trial.status.has_metrics() && trial.frequency_rad_s() > 0.0 {
                campaigns.entry(&trial.campaign).or_default().push(index);
            }
        }
        let mut worst: BTreeMap<usize, Self> = BTreeMap::new();
        for indices in campaigns.into_values() {
            let groups = repeats(trials, indices);
            for metric in Metric::ALL.into_iter().filter(|of| of.is_independent_size()) {
                for found in unlike(trials, &groups, metric) {
                    let known = worst.entry(found.index).or_insert_with(|| found.clone());
                    if found.deviations > known.deviations {
                        *known = found;
                    }
                }
            }
        }
        worst.into_values().collect()
    }
}

/// Returns the trials of a campaign grouped by day and frequency.
fn repeats(trials: &[TrialRow], mut indices: Vec<usize>) -> Vec<Vec<usize>> {
    indices.sort_by(|a, b| {
        let [a, b] = [a, b].map(|index| &trials[*index]);
        a.day.cmp(&b.day).then_with(|| a.frequency_rad_s().total_cmp(&b.frequency_rad_s()))
    });
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for index in indices {
        let is_repeat = |first: &usize| {
            let [first, own] = [*first, index].map(|index| &trials[index]);
            let max_rad_s = first.frequency_rad_s() * (1.0 + SAME_FREQUENCY);
            own.day == first.day && own.frequency_rad_s() <= max_rad_s
        };
        match groups.last_mut() {
            Some(group) if is_repeat(&group[0]) => group.push(index),
            _ => groups.push(vec![index]),
        }
    }
    groups
}

/// Measured metric of a trial and its repeats.
struct Repeats {
    /// Indices of the trials.
    indices: Vec<usize>,
    /// Logarithms of the metric.
    logarithms: Vec<f64>,
    /// Median of the logarithms.
    median: f64,
}

impl Repeats {
    /// Returns the absolute deviation from the median of the trial with the given place in the group, relative to the
    /// root mean square of the deviations that a unit standard deviation causes.
    fn deviation(&self, place: usize) -> f64 {
        let count = self.indices.len() as f64;
        // The median of an even number of values follows each of them.
        let expected =
            if self.indices.len().is_multiple_of(2) { (1.0 - 1.0 / count).sqrt() } else { 1.0 };
        (self.logarithms[place] - self.median).abs() / expected
    }
}

/// Returns the trials of a campaign whose metric deviates from that of their repeats.
fn unlike(trials: &[TrialRow], groups: &[Vec<usize>], metric: Metric) -> Vec<UnlikeRepeats> {
    let value = |index: usize| trials[index].metrics[metric];
    let groups: Vec<Repeats> = groups
        .iter()
        .map(|group| group.iter().copied().filter(|index| value(*index) > 0.0).collect())
        .filter(|indices: &Vec<usize>| indices.len() > 1)
        .map(|indices| {
            let logarithms: Vec<f64> = indices.iter().map(|index| value(*index).ln()).collect();
            let median = median(logarithms.clone());
            Repeats { indices, logarithms, median }
        })
        .collect();
    let repeats: usize = groups.iter().map(|group| group.indices.len() - 1).sum();
    if repeats < MIN_REPEATS {
        return Vec::new();
    }
    // Trials that are found do not count as scatter, so that others that they have masked are found, too.
    let mut found: Vec<UnlikeRepeats> = Vec::new();
    loop {
        let is_found = |index: usize| found.iter().any(|one| one.index == index);
        let Some(scatter) = scatter(&groups, is_found) else { return found };
        let mut more = Vec::new();
        for group in &groups {
            for (place, &index) in group.indices.iter().enumerate() {
                let error = trials[index].metrics_se[metric] / value(index);
                let deviations = group.deviation(place) / scatter.max(error);
                if deviations > MAX_DEVIATIONS && !is_found(index) {
                    more.push(UnlikeRepeats {
                        index,
                        metric,
                        median: group.median.exp(),
                        trials: group.indices.len(),
                        deviations,
                    });
                }
            }
        }
        if more.is_empty() {
            return found;
        }
        found.extend(more);
    }
}

/// Returns the robust standard deviation of the logarithms of repeats, without the trials that `is_left_out`; `None` if
/// too few are left.
fn scatter(groups: &[Repeats], is_left_out: impl Fn(usize) -> bool) -> Option<f64> {
    let mut differences = Vec::new();
    for group in groups {
        let kept = group.indices.iter().zip(&group.logarithms);
        let kept: Vec<f64> =
            kept.filter(|(index, _)| !is_left_out(**index)).map(|(_, of)| *of).collect();
        for (place, one) in kept.iter().enumerate() {
            differences.extend(kept[..place].iter().map(|other| (one - other).abs()));
        }
    }
    let is_enough = differences.len() >= MIN_DIFFERENCES;
    is_enough.then(|| (SHAMOS * median(differences)).max(MIN_SCATTER))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};
    use trilink_robot::metrics::{GaitMetrics, padded};

    use super::*;
    use crate::Columns as _;

    /// Returns trials with independent relative deviations of 1 % of d and 5 % of the skid ratios.
    fn trials(frequencies: usize, repeats: usize, seed: u64) -> Vec<TrialRow> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut scattered = |value: f64, relative: f64| {
            let normal: f64 = StandardNormal.sample(&mut random);
            value * (1.0 + relative * normal)
        };
        let mut trials = Vec::new();
        for frequency in 1..=frequencies {
            for _ in 0..repeats {
                let sigma = [0.3, 0.1, 0.2].map(|sigma| scattered(sigma, 0.05));
                let d_m = scattered(0.1 * frequency as f64, 0.01);
                trials.push(TrialRow {
                    omega_commanded_rad_s: frequency as f64,
                    metrics: GaitMetrics { d_m, sigma: padded(&sigma), ..GaitMetrics::MISSING },
                    ..TrialRow::blank()
                });
            }
        }
        trials
    }

    fn found(trials: &[TrialRow]) -> Vec<usize> {
        UnlikeRepeats::find(trials).iter().map(|unlike| unlike.index).collect()
    }

    #[test]
    fn five_of_twenty_four_trials_that_are_unlike_their_repeats_are_found() {
        let mut exact = 0;
        for seed in 0..50 {
            let mut trials = trials(8, 3, seed);
            let unlike = [1, 5, 6, 14, 21];
            unlike.iter().for_each(|index| trials[*index].metrics.d_m *= 1.5);
            let found = found(&trials);
            assert!(unlike.iter().filter(|index| found.contains(index)).count() >= 4, "{found:?}");
            exact += usize::from(found == unlike);
        }
        assert!(exact >= 45, "{exact}");
    }

    #[test]
    fn trials_that_only_scatter_are_seldom_unlike_their_repeats() {
        for (frequencies, repeats) in [(6, 2), (12, 2), (6, 3), (2, 4), (5, 4), (1, 8)] {
            let campaigns =
                (0..400).filter(|seed| !found(&trials(frequencies, repeats, *seed)).is_empty());
            let count = campaigns.count();
            assert!(count <= 20, "{frequencies} {repeats}: {count}");
        }
    }

    #[test]
    fn two_trials_that_disagree_are_both_found_also_among_exact_repeats() {
        for spread in [1.0, 0.0] {
            let mut trials = trials(8, 2, 1);
            for trial in &mut trials {
                let exact = 0.1 * trial.omega_commanded_rad_s;
                trial.metrics.d_m = exact + spread * (trial.metrics.d_m - exact);
            }
            trials[6].metrics.d_m *= 1.4;
            assert_eq!(found(&trials), [6, 7]);
        }
    }

    #[test]
    fn the_worst_metric_is_named_with_the_median_of_the_repeats() {
        let mut trials = trials(6, 3, 1);
        trials[4].metrics.d_m *= 1.1;
        trials[4].metrics.sigma[1] *= 4.0;
        let unlike = UnlikeRepeats::find(&trials);
        let [unlike] = unlike.as_slice() else { panic!("{unlike:?}") };
        assert_eq!((unlike.index, unlike.metric, unlike.trials), (4, Metric::Sigma1, 3));
        assert!((unlike.median / 0.1 - 1.0).abs() < 0.15, "{unlike:?}");
        // A standard error explains the deviation.
        trials[4].metrics_se.d_m = 0.05;
        trials[4].metrics_se.sigma[1] = 0.2;
        assert_eq!(found(&trials), []);
    }

    #[test]
    fn trials_of_other_days_and_frequencies_are_not_repeats() {
        let mut days = trials(6, 3, 1);
        for (index, trial) in days.iter_mut().enumerate() {
            trial.day = format!("day {}", index % 3);
            trial.metrics.d_m *= 1.0 + 0.3 * (index % 3) as f64;
        }
        assert_eq!(found(&days), []);
        let mut single = trials(18, 1, 1);
        single[4].metrics.d_m *= 2.0;
        assert_eq!(found(&single), []);
        let mut few = trials(2, 3, 1);
        few[4].metrics.d_m *= 2.0;
        assert_eq!(found(&few), []);
    }
}
