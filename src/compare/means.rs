//! Means over the trials of a campaign, which reveal a small shift that all trials share.

use std::collections::{BTreeMap, BTreeSet};

use trilink_robot::metrics::Metric;

use super::judge::StandardError;
use super::snapshot::{Record, Records, number, text};

/// Returns each campaign's means over the trials that both runs have, with their standard errors.
pub(super) fn campaign_means(runs: [&Records; 2]) -> [Records; 2] {
    let mut means = [Records::new(), Records::new()];
    for campaign in campaigns(runs[0]) {
        let trials = runs[0].iter().filter(|(_, trial)| text(trial, "campaign") == campaign);
        let pairs: Vec<[&Record; 2]> =
            trials.filter_map(|(name, trial)| Some([trial, runs[1].get(name)?])).collect();
        let mut records = [Record::new(), Record::new()];
        let columns = ["omega_rad_s"].into_iter().chain(Metric::ALL.map(Metric::column));
        let debiased = Metric::ALL.into_iter().filter_map(|metric| metric.definition().debiased);
        for column in columns.chain(debiased) {
            // Only trials that have the value in both runs are used.
            let is_known = |trial: &&Record| {
                number(trial, column).is_some() && StandardError::of_cycles(column, trial).is_some()
            };
            let known: Vec<&[&Record; 2]> =
                pairs.iter().filter(|pair| pair.iter().all(is_known)).collect();
            for (run, record) in records.iter_mut().enumerate() {
                let trials = known.iter().map(|pair| (pair[run], 1.0 / known.len() as f64));
                let Some((mean, Some(error))) = mean(&trials.collect::<Vec<_>>(), column) else {
                    continue;
                };
                record.insert(column.to_owned(), mean.into());
                record.insert(format!("{column}_se"), error.error.into());
                // `StandardError::from_record` takes cycles - 1 as the degrees of freedom.
                record.entry("cycles".to_owned()).or_insert((error.freedom + 1.0).into());
            }
        }
        for (means, record) in means.iter_mut().zip(records) {
            means.insert(campaign.to_owned(), record);
        }
    }
    means
}

/// Returns the sorted names of the campaigns that have trials.
pub(super) fn campaigns(trials: &Records) -> BTreeSet<&str> {
    trials.values().map(|trial| text(trial, "campaign")).filter(|name| !name.is_empty()).collect()
}

/// Mean of a metric over the frequencies of a campaign.
pub(super) struct MeanOverFrequencies {
    pub value: f64,
    /// Standard error; NaN if unknown.
    pub error: f64,
    /// The commanded frequencies, such as `0.50, 1.00`, rad/s.
    pub frequencies: String,
}

impl MeanOverFrequencies {
    /// Averages a column over the repeats at each commanded frequency, and then over the frequencies; `None` without
    /// values.
    pub(super) fn new(trials: &[&Record], column: &str) -> Option<Self> {
        let mut repeats: BTreeMap<String, Vec<&Record>> = BTreeMap::new();
        for trial in trials.iter().filter(|trial| number(trial, column).is_some()) {
            let omega = number(trial, "omega_commanded_rad_s").unwrap_or(f64::NAN);
            repeats.entry(format!("{omega:05.2}")).or_default().push(trial);
        }
        let weighted = repeats.values().flat_map(|trials| {
            let weight = 1.0 / (trials.len() * repeats.len()) as f64;
            trials.iter().map(move |trial| (*trial, weight))
        });
        let (value, error) = mean(&weighted.collect::<Vec<_>>(), column)?;
        let frequencies = repeats.keys().map(|omega| omega.trim_start_matches('0'));
        let frequencies = frequencies.collect::<Vec<_>>().join(", ");
        Some(Self { value, error: error.map_or(f64::NAN, |of| of.error), frequencies })
    }
}

/// Returns the mean of a column over trials with weights whose sum is 1, and its standard error if that of each trial
/// is known; `None` without trials. Cycles scatter independently. What trials and days vary by is taken as common to
/// the trials of a day, because days often shift all trials alike.
fn mean(trials: &[(&Record, f64)], column: &str) -> Option<(f64, Option<StandardError>)> {
    let values = trials.iter().map(|(trial, weight)| Some(weight * number(trial, column)?));
    let sum = values.sum::<Option<f64>>().filter(|_| !trials.is_empty())?;
    let scaled = |of: Option<StandardError>, weight: f64| {
        of.map(|of| StandardError { error: weight * of.error, ..of })
    };
    let of_cycles = trials
        .iter()
        .map(|(trial, weight)| scaled(StandardError::of_cycles(column, trial), *weight))
        .reduce(|sum, own| Some(sum?.combine(own?)))
        .flatten();
    let days: BTreeSet<&str> = trials.iter().map(|(trial, _)| text(trial, "day")).collect();
    let between = trials
        .iter()
        .filter_map(|(trial, weight)| scaled(StandardError::between(column, trial), *weight))
        .reduce(|sum, own| StandardError {
            error: sum.error + own.error,
            freedom: sum.freedom.min(own.freedom),
        });
    let between = scaled(between, 1.0 / (days.len() as f64).sqrt());
    let error = of_cycles.map(|of| between.map_or(of, |between| of.combine(between)));
    Some((sum, error))
}
