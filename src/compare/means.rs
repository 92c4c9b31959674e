//! Means over the trials of a campaign, in which a small shift of all of them shows.

use std::collections::BTreeSet;

use trilink_robot::metrics::Metric;

use super::judge::StandardError;
use super::snapshot::{Record, Records, number, text};

/// Each campaign's means over the trials that both runs have, with their standard errors.
pub(super) fn of_campaigns(runs: [&Records; 2]) -> [Records; 2] {
    let mut means = [Records::new(), Records::new()];
    for campaign in campaigns(runs[0]) {
        let of_campaign = runs[0].iter().filter(|(_, trial)| text(trial, "campaign") == campaign);
        let pairs: Vec<[&Record; 2]> =
            of_campaign.filter_map(|(name, trial)| Some([trial, runs[1].get(name)?])).collect();
        let mut records = [Record::new(), Record::new()];
        let columns = ["omega_rad_s"].into_iter().chain(Metric::ALL.map(Metric::column));
        let debiased = Metric::ALL.into_iter().filter_map(|metric| metric.definition().debiased);
        for column in columns.chain(debiased) {
            let value = |of: &Record| Some((number(of, column)?, StandardError::of(column, of)?));
            // A trial counts if it has the value in both runs.
            let values: Vec<_> =
                pairs.iter().filter_map(|[then, now]| Some([value(then)?, value(now)?])).collect();
            for (run, record) in records.iter_mut().enumerate() {
                let Some((mean, error)) = mean(values.iter().map(|pair| pair[run])) else {
                    continue;
                };
                record.insert(column.to_owned(), mean.into());
                record.insert(format!("{column}_se"), error.error.into());
                // Where standard errors are looked for, degrees of freedom are cycles less 1.
                record.entry("cycles".to_owned()).or_insert((error.freedom + 1.0).into());
            }
        }
        for (means, record) in means.iter_mut().zip(records) {
            means.insert(campaign.to_owned(), record);
        }
    }
    means
}

/// Names of the campaigns that have trials, in order.
pub(super) fn campaigns(trials: &Records) -> BTreeSet<&str> {
    trials.values().map(|trial| text(trial, "campaign")).filter(|name| !name.is_empty()).collect()
}

/// A mean and its standard error.
pub(super) fn mean(
    values: impl ExactSizeIterator<Item = (f64, StandardError)>,
) -> Option<(f64, StandardError)> {
    let count = values.len() as f64;
    let (sum, error) =
        values.reduce(|(sum, error), (value, of_value)| (sum + value, error.with(of_value)))?;
    Some((sum / count, StandardError { error: error.error / count, ..error }))
}
