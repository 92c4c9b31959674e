//! The scorecard: the numbers and claims that the paper prints, and what becomes of them.
//!
//! The claims and how each is answered are data, `claims.toml`. A claim has a *computed* number,
//! which the motion solver gives from the paper's own parameters whatever the user's
//! configuration says, or a *measured* one, which the tables of the trials at hand give, or both.
//! Nothing is fitted or tuned to a claim. Identities of the mechanics are tests instead, and what
//! no program can judge stands in `docs/paper-claims.md`.
//!
//! # Verdicts
//!
//! - `reproduced`: the number that the claim is judged by meets its criterion, which comes from the
//!   claim: half a unit of the last printed digit, the interval of what was measured, or what its
//!   words ask for (the head of `claims.toml`). No criterion is one that every number meets.
//! - `differs`: it does not, or there is no such number (a motion that does not exist).
//! - `not testable here`: the folder lacks what it takes, or its trials are synthetic.
//!
//! What trials or fits to them show is judged by the trials at hand, and not by synthetic ones,
//! which say nothing of the experiment; what the models with the authors' values show, by the
//! computed number. Of the fits those count that the commanded gait drives, as in the paper.

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

/// One line of the scorecard. A number that there is not, or that has no bound, is null.
#[derive(Debug, Serialize)]
pub(crate) struct JudgedClaim {
    #[serde(flatten)]
    pub claim: Claim,
    pub judged_by: Option<Judged>,
    pub computed: Option<f64>,
    pub measured: Option<f64>,
    /// Of the number that it is judged by from the printed one.
    pub relative_difference: Option<f64>,
    pub verdict: Verdict,
    pub remark: String,
}

/// Judges every claim, by the paper's parameters and by the `tables` at hand, of whose skid
/// ratios those of kind `sigma` count; `is_synthetic` if they come from trials with a planted
/// truth.
///
/// # Errors
/// The claims that come with the program cannot be read.
pub(crate) fn scorecard(
    tables: Arc<Tables>,
    sigma: SigmaKind,
    is_synthetic: bool,
) -> Result<Vec<JudgedClaim>, ReportError> {
    let Claims { fitted, motion, claim } = Claims::load().map_err(ReportError::Claims)?;
    let formulas = Formulas::new(Paper::new(fitted, motion), Trials { tables, sigma });
    Ok(claim.into_par_iter().map(|claim| judge(claim, &formulas, is_synthetic)).collect())
}

fn judge(claim: Claim, formulas: &Formulas, is_synthetic: bool) -> JudgedClaim {
    let no_motion = |_| Found::with_note(f64::NAN, NO_MOTION);
    let computed = claim.computed.as_ref();
    let computed = computed.map(|formula| formulas.find(formula).unwrap_or_else(no_motion));
    let mut sentences = Vec::new();
    let measured = claim.measured.as_ref().map(|formula| formulas.find(formula));
    let judged = match (claim.judged, &measured) {
        (Judged::Measured, _) if is_synthetic => {
            sentences.push("A claim on the experiment, and these trials are synthetic.".to_owned());
            None
        }
        (Judged::Computed, _) => computed.as_ref(),
        (Judged::Measured, Some(Ok(found))) => Some(found),
        (Judged::Measured, Some(Err(error))) => {
            let is_missing = error.kind() == ErrorKind::UndefinedError;
            let reason = error.detail().filter(|_| is_missing);
            sentences.push(reason.unwrap_or("The tables give it no value.").to_owned());
            None
        }
        (Judged::Measured, None) => None,
    };
    let verdict = match judged.map(|found| claim.criterion.is_met(found, claim.printed)) {
        Some(Some(true)) => Verdict::Reproduced,
        Some(Some(false)) => Verdict::Differs,
        Some(None) => {
            sentences.push("There is no confidence interval.".to_owned());
            Verdict::NotTestable
        }
        None => Verdict::NotTestable,
    };
    let judged = judged.filter(|_| verdict != Verdict::NotTestable);

    sentences.push(claim.remark.clone());
    // Beside the verdict, what there is to say of the number.
    sentences.extend(judged.map(|found| match found.limits {
        Some(limits) => format!("95 % interval {}.", interval(limits, 4)),
        None => found.note.to_owned(),
    }));
    sentences.extend(claim.also.iter().map(|also| {
        let value = formulas.find(&also.computed).map_or(f64::NAN, |found| found.value);
        also.text.replace("{}", &significant(value, 6))
    }));
    sentences.retain(|sentence| !sentence.is_empty());

    let finite = |value: &f64| value.is_finite();
    let number = |found: &Found| Some(found.value).filter(finite);
    let printed = claim.printed.filter(|printed| *printed != 0.0);
    let difference = judged.zip(printed).map(|(found, printed)| found.value / printed - 1.0);
    JudgedClaim {
        judged_by: judged.map(|_| claim.judged),
        relative_difference: difference.filter(finite),
        computed: computed.as_ref().and_then(number),
        measured: measured.as_ref().and_then(|found| number(found.as_ref().ok()?)),
        verdict,
        remark: sentences.join(" "),
        claim,
    }
}
