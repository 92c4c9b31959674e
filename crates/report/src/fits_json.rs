//! `fits.json`: the fitted models for scripts that do not read Parquet. NaN becomes null.

use std::collections::BTreeMap;

use serde::Serialize;
use trilink_robot::{Model, Parameter};
use trilink_tables::{ComparisonRow, FitRow, SharedFitRow};

use super::tables::Tables;

#[derive(Serialize)]
pub(crate) struct Fit<'f> {
    #[serde(flatten)]
    fit: &'f FitRow,
    /// 95 % confidence limits of the fitted parameters by column; null where the interval is open.
    intervals: BTreeMap<&'static str, [f64; 2]>,
    /// How the model compares with its campaign's others.
    comparison: Option<Compared<'f>>,
    /// The same model driven by the other gait than the configured one.
    other_gait: Option<Box<Fit<'f>>>,
    /// The same model fitted to all campaigns of the robot together.
    shared: Option<&'f SharedFitRow>,
}

#[derive(Serialize)]
pub(crate) struct Compared<'f> {
    #[serde(flatten)]
    row: &'f ComparisonRow,
    sentence: Option<String>,
}

impl<'f> Fit<'f> {
    fn new(fit: &'f FitRow) -> Self {
        let interval = |of: &Parameter| (of.name(), [fit.lower[*of], fit.upper[*of]]);
        let intervals = fit.free.iter().map(interval).collect();
        Self { fit, intervals, comparison: None, other_gait: None, shared: None }
    }
}

/// The fits, in order.
pub(crate) fn fits(tables: &Tables) -> Vec<Fit<'_>> {
    let with_others = tables.fits.iter().map(|fit| {
        let is_same = |campaign: &str, model: Model| campaign == fit.campaign && model == fit.model;
        let mut compared = tables.comparison.iter();
        let mut others = tables.alternative_fits.iter();
        let mut shared = tables.shared_fits.iter();
        Fit {
            comparison: compared.find(|row| is_same(&row.campaign, row.model)).map(|row| {
                let sentence = tables.compared(&row.campaign).map(|all| all.to_string());
                Compared { row, sentence }
            }),
            other_gait: others
                .find(|other| is_same(&other.campaign, other.model))
                .map(|other| Fit::new(other).into()),
            shared: shared.find(|row| row.campaigns.iter().any(|of| is_same(of, row.fit.model))),
            ..Fit::new(fit)
        }
    });
    with_others.collect()
}
