//! Means over the trials of a campaign, in which a small shift of all of them shows.

use super::judge::StandardError;
use super::snapshot::{Cell, Record, Records};

const COLUMNS: [&str; 11] = [
    "omega_rad_s",
    "d_m",
    "v_m_s",
    "sigma0",
    "sigma1",
    "sigma2",
    "sigma0_debiased",
    "sigma1_debiased",
    "sigma2_debiased",
    "alpha1_rad",
    "dtheta_rad",
];

/// Each campaign's means over the trials that both runs have, with their standard errors.
pub fn of_campaigns(then: &Records, now: &Records) -> [Records; 2] {
    let mut means = [Records::new(), Records::new()];
    let campaign = |record: &Record| match record.get("campaign") {
        Some(Cell::Text(name)) if !name.is_empty() => Some(name.clone()),
        _ => None,
    };
    let mut names: Vec<String> = then.values().filter_map(campaign).collect();
    names.sort();
    names.dedup();
    for name in names {
        let of_campaign =
            then.iter().filter(|(_, record)| campaign(record).as_ref() == Some(&name));
        let both: Vec<[&Record; 2]> =
            of_campaign.filter_map(|(of, record)| Some([record, now.get(of)?])).collect();
        let mut records = [Record::new(), Record::new()];
        for column in COLUMNS {
            // A trial counts if it has the value in both runs.
            let has =
                |pair: &&[&Record; 2]| pair.iter().all(|record| value(record, column).is_some());
            let pairs: Vec<_> = both.iter().filter(has).collect();
            for run in [0, 1] {
                let values = pairs.iter().filter_map(|pair| value(pair[run], column));
                if let Some((mean, error)) = mean(values) {
                    records[run].insert(column.to_owned(), Cell::Number(mean));
                    records[run].insert(format!("{column}_se"), Cell::Number(error.error));
                    // Where standard errors are looked for, degrees of freedom are cycles less 1.
                    let cycles = error.freedom + 1.0;
                    records[run].entry("cycles".to_owned()).or_insert(Cell::Number(cycles));
                }
            }
        }
        let [then, now] = records;
        means[0].insert(name.clone(), then);
        means[1].insert(name, now);
    }
    means
}

/// A value with its standard error and what that is known by.
fn value(record: &Record, column: &str) -> Option<(f64, StandardError)> {
    let number = |name: &str| record.get(name).and_then(Cell::number);
    let error = number(&format!("{column}_se"))?;
    let freedom = (number("cycles")? - 1.0).max(1.0);
    Some((number(column)?, StandardError { error, freedom }))
}

fn mean(values: impl Iterator<Item = (f64, StandardError)>) -> Option<(f64, StandardError)> {
    let (mut sum, mut error, mut count) = (0.0, None::<StandardError>, 0.0);
    for (value, of_value) in values {
        sum += value;
        error = Some(error.map_or(of_value, |error| error.with(of_value)));
        count += 1.0;
    }
    let error = error?;
    Some((sum / count, StandardError { error: error.error / count, ..error }))
}
