//! `fits.json`: the fitted models for scripts that do not read Parquet. NaN becomes null.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::config::GaitInput;
use crate::motion::Model;
use crate::robot::Parameter;
use crate::store::{ComparisonRow, FitRow, FitStatus};

#[derive(Serialize)]
pub struct Fit<'f> {
    campaign: &'f str,
    model: Model,
    /// By column name; null where the model does not have the parameter.
    parameters: BTreeMap<&'static str, f64>,
    /// 95 % confidence limits of the fitted ones; null where the interval is open, and all of them
    /// for the reason in `no_interval`.
    intervals: BTreeMap<&'static str, [f64; 2]>,
    /// Half widths of these by one part alone.
    scatter: BTreeMap<&'static str, f64>,
    systematic: BTreeMap<&'static str, f64>,
    no_interval: &'f str,
    free: &'f [Parameter],
    measured: &'f [Parameter],
    identifiable: &'f [Parameter],
    practically_not: &'f [Parameter],
    structurally_not: &'f [Parameter],
    at_bound: &'f [Parameter],
    j: f64,
    lack_of_fit: f64,
    lack_of_fit_limit: f64,
    adequate: Option<bool>,
    misfit: &'f str,
    notes: &'f str,
    comparison: Option<Comparison<'f>>,
    starts: i64,
    starts_reached: i64,
    solves: i64,
    status: &'f FitStatus,
}

/// How the model compares with its campaign's others.
#[derive(Serialize)]
struct Comparison<'f> {
    j_d: f64,
    j_v: f64,
    j_sigma: f64,
    j_alpha: f64,
    j_left_out: f64,
    criterion: f64,
    wins: f64,
    other_gait_input: &'f str,
    other_gait_j: f64,
    sentence: &'f str,
}

/// The fits, in order.
pub fn fits<'f>(fits: &'f [FitRow], comparison: &'f [ComparisonRow]) -> Vec<Fit<'f>> {
    let compared = |fit: &FitRow| {
        let mut rows = comparison.iter();
        let row = rows.find(|row| row.campaign == fit.campaign && row.model == fit.model)?;
        Some(Comparison {
            j_d: row.j_d,
            j_v: row.j_v,
            j_sigma: row.j_sigma,
            j_alpha: row.j_alpha,
            j_left_out: row.j_left_out,
            criterion: row.criterion,
            wins: row.wins,
            other_gait_input: row.other_gait_input.map_or("", GaitInput::name),
            other_gait_j: row.other_gait_j,
            sentence: &row.sentence,
        })
    };
    let fit = |fit: &'f FitRow| {
        let interval = |of: &Parameter| (of.name(), [fit.lower[*of], fit.upper[*of]]);
        Fit {
            campaign: &fit.campaign,
            model: fit.model,
            parameters: fit.parameters.iter().map(|(of, value)| (of.name(), *value)).collect(),
            intervals: fit.free.iter().map(interval).collect(),
            scatter: fit.free.iter().map(|of| (of.name(), fit.scatter[*of])).collect(),
            systematic: fit.free.iter().map(|of| (of.name(), fit.systematic[*of])).collect(),
            no_interval: &fit.no_interval,
            free: &fit.free,
            measured: &fit.measured,
            identifiable: &fit.identifiable,
            practically_not: &fit.practically_not,
            structurally_not: &fit.structurally_not,
            at_bound: &fit.at_bound,
            j: fit.j,
            lack_of_fit: fit.lack_of_fit,
            lack_of_fit_limit: fit.lack_of_fit_limit,
            adequate: fit.adequate,
            misfit: &fit.misfit,
            notes: &fit.notes,
            comparison: compared(fit),
            starts: fit.starts,
            starts_reached: fit.starts_reached,
            solves: fit.solves,
            status: &fit.status,
        }
    };
    fits.iter().map(fit).collect()
}
