//! Scorecard: verdicts on the printed values and the claims of the paper.
//!
//! The claims and the formulas for their values are defined in `claims.toml`. A claim has a *computed* value, which the
//! motion solver returns for the paper's own parameters, independently of the user's configuration, or a *measured*
//! value from the tables of the user's trials, or both. Nothing is fitted or tuned to a claim. Identities of the
//! mechanics are covered by tests instead, and claims that no program can judge are listed in `docs/paper-claims.md`.
//!
//! # Verdicts
//!
//! - `reproduced`: the judged value meets the claim's criterion: agreement within half a unit of the last printed digit
//!   or within the confidence interval of the measurement, or the meaning of the claim's words (see the head of
//!   `claims.toml`). Every criterion can fail.
//! - `differs`: the value does not meet the criterion or does not exist (because the motion does not exist).
//! - `not testable here`: the tables lack the necessary data, or the trials are synthetic.
//!
//! Claims about trials, or about fits to trials, are judged by the measured value, unless the trials are synthetic,
//! because synthetic trials contain no information on the experiment. Claims about the models with the authors' values
//! are judged by the computed value. As in the paper, only fits with the commanded gait are used.

mod claims;
mod curve;
mod cycle;
mod formula;
mod missing;
mod paper;
#[cfg(test)]
mod tests;
mod trials;
mod verdict;

use std::sync::Arc;

use minijinja::ErrorKind;
use rayon::prelude::*;
use serde::Serialize;
use trilink_base::numbers::{interval, significant};
use trilink_tables::config::SigmaKind;

use super::ReportError;
use super::tables::Tables;
use claims::{Claim, Claims, Judged};
use formula::Formulas;
use missing::NO_MOTION;
use paper::Paper;
use trials::Trials;
use verdict::{Found, Verdict};

/// Claim in the scorecard, with its values and verdict. In JSON, values that do not exist or are infinite are null.
#[derive(Debug, Serialize)]
pub(crate) struct JudgedClaim {
    #[serde(flatten)]
    pub claim: Claim,
    pub judged_by: Option<Judged>,
    pub computed: Option<f64>,
    pub measured: Option<f64>,
    /// Relative difference between the judged value and the printed value; `None` if a value is missing or the printed
    /// one is 0.
    pub relative_difference: Option<f64>,
    pub verdict: Verdict,
    pub remark: String,
}

/// Judges every claim of the paper, from the paper's own parameters and from the `tables` of the user's trials.
///
/// `sigma` is the kind of skid ratio to be used; `is_synthetic` says whether the trials are synthetic.
///
/// # Errors
/// Returns an error if the built-in claims cannot be read.
pub(crate) fn scorecard(
    tables: Arc<Tables>,
    sigma: SigmaKind,
    is_synthetic: bool,
) -> Result<Vec<JudgedClaim>, ReportError> {
    let Claims { fitted, motion, claim } = Claims::load().map_err(ReportError::Claims)?;
    let formulas = Formulas::new(Paper::new(fitted, motion), Trials { tables, sigma });
    Ok(claim.into_par_iter().map(|claim| judge(claim, &formulas, is_synthetic)).collect())
}

/// Evaluates the formulas of a claim and judges it.
fn judge(claim: Claim, formulas: &Formulas, is_synthetic: bool) -> JudgedClaim {
    let computed = claim.computed.as_ref();
    let computed = computed.map(|formula| {
        formulas.find(formula).unwrap_or_else(|_| Found::with_note(f64::NAN, NO_MOTION))
    });
    let mut sentences = Vec::new();
    let measured = claim.measured.as_ref().map(|formula| formulas.find(formula));
    let judged = match (claim.judged, &measured) {
        (Judged::Measured, _) if is_synthetic => {
            sentences.push(
                "The claim is about the experiment, but these trials are synthetic.".to_owned(),
            );
            None
        }
        (Judged::Computed, _) => computed.as_ref(),
        (Judged::Measured, Some(Ok(found))) => Some(found),
        (Judged::Measured, Some(Err(error))) => {
            let is_missing = error.kind() == ErrorKind::UndefinedError;
            let reason = error.detail().filter(|_| is_missing);
            sentences
                .push(reason.unwrap_or("The tables contain no value for this claim.").to_owned());
            None
        }
        (Judged::Measured, None) => None,
    };
    let verdict = match judged.map(|found| claim.criterion.is_met(found, claim.printed)) {
        Some(Some(true)) => Verdict::Reproduced,
        Some(Some(false)) => Verdict::Differs,
        Some(None) => {
            sentences.push("The value has no confidence interval.".to_owned());
            Verdict::NotTestable
        }
        None => Verdict::NotTestable,
    };
    let judged = judged.filter(|_| verdict != Verdict::NotTestable);

    sentences.push(claim.remark.clone());
    sentences.extend(judged.map(|found| match found.limits {
        Some(limits) => format!("95 % interval {}.", interval(limits, 4)),
        None => found.note.to_owned(),
    }));
    sentences.extend(claim.also.iter().map(|also| {
        let value = formulas.find(&also.computed).map_or(f64::NAN, |found| found.value);
        also.text.replace("{}", &significant(value, 6))
    }));
    sentences.retain(|sentence| !sentence.is_empty());

    let number = |found: &Found| Some(found.value).filter(|value| value.is_finite());
    let printed = claim.printed.filter(|printed| *printed != 0.0);
    let difference = judged.zip(printed).map(|(found, printed)| found.value / printed - 1.0);
    JudgedClaim {
        judged_by: judged.map(|_| claim.judged),
        relative_difference: difference.filter(|value| value.is_finite()),
        computed: computed.as_ref().and_then(number),
        measured: measured.as_ref().and_then(|found| number(found.as_ref().ok()?)),
        verdict,
        remark: sentences.join(" "),
        claim,
    }
}
