//! Means over the trials of a campaign, which reveal a small shift that all trials share.

use std::collections::BTreeSet;

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
            let value = |trial: &Record| {
                Some((number(trial, column)?, StandardError::from_record(column, trial)?))
            };
            // Only trials that have the value in both runs are used.
            let values: Vec<_> =
                pairs.iter().filter_map(|[then, now]| Some([value(then)?, value(now)?])).collect();
            for (run, record) in records.iter_mut().enumerate() {
                let Some((mean, error)) = mean(values.iter().map(|pair| pair[run])) else {
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

/// Returns the mean of independent values and its standard error; `None` without values.
pub(super) fn mean(
    values: impl ExactSizeIterator<Item = (f64, StandardError)>,
) -> Option<(f64, StandardError)> {
    let count = values.len() as f64;
    let (sum, error) =
        values.reduce(|(sum, error), (value, own)| (sum + value, error.combine(own)))?;
    Some((sum / count, StandardError { error: error.error / count, ..error }))
}
