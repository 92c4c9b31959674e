//! `fits.json`: the fitted models for scripts that do not read Parquet.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{ReportError, parameters};
use crate::store::FitRow;

#[derive(Serialize)]
struct Fit<'f> {
    campaign: &'f str,
    model: &'f str,
    /// By column name; null where the model does not have the parameter.
    parameters: BTreeMap<&'static str, Option<f64>>,
    free: &'f [String],
    insensitive: &'f [String],
    at_bound: &'f [String],
    j: Option<f64>,
    starts: i64,
    solves: i64,
    status: &'f str,
}

/// The fits as a JSON array, in order.
///
/// # Errors
/// None that is known; those of the encoder.
pub fn json(fits: &[FitRow]) -> Result<Vec<u8>, ReportError> {
    let number = |value: f64| Some(value).filter(|value| value.is_finite());
    let fits: Vec<Fit> = fits
        .iter()
        .map(|fit| Fit {
            campaign: &fit.campaign,
            model: &fit.model,
            parameters: parameters::of_fit(fit)
                .iter()
                .map(|parameter| (parameter.name, number(parameter.value)))
                .collect(),
            free: &fit.free,
            insensitive: &fit.insensitive,
            at_bound: &fit.at_bound,
            j: number(fit.j),
            starts: fit.starts,
            solves: fit.solves,
            status: &fit.status,
        })
        .collect();
    let mut json = serde_json::to_vec_pretty(&fits).map_err(ReportError::Json)?;
    json.push(b'\n');
    Ok(json)
}
