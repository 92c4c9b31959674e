//! The scorecard: every number and claim that the paper prints, and what becomes of it.
//!
//! The claims and how each is answered are data, `claims.toml`. A claim has a *computed* number,
//! which the motion solver gives from the paper's own parameters whatever the user's
//! configuration says, or a *measured* one, which the tables of the trials at hand give, or both.
//! Nothing is fitted or tuned to a claim.
//!
//! # Verdicts
//!
//! - `reproduced`: the number that the claim is judged by meets its criterion. That is half a
//!   unit of the last printed digit unless the claim has a criterion of its own: 10 % where the
//!   paper says "approximately" or that a model agrees well with a measurement, 0.5 rad/s (a step
//!   of the trials) where it says "around" a frequency, for fitted coefficients the fit's 95 %
//!   confidence interval, give or take the rounding of the printed value, and for statements in
//!   words the bound that the data file gives.
//! - `differs`: it does not, or there is no such number (a motion that does not exist).
//! - `not testable here`: the data file gives a reason, or the folder lacks what it takes.
//!
//! What the authors measured on their robot is judged by the computed number, with their fitted
//! parameters, where there is one: other trials cannot refute a measurement. Fitted coefficients
//! and comparisons of fitted models are judged by the trials at hand; where those are synthetic
//! the remark says so.

mod claims;
mod computed;
mod measured;
mod mechanics;
mod moments;
mod paper;
mod parameters;
mod sweep;
#[cfg(test)]
mod tests;
mod verdict;
mod view;

use std::collections::BTreeSet;

use rayon::prelude::*;
use serde::Serialize;

use super::ReportError;
use super::numbers::significant;
use super::tables::Tables;
use crate::report::ReportInput;
use claims::{Claim, Claims, Judged, Printed};
use computed::Found;
use paper::Paper;
use sweep::Curves;
use verdict::{Verdict, judge};
pub use view::View;

/// Said of what is judged by trials that no camera recorded.
const SYNTHETIC: &str = "The trials are synthetic.";

/// One line of the scorecard. A number that there is not, or that has no bound, is null.
#[derive(Debug, Serialize)]
pub struct Entry {
    pub id: String,
    pub part: String,
    pub place: String,
    pub claim: String,
    /// What the numbers are, where the claim does not say it itself.
    pub quantity: String,
    pub printed: Option<Printed>,
    pub unit: String,
    pub criterion: Option<String>,
    pub judged_by: Option<Judged>,
    pub computed: Option<f64>,
    pub measured: Option<f64>,
    /// Of the number that it is judged by from the printed one.
    pub relative_difference: Option<f64>,
    pub verdict: &'static str,
    pub remark: String,
}

/// Judges every claim, by the paper's parameters and by the `tables` at hand; `is_synthetic` if
/// those come from trials with a planted truth.
///
/// # Errors
/// The claims that come with the program cannot be read.
pub fn scorecard(
    config: &ReportInput,
    tables: &Tables,
    is_synthetic: bool,
) -> Result<Vec<Entry>, ReportError> {
    let claims = Claims::load().map_err(ReportError::Claims)?;
    let paper = Paper::new(&claims);
    let answers = claims.claim.iter().flat_map(|claim| {
        claim.computed.iter().chain(claim.also.iter().map(|also| &also.computed))
    });
    let swept: BTreeSet<&str> = answers.flat_map(|computed| computed.swept()).collect();
    let curves = sweep::curves(&paper, &swept);
    let entry = |claim: &Claim| {
        let computed = claim.computed.as_ref().map(|computed| computed.find(&paper, &curves));
        let measured = claim.measured.as_ref();
        let measured = measured.and_then(|of| of.find(&paper, tables, config.sigma));
        entry(claim, computed, measured, &more(claim, &paper, &curves), is_synthetic)
    };
    Ok(claims.claim.par_iter().map(entry).collect())
}

/// `scorecard.json`.
///
/// # Errors
/// None that is known; those of the encoder.
pub fn json(entries: &[Entry]) -> Result<Vec<u8>, ReportError> {
    let mut json = serde_json::to_vec_pretty(entries).map_err(ReportError::Json)?;
    json.push(b'\n');
    Ok(json)
}

/// The sentences of [`Claim::also`].
fn more(claim: &Claim, paper: &Paper<'_>, curves: &Curves) -> Vec<String> {
    let sentence = |also: &claims::Also| {
        let number = significant(also.computed.find(paper, curves).value, 6);
        also.text.replace("{}", &number)
    };
    claim.also.iter().map(sentence).collect()
}

fn entry(
    claim: &Claim,
    computed: Option<Found>,
    measured: Option<Found>,
    more: &[String],
    is_synthetic: bool,
) -> Entry {
    let judged = match claim.judged {
        Judged::Computed => computed.as_ref(),
        Judged::Measured => measured.as_ref(),
    };
    let (verdict, reason) = judge(claim, judged);
    let is_judged = verdict != Verdict::NotTestable;
    let by_trials = is_judged && claim.judged == Judged::Measured;
    let note = judged.filter(|_| is_judged).map(note).unwrap_or_default();
    let synthetic = if by_trials && is_synthetic { SYNTHETIC } else { "" };
    let sentences = [reason.as_deref().unwrap_or_default(), &claim.remark, &note];
    let sentences = sentences.into_iter().chain(more.iter().map(String::as_str)).chain([synthetic]);
    let sentences: Vec<&str> = sentences.filter(|sentence| !sentence.is_empty()).collect();

    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    let printed = claim.printed.as_ref().and_then(Printed::number);
    let relative_difference = match (judged.filter(|_| is_judged), printed) {
        (Some(found), Some(printed)) if printed != 0.0 => finite(found.value / printed - 1.0),
        _ => None,
    };
    let number = |found: &Option<Found>| found.as_ref().and_then(|found| finite(found.value));
    Entry {
        id: claim.id.clone(),
        part: claim.part.clone(),
        place: claim.place.clone(),
        claim: claim.claim.clone(),
        quantity: claim.quantity.clone(),
        printed: claim.printed.clone(),
        unit: claim.unit.clone(),
        criterion: claim.criterion.map(|criterion| criterion.text()),
        judged_by: is_judged.then_some(claim.judged),
        computed: number(&computed),
        measured: number(&measured),
        relative_difference,
        verdict: verdict.name(),
        remark: sentences.join(" "),
    }
}

/// What is to be said of a number beside the verdict.
fn note(found: &Found) -> String {
    let Some([low, high]) = found.limits else { return found.note.clone() };
    let text = |limit: f64, open: &str| match limit.is_finite() {
        true => significant(limit, 4),
        false => open.to_owned(),
    };
    format!("95 % interval {} to {}.", text(low, "0"), text(high, "∞"))
}
