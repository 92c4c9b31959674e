//! `fits.json`: the fitted models, for scripts that do not read Parquet. NaN becomes null.

use std::collections::BTreeMap;

use serde::Serialize;
use trilink_robot::Model;
use trilink_tables::{ComparisonRow, FitRow, SharedFitRow};

use super::tables::Tables;

/// Entry in `fits.json`: a fit with its confidence intervals and the related rows of other tables.
#[derive(Serialize)]
pub(crate) struct Fit<'f> {
    #[serde(flatten)]
    fit: &'f FitRow,
    /// 95 % confidence limits of the free parameters, keyed by column name; NaN (null in JSON) where the interval is
    /// open.
    intervals: BTreeMap<&'static str, [f64; 2]>,
    /// Comparison with the other models fitted to the campaign; `None` if the models were not compared.
    comparison: Option<Compared<'f>>,
    /// Fit of the same model with the alternative gait input (measured instead of commanded gait, or vice versa);
    /// `None` if there is none.
    other_gait: Option<Box<Fit<'f>>>,
    /// Fit of the model to all campaigns of the robot together; `None` if there is none.
    shared: Option<&'f SharedFitRow>,
}

/// Row for a model in the model comparison, with the sentence that summarises the comparison for its campaign.
#[derive(Serialize)]
pub(crate) struct Compared<'f> {
    #[serde(flatten)]
    row: &'f ComparisonRow,
    sentence: Option<String>,
}

impl<'f> Fit<'f> {
    fn new(fit: &'f FitRow) -> Self {
        let intervals =
            fit.free.iter().map(|of| (of.name(), [fit.lower[*of], fit.upper[*of]])).collect();
        Self { fit, intervals, comparison: None, other_gait: None, shared: None }
    }
}

/// Returns the entries of `fits.json`, in the order of the `fits` table.
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
