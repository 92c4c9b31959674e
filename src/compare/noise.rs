//! Variation between trials and days, which the cycles of one recording do not contain.

use std::collections::{BTreeMap, BTreeSet};

use trilink_tables::{PrecisionRow, ResidualRow};

use super::snapshot::{Record, Records, number, text};

/// Suffix of a trial's column with the standard deviation of a metric between such trials, on different days if the
/// trials are of several days, in the unit of the metric.
pub(super) const BETWEEN: &str = "_between";
/// Suffix of a trial's column with the degrees of freedom of this standard deviation.
pub(super) const BETWEEN_DOF: &str = "_between_dof";

/// Adds to every trial the standard deviations of its metrics between trials and days: those of repeats, whatever the
/// models predict, or else, without repeats, the largest that an adequate model has estimated.
pub(super) fn add_between(
    trials: &mut Records,
    fits: &Records,
    precision: &[PrecisionRow],
    residuals: &[ResidualRow],
) {
    for trial in trials.values_mut() {
        let of_campaign = precision.iter().filter(|row| row.campaign == text(trial, "campaign"));
        let repeats = of_campaign.filter_map(|row| {
            let [deviation, freedom] = if row.reproducibility.is_finite() {
                [row.reproducibility, row.reproducibility_dof]
            } else {
                [row.repeatability, row.repeatability_dof]
            };
            let metric = row.metric.trim_end_matches("_debiased");
            let value = number(trial, &row.metric).or_else(|| number(trial, metric))?;
            (deviation > 0.0).then(|| (metric, deviation * value.abs(), freedom))
        });
        for (metric, deviation, freedom) in repeats.collect::<Vec<_>>() {
            insert(trial, metric, deviation, freedom);
        }
    }
    let verdicts: BTreeMap<[&str; 2], &str> =
        fits.values().map(|fit| (campaign_and_model(fit), text(fit, "adequate"))).collect();
    // Adequate models come before undecided ones; a model without friction does not show how friction varies.
    let mut by_fits: BTreeMap<(&str, &str), (bool, f64)> = BTreeMap::new();
    for row in residuals.iter().filter(|row| row.noise > 0.0) {
        let verdict =
            verdicts.get(&[&*row.campaign, row.model.name()]).copied().unwrap_or_default();
        if verdict != "false" {
            let between = (row.noise.powi(2) - row.standard_error.powi(2)).max(0.0).sqrt();
            let own = (verdict == "true", between);
            let known = by_fits.entry((&row.trial, &row.metric)).or_insert(own);
            if own > *known {
                *known = own;
            }
        }
    }
    for ((trial, metric), (_, deviation)) in by_fits {
        if let Some(trial) = trials.get_mut(trial)
            && !trial.contains_key(&format!("{metric}{BETWEEN}"))
        {
            insert(trial, metric, deviation, f64::INFINITY);
        }
    }
}

fn insert(trial: &mut Record, metric: &str, deviation: f64, freedom: f64) {
    trial.insert(format!("{metric}{BETWEEN}"), deviation.into());
    // JSON has no infinity; a missing number of degrees of freedom is infinite.
    if freedom.is_finite() {
        trial.insert(format!("{metric}{BETWEEN_DOF}"), freedom.into());
    }
}

/// Returns the campaign and the model of each fit that is known to be inadequate. Coefficients of such a model have no
/// true values and switch between local optima by chance.
pub(super) fn inadequate(fits: &Records) -> BTreeSet<[&str; 2]> {
    let inadequate = fits.values().filter(|fit| text(fit, "adequate") == "false");
    inadequate.map(campaign_and_model).collect()
}

/// Returns the campaign and the model that a fit or prediction belongs to.
pub(super) fn campaign_and_model(record: &Record) -> [&str; 2] {
    ["campaign", "model"].map(|column| text(record, column))
}
