//! `fits.json`: the fitted models for scripts that do not read Parquet.

use std::collections::BTreeMap;

use serde::Serialize;

use super::ReportError;
use crate::config::GaitInput;
use crate::motion::Model;
use crate::robot::Parameter;
use crate::store::{ComparisonRow, FitRow, FitStatus};

#[derive(Serialize)]
struct Fit<'f> {
    campaign: &'f str,
    model: Model,
    /// By column name; null where the model does not have the parameter.
    parameters: BTreeMap<&'static str, Option<f64>>,
    /// 95 % confidence limits of the fitted ones; null where the interval is open.
    intervals: BTreeMap<&'static str, [Option<f64>; 2]>,
    free: &'f [Parameter],
    measured: &'f [Parameter],
    identifiable: &'f [Parameter],
    practically_not: &'f [Parameter],
    structurally_not: &'f [Parameter],
    at_bound: &'f [Parameter],
    j: Option<f64>,
    comparison: Option<Comparison<'f>>,
    starts: i64,
    starts_reached: i64,
    solves: i64,
    status: &'f FitStatus,
}

/// How the model compares with its campaign's others.
#[derive(Serialize)]
struct Comparison<'f> {
    j_d: Option<f64>,
    j_v: Option<f64>,
    j_sigma: Option<f64>,
    j_alpha: Option<f64>,
    j_left_out: Option<f64>,
    criterion: Option<f64>,
    wins: Option<f64>,
    other_gait_input: &'f str,
    other_gait_j: Option<f64>,
    sentence: &'f str,
}

/// The fits as a JSON array, in order.
///
/// # Errors
/// None that is known; those of the encoder.
pub fn json(fits: &[FitRow], comparison: &[ComparisonRow]) -> Result<Vec<u8>, ReportError> {
    let number = |value: f64| Some(value).filter(|value| value.is_finite());
    let compared = |fit: &FitRow| {
        let mut rows = comparison.iter();
        let row = rows.find(|row| row.campaign == fit.campaign && row.model == fit.model)?;
        Some(Comparison {
            j_d: number(row.j_d),
            j_v: number(row.j_v),
            j_sigma: number(row.j_sigma),
            j_alpha: number(row.j_alpha),
            j_left_out: number(row.j_left_out),
            criterion: number(row.criterion),
            wins: number(row.wins),
            other_gait_input: row.other_gait_input.map_or("", GaitInput::name),
            other_gait_j: number(row.other_gait_j),
            sentence: &row.sentence,
        })
    };
    let fits: Vec<Fit> = fits
        .iter()
        .map(|fit| Fit {
            campaign: &fit.campaign,
            model: fit.model,
            parameters: fit
                .parameters
                .iter()
                .map(|(of, value)| (of.column(), number(*value)))
                .collect(),
            intervals: fit
                .free
                .iter()
                .map(|of| (of.column(), [fit.lower[*of], fit.upper[*of]].map(number)))
                .collect(),
            free: &fit.free,
            measured: &fit.measured,
            identifiable: &fit.identifiable,
            practically_not: &fit.practically_not,
            structurally_not: &fit.structurally_not,
            at_bound: &fit.at_bound,
            j: number(fit.j),
            comparison: compared(fit),
            starts: fit.starts,
            starts_reached: fit.starts_reached,
            solves: fit.solves,
            status: &fit.status,
        })
        .collect();
    let mut json = serde_json::to_vec_pretty(&fits).map_err(ReportError::Json)?;
    json.push(b'\n');
    Ok(json)
}
